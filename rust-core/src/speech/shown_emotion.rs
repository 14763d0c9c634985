//! Turns probabilities of emotions in a voice into an expression of the face.

use std::ops::Range;

use crate::conditions::{EMOTIONS, Emotion};

/// Total probability of all emotions except neutral above which an emotion shows, in a recording.
const FLOOR: f64 = 0.6;
/// The same in a live voice, about which the ear is wrong more often.
const LIVE_FLOOR: f64 = 0.7;
/// Total probability from which it shows fully.
const FULL: f64 = 0.95;
/// The same in a recording that was chosen for its emotion. In most acted recordings by strangers the
/// ear is at least as sure as this, in most readings by strangers less than a third as sure.
const FULL_ON_PURPOSE: f64 = 0.65;
/// The exponent of the probabilities in a mixture. A face does not show several emotions at once as
/// strongly as one of them, so that a doubt should show only the likelier one.
const SHARPNESS: i32 = 2;
const SHARPNESS_ON_PURPOSE: i32 = 16;

/// Turns probabilities of [`EMOTIONS`], of which the first is neutral, into an expression.
///
/// Nothing shows where neutral is as likely as when unknown speakers simply read aloud. As neutral
/// becomes less likely, the intensity rises smoothly to 1. The mixture follows powers of the other
/// probabilities. The rule is ours.
pub(super) fn shown(shares: &[f64; EMOTIONS.len()]) -> Emotion {
    shown_above(FLOOR, shares)
}

/// Like `shown`, for a live voice.
pub(super) fn shown_live(shares: &[f64; EMOTIONS.len()]) -> Emotion {
    shown_above(LIVE_FLOOR, shares)
}

fn shown_above(floor: f64, shares: &[f64; EMOTIONS.len()]) -> Emotion {
    strongest_of(shares, SHARPNESS, floor..FULL)
}

/// Like `shown`, for a recording that the user chose for its emotion. The emotion shows from any
/// probability on, and practically only the likeliest one.
pub(super) fn shown_on_purpose(shares: &[f64; EMOTIONS.len()]) -> Emotion {
    strongest_of(shares, SHARPNESS_ON_PURPOSE, 0.0..FULL_ON_PURPOSE)
}

/// `over`: the total probability of all emotions except neutral over which the intensity rises from 0 to
/// 1.
fn strongest_of(shares: &[f64; EMOTIONS.len()], sharpness: i32, over: Range<f64>) -> Emotion {
    let total: f64 = shares[1..].iter().sum();
    let above = ((total - over.start) / (over.end - over.start)).clamp(0.0, 1.0);
    let intensity = (above * above * (3.0 - 2.0 * above)) as f32;
    if intensity == 0.0 {
        return Emotion::default();
    }
    let mut strength = shares.map(|share| share.powi(sharpness));
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

    #[test]
    fn a_recording_chosen_for_its_emotion_shows_the_likeliest_one() {
        let mut shares = [0.0; EMOTIONS.len()];
        let place = |name: &str| EMOTIONS.iter().position(|known| *known == name).unwrap();
        let parts = [
            ("neutral", 0.4),
            ("sad", 0.3),
            ("afraid", 0.2),
            ("disgusted", 0.1),
        ];
        for (name, share) in parts {
            shares[place(name)] = share;
        }
        let (on_purpose, by_chance) = (shown_on_purpose(&shares), shown(&shares));
        assert!(on_purpose.mixture[place("sad")] > 0.95, "{on_purpose:?}");
        assert!(on_purpose.intensity > 0.8, "{on_purpose:?}");
        assert_eq!(by_chance, Emotion::default());
        // A neutral reading shows little, but more than nothing.
        shares = [0.0; EMOTIONS.len()];
        (shares[0], shares[place("sad")]) = (0.8, 0.2);
        let weak = shown_on_purpose(&shares).intensity;
        assert!((0.02..0.3).contains(&weak), "{weak}");
    }
}
