//! Scales how far the mouth opens by the effort of the voice.
//!
//! The level says little, because it depends on the microphone's distance and is normalised away.
//! Effort shows in the balance of the spectrum (loud voices carry 6 dB more above 1 kHz), in a raised
//! pitch, and in whether there is a voice at all: a whisper has none. The gains are calibrated on
//! readings in four languages and on ten actors of emodb_de (whispers 0.75, made from the readings by
//! sending noise through their LPC filters). A speaker who declaims counts as loud. A dull spectrum
//! counts as ordinary speech: a slack voice has it, and so does many a microphone.

use std::ops::Range;

use crate::audio::{PROSODY_FPS, Prosody};

/// Gains of shouting and of whisper.
const LOUDEST: f32 = 1.3;
const WHISPER: f32 = 0.75;
/// Spectral balance (dB above 1 kHz relative to below) at which strain begins, and at which it is
/// full.
const STRAIN_DB: (f32, f32) = (-7.0, -3.0);
/// Median pitch above which nobody reads, and that of shouts, semitones over 1 Hz: 228 and 323 Hz.
const RAISED: (f32, f32) = (94.0, 100.0);
/// Weight of a raised pitch relative to a strained spectrum.
const RAISED_SHARE: f32 = 0.4;
/// Share of voiced frames in a whisper, and in a voice.
const VOICED: (f32, f32) = (0.15, 0.4);
/// Frames this far below the loud level are not speech; frames nearer to it than `STRONG_DB` are the
/// strong part of speech.
const SPEECH_DB: f32 = 20.0;
const STRONG_DB: f32 = 12.0;
/// Nobody speaks if the loud level is below this, dB of full scale.
const SILENT_DB: f32 = -70.0;
/// A phrase of this many frames counts as much as the whole clip.
const PHRASE: f32 = 200.0;
/// Less speech than this says little about whether it is a whisper, frames.
const LEAST: f32 = 50.0;
/// Standard deviation of the fade from one phrase to the next, seconds.
const SETTLING_S: f64 = 0.15;

/// Measures of a stretch of speech, summed over frames at [`PROSODY_FPS`].
#[derive(Debug, Clone, Copy, Default)]
struct Stretch {
    speech: f32,
    voiced: f32,
    strong: f32,
    balance_db: f32,
    pitch: f32,
}

/// Factors on the speech motion of jaw and lips, `[frames]`, from the sound of the voice: 1 for
/// ordinary reading, about 1.3 for shouting, 0.75 for a whisper. `effort` is their exponent; at 0 all
/// are 1.
pub fn effort_gain(prosody: &Prosody, frames: usize, fps: f64, effort: f32) -> Vec<f32> {
    let whole = Stretch::of(prosody, 0..prosody.level_db.len());
    if effort == 0.0 || whole.speech == 0.0 || prosody.loud_db < SILENT_DB {
        return vec![1.0; frames];
    }
    let phrases: Vec<(Range<usize>, f32)> = phrases(prosody)
        .map(|phrase| {
            let part = Stretch::of(prosody, phrase.clone()).beside(&whole);
            (phrase, part.gain(whole.speech).powf(effort))
        })
        .collect();
    (0..frames)
        .map(|t| mixed(&phrases, t as f64 / fps))
        .collect()
}

/// The stretches between the middles of the pauses.
fn phrases(prosody: &Prosody) -> impl Iterator<Item = Range<usize>> {
    let middles = prosody
        .pauses
        .iter()
        .map(|p| usize::midpoint(p.start, p.end));
    let edges: Vec<usize> = std::iter::once(0)
        .chain(middles)
        .chain([prosody.level_db.len()])
        .collect();
    let pairs: Vec<Range<usize>> = edges.windows(2).map(|pair| pair[0]..pair[1]).collect();
    pairs.into_iter().filter(|phrase| !phrase.is_empty())
}

/// The gain at a time. It fades from one phrase to the next along a logistic curve, which is close to
/// the integral of a Gaussian.
fn mixed(phrases: &[(Range<usize>, f32)], time_s: f64) -> f32 {
    let mut gain = phrases.first().map_or(1.0, |(_, gain)| *gain);
    for pair in phrases.windows(2) {
        let after_s = time_s - pair[1].0.start as f64 / PROSODY_FPS;
        let share = 1.0 / (1.0 + (-1.7 * after_s / SETTLING_S).exp());
        gain += (pair[1].1 - pair[0].1) * share as f32;
    }
    gain
}

