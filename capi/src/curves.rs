//! Reduces weights over time to a few Bézier keys.

use anyface::curves::{Curve, FaceFit, Key, fit_each, on_face};
use ndarray::{ArrayView2, ArrayView3};

use crate::{
    error::{AnyfaceError, Failure},
    guard, pointer,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// `K` curves with few keys each. They never change once they are made: any number of threads may
/// use them at the same time.
///
/// A curve passes through the values at its keys. Between two keys `n` frames apart it is a Bézier
/// segment. Each of its handles lies `0.39 * n` frames from its key, along that key's slope.
pub struct AnyfaceCurves(FaceFit);

const _: () = guard::shared_by_threads::<AnyfaceCurves>();

/// Fits few keys to the weights of shapes, so that no vertex is farther than `tolerance` from its
/// place in any frame. Accepts a progress handle.
///
/// `weights`: `[frame_count, curve_count]`. `shapes`: `[curve_count, vertex_count, 3]`,
/// displacements at weight 1. `tolerance`: above 0, in the unit of the shapes. `touching`:
/// `[frame_count]`, 1 in frames where the lips touch; may be NULL. In these frames a tenth of the
/// tolerance applies, and a run of them starts and ends with a key on every curve that moves the
/// face by more than the tolerance. `progress` may be NULL. Free with `anyface_curves_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not finite, `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_curves_new(
    weights: *const f32,
    frame_count: usize,
    curve_count: usize,
    shapes: *const f32,
    vertex_count: usize,
    tolerance: f32,
    touching: *const u8,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceCurves,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let rows = unsafe { pointer::slice("weights", weights, frame_count, curve_count) }?;
        let floats = vertex_count.saturating_mul(3);
        let vectors = unsafe { pointer::slice("shapes", shapes, curve_count, floats) }?;
        let marks = unsafe { marks(touching, frame_count) }?;
        let rows = ArrayView2::from_shape((frame_count, curve_count), rows);
        let vectors = ArrayView3::from_shape((curve_count, vertex_count, 3), vectors);
        let (rows, vectors) = (rows.map_err(shape)?, vectors.map_err(shape)?);
        let work = |watch: anyface::job::ProgressFn<'_>| {
            on_face(rows, vectors, f64::from(tolerance), &marks, watch)
        };
        unsafe { watched(progress, work) }.map(AnyfaceCurves)
    };
    unsafe { guard::give(out, error, make) }
}

/// Fits few keys to values of any kind, each column by itself.
///
/// `values`: `[frame_count, curve_count]`. `limits`: `[curve_count]`, above 0: how far each curve
/// may be from its values in any frame, in their unit. `touching`: `[frame_count]`, 1 for frames in
/// which every curve has a key; may be NULL. Free with `anyface_curves_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not finite.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_curves_new_each(
    values: *const f32,
    frame_count: usize,
    curve_count: usize,
    limits: *const f32,
    touching: *const u8,
    out: *mut *mut AnyfaceCurves,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let rows = unsafe { pointer::slice("values", values, frame_count, curve_count) }?;
        let limits = unsafe { pointer::slice("limits", limits, curve_count, 1) }?;
        let marks = unsafe { marks(touching, frame_count) }?;
        let limits: Vec<f64> = limits.iter().map(|&limit| f64::from(limit)).collect();
        let column = |k: usize| {
            rows.iter()
                .skip(k)
                .step_by(curve_count)
                .map(|&w| f64::from(w))
                .collect()
        };
        let columns: Vec<Vec<f64>> = (0..curve_count).map(column).collect();
        let curves = fit_each(&columns, &limits, &marks)?;
        Ok(AnyfaceCurves(FaceFit { curves, error: 0.0 }))
    };
    unsafe { guard::give(out, error, make) }
}

/// Number of keys of a curve; 0 for NULL and for a curve that does not exist.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_curves_key_count(
    curves: *const AnyfaceCurves,
    curve: usize,
) -> usize {
    let curves = unsafe { curves.as_ref() };
    curves
        .and_then(|curves| curves.0.curves.get(curve))
        .map_or(0, Vec::len)
}

