//! Weights of shapes over time, solved from the motion of vertices.

use anyface::{
    face::Rig,
    output::write_blend_weights,
    rig::{SolveOptions, SolvedWeights, solve},
};
use libc::c_char;
use ndarray::{ArrayView2, ArrayView3, Axis, s};

use crate::{
    clip::AnyfaceClip,
    error::{AnyfaceError, Failure},
    guard, pointer,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// Weights of `S` shapes in `T` frames, 0 to 1. They never change once they are made: any number of
/// threads may use them at the same time.
pub struct AnyfaceWeights(SolvedWeights);

/// Finds the weights with which shapes come nearest to a motion, by bounded least squares.
///
/// It uses few shapes at a time and keeps their weights smooth over time. Left and right weights are
/// alike where the motion hardly tells them apart. Of shapes that undo each other, by name or by the
/// motion they make, only one is used at a time. Accepts a progress handle.
///
/// `names`: `[shape_count]`, UTF-8; "…Left" and "…Right" are taken as a pair. `shapes`:
/// `[shape_count, vertex_count, 3]`, displacements at weight 1. `displacements`:
/// `[frame_count, vertex_count, 3]` in the same units, without motion of the whole head. `lips`:
/// `[lip_pairs, 2]`, an upper and a lower lip vertex that meet, such as those of the landmarks 61
/// and 67, 62 and 66, 63 and 65. In frames whose motion brings them together, the shapes do so too,
/// as well as they can. NULL with 0 for none. All arrays are copied. `progress` may be NULL. Free
/// with `anyface_weights_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not finite, for a lip vertex out
/// of range, or if none of the shapes moves anything, and with `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weights_new(
    names: *const *const c_char,
    shapes: *const f32,
    shape_count: usize,
    displacements: *const f32,
    frame_count: usize,
    vertex_count: usize,
    lips: *const u32,
    lip_pairs: usize,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceWeights,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let rig = unsafe { rig(names, shapes, shape_count, vertex_count) }?;
        let lips = unsafe { pairs(lips, lip_pairs) }?;
        let motion = unsafe { moves("displacements", displacements, frame_count, vertex_count) }?;
        solved(&rig, motion, lips, progress)
    };
    unsafe { guard::give(out, error, make) }
}

/// Finds weights as `anyface_weights_new()` does, but for the motion of a clip, whose displacements
/// stay in the library.
///
/// `shapes`: `[shape_count, vertex_count, 3]`, for the clip's first `vertex_count` vertices; later
/// ones are left out. `to_shapes`: `[3, 3]`, row by row, the matrix that takes displacements of the
/// clip to the axes and units of the shapes. NULL leaves them as they are. All else is as for
/// `anyface_weights_new()`. The clip may be freed before the weights.
/// Fails as `anyface_weights_new()` does, and with `ANYFACE_STATUS_INVALID_INPUT` for more vertices
/// than the clip has.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weights_new_of_clip(
    clip: *const AnyfaceClip,
    names: *const *const c_char,
    shapes: *const f32,
    shape_count: usize,
    vertex_count: usize,
    to_shapes: *const f32,
    lips: *const u32,
    lip_pairs: usize,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceWeights,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let clip = unsafe { pointer::handle("clip", clip) }?;
        let rig = unsafe { rig(names, shapes, shape_count, vertex_count) }?;
        let lips = unsafe { pairs(lips, lip_pairs) }?;
        let motion = &clip.animation.vertices.displacements;
        let of_clip = motion.len_of(Axis(1));
        if vertex_count > of_clip {
            return Err(Failure::invalid(format!(
                "vertex_count: expected at most {of_clip}, those of the clip, got {vertex_count}"
            )));
        }
        let motion = motion.slice(s![.., ..vertex_count, ..]);
        let weights = if to_shapes.is_null() {
            solved(&rig, motion, lips, progress)?
        } else {
            let rows = unsafe { pointer::slice("to_shapes", to_shapes, 3, 3) }?;
            let mut turned = motion.to_owned();
            for mut moved in turned.rows_mut() {
                let [x, y, z] = [moved[0], moved[1], moved[2]];
                for (axis, row) in rows.as_chunks::<3>().0.iter().enumerate() {
                    moved[axis] = x * row[0] + y * row[1] + z * row[2];
                }
            }
            solved(&rig, turned.view(), lips, progress)?
        };
        Ok(weights)
    };
    unsafe { guard::give(out, error, make) }
}

