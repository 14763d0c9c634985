//! The conditions of a performance: emotion and intensity over time, events, controls.

mod action_units;
mod controls;
mod event;
mod expression;
mod from_voice;
mod keys;

use crate::{Error, Result};
use ndarray::Array2;

pub use action_units::{ACTION_UNITS, ActionUnit, LEARNED_UNITS, SIDES, Side};
pub use controls::{Control, ControlCurve, ControlStage, ControlValues, Controls, NOISE, STEPS};
pub(crate) use event::turn_eyes;
pub use event::{EDGE_S, Event, EventTrack};
pub use expression::{Expression, MAX_EVENT_STRENGTH, MENU, read_unit};
pub use from_voice::{arousal, emotion_from_voice};

/// The fifteen emotion categories, in the order of the weights.
pub const EMOTIONS: [&str; 15] = [
    "neutral",
    "happy",
    "pleased",
    "calm",
    "surprised",
    "sad",
    "upset",
    "ashamed",
    "afraid",
    "angry",
    "disgusted",
    "contempt",
    "suspicious",
    "ill",
    "drunk",
];

/// Strength of each of [`EMOTIONS`]; 1 is the full expression. The strength of neutral has no
/// meaning.
pub(crate) type Strengths = [f32; EMOTIONS.len()];

/// Largest intensity that a caller may ask for; 1 is a full expression.
pub const MAX_INTENSITY: f32 = 1.5;

/// Returns a word's shares of [`EMOTIONS`], or an error that says why it has none.
pub type WordEmotion<'a> = &'a dyn Fn(&str) -> Result<[f32; 15]>;

/// The error for a word that is not a category.
fn unknown(name: &str) -> Result<[f32; 15]> {
    Err(Error::InvalidInput(format!(
        "emotion: expected one of {}, got {name:?}",
        EMOTIONS.join(", ")
    )))
}

/// A mixture of emotions with one intensity, at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Emotion {
    /// Share of each category of [`EMOTIONS`]; not negative, sums to 1.
    pub mixture: [f32; 15],
    /// 0 to [`MAX_INTENSITY`].
    pub intensity: f32,
}

impl Default for Emotion {
    fn default() -> Self {
        let mut mixture = [0.0; 15];
        mixture[0] = 1.0;
        Emotion {
            mixture,
            intensity: 0.0,
        }
    }
}

impl Emotion {
    /// # Errors
    /// `InvalidInput` if a share or the intensity is not finite.
    pub(crate) fn check_finite(&self) -> Result<()> {
        let mut values = self.mixture.iter().chain([&self.intensity]);
        match values.find(|value| !value.is_finite()) {
            Some(value) => Err(Error::InvalidInput(format!(
                "emotion: expected finite numbers, got {value}"
            ))),
            None => Ok(()),
        }
    }

    /// Reads `happy:0.7` or a blend `happy:0.4,surprised:0.3`.
    ///
    /// Each number is that emotion's strength; the intensity is their sum.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown name or a strength outside 0 to [`MAX_INTENSITY`].
    pub fn parse(text: &str) -> Result<Self> {
        Emotion::parse_with(text, &unknown)
    }

    /// The same, but `of` reads words that are not categories. It returns a word's shares of the
    /// categories, which sum to 1, or an error that says why the word has none.
    ///
    /// # Errors
    /// Those of [`Emotion::parse`] and of `of`.
    pub fn parse_with(text: &str, of: WordEmotion<'_>) -> Result<Self> {
        let mut strength = [0.0f32; 15];
        for item in text
            .split(',')
            .map(str::trim)
            .filter(|item| !item.is_empty())
        {
            let (name, value) = item.split_once(':').unwrap_or((item, "1"));
            let shares = match EMOTIONS.iter().position(|known| *known == name) {
                Some(index) => std::array::from_fn(|e| f32::from(u8::from(e == index))),
                None => of(name)?,
            };
            let value: f32 = value.parse().map_err(|_| {
                Error::InvalidInput(format!("emotion {name}: expected a number, got {value:?}"))
            })?;
            for (sum, share) in strength.iter_mut().zip(shares) {
                *sum += share * value;
            }
        }
        Self::from_strengths(strength)
    }

    /// An emotion from the strength of each category.
    ///
    /// # Errors
    /// `InvalidInput` if a strength is negative or not finite, or their sum is above
    /// [`MAX_INTENSITY`].
    pub fn from_strengths(strength: [f32; 15]) -> Result<Self> {
        let sum: f32 = strength.iter().sum();
        if strength.iter().any(|s| !s.is_finite() || *s < 0.0) || sum > MAX_INTENSITY + 1e-6 {
            return Err(Error::InvalidInput(format!(
                "emotion: expected strengths of at least 0 with a sum of at most {MAX_INTENSITY}, got {strength:?}"
            )));
        }
        if sum == 0.0 {
            return Ok(Self::default());
        }
        Ok(Emotion {
            mixture: strength.map(|s| s / sum),
            intensity: sum,
        })
    }
}

