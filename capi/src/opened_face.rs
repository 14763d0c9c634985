//! Cuts apart lips, or lids and eyes, that are one surface.

use anyface::{Engine, Face, Result, face::OpenedFace, job::ProgressFn};

use crate::{
    engine::AnyfaceEngine,
    error::AnyfaceError,
    face::AnyfaceFace,
    guard,
    mesh::AnyfaceMesh,
    pointer,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// A mesh whose lips or lids were one surface and can part now, and the source of each of its
/// pieces. It never changes once it is made: any number of threads may use it at the same time.
///
/// Old vertices keep their numbers and positions; new ones follow. Old triangles keep their order,
/// and pieces replace those that were cut. The surface that was sewn behind the cut follows.
pub struct AnyfaceOpenedFace(OpenedFace);

const _: () = guard::shared_by_threads::<AnyfaceOpenedFace>();

/// Parts the lips of a face along the valley between them and sews the inside of a mouth behind
/// them. At rest the surface stays the same. As a trial, the jaw of the result drops once by 20 mm:
/// the lips have to part smoothly and equally on both sides. Long: accepts a progress handle,
/// which may be NULL.
///
/// Call it if `anyface_face_mouth()` gives `ANYFACE_MOUTH_WELDED`.
/// Free with `anyface_opened_face_free()`. Prepare the new mesh like any other, with the landmarks
/// of `anyface_opened_face_copy_landmarks()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if the lips part already or the landmarks name no mouth,
/// with `ANYFACE_STATUS_MESH` if no line leads from corner to corner between the lips or if they do
/// not part well, and with `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_open_mouth(
    engine: *const AnyfaceEngine,
    face: *const AnyfaceFace,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceOpenedFace,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    unsafe { opened(Engine::open_mouth, (engine, face), progress, (out, error)) }
}

/// Cuts free the eyes of a face that are one surface with their lids. The lids get a lining, and
/// the eyes become the fronts of balls. At rest the surface stays the same. As a trial, the result
/// blinks once: the lids have to cover the whole eye. Long: accepts a progress handle, which
/// may be NULL.
///
/// Call it if `anyface_face_lids()` gives `ANYFACE_LIDS_JOINED`.
/// Free with `anyface_opened_face_free()`. Prepare the new mesh like any other, with the landmarks
/// of `anyface_opened_face_copy_landmarks()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if no eye is one surface with its lids, with
/// `ANYFACE_STATUS_MESH` if no line leads around an eye or if its lids do not shut well, and with
/// `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_open_eyes(
    engine: *const AnyfaceEngine,
    face: *const AnyfaceFace,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceOpenedFace,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    unsafe { opened(Engine::open_eyes, (engine, face), progress, (out, error)) }
}

/// Opens the mouth or the eyes of a face, as `open` does.
unsafe fn opened(
    open: impl FnOnce(&Engine, &Face, ProgressFn<'_>) -> Result<OpenedFace>,
    (engine, face): (*const AnyfaceEngine, *const AnyfaceFace),
    progress: *const AnyfaceProgress,
    (out, error): (*mut *mut AnyfaceOpenedFace, *mut *mut AnyfaceError),
) -> AnyfaceStatus {
    let make = || {
        let engine = &unsafe { pointer::handle("engine", engine) }?.0;
        let face = &unsafe { pointer::handle("face", face) }?.0;
        let opened = unsafe { watched(progress, |watch| open(engine, face, watch)) }?;
        Ok(AnyfaceOpenedFace(opened))
    };
    unsafe { guard::give(out, error, make) }
}

/// Copies the new mesh: `V` vertices and `F` triangles. Free the copy with `anyface_mesh_free()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_opened_face_mesh(
    opened: *const AnyfaceOpenedFace,
    out: *mut *mut AnyfaceMesh,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let mesh = unsafe { pointer::handle("opened", opened) }?.0.mesh.clone();
        Ok(AnyfaceMesh(mesh))
    };
    unsafe { guard::give(out, error, make) }
}

