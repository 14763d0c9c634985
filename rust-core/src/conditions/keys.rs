//! Reads emotion keys from text.

use super::{Emotion, EmotionCurve, WordEmotion, unknown};
use crate::{Error, Result};

impl EmotionCurve {
    /// Reads keys such as `0:neutral 2.5:happy:0.8,surprised:0.2 4:sad:0.5`.
    ///
    /// Each word is a time in seconds and an emotion as [`Emotion::parse`] reads it; times rise.
    /// Strengths are linear between keys and constant before the first and after the last.
    ///
    /// # Errors
    /// `InvalidInput` if there is no key, or a time is negative, not a number or does not rise; the
    /// errors of [`Emotion::parse`].
    pub fn parse_keys(text: &str) -> Result<Self> {
        EmotionCurve::parse_keys_with(text, &unknown)
    }

    /// The same, but `of` reads words that are not categories: see [`Emotion::parse_with`].
    ///
    /// # Errors
    /// Those of [`EmotionCurve::parse_keys`] and of `of`.
    pub fn parse_keys_with(text: &str, of: WordEmotion<'_>) -> Result<Self> {
        let keys = text
            .split_whitespace()
            .map(|word| key(word, of))
            .collect::<Result<Vec<_>>>()?;
        let rising = keys.windows(2).all(|pair| pair[0].0 < pair[1].0);
        if keys.is_empty() || !rising {
            return Err(Error::InvalidInput(format!(
                "emotion keys: expected rising times, as in \"0:neutral 2.5:happy:0.8\", got {text:?}"
            )));
        }
        Ok(Self::Keys(keys))
    }
}

fn key(word: &str, of: WordEmotion<'_>) -> Result<(f64, Emotion)> {
    let wrong = || {
        Error::InvalidInput(format!(
            "emotion keys: expected seconds:emotion, as in 2.5:happy:0.8, got {word:?}"
        ))
    };
    let (time, emotion) = word.split_once(':').ok_or_else(wrong)?;
    let time_s: f64 = time.parse().map_err(|_| wrong())?;
    if time_s.is_finite() && time_s >= 0.0 && !emotion.is_empty() {
        Ok((time_s, Emotion::parse_with(emotion, of)?))
    } else {
        Err(wrong())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_times_and_blends() {
        let curve = EmotionCurve::parse_keys("0:neutral 2:happy:0.8,sad:0.2  4:angry").unwrap();
        assert_eq!(curve.at(2.0).intensity, 1.0);
        assert!((curve.at(1.0).mixture[1] - 0.4).abs() < 1e-6);
        assert_eq!(curve.at(9.0).mixture[9], 1.0);
    }

    #[test]
    fn what_is_no_key_is_named() {
        for (text, words) in [
            ("", "rising times"),
            ("2:sad 1:happy", "rising times"),
            ("happy:0.8", "seconds:emotion"),
            ("-1:happy", "seconds:emotion"),
            ("nan:happy", "seconds:emotion"),
            ("3:", "seconds:emotion"),
            ("3:joyful", "expected one of neutral"),
            ("0:happy 2:off", "expected one of neutral"),
        ] {
            let message = EmotionCurve::parse_keys(text).unwrap_err().to_string();
            assert!(message.contains(words), "{text:?}: {message}");
        }
    }
}
