//! Derives the motion of the lower jaw from the contour of the face.
//!
//! The jaw is a rigid body: it turns about the hinge in front of the ears (pitch, and a little
//! yaw), and the hinge slides. These five numbers are linear in the displacements of the contour's
//! landmarks 2 to 14. A ridge regression on ICT FaceKit's lower teeth
//! (`training/deform/fit_jaw.py`) gives the coefficients; it separates the motion of the bone from
//! that of the skin over it. The displacement of a point is not linear in the five numbers: the
//! point turns with the bone, so the teeth keep their shape when the jaw opens wide.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use crate::mesh::ibug::LANDMARKS;

/// Pitch and yaw in radians, slide x, y, z in canonical centimetres.
const NUMBERS: usize = 5;
/// Numbers that describe a pose such that the displacement of every point is linear in them.
pub(super) const POSE_NUMBERS: usize = 12;

/// The file that `training/deform/fit_jaw.py` writes.
#[derive(Deserialize)]
struct Fitted {
    landmarks: Vec<usize>,
    /// Position of the hinge relative to the midpoint of landmarks 2 and 14: a share of the vector
    /// to the chin, and a share of that vector turned by a right angle.
    hinge: [f32; 2],
    /// Distance from the hinge to the chin on the head used for the fit.
    lever_cm: f32,
    /// `[5][39]`, a coefficient for every number and contour coordinate x, y, z.
    pose: Vec<Vec<f32>>,
}

static FITTED: LazyLock<Fitted> = LazyLock::new(|| {
    serde_json::from_str(include_str!("jaw_from_contour.json"))
        .expect("the embedded file is checked by a test")
});

/// The lower jaw of one head, canonical centimetres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Jaw {
    /// The point about which the jaw turns.
    pub hinge: [f32; 3],
    /// Distance from the hinge to the chin, relative to the head used for the fit.
    size: f32,
}

/// Where the jaw is in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JawPose {
    /// Rotation matrix minus the identity.
    turn: [[f32; 3]; 3],
    slide: [f32; 3],
}

impl Jaw {
    /// Finds the hinge. `landmarks`: of the neutral face, canonical centimetres.
    pub fn of(landmarks: &[[f32; 3]; LANDMARKS]) -> Jaw {
        let middle: [f32; 3] = std::array::from_fn(|i| 0.5 * (landmarks[2][i] + landmarks[14][i]));
        let chin = landmarks[8];
        let (y, z) = (chin[1] - middle[1], chin[2] - middle[2]);
        let [along, across] = FITTED.hinge;
        let hinge = [
            middle[0],
            middle[1] + along * y + across * z,
            middle[2] + along * z - across * y,
        ];
        let lever = (chin[1] - hinge[1]).hypot(chin[2] - hinge[2]);
        Jaw {
            hinge,
            size: (lever / FITTED.lever_cm).max(0.1),
        }
    }

    /// The pose for landmark displacements, canonical centimetres.
    pub fn pose(&self, moved: &[[f32; 3]; LANDMARKS]) -> JawPose {
        let mut numbers = [0.0f32; NUMBERS];
        for (number, weights) in numbers.iter_mut().zip(&FITTED.pose) {
            let of_landmarks = FITTED.landmarks.iter().zip(weights.chunks_exact(3));
            *number = of_landmarks
                .map(|(&n, w)| (0..3).map(|i| w[i] * moved[n][i]).sum::<f32>())
                .sum();
        }
        let [pitch, yaw, x, y, z] = numbers;
        JawPose {
            turn: turn(pitch / self.size, yaw / self.size),
            slide: [x, y, z],
        }
    }
}

impl JawPose {
    /// The turn, row by row, then the slide.
    pub(super) fn numbers(&self) -> [f32; POSE_NUMBERS] {
        let mut numbers = [0.0; POSE_NUMBERS];
        numbers[..9].copy_from_slice(self.turn.as_flattened());
        numbers[9..].copy_from_slice(&self.slide);
        numbers
    }

    /// Displacement of a point given by its offset from the hinge, canonical centimetres.
    pub fn displacement(&self, from_hinge: [f32; 3]) -> [f32; 3] {
        let turned = |i: usize| -> f32 { (0..3).map(|j| self.turn[i][j] * from_hinge[j]).sum() };
        std::array::from_fn(|i| turned(i) + self.slide[i])
    }
}

