//! The log-mel spectrogram of Whisper. Twin of `decades` and `whisper_mel` in
//! `training/speech/whisper.py`.

use std::f64::consts::TAU;

use ndarray::Array2;
use realfft::RealFftPlanner;

use super::log_mel::{FRAME, HOP};
use crate::{audio::SAMPLE_RATE_HZ, nn::matrix};

/// Number of bands of all models except the latest large one, which has 128.
pub(super) const BANDS: usize = 80;
const HIGH_HZ: f64 = 8000.0;
/// Smallest power that enters the logarithm.
const FLOOR: f32 = 1e-10;
/// Power more than this many decades below the loudest band of the sound is raised to that level.
const RANGE: f32 = 8.0;
/// Slaney's scale is linear up to this frequency, hertz, and logarithmic above it.
const KNEE_HZ: f64 = 1000.0;
const KNEE_MEL: f64 = 15.0;

/// [`decades`] on Whisper's scale, about −1 to 1. Power more than [`RANGE`] decades below the loudest
/// band of the sound is raised to that level.
pub(super) fn whisper_mel(samples: &[f32]) -> Array2<f32> {
    let mel = decades(samples);
    let loudest = mel.fold(f32::NEG_INFINITY, |a, b| a.max(*b));
    mel.mapv_into(|x| on_scale(x.max(loudest - RANGE)))
}

/// Decades of power → Whisper's scale.
pub(super) fn on_scale(decades: f32) -> f32 {
    (decades + 4.0) / 4.0
}

/// Decades of power in Whisper's bands, at 100 frames a second. Frame `i` is centred on sample
/// `160 i`.
///
/// Periodic Hann window of 400 samples, the sound mirrored beyond both ends; `|X|²`; triangles of
/// equal area, evenly spaced on Slaney's scale from 0 to 8 kHz. `samples`: `[S]` at 16 kHz, more
/// than 200. Returns `[S / 160, 80]`.
pub(super) fn decades(samples: &[f32]) -> Array2<f32> {
    let transform = RealFftPlanner::<f32>::new().plan_fft_forward(FRAME);
    let window: [f32; FRAME] =
        std::array::from_fn(|k| (0.5 - 0.5 * (TAU * k as f64 / FRAME as f64).cos()) as f32);
    let filters = filters();
    matrix::by_row_blocks(samples.len() / HOP, BANDS, |frames, out| {
        let mut framed = transform.make_input_vec();
        let mut spectrum = transform.make_output_vec();
        let mut scratch = transform.make_scratch_vec();
        for (frame, row) in frames.zip(out.chunks_exact_mut(BANDS)) {
            cut_frame(samples, frame, &mut framed);
            framed.iter_mut().zip(&window).for_each(|(x, w)| *x *= w);
            transform
                .process_with_scratch(&mut framed, &mut spectrum, &mut scratch)
                .expect("buffers come from the transform itself");
            for (band, filter) in row.iter_mut().zip(&filters) {
                let bins = filter.weights.iter().zip(&spectrum[filter.first_bin..]);
                let power: f32 = bins.map(|(w, x)| w * x.norm_sqr()).sum();
                *band = power.max(FLOOR).log10();
            }
        }
    })
}

/// Copies the [`FRAME`] samples around frame number `frame`, with the sound mirrored beyond its
/// ends.
fn cut_frame(samples: &[f32], frame: usize, framed: &mut [f32]) {
    let middle = frame * HOP;
    let start = middle.checked_sub(FRAME / 2);
    match start.and_then(|start| samples.get(start..start + FRAME)) {
        Some(inside) => framed.copy_from_slice(inside),
        None => {
            for (k, x) in framed.iter_mut().enumerate() {
                *x = mirrored(samples, (middle + k) as isize - (FRAME / 2) as isize);
            }
        }
    }
}

/// The sample at `place`, which may lie beyond either end. There the sound is mirrored without
/// repeating its first or last sample.
fn mirrored(samples: &[f32], place: isize) -> f32 {
    let last = samples.len() as isize - 1;
    let inside = if place > last {
        2 * last - place
    } else {
        place.abs()
    };
    samples[inside as usize]
}

/// A triangle of equal area: its non-zero weights, which begin at `first_bin`.
struct Filter {
    first_bin: usize,
    weights: Vec<f32>,
}

/// One filter for each of [`BANDS`].
fn filters() -> Vec<Filter> {
    let high = hertz_to_mel(HIGH_HZ);
    let edge = |i: usize| mel_to_hertz(high * i as f64 / (BANDS + 1) as f64);
    let filter = |band| {
        let (from, peak, to) = (edge(band), edge(band + 1), edge(band + 2));
        let weight = |bin: usize| {
            let hertz = bin as f64 * f64::from(SAMPLE_RATE_HZ) / FRAME as f64;
            let (rise, fall) = ((hertz - from) / (peak - from), (to - hertz) / (to - peak));
            (rise.min(fall).max(0.0) * 2.0 / (to - from)) as f32
        };
        let bins = (0..=FRAME / 2).filter(|bin| weight(*bin) > 0.0);
        let bins: Vec<usize> = bins.collect();
        Filter {
            first_bin: bins.first().copied().unwrap_or(0),
            weights: bins.into_iter().map(weight).collect(),
        }
    };
    (0..BANDS).map(filter).collect()
}

fn hertz_to_mel(hertz: f64) -> f64 {
    if hertz < KNEE_HZ {
        hertz * KNEE_MEL / KNEE_HZ
    } else {
        KNEE_MEL + 27.0 * (hertz / KNEE_HZ).ln() / 6.4f64.ln()
    }
}

fn mel_to_hertz(mel: f64) -> f64 {
    if mel < KNEE_MEL {
        mel * KNEE_HZ / KNEE_MEL
    } else {
        KNEE_HZ * ((mel - KNEE_MEL) * 6.4f64.ln() / 27.0).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::{Golden, distance};

    #[test]
    fn the_spectrogram_is_that_of_training() {
        let golden = Golden::open("whisper_tiny");
        let error = distance(&whisper_mel(&golden.values("input")), &golden.values("mel"));
        assert!(error < 1e-4, "{error}");
    }

    #[test]
    fn beyond_its_ends_a_sound_goes_back() {
        let samples = [0.0, 1.0, 2.0, 3.0];
        let values: Vec<f32> = (-2..6).map(|place| mirrored(&samples, place)).collect();
        assert_eq!(values, [2.0, 1.0, 0.0, 1.0, 2.0, 3.0, 2.0, 1.0]);
    }
}