/// Number of the first lining triangle; 0 for NULL.
///
/// Triangles from this one up to `anyface_opened_face_first_inside_triangle()` lie behind the cut
/// and have the colour of the surface in front of them: inner sides of lips and lids, and the rest
/// of eyeballs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_opened_face_first_lining_triangle(
    opened: *const AnyfaceOpenedFace,
) -> usize {
    unsafe { opened.as_ref() }.map_or(0, |opened| opened.0.first_lining_triangle)
}

/// Number of the first triangle of the inside of the mouth behind the lips. `F` if eyes were
/// opened; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_opened_face_first_inside_triangle(
    opened: *const AnyfaceOpenedFace,
) -> usize {
    unsafe { opened.as_ref() }.map_or(0, |opened| opened.0.first_inside_triangle)
}

/// Copies the old vertices that each vertex is a mixture of, for vertex groups and shape keys.
/// Vertices behind the cut take the mixture of the rim in front of them.
///
/// `vertices`: `[V, 3]`, numbers of old vertices. `shares`: `[V, 3]`, their shares, sum 1. `count`
/// must be `V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_opened_face_copy_vertex_sources(
    opened: *const AnyfaceOpenedFace,
    vertices: *mut u32,
    shares: *mut f32,
    count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let sources = &unsafe { pointer::handle("opened", opened) }?
            .0
            .vertex_sources;
        let all = || sources.as_flattened().iter();
        let numbers: Vec<u32> = all().map(|(vertex, _)| *vertex).collect();
        let weights: Vec<f32> = all().map(|(_, share)| *share).collect();
        pointer::check_room("shares", shares, count, 1)?;
        unsafe { pointer::copy_out("vertices", &numbers, vertices, count) }?;
        unsafe { pointer::copy_out("shares", &weights, shares, count) }
    };
    unsafe { guard::guard(error, work) }
}

/// Copies the old triangle that each triangle was cut from, for materials, and where its corners
/// lie in that old triangle, for texture coordinates and normals.
///
/// `triangles`: `[F]`, numbers of old triangles. `shares`: `[F, 3, 3]`, for each corner the shares
/// of the old triangle's three corners, sum 1. `triangle_count` must be `F`, and `share_count` must
/// be `F * 9`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for other counts.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_opened_face_copy_triangle_sources(
    opened: *const AnyfaceOpenedFace,
    triangles: *mut u32,
    triangle_count: usize,
    shares: *mut f32,
    share_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let sources = &unsafe { pointer::handle("opened", opened) }?
            .0
            .triangle_sources;
        let numbers: Vec<u32> = sources.iter().map(|source| source.triangle).collect();
        let weights = sources.iter().flat_map(|source| source.corners).flatten();
        let weights: Vec<f32> = weights.collect();
        pointer::check_room("shares", shares, share_count, 1)?;
        unsafe { pointer::copy_out("triangles", &numbers, triangles, triangle_count) }?;
        unsafe { pointer::copy_out("shares", &weights, shares, share_count) }
    };
    unsafe { guard::guard(error, work) }
}

/// Copies the landmarks of the new mesh. Those of the inner lips, or of the lids, lie on their own
/// rim.
///
/// `positions`: `[68, 3]`, mesh units. `vertices`: `[68]`, numbers of the nearest vertices.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_opened_face_copy_landmarks(
    opened: *const AnyfaceOpenedFace,
    positions: *mut f32,
    vertices: *mut u32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let landmarks = &unsafe { pointer::handle("opened", opened) }?.0.landmarks;
        let places = landmarks.positions.as_flattened();
        let numbers = &landmarks.vertices;
        pointer::check_room("vertices", vertices, numbers.len(), 1)?;
        unsafe { pointer::copy_out("positions", places, positions, places.len()) }?;
        unsafe { pointer::copy_out("vertices", numbers, vertices, numbers.len()) }
    };
    unsafe { guard::guard(error, work) }
}

