//! How the words are said: loudness, pitch and vocal effort over time, syllables and pauses.

use std::ops::Range;

use super::{
    SAMPLE_RATE_HZ, Waveform,
    pitch::{HOP, PROSODY_FPS, pitch_track},
};

/// Levels below this are raised to it.
const FLOOR_DB: f32 = -90.0;
/// A frame this far below the loud parts of the speech belongs to a pause.
const PAUSE_DEPTH_DB: f32 = 28.0;
/// A pause lasts at least this long; a stop consonant is shorter.
const PAUSE_S: f64 = 0.25;
/// de Jong & Wempe 2009: a syllable rises this far above the dips beside it.
const SYLLABLE_DIP_DB: f32 = 2.0;
/// Syllables are at most this far below the loud parts.
const SYLLABLE_DEPTH_DB: f32 = 22.0;
/// Splits the upper band of vocal effort from the lower one.
const EFFORT_SPLIT_HZ: f32 = 1000.0;
/// The loud parts have the level that this share of all frames exceeds.
const LOUD_SHARE: f64 = 0.05;

/// Tracks at [`PROSODY_FPS`]. Frame `t` is centred at `(t + 1/2) / 100` seconds.
#[derive(Debug, Clone, PartialEq)]
pub struct Prosody {
    /// `[T']`, dB of full scale, smoothed over 70 ms; at least −90.
    pub level_db: Vec<f32>,
    /// `[T']`, Hz; 0 where there is no voice.
    pub pitch_hz: Vec<f32>,
    /// `[T']`, dB by which the sound above 1 kHz exceeds the sound below. It shows vocal effort,
    /// but also the colour of the room and the microphone.
    pub effort_db: Vec<f32>,
    /// Level that the loudest twentieth of the frames exceeds, dB.
    pub loud_db: f32,
    /// Frames of the syllables' nuclei, rising.
    pub nuclei: Vec<usize>,
    /// Frames of the pauses, rising. The silence before and after the speech counts as pauses too.
    pub pauses: Vec<Range<usize>>,
}

impl Prosody {
    /// Analyses a sound. A silent one has no voice, no syllables and no pauses.
    pub fn of(waveform: &Waveform) -> Self {
        let frames = waveform.samples.len().div_ceil(HOP);
        let (low, high) = bands(&waveform.samples);
        let power: Vec<f32> = low.iter().zip(&high).map(|(a, b)| a + b).collect();
        let level_db: Vec<f32> = smooth(&power).into_iter().map(decibel).collect();
        let effort_db = smooth(&high)
            .into_iter()
            .zip(smooth(&low))
            .map(|(high, low)| decibel(high) - decibel(low))
            .collect();
        let mut sorted = level_db.clone();
        sorted.sort_by(f32::total_cmp);
        let loud_frame = ((1.0 - LOUD_SHARE) * frames.saturating_sub(1) as f64) as usize;
        let loud_db = sorted.get(loud_frame).copied().unwrap_or(f32::NEG_INFINITY);
        let mut this = Prosody {
            level_db,
            pitch_hz: vec![0.0; frames],
            effort_db,
            loud_db,
            nuclei: Vec::new(),
            pauses: Vec::new(),
        };
        if !waveform.is_silent() {
            this.pitch_hz = pitch_track(&waveform.samples, frames);
            this.nuclei = this.find_nuclei();
            this.pauses = this.find_pauses();
        }
        this
    }

    /// Time at the middle of a frame, seconds.
    pub fn time_s(frame: usize) -> f64 {
        (frame as f64 + 0.5) / PROSODY_FPS
    }

    /// Finds voiced maxima of the level with a dip before and after: de Jong & Wempe 2009.
    fn find_nuclei(&self) -> Vec<usize> {
        let level = &self.level_db;
        let least = self.loud_db - SYLLABLE_DEPTH_DB;
        let mut nuclei = Vec::new();
        // The highest frame since the last dip, and the lowest level of that dip.
        let (mut peak, mut dip) = (None::<usize>, f32::INFINITY);
        for t in 0..level.len() {
            match peak {
                Some(top) if level[t] <= level[top] - SYLLABLE_DIP_DB => {
                    nuclei.push(top);
                    (peak, dip) = (None, level[t]);
                }
                Some(top) if level[t] > level[top] => peak = Some(t),
                None if level[t] >= dip + SYLLABLE_DIP_DB || dip == f32::INFINITY => peak = Some(t),
                _ => dip = dip.min(level[t]),
            }
        }
        nuclei.extend(peak);
        nuclei.retain(|t| level[*t] > least && self.is_voiced_near(*t));
        nuclei
    }