/// Solves for the weights of all shapes of a rig.
fn solved(
    rig: &Rig,
    motion: ArrayView3<'_, f32>,
    lips: &[[u32; 2]],
    progress: *const AnyfaceProgress,
) -> Result<AnyfaceWeights, Failure> {
    let work = |watch: anyface::job::ProgressFn<'_>| {
        solve(
            rig,
            rig.names.len(),
            motion,
            lips,
            &SolveOptions::editable(),
            watch,
        )
    };
    unsafe { watched(progress, work) }.map(AnyfaceWeights)
}

/// Takes the caller's own weights, such as those of `anyface_motion_copy_weights()`, so that they
/// can be written as a file.
///
/// `names`: `[shape_count]`, UTF-8. `weights`: `[frame_count, shape_count]`. Both are copied. Free
/// with `anyface_weights_free()`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not
/// finite.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weights_new_from_array(
    names: *const *const c_char,
    weights: *const f32,
    shape_count: usize,
    frame_count: usize,
    out: *mut *mut AnyfaceWeights,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let names = unsafe { texts("names", names, shape_count) }?;
        let values = unsafe { pointer::slice("weights", weights, frame_count, shape_count) }?;
        let weights = copy_weights(names, values, frame_count)?;
        Ok(AnyfaceWeights(weights))
    };
    unsafe { guard::give(out, error, make) }
}

/// Copies the caller's weights `[frames, names]` and checks that they are finite. They count as
/// exact: no motion is left out.
fn copy_weights(
    names: Vec<String>,
    values: &[f32],
    frames: usize,
) -> Result<SolvedWeights, Failure> {
    if let Some(at) = values.iter().position(|x| !x.is_finite()) {
        let (frame, shape) = (at / names.len(), at % names.len());
        let message = format!("weights: not finite at frame {frame}, shape {shape}");
        return Err(Failure::invalid(message));
    }
    let weights = ArrayView2::from_shape((frames, names.len()), values)
        .map_err(|error| Failure::invalid(format!("weights: {error}")))?
        .to_owned();
    Ok(SolvedWeights::exact(names, weights))
}

/// Copies the weights into the caller's buffer.
///
/// `buffer`: `[T, S]`, 0 to 1; `float_count` must be `T * S`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weights_copy(
    weights: *const AnyfaceWeights,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let weights = &unsafe { pointer::handle("weights", weights) }?.0.weights;
        Ok(weights.iter().copied().collect::<Vec<f32>>())
    };
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Share of the motion that the shapes leave out, root mean square over vertices and frames: 0 if
/// they show all of it, 1 if they show none. 0 for NULL and for a motion that does not move.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weights_left_out(weights: *const AnyfaceWeights) -> f32 {
    let Some(AnyfaceWeights(weights)) = (unsafe { weights.as_ref() }) else {
        return 0.0;
    };
    let energy = |rms: &[f32]| rms.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
    match energy(&weights.motion) {
        motion if motion > 0.0 => (energy(&weights.residual) / motion).sqrt() as f32,
        _ => 0.0,
    }
}

