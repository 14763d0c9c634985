//! Heads made from numbers.

use std::{ffi::CString, path::Path, sync::Arc};

use anyface::head::{COEFFICIENTS, Head, HeadOptions, ScanOptions};
use libc::c_char;

use crate::{
    error::{AnyfaceError, Failure},
    face::AnyfaceFace,
    guard,
    mesh::AnyfaceMesh,
    pointer::{self, handles},
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// One head of FaceTalk's parametric model. Never changes after it was made: any number of threads may use
/// it at the same time.
///
/// It is 100 coefficients, each from a normal distribution; all 0 is the mean head. Its frame is metres, +x to the
/// subject's left, +y up, +z out of the face.
pub struct AnyfaceHead {
    model: Arc<Head>,
    coefficients: Vec<f32>,
    directions: Arc<Vec<CString>>,
    fit_mm: f32,
}

const _: () = guard::shared_by_threads::<AnyfaceHead>();

impl AnyfaceHead {
    fn open(folder: Option<&Path>) -> Result<Self, Failure> {
        let model = Head::open(folder)?;
        let directions = model.config().directions.iter();
        Ok(AnyfaceHead {
            directions: Arc::new(
                directions
                    .map(|direction| pointer::c_text(&direction.name))
                    .collect(),
            ),
            coefficients: vec![0.0; COEFFICIENTS],
            model: Arc::new(model),
            fit_mm: 0.0,
        })
    }

    /// The same model with other coefficients.
    fn other(&self, coefficients: Vec<f32>) -> AnyfaceHead {
        AnyfaceHead {
            model: Arc::clone(&self.model),
            directions: Arc::clone(&self.directions),
            coefficients,
            fit_mm: 0.0,
        }
    }
}

/// A head from coefficients, or the random one of a seed.
///
/// `weights_dir`: UTF-8, a folder of models instead of the built-in ones, or NULL. `coefficients`:
/// `[coefficient_count]`, which must be 100, or NULL with 0 for those of `seed`. Free with `anyface_head_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another count, numbers that are not finite, and heads far outside what
/// was learned; `ANYFACE_STATUS_WEIGHTS` or `ANYFACE_STATUS_IO` for a folder that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_new(
    weights_dir: *const c_char,
    coefficients: *const f32,
    coefficient_count: usize,
    seed: u64,
    out: *mut *mut AnyfaceHead,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let given = match coefficients.is_null() && coefficient_count == 0 {
            true => Head::random(seed),
            false => {
                let given =
                    unsafe { pointer::slice("coefficients", coefficients, coefficient_count, 1) }?;
                Head::checked(given.to_vec(), false)?
            }
        };
        let folder = unsafe { pointer::optional_text("weights_dir", weights_dir) }?;
        let head = AnyfaceHead::open(folder.map(Path::new))?;
        Ok(head.other(given))
    };
    unsafe { guard::give(out, error, make) }
}

/// The head between two others: `share` 0 is `a`, 1 is `b`. Free with `anyface_head_free()`.
///
/// Both must be of the same model. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a share outside 0 to 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_new_mixed(
    a: *const AnyfaceHead,
    b: *const AnyfaceHead,
    share: f32,
    out: *mut *mut AnyfaceHead,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (a, b) = handles!(a, b);
        let mixed = Head::mixture(&a.coefficients, &b.coefficients, share)?;
        Ok(a.other(mixed))
    };
    unsafe { guard::give(out, error, make) }
}

/// The same head with another value along one direction, -4 to 4; 0 is the average. Free with
/// `anyface_head_free()`.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a value or number out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_new_along(
    head: *const AnyfaceHead,
    direction: usize,
    value: f32,
    out: *mut *mut AnyfaceHead,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let head = unsafe { pointer::handle("head", head) }?;
        let mut moved = head.coefficients.clone();
        head.model.set_along(&mut moved, direction, value)?;
        Ok(head.other(moved))
    };
    unsafe { guard::give(out, error, make) }
}

/// The head that is most like a face at rest: a scan or a model of which the landmarks are known. Long: accepts a
/// progress handle, which may be NULL. Free with `anyface_head_free()`.
///
/// `weights_dir`: as in `anyface_head_new()`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for fewer than 300 vertices on the
/// face, and where it stays more than 3 mm away on average.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_fit(
    weights_dir: *const c_char,
    face: *const AnyfaceFace,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceHead,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let face = &unsafe { pointer::handle("face", face) }?.0;
        let folder = unsafe { pointer::optional_text("weights_dir", weights_dir) }?;
        let head = AnyfaceHead::open(folder.map(Path::new))?;
        let options = ScanOptions::default();
        let (points, landmarks) = (&face.mesh.positions, &face.landmarks);
        let fit = unsafe {
            watched(progress, |watch| {
                head.model.fit_scan(points, landmarks, &options, watch)
            })
        }?;
        let mut fitted = head.other(fit.coefficients);
        fitted.fit_mm = fit.mean_mm;
        Ok(fitted)
    };
    unsafe { guard::give(out, error, make) }
}

/// How far the face lies from the head that was fitted to it, mean, millimetres on a head of human size; 0 for NULL and
/// heads that were not fitted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_fit_mm(head: *const AnyfaceHead) -> f32 {
    unsafe { head.as_ref() }.map_or(0.0, |head| head.fit_mm)
}

/// Copies the coefficients. `buffer`: `[100]`; `count` must be 100.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_copy_coefficients(
    head: *const AnyfaceHead,
    buffer: *mut f32,
    count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || Ok(&unsafe { pointer::handle("head", head) }?.coefficients);
    unsafe { guard::copy(buffer, count, error, values) }
}

