//! Resamples any rate to 16 kHz with a windowed sinc, applied by FFT (rubato's `Fft`) in chunks.
//!
//! The ratio is exact (both rates are integers), and the filter's delay is removed. The squared
//! Blackman-Harris window attenuates frequencies that would fold below 8 kHz by more than 100 dB.

use std::ops::Range;

use rubato::{
    Fft, FixedSync, Resampler, WindowFunction, audioadapter_buffers::direct::InterleavedSlice,
};

use super::SAMPLE_RATE_HZ;
use crate::{Error, Result};

/// Smallest block of input or output. Longer blocks mean a steeper filter: with 1024 samples the
/// passband ends within 3 % of 8 kHz.
const SMALLEST_BLOCK: usize = 1024;
/// The same for sound that is still going on, whose delay counts: half a block at the lower of both rates. The passband
/// ends within 10 % of 8 kHz.
const SMALLEST_LIVE_BLOCK: usize = 320;

/// Receives mono samples at [`SAMPLE_RATE_HZ`] piece by piece during decoding. An error ends the
/// decoding.
pub(super) type Take<'a> = &'a mut dyn FnMut(&[f32]) -> Result<()>;

/// Streams mono samples of one rate into 16 kHz.
pub(super) enum ToSpeechRate {
    /// The sound is at 16 kHz already.
    Same,
    Convert(Box<Converter>),
}

pub(super) struct Converter {
    fft: Fft<f32>,
    rate_hz: u32,
    /// Input that does not fill a block yet.
    pending: Vec<f32>,
    block_out: Vec<f32>,
    /// Output samples of the filter's delay that are still to be dropped.
    to_drop: usize,
    samples_in: u64,
    /// Output samples passed on so far.
    gone: u64,
}

impl ToSpeechRate {
    pub(super) fn new(rate_hz: u32) -> Result<Self> {
        Self::with_blocks(rate_hz, SMALLEST_BLOCK)
    }

    fn with_blocks(rate_hz: u32, smallest: usize) -> Result<Self> {
        if rate_hz == SAMPLE_RATE_HZ {
            return Ok(Self::Same);
        }
        let converter = Converter::new(rate_hz, smallest)?;
        Ok(Self::Convert(Box::new(converter)))
    }

    pub(super) fn push(&mut self, mono: &[f32], out: Take<'_>) -> Result<()> {
        match self {
            Self::Same => out(mono),
            Self::Convert(converter) => converter.push(mono, out),
        }
    }

    /// Passes on the rest, so that the output has exactly `round(S · 16000 / rate)` samples (at
    /// least one if there was input).
    pub(super) fn finish(self, out: Take<'_>) -> Result<()> {
        match self {
            Self::Same => Ok(()),
            Self::Convert(converter) => converter.finish(out),
        }
    }
}

impl Converter {
    fn new(rate_hz: u32, smallest_block: usize) -> Result<Self> {
        let (rate_in, rate_out) = (rate_hz as usize, SAMPLE_RATE_HZ as usize);
        let divisor = greatest_common_divisor(rate_in, rate_out);
        let (step_in, step_out) = (rate_in / divisor, rate_out / divisor);
        // An even number of steps keeps the delay, half a block, a whole number of samples.
        let steps = smallest_block
            .div_ceil(step_in.min(step_out))
            .next_multiple_of(2);
        let fft = Fft::new_custom(
            rate_in,
            rate_out,
            step_in * steps,
            1,
            1,
            WindowFunction::BlackmanHarris2,
            FixedSync::Both,
        )
        .map_err(|e| Error::Audio(format!("cannot resample from {rate_hz} Hz: {e}")))?;
        Ok(Converter {
            to_drop: fft.output_delay(),
            block_out: vec![0.0; fft.output_frames_max()],
            pending: Vec::with_capacity(fft.input_frames_max()),
            fft,
            rate_hz,
            samples_in: 0,
            gone: 0,
        })
    }

    fn push(&mut self, mut mono: &[f32], out: Take<'_>) -> Result<()> {
        self.samples_in += mono.len() as u64;
        let block = self.fft.input_frames_next();
        while !mono.is_empty() {
            let take = (block - self.pending.len()).min(mono.len());
            self.pending.extend_from_slice(&mono[..take]);
            mono = &mono[take..];
            if self.pending.len() == block {
                let converted = self.convert_block()?;
                self.gone += converted.len() as u64;
                out(&self.block_out[converted])?;
            }
        }
        Ok(())
    }

    /// Converts the pending samples. Returns where the new samples lie in `block_out`.
    fn convert_block(&mut self) -> Result<Range<usize>> {
        let frames_out = self.block_out.len();
        let failed = |e: &dyn std::fmt::Display| Error::Audio(format!("resampling failed: {e}"));
        let from = InterleavedSlice::new(&self.pending[..], 1, self.pending.len())
            .map_err(|e| failed(&e))?;
        let mut to = InterleavedSlice::new_mut(&mut self.block_out[..], 1, frames_out)
            .map_err(|e| failed(&e))?;
        let (_, written) = self
            .fft
            .process_into_buffer(&from, &mut to, None)
            .map_err(|e| failed(&e))?;
        let dropped = self.to_drop.min(written);
        self.to_drop -= dropped;
        self.pending.clear();
        Ok(dropped..written)
    }

    fn finish(mut self, out: Take<'_>) -> Result<()> {
        let total = output_length(self.samples_in, self.rate_hz);
        let block = self.fft.input_frames_next();
        while self.gone < total {
            self.pending.resize(block, 0.0);
            let converted = self.convert_block()?;
            let left = usize::try_from(total - self.gone).unwrap_or(usize::MAX);
            let converted =
                converted.start..converted.end.min(converted.start.saturating_add(left));
            self.gone += converted.len() as u64;
            out(&self.block_out[converted])?;
        }
        Ok(())
    }
}

/// Converts sound that is still going on to [`SAMPLE_RATE_HZ`], in blocks of 20 ms and more.
pub struct RateConverter(ToSpeechRate);

impl RateConverter {
    /// From `rate_hz`. Rates that share few factors with 16,000 have long blocks: 44,100 those of 20 ms,
    /// 44,101 those of two seconds.
    ///
    /// # Errors
    /// `Audio` if there is no filter for this rate.
    pub fn new(rate_hz: u32) -> Result<RateConverter> {
        let converter = ToSpeechRate::with_blocks(rate_hz, SMALLEST_LIVE_BLOCK)?;
        Ok(RateConverter(converter))
    }

    /// Takes mono samples and returns those that are ready.
    ///
    /// # Errors
    /// `Audio` if the filter fails.
    pub fn push(&mut self, mono: &[f32]) -> Result<Vec<f32>> {
        let mut samples = Vec::new();
        self.0.push(mono, &mut |block| {
            samples.extend_from_slice(block);
            Ok(())
        })?;
        Ok(samples)
    }

    /// Ends the sound and returns the rest.
    ///
    /// # Errors
    /// `Audio` if the filter fails.
    pub fn finish(self) -> Result<Vec<f32>> {
        let mut samples = Vec::new();
        self.0.finish(&mut |block| {
            samples.extend_from_slice(block);
            Ok(())
        })?;
        Ok(samples)
    }
}

/// `round(S · 16000 / rate)`, at least one if there is any input.
fn output_length(samples_in: u64, rate_hz: u32) -> u64 {
    let rate = u64::from(rate_hz);
    let rounded = (samples_in * u64::from(SAMPLE_RATE_HZ) + rate / 2) / rate;
    rounded.max(u64::from(samples_in > 0))
}

fn greatest_common_divisor(mut a: usize, mut b: usize) -> usize {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}