/// Writes the weights as a file. The ending of its name sets the kind.
///
/// .csv, in the form of Live Link Face: the 52 ARKit shapes, with 0 for those that are not among
/// the names. .json: `fps`, `names` `[S]`, `weights` `[T][S]`. `path`: UTF-8. `fps`: 1 to 240.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending or frame rate, or with
/// `ANYFACE_STATUS_IO` if the file cannot be written; in that case no file is left behind.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weights_write(
    weights: *const AnyfaceWeights,
    path: *const c_char,
    fps: f64,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let weights = &unsafe { pointer::handle("weights", weights) }?.0;
        let path = unsafe { pointer::path("path", path) }?;
        Ok(write_blend_weights(path, weights, fps)?)
    };
    unsafe { guard::guard(error, work) }
}

/// Frees weights that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_weights_free(weights: *mut AnyfaceWeights) {
    unsafe { guard::free(weights) }
}

/// Copies the caller's shapes into a rig.
///
/// # Safety
/// As [`texts`] and [`moves`].
unsafe fn rig(
    names: *const *const c_char,
    shapes: *const f32,
    count: usize,
    vertices: usize,
) -> Result<Rig, Failure> {
    Ok(Rig {
        names: unsafe { texts("names", names, count) }?,
        deltas: unsafe { moves("shapes", shapes, count, vertices) }?.to_owned(),
        reports: Vec::new(),
    })
}

/// Borrows pairs of vertices, `[count, 2]`.
///
/// # Safety
/// `lips` is NULL or valid for reads of `count * 2` values.
unsafe fn pairs<'a>(lips: *const u32, count: usize) -> Result<&'a [[u32; 2]], Failure> {
    if count == 0 {
        return Ok(&[]);
    }
    let lips = unsafe { pointer::slice("lips", lips, count, 2) }?;
    Ok(lips.as_chunks().0)
}

/// Borrows displacements, `[count, vertices, 3]`.
///
/// # Safety
/// `values` is NULL or valid for reads of `count * vertices * 3` values.
unsafe fn moves<'a>(
    name: &'static str,
    values: *const f32,
    count: usize,
    vertices: usize,
) -> Result<ArrayView3<'a, f32>, Failure> {
    let columns = vertices.saturating_mul(3);
    let values = unsafe { pointer::slice(name, values, count, columns) }?;
    ArrayView3::from_shape((count, vertices, 3), values)
        .map_err(|error| Failure::invalid(format!("{name}: {error}")))
}

