//! Log-mel spectrogram of 16 kHz mono speech: the input of the compact encoder.
//!
//! Twin of `training/speech/log_mel.py`; a golden test compares the two.

use std::{f64::consts::TAU, sync::Arc};

use realfft::{RealFftPlanner, RealToComplex, num_complex::Complex};

use crate::audio::SAMPLE_RATE_HZ;

/// Number of mel bands.
pub const BANDS: usize = 64;
/// Samples from one frame to the next: 100 frames a second.
pub const HOP: usize = 160;
/// Samples in a frame. Half of them lie before the frame's instant.
pub const FRAME: usize = 400;
const FFT: usize = 512;
const LOW_HZ: f64 = 50.0;
const HIGH_HZ: f64 = 7600.0;
/// Smallest power that enters the logarithm.
const FLOOR: f32 = 1e-6;

/// Natural logarithm of the mel power, at 100 frames a second.
///
/// Frame `i` is centred on sample `160 i` and starts at `160 i − 200`. Beyond both ends the sound
/// is zero. Periodic Hann window of 400 samples, zero-padded on the right to 512; `|X|²`;
/// triangular filters with peak 1, evenly spaced on the HTK mel scale from 50 to 7600 Hz;
/// `ln(max(·, 1e-6))`.
///
/// # Shapes and units
/// `samples`: `[S]` at 16 kHz, nominally in [−1, 1]. Returns `[1 + S / 160, 64]`.
#[cfg(test)]
pub(super) fn log_mel(samples: &[f32]) -> ndarray::Array2<f32> {
    let mut analyser = MelAnalyser::new();
    let mut stretch = [0.0; FRAME];
    let mut out = ndarray::Array2::zeros((frames_of_samples(samples.len()), BANDS));
    for (i, mut row) in out.outer_iter_mut().enumerate() {
        cut_frame(samples, i, &mut stretch);
        analyser.frame(&stretch, row.as_slice_mut().expect("a row is contiguous"));
    }
    out
}

/// Number of frames for a number of samples.
pub(super) fn frames_of_samples(samples: usize) -> usize {
    1 + samples / HOP
}

/// Copies the [`FRAME`] samples around frame number `frame` into `stretch`, with zeros beyond the
/// ends of the sound.
pub(super) fn cut_frame(samples: &[f32], frame: usize, stretch: &mut [f32; FRAME]) {
    let start = (frame * HOP) as isize - (FRAME / 2) as isize;
    for (k, x) in stretch.iter_mut().enumerate() {
        let at = usize::try_from(start + k as isize).ok();
        *x = at.and_then(|at| samples.get(at)).copied().unwrap_or(0.0);
    }
}

/// Computes [`log_mel`] frame by frame, for sound that arrives in pieces.
pub struct MelAnalyser {
    transform: Arc<dyn RealToComplex<f32>>,
    window: [f32; FRAME],
    filters: Vec<Filter>,
    framed: Vec<f32>,
    spectrum: Vec<Complex<f32>>,
    scratch: Vec<Complex<f32>>,
}

impl MelAnalyser {
    /// Plans the transform and lays out the filters.
    #[expect(
        clippy::new_without_default,
        reason = "it plans, which a default should not"
    )]
    pub fn new() -> Self {
        let transform = RealFftPlanner::<f32>::new().plan_fft_forward(FFT);
        MelAnalyser {
            window: hann(),
            filters: mel_filters(),
            framed: transform.make_input_vec(),
            spectrum: transform.make_output_vec(),
            scratch: transform.make_scratch_vec(),
            transform,
        }
    }

    /// Writes the log-mel of the [`FRAME`] samples around one instant into `row`, which has
    /// [`BANDS`] values.
    pub fn frame(&mut self, samples: &[f32; FRAME], row: &mut [f32]) {
        self.framed.fill(0.0);
        for ((x, w), sample) in self.framed.iter_mut().zip(&self.window).zip(samples) {
            *x = w * sample;
        }
        self.transform
            .process_with_scratch(&mut self.framed, &mut self.spectrum, &mut self.scratch)
            .expect("buffers come from the transform itself");
        for (band, filter) in row.iter_mut().zip(&self.filters) {
            let bins = filter
                .weights
                .iter()
                .zip(&self.spectrum[filter.first_bin..]);
            let power: f32 = bins.map(|(w, x)| w * x.norm_sqr()).sum();
            *band = power.max(FLOOR).ln();
        }
    }

    /// `|X|²` of the latest frame, bin by bin.
    pub(super) fn power(&self) -> impl Iterator<Item = f64> {
        self.spectrum.iter().map(|x| x.norm_sqr().into())
    }
}

fn hann() -> [f32; FRAME] {
    std::array::from_fn(|k| (0.5 - 0.5 * (TAU * k as f64 / FRAME as f64).cos()) as f32)
}

