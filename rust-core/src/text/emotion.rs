//! Understands words for emotions that are not among the categories.

use ndarray::{Array1, ArrayView2};

use super::{TextUnits, check_length, cosine};
use crate::{Error, Result, conditions::EMOTIONS};

/// A word less similar to every category than this names no emotion.
const LEAST_COSINE: f32 = 0.25;
/// After this many sweeps over the categories the shares no longer change.
const SWEEPS: usize = 200;

impl TextUnits {
    /// Finds the mixture of [`EMOTIONS`] whose place comes nearest to the place of a word, by least
    /// squares with no share below 0. The shares sum to 1. A category gives itself.
    ///
    /// ```
    /// use anyface::{conditions::{EMOTIONS, Emotion}, text::TextUnits};
    ///
    /// let words = TextUnits::open(None)?;
    /// let furious = Emotion::parse_with("furious:0.8", &|word| words.emotion(word))?;
    /// let angry = EMOTIONS.iter().position(|name| *name == "angry").unwrap();
    /// assert!(furious.mixture[angry] > 0.8 && (furious.intensity - 0.8).abs() < 1e-6);
    /// # Ok::<(), anyface::Error>(())
    /// ```
    ///
    /// # Errors
    /// `InvalidInput` for a word that the space lacks or that is near no category, and for a text
    /// of more than 1,000 letters.
    pub fn emotion(&self, text: &str) -> Result<[f32; 15]> {
        check_length(text)?;
        if let Some(category) = EMOTIONS.iter().position(|name| *name == text) {
            return Ok(std::array::from_fn(|e| f32::from(u8::from(e == category))));
        }
        let clauses = self.clauses(text);
        let mut words = clauses.iter().flat_map(|clause| &clause.words);
        let is_known = words.all(|word| self.space.knows(word));
        let place = self.place(text).filter(|_| is_known);
        let nearest = place.as_ref().map(|place| {
            let near = self.emotions.outer_iter().zip(EMOTIONS);
            let near = near.map(|(emotion, name)| (cosine(place, &emotion.to_owned()), name));
            near.fold(
                (f32::MIN, ""),
                |best, next| {
                    if next.0 > best.0 { next } else { best }
                },
            )
        });
        match (place, nearest) {
            (Some(place), Some((near, _))) if near >= LEAST_COSINE => {
                Ok(shares(&place, self.emotions.view()))
            }
            (_, nearest) => {
                let nearest = nearest.map(|(_, name)| format!("; the nearest is {name:?}"));
                Err(Error::InvalidInput(format!(
                    "emotion: expected one of {}, or an English word for an emotion, got {text:?}{}",
                    EMOTIONS.join(", "),
                    nearest.unwrap_or_default()
                )))
            }
        }
    }
}

/// Minimises `‖place − xᵀ emotions‖²` with x ≥ 0 by coordinate descent, then divides x by its sum.
fn shares(place: &Array1<f32>, emotions: ArrayView2<'_, f32>) -> [f32; 15] {
    let (gram, goal) = (emotions.dot(&emotions.t()), emotions.dot(place));
    let mut x = Array1::<f32>::zeros(EMOTIONS.len());
    for _ in 0..SWEEPS {
        for e in 0..EMOTIONS.len() {
            let pull = goal[e] - gram.row(e).dot(&x);
            x[e] = (x[e] + pull / gram[[e, e]].max(f32::MIN_POSITIVE)).max(0.0);
        }
    }
    let sum = x.sum();
    std::array::from_fn(|e| x[e] / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strongest(word: &str) -> (&'static str, f32) {
        let words = TextUnits::open(None).unwrap();
        let shares = words.emotion(word).unwrap();
        assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{word}");
        assert!(shares.iter().all(|share| *share >= 0.0), "{word}");
        let named = shares.into_iter().zip(EMOTIONS);
        let (share, name) = named.fold(
            (0.0, ""),
            |best, next| if next.0 > best.0 { next } else { best },
        );
        (name, share)
    }

    #[test]
    fn words_are_what_lies_near_them_and_categories_stay() {
        assert_eq!(strongest("angry"), ("angry", 1.0));
        for (word, name) in [
            ("furious", "angry"),
            ("joyful", "happy"),
            ("grieving", "sad"),
            ("anxious", "upset"),
            ("shocked", "afraid"),
        ] {
            assert_eq!(strongest(word).0, name, "{word}");
        }
        let relieved = TextUnits::open(None).unwrap().emotion("relieved").unwrap();
        assert!(relieved[1] > 0.2, "happy: {relieved:?}");
    }

    #[test]
    fn what_is_no_emotion_is_refused_with_the_known_names() {
        let words = TextUnits::open(None).unwrap();
        for text in ["car", "bicycle", "", "the", "xyzzy", "你好"] {
            let message = words.emotion(text).unwrap_err().to_string();
            assert!(
                message.contains("neutral, happy") && message.contains(text),
                "{message}"
            );
        }
    }
}
