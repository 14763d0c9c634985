//! Makes a whisper and a shout of the same words out of one recording.
//!
//! Linear prediction (Atal & Hanauer 1971; Makhoul 1975) splits the sound into the mouth's
//! resonances and the signal that excites them. A whisper is the same mouth with noise for a voice.
//! A shout has a higher voice, higher resonances and a flatter spectrum.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

use super::random::normal;
use anyface::audio::{SAMPLE_RATE_HZ, Waveform};

/// Number of poles that model the mouth.
const ORDER: usize = 18;
/// Length of a frame, samples: 32 ms.
const FRAME: usize = 512;
/// Distance between frames, samples: 8 ms.
const STEP: usize = 128;
/// Share of a frame's power that is added to its autocorrelation at lag 0: −40 dB.
const WHITE: f64 = 1e-4;
/// Ratio of a shout's pitch to that of the recording.
const PITCH: f64 = 1.4;
/// Ratio of a shout's resonances to those of the recording.
const RESONANCES: f64 = 1.15;
/// A shout gains 6 dB an octave above this frequency, hertz.
const TILT_HZ: f64 = 1000.0;
/// The search for the waveform's best continuation goes this far either way, samples.
const REACH: usize = 160;
const PEAK: f32 = 0.9;
const SEED: u64 = 0;

/// Noise through the recording's resonances.
pub(super) fn whispered(sound: &Waveform) -> Waveform {
    let samples = doubles(sound);
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let noise: Vec<f64> = samples.iter().map(|_| normal(&mut random)).collect();
    let out = through_resonances(&samples, 1.0, |at| {
        let from = at.min(noise.len().saturating_sub(FRAME));
        noise[from..(from + FRAME).min(noise.len())].to_vec()
    });
    loudest_at(out)
}

/// A higher voice through higher resonances, with more of the high frequencies.
pub(super) fn shouted(sound: &Waveform) -> Waveform {
    let samples = doubles(sound);
    let voice = residual(&samples);
    let higher = stretched(&faster(&voice, PITCH), voice.len());
    let out = through_resonances(&samples, RESONANCES, |at| {
        higher[at.min(higher.len())..(at + FRAME).min(higher.len())].to_vec()
    });
    let gain = f64::from(SAMPLE_RATE_HZ) / (std::f64::consts::TAU * TILT_HZ);
    let before = [0.0].iter().chain(&out);
    let tilted = out
        .iter()
        .zip(before)
        .map(|(now, last)| now + gain * (now - last));
    loudest_at(tilted.collect())
}

fn doubles(sound: &Waveform) -> Vec<f64> {
    sound.samples.iter().map(|x| f64::from(*x)).collect()
}

fn loudest_at(samples: Vec<f64>) -> Waveform {
    let most = samples.iter().fold(1e-9, |most: f64, x| most.max(x.abs()));
    Waveform {
        samples: samples.iter().map(|x| (x / most) as f32 * PEAK).collect(),
    }
}

/// Periodic Hann window. Copies of it a quarter of a frame apart add up to 2.
fn window(k: usize) -> f64 {
    0.5 - 0.5 * (std::f64::consts::TAU * k as f64 / FRAME as f64).cos()
}

/// Predictor `[ORDER]` of a frame, and the root mean square of its error per sample (Levinson &
/// Durbin).
fn predictor(frame: &[f64]) -> ([f64; ORDER], f64) {
    let at_lag = |lag: usize| -> f64 { frame.iter().zip(&frame[lag..]).map(|(a, b)| a * b).sum() };
    let lags: Vec<f64> = (0..=ORDER).map(at_lag).collect();
    let mut left = lags[0] * (1.0 + WHITE) + 1e-12;
    let mut taps = [0.0; ORDER];
    for order in 0..ORDER {
        let known: f64 = (0..order).map(|k| taps[k] * lags[order - k]).sum();
        let reflection = (lags[order + 1] - known) / left;
        let before = taps;
        taps[order] = reflection;
        for k in 0..order {
            taps[k] = before[k] - reflection * before[order - 1 - k];
        }
        left *= 1.0 - reflection * reflection;
    }
    (taps, (left / frame.len() as f64).sqrt())
}

/// A windowed frame from sample `at` on. It is read at `speed` around its middle; outside the sound
/// there is silence.
fn frame_at(samples: &[f64], at: usize, speed: f64) -> Vec<f64> {
    let middle = (FRAME / 2) as f64;
    let read = |k: usize| {
        let place = at as f64 + middle + (k as f64 - middle) * speed;
        between(samples, place) * window(k)
    };
    (0..FRAME).map(read).collect()
}

/// The interpolated value between two samples; 0 outside the sound.
fn between(samples: &[f64], place: f64) -> f64 {
    if place < 0.0 || place >= samples.len() as f64 - 1.0 {
        return 0.0;
    }
    let (before, share) = (place as usize, place.fract());
    samples[before] * (1.0 - share) + samples[before + 1] * share
}

