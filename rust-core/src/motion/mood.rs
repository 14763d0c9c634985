//! How an emotion affects the head: its posture, and the size and pace of its motion.
//!
//! Sad and ashamed heads hang, and they move little and slowly. A happy head stands higher and
//! moves more. An angry one comes forward (Wallbott 1998; Busso et al. 2007). Ashamed and sad eyes
//! look down and away (Keltner 1995; Adams & Kleck 2005). The angles and rates are our own choice.

use ndarray::{Array2, ArrayView2};

use super::smooth::smoothed;
use crate::conditions::{EMOTIONS, Strengths};

/// Standard deviation of the Gaussian that smooths changes of emotion, seconds.
const SETTLING_S: f64 = 0.4;
const QUANTITIES: usize = 5;

/// Posture and liveliness of the head at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mood {
    /// Factor on drift, posture and ordinary nods.
    pub(super) size: f64,
    /// Speed of drift and nods. 1 is calm reading.
    pub(super) pace: f64,
    /// Added to the liveliness of the voice; may be below 0.
    pub(super) liveliness: f64,
    /// How far the face is turned down, degrees.
    pub(super) down_deg: f64,
    /// The share of the eyes' fixations that look away from the partner, down and to the side.
    pub(super) aversion: f64,
}

impl Mood {
    pub(super) const NEUTRAL: Mood = mood(1.0, 1.0, 0.0, 0.0, 0.0);

    fn as_array(self) -> [f64; QUANTITIES] {
        [
            self.size,
            self.pace,
            self.liveliness,
            self.down_deg,
            self.aversion,
        ]
    }
}

const fn mood(size: f64, pace: f64, liveliness: f64, down_deg: f64, aversion: f64) -> Mood {
    Mood {
        size,
        pace,
        liveliness,
        down_deg,
        aversion,
    }
}

/// The moods at intensity 1, in the order of [`EMOTIONS`].
const MOODS: [Mood; EMOTIONS.len()] = [
    Mood::NEUTRAL,
    mood(1.5, 1.2, 0.7, -1.5, 0.0),
    mood(1.25, 1.1, 0.35, -1.0, 0.0),
    mood(0.6, 0.75, -0.2, 0.0, 0.05),
    mood(1.3, 1.1, 0.5, -2.5, 0.0),
    mood(0.65, 0.6, -0.6, 5.0, 0.4),
    mood(0.9, 0.85, -0.2, 2.5, 0.2),
    mood(0.6, 0.65, -0.6, 6.0, 0.7),
    mood(0.9, 1.25, 0.2, -1.5, 0.15),
    mood(1.5, 1.2, 0.8, 2.5, 0.0),
    mood(1.0, 0.9, 0.2, -1.5, 0.2),
    mood(0.8, 0.8, 0.0, -3.0, 0.15),
    mood(0.7, 0.8, 0.0, 1.5, 0.1),
    mood(0.6, 0.6, -0.5, 4.0, 0.3),
    mood(1.4, 0.55, 0.2, 1.0, 0.25),
];

/// The pace of somebody with these emotions. 1 is calm reading.
pub(super) fn pace(strengths: &Strengths) -> f64 {
    let changes = MOODS.iter().zip(strengths).skip(1);
    let change: f64 = changes
        .map(|(mood, strength)| f64::from(*strength) * (mood.pace - Mood::NEUTRAL.pace))
        .sum();
    (Mood::NEUTRAL.pace + change).max(0.4)
}

/// The mood of each frame of `affect` `[T, 16]`, a mixture of emotions and an intensity.
pub(super) fn moods(affect: ArrayView2<'_, f32>, fps: f64) -> Vec<Mood> {
    let neutral = Mood::NEUTRAL.as_array();
    let mut values = Array2::<f32>::zeros((affect.nrows(), QUANTITIES));
    for (mut row, affect) in values.outer_iter_mut().zip(affect.outer_iter()) {
        let intensity = affect[EMOTIONS.len()];
        for (mood, share) in MOODS.iter().zip(affect) {
            for (x, (of, neutral)) in row.iter_mut().zip(mood.as_array().iter().zip(neutral)) {
                *x += intensity * share * (of - neutral) as f32;
            }
        }
    }
    smoothed(&values, SETTLING_S * fps)
        .outer_iter()
        .map(|row| {
            let at = |k: usize, least: f64| (neutral[k] + f64::from(row[k])).max(least);
            let (liveliness, down_deg) = (f64::from(row[2]), f64::from(row[3]));
            mood(at(0, 0.3), at(1, 0.4), liveliness, down_deg, at(4, 0.0))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conditions::{Emotion, EmotionCurve};

    fn of(emotion: &str) -> Mood {
        let curve = EmotionCurve::Constant(Emotion::parse(emotion).unwrap());
        moods(curve.sample(3, 30.0).view(), 30.0)[1]
    }

    #[test]
    fn neutral_is_neutral_and_half_an_emotion_is_half_the_change() {
        assert_eq!(of("neutral:1"), Mood::NEUTRAL);
        assert_eq!(of("sad:0"), Mood::NEUTRAL);
        let (half, whole) = (of("sad:0.5"), of("sad:1"));
        assert!((half.down_deg - 0.5 * whole.down_deg).abs() < 1e-5);
        assert!((whole.pace - 0.6).abs() < 1e-5);
    }

    #[test]
    fn a_change_of_emotion_takes_a_second() {
        let curve = EmotionCurve::parse_keys("0:neutral 2:neutral 2.01:sad:1").unwrap();
        let moods = moods(curve.sample(120, 30.0).view(), 30.0);
        let most = moods
            .windows(2)
            .map(|pair| (pair[1].down_deg - pair[0].down_deg).abs())
            .fold(0.0, f64::max);
        assert!(most < 0.25, "{most} degrees in a frame");
        assert!(moods[0].down_deg < 0.01 && moods[119].down_deg > 4.9);
    }
}
