//! Motion that consists of weights of shapes, as the system made it.

use std::ffi::CString;

use anyface::motion::{Motion, WeightClip};
use libc::c_char;

use crate::{
    error::{AnyfaceError, Failure},
    motion::AnyfaceMotion,
    pointer,
    status::AnyfaceStatus,
};

impl AnyfaceMotion {
    fn weights(&self) -> Result<&WeightClip, Failure> {
        match self.motion() {
            Motion::Weights(clip) => Ok(clip),
            other => Err(Failure::invalid(format!(
                "motion: expected motion of weights, got {}",
                other.kind()
            ))),
        }
    }

    /// Names of the shapes. Empty if the motion does not consist of weights.
    pub(crate) fn shape_names(motion: &Motion) -> Vec<CString> {
        let Motion::Weights(clip) = motion else {
            return Vec::new();
        };
        clip.names
            .iter()
            .map(|name| pointer::c_text(name))
            .collect()
    }
}

/// Number `S` of shapes whose weights the system made, such as the 51 ARKit shapes that `cafe-talk`
/// moves. 0 if the system moves something else, or for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_weight_count(motion: *const AnyfaceMotion) -> usize {
    unsafe { motion.as_ref() }.map_or(0, |motion| motion.names.len())
}

/// ARKit's name of a shape. NULL for NULL, or for a number that is not below the count. Lives as
/// long as the motion.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_weight_name(
    motion: *const AnyfaceMotion,
    shape: usize,
) -> *const c_char {
    pointer::lend(unsafe { motion.as_ref() }.and_then(|motion| motion.names.get(shape)))
}

/// Copies motion of weights into the caller's buffer, exactly as the system made it. Nothing is
/// solved.
///
/// `buffer`: `[T, S]`, 0 to 1, in the order of `anyface_motion_weight_name()`; `float_count` must
/// be `T * S`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, or for motion
/// of a system that moves no weights.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_copy_weights(
    motion: *const AnyfaceMotion,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = |motion: &AnyfaceMotion| Ok(motion.weights()?.weights.iter().copied().collect());
    unsafe { AnyfaceMotion::copy(motion, buffer, float_count, error, values) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::motion::LandmarkClip;
    use ndarray::{Array3, array};
    use std::{
        ffi::CStr,
        ptr::{null, null_mut},
    };

    fn weight_motion() -> AnyfaceMotion {
        let clip = WeightClip {
            names: vec!["jawOpen".to_owned(), "mouthClose".to_owned()],
            // The memory layout is column by column.
            weights: array![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]].reversed_axes(),
            fps: 25.0,
            together: Vec::new(),
        };
        AnyfaceMotion::import(Motion::Weights(clip))
    }

    #[test]
    fn weights_and_names_come_as_they_are() {
        let (motion, mut buffer) = (weight_motion(), [0.0; 6]);
        assert_eq!(unsafe { anyface_motion_weight_count(&motion) }, 2);
        let name = unsafe { CStr::from_ptr(anyface_motion_weight_name(&motion, 1)) };
        assert_eq!(name.to_str(), Ok("mouthClose"));
        assert!(unsafe { anyface_motion_weight_name(&motion, 2) }.is_null());
        let to = buffer.as_mut_ptr();
        let short = unsafe { anyface_motion_copy_weights(&motion, to, 5, null_mut()) };
        assert_eq!((short, buffer), (AnyfaceStatus::InvalidInput, [0.0; 6]));
        let status = unsafe { anyface_motion_copy_weights(&motion, to, 6, null_mut()) };
        assert_eq!(status, AnyfaceStatus::Ok);
        assert_eq!(buffer, [0.1, 0.4, 0.2, 0.5, 0.3, 0.6]);
    }

    #[test]
    fn other_kinds_of_motion_have_none() {
        let clip = LandmarkClip {
            displacements: Array3::zeros((1, 68, 3)),
            fps: 25.0,
        };
        let motion = AnyfaceMotion::import(Motion::Landmarks(clip));
        assert_eq!(unsafe { anyface_motion_weight_count(&motion) }, 0);
        let failure = motion.weights().unwrap_err();
        assert!(failure.message().contains("got landmarks"));
        assert!(unsafe { anyface_motion_weight_name(null(), 0) }.is_null());
    }
}