/// The error of the predictors of all frames: the voice without the mouth's resonances.
fn residual(samples: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; samples.len()];
    for at in (0..samples.len()).step_by(STEP) {
        let frame = frame_at(samples, at, 1.0);
        let (taps, _) = predictor(&frame);
        for k in 0..FRAME.min(samples.len() - at) {
            let past = taps.iter().zip((0..k).rev());
            let predicted: f64 = past.map(|(tap, j)| tap * frame[j]).sum();
            out[at + k] += 0.5 * (frame[k] - predicted);
        }
    }
    out
}

/// Filters the excitation of every frame, from `excite`, through the resonances of `samples`, which
/// become `resonances` times as high. Each frame gets the loudness of the original.
fn through_resonances(
    samples: &[f64],
    resonances: f64,
    excite: impl Fn(usize) -> Vec<f64>,
) -> Vec<f64> {
    let mut out = vec![0.0; samples.len()];
    for at in (0..samples.len()).step_by(STEP) {
        let (taps, level) = predictor(&frame_at(samples, at, resonances));
        let mut frame = excite(at);
        let power: f64 = frame.iter().map(|x| x * x).sum();
        let power_of_frame = (power / frame.len().max(1) as f64).sqrt();
        let gain = level / power_of_frame.max(1e-9);
        for k in 0..frame.len() {
            let past = taps.iter().zip((0..k).rev());
            let ringing: f64 = past.map(|(tap, j)| tap * frame[j]).sum();
            frame[k] = gain * frame[k] + ringing;
        }
        for (k, value) in frame.iter().enumerate().take(samples.len() - at) {
            out[at + k] += window(k) * value;
        }
    }
    out
}

/// Reads the samples `speed` times as fast, so that they become shorter and higher.
fn faster(samples: &[f64], speed: f64) -> Vec<f64> {
    let count = (samples.len() as f64 / speed) as usize;
    (0..count)
        .map(|k| between(samples, k as f64 * speed))
        .collect()
}

/// Stretches the samples to `length` at the same pitch. It adds up overlapping frames, and takes
/// each from where it best continues the one before (Verhelst & Roelands 1993).
fn stretched(samples: &[f64], length: usize) -> Vec<f64> {
    let mut out = vec![0.0; length];
    let half = FRAME / 2;
    let ratio = samples.len() as f64 / length.max(1) as f64;
    let at = |k: usize| samples.get(k).copied().unwrap_or(0.0);
    let mut next = 0;
    for start in (0..length).step_by(half) {
        let position = (start as f64 * ratio) as usize;
        let fit = |from: &usize| -> f64 { (0..half).map(|k| at(from + k) * at(next + k)).sum() };
        let candidates = (position.saturating_sub(REACH)..=position + REACH).step_by(2);
        let best = candidates
            .max_by(|a, b| fit(a).total_cmp(&fit(b)))
            .unwrap_or(position);
        for k in 0..FRAME.min(length - start) {
            out[start + k] += window(k) * at(best + k);
        }
        next = best + half;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One second of a voice of `hertz` through one resonance at 700 Hz.
    fn voice(hertz: f64) -> Waveform {
        let rate = f64::from(SAMPLE_RATE_HZ);
        let period = (rate / hertz) as usize;
        let (radius, angle) = (0.97, std::f64::consts::TAU * 700.0 / rate);
        let mut out = vec![0.0; SAMPLE_RATE_HZ as usize];
        for k in 2..out.len() {
            let pulse = f64::from(u8::from(k % period == 0));
            out[k] =
                pulse + 2.0 * radius * f64::cos(angle) * out[k - 1] - radius * radius * out[k - 2];
        }
        loudest_at(out)
    }

    /// Period of the strongest repetition between 60 and 400 Hz, and how strong it is, 0 to 1.
    fn period(sound: &Waveform) -> (usize, f64) {
        let x = &doubles(sound)[4000..12_000];
        let at = |lag: usize| -> f64 { x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum() };
        let best = (40..266).max_by(|a, b| at(*a).total_cmp(&at(*b))).unwrap();
        (best, at(best) / at(0))
    }

    #[test]
    fn a_whisper_has_the_length_but_not_the_voice() {
        let spoken = voice(120.0);
        assert!(period(&spoken).1 > 0.8);
        let whisper = whispered(&spoken);
        assert_eq!(whisper.samples.len(), spoken.samples.len());
        assert!(period(&whisper).1 < 0.5, "{:?}", period(&whisper));
        assert!(whisper.samples.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn a_shout_is_higher_and_as_long() {
        let spoken = voice(120.0);
        let shout = shouted(&spoken);
        assert_eq!(shout.samples.len(), spoken.samples.len());
        let ratio = period(&spoken).0 as f64 / period(&shout).0 as f64;
        assert!((ratio - PITCH).abs() < 0.1, "{ratio}");
    }

    #[test]
    fn silence_stays_finite() {
        let nothing = Waveform {
            samples: vec![0.0; 2000],
        };
        for voice in [whispered(&nothing), shouted(&nothing)] {
            assert!(voice.samples.iter().all(|x| x.is_finite()));
        }
    }
}