/// A triangular filter: its non-zero weights, which begin at `first_bin`.
struct Filter {
    first_bin: usize,
    weights: Vec<f32>,
}

fn mel_filters() -> Vec<Filter> {
    let (low, high) = (hertz_to_mel(LOW_HZ), hertz_to_mel(HIGH_HZ));
    let edge = |i: usize| mel_to_hertz(low + (high - low) * i as f64 / (BANDS + 1) as f64);
    (0..BANDS)
        .map(|band| {
            let (from, peak, to) = (edge(band), edge(band + 1), edge(band + 2));
            let weight = |bin: usize| {
                let hertz = bin as f64 * f64::from(SAMPLE_RATE_HZ) / FFT as f64;
                let rise = (hertz - from) / (peak - from);
                let fall = (to - hertz) / (to - peak);
                rise.min(fall).max(0.0) as f32
            };
            let inside: Vec<usize> = (0..=FFT / 2).filter(|bin| weight(*bin) > 0.0).collect();
            Filter {
                first_bin: inside.first().copied().unwrap_or(0),
                weights: inside.iter().map(|bin| weight(*bin)).collect(),
            }
        })
        .collect()
}

/// HTK scale: 2595 log₁₀(1 + f / 700).
fn hertz_to_mel(hertz: f64) -> f64 {
    2595.0 * (1.0 + hertz / 700.0).log10()
}

fn mel_to_hertz(mel: f64) -> f64 {
    700.0 * (10f64.powf(mel / 2595.0) - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::Golden;

    #[test]
    fn agrees_with_python() {
        let golden = Golden::open("log_mel_debug");
        let (mel, known) = (log_mel(&golden.values("input")), golden.matrix("output"));
        assert_eq!(mel.dim(), known.dim());
        // The chirp leaves some bands 100 dB down, where FFTs in single precision disagree.
        assert!(mel.iter().zip(&known).all(|(a, b)| (a - b).abs() < 1e-3));
    }

    /// The definition, bin by bin, in double precision.
    fn slow_twin(samples: &[f32], frame: usize, band: usize) -> f64 {
        let (low, high) = (hertz_to_mel(LOW_HZ), hertz_to_mel(HIGH_HZ));
        let edges: Vec<f64> = (0..BANDS + 2)
            .map(|i| mel_to_hertz(low + (high - low) * i as f64 / 65.0))
            .collect();
        let mut sum = 0.0;
        for bin in 0..=FFT / 2 {
            let hertz = bin as f64 * 16_000.0 / FFT as f64;
            let rise = (hertz - edges[band]) / (edges[band + 1] - edges[band]);
            let fall = (edges[band + 2] - hertz) / (edges[band + 2] - edges[band + 1]);
            let weight = rise.min(fall).max(0.0);
            if weight == 0.0 {
                continue;
            }
            let (mut re, mut im) = (0.0, 0.0);
            for k in 0..FRAME {
                let at = (frame * HOP + k) as isize - 200;
                if at < 0 || at >= samples.len() as isize {
                    continue;
                }
                let w = 0.5 - 0.5 * (TAU * k as f64 / 400.0).cos();
                let x = w * f64::from(samples[at as usize]);
                let (s, c) = (TAU * (bin * k) as f64 / 512.0).sin_cos();
                re += x * c;
                im -= x * s;
            }
            sum += weight * (re * re + im * im);
        }
        sum.max(1e-6).ln()
    }

    fn noise(samples: usize) -> Vec<f32> {
        let mut state = 1u64;
        (0..samples)
            .map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
                ((state >> 40) as f32 / (1u64 << 23) as f32 - 1.0) * 0.3
            })
            .collect()
    }

    #[test]
    fn equals_the_definition() {
        let samples = noise(1000);
        let mel = log_mel(&samples);
        assert_eq!(mel.dim(), (7, 64));
        for frame in [0, 3, 6] {
            for band in [0, 1, 20, 40, 63] {
                let expected = slow_twin(&samples, frame, band);
                let got = f64::from(mel[[frame, band]]);
                assert!(
                    (got - expected).abs() < 1e-4,
                    "[{frame}, {band}]: {got} {expected}"
                );
            }
        }
    }

    #[test]
    fn silence_is_the_floor_and_nothing_gives_one_frame() {
        assert!(log_mel(&[0.0; 480]).iter().all(|x| *x == FLOOR.ln()));
        assert_eq!(log_mel(&[]).dim(), (1, 64));
        assert_eq!(log_mel(&[0.1; 159]).dim(), (1, 64));
    }

    #[test]
    fn every_band_sees_at_least_one_bin() {
        assert!(
            mel_filters()
                .iter()
                .all(|filter| !filter.weights.is_empty())
        );
    }
}
