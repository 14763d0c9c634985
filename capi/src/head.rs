//! Heads of a parametric model, made from numbers.

use std::{ffi::CString, path::Path, sync::Arc};

use anyface::head::{COEFFICIENTS, HeadMaker, ScanOptions};
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

/// One head of FaceTalk's parametric model. It never changes once it is made: any number of threads
/// may use it at the same time.
///
/// `N` numbers describe it: 100 coefficients, each from a normal distribution, then the value of
/// each trait (age, sex, weight …), -4 to 4. The mean head has only zeros. The frame is in metres,
/// +x to the subject's left, +y up, +z out of the face.
pub struct AnyfaceHead {
    maker: Arc<HeadMaker>,
    numbers: Vec<f32>,
    names: Arc<Names>,
    fit_mm: f32,
}

/// Texts that are lent to the caller.
struct Names {
    directions: Vec<CString>,
    materials: Vec<CString>,
}

const _: () = guard::shared_by_threads::<AnyfaceHead>();

impl AnyfaceHead {
    fn open(folder: Option<&Path>) -> Result<Self, Failure> {
        let maker = HeadMaker::open(folder)?;
        let materials = maker.topology().materials();
        let names = Names {
            directions: maker.directions().map(pointer::c_text).collect(),
            materials: materials.map(pointer::c_text).collect(),
        };
        Ok(AnyfaceHead {
            numbers: vec![0.0; maker.count()],
            names: Arc::new(names),
            maker: Arc::new(maker),
            fit_mm: 0.0,
        })
    }

    /// A head of the same model with other numbers.
    fn other(&self, numbers: Vec<f32>) -> AnyfaceHead {
        AnyfaceHead {
            maker: Arc::clone(&self.maker),
            names: Arc::clone(&self.names),
            numbers,
            fit_mm: 0.0,
        }
    }
}

/// Makes a head from its numbers, or a random head from a seed.
///
/// `weights_dir`: UTF-8, a folder of models that replace the built-in ones, or NULL.
/// `coefficients`: `[coefficient_count]`; NULL with a count of 0 for a random head.
/// `coefficient_count` is 100, which sets all traits to 0, or `N` from
/// `anyface_head_coefficient_count()`. `seed`: of the random head; ignored if there are
/// coefficients. Free with `anyface_head_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another count, numbers that are not finite, and
/// heads far outside those that were learned, and with `ANYFACE_STATUS_WEIGHTS` or
/// `ANYFACE_STATUS_IO` for a folder that cannot be used.
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
        let folder = unsafe { pointer::optional_text("weights_dir", weights_dir) }?;
        let head = AnyfaceHead::open(folder.map(Path::new))?;
        let numbers = if coefficients.is_null() && coefficient_count == 0 {
            head.maker.random(seed)
        } else {
            let numbers =
                unsafe { pointer::slice("coefficients", coefficients, coefficient_count, 1) }?;
            head.maker.checked(numbers.to_vec(), false)?
        };
        Ok(head.other(numbers))
    };
    unsafe { guard::give(out, error, make) }
}

/// Mixes two heads: a `share` of 0 gives `a`, 1 gives `b`. Free with `anyface_head_free()`.
///
/// Both must belong to the same model. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a share
/// outside 0 to 1.
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
        let mixed = a.maker.mixture(&a.numbers, &b.numbers, share)?;
        Ok(a.other(mixed))
    };
    unsafe { guard::give(out, error, make) }
}

/// Copies a head and sets one of its sliders, `direction`, to `value`, -4 to 4; 0 is the average.
/// Free with `anyface_head_free()`.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a value or direction out of range.
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
        let mut moved = head.numbers.clone();
        head.maker.set_along(&mut moved, direction, value)?;
        Ok(head.other(moved))
    };
    unsafe { guard::give(out, error, make) }
}

/// Fits a head to a face at rest, such as a scan or a model. Long: accepts a progress handle, which
/// may be NULL. Free with `anyface_head_free()`.
///
/// `weights_dir`: as in `anyface_head_new()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if the face has fewer than 300 vertices or stays more
/// than 3 mm away from the head on average.
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
                let field = head.maker.head();
                field.fit_scan(points, landmarks, &options, watch)
            })
        }?;
        let mut fitted = head.other(head.maker.checked(fit.coefficients, true)?);
        fitted.fit_mm = fit.mean_mm;
        Ok(fitted)
    };
    unsafe { guard::give(out, error, make) }
}