    fn is_voiced_near(&self, frame: usize) -> bool {
        let end = (frame + 3).min(self.pitch_hz.len());
        self.pitch_hz[frame.saturating_sub(2)..end]
            .iter()
            .any(|hz| *hz > 0.0)
    }

    fn find_pauses(&self) -> Vec<Range<usize>> {
        let quiet = self.loud_db - PAUSE_DEPTH_DB;
        let mut pauses = Vec::new();
        let mut start = None;
        for t in 0..=self.level_db.len() {
            let paused = self.level_db.get(t).is_some_and(|level| *level < quiet);
            match (paused, start) {
                (true, None) => start = Some(t),
                (false, Some(from)) => {
                    if (t - from) as f64 / PROSODY_FPS >= PAUSE_S {
                        pauses.push(from..t);
                    }
                    start = None;
                }
                _ => {}
            }
        }
        pauses
    }
}

/// Mean power of each hop below and above the split, `[T']` each. The split is a one-pole filter,
/// 6 dB an octave.
fn bands(samples: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let keep = (-std::f32::consts::TAU * EFFORT_SPLIT_HZ / SAMPLE_RATE_HZ as f32).exp();
    let (mut low, mut low_power, mut high_power) = (0.0f32, Vec::new(), Vec::new());
    for hop in samples.chunks(HOP) {
        let (mut below, mut above) = (0.0, 0.0);
        for x in hop {
            low = keep * low + (1.0 - keep) * x;
            below += low * low;
            above += (x - low) * (x - low);
        }
        low_power.push(below / hop.len() as f32);
        high_power.push(above / hop.len() as f32);
    }
    (low_power, high_power)
}

/// Smooths over a window of 70 ms, which is shorter than a syllable and longer than a pitch period.
fn smooth(track: &[f32]) -> Vec<f32> {
    const WEIGHTS: [f32; 7] = [1.0, 3.0, 6.0, 7.0, 6.0, 3.0, 1.0];
    let last = track.len() as isize - 1;
    (0..=last)
        .map(|t| {
            let at = |k: usize| track[(t + k as isize - 3).clamp(0, last) as usize];
            (0..7).map(|k| WEIGHTS[k] * at(k)).sum::<f32>() / 27.0
        })
        .collect()
}

fn decibel(power: f32) -> f32 {
    (10.0 * power.max(1e-12).log10()).max(FLOOR_DB)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A buzz at `hz` with harmonics, in bursts: `syllables` a second for the first `spoken_s`.
    fn babble(hz: f32, syllables: f32, spoken_s: f32, seconds: f32) -> Waveform {
        let samples = (0..(seconds * 16_000.0) as usize)
            .map(|i| {
                let t = i as f32 / 16_000.0;
                let buzz: f32 = (1..12)
                    .map(|k| (std::f32::consts::TAU * hz * k as f32 * t).sin() / k as f32)
                    .sum();
                let burst = (0.5 - 0.5 * (std::f32::consts::TAU * syllables * t).cos()).powi(2);
                if t < spoken_s {
                    0.3 * buzz * burst
                } else {
                    0.0
                }
            })
            .collect();
        Waveform { samples }
    }

    #[test]
    fn syllables_and_the_pause_after_them_are_counted() {
        let prosody = Prosody::of(&babble(120.0, 4.0, 3.0, 5.0));
        assert_eq!(prosody.nuclei.len(), 12);
        let pause = prosody.pauses.last().unwrap();
        assert!((Prosody::time_s(pause.start) - 3.0).abs() < 0.1 && pause.end == 500);
    }

    #[test]
    fn silence_says_nothing() {
        let prosody = Prosody::of(&Waveform {
            samples: vec![0.0; 16_000],
        });
        assert_eq!(prosody.level_db.len(), 100);
        assert!(prosody.nuclei.is_empty() && prosody.pauses.is_empty());
        assert!(prosody.pitch_hz.iter().all(|hz| *hz == 0.0));
    }

    #[test]
    fn the_shortest_sound_is_heard() {
        for length in [0, 1, 159, 161, 700] {
            let samples = vec![0.5; length];
            let prosody = Prosody::of(&Waveform { samples });
            assert_eq!(prosody.level_db.len(), length.div_ceil(160));
        }
    }

    #[test]
    fn effort_rises_with_the_upper_harmonics() {
        let tone = |hz: f32| Waveform {
            samples: (0..16_000)
                .map(|i| (std::f32::consts::TAU * hz * i as f32 / 16_000.0).sin())
                .collect(),
        };
        let effort = |hz: f32| Prosody::of(&tone(hz)).effort_db[50];
        assert!(effort(3000.0) > effort(300.0) + 15.0);
    }
}
