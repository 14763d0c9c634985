//! The aspects of a finished take that can still be scaled without a new run.

use anyface::{SliderChange, systems::Slider};

use crate::{
    basis::AnyfaceBasis,
    clip::AnyfaceClip,
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    face::AnyfaceFace,
    guard,
    motion::{AnyfaceMotion, MotionSource},
    pointer::{self, handles},
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// An aspect of a take that can be scaled. At 1 the take stays as it was made.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceSlider {
    /// How far speech moves the mouth and the jaw: 0 to 2.
    Articulation = 0,
    /// How strongly the emotion shows: 0 to 1.5. Blinks stay where they are.
    Emotion = 1,
    /// How far the eyes close in blinks: 0 to 1.
    Blinks = 2,
    /// The change that emotion and blinks make together, beyond what each makes alone. Do not offer
    /// it to users: with emotion at e and blinks at b, set it to 1 - (1 - e) * (1 - b).
    EmotionAndBlinks = 3,
}

/// The change that each slider adds to the weights of a basis: `weight[t][k] + change[t][k]`.
///
/// A slider has `N` knots in rising order. 1 is never among them, because nothing is added there.
/// The change is linear from knot to knot, where 1 counts as a knot without change, and constant
/// beyond the outermost. The changes of several sliders add up. The object never changes once it is
/// made: any number of threads may read it at the same time.
pub struct AnyfaceSliders(Vec<SliderChange>);

impl AnyfaceSliders {
    /// The change of a slider. `None` if it moves nothing.
    fn of(&self, slider: i32) -> Result<Option<&SliderChange>, Failure> {
        let slider = known(slider)?;
        Ok(self.0.iter().find(|change| change.slider == slider))
    }
}

pub(crate) fn known(slider: i32) -> Result<Slider, Failure> {
    const SLIDERS: [(AnyfaceSlider, Slider); 4] = [
        (AnyfaceSlider::Articulation, Slider::Articulation),
        (AnyfaceSlider::Emotion, Slider::Emotion),
        (AnyfaceSlider::Blinks, Slider::Blinks),
        (AnyfaceSlider::EmotionAndBlinks, Slider::EmotionAndBlinks),
    ];
    pointer::one_of(
        "slider",
        slider,
        SLIDERS.map(|(c, known)| (c as i32, known)),
    )
}

/// Computes the changes that the sliders of a take make. Long: accepts a progress handle.
///
/// `motion` comes from `anyface_motion_new()`, `clip` is the same motion on `face`, and `basis` is
/// that clip reduced to a few shapes. Motion that the caller brought, or that was redone or cut,
/// has no sliders. `progress` may be NULL. Free with `anyface_sliders_free()`; everything else may
/// be freed first.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a clip or basis of another motion or for a face
/// with another number of vertices, and with `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sliders_new(
    engine: *const AnyfaceEngine,
    face: *const AnyfaceFace,
    motion: *const AnyfaceMotion,
    clip: *const AnyfaceClip,
    basis: *const AnyfaceBasis,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceSliders,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, face, motion) = handles!(engine, face, motion);
        let clip = &unsafe { pointer::handle("clip", clip) }?.animation.vertices;
        let basis = &unsafe { pointer::handle("basis", basis) }?.0;
        let find = |watch: anyface::job::ProgressFn<'_>| match &motion.source {
            MotionSource::Spoken(performance) => {
                performance.slider_changes(&engine.0, &face.0, clip, basis, watch)
            }
            MotionSource::Redone(..) | MotionSource::Imported(..) => Ok(Vec::new()),
        };
        let changes = unsafe { watched(progress, find) }?;
        Ok(AnyfaceSliders(changes))
    };
    unsafe { guard::give(out, error, make) }
}

/// Number `N` of knots of an `AnyfaceSlider`. 0 if it moves nothing, for an unknown slider, or for
/// NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sliders_knot_count(
    sliders: *const AnyfaceSliders,
    slider: i32,
) -> usize {
    let change = unsafe { sliders.as_ref() }.and_then(|sliders| sliders.of(slider).ok()?);
    change.map_or(0, |change| change.knots.len())
}

/// Copies the knots of an `AnyfaceSlider` into the caller's buffer.
///
/// `buffer`: `[N]`; `float_count` must be `N`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count` or slider.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sliders_copy_knots(
    sliders: *const AnyfaceSliders,
    slider: i32,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let change_of_slider = unsafe { pointer::handle("sliders", sliders) }?.of(slider)?;
        Ok(change_of_slider.map_or(&[][..], |change| &change.knots))
    };
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Copies the changes that an `AnyfaceSlider` adds at each of its knots into the caller's buffer.
///
/// `buffer`: `[N, T, K]`, changes of the basis's weights; `float_count` must be `N * T * K`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count` or slider.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sliders_copy_changes(
    sliders: *const AnyfaceSliders,
    slider: i32,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let change_of_slider = unsafe { pointer::handle("sliders", sliders) }?.of(slider)?;
        let changes = change_of_slider.map_or(&[][..], |change| &change.changes);
        Ok(changes.iter().flatten().copied().collect::<Vec<f32>>())
    };
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Frees sliders that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_sliders_free(sliders: *mut AnyfaceSliders) {
    unsafe { guard::free(sliders) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use std::ptr::null_mut;

    /// Blinks of two frames and three shapes; nothing else moves.
    fn sliders() -> AnyfaceSliders {
        AnyfaceSliders(vec![SliderChange {
            slider: Slider::Blinks,
            knots: vec![0.0],
            changes: vec![Array2::from_shape_fn((2, 3), |(t, k)| (3 * t + k) as f32)],
        }])
    }

    #[test]
    fn changes_are_copied_frame_by_frame() {
        let sliders = sliders();
        assert_eq!(unsafe { anyface_sliders_knot_count(&sliders, 2) }, 1);
        let (mut knots, mut changes) = ([9.0], [9.0; 6]);
        let (k, c) = (knots.as_mut_ptr(), changes.as_mut_ptr());
        let status = unsafe { anyface_sliders_copy_knots(&sliders, 2, k, 1, null_mut()) };
        assert_eq!((status, knots), (AnyfaceStatus::Ok, [0.0]));
        let status = unsafe { anyface_sliders_copy_changes(&sliders, 2, c, 6, null_mut()) };
        assert_eq!(
            (status, changes),
            (AnyfaceStatus::Ok, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
        );
        let status = unsafe { anyface_sliders_copy_changes(&sliders, 2, c, 5, null_mut()) };
        assert_eq!(status, AnyfaceStatus::InvalidInput);
    }

    #[test]
    fn a_slider_that_moves_nothing_has_no_knots_and_an_unknown_one_is_refused() {
        let sliders = sliders();
        let mut none = [0.0f32; 0];
        for (slider, status) in [
            (0, AnyfaceStatus::Ok),
            (4, AnyfaceStatus::InvalidInput),
            (-1, AnyfaceStatus::InvalidInput),
        ] {
            assert_eq!(unsafe { anyface_sliders_knot_count(&sliders, slider) }, 0);
            let to = none.as_mut_ptr();
            let answer = unsafe { anyface_sliders_copy_knots(&sliders, slider, to, 0, null_mut()) };
            assert_eq!(answer, status);
        }
    }
}