/// Mean distance between a face and the head that was fitted to it, millimetres on a head of human
/// size; 0 for NULL and heads that were not fitted.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_fit_mm(head: *const AnyfaceHead) -> f32 {
    unsafe { head.as_ref() }.map_or(0.0, |head| head.fit_mm)
}

/// Number `N` of the numbers that describe a head: 100 coefficients and the traits; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_coefficient_count(head: *const AnyfaceHead) -> usize {
    unsafe { head.as_ref() }.map_or(0, |head| head.numbers.len())
}

/// Copies the numbers of a head. `buffer`: `[count]`; `count` must be `N`, or 100 for the
/// coefficients alone.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_copy_coefficients(
    head: *const AnyfaceHead,
    buffer: *mut f32,
    count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let numbers = &unsafe { pointer::handle("head", head) }?.numbers;
        let whole = if count == COEFFICIENTS {
            COEFFICIENTS
        } else {
            numbers.len()
        };
        Ok(&numbers[..whole])
    };
    unsafe { guard::copy(buffer, count, error, values) }
}

/// Number `D` of sliders; 0 for NULL. Traits such as age come first, then the directions in which
/// heads differ, starting with the one that moves the surface furthest.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_direction_count(head: *const AnyfaceHead) -> usize {
    unsafe { head.as_ref() }.map_or(0, |head| head.names.directions.len())
}

/// What a slider changes most, such as "age" or "face width". Lives until the head is freed. NULL
/// for NULL or if `direction` is not below the count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_direction_name(
    head: *const AnyfaceHead,
    direction: usize,
) -> *const c_char {
    pointer::lend(unsafe { head.as_ref() }.and_then(|head| head.names.directions.get(direction)))
}

/// Copies the value of each slider. `buffer`: `[D]`; `count` must be `D`.
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
        Ok(head.maker.along(&head.numbers)?)
    };
    unsafe { guard::copy(buffer, count, error, values) }
}

/// Makes the mesh of a head at rest, metres. Long if `resolution` is not 0: accepts a progress
/// handle, which may be NULL. Free with `anyface_mesh_free()`.
///
/// `resolution`: 0 for clean quads, each cut into two triangles (`anyface_head_copy_faces()` has
/// the quads). Otherwise the number of cells along the longest side of the grid for the surface of
/// the field, such as 128; traits do not change that surface. `parts`: 0 for the skin alone,
/// otherwise also eyes, teeth, tongue, lashes and brows, whose vertices and triangles follow those
/// of the skin. The field has no such parts. `skin_vertices`: receives the number of vertices that
/// are skin; may be NULL. `landmark_vertices`: `[68]`, receives the vertices on which the landmarks
/// lie; may be NULL.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a resolution from 1 to 31 or one that would take
/// more than 1 GiB, and if both `resolution` and `parts` are not 0.
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
        let surface = match resolution {
            0 => head.maker.mesh(&head.numbers, parts != 0)?,
            _ if parts != 0 => {
                return Err(Failure::invalid(format!(
                    "parts: expected 0 with a resolution, as the surface of the field has no eyes and teeth, got {parts}; \
                     a resolution of 0 makes clean quads with them"
                )));
            }
            cells => unsafe {
                watched(progress, |watch| {
                    head.maker.surface(&head.numbers, cells, watch)
                })
            }?,
        };
        let (vertices, skin) = (surface.landmarks.vertices, [surface.skin_vertices()]);
        unsafe {
            pointer::copy_where_asked("landmark_vertices", &vertices, landmark_vertices)?;
            pointer::copy_where_asked("skin_vertices", &skin, skin_vertices)?;
        }
        Ok(AnyfaceMesh(surface.mesh))
    };
    unsafe { guard::give(out, error, make) }
}

/// Number `F` of faces of the clean quads, including the parts; 0 for NULL. The faces of the skin
/// come first.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_face_count(head: *const AnyfaceHead) -> usize {
    unsafe { head.as_ref() }.map_or(0, |head| head.maker.topology().faces().len())
}

/// Number `S` of faces of the skin; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_skin_face_count(head: *const AnyfaceHead) -> usize {
    unsafe { head.as_ref() }.map_or(0, |head| head.maker.topology().uv().len())
}

