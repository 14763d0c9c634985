//! Converts what a device records to mono at 16 kHz.

use cpal::{FromSample, Sample};
use rubato::{
    Async, FixedAsync, Resampler, SincInterpolationParameters, WindowFunction,
    audioadapter_buffers::direct::InterleavedSlice,
};

use crate::SAMPLE_RATE_HZ;

/// Length of the filter in samples of the device. Its delay is half of that, 2.7 ms at 48 kHz.
const FILTER: usize = 256;
/// Blocks per second: sound is converted one block at a time.
const PARTS: u32 = 100;

/// Mixes the channels of a device and converts its rate.
pub(crate) struct Intake {
    channels: usize,
    mono: Vec<f32>,
    converter: Option<Converter>,
}

/// Converts from one sample rate to another, block by block.
pub(crate) struct Converter {
    filter: Async<f32>,
    block: usize,
    out: Vec<f32>,
}

impl Intake {
    /// For a device with this many channels at `rate_hz`.
    ///
    /// # Errors
    /// The reason, if that rate cannot be converted.
    pub fn new(channels: usize, rate_hz: u32) -> Result<Intake, String> {
        let converter = match rate_hz {
            SAMPLE_RATE_HZ => None,
            _ => Some(Converter::new(rate_hz, SAMPLE_RATE_HZ)?),
        };
        Ok(Intake {
            channels: channels.max(1),
            mono: Vec::new(),
            converter,
        })
    }

    /// Converts a device's samples, with interleaved channels, to mono samples `[S]` at 16 kHz.
    /// Values that are not finite become silence.
    pub fn take<T: Copy>(&mut self, data: &[T]) -> Vec<f32>
    where
        f32: FromSample<T>,
    {
        let share = 1.0 / self.channels as f32;
        let frames = data.chunks_exact(self.channels).map(|frame| {
            let sum: f32 = frame.iter().map(|x| f32::from_sample(*x)).sum();
            let sample = share * sum;
            if sample.is_finite() {
                sample
            } else {
                f32::EQUILIBRIUM
            }
        });
        self.mono.extend(frames);
        match &mut self.converter {
            None => std::mem::take(&mut self.mono),
            Some(converter) => converter.take(&mut self.mono),
        }
    }
}

impl Converter {
    /// # Errors
    /// The reason, if there is no filter for these rates.
    pub fn new(from_hz: u32, to_hz: u32) -> Result<Converter, String> {
        let parameters = SincInterpolationParameters::new(FILTER, WindowFunction::BlackmanHarris2);
        let ratio = f64::from(to_hz) / f64::from(from_hz);
        let block = (from_hz / PARTS).max(1) as usize;
        let filter = Async::new_sinc(ratio, 1.0, &parameters, block, 1, FixedAsync::Input)
            .map_err(|e| format!("{from_hz} Hz to {to_hz} Hz: {e}"))?;
        Ok(Converter {
            out: vec![0.0; filter.output_frames_max()],
            block,
            filter,
        })
    }

    /// Removes whole blocks from the front of `mono` and returns them converted.
    pub fn take(&mut self, mono: &mut Vec<f32>) -> Vec<f32> {
        let mut samples = Vec::new();
        let whole = mono.len() / self.block * self.block;
        for block in mono[..whole].chunks_exact(self.block) {
            let room = self.out.len();
            let from = InterleavedSlice::new(block, 1, self.block).expect("a whole block");
            let mut to =
                InterleavedSlice::new_mut(&mut self.out, 1, room).expect("room for a block");
            let (_, count) = self
                .filter
                .process_into_buffer(&from, &mut to, None)
                .expect("a whole block and room for it");
            samples.extend_from_slice(&self.out[..count]);
        }
        mono.drain(..whole);
        samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tone(hz: f64, rate_hz: u32, seconds: f64) -> Vec<f32> {
        let count = (seconds * f64::from(rate_hz)) as usize;
        let at = |n: usize| (std::f64::consts::TAU * hz * n as f64 / f64::from(rate_hz)).sin();
        (0..count).map(|n| (0.5 * at(n)) as f32).collect()
    }

    /// Root mean square after the first tenth of a second.
    fn size(samples: &[f32]) -> f64 {
        let rest = &samples[1600..];
        (rest.iter().map(|x| f64::from(x * x)).sum::<f64>() / rest.len() as f64).sqrt()
    }

    #[test]
    fn other_rates_become_16_khz_however_they_come() {
        for rate_hz in [8_000, 11_025, 44_100, 48_000, 96_000] {
            let recorded = tone(440.0, rate_hz, 1.0);
            let mut whole = Intake::new(1, rate_hz).unwrap();
            let whole = whole.take(&recorded);
            assert!(
                (15_600..16_001).contains(&whole.len()),
                "{rate_hz}: {}",
                whole.len()
            );
            assert!(
                (size(&whole) - 0.5 / 2.0f64.sqrt()).abs() < 0.005,
                "{rate_hz}"
            );
            let mut pieces = Intake::new(1, rate_hz).unwrap();
            let pieces: Vec<f32> = recorded.chunks(77).flat_map(|x| pieces.take(x)).collect();
            assert_eq!(pieces, whole, "{rate_hz}");
        }
    }

    #[test]
    fn what_lies_above_8_khz_does_not_fold_down() {
        let heard = Intake::new(1, 48_000)
            .unwrap()
            .take(&tone(11_000.0, 48_000, 1.0));
        assert!(size(&heard) < 0.001, "{}", size(&heard));
    }

    #[test]
    fn channels_are_mixed_and_formats_are_read() {
        let mut stereo = Intake::new(2, SAMPLE_RATE_HZ).unwrap();
        assert_eq!(stereo.take(&[0.5f32, -0.5, 1.0, 0.0]), [0.0, 0.5]);
        assert_eq!(stereo.take(&[i16::MAX / 2, i16::MAX / 2]).len(), 1);
        // A frame with a sample that is not finite becomes silence.
        assert_eq!(stereo.take(&[f32::NAN, 1.0]), [0.0]);
    }
}
