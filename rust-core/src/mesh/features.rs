//! Tells which features of a face the finder saw. Missing features do not move.
//!
//! A shape prior puts all 68 landmarks somewhere, even on a face with one eye. Every face has a
//! mouth. So a feature counts as missing where the networks' confidence in it is low compared with
//! the mouth's. 24 eyes on eight heads, filled level with the skin, reached 0.10 to 0.63 of their
//! mouth's confidence (13 below 0.45, 18 below 0.55). Real eyes and brows reached 0.61 and more
//! (Suzanne's 0.70), one brow under hair 0.48. A jaw never counts as missing, because a real chin
//! may reach less (0.08 on a round head with a collar) than a cut-off one (0.75). Where brows and
//! noses were smoothed away from human heads, the networks do not notice. They infer the places
//! from the eyes (0.94).

use super::{
    Landmarks,
    ibug::{FEATURES, LANDMARKS, MOUTH},
};

/// A feature with at most this share of the mouth's confidence counts as missing.
const MISSING: f32 = 0.45;
/// A feature with at least this share of the mouth's confidence counts as found.
const FOUND: f32 = 0.55;
/// Confidence of a landmark that the caller placed. The networks' confidence stays below it.
const CERTAIN: f32 = 1.0;

/// The share, 0 to 1, by which each of [`FEATURES`] moves.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Features {
    shares: [f32; FEATURES.len()],
}

impl Features {
    /// Judges features by the confidence of their landmarks. A single landmark that the caller
    /// placed means that its feature is there.
    pub(crate) fn of(landmarks: &Landmarks) -> Features {
        let sure = &landmarks.confidence;
        let reference = mean_estimated(&sure[MOUTH]).or_else(|| mean_estimated(sure));
        let shares = FEATURES.map(|(_, range)| {
            let (Some(reference), false) = (reference, sure[range.clone()].contains(&CERTAIN))
            else {
                return 1.0;
            };
            let mean = mean_estimated(&sure[range]).unwrap_or(CERTAIN);
            let t = ((mean / reference - MISSING) / (FOUND - MISSING)).clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        });
        Features { shares }
    }

    /// The same for a face with one eye in the middle. The eye is there, and it has one brow.
    pub(crate) fn of_one_eye(self) -> Features {
        let [right_brow, left_brow, _, _, nose] = self.shares;
        let brow = right_brow.max(left_brow);
        Features {
            shares: [brow, brow, 1.0, 1.0, nose],
        }
    }

    /// Whether every feature moves fully.
    pub(crate) fn are_all(&self) -> bool {
        self.shares.iter().all(|share| *share == 1.0)
    }

    /// The share by which each landmark moves.
    pub(crate) fn of_landmarks(&self) -> [f32; LANDMARKS] {
        let mut all = [1.0; LANDMARKS];
        for ((_, range), share) in FEATURES.into_iter().zip(self.shares) {
            all[range].fill(share);
        }
        all
    }

    /// The share by which a shape of ARKit moves. A shape of one eye or brow has the share of that
    /// feature, a shape of both sides has the larger one.
    pub(crate) fn of_shape(&self, name: &str) -> f32 {
        let [right_brow, left_brow, right_eye, left_eye, nose] = self.shares;
        let (right, left) = match name {
            _ if name.starts_with("eye") => (right_eye, left_eye),
            _ if name.starts_with("brow") => (right_brow, left_brow),
            _ if name.starts_with("nose") => (nose, nose),
            _ => return 1.0,
        };
        match name {
            _ if name.ends_with("Right") => right,
            _ if name.ends_with("Left") => left,
            _ => right.max(left),
        }
    }

    /// Says which features do not move or move less, if any.
    pub(crate) fn sentence(&self) -> Option<String> {
        let named = |keep: fn(f32) -> bool| {
            let named = FEATURES.iter().zip(self.shares);
            let named: Vec<&str> = named.filter(|x| keep(x.1)).map(|x| x.0.0).collect();
            named.join(", ")
        };
        let (missing, doubtful) = (named(|x| x == 0.0), named(|x| x > 0.0 && x < 1.0));
        let missing =
            (!missing.is_empty()).then(|| format!("not found: {missing}; what it would do rests"));
        let doubtful = (!doubtful.is_empty())
            .then(|| format!("hardly found: {doubtful}; what it does is weaker"));
        let parts: Vec<String> = missing.into_iter().chain(doubtful).collect();
        let sentence = format!(
            "{}; give its landmarks (--landmarks, --fix) if it is there",
            parts.join("; ")
        );
        (!parts.is_empty()).then_some(sentence)
    }
}

/// Mean of the confidences below [`CERTAIN`]. `None` if there are none or all are zero.
fn mean_estimated(confidence: &[f32]) -> Option<f32> {
    let estimated = confidence.iter().filter(|sure| **sure < CERTAIN);
    let (sum, count) = estimated.fold((0.0, 0u8), |(sum, count), sure| (sum + sure, count + 1));
    (sum > 0.0).then(|| sum / f32::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::canonical_landmarks;

    fn features(confidence: impl Fn(usize) -> f32) -> Features {
        Features::of(&Landmarks {
            positions: *canonical_landmarks(),
            vertices: [0; LANDMARKS],
            confidence: std::array::from_fn(confidence),
        })
    }

    #[test]
    fn a_missing_eye_rests_and_its_neighbours_do_not() {
        let one_eyed = features(|n| if (42..48).contains(&n) { 0.3 } else { 0.97 });
        let shares = one_eyed.of_landmarks();
        for (n, share) in shares.iter().enumerate() {
            let expected = if (42..48).contains(&n) { 0.0 } else { 1.0 };
            assert_eq!(*share, expected, "landmark {n}");
        }
        let blinks = ["eyeBlinkLeft", "eyeBlinkRight", "browInnerUp", "jawOpen"];
        assert_eq!(
            blinks.map(|name| one_eyed.of_shape(name)),
            [0.0, 1.0, 1.0, 1.0]
        );
        let text = one_eyed.sentence().unwrap();
        assert!(text.starts_with("not found: left eye; "), "{text}");
    }

    #[test]
    fn a_face_that_is_unsure_everywhere_lacks_nothing() {
        // Suzanne's confidences. She has all features.
        let suzanne = features(|n| match n {
            17..22 => 0.51,
            22..27 => 0.43,
            36..42 => 0.56,
            42..48 => 0.40,
            _ => 0.57,
        });
        assert!(suzanne.are_all() && suzanne.sentence().is_none());
        assert!(features(|_| 1.0).are_all());
    }

    #[test]
    fn a_landmark_of_the_users_own_says_that_its_feature_is_there() {
        let low = |n: usize| if (42..48).contains(&n) { 0.2 } else { 0.6 };
        assert_eq!(features(low).of_landmarks()[42], 0.0);
        let fixed = features(|n| if n == 45 { 1.0 } else { low(n) });
        assert!(fixed.are_all());
        // Other features are no less certain because the user fixed the mouth.
        assert!(features(|n| if n < 48 { 0.5 } else { 1.0 }).are_all());
    }

    #[test]
    fn what_is_hardly_found_fades() {
        let unsure = features(|n| if (17..22).contains(&n) { 0.45 } else { 0.9 });
        let share = unsure.of_landmarks()[17];
        assert!((share - 0.5).abs() < 1e-4, "{share}");
        let text = unsure.sentence().unwrap();
        assert!(text.starts_with("hardly found: right brow; "), "{text}");
    }
}
