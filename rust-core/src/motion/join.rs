//! A motion that begins in the pose in which another ended.

use ndarray::{ArrayView2, ArrayViewMut3, Axis};

use crate::mesh::ibug::LANDMARKS;

/// How long a motion takes from a pose that it was given to its own.
const LEAVES_WITHIN_S: f64 = 0.4;

/// Shifts landmarks `[T, 68, 3]` so that their first frame is `pose`: by all that they are off it there, and by less
/// and less within [`LEAVES_WITHIN_S`], in a way that starts and ends without a jolt.
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
        let way = t as f64 / (LEAVES_WITHIN_S * fps);
        if way >= 1.0 {
            break;
        }
        let left = 1.0 - way * way * (3.0 - 2.0 * way);
        frame.scaled_add(left as f32, &off);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn the_first_frame_is_the_pose_and_what_follows_the_motion_itself() {
        let own = Array3::from_shape_fn((30, LANDMARKS, 3), |(t, n, axis)| {
            1e-3 * (0.2 * t as f32 + n as f32 + axis as f32).sin()
        });
        let pose = std::array::from_fn(|n| [2e-3, -1e-3 * n as f32, 0.0]);
        let mut joined = own.clone();
        begin_in(&pose, joined.view_mut(), 25.0);
        let off = (&joined - &own).mapv(f32::abs);
        for (at, wanted) in joined.index_axis(Axis(0), 0).outer_iter().zip(pose) {
            assert!((0..3).all(|axis| (at[axis] - wanted[axis]).abs() < 1e-7));
        }
        let far = |t: usize| off.index_axis(Axis(0), t).sum();
        assert!((0..10).all(|t| far(t + 1) < far(t)));
        assert_eq!(far(10), 0.0);
        // Nothing to begin.
        begin_in(&pose, Array3::zeros((0, LANDMARKS, 3)).view_mut(), 25.0);
    }
}