/// Emotion over time.
#[derive(Debug, Clone, PartialEq)]
pub enum EmotionCurve {
    /// The same throughout.
    Constant(Emotion),
    /// `(time_s, emotion)` in rising order; linear in between, constant before and after.
    Keys(Vec<(f64, Emotion)>),
    /// The emotion in the voice: see [`crate::speech::EmotionEar::heard`]. Neutral until the
    /// voice is analysed.
    Auto,
    /// How excited the voice sounds: see [`emotion_from_voice`]. Neutral until the voice is
    /// analysed.
    Arousal,
    /// No emotion, and no motion beyond speech: no blinks, no motion of the upper face.
    Off,
}

impl Default for EmotionCurve {
    fn default() -> Self {
        Self::Constant(Emotion::default())
    }
}

impl EmotionCurve {
    /// The emotions that the curve names. `Auto` and `Arousal` name none.
    pub(crate) fn named(&self) -> Vec<&Emotion> {
        match self {
            Self::Constant(emotion) => vec![emotion],
            Self::Keys(keys) => keys.iter().map(|(_, emotion)| emotion).collect(),
            Self::Auto | Self::Arousal | Self::Off => Vec::new(),
        }
    }

    /// The curve from `start_s` on: every key moves that much earlier.
    #[must_use]
    pub(crate) fn after_second(&self, start_s: f64) -> EmotionCurve {
        match self {
            Self::Keys(keys) => Self::Keys(
                keys.iter()
                    .map(|(time_s, emotion)| (time_s - start_s, *emotion))
                    .collect(),
            ),
            other => other.clone(),
        }
    }

    /// Stretches the curve of a sound of `from_s` seconds to `to_s` seconds.
    #[cfg(feature = "emoface")]
    #[must_use]
    pub(crate) fn over(&self, from_s: f64, to_s: f64) -> EmotionCurve {
        match self {
            Self::Keys(keys) => {
                let at = |time_s: f64| time_s * to_s / from_s;
                Self::Keys(
                    keys.iter()
                        .map(|(time_s, emotion)| (at(*time_s), *emotion))
                        .collect(),
                )
            }
            other => other.clone(),
        }
    }

    /// Reads `off`, `auto`, `auto-arousal`, or an emotion as [`Emotion::parse`] does.
    ///
    /// # Errors
    /// Those of [`Emotion::parse`].
    pub fn parse(text: &str) -> Result<Self> {
        EmotionCurve::parse_with(text, &unknown)
    }

    /// The same, but `of` reads words that are not categories: see [`Emotion::parse_with`].
    ///
    /// # Errors
    /// Those of [`Emotion::parse_with`].
    pub fn parse_with(text: &str, of: WordEmotion<'_>) -> Result<Self> {
        match text.trim() {
            "off" => Ok(Self::Off),
            "auto" => Ok(Self::Auto),
            "auto-arousal" => Ok(Self::Arousal),
            other => Emotion::parse_with(other, of).map(Self::Constant),
        }
    }

    /// The emotion at `time_s`: strengths are interpolated, then split into mixture and intensity.
    pub fn at(&self, time_s: f64) -> Emotion {
        let keys = match self {
            Self::Constant(emotion) => return *emotion,
            Self::Keys(keys) if !keys.is_empty() => keys,
            Self::Keys(_) | Self::Auto | Self::Arousal | Self::Off => return Emotion::default(),
        };
        let after = keys.partition_point(|(key_s, _)| *key_s <= time_s);
        let (before_s, before) = keys[after.saturating_sub(1)];
        let (after_s, after) = keys[after.min(keys.len() - 1)];
        let share = if after_s > before_s {
            ((time_s - before_s) / (after_s - before_s)).clamp(0.0, 1.0) as f32
        } else {
            0.0
        };
        let strength = std::array::from_fn(|e| {
            let a = before.mixture[e] * before.intensity;
            let b = after.mixture[e] * after.intensity;
            a + (b - a) * share
        });
        let intensity: f32 = strength.iter().sum();
        if intensity > 0.0 {
            Emotion {
                mixture: strength.map(|s: f32| s / intensity),
                intensity,
            }
        } else {
            Emotion::default()
        }
    }

    /// The same emotions with `factor` times their intensity. Curves that name no emotion stay as
    /// they are.
    pub fn scaled(&self, factor: f32) -> EmotionCurve {
        let scale = |emotion: &Emotion| match emotion.intensity * factor {
            intensity if intensity > 0.0 => Emotion {
                intensity,
                ..*emotion
            },
            _ => Emotion::default(),
        };
        match self {
            Self::Constant(emotion) => Self::Constant(scale(emotion)),
            Self::Keys(keys) => Self::Keys(keys.iter().map(|(s, e)| (*s, scale(e))).collect()),
            Self::Auto | Self::Arousal | Self::Off => self.clone(),
        }
    }

