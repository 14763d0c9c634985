//! Reduces a clip to shapes with weights over time, few enough for shape keys.

use anyface::deform::compression::{VertexBasis, compress};

use crate::{
    clip::AnyfaceClip,
    engine::AnyfaceEngine,
    error::AnyfaceError,
    guard, pointer,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// `K` shapes and their weights in every frame: `displacement[t] = sum over k of weight[t][k] *
/// shape[k]`. Weights lie within -1 and 1. The basis never changes once it is made: any number
/// of threads may use it at the same time.
pub struct AnyfaceBasis(pub(crate) VertexBasis);

impl AnyfaceBasis {
    /// Makes both arrays contiguous.
    fn new(mut basis: VertexBasis) -> Self {
        if !basis.shapes.is_standard_layout() {
            basis.shapes = basis.shapes.as_standard_layout().into_owned();
        }
        if !basis.weights.is_standard_layout() {
            basis.weights = basis.weights.as_standard_layout().into_owned();
        }
        AnyfaceBasis(basis)
    }

    /// `[K, V, 3]`.
    fn shapes(&self) -> &[f32] {
        self.0.shapes.as_slice().unwrap_or_default()
    }

    /// `[T, K]`.
    fn weights(&self) -> &[f32] {
        self.0.weights.as_slice().unwrap_or_default()
    }
}

/// Finds the fewest shapes that keep every vertex in every frame within `max_error` of its place.
/// Accepts a progress handle.
///
/// `max_error`: mesh units, 0 or more. `max_shapes`: at least 1. If this many shapes are too few,
/// the error exceeds `max_error`; `anyface_basis_max_error()` returns it. `progress` may be NULL. A
/// clip that does not move has no shapes. If the error allows it, at most 20 shapes have a weight
/// other than 0 in any one frame. Free with `anyface_basis_free()`; the clip may be freed before.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for numbers out of range, `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_basis_new(
    engine: *const AnyfaceEngine,
    clip: *const AnyfaceClip,
    max_error: f32,
    max_shapes: usize,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceBasis,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let engine = unsafe { pointer::handle("engine", engine) }?;
        let clip = &unsafe { pointer::handle("clip", clip) }?.animation.vertices;
        let reduce = |watch: anyface::job::ProgressFn<'_>| {
            let engine = &engine.0;
            engine.threads(|| compress(clip, max_error, max_shapes, watch))
        };
        let basis = unsafe { watched(progress, reduce) }?;
        Ok(AnyfaceBasis::new(basis))
    };
    unsafe { guard::give(out, error, make) }
}

/// Number `K` of shapes; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_basis_shape_count(basis: *const AnyfaceBasis) -> usize {
    unsafe { basis.as_ref() }.map_or(0, |basis| basis.0.shapes.len_of(ndarray::Axis(0)))
}

/// Largest distance of any vertex in any frame from its place in the clip, mesh units; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_basis_max_error(basis: *const AnyfaceBasis) -> f32 {
    unsafe { basis.as_ref() }.map_or(0.0, |basis| basis.0.max_error)
}

/// Copies the shapes into the caller's buffer.
///
/// `buffer`: `[K, V, 3]`, mesh units; `float_count` must be `K * V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_basis_copy_shapes(
    basis: *const AnyfaceBasis,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || Ok(unsafe { pointer::handle("basis", basis) }?.shapes());
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Copies the weights into the caller's buffer.
///
/// `buffer`: `[T, K]`, -1 to 1; `float_count` must be `T * K`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_basis_copy_weights(
    basis: *const AnyfaceBasis,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || Ok(unsafe { pointer::handle("basis", basis) }?.weights());
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Frees a basis that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_basis_free(basis: *mut AnyfaceBasis) {
    unsafe { guard::free(basis) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{anyface_error_free, anyface_error_status};
    use anyface::{
        Engine, EngineOptions, deform::VertexClip, motion::Visibility, spread::Animation,
    };
    use ndarray::{Array3, Axis};
    use std::ptr::null_mut;

    /// 20 frames of 30 vertices, which two shapes can reproduce.
    fn clip() -> AnyfaceClip {
        let swing = |(t, v, c): (usize, usize, usize)| {
            let (t, v) = (t as f32, (3 * v + c) as f32);
            (0.7 * t).sin() * (0.3 * v).cos() + 0.2 * (0.2 * t).cos() * (0.5 * v).sin()
        };
        let vertices = VertexClip {
            displacements: Array3::from_shape_fn((20, 30, 3), swing),
            fps: 25.0,
        };
        let animation = Animation {
            vertices,
            landmarks_neutral: [[0.0; 3]; 68],
            landmark_displacements: Array3::zeros((20, 68, 3)),
        };
        AnyfaceClip::new(animation, 1.0, Visibility::Speaks)
    }

    /// Requests a basis of at most 16 shapes.
    fn ask(
        clip: &AnyfaceClip,
        max_error: f32,
        error: &mut *mut AnyfaceError,
    ) -> (AnyfaceStatus, *mut AnyfaceBasis) {
        let engine = AnyfaceEngine(Engine::new(EngineOptions::default()).unwrap());
        let (mut basis, silent) = (null_mut(), std::ptr::null());
        let status =
            unsafe { anyface_basis_new(&engine, clip, max_error, 16, silent, &mut basis, error) };
        (status, basis)
    }

    #[test]
    fn shapes_and_weights_give_the_clip_back() {
        let clip = clip();
        let mut error = null_mut();
        let (status, basis) = ask(&clip, 1e-4, &mut error);
        assert_eq!(status, AnyfaceStatus::Ok);
        let count = unsafe { anyface_basis_shape_count(basis) };
        assert_eq!(count, 2);
        let (mut shapes, mut weights) = (vec![0.0f32; count * 90], vec![0.0f32; 20 * count]);
        let (s, w) = (shapes.as_mut_ptr(), weights.as_mut_ptr());
        unsafe {
            let status = anyface_basis_copy_shapes(basis, s, shapes.len(), &mut error);
            assert_eq!(status, AnyfaceStatus::Ok);
            let status = anyface_basis_copy_weights(basis, w, weights.len(), &mut error);
            assert_eq!(status, AnyfaceStatus::Ok);
            assert!(anyface_basis_max_error(basis) <= 1e-4);
            anyface_basis_free(basis);
        }
        for (t, frame) in clip
            .animation
            .vertices
            .displacements
            .axis_iter(Axis(0))
            .enumerate()
        {
            for (i, truth) in frame.iter().enumerate() {
                let sum: f32 = (0..count)
                    .map(|k| weights[t * count + k] * shapes[k * 90 + i])
                    .sum();
                assert!(
                    (sum - truth).abs() < 2e-4,
                    "frame {t}, value {i}: {sum} for {truth}"
                );
            }
        }
    }

    #[test]
    fn a_negative_error_is_refused() {
        let mut error = null_mut();
        let (status, basis) = ask(&clip(), -1.0, &mut error);
        assert_eq!((status, basis), (AnyfaceStatus::InvalidInput, null_mut()));
        assert_eq!(
            unsafe { anyface_error_status(error) },
            AnyfaceStatus::InvalidInput
        );
        unsafe { anyface_error_free(error) };
    }
}
