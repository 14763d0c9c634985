//! Measures how aroused a voice sounds, and turns that into emotion over time.
//!
//! A voice shows arousal more plainly than anything else: more effort (flatter spectrum), higher and
//! wider pitch, more loudness (Scherer 2003). Valence is not measured, so joy, fear and anger look
//! the same. An aroused voice widens the eyes and raises the brows, a drowsy one calms the face. To
//! show a particular emotion, choose it yourself.
//!
//! The constants were tuned on the ten actors of emodb_de, on readings in four languages and on
//! four acted clips of two people, so the following numbers are not an independent test. Mean
//! arousal, and intensity: emodb anger 0.82, 0.62; joy 0.59, 0.42; fear 0.06, 0.13; neutral −0.31,
//! 0.02; boredom −0.30, 0.03; sadness −0.52, 0.03. Acted joy 0.95, 0.75; acted anger in a low voice
//! 0.23, 0.06, because it shows in neither effort nor pitch. Readings −0.53 to 0.12, 0.01 to 0.10;
//! a politician who declaims 1.03.

use super::{EMOTIONS, Emotion, EmotionCurve};
use crate::audio::Prosody;

/// Time between keys.
const STEP_S: f64 = 0.25;
/// Standard deviation of the Gaussian window around a key. The window reaches twice as far.
const WINDOW_S: f64 = 0.5;
/// Frames this far below the loud ones hold only echoes and noise, and are left out.
const HEARD_DB: f32 = 25.0;
/// The arousal of a clip with this many voiced frames counts half, with more frames more.
const ENOUGH_CLIP: f32 = 30.0;
/// The same for a window, whose frames are weighted.
const ENOUGH_WINDOW: f32 = 20.0;
/// The level at this quantile of the voiced frames separates the loudest from the rest.
const LOUD_QUANTILE: f32 = 0.95;
/// Effort is measured only in frames that are less than this below the loudest ones.
const STRONG_DB: f32 = 12.0;
/// Effort between that of neutral and that of lively readings.
const EFFORT_DB: f32 = -8.5;
/// Effort above `EFFORT_DB` that counts as one unit.
const EFFORT_STEP_DB: f32 = 3.0;
/// Weight of one unit of effort in the arousal.
const EFFORT_WEIGHT: f32 = 0.65;
/// The same for the semitones from the floor of the voice up to its usual pitch.
const LIFT: f32 = 4.5;
const LIFT_STEP: f32 = 3.0;
const LIFT_WEIGHT: f32 = 0.25;
/// The same for the median pitch, in semitones over 1 Hz. Few people read at a pitch this high
/// (203 Hz).
const RAISED: f32 = 92.0;
const RAISED_STEP: f32 = 4.0;
const RAISED_WEIGHT: f32 = 0.35;
/// A moment this much louder than the clip, and `LOCAL_SEMITONES` higher, counts as one unit of
/// arousal more.
const LOCAL_DB: f32 = 12.0;
const LOCAL_SEMITONES: f32 = 8.0;
/// Arousal between these is neutral. The range reaches further down, because readers differ more
/// there.
const NEUTRAL: (f32, f32) = (-0.6, 0.2);
/// Intensity for each unit of arousal outside [`NEUTRAL`].
const GAIN: f32 = 1.0;
/// The emotion that shows high arousal. Aroused people raise their brows and widen their eyes,
/// whether they are surprised or not.
const AROUSED: &str = "surprised";
/// The emotion that shows low arousal.
const DROWSY: &str = "calm";

/// One voiced frame.
struct Voiced {
    time_s: f64,
    level_db: f32,
    semitones: f32,
    effort_db: f32,
}

/// Arousal over time, `(time_s, arousal)` every quarter of a second: about 0 for neutral reading, 1
/// and more for an excited voice. The mean of the whole clip is at least about −0.7. Empty if there
/// is no voice.
pub fn arousal(prosody: &Prosody) -> Vec<(f64, f32)> {
    let voiced = voiced(prosody);
    if voiced.is_empty() {
        return Vec::new();
    }
    let of_clip = clip_arousal(&voiced);
    let level = median(voiced.iter().map(|v| v.level_db));
    let pitch = median(voiced.iter().map(|v| v.semitones));
    let duration_s = Prosody::time_s(prosody.level_db.len());
    let keys = (duration_s / STEP_S) as usize + 1;
    (0..keys)
        .map(|key| {
            let time_s = key as f64 * STEP_S;
            (time_s, of_clip + local(&voiced, time_s, level, pitch))
        })
        .collect()
}

/// The arousal of a voice as an emotion curve: see the module. The intensity is at most 1, and 0
/// for silence.
pub fn emotion_from_voice(prosody: &Prosody) -> EmotionCurve {
    let keys = arousal(prosody)
        .into_iter()
        .map(|(time_s, arousal)| (time_s, expression(arousal)))
        .collect();
    EmotionCurve::Keys(keys)
}

fn expression(arousal: f32) -> Emotion {
    let (emotion, outside) = if arousal > 0.0 {
        (AROUSED, arousal - NEUTRAL.1)
    } else {
        (DROWSY, NEUTRAL.0 - arousal)
    };
    if outside <= 0.0 {
        return Emotion::default();
    }
    let mixture = EMOTIONS.map(|name| if name == emotion { 1.0 } else { 0.0 });
    Emotion {
        mixture,
        intensity: (GAIN * outside).min(1.0),
    }
}