    /// The largest intensity among the named emotions that are not purely neutral; 0 if there are
    /// none.
    pub fn strongest(&self) -> f32 {
        let strength_of = |emotion: &Emotion| {
            if emotion.mixture[0] < 1.0 {
                emotion.intensity
            } else {
                0.0
            }
        };
        self.named()
            .into_iter()
            .map(strength_of)
            .fold(0.0, f32::max)
    }

    /// Per-frame conditions: mixture `[T, 15]` and intensity `[T, 1]` side by side, `[T, 16]`.
    pub fn sample(&self, frames: usize, fps: f64) -> Array2<f32> {
        let mut out = Array2::zeros((frames, EMOTIONS.len() + 1));
        for (t, mut row) in out.outer_iter_mut().enumerate() {
            let emotion = self.at(t as f64 / fps);
            for (e, share) in emotion.mixture.iter().enumerate() {
                row[e] = *share;
            }
            row[EMOTIONS.len()] = emotion.intensity;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blend_is_split_into_mixture_and_intensity() {
        let emotion = Emotion::parse("happy:0.6,surprised:0.2").unwrap();
        assert!((emotion.intensity - 0.8).abs() < 1e-6);
        assert!((emotion.mixture[1] - 0.75).abs() < 1e-6);
        assert!((emotion.mixture.iter().sum::<f32>() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn unknown_emotion_names_the_known_ones() {
        let message = Emotion::parse("joyful:1").unwrap_err().to_string();
        assert!(
            message.contains("joyful") && message.contains("happy"),
            "{message}"
        );
    }

    #[test]
    fn words_that_are_no_category_are_what_they_are_said_to_be() {
        let of = |word: &str| match word {
            "bittersweet" => {
                let mut shares = [0.0; 15];
                (shares[1], shares[5]) = (0.25, 0.75);
                Ok(shares)
            }
            other => unknown(other),
        };
        let emotion = Emotion::parse_with("bittersweet:0.8,happy:0.2", &of).unwrap();
        assert!((emotion.intensity - 1.0).abs() < 1e-6);
        assert!((emotion.mixture[1] - 0.4).abs() < 1e-6 && (emotion.mixture[5] - 0.6).abs() < 1e-6);
        let happy = Emotion::parse_with("happy:0.7", &of).unwrap();
        assert_eq!(happy, Emotion::parse("happy:0.7").unwrap());
        assert!(
            Emotion::parse_with("sour", &of).is_err() && Emotion::parse("bittersweet").is_err()
        );
        let keys = EmotionCurve::parse_keys_with("0:neutral 2:bittersweet:0.5", &of).unwrap();
        assert!((keys.at(2.0).intensity - 0.5).abs() < 1e-6);
    }

    #[test]
    fn off_and_auto_are_read_and_neutral_until_heard() {
        assert_eq!(EmotionCurve::parse(" off").unwrap(), EmotionCurve::Off);
        for (text, heard) in [
            ("auto", EmotionCurve::Auto),
            ("auto-arousal", EmotionCurve::Arousal),
        ] {
            let auto = EmotionCurve::parse(text).unwrap();
            assert_eq!((&auto, auto.at(1.0)), (&heard, Emotion::default()));
        }
        assert!(EmotionCurve::parse("automatic").is_err());
    }

    #[test]
    fn strengths_out_of_range_are_refused() {
        assert!(Emotion::parse("happy:-0.1").is_err());
        assert!(Emotion::parse("happy:1.6").is_err());
        assert!(Emotion::parse("happy:nan").is_err());
    }

    #[test]
    fn scaling_changes_the_intensity_alone() {
        let blend = Emotion::parse("happy:0.4,sad:0.2").unwrap();
        let keys = EmotionCurve::Keys(vec![(1.0, Emotion::default()), (2.0, blend)]);
        let half = keys.scaled(0.5);
        assert_eq!(half.at(2.0).mixture, blend.mixture);
        assert!((half.strongest() - 0.3).abs() < 1e-6);
        assert_eq!(keys.scaled(0.0).at(2.0), Emotion::default());
        assert_eq!(EmotionCurve::Off.scaled(0.5), EmotionCurve::Off);
    }

    #[test]
    fn what_is_neutral_has_no_strength() {
        let neutral = EmotionCurve::parse("neutral:1").unwrap();
        assert_eq!(
            (neutral.strongest(), EmotionCurve::Off.strongest()),
            (0.0, 0.0)
        );
        assert_eq!(
            EmotionCurve::parse("neutral:0.5,sad:0.5")
                .unwrap()
                .strongest(),
            1.0
        );
    }

    #[test]
    fn curve_is_linear_between_keys_and_held_outside() {
        let keys = vec![
            (1.0, Emotion::default()),
            (2.0, Emotion::parse("sad:1").unwrap()),
        ];
        let curve = EmotionCurve::Keys(keys);
        assert_eq!(curve.at(0.0).intensity, 0.0);
        assert!((curve.at(1.5).intensity - 0.5).abs() < 1e-6);
        assert_eq!(curve.at(9.0).intensity, 1.0);
        assert_eq!(curve.sample(3, 1.0).shape(), [3, 16]);
    }
}
