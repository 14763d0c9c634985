//! The four curves by which a mouth is read: opening, width, jaw and rounding.

use super::clip::Clip;
use anyface::{
    Result,
    metrics::{self, mouth_width},
};

const MM: f64 = 1000.0;
const CHIN: usize = 8;
/// Middles of the outer lips, which come forward of the corners when they are rounded.
const MIDDLES: [usize; 2] = [51, 57];
const CORNERS: [usize; 2] = [48, 54];
/// How many there are.
pub(super) const COUNT: usize = 4;
/// Places in [`of`].
pub(super) const GAP: usize = 0;
pub(super) const WIDTH: usize = 1;
pub(super) const CHIN_DROP: usize = 2;
pub(super) const PROTRUSION: usize = 3;

/// Every feature of a motion of this clip's face, `[4][T]` millimetres: inner-lip gap ‖62 − 66‖,
/// mouth width ‖48 − 54‖, fall of the chin (−y of 8), protrusion (mean z of 51 and 57 minus that of
/// 48 and 54); the last two count from rest.
pub(super) fn of(clip: &Clip, motion: metrics::Clip<'_>) -> Result<[Vec<f64>; COUNT]> {
    let positions = (&motion + &clip.neutral) * MM;
    let mean_z = |t: usize, of: [usize; 2]| 0.5 * (motion[[t, of[0], 2]] + motion[[t, of[1], 2]]);
    let frames = || 0..motion.dim().0;
    Ok([
        metrics::lip_gap(positions.view())?,
        mouth_width(positions.view())?,
        frames().map(|t| -MM * motion[[t, CHIN, 1]]).collect(),
        frames()
            .map(|t| MM * (mean_z(t, MIDDLES) - mean_z(t, CORNERS)))
            .collect(),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::{audio::Waveform, ibug::LANDMARKS};
    use ndarray::{Array2, Array3};

    #[test]
    fn each_feature_follows_its_own_landmarks() {
        let mut neutral = Array2::zeros((LANDMARKS, 3));
        (neutral[[48, 0]], neutral[[54, 0]]) = (0.025, -0.025);
        let mut motion = Array3::zeros((2, LANDMARKS, 3));
        motion[[1, 66, 1]] = -0.010;
        motion[[1, 48, 0]] = 0.001;
        motion[[1, 8, 1]] = -0.008;
        motion[[1, 51, 2]] = 0.004;
        motion[[1, 57, 2]] = 0.002;
        let clip = Clip {
            name: "test".into(),
            waveform: Waveform {
                samples: Vec::new(),
            },
            start_s: 0.0,
            motion: motion.clone(),
            neutral,
            fps: 25.0,
            observed: Vec::new(),
            judged: 0..2,
            phones: None,
        };
        let found = of(&clip, motion.view()).unwrap();
        let wanted = [[0.0, 10.0], [50.0, 51.0], [0.0, 8.0], [0.0, 3.0]];
        for (found, wanted) in found.iter().zip(wanted) {
            assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9));
        }
    }
}
