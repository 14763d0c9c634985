//! Starts a motion in the pose in which another one ended.

use ndarray::{ArrayView1, ArrayView2, ArrayViewMut2, ArrayViewMut3, Axis};

use crate::{mesh::ibug::LANDMARKS, speech::TONGUE_PLACES};

/// How long a motion takes to get from its start pose to its own frames, seconds.
const LEAVES_WITHIN_S: f64 = 0.4;

/// The pose of a face at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// `[68][3]`, displacements from the neutral face, canonical metres.
    pub landmarks: [[f32; 3]; LANDMARKS],
    /// Where the tongue is, in the same form as [`Life::tongue`](super::Life::tongue).
    pub tongue: [f32; TONGUE_PLACES],
}

impl From<[[f32; 3]; LANDMARKS]> for Pose {
    /// Makes a pose with the tongue at rest.
    fn from(landmarks: [[f32; 3]; LANDMARKS]) -> Pose {
        Pose {
            landmarks,
            tongue: [0.0; TONGUE_PLACES],
        }
    }
}

impl Pose {
    /// The pose of one frame: landmarks `[68, 3]` and tongue `[4]`.
    pub fn of_frame(landmarks: ArrayView2<'_, f32>, tongue: ArrayView1<'_, f32>) -> Pose {
        Pose {
            landmarks: std::array::from_fn(|n| std::array::from_fn(|axis| landmarks[[n, axis]])),
            tongue: std::array::from_fn(|place| tongue[place]),
        }
    }
}

/// Fades the tongue `[T, 4]` from that of a pose into its own motion. The first frame is the pose.
/// [`begin_in`] does the same for landmarks, but by an offset.
pub(crate) fn begin_tongue_in(
    pose: &[f32; TONGUE_PLACES],
    mut tongue: ArrayViewMut2<'_, f32>,
    fps: f64,
) {
    for (t, mut row) in tongue.axis_iter_mut(Axis(0)).enumerate() {
        let left = left_of_pose(t, fps);
        for (x, pose) in row.iter_mut().zip(pose) {
            *x = (1.0 - left) * *x + left * pose;
        }
    }
}

/// The share of the start pose in frame `t`: 1 in the first frame, 0 from [`LEAVES_WITHIN_S`] on.
fn left_of_pose(t: usize, fps: f64) -> f32 {
    let way = (t as f64 / (LEAVES_WITHIN_S * fps)).min(1.0);
    (1.0 - way * way * (3.0 - 2.0 * way)) as f32
}

/// Shifts landmarks `[T, 68, 3]` so that their first frame is `pose`. The shift then fades out
/// within [`LEAVES_WITHIN_S`], without a jolt at its start or end.
pub(crate) fn begin_in(
    pose: &[[f32; 3]; LANDMARKS],
    mut displacements: ArrayViewMut3<'_, f32>,
    fps: f64,
) {
    let Some(first) = displacements.axis_iter(Axis(0)).next() else {
        return;
    };
    let off = &ArrayView2::from(pose) - &first;
    for (t, mut frame) in displacements.axis_iter_mut(Axis(0)).enumerate() {
        let left = left_of_pose(t, fps);
        if left == 0.0 {
            break;
        }
        frame.scaled_add(left, &off);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, Array3};

    #[test]
    fn a_tongue_begins_in_the_pose_and_stays_within_its_way() {
        let motion = Array2::from_shape_fn((30, TONGUE_PLACES), |(t, place)| {
            (0.5 + 0.5 * (0.3 * t as f32 + place as f32).sin()).min(1.0)
        });
        let pose = [1.0, 0.0, 0.4, 0.7];
        let mut joined = motion.clone();
        begin_tongue_in(&pose, joined.view_mut(), 25.0);
        assert_eq!(joined.row(0).to_vec(), pose);
        assert!(joined.iter().all(|share| (0.0..=1.0).contains(share)));
        for t in 1..10 {
            assert!(joined.row(t) != motion.row(t), "frame {t}");
        }
        assert_eq!(
            joined.slice(ndarray::s![10.., ..]),
            motion.slice(ndarray::s![10.., ..])
        );
        begin_tongue_in(&pose, Array2::zeros((0, TONGUE_PLACES)).view_mut(), 25.0);
    }

    #[test]
    fn the_first_frame_is_the_pose_and_what_follows_the_motion_itself() {
        let motion = Array3::from_shape_fn((30, LANDMARKS, 3), |(t, n, axis)| {
            1e-3 * (0.2 * t as f32 + n as f32 + axis as f32).sin()
        });
        let pose = std::array::from_fn(|n| [2e-3, -1e-3 * n as f32, 0.0]);
        let mut joined = motion.clone();
        begin_in(&pose, joined.view_mut(), 25.0);
        let off = (&joined - &motion).mapv(f32::abs);
        for (at, expected) in joined.index_axis(Axis(0), 0).outer_iter().zip(pose) {
            assert!((0..3).all(|axis| (at[axis] - expected[axis]).abs() < 1e-7));
        }
        let far = |t: usize| off.index_axis(Axis(0), t).sum();
        assert!((0..10).all(|t| far(t + 1) < far(t)));
        assert_eq!(far(10), 0.0);
        // A motion without frames.
        begin_in(&pose, Array3::zeros((0, LANDMARKS, 3)).view_mut(), 25.0);
    }
}