/// Frees an opened face that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_opened_face_free(opened: *mut AnyfaceOpenedFace) {
    unsafe { guard::free(opened) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{anyface_error_free, anyface_error_status};
    use anyface::{
        face::TriangleSource,
        mesh::{Landmarks, Mesh},
    };
    use std::ptr::{null, null_mut};

    /// Two triangles that were cut from one old triangle.
    fn example() -> AnyfaceOpenedFace {
        let source = |corners| TriangleSource {
            triangle: 0,
            corners,
        };
        let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        AnyfaceOpenedFace(OpenedFace {
            mesh: Mesh {
                positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.0]],
                triangles: vec![[0, 1, 3], [0, 3, 2]],
            },
            landmarks: Landmarks {
                positions: [[0.25; 3]; 68],
                vertices: [0; 68],
                confidence: [1.0; 68],
            },
            vertex_sources: vec![
                [(0, 1.0), (0, 0.0), (0, 0.0)],
                [(1, 1.0), (1, 0.0), (1, 0.0)],
                [(2, 1.0), (2, 0.0), (2, 0.0)],
                [(1, 0.5), (2, 0.5), (1, 0.0)],
            ],
            triangle_sources: vec![
                source([corners[0], corners[1], [0.0, 0.5, 0.5]]),
                source(corners),
            ],
            first_inside_vertex: 4,
            first_lining_triangle: 2,
            first_inside_triangle: 2,
            upper_rim: vec![0, 3],
            lower_rim: vec![0, 3],
        })
    }

    #[test]
    fn sources_and_landmarks_are_copied() {
        let (opened, mut error) = (example(), null_mut());
        let (mut numbers, mut shares) = (vec![0u32; 12], vec![0.0f32; 18]);
        unsafe {
            let n = numbers.as_mut_ptr();
            let status = anyface_opened_face_copy_vertex_sources(
                &opened,
                n,
                shares.as_mut_ptr(),
                12,
                &mut error,
            );
            assert_eq!(status, AnyfaceStatus::Ok);
            assert_eq!((numbers[9..].to_vec(), shares[9]), (vec![1, 2, 1], 0.5));
            let status = anyface_opened_face_copy_triangle_sources(
                &opened,
                n,
                2,
                shares.as_mut_ptr(),
                18,
                &mut error,
            );
            assert_eq!(status, AnyfaceStatus::Ok);
            assert_eq!((numbers[1], shares[8], shares[17]), (0, 0.5, 1.0));
            let (mut places, mut nearest) = (vec![0.0f32; 204], vec![9u32; 68]);
            let (p, v): (*mut f32, *mut u32) = (places.as_mut_ptr(), null_mut());
            let status = anyface_opened_face_copy_landmarks(&opened, p, v, &mut error);
            assert_eq!(status, AnyfaceStatus::NullPointer);
            anyface_error_free(error);
            let v = nearest.as_mut_ptr();
            let status = anyface_opened_face_copy_landmarks(&opened, p, v, null_mut());
            assert_eq!(
                (status, places[203], nearest[67]),
                (AnyfaceStatus::Ok, 0.25, 0)
            );
            assert_eq!(anyface_opened_face_first_inside_triangle(null()), 0);
        }
    }

    #[test]
    fn wrong_sizes_are_refused() {
        let (opened, mut error) = (example(), null_mut());
        let (mut numbers, mut shares) = ([0u32; 12], [0.0f32; 12]);
        unsafe {
            let (to, of) = (numbers.as_mut_ptr(), shares.as_mut_ptr());
            let status = anyface_opened_face_copy_vertex_sources(&opened, to, of, 3, &mut error);
            assert_eq!(status, AnyfaceStatus::InvalidInput);
            assert_eq!(anyface_error_status(error), AnyfaceStatus::InvalidInput);
            anyface_error_free(error);
        }
    }
}