/// The rotation by the vector (pitch, yaw, 0), minus the identity (Rodrigues).
fn turn(pitch: f32, yaw: f32) -> [[f32; 3]; 3] {
    let angle = pitch.hypot(yaw);
    let (sine, versine) = if angle < 1e-4 {
        (1.0, 0.5)
    } else {
        // 1 − cos without cancellation.
        (
            angle.sin() / angle,
            2.0 * (0.5 * angle).sin().powi(2) / (angle * angle),
        )
    };
    let k = [[0.0, 0.0, yaw], [0.0, 0.0, -pitch], [-yaw, pitch, 0.0]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let square: f32 = (0..3).map(|m| k[i][m] * k[m][j]).sum();
            sine * k[i][j] + versine * square
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::canonical_landmarks;

    fn landmarks() -> [[f32; 3]; LANDMARKS] {
        canonical_landmarks().map(|p| p.map(|x| 100.0 * x))
    }

    /// Motion of the chin's skin over an opening jaw: less and less towards the ears.
    fn opening(sign: f32) -> [[f32; 3]; LANDMARKS] {
        let mut moved = [[0.0; 3]; LANDMARKS];
        for n in 2..=14usize {
            let share = 1.0 - n.abs_diff(8) as f32 / 7.0;
            moved[n] = [0.3 * sign * share * share, -2.0 * share, -2.0 * share];
        }
        moved
    }

    #[test]
    fn the_fit_has_thirteen_landmarks_and_five_numbers() {
        assert_eq!(FITTED.landmarks, (2..=14).collect::<Vec<_>>());
        assert_eq!(FITTED.pose.len(), NUMBERS);
        assert!(FITTED.pose.iter().all(|row| row.len() == 39));
    }

    #[test]
    fn an_opening_jaw_turns_down_and_keeps_lengths() {
        let jaw = Jaw::of(&landmarks());
        let pose = jaw.pose(&opening(0.0));
        let points = [[1.0, -5.0, 9.0], [-2.0, -3.0, 6.0]];
        let moved = points.map(|p| {
            let d = pose.displacement(p);
            std::array::from_fn::<f32, 3, _>(|i| p[i] + d[i])
        });
        assert!(moved[0][1] < points[0][1] - 1.0, "{moved:?}");
        let length =
            |a: [f32; 3], b: [f32; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt();
        let change = length(moved[0], moved[1]) - length(points[0], points[1]);
        assert!(change.abs() < 1e-5, "{change}");
    }

    #[test]
    fn the_hinge_lies_before_the_ears_and_grows_with_the_head() {
        let jaw = Jaw::of(&landmarks());
        for (got, expected) in jaw.hinge.iter().zip([0.0, -3.13, -1.97]) {
            assert!((got - expected).abs() < 0.02, "{:?}", jaw.hinge);
        }
        assert!((jaw.size - 1.0).abs() < 1e-3);
        let twice = Jaw::of(&landmarks().map(|p| p.map(|x| 2.0 * x)));
        assert!((twice.size - 2.0).abs() < 2e-3);
    }

    #[test]
    fn mirrored_motion_gives_the_mirrored_pose() {
        let jaw = Jaw::of(&landmarks());
        let motion = |n: usize| {
            [
                (n as f32).sin(),
                (1.7 * n as f32).cos(),
                0.3 * n as f32 - 2.0,
            ]
        };
        let one: [[f32; 3]; LANDMARKS] = std::array::from_fn(motion);
        let mut other = one;
        for n in 0..17 {
            other[n] = [-one[16 - n][0], one[16 - n][1], one[16 - n][2]];
        }
        let [left, right] = [jaw.pose(&one), jaw.pose(&other)];
        let a = left.displacement([1.0, -4.0, 8.0]);
        let b = right.displacement([-1.0, -4.0, 8.0]);
        // Covers sums of 39 products of size 0.1 in another order, times a lever of 9 cm.
        for (a, b) in a.iter().zip([-b[0], b[1], b[2]]) {
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
    }
}
