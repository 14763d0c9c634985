//! Any sample rate to 16 kHz: a windowed sinc applied by FFT (rubato's `Fft`), chunk by chunk.
//!
//! The ratio is exact (both rates are integers), the filter's delay is removed, and nothing that
//! would fold below 8 kHz survives: the squared Blackman-Harris window stops more than 100 dB.

use rubato::{
    Fft, FixedSync, Resampler, WindowFunction, audioadapter_buffers::direct::InterleavedSlice,
};

use super::SAMPLE_RATE_HZ;
use crate::{Error, Result};

/// Smallest block on either side. Longer blocks mean a steeper filter: with 1024 samples the
/// passband ends within 3 % of 8 kHz.
const SMALLEST_BLOCK: usize = 1024;

/// Streams mono samples of one rate into 16 kHz.
pub(super) enum ToSpeechRate {
    /// The sound is at 16 kHz already.
    Same {
        out: Vec<f32>,
    },
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
    taken: u64,
    out: Vec<f32>,
}

impl ToSpeechRate {
    pub(super) fn new(rate_hz: u32) -> Result<Self> {
        if rate_hz == SAMPLE_RATE_HZ {
            return Ok(Self::Same { out: Vec::new() });
        }
        Converter::new(rate_hz).map(|converter| Self::Convert(Box::new(converter)))
    }

    pub(super) fn push(&mut self, mono: &[f32]) -> Result<()> {
        match self {
            Self::Same { out } => {
                out.extend_from_slice(mono);
                Ok(())
            }
            Self::Convert(converter) => converter.push(mono),
        }
    }

    /// All output, exactly `round(S · 16000 / rate)` samples (at least one if there was input).
    pub(super) fn finish(self) -> Result<Vec<f32>> {
        match self {
            Self::Same { out } => Ok(out),
            Self::Convert(converter) => converter.finish(),
        }
    }
}

impl Converter {
    fn new(rate_hz: u32) -> Result<Self> {
        let (rate_in, rate_out) = (rate_hz as usize, SAMPLE_RATE_HZ as usize);
        let divisor = greatest_common_divisor(rate_in, rate_out);
        let (step_in, step_out) = (rate_in / divisor, rate_out / divisor);
        // An even number of steps keeps the delay, half a block, a whole number of samples.
        let steps = SMALLEST_BLOCK
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
            taken: 0,
            out: Vec::new(),
        })
    }

    fn push(&mut self, mut mono: &[f32]) -> Result<()> {
        self.taken += mono.len() as u64;
        let block = self.fft.input_frames_next();
        while !mono.is_empty() {
            let take = (block - self.pending.len()).min(mono.len());
            self.pending.extend_from_slice(&mono[..take]);
            mono = &mono[take..];
            if self.pending.len() == block {
                self.convert_block()?;
            }
        }
        Ok(())
    }

    fn convert_block(&mut self) -> Result<()> {
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
        self.out
            .extend_from_slice(&self.block_out[dropped..written]);
        self.pending.clear();
        Ok(())
    }

    fn finish(mut self) -> Result<Vec<f32>> {
        let wanted = output_length(self.taken, self.rate_hz);
        let block = self.fft.input_frames_next();
        while self.out.len() < wanted {
            self.pending.resize(block, 0.0);
            self.convert_block()?;
        }
        self.out.truncate(wanted);
        Ok(self.out)
    }
}

/// `round(S · 16000 / rate)`, at least one if there is any input.
fn output_length(taken: u64, rate_hz: u32) -> usize {
    let rate = u64::from(rate_hz);
    let rounded = (taken * u64::from(SAMPLE_RATE_HZ) + rate / 2) / rate;
    rounded.max(u64::from(taken > 0)) as usize
}

fn greatest_common_divisor(mut a: usize, mut b: usize) -> usize {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}