/// Number `D` of directions in which heads differ, the one that moves the surface furthest first; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_direction_count(head: *const AnyfaceHead) -> usize {
    unsafe { head.as_ref() }.map_or(0, |head| head.directions.len())
}

/// What a direction changes most, such as "face width"; lives until the head is freed. NULL for NULL or a number
/// that is not below the count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_direction_name(
    head: *const AnyfaceHead,
    direction: usize,
) -> *const c_char {
    pointer::lend(unsafe { head.as_ref() }.and_then(|head| head.directions.get(direction)))
}

/// Copies how far the head lies along each direction. `buffer`: `[D]`; `count` must be `D`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_copy_directions(
    head: *const AnyfaceHead,
    buffer: *mut f32,
    count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let head = unsafe { pointer::handle("head", head) }?;
        Ok(head.model.along(&head.coefficients)?)
    };
    unsafe { guard::copy(buffer, count, error, values) }
}

/// The head as a mesh at rest, metres. Long: accepts a progress handle, which may be NULL. Free with
/// `anyface_mesh_free()`.
///
/// `resolution`: cells along the longest side of the grid, such as 128. `parts`: not 0 for eyes, teeth and tongue
/// beside the skin, whose vertices and triangles come first. `skin_vertices`: may be NULL; how many of the vertices
/// are skin. `landmark_vertices`: `[68]`, may be NULL; the vertices on which the landmarks lie.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a resolution that would take more than 1 GiB.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_mesh(
    head: *const AnyfaceHead,
    resolution: usize,
    parts: i32,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceMesh,
    skin_vertices: *mut usize,
    landmark_vertices: *mut u32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let head = unsafe { pointer::handle("head", head) }?;
        let options = HeadOptions {
            resolution,
            parts: parts != 0,
        };
        let one = head
            .model
            .one(head.model.identity_code(&head.coefficients)?)?;
        let made = unsafe { watched(progress, |watch| one.mesh(&options, watch)) }?;
        let (vertices, skin) = (made.landmarks.vertices, [made.canonical.len()]);
        unsafe {
            pointer::copy_where_asked("landmark_vertices", &vertices, landmark_vertices)?;
            pointer::copy_where_asked("skin_vertices", &skin, skin_vertices)?;
        }
        Ok(AnyfaceMesh(made.mesh))
    };
    unsafe { guard::give(out, error, make) }
}

/// Frees a head that no running call uses, with everything it lent; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_free(head: *mut AnyfaceHead) {
    unsafe { guard::free(head) }
}

#[cfg(test)]
mod tests {
    use std::{
        ffi::CStr,
        ptr::{null, null_mut},
    };

    use super::*;
    use crate::{
        error::{anyface_error_free, anyface_error_message},
        mesh::{anyface_mesh_free, anyface_mesh_vertex_count},
    };

    fn made(seed: u64) -> *mut AnyfaceHead {
        let mut head = null_mut();
        let status = unsafe { anyface_head_new(null(), null(), 0, seed, &mut head, null_mut()) };
        assert_eq!(status, AnyfaceStatus::Ok);
        head
    }

    #[test]
    fn a_head_is_mixed_moved_and_made() {
        unsafe {
            let (a, b) = (made(1), made(2));
            let (mut mixed, mut moved, mut mesh) = (null_mut(), null_mut(), null_mut());
            assert_eq!(
                anyface_head_new_mixed(a, b, 0.5, &mut mixed, null_mut()),
                AnyfaceStatus::Ok
            );
            let status = anyface_head_new_along(mixed, 1, 2.0, &mut moved, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            let count = anyface_head_direction_count(moved);
            let mut along = vec![0.0f32; count];
            let status = anyface_head_copy_directions(moved, along.as_mut_ptr(), count, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            assert!((along[1] - 2.0).abs() < 1e-4);
            assert!(!anyface_head_direction_name(moved, 0).is_null());
            assert!(anyface_head_direction_name(moved, count).is_null());
            let (mut skin, mut marks) = (0usize, [0u32; 68]);
            let to = (&mut skin as *mut usize, marks.as_mut_ptr());
            let status = anyface_head_mesh(moved, 40, 1, null(), &mut mesh, to.0, to.1, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            assert!(skin < anyface_mesh_vertex_count(mesh));
            assert!(marks.iter().all(|v| (*v as usize) < skin));
            anyface_mesh_free(mesh);
            for head in [a, b, mixed, moved] {
                anyface_head_free(head);
            }
        }
    }

    #[test]
    fn coefficients_make_the_same_head_and_wrong_ones_are_told() {
        unsafe {
            let (head, mut again) = (made(1), null_mut());
            let (mut first, mut second) = ([0.0f32; 100], [1.0f32; 100]);
            let status = anyface_head_copy_coefficients(head, first.as_mut_ptr(), 100, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            let status = anyface_head_new(null(), first.as_ptr(), 100, 0, &mut again, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            let status =
                anyface_head_copy_coefficients(again, second.as_mut_ptr(), 100, null_mut());
            assert_eq!((status, first), (AnyfaceStatus::Ok, second));
            anyface_head_free(head);
            anyface_head_free(again);
            let (mut none, mut error) = (null_mut(), null_mut());
            let far = [9.0f32; 100];
            let status = anyface_head_new(null(), far.as_ptr(), 100, 0, &mut none, &mut error);
            assert_eq!(status, AnyfaceStatus::InvalidInput);
            let message = CStr::from_ptr(anyface_error_message(error))
                .to_str()
                .unwrap();
            assert!(message.contains("no such head was learned"), "{message}");
            anyface_error_free(error);
        }
    }
}
