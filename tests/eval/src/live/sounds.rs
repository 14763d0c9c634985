//! Synthetic sounds that are not speech, and the changes made to clips of speech.

use std::f32::consts::TAU;

use rand_chacha::{
    ChaCha8Rng,
    rand_core::{RngCore, SeedableRng},
};

const RATE: usize = 16_000;
const SECONDS: usize = 12;
/// Major triads: the root, third and fifth of each chord, hertz.
const CHORDS: [[f32; 3]; 4] = [
    [220.0, 277.2, 329.6],
    [196.0, 246.9, 293.7],
    [174.6, 220.0, 261.6],
    [246.9, 311.1, 370.0],
];

type Change = fn(&[f32]) -> Vec<f32>;

/// Sounds other than speech with their names, twelve seconds each.
pub(super) fn no_speech() -> Vec<(&'static str, Vec<f32>)> {
    let (plucked, organ, drums) = (chords(0.5, 0.4), chords(2.0, 1e3), drums());
    let together = |parts: &[&Vec<f32>]| {
        (0..parts[0].len())
            .map(|i| parts.iter().map(|p| p[i]).sum())
            .collect::<Vec<f32>>()
    };
    vec![
        ("plucked chords", at(&plucked, -20.0)),
        ("organ", at(&organ, -20.0)),
        ("melody with vibrato", at(&melody(), -20.0)),
        ("drums", at(&drums, -20.0)),
        (
            "all four",
            at(
                &together(&[
                    &at(&plucked, -20.0),
                    &at(&melody(), -20.0),
                    &at(&organ, -26.0),
                    &at(&drums, -20.0),
                ]),
                -18.0,
            ),
        ),
        ("keyboard", keys()),
        ("breath, −32 dB", at(&breath(), -32.0)),
        ("breath, −22 dB", at(&breath(), -22.0)),
        ("fan, −34 dB", fan()),
        ("pink noise, −50 dB", at(&pink(1), -50.0)),
        ("pink noise, −40 dB", at(&pink(1), -40.0)),
        ("pink noise, −30 dB", at(&pink(1), -30.0)),
        ("pink noise, −20 dB", at(&pink(1), -20.0)),
    ]
}

/// The changes made to clips of speech, with their names.
pub(super) fn changes() -> Vec<(&'static str, Change)> {
    vec![
        ("clean", |x| x.to_vec()),
        ("noise 20 dB below", |x| noisy(x, 20.0)),
        ("noise 10 dB below", |x| noisy(x, 10.0)),
        ("12 dB softer", |x| louder(x, -12.0)),
        ("24 dB softer", |x| louder(x, -24.0)),
        ("12 dB louder, clipped", |x| louder(x, 12.0)),
    ]
}

fn louder(x: &[f32], db: f32) -> Vec<f32> {
    let gain = 10f32.powf(db / 20.0);
    x.iter().map(|x| (x * gain).clamp(-1.0, 1.0)).collect()
}

fn noisy(x: &[f32], below_db: f32) -> Vec<f32> {
    let noise = at(
        &pink(2),
        20.0 * rms(&x[RATE..x.len() - RATE]).log10() - below_db,
    );
    x.iter()
        .zip(noise.iter().cycle())
        .map(|(x, n)| x + n)
        .collect()
}

fn rms(x: &[f32]) -> f32 {
    (x.iter().map(|x| x * x).sum::<f32>() / x.len() as f32).sqrt()
}

/// Scales the sound to this RMS level, dB relative to full scale.
fn at(x: &[f32], db: f32) -> Vec<f32> {
    let gain = 10f32.powf(db / 20.0) / rms(x);
    x.iter().map(|x| x * gain).collect()
}

fn of(sample: impl FnMut(usize) -> f32) -> Vec<f32> {
    (0..RATE * SECONDS).map(sample).collect()
}

/// Uniform noise from −1 to 1.
fn white(seed: u64) -> impl FnMut() -> f32 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    move || random.next_u32() as f32 / (u32::MAX / 2) as f32 - 1.0
}

/// A note's value `since` seconds after its start: eight partials under an envelope.
fn note(hz: f32, since: f32, attack: f32, decay: f32) -> f32 {
    let partial = |k: u8| (TAU * f32::from(k) * hz * since).sin() / f32::from(k).powf(1.3);
    let envelope = (since / attack).min(1.0) * (-since / decay).exp();
    envelope * (1..=8).map(partial).sum::<f32>()
}

