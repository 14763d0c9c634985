//! Brow raises on stressed syllables.
//!
//! Most rapid brow raises accompany a rise in pitch, but many rises in pitch have no raise (Cavé et
//! al. 1996). Raises begin about 60 ms before the accent (Flecha-García 2010). So the chance of a
//! raise grows with the prominence of a syllable. Raises are as high as those of grid_s1's tracked
//! speaker, 1 to 1.5 mm, and higher in lively speech.

use ndarray::{Array2, Array3};

use super::{chance::Chance, face_modes::FaceModes, liveliness::liveliness};
use crate::mesh::ibug::BROWS;
use crate::{Result, audio::Prosody};

/// Number of the random stream that draws the accents.
const STREAM: u64 = u64::MAX - 1;
/// A raise is complete this long before its syllable's nucleus, seconds, after Flecha-García 2010.
pub(super) const LEAD_S: f64 = 0.06;
pub(super) const ONSET_S: f64 = 0.12;
const APEX_S: f64 = 0.08;
const OFFSET_S: f64 = 0.25;
/// A syllable of at least this prominence, in standard deviations, may count as stressed.
pub(super) const STRESSED: f32 = 0.6;
/// Chance of a raise per standard deviation of prominence, and the greatest chance.
const CHANCE: f64 = 0.3;
const MAX_CHANCE: f64 = 0.75;
/// The shortest time from the start of one raise to the next, seconds.
const APART_S: f64 = 0.8;
/// Weight of the modes at the least and the greatest prominence.
const WEIGHT: (f64, f64) = (0.1, 0.2);
/// How much a liveliness of 1 adds to that weight, as a share.
const LIVELY: f64 = 0.8;
/// The modes that together raise the brows.
pub(super) const RAISING: [&str; 4] = [
    "browInnerUp_L",
    "browInnerUp_R",
    "browOuterUp_L",
    "browOuterUp_R",
];

/// One brow raise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrowAccent {
    /// When the brows begin to rise, seconds.
    pub start_s: f64,
    /// Weight of the raising modes at the top.
    pub weight: f32,
}

impl BrowAccent {
    pub(super) fn end_s(&self) -> f64 {
        self.start_s + ONSET_S + APEX_S + OFFSET_S
    }

    pub(super) fn at(&self, time_s: f64) -> f32 {
        let rising = (time_s - self.start_s) / ONSET_S;
        let falling = (self.end_s() - time_s) / OFFSET_S;
        let x = rising.min(falling).clamp(0.0, 1.0) as f32;
        self.weight * x * x * (3.0 - 2.0 * x)
    }
}

/// Draws the raises of a performance, in rising order and apart from one another.
pub fn brow_accents(prosody: &Prosody, seed: u64) -> Vec<BrowAccent> {
    let mut chance = Chance::new(seed, STREAM);
    let mut accents: Vec<BrowAccent> = Vec::new();
    let lively = 1.0 + LIVELY * liveliness(prosody);
    for (frame, prominence) in prominences(prosody) {
        // Every syllable draws, stressed or not: whether one gets a raise does not shift later draws.
        let (drawn, spread) = (chance.unit(), chance.between(-0.03, 0.03));
        let start_s = (Prosody::time_s(frame) - LEAD_S - ONSET_S).max(0.0);
        let free = accents
            .last()
            .is_none_or(|a| start_s >= a.start_s + APART_S);
        let likely = (CHANCE * f64::from(prominence)).min(MAX_CHANCE);
        if prominence >= STRESSED && free && drawn < likely {
            let share = (f64::from(prominence - STRESSED) / 1.5).min(1.0);
            let weight = WEIGHT.0 + (WEIGHT.1 - WEIGHT.0) * share + spread;
            accents.push(BrowAccent {
                start_s,
                weight: (lively * weight) as f32,
            });
        }
    }
    accents
}

/// Raises the brows and nothing else. `moved`: `[T, 68, 3]`, canonical metres.
pub(super) fn raise_brows(
    moved: &mut Array3<f32>,
    fps: f64,
    accents: &[BrowAccent],
    modes: &FaceModes,
    strength: f32,
) -> Result<()> {
    let mut raise = Array2::<f32>::zeros((68, 3));
    for name in RAISING {
        raise += &modes.mode(name)?;
    }
    let last = moved.dim().0;
    for accent in accents {
        let first = (accent.start_s * fps) as usize;
        let end = ((accent.end_s() * fps).ceil() as usize).min(last);
        for t in first.min(end)..end {
            let weight = strength * accent.at(t as f64 / fps);
            let mut frame = moved.index_axis_mut(ndarray::Axis(0), t);
            for n in BROWS {
                frame.row_mut(n).scaled_add(weight, &raise.row(n));
            }
        }
    }
    Ok(())
}