/// Copies the keys of a curve.
///
/// `frames`: the frame of each key, in rising order, including the first and the last frame.
/// `slopes`: the slope of each key's handles, per frame. Both buffers hold `key_count` values;
/// `key_count` must be `anyface_curves_key_count()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a curve that does not exist and another
/// `key_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_curves_copy_keys(
    curves: *const AnyfaceCurves,
    curve: usize,
    frames: *mut u32,
    slopes: *mut f32,
    key_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let copy = || {
        let every = &unsafe { pointer::handle("curves", curves) }?.0.curves;
        let keys: &Curve = every.get(curve).ok_or_else(|| {
            Failure::invalid(format!(
                "curve: expected a number below {}, got {curve}",
                every.len()
            ))
        })?;
        let rows: Vec<u32> = keys.iter().map(|key| key.row as u32).collect();
        let along: Vec<f32> = keys.iter().map(|key: &Key| key.slope as f32).collect();
        unsafe { pointer::copy_out("frames", &rows, frames, key_count) }?;
        unsafe { pointer::copy_out("slopes", &along, slopes, key_count) }
    };
    unsafe { guard::guard(error, copy) }
}

/// Frees curves that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_curves_free(curves: *mut AnyfaceCurves) {
    unsafe { guard::free(curves) }
}

/// Reads which frames are marked; for NULL none is.
///
/// # Safety
/// `touching` is NULL or valid for reads of `frame_count` values.
unsafe fn marks(touching: *const u8, frame_count: usize) -> Result<Vec<bool>, Failure> {
    if touching.is_null() {
        return Ok(vec![false; frame_count]);
    }
    let marks = unsafe { pointer::slice("touching", touching, frame_count, 1) }?;
    Ok(marks.iter().map(|&mark| mark != 0).collect())
}

fn shape(error: ndarray::ShapeError) -> Failure {
    Failure::invalid(format!("curves: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{anyface_error_free, anyface_error_status};
    use std::ptr::{null, null_mut};

    #[test]
    fn an_arch_has_few_keys_and_bad_numbers_are_errors() {
        let arch: Vec<f32> = (0..41)
            .map(|t| (t as f32 / 40.0 * std::f32::consts::PI).sin())
            .collect();
        let (mut curves, mut error) = (null_mut(), null_mut());
        let (values, limit) = (arch.as_ptr(), [0.02f32]);
        let status = unsafe {
            anyface_curves_new_each(
                values,
                41,
                1,
                limit.as_ptr(),
                null(),
                &mut curves,
                &mut error,
            )
        };
        assert_eq!(status, AnyfaceStatus::Ok);
        let count = unsafe { anyface_curves_key_count(curves, 0) };
        assert!((2..=4).contains(&count), "{count}");
        assert_eq!(unsafe { anyface_curves_key_count(curves, 1) }, 0);
        let (mut rows, mut slopes) = (vec![9u32; count], vec![9.0f32; count]);
        let (r, s) = (rows.as_mut_ptr(), slopes.as_mut_ptr());
        let status = unsafe { anyface_curves_copy_keys(curves, 0, r, s, count, &mut error) };
        assert_eq!(status, AnyfaceStatus::Ok);
        assert_eq!((rows[0], rows[count - 1]), (0, 40));
        assert!(slopes[0] > 0.0 && slopes[count - 1] < 0.0);
        let status = unsafe { anyface_curves_copy_keys(curves, 1, r, s, count, &mut error) };
        assert_eq!(status, AnyfaceStatus::InvalidInput);
        unsafe { anyface_error_free(error) };
        unsafe { anyface_curves_free(curves) };
        let none = [0.0f32];
        let status = unsafe {
            anyface_curves_new_each(
                values,
                41,
                1,
                none.as_ptr(),
                null(),
                &mut curves,
                &mut error,
            )
        };
        assert_eq!(status, AnyfaceStatus::InvalidInput);
        assert_eq!(
            unsafe { anyface_error_status(error) },
            AnyfaceStatus::InvalidInput
        );
        unsafe { anyface_error_free(error) };
    }
}
