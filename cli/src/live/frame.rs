//! One frame of a face, as every target receives it, and the angles that follow from its weights.

use anyface::rig::{ARKIT, VISEMES, is_of_mouth};
use clap::ValueEnum;

/// Turn of an eye in radians when one of ARKit's eyeLook shapes has weight 1. About 30° in faces that ARKit
/// tracks.
const LOOK_RAD: f32 = std::f32::consts::FRAC_PI_6;

/// What of a face is sent.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
pub enum Shown {
    /// Everything
    All,
    /// Jaw, lips, puffed cheeks and tongue, and nothing of eyes, brows and head, for which another tracker cares
    Mouth,
}

impl Shown {
    /// Whether the weight of a shape of [`ARKIT`] is sent.
    pub fn has(self, shape: &str) -> bool {
        self == Shown::All || is_of_mouth(shape)
    }
}

/// The face at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Number of the frame, counted at the outgoing rate.
    pub number: u32,
    /// Time of the frame in the sound, in seconds.
    pub time_s: f64,
    /// Weights of [`ARKIT`], 0 to 1.
    pub shapes: [f32; 52],
    /// Weights of [`VISEMES`], 0 to 1.
    pub visemes: [f32; 15],
    /// Rotation vector in radians: about x nods down, about y turns to the face's left, about z tilts to its right.
    pub head: [f32; 3],
    /// Emotion of the frame, as VRM's feelings.
    pub feelings: Feelings,
}

/// Strengths of the five feelings that VRM has expressions for, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Feelings {
    pub happy: f32,
    pub angry: f32,
    pub sad: f32,
    pub relaxed: f32,
    pub surprised: f32,
}

/// Angles of the head or of an eye in radians, by Unreal's convention: yaw to the face's right, pitch up,
/// roll to its right.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Angles {
    pub yaw: f32,
    pub pitch: f32,
    pub roll: f32,
}

impl Frame {
    /// Weight of the shape of this name, one of [`ARKIT`].
    pub fn shape(&self, name: &str) -> f32 {
        let place = ARKIT.iter().position(|known| *known == name);
        self.shapes[place.expect("a name of ARKit")]
    }

    /// Weight of the viseme of this name, one of [`VISEMES`].
    pub fn viseme(&self, name: &str) -> f32 {
        let place = VISEMES.iter().position(|known| *known == name);
        self.visemes[place.expect("a name of the visemes")]
    }

    /// Rotation of the head as a quaternion x, y, z, w, with the axes of [`Frame::head`].
    pub fn head_quaternion(&self) -> [f32; 4] {
        let [x, y, z] = self.head;
        let angle = (x * x + y * y + z * z).sqrt();
        // sin(a / 2) / a. Its limit at rest is a half.
        let share = if angle > 1e-6 {
            (0.5 * angle).sin() / angle
        } else {
            0.5
        };
        [share * x, share * y, share * z, (0.5 * angle).cos()]
    }

    /// Angles of the head: rolled first, then pitched, then turned.
    pub fn head_angles(&self) -> Angles {
        let [x, y, z, w] = self.head_quaternion();
        // The direction of the nose, and the heights of the left ear and of the top of the head.
        let nose = [
            2.0 * (x * z + w * y),
            2.0 * (y * z - w * x),
            1.0 - 2.0 * (x * x + y * y),
        ];
        let (ear, top) = (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z));
        Angles {
            yaw: -nose[0].atan2(nose[2]),
            pitch: nose[1].clamp(-1.0, 1.0).asin(),
            roll: ear.atan2(top),
        }
    }

    /// Angles of the left and the right eye relative to the head.
    pub fn eye_angles(&self) -> [Angles; 2] {
        let look = |way: &str, side: &str| self.shape(&format!("eyeLook{way}{side}"));
        let eye = |right: &str, left: &str, side: &str| Angles {
            yaw: LOOK_RAD * (look(right, side) - look(left, side)),
            pitch: LOOK_RAD * (look("Up", side) - look("Down", side)),
            roll: 0.0,
        };
        [eye("In", "Out", "Left"), eye("Out", "In", "Right")]
    }
}

/// Capitalises the first letter: `jawOpen` becomes `JawOpen`.
pub fn capital(name: &str) -> String {
    let mut letters = name.chars();
    let first = letters.next().map(|c| c.to_ascii_uppercase());
    first.into_iter().chain(letters).collect()
}

#[cfg(test)]
impl Frame {
    /// Frame 3 at 25 frames per second, at rest.
    pub fn at_rest() -> Frame {
        Frame {
            number: 3,
            time_s: 0.12,
            shapes: [0.0; 52],
            visemes: [0.0; 15],
            head: [0.0; 3],
            feelings: Feelings::default(),
        }
    }

    /// Sets the weights of these shapes and visemes.
    pub fn with(mut self, weights: &[(&str, f32)]) -> Frame {
        for (name, weight) in weights {
            let shape = ARKIT.iter().position(|known| known == name);
            let viseme = VISEMES.iter().position(|known| known == name);
            match (shape, viseme) {
                (Some(s), _) => self.shapes[s] = *weight,
                (_, Some(v)) => self.visemes[v] = *weight,
                _ => panic!("{name}"),
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn angles_of(head: [f32; 3]) -> [f32; 3] {
        let frame = Frame {
            head,
            ..Frame::at_rest()
        };
        let Angles { yaw, pitch, roll } = frame.head_angles();
        [yaw, pitch, roll]
    }

    fn is_near(a: [f32; 3], b: [f32; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6)
    }

    #[test]
    fn a_nod_down_is_a_negative_pitch_and_a_turn_to_the_left_a_negative_yaw() {
        assert!(is_near(angles_of([0.3, 0.0, 0.0]), [0.0, -0.3, 0.0]));
        assert!(is_near(angles_of([0.0, 0.3, 0.0]), [-0.3, 0.0, 0.0]));
        assert!(is_near(angles_of([0.0, 0.0, 0.3]), [0.0, 0.0, 0.3]));
        assert!(is_near(angles_of([0.0; 3]), [0.0; 3]));
    }

    #[test]
    fn the_quaternion_is_the_rotation_vector() {
        let frame = Frame {
            head: [0.0, 0.6, 0.0],
            ..Frame::at_rest()
        };
        let [x, y, z, w] = frame.head_quaternion();
        assert!(is_near([x, y, z], [0.0, 0.3f32.sin(), 0.0]) && (w - 0.3f32.cos()).abs() < 1e-6);
        assert_eq!(Frame::at_rest().head_quaternion(), [0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn both_eyes_look_to_the_right_where_the_left_one_looks_in() {
        let frame = Frame::at_rest().with(&[
            ("eyeLookInLeft", 0.5),
            ("eyeLookOutRight", 0.5),
            ("eyeLookDownLeft", 1.0),
        ]);
        let [left, right] = frame.eye_angles();
        assert!((left.yaw - 0.5 * LOOK_RAD).abs() < 1e-6 && left.yaw == right.yaw);
        assert_eq!((left.pitch, right.pitch), (-LOOK_RAD, 0.0));
    }
}