fn voiced(prosody: &Prosody) -> Vec<Voiced> {
    let least = prosody.loud_db - HEARD_DB;
    (0..prosody.level_db.len())
        .filter(|t| prosody.pitch_hz[*t] > 0.0 && prosody.level_db[*t] > least)
        .map(|t| Voiced {
            time_s: Prosody::time_s(t),
            level_db: prosody.level_db[t],
            semitones: 12.0 * prosody.pitch_hz[t].log2(),
            effort_db: prosody.effort_db[t],
        })
        .collect()
}

/// How aroused the whole clip is, from measures that need no other clips of the speaker.
fn clip_arousal(voiced: &[Voiced]) -> f32 {
    let count = voiced.len() as f32;
    let loudest = voiced.iter().map(|v| v.level_db);
    let least = quantile(loudest, LOUD_QUANTILE) - STRONG_DB;
    let strong = voiced.iter().filter(|v| v.level_db > least);
    let (sum, frames) = strong.fold((0.0, 0.0), |(sum, n), v| (sum + v.effort_db, n + 1.0f32));
    let pitch = || voiced.iter().map(|v| v.semitones);
    let usual = median(pitch());
    let lift = usual - quantile(pitch(), 0.1);
    // Low effort may only mean a dull microphone, so it can count for less than high effort.
    let effort = ((sum / frames.max(1.0) - EFFORT_DB) / EFFORT_STEP_DB).clamp(-1.0, 1.5);
    let lift = ((lift - LIFT) / LIFT_STEP).clamp(-0.3, 1.0);
    let raised = ((usual - RAISED) / RAISED_STEP).clamp(0.0, 1.0);
    let all = EFFORT_WEIGHT * effort + LIFT_WEIGHT * lift + RAISED_WEIGHT * raised;
    all * count / (count + ENOUGH_CLIP)
}

/// How much more aroused a moment is than the clip, because it is louder and higher.
fn local(voiced: &[Voiced], time_s: f64, level_db: f32, semitones: f32) -> f32 {
    let reach_s = 2.0 * WINDOW_S;
    let from = voiced.partition_point(|v| v.time_s < time_s - reach_s);
    let near = voiced[from..]
        .iter()
        .take_while(|v| v.time_s <= time_s + reach_s);
    let (mut weight, mut change) = (0.0, 0.0);
    for v in near {
        let share = (-0.5 * ((v.time_s - time_s) / WINDOW_S).powi(2)).exp() as f32;
        let louder = (v.level_db - level_db) / LOCAL_DB;
        let higher = (v.semitones - semitones) / LOCAL_SEMITONES;
        weight += share;
        change += share * 0.5 * (louder + higher);
    }
    change / (weight + ENOUGH_WINDOW)
}

fn median(values: impl Iterator<Item = f32>) -> f32 {
    quantile(values, 0.5)
}

fn quantile(values: impl Iterator<Item = f32>, share: f32) -> f32 {
    let mut sorted: Vec<f32> = values.collect();
    sorted.sort_by(f32::total_cmp);
    sorted[(share * (sorted.len() - 1) as f32) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audio::{PROSODY_FPS, Waveform};

    /// The prosody of speech at one effort, with a pitch that swings up to `swing` semitones above
    /// 120 Hz.
    fn spoken(swing: f32, effort_db: f32) -> Prosody {
        let frames = 6 * PROSODY_FPS as usize;
        let pitch_hz = (0..frames)
            .map(|t| 120.0 * (swing * (0.5 - 0.5 * (t as f32 * 0.1).cos()) / 12.0).exp2())
            .collect();
        Prosody {
            level_db: vec![-20.0; frames],
            pitch_hz,
            effort_db: vec![effort_db; frames],
            loud_db: -20.0,
            nuclei: Vec::new(),
            pauses: Vec::new(),
        }
    }

    fn mean(prosody: &Prosody) -> f32 {
        let arousal = arousal(prosody);
        arousal.iter().map(|(_, a)| a).sum::<f32>() / arousal.len() as f32
    }

    #[test]
    fn wide_pitch_and_effort_arouse() {
        let (flat, wide) = (mean(&spoken(2.0, -11.0)), mean(&spoken(14.0, -4.0)));
        assert!(flat < 0.0 && wide > 0.8, "{flat} {wide}");
    }

    #[test]
    fn neutral_speech_and_silence_stay_neutral() {
        let neutral = emotion_from_voice(&spoken(7.0, -9.0));
        assert!(neutral.sample(60, 10.0).column(15).iter().all(|i| *i < 0.1));
        let samples = vec![0.0; 16_000];
        let silence = emotion_from_voice(&Prosody::of(&Waveform { samples }));
        assert_eq!(silence, EmotionCurve::Keys(Vec::new()));
        assert_eq!(silence.at(0.5), Emotion::default());
    }

    #[test]
    fn intensity_never_passes_one() {
        let curve = emotion_from_voice(&spoken(40.0, 10.0));
        let most = curve
            .sample(60, 10.0)
            .column(15)
            .iter()
            .copied()
            .fold(0.0, f32::max);
        assert!(most > 0.5 && most <= 1.0 + 1e-6, "{most}");
    }

    #[test]
    fn a_louder_higher_stretch_stands_out_of_its_clip() {
        let mut prosody = spoken(7.0, -9.0);
        for t in 300..450 {
            prosody.level_db[t] += 9.0;
            prosody.pitch_hz[t] *= 1.6;
        }
        let arousal = arousal(&prosody);
        let at = |s: f64| arousal[(s / STEP_S) as usize].1;
        assert!(at(3.75) > at(1.0) + 0.4 && at(5.9) < at(3.75));
    }
}
