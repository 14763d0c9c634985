//! Takes samples from the decoders, mixes them to mono, checks each one and resamples.

use super::{
    mixdown::Mixdown,
    resample::{Take, ToSpeechRate},
    waveform::{ACCEPTED_RATES_HZ, LOUDEST, Waveform},
};
use crate::{Error, Result, job::outside::guarded};

/// Takes interleaved samples in any number of pieces. Passes them on as the speech models need
/// them: mono, at one rate.
pub(super) struct Intake<'a> {
    out: Take<'a>,
    channels: usize,
    mixdown: Mixdown,
    resampler: ToSpeechRate,
    /// Reused mono buffer.
    mono: Vec<f32>,
    frames: u64,
    /// Frames with a sample that is not finite, and frames with one that is too large.
    not_finite: Count,
    too_large: Count,
    /// Frames that are still to be dropped before the sound starts.
    to_drop: usize,
    /// Frames that are still to be accepted.
    frames_left: usize,
}

impl<'a> Intake<'a> {
    pub(super) fn new(channels: usize, rate_hz: u32, out: Take<'a>) -> Result<Self> {
        if channels == 0 {
            return Err(Error::Audio("expected at least 1 channel, got 0".into()));
        }
        if !ACCEPTED_RATES_HZ.contains(&rate_hz) {
            return Err(Error::Audio(format!(
                "expected a sample rate of {} to {} Hz, got {rate_hz}",
                ACCEPTED_RATES_HZ.start(),
                ACCEPTED_RATES_HZ.end()
            )));
        }
        Ok(Intake {
            out,
            channels,
            mixdown: Mixdown::new(channels, rate_hz),
            resampler: ToSpeechRate::new(rate_hz)?,
            mono: Vec::new(),
            frames: 0,
            not_finite: Count::default(),
            too_large: Count::default(),
            to_drop: 0,
            frames_left: usize::MAX,
        })
    }

    /// Keeps only `frames` frames after the first `to_drop`. Call it before the first
    /// [`Intake::push`].
    pub(super) fn keep(&mut self, to_drop: usize, frames: usize) {
        self.to_drop = to_drop;
        self.frames_left = frames;
    }

    /// `interleaved`: `[S, C]`, whole frames.
    pub(super) fn push(&mut self, interleaved: &[f32]) -> Result<()> {
        let frames = interleaved.len() / self.channels;
        let dropped = self.to_drop.min(frames);
        let accepted = self.frames_left.min(frames - dropped);
        self.to_drop -= dropped;
        self.frames_left -= accepted;
        let interleaved = &interleaved[dropped * self.channels..][..accepted * self.channels];
        self.mono.clear();
        for (here, frame) in (self.frames..).zip(interleaved.chunks_exact(self.channels)) {
            if frame.iter().any(|x| !x.is_finite()) {
                self.not_finite.add(here);
            } else if frame.iter().any(|x| x.abs() > LOUDEST) {
                self.too_large.add(here);
            }
            self.mixdown.push(frame, &mut self.mono);
        }
        self.frames += accepted as u64;
        // `finish` will refuse a sound with such frames, so from here on they are only counted.
        match self.not_finite.first.or(self.too_large.first) {
            None => self.resampler.push(&self.mono, self.out),
            Some(_) => Ok(()),
        }
    }

    pub(super) fn finish(mut self) -> Result<()> {
        if let Count {
            count,
            first: Some(first),
        } = self.not_finite
        {
            return Err(Error::Audio(format!(
                "expected finite samples, got {count} of {} that are NaN or infinite, the first at {first}",
                self.frames
            )));
        }
        if let Count {
            count,
            first: Some(first),
        } = self.too_large
        {
            return Err(Error::Audio(format!(
                "expected samples within ±{LOUDEST}, got {count} of {} that are larger, the first at {first}; \
                 full scale is ±1",
                self.frames
            )));
        }
        if self.frames == 0 {
            return Err(Error::Audio("expected sound, got no samples".into()));
        }
        self.mono.clear();
        self.mixdown.finish(&mut self.mono);
        self.resampler.push(&self.mono, self.out)?;
        self.resampler.finish(self.out)
    }
}

/// How many frames have the same fault, and the index of the first.
#[derive(Default, Clone, Copy)]
struct Count {
    count: u64,
    first: Option<u64>,
}

impl Count {
    fn add(&mut self, here: u64) {
        self.count += 1;
        self.first.get_or_insert(here);
    }
}

impl Waveform {
    /// Makes a waveform from a host's own samples.
    ///
    /// `samples`: `[S, C]` interleaved, nominally in [−1, 1]; `rate_hz` within
    /// [`ACCEPTED_RATES_HZ`]. The result has `round(S · 16000 / rate_hz)` samples, at least one.
    ///
    /// # Errors
    /// `Audio` for no samples, a length that is no multiple of `channels`, a rate out of range, or
    /// samples that are not finite or beyond ±[`LOUDEST`] (says how many and where the first is).
    pub fn from_interleaved(samples: &[f32], channels: usize, rate_hz: u32) -> Result<Self> {
        if channels == 0 || !samples.len().is_multiple_of(channels) {
            return Err(Error::Audio(format!(
                "expected whole frames of {channels} channels, got {} samples",
                samples.len()
            )));
        }
        guarded(Error::Audio, || {
            let mut mono = Vec::new();
            let mut keep = |piece: &[f32]| {
                mono.extend_from_slice(piece);
                Ok(())
            };
            let mut intake = Intake::new(channels, rate_hz, &mut keep)?;
            intake.push(samples)?;
            intake.finish()?;
            Ok(Waveform { samples: mono })
        })
    }
}