/// How far each syllable stands out from the clip in level and pitch, in standard deviations:
/// `(frame, value)`.
pub(super) fn prominences(prosody: &Prosody) -> Vec<(usize, f32)> {
    let level: Vec<f32> = prosody
        .nuclei
        .iter()
        .map(|t| prosody.level_db[*t])
        .collect();
    let pitch: Vec<f32> = prosody
        .nuclei
        .iter()
        .map(|t| semitones(prosody, *t))
        .collect();
    let (level, pitch) = (standardised(&level), standardised(&pitch));
    let both = level.iter().zip(&pitch).map(|(a, b)| 0.5 * (a + b));
    prosody.nuclei.iter().copied().zip(both).collect()
}

/// Highest pitch within 50 ms of a nucleus, semitones over 1 Hz.
fn semitones(prosody: &Prosody, frame: usize) -> f32 {
    let end = (frame + 6).min(prosody.pitch_hz.len());
    let near = &prosody.pitch_hz[frame.saturating_sub(5)..end];
    12.0 * near.iter().copied().fold(1.0, f32::max).log2()
}

/// Values in standard deviations from their mean; all 0 if they hardly vary.
fn standardised(values: &[f32]) -> Vec<f32> {
    let count = values.len().max(1) as f32;
    let mean = values.iter().sum::<f32>() / count;
    let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / count;
    let scale = if variance > 1e-4 {
        variance.sqrt().recip()
    } else {
        0.0
    };
    values.iter().map(|x| (x - mean) * scale).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audio::PROSODY_FPS;

    /// Two syllables a second for ten minutes. Every fourth is 10 dB louder and higher by a half.
    fn stressed() -> Prosody {
        let frames = (600.0 * PROSODY_FPS) as usize;
        let nuclei: Vec<usize> = (0..1200).map(|k| 50 * k + 25).collect();
        let strong = |t: usize| (t / 50).is_multiple_of(4);
        Prosody {
            level_db: (0..frames)
                .map(|t| if strong(t) { -15.0 } else { -25.0 })
                .collect(),
            pitch_hz: (0..frames)
                .map(|t| if strong(t) { 180.0 } else { 120.0 })
                .collect(),
            effort_db: vec![-9.0; frames],
            loud_db: -15.0,
            nuclei,
            pauses: Vec::new(),
        }
    }

    #[test]
    fn raises_begin_before_stressed_syllables_and_not_at_all_of_them() {
        let accents = brow_accents(&stressed(), 2);
        // 300 stressed syllables of prominence 1.7: about half of them get a raise.
        assert!((100..200).contains(&accents.len()), "{}", accents.len());
        for accent in &accents {
            let syllable = (accent.start_s + LEAD_S + ONSET_S - 0.255) / 2.0;
            let from_stress = (syllable - syllable.round()).abs();
            assert!(from_stress < 1e-6 || accent.start_s < 0.1, "{accent:?}");
            assert!((0.05..0.35).contains(&accent.weight));
        }
    }

    #[test]
    fn a_raise_rises_faster_than_it_falls_and_ends() {
        let accent = BrowAccent {
            start_s: 1.0,
            weight: 0.2,
        };
        assert_eq!((accent.at(1.0), accent.at(1.15)), (0.0, 0.2));
        assert!(accent.at(1.06) > 0.09 && accent.at(1.33) > 0.05);
        assert_eq!(accent.at(1.46), 0.0);
    }

    #[test]
    fn monotony_raises_no_brow() {
        let mut prosody = stressed();
        prosody.level_db.fill(-20.0);
        prosody.pitch_hz.fill(120.0);
        assert!(brow_accents(&prosody, 2).is_empty());
    }

    #[test]
    fn chance_follows_the_seed() {
        let prosody = stressed();
        assert_eq!(brow_accents(&prosody, 7), brow_accents(&prosody, 7));
        assert_ne!(brow_accents(&prosody, 7), brow_accents(&prosody, 8));
    }
}
