//! The mean landmarks of the canonical face, and the fit of other landmarks to them.

use std::sync::LazyLock;

use serde::Deserialize;

use super::{Fit, Landmarks, Similarity, ibug::LANDMARKS};
use crate::{Error, Result};

/// `[68]`, metres: mean ICT identity in the canonical frame (+x subject's left, +y up, +z out of
/// the face, origin between the jaw hinges). Written by `python -m training.landmarks.canonical`.
static MEAN: LazyLock<[[f32; 3]; LANDMARKS]> = LazyLock::new(|| {
    #[derive(Deserialize)]
    struct File {
        landmarks: Vec<[f32; 3]>,
    }
    let file: File = serde_json::from_str(include_str!("canonical_landmarks.json"))
        .expect("the embedded file is checked by a test");
    file.landmarks
        .try_into()
        .expect("the embedded file is checked by a test")
});

/// Above this distance, the landmarks are not those of a face, or not in iBUG order. The heads of
/// the training measured 4 mm (at most 8) without warps, and at most 18 mm under the strongest
/// caricature warps. An order shifted by one gives 28 mm, a shuffled one 44 mm and more.
const WORST_RMS_M: f64 = 0.022;

/// The same limit where the caller is certain of [`ENOUGH_CERTAIN`] landmarks or more, but not of
/// all. These points say where the face is, even if it hardly resembles a human one. The snout of
/// an alligator, three times as long as the nose of a human head, measures 29 mm.
const WORST_RMS_OF_CERTAIN_M: f64 = 0.06;
const ENOUGH_CERTAIN: usize = 4;
/// Confidence of a landmark that the caller placed.
const CERTAIN: f32 = 1.0;

/// Mean landmarks of the canonical face, metres.
pub fn canonical_landmarks() -> &'static [[f32; 3]; LANDMARKS] {
    &MEAN
}

/// How much each landmark says about where the head is. The eye corners and the nose move little
/// from person to person and under expression. Landmarks of the jaw have no clear place along it.
pub(crate) fn stability(index: usize) -> f64 {
    match index {
        0..=16 => 0.15,
        17..=26 => 0.4,
        27..=35 => 1.5,
        36 | 39 | 42 | 45 => 2.0,
        37..=47 => 1.0,
        _ => 0.7,
    }
}

/// The similarity from the mesh's frame to the canonical one. Landmarks that move less weigh more.
///
/// It maps to metres. Its inverse converts displacements back to the mesh's frame.
/// # Errors
/// `FaceNotFound` if the landmarks are mirrored, in another order, or not those of a face.
pub fn align_to_canonical(landmarks: &Landmarks) -> Result<Similarity> {
    let fit = fit_to_canonical(&landmarks.positions, Some(&landmarks.confidence))?;
    check(&fit, &landmarks.confidence)?;
    Ok(fit.similarity)
}

/// Fits `[68]` positions to the mean landmarks without judging the result.
pub(crate) fn fit_to_canonical(
    positions: &[[f32; 3]; LANDMARKS],
    confidence: Option<&[f32; LANDMARKS]>,
) -> Result<Fit> {
    let weights: Vec<f64> = (0..LANDMARKS)
        .map(|i| stability(i) * confidence.map_or(1.0, |c| f64::from(c[i]).max(0.05)))
        .collect();
    Similarity::fit(positions, canonical_landmarks(), Some(&weights))
}

/// Refuses landmarks that do not fit and says what is wrong with them.
pub(crate) fn check(fit: &Fit, confidence: &[f32; LANDMARKS]) -> Result<()> {
    let certain = confidence.iter().filter(|sure| **sure >= CERTAIN).count();
    let worst_m = if (ENOUGH_CERTAIN..LANDMARKS).contains(&certain) {
        WORST_RMS_OF_CERTAIN_M
    } else {
        WORST_RMS_M
    };
    let mirrored = fit.mirrored_rms < 0.6 * fit.rms && fit.mirrored_rms < WORST_RMS_M;
    if mirrored && fit.rms > 0.006 {
        return Err(Error::FaceNotFound(
            "the landmarks are mirrored: number 0 must lie at the subject's right ear and 16 at \
             the left one; if the mesh itself was scaled by a negative number, apply that scale \
             first or swap left and right landmarks"
                .into(),
        ));
    }
    if fit.rms > worst_m {
        return Err(Error::FaceNotFound(format!(
            "the landmarks do not have the shape of a face: {:.0} mm from it on a head of human \
             size, expected at most {:.0}; check that all 68 are in iBUG order (0-16 jaw, 17-26 \
             brows, 27-35 nose, 36-47 eyes, 48-67 mouth)",
            fit.rms * 1e3,
            worst_m * 1e3
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn landmarks(positions: [[f32; 3]; LANDMARKS]) -> Landmarks {
        Landmarks {
            positions,
            vertices: [0; LANDMARKS],
            confidence: [1.0; LANDMARKS],
        }
    }

    /// A snout three times as long as a nose: nose and mouth lie far in front of the eyes.
    #[test]
    fn a_face_that_five_points_place_may_be_longer_than_a_human_one() {
        let mut snout = landmarks(*canonical_landmarks());
        for n in (27..36).chain(48..68) {
            snout.positions[n][2] += 0.12;
        }
        assert!(align_to_canonical(&snout).is_err());
        snout.confidence = [0.2; LANDMARKS];
        assert!(align_to_canonical(&snout).is_err());
        for n in crate::mesh::FIVE_POINTS {
            snout.confidence[n] = 1.0;
        }
        align_to_canonical(&snout).unwrap();
    }

    /// Makes a face ten times as large, turns it upside down and lets it look along −x.
    fn elsewhere(p: [f32; 3]) -> [f32; 3] {
        [-10.0 * p[2] + 3.0, -10.0 * p[1] - 40.0, -10.0 * p[0] + 0.5]
    }

    #[test]
    fn the_mean_face_is_symmetric_and_of_human_size() {
        let mean = canonical_landmarks();
        assert!((mean[16][0] - mean[0][0] - 0.147).abs() < 0.01);
        assert!(mean[30][2] > mean[0][2] && mean[27][1] > mean[8][1]);
        for (left, right) in [(0, 16), (36, 45), (48, 54)] {
            assert!((mean[left][0] + mean[right][0]).abs() < 1e-4);
        }
    }

    #[test]
    fn a_face_in_other_units_and_upside_down_comes_back() {
        let mean = canonical_landmarks();
        let similarity = align_to_canonical(&landmarks(mean.map(elsewhere))).unwrap();
        assert!((similarity.scale - 0.1).abs() < 1e-6);
        for p in mean {
            let back = similarity.apply(elsewhere(*p));
            for i in 0..3 {
                assert!((back[i] - p[i]).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn a_mirrored_face_is_refused() {
        let mirrored = canonical_landmarks().map(|p| [-p[0], p[1], p[2]]);
        let error = align_to_canonical(&landmarks(mirrored)).unwrap_err();
        assert!(error.to_string().contains("mirrored"), "{error}");
    }

    #[test]
    fn another_order_is_refused() {
        let mut positions = *canonical_landmarks();
        positions.rotate_left(17);
        let error = align_to_canonical(&landmarks(positions)).unwrap_err();
        assert!(error.to_string().contains("iBUG order"), "{error}");
    }

    #[test]
    fn landmarks_in_one_point_are_refused() {
        assert!(align_to_canonical(&landmarks([[1.0; 3]; LANDMARKS])).is_err());
    }
}