impl Stretch {
    fn of(prosody: &Prosody, frames: Range<usize>) -> Self {
        let mut sum = Stretch::default();
        let mut pitches = Vec::new();
        for t in frames {
            let below_db = prosody.loud_db - prosody.level_db[t];
            if below_db >= SPEECH_DB {
                continue;
            }
            sum.speech += 1.0;
            if prosody.pitch_hz[t] > 0.0 {
                sum.voiced += 1.0;
                if below_db < STRONG_DB {
                    sum.balance_db += prosody.effort_db[t];
                    pitches.push(12.0 * prosody.pitch_hz[t].log2());
                }
            }
        }
        pitches.sort_by(f32::total_cmp);
        sum.strong = pitches.len() as f32;
        sum.pitch = sum.strong * pitches.get(pitches.len() / 2).copied().unwrap_or(0.0);
        sum
    }

    /// Adds the equivalent of [`PHRASE`] frames of the whole clip.
    fn beside(&self, whole: &Stretch) -> Stretch {
        let of_speech = PHRASE / whole.speech.max(1.0);
        let of_strong = PHRASE / whole.strong.max(1.0);
        Stretch {
            speech: self.speech + of_speech * whole.speech,
            voiced: self.voiced + of_speech * whole.voiced,
            strong: self.strong + of_strong * whole.strong,
            balance_db: self.balance_db + of_strong * whole.balance_db,
            pitch: self.pitch + of_strong * whole.pitch,
        }
    }

    /// The gain of the stretch. `speech`: frames of speech in the whole clip.
    fn gain(&self, speech: f32) -> f32 {
        let voice = if self.strong > 0.0 {
            let (balance_db, pitch) = (self.balance_db / self.strong, self.pitch / self.strong);
            let raised = RAISED_SHARE * part(pitch, RAISED);
            let strain = (part(balance_db, STRAIN_DB) + raised).min(1.0);
            1.0 + (LOUDEST - 1.0) * strain
        } else {
            1.0
        };
        let x = 1.0 - part(self.voiced / self.speech, VOICED);
        let whispers = x * x * (3.0 - 2.0 * x) * (speech / LEAST).min(1.0);
        voice + (WHISPER - voice) * whispers
    }
}

/// Position of `x` on the way from `from` to `to`, 0 to 1.
fn part(x: f32, (from, to): (f32, f32)) -> f32 {
    ((x - from) / (to - from)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audio::Waveform;

    /// Ten seconds of speech: two phrases with half a second between them. Each argument has one value
    /// for each phrase.
    fn spoken(balance_db: [f32; 2], pitch_hz: [f32; 2]) -> Prosody {
        let phrase = |t: usize| usize::from(t >= 500);
        let pause = 475..525;
        Prosody {
            level_db: (0..1000)
                .map(|t| if pause.contains(&t) { -80.0 } else { -20.0 })
                .collect(),
            pitch_hz: (0..1000).map(|t| pitch_hz[phrase(t)]).collect(),
            effort_db: (0..1000).map(|t| balance_db[phrase(t)]).collect(),
            loud_db: -20.0,
            nuclei: Vec::new(),
            pauses: vec![pause],
        }
    }

    fn ends(prosody: &Prosody) -> [f32; 2] {
        let gain = effort_gain(prosody, 250, 25.0, 1.0);
        [gain[50], gain[200]]
    }

    #[test]
    fn reading_stays_and_shouting_and_whisper_do_not() {
        assert_eq!(ends(&spoken([-9.0; 2], [120.0; 2])), [1.0; 2]);
        let shout = ends(&spoken([-3.0; 2], [280.0; 2]))[0];
        let whisper = ends(&spoken([-4.0; 2], [0.0; 2]))[0];
        assert!((shout - 1.3).abs() < 1e-3 && (whisper - 0.75).abs() < 1e-3);
        assert!(shout / whisper > 1.5);
    }

    #[test]
    fn a_louder_phrase_opens_further_and_the_way_there_is_smooth() {
        let prosody = spoken([-9.0, -4.0], [120.0, 200.0]);
        let [quiet, loud] = ends(&prosody);
        assert!(quiet < 1.08 && loud > quiet + 0.08, "{quiet} {loud}");
        let gain = effort_gain(&prosody, 250, 25.0, 1.0);
        assert!(gain.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.03));
    }

    #[test]
    fn effort_is_the_exponent_and_silence_has_none() {
        let prosody = spoken([-3.0; 2], [280.0; 2]);
        assert!(
            effort_gain(&prosody, 9, 25.0, 0.0)
                .iter()
                .all(|gain| *gain == 1.0)
        );
        let twice = effort_gain(&prosody, 250, 25.0, 2.0)[50];
        assert!((twice - ends(&prosody)[0].powi(2)).abs() < 1e-5);
        let silence = Prosody::of(&Waveform {
            samples: vec![0.0; 16_000],
        });
        assert_eq!(effort_gain(&silence, 3, 25.0, 1.0), [1.0; 3]);
    }
}
