//! The log-mel spectrogram of Whisper. Twin of `whisper_mel` in `training/speech/whisper.py`.

use std::f64::consts::TAU;

use ndarray::Array2;
use realfft::RealFftPlanner;

use super::{FRAME, HOP};
use crate::audio::SAMPLE_RATE_HZ;

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

/// Decades of band power, scaled to about −1 to 1, at 100 frames a second. Frame `i` is centred on
/// sample `160 i`.
///
/// Periodic Hann window of 400 samples, the sound mirrored beyond both ends; `|X|²`; triangles of
/// equal area, evenly spaced on Slaney's scale from 0 to 8 kHz. `samples`: `[S]` at 16 kHz, more
/// than 200. Returns `[S / 160, 80]`.
pub(super) fn whisper_mel(samples: &[f32]) -> Array2<f32> {
    let transform = RealFftPlanner::<f32>::new().plan_fft_forward(FRAME);
    let window: [f32; FRAME] =
        std::array::from_fn(|k| (0.5 - 0.5 * (TAU * k as f64 / FRAME as f64).cos()) as f32);
    let filters = filters();
    let mut framed = transform.make_input_vec();
    let mut spectrum = transform.make_output_vec();
    let mut mel = Array2::zeros((samples.len() / HOP, BANDS));
    for (i, mut row) in mel.outer_iter_mut().enumerate() {
        for (k, x) in framed.iter_mut().enumerate() {
            *x = window[k] * mirrored(samples, (i * HOP + k) as isize - (FRAME / 2) as isize);
        }
        transform
            .process(&mut framed, &mut spectrum)
            .expect("buffers come from the transform itself");
        for (band, weights) in row.iter_mut().zip(filters.outer_iter()) {
            let bins = weights.iter().zip(&spectrum);
            let power: f32 = bins.map(|(w, x)| w * x.norm_sqr()).sum();
            *band = power.max(FLOOR).log10();
        }
    }
    let loudest = mel.fold(f32::NEG_INFINITY, |a, b| a.max(*b));
    mel.mapv_into(|x| (x.max(loudest - RANGE) + 4.0) / 4.0)
}

/// The sample at `place`, which may lie beyond either end. There the sound is mirrored without
/// repeating its first or last sample.
fn mirrored(samples: &[f32], place: isize) -> f32 {
    let last = samples.len() as isize - 1;
    let inside = match place > last {
        true => 2 * last - place,
        false => place.abs(),
    };
    samples[inside as usize]
}

/// `[BANDS, FRAME / 2 + 1]`
fn filters() -> Array2<f32> {
    let high = hertz_to_mel(HIGH_HZ);
    let edge = |i: usize| mel_to_hertz(high * i as f64 / (BANDS + 1) as f64);
    Array2::from_shape_fn((BANDS, FRAME / 2 + 1), |(band, bin)| {
        let (from, peak, to) = (edge(band), edge(band + 1), edge(band + 2));
        let hertz = bin as f64 * f64::from(SAMPLE_RATE_HZ) / FRAME as f64;
        let (rise, fall) = ((hertz - from) / (peak - from), (to - hertz) / (to - peak));
        (rise.min(fall).max(0.0) * 2.0 / (to - from)) as f32
    })
}

fn hertz_to_mel(hertz: f64) -> f64 {
    match hertz < KNEE_HZ {
        true => hertz * KNEE_MEL / KNEE_HZ,
        false => KNEE_MEL + 27.0 * (hertz / KNEE_HZ).ln() / 6.4f64.ln(),
    }
}

fn mel_to_hertz(mel: f64) -> f64 {
    match mel < KNEE_MEL {
        true => mel * KNEE_HZ / KNEE_MEL,
        false => KNEE_HZ * ((mel - KNEE_MEL) * 6.4f64.ln() / 27.0).exp(),
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