fn chords(every_s: f32, decay: f32) -> Vec<f32> {
    of(|i| {
        let t = i as f32 / RATE as f32;
        let number = (t / every_s) as usize;
        let since = t - number as f32 * every_s;
        CHORDS[number / 2 % 4]
            .iter()
            .map(|hz| note(*hz, since, 0.005, decay))
            .sum()
    })
}

fn melody() -> Vec<f32> {
    let steps = [0, 4, 7, 12, 11, 7, 5, 9, 2, 4, 0];
    of(|i| {
        let t = i as f32 / RATE as f32;
        let since = t % 0.3;
        let hz = 220.0 * 2f32.powf(steps[(t / 0.3) as usize % steps.len()] as f32 / 12.0);
        let phase = TAU * hz * since + 0.3 * (TAU * 5.5 * since).sin();
        let partials: f32 = (1..=10u8)
            .map(|k| (f32::from(k) * phase).sin() / f32::from(k).powf(1.3))
            .sum();
        partials * (since / 0.03).min(1.0) * ((0.3 - since) / 0.02).min(1.0)
    })
}

fn drums() -> Vec<f32> {
    let mut noise = white(3);
    of(|i| {
        let (beat, since) = (i / 4_000, (i % 4_000) as f32 / RATE as f32);
        let noise = noise();
        match beat % 4 {
            0 => {
                (TAU * (60.0 * since + 3.0 * (1.0 - (-30.0 * since).exp()))).sin()
                    * (-20.0 * since).exp()
            }
            2 => 0.5 * noise * (-30.0 * since).exp(),
            _ => 0.2 * noise * (-80.0 * since).exp(),
        }
    })
}

/// Five or six keystrokes a second, each a click down and a softer click up.
fn keys() -> Vec<f32> {
    let mut noise = white(4);
    let mut out = vec![0.0; RATE * SECONDS];
    let mut t = 0.3;
    while t < SECONDS as f32 - 0.3 {
        for (later, gain) in [(0.0, 0.4), (0.08, 0.16)] {
            let (hz, decay) = (2_600.0 + 1_400.0 * noise(), 0.007 + 0.004 * noise());
            let start = ((t + later) * RATE as f32) as usize;
            for k in 0..800 {
                let since = k as f32 / RATE as f32;
                out[start + k] +=
                    gain * noise() * (TAU * hz * since).cos() * (-since / decay).exp();
            }
        }
        t += 0.18 + 0.1 * noise();
    }
    out
}

/// White noise between a low and a high corner frequency.
fn band(seed: u64, low_hz: f32, high_hz: f32) -> Vec<f32> {
    let mut noise = white(seed);
    let pole = |hz: f32| 1.0 - (-TAU * hz / RATE as f32).exp();
    let (mut slow, mut fast) = (0.0, 0.0);
    of(|_| {
        fast += pole(high_hz) * (noise() - fast);
        slow += pole(low_hz) * (fast - slow);
        fast - slow
    })
}

/// A breath every 3 s: in for 1.2 s, then out for 1.3 s.
fn breath() -> Vec<f32> {
    let (inward, outward) = (band(5, 400.0, 3_500.0), band(6, 300.0, 2_000.0));
    of(|i| {
        let t = i as f32 / RATE as f32 % 3.0;
        let swell = |from: f32, length: f32| {
            if (from..from + length).contains(&t) {
                (TAU / 2.0 * (t - from) / length).sin().powf(1.5)
            } else {
                0.0
            }
        };
        inward[i] * swell(0.0, 1.2) + 0.7 * outward[i] * swell(1.5, 1.3)
    })
}

fn fan() -> Vec<f32> {
    let hum = of(|i| {
        let partial = |k: f32| (TAU * 100.0 * k * i as f32 / RATE as f32).sin() / k;
        [1.0, 2.0, 3.0, 5.0].map(partial).iter().sum()
    });
    let (wind, hum) = (at(&band(7, 20.0, 800.0), -34.0), at(&hum, -38.0));
    wind.iter().zip(&hum).map(|(a, b)| a + b).collect()
}

/// Pink noise as a sum of octaves, after Voss and McCartney.
fn pink(seed: u64) -> Vec<f32> {
    let mut noise = white(seed);
    let mut octaves = [0.0; 14];
    of(|i| {
        octaves[((i + 1).trailing_zeros() as usize).min(13)] = noise();
        octaves.iter().sum::<f32>() + noise()
    })
}