/// # Safety
/// `values` is NULL or valid for reads of `count` strings, each NULL or NUL-terminated.
unsafe fn texts(
    name: &'static str,
    values: *const *const c_char,
    count: usize,
) -> Result<Vec<String>, Failure> {
    let values = unsafe { pointer::slice(name, values, count, 1) }?;
    let text = |value: &*const c_char| unsafe { pointer::text(name, *value) }.map(str::to_owned);
    values.iter().map(text).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{anyface_error_free, anyface_error_status};
    use anyface::{deform::VertexClip, motion::Visibility, spread::Animation};
    use ndarray::Array3;
    use std::ptr::{null, null_mut};

    /// Two shapes that move different vertices, and their sum with weights 0.5 and 0.25, twice.
    fn example() -> (Array3<f32>, Array3<f32>) {
        let shapes = Array3::from_shape_fn((2, 4, 3), |(s, v, _)| f32::from(v / 2 == s));
        let strength = [0.5, 0.25];
        let motion = Array3::from_shape_fn((2, 4, 3), |(_, v, _)| strength[v / 2]);
        (shapes, motion)
    }

    unsafe fn solved_of(motion: &Array3<f32>) -> Result<*mut AnyfaceWeights, AnyfaceStatus> {
        let (shapes, _) = example();
        let names = [c"jawOpen".as_ptr(), c"tongueOut".as_ptr()];
        let (mut out, mut error) = (null_mut(), null_mut());
        let status = unsafe {
            anyface_weights_new(
                names.as_ptr(),
                shapes.as_ptr(),
                2,
                motion.as_ptr(),
                motion.dim().0,
                4,
                null(),
                0,
                null(),
                &mut out,
                &mut error,
            )
        };
        if status == AnyfaceStatus::Ok {
            return Ok(out);
        }
        assert_eq!(unsafe { anyface_error_status(error) }, status);
        unsafe { anyface_error_free(error) };
        Err(status)
    }

    #[test]
    fn known_weights_come_back() {
        unsafe {
            let weights = solved_of(&example().1).unwrap();
            let (mut buffer, mut error) = ([0.0f32; 4], null_mut());
            let status = anyface_weights_copy(weights, buffer.as_mut_ptr(), 4, &mut error);
            assert_eq!(status, AnyfaceStatus::Ok);
            for (got, expected) in buffer.iter().zip([0.5, 0.25, 0.5, 0.25]) {
                // The preference for few weights makes each of them a little smaller.
                assert!((got - expected).abs() < 3e-3, "{buffer:?}");
            }
            assert!(anyface_weights_left_out(weights) < 0.01);
            anyface_weights_free(weights);
        }
    }

    #[test]
    fn a_clip_gives_the_same_bits_in_the_frame_of_the_shapes() {
        let (shapes, motion) = example();
        // The clip has one more vertex. Its axes are in another order, and one is reversed.
        let displacements = Array3::from_shape_fn((2, 5, 3), |(t, v, axis)| match (v, axis) {
            (4, _) => 7.0,
            (_, 2) => -motion[[t, v, 0]],
            _ => motion[[t, v, axis + 1]],
        });
        let animation = Animation {
            vertices: VertexClip {
                displacements,
                fps: 25.0,
            },
            landmarks_neutral: [[0.0; 3]; 68],
            landmark_displacements: Array3::zeros((2, 68, 3)),
        };
        let clip = AnyfaceClip::new(animation, 1.0, Visibility::Speaks);
        let to_shapes = [0.0f32, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let names = [c"jawOpen".as_ptr(), c"tongueOut".as_ptr()];
        let of_clip = |vertices: usize, out: &mut *mut AnyfaceWeights| unsafe {
            anyface_weights_new_of_clip(
                &clip,
                names.as_ptr(),
                shapes.as_ptr(),
                2,
                vertices,
                to_shapes.as_ptr(),
                null(),
                0,
                null(),
                out,
                null_mut(),
            )
        };
        let mut of = null_mut();
        assert_eq!(of_clip(4, &mut of), AnyfaceStatus::Ok);
        unsafe {
            let expected = solved_of(&motion).unwrap();
            assert_eq!((*of).0, (*expected).0);
            anyface_weights_free(of);
            anyface_weights_free(expected);
        }
        assert_eq!(of_clip(6, &mut of), AnyfaceStatus::InvalidInput);
    }

    #[test]
    fn what_no_shape_can_do_is_left_out() {
        let mut motion = example().1;
        motion.mapv_inplace(|x| -x);
        unsafe {
            let weights = solved_of(&motion).unwrap();
            assert!((anyface_weights_left_out(weights) - 1.0).abs() < 1e-3);
            anyface_weights_free(weights);
        }
    }

    #[test]
    fn weights_of_the_caller_are_kept_as_they_are() {
        let names = || vec!["jawOpen".to_owned(), "mouthClose".to_owned()];
        let copy = copy_weights(names(), &[0.1, 0.2, 0.3, 0.4], 2).unwrap();
        assert_eq!((copy.weights[[1, 0]], copy.names), (0.3, names()));
        let failure = copy_weights(names(), &[0.1, 0.2, f32::NAN, 0.4], 2).unwrap_err();
        assert!(failure.message().contains("frame 1, shape 0"));
    }

    #[test]
    fn motion_that_is_not_finite_is_refused() {
        let mut motion = example().1;
        motion[[1, 0, 0]] = f32::NAN;
        assert_eq!(
            unsafe { solved_of(&motion) },
            Err(AnyfaceStatus::InvalidInput)
        );
    }
}
