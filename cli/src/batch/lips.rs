//! Measures how well the lips of a line match its sound.

use anyface::audio::{SAMPLE_RATE_HZ, Waveform};
use serde::{Deserialize, Serialize};

/// Number of waveform peaks that the page draws for each row.
pub const PEAKS: usize = 200;
/// A frame louder than this share of the loudest frames is speech. Frames more than `APART_S`
/// seconds away from all speech are silence.
const SPOKEN: f32 = 0.1;
const APART_S: f64 = 0.3;
/// Sound up to this level is never speech, however quiet the rest is.
const LEAST_RMS: f32 = 1e-3;
/// Lips are open if their gap is wider than this. Below `MOVED_MM` they have not parted.
/// Millimetres on a human head.
const OPEN_MM: f32 = 4.0;
const MOVED_MM: f32 = 1.0;
/// The gap between the lips over time.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    pub fps: f64,
    /// How much wider the gap is than in the face at rest, millimetres on a human head.
    pub values: Vec<f32>,
}

/// Numbers by which to judge the motion of the lips.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct LipMotion {
    /// Seconds of silence, away from speech, in which the lips are open.
    pub silent_open_s: f64,
    /// The longest stretch of speech, seconds, in which the lips do not part.
    pub still_s: f64,
    /// The fastest change of the gap, millimetres a second on a human head.
    pub fastest_mm_s: f32,
    /// The widest gap, millimetres on a human head.
    pub widest_mm: f32,
}

impl LipMotion {
    /// Measures a gap against its sound.
    pub fn of(gap: &Gap, sound: &Waveform) -> LipMotion {
        let loud = loudness(sound, gap.fps, gap.values.len());
        let mut sorted = loud.clone();
        sorted.sort_by(f32::total_cmp);
        let loudest = sorted.get(sorted.len() * 95 / 100).copied().unwrap_or(0.0);
        let spoken: Vec<bool> = loud
            .iter()
            .map(|rms| *rms > LEAST_RMS && *rms > SPOKEN * loudest)
            .collect();
        let apart = (APART_S * gap.fps).ceil() as usize;
        let is_near_speech = |t: usize| {
            let (first, last) = (t.saturating_sub(apart), (t + apart + 1).min(spoken.len()));
            spoken[first..last].contains(&true)
        };
        let open = gap.values.iter().enumerate();
        let open = open.filter(|(t, mm)| **mm > OPEN_MM && !is_near_speech(*t));
        let jumps = gap.values.windows(2).map(|w| (w[1] - w[0]).abs());
        LipMotion {
            silent_open_s: open.count() as f64 / gap.fps,
            still_s: longest_still(gap, &spoken) as f64 / gap.fps,
            fastest_mm_s: jumps.fold(0.0, f32::max) * gap.fps as f32,
            widest_mm: gap.values.iter().copied().fold(0.0, f32::max),
        }
    }
}

/// Frames of the longest stretch of speech in which the gap stays below [`MOVED_MM`].
fn longest_still(gap: &Gap, spoken: &[bool]) -> usize {
    let (mut longest, mut now) = (0, 0);
    for (mm, is_spoken) in gap.values.iter().zip(spoken) {
        now = if *is_spoken && *mm < MOVED_MM {
            now + 1
        } else {
            0
        };
        longest = longest.max(now);
    }
    longest
}

/// Root mean square of the sound in each frame.
fn loudness(sound: &Waveform, fps: f64, frames: usize) -> Vec<f32> {
    let at = |t: usize| {
        let sample = (t as f64 * f64::from(SAMPLE_RATE_HZ) / fps) as usize;
        sample.min(sound.samples.len())
    };
    let rms = |t: usize| {
        let samples = &sound.samples[at(t)..at(t + 1)];
        let energy: f32 = samples.iter().map(|x| x * x).sum();
        (energy / samples.len().max(1) as f32).sqrt()
    };
    (0..frames).map(rms).collect()
}

/// The largest magnitude in each of [`PEAKS`] parts of a sound, in hundredths of the whole range.
pub fn peaks(sound: &Waveform) -> Vec<f32> {
    let count = sound.samples.len();
    let part = |k: usize| &sound.samples[k * count / PEAKS..(k + 1) * count / PEAKS];
    let largest = |k| part(k).iter().fold(0.0f32, |most, x| most.max(x.abs()));
    let rounded = |x: f32| (100.0 * x.min(1.0)).round() / 100.0;
    (0..PEAKS).map(|k| rounded(largest(k))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_are_those_of_the_sound() {
        let voice = |i: usize| (i as f32 * 0.08).sin() * 0.5;
        let samples = (0..32_000).map(|i| if i < 16_000 { 0.0 } else { voice(i) });
        let sound = Waveform {
            samples: samples.collect(),
        };
        let peaks = peaks(&sound);
        assert_eq!(peaks.len(), PEAKS);
        assert!(peaks[..99].iter().all(|x| *x == 0.0) && peaks[150] == 0.5);
    }
}
