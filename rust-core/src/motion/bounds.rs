//! Bounds on motion. A value beyond what a face can do gives a warning. A value far beyond it gives
//! an error: it is in another unit, or the file is damaged.

use super::{Life, Motion};
use crate::{Error, Result};

/// Bounds on one kind of value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    what: &'static str,
    unit: &'static str,
    /// A face cannot do more than this: greater values give a warning.
    pub face: f32,
    /// No motion is greater than this: greater values give an error.
    pub most: f32,
}

/// Displacement of a landmark or a vertex, metres on a human head. A mouth opens by 0.06 m, an
/// exaggerated one by twice as much.
pub const DISPLACEMENT: Bound = Bound {
    what: "displacements",
    unit: " m on a human head",
    face: 0.2,
    most: 10.0,
};

/// Weight of a blendshape.
pub const WEIGHT: Bound = Bound {
    what: "weights",
    unit: "",
    face: 3.0,
    most: 1_000.0,
};

/// Rotation of the head about each axis.
pub const HEAD: Bound = Bound {
    what: "head",
    unit: " rad",
    face: 1.6,
    most: 20.0,
};

/// Rotation of the eyes relative to the head.
pub const GAZE: Bound = Bound {
    what: "gaze",
    unit: " rad",
    face: 1.2,
    most: 20.0,
};

impl Bound {
    /// Warns if a value is beyond what a face can do.
    ///
    /// # Errors
    /// `InvalidInput` if a value is beyond `most` or is not a number.
    pub fn check<'a>(&self, values: impl IntoIterator<Item = &'a f32>) -> Result<Option<String>> {
        let largest = |most: f32, value: &f32| {
            if value.is_nan() {
                f32::INFINITY
            } else {
                most.max(value.abs())
            }
        };
        let got = values.into_iter().fold(0.0, largest);
        let Bound {
            what,
            unit,
            face,
            most,
        } = self;
        if got > *most {
            return Err(Error::InvalidInput(format!(
                "{what}: expected at most {most}{unit}, got {got}; are they in another unit?"
            )));
        }
        Ok((got > *face).then(|| {
            format!("{what}: up to {got:.2}{unit}, which no face does (up to {face}); are they in another unit?")
        }))
    }
}

/// Checks the values of a motion and returns warnings.
///
/// # Errors
/// Those of [`Bound::check`].
pub fn check_motion(motion: &Motion) -> Result<Vec<String>> {
    let warning = match motion {
        Motion::Landmarks(clip) => DISPLACEMENT.check(&clip.displacements)?,
        Motion::Weights(clip) => WEIGHT.check(&clip.weights)?,
        Motion::Codes(clip) => DISPLACEMENT.check(&clip.landmarks.displacements)?,
    };
    Ok(warning.into_iter().collect())
}

/// Checks the rotations of head and eyes and returns warnings.
///
/// # Errors
/// Those of [`Bound::check`].
pub fn check_life(life: &Life) -> Result<Vec<String>> {
    let warnings = [HEAD.check(&life.head)?, GAZE.check(&life.gaze)?];
    Ok(warnings.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::LandmarkClip;
    use ndarray::Array3;

    #[test]
    fn what_no_face_does_is_a_warning_and_kilometres_are_an_error() {
        let moved = |by: f32| {
            let mut displacements = Array3::zeros((3, 68, 3));
            displacements[[1, 8, 1]] = -by;
            check_motion(&Motion::Landmarks(LandmarkClip {
                displacements,
                fps: 25.0,
            }))
        };
        assert!(moved(0.06).unwrap().is_empty());
        assert!(moved(0.5).unwrap()[0].contains("no face does"));
        let error = moved(2_000.0).unwrap_err();
        assert!(
            matches!(&error, Error::InvalidInput(m) if m.contains("at most 10 m")),
            "{error}"
        );
        assert!(moved(f32::NAN).is_err());
    }

    #[test]
    fn eyes_that_look_backwards_are_a_warning_and_those_that_spin_an_error() {
        let mut life = Life::still(2);
        assert!(check_life(&life).unwrap().is_empty());
        life.gaze[[1, 0, 0]] = 2.0;
        assert!(check_life(&life).unwrap()[0].starts_with("gaze"));
        life.gaze[[1, 0, 0]] = -1e9;
        assert!(check_life(&life).is_err());
    }
}
