//! Turns probabilities of emotions in a voice into an expression of the face.

use crate::conditions::{EMOTIONS, Emotion};

/// Total probability of all emotions except neutral above which an emotion shows, in a recording.
const FLOOR: f64 = 0.6;
/// The same in a live voice, about which the ear is wrong more often.
const LIVE_FLOOR: f64 = 0.7;
/// Total probability from which it shows fully.
const FULL: f64 = 0.95;

/// Turns probabilities of [`EMOTIONS`], of which the first is neutral, into an expression.
///
/// Nothing shows where neutral is as likely as when unknown speakers simply read aloud. As neutral
/// becomes less likely, the intensity rises smoothly to 1. The mixture follows the squares of the
/// other probabilities, so that a doubt between two emotions seldom shows both. The rule is ours.
pub(super) fn shown(shares: &[f64; EMOTIONS.len()]) -> Emotion {
    shown_above(FLOOR, shares)
}

/// Like `shown`, for a live voice.
pub(super) fn shown_live(shares: &[f64; EMOTIONS.len()]) -> Emotion {
    shown_above(LIVE_FLOOR, shares)
}

fn shown_above(floor: f64, shares: &[f64; EMOTIONS.len()]) -> Emotion {
    let total: f64 = shares[1..].iter().sum();
    let above = ((total - floor) / (FULL - floor)).clamp(0.0, 1.0);
    strongest_of(shares, above * above * (3.0 - 2.0 * above))
}

/// Like `shown`, for a recording that the user chose for its emotion. The intensity is the total
/// probability of all emotions except neutral.
pub(super) fn shown_on_purpose(shares: &[f64; EMOTIONS.len()]) -> Emotion {
    strongest_of(shares, shares[1..].iter().sum())
}

fn strongest_of(shares: &[f64; EMOTIONS.len()], intensity: f64) -> Emotion {
    let intensity = intensity as f32;
    if intensity == 0.0 {
        return Emotion::default();
    }
    let mut strength = shares.map(|share| share * share);
    strength[0] = 0.0;
    let sum: f64 = strength.iter().sum();
    Emotion {
        mixture: strength.map(|x| (x / sum) as f32),
        intensity,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sure_of(emotion: &str, share: f64) -> Emotion {
        let rest = (1.0 - share) / (EMOTIONS.len() - 1) as f64;
        shown(&EMOTIONS.map(|name| if name == emotion { share } else { rest }))
    }

    #[test]
    fn what_is_surer_shows_more() {
        assert_eq!(sure_of("neutral", 0.41), Emotion::default());
        let levels = [0.55, 0.41, 0.2, 0.1, 0.01].map(|share| sure_of("neutral", share).intensity);
        assert!(levels[0] == 0.0 && levels.is_sorted(), "{levels:?}");
        assert!(levels[2] > 0.05 && levels[4] == 1.0, "{levels:?}");
    }

    #[test]
    fn the_likeliest_emotion_shows_most() {
        let angry = sure_of("angry", 0.9);
        let place = EMOTIONS.iter().position(|name| *name == "angry").unwrap();
        assert!(angry.mixture[place] > 0.99, "{angry:?}");
        assert!((angry.mixture.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert_eq!(angry.mixture[0], 0.0);
    }
}
