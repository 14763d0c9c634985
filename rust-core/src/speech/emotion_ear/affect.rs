//! Valence and arousal of the emotions that an ear hears.
//!
//! The values are mean ratings of words in Table 4 of Russell and Mehrabian (1977), "Evidence for a
//! three-factor theory of emotions", Journal of Research in Personality 11, 273–294. In that study,
//! people rated how they feel in 151 emotional states, from −1 to 1.

use crate::conditions::EMOTIONS;

/// Valence and arousal of each of [`EMOTIONS`], and the word of the table that stands for it.
///
/// Neutral and drunk are not in the table and get its origin. Calm gets the values of bored,
/// because bored voices were the training data of the built-in ear for calm.
const PLACES: [(&str, [f64; 2]); EMOTIONS.len()] = [
    ("", [0.0, 0.0]),
    ("happy", [0.81, 0.51]),
    ("enjoyment", [0.77, 0.44]),
    ("bored", [-0.65, -0.62]),
    ("surprised", [0.40, 0.67]),
    ("sad", [-0.63, -0.27]),
    ("upset", [-0.63, 0.30]),
    ("shamed", [-0.57, 0.01]),
    ("fearful", [-0.64, 0.60]),
    ("angry", [-0.51, 0.59]),
    ("disgusted", [-0.60, 0.35]),
    ("contempt", [-0.23, 0.31]),
    ("suspicious", [-0.25, 0.42]),
    ("nauseated", [-0.61, -0.01]),
    ("", [0.0, 0.0]),
];

/// Expected valence and arousal for probabilities of [`EMOTIONS`], each −1 to 1.
pub(super) fn valence_and_arousal(shares: &[f64; EMOTIONS.len()]) -> [f64; 2] {
    [0, 1].map(|axis| {
        let places = shares.iter().zip(PLACES);
        places.map(|(share, (_, at))| share * at[axis]).sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Valence and arousal if `emotion` has probability `share` and neutral has the rest.
    fn of(emotion: &str, share: f64) -> [f64; 2] {
        let mut shares = EMOTIONS.map(|name| if name == emotion { share } else { 0.0 });
        shares[0] += 1.0 - share;
        valence_and_arousal(&shares)
    }

    #[test]
    fn emotions_lie_where_people_put_them() {
        assert_eq!(of("neutral", 0.0), [0.0, 0.0]);
        let [valence, arousal] = of("angry", 1.0);
        assert!(valence < -0.4 && arousal > 0.5, "{valence} {arousal}");
        let [valence, arousal] = of("sad", 1.0);
        assert!(valence < -0.4 && arousal < -0.2, "{valence} {arousal}");
        let [valence, arousal] = of("happy", 1.0);
        assert!(valence > 0.7 && arousal > 0.4, "{valence} {arousal}");
        let within = |(_, at): (&str, [f64; 2])| at.iter().all(|x| x.abs() <= 1.0);
        assert!(PLACES.into_iter().all(within));
    }

    #[test]
    fn what_is_half_as_likely_is_half_as_far_from_neutral() {
        for name in EMOTIONS {
            let (whole, half) = (of(name, 1.0), of(name, 0.5));
            let apart = |axis: usize| (whole[axis] - 2.0 * half[axis]).abs();
            assert!(apart(0) < 1e-12 && apart(1) < 1e-12, "{name}");
        }
    }
}