/// Copies the faces, four vertices each. A triangle has its last vertex twice. `buffer`: `[F, 4]`;
/// `count` must be `4 F`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_copy_faces(
    head: *const AnyfaceHead,
    buffer: *mut u32,
    count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let head = unsafe { pointer::handle("head", head) }?;
        Ok(head.maker.topology().faces().as_flattened())
    };
    unsafe { guard::copy(buffer, count, error, values) }
}

/// Copies the texture coordinates at the corners of the skin's faces: (0, 0) at the lower left to
/// (1, 1). `buffer`: `[S, 4, 2]`; `count` must be `8 S`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_copy_uv(
    head: *const AnyfaceHead,
    buffer: *mut f32,
    count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let head = unsafe { pointer::handle("head", head) }?;
        Ok(head.maker.topology().uv().as_flattened().as_flattened())
    };
    unsafe { guard::copy(buffer, count, error, values) }
}

/// Copies the material number of each face. `buffer`: `[F]`; `count` must be `F`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_copy_face_materials(
    head: *const AnyfaceHead,
    buffer: *mut u32,
    count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let head = unsafe { pointer::handle("head", head) }?;
        Ok(head.maker.topology().face_materials())
    };
    unsafe { guard::copy(buffer, count, error, values) }
}

/// Number `M` of materials; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_material_count(head: *const AnyfaceHead) -> usize {
    unsafe { head.as_ref() }.map_or(0, |head| head.names.materials.len())
}

/// Name of a material, such as "skin" or "lips". Lives until the head is freed. NULL for NULL or if
/// `material` is not below the count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_head_material_name(
    head: *const AnyfaceHead,
    material: usize,
) -> *const c_char {
    pointer::lend(unsafe { head.as_ref() }.and_then(|head| head.names.materials.get(material)))
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

    fn make_head(seed: u64) -> *mut AnyfaceHead {
        let mut head = null_mut();
        let status = unsafe { anyface_head_new(null(), null(), 0, seed, &mut head, null_mut()) };
        assert_eq!(status, AnyfaceStatus::Ok);
        head
    }

    #[test]
    fn a_head_is_mixed_moved_and_made() {
        unsafe {
            let (a, b) = (make_head(1), make_head(2));
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
            let status = anyface_head_mesh(moved, 0, 1, null(), &mut mesh, to.0, to.1, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            assert!(skin < anyface_mesh_vertex_count(mesh));
            assert!(marks.iter().all(|v| (*v as usize) < skin));
            let mut faces = vec![0u32; 4 * anyface_head_face_count(moved)];
            let status =
                anyface_head_copy_faces(moved, faces.as_mut_ptr(), faces.len(), null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            let last = faces.iter().max().map(|v| *v as usize);
            assert_eq!(last, Some(anyface_mesh_vertex_count(mesh) - 1));
            let mut uv = vec![-1.0f32; 8 * anyface_head_skin_face_count(moved)];
            let status = anyface_head_copy_uv(moved, uv.as_mut_ptr(), uv.len(), null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            assert!(uv.iter().all(|x| (0.0..=1.0).contains(x)));
            let mut kinds = vec![0u32; faces.len() / 4];
            let status = anyface_head_copy_face_materials(
                moved,
                kinds.as_mut_ptr(),
                kinds.len(),
                null_mut(),
            );
            assert_eq!(status, AnyfaceStatus::Ok);
            let count = anyface_head_material_count(moved);
            assert!(kinds.iter().all(|kind| (*kind as usize) < count));
            let first = CStr::from_ptr(anyface_head_material_name(moved, kinds[0] as usize));
            assert_eq!(first.to_str(), Ok("skin"));
            let (mut none, mut error) = (null_mut(), null_mut());
            let status = anyface_head_mesh(moved, 40, 1, null(), &mut none, to.0, to.1, &mut error);
            assert_eq!(status, AnyfaceStatus::InvalidInput);
            anyface_error_free(error);
            let status = anyface_head_mesh(moved, 40, 0, null(), &mut none, to.0, to.1, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            assert_eq!(skin, anyface_mesh_vertex_count(none));
            anyface_mesh_free(none);
            anyface_mesh_free(mesh);
            for head in [a, b, mixed, moved] {
                anyface_head_free(head);
            }
        }
    }

    #[test]
    fn coefficients_make_the_same_head_and_wrong_ones_are_told() {
        unsafe {
            let (head, mut again) = (make_head(1), null_mut());
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
