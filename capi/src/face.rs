//! A mesh with its landmarks and everything that does not depend on time.

use std::io::Write;

use anyface::{
    Engine, Face, Result,
    face::{FaceOptions, Lids},
    job::{ProgressFn, write_atomically},
    mesh::{Mesh, Mouth},
};
use libc::c_char;

use crate::{
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    face_request::ROLES,
    guard,
    mesh::AnyfaceMesh,
    pointer,
    progress::{AnyfaceProgress, watched},
    request::AnyfaceRequest,
    status::AnyfaceStatus,
};

/// Everything known about one mesh: its landmarks, how its lips meet, what its parts are, and the
/// data needed to move it. It never changes once it is made: any number of threads may use it at
/// the same time.
pub struct AnyfaceFace(pub(crate) Face);

const _: () = guard::shared_by_threads::<AnyfaceFace>();

/// Runs `make` on a caller's mesh and reports to the caller's progress handle.
///
/// # Safety
/// Every pointer is NULL or valid.
pub(crate) unsafe fn of_mesh<T>(
    engine: *const AnyfaceEngine,
    mesh: *const AnyfaceMesh,
    request: *const AnyfaceRequest,
    progress: *const AnyfaceProgress,
    make: impl FnOnce(&Engine, &Mesh, &FaceOptions, ProgressFn<'_>) -> Result<T>,
) -> std::result::Result<T, Failure> {
    let engine = unsafe { pointer::handle("engine", engine) }?;
    let mesh = unsafe { pointer::handle("mesh", mesh) }?;
    let options = unsafe { AnyfaceRequest::face(request) }?;
    unsafe { watched(progress, |watch| make(&engine.0, &mesh.0, &options, watch)) }
}

/// How the lips of a mesh meet.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceMouth {
    /// They are apart, with nothing or the inside of the mouth between them.
    Open = 0,
    /// They are closed but not joined, so they can part.
    Slit = 1,
    /// They are one surface and cannot part.
    Welded = 2,
}

/// What the lids of an eye can do.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceLids {
    /// They close.
    Close = 0,
    /// They are sculpted shut and do not move.
    Shut = 1,
    /// They form one surface with the eye, without a slit between, and do not move.
    Joined = 2,
}

/// Takes or finds the landmarks of a mesh and computes everything that does not depend on time.
/// Long: accepts a progress handle. The engine's cache keeps the result.
///
/// `request` and `progress` may be NULL. A face reads of a request its controls of the stage "face",
/// such as "learned", and:
/// - "forward" and "up", texts: the axis out of the face and the axis to the top of the head, "+x"
///   to "-z"; without them "+z" and "+y", as in OBJ and glTF. Blender has "-y" and "+z".
/// - "landmarks", 68 rows of x, y, z in mesh units and axes, in the order of iBUG 300-W; or the text
///   of a landmark file as `anyface_face_write_landmarks()` writes it. Each landmark moves to the
///   nearest suitable place on the surface, unless it lies at its vertex in "landmark_vertices".
/// - "landmark_vertices", 68 rows of a vertex number. Together with positions, a point that lies
///   exactly at its vertex stays on that vertex. Points of `anyface_opened_face_copy_landmarks()`
///   need this where rims touch. Without these and "landmarks" the library finds the face.
/// - "fixed_landmarks", rows of a landmark's number, 0 to 67, and x, y, z: it stays there, while the
///   others adapt; it moves onto the surface.
/// - "part_roles", rows of the number of a part, as in `anyface_face_copy_parts()`, and its
///   `AnyfacePartRole`. The library recognises all other parts by their shape and place.
/// - "object_of_vertex", `V` rows of a number: which object each vertex belongs to, for a mesh that
///   was joined from several objects (a face, its teeth, its lashes); -1 for none.
/// - "object_roles", a row for each object: the `AnyfacePartRole` of all its parts, or -1 if the
///   library shall recognise them. "part_roles" take precedence.
///
/// The mesh may be freed afterwards. Free with `anyface_face_free()`.
/// Fails with `ANYFACE_STATUS_FACE_NOT_FOUND`, `ANYFACE_STATUS_MESH` for a mesh that cannot be
/// used, `ANYFACE_STATUS_INVALID_INPUT` for unusable landmarks or parts,
/// `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_new(
    engine: *const AnyfaceEngine,
    mesh: *const AnyfaceMesh,
    request: *const AnyfaceRequest,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceFace,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let face = unsafe { of_mesh(engine, mesh, request, progress, Engine::prepare) }?;
        Ok(AnyfaceFace(face))
    };
    unsafe { guard::give(out, error, make) }
}

/// The quick part of `anyface_face_new()`: finds the face but does not compute the data needed to
/// move it. That happens when the face is first moved. Both functions share results through the
/// engine's cache.
///
/// Arguments and failures are those of `anyface_face_new()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_find(
    engine: *const AnyfaceEngine,
    mesh: *const AnyfaceMesh,
    request: *const AnyfaceRequest,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceFace,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let face = unsafe { of_mesh(engine, mesh, request, progress, Engine::find) }?;
        Ok(AnyfaceFace(face))
    };
    unsafe { guard::give(out, error, make) }
}

/// How the lips meet, an `AnyfaceMouth`; -1 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_mouth(face: *const AnyfaceFace) -> i32 {
    let code = |face: &AnyfaceFace| match face.0.mouth() {
        Mouth::Open => AnyfaceMouth::Open as i32,
        Mouth::Slit => AnyfaceMouth::Slit as i32,
        Mouth::Welded => AnyfaceMouth::Welded as i32,
    };
    guard::guard_or(-1, || unsafe { face.as_ref() }.map_or(-1, code))
}

/// What the lids of an eye can do, an `AnyfaceLids`; -1 for NULL. `side`: 0 for the subject's right
/// eye, anything else for the left one. If the lids cannot move, a blink lowers the brow instead.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_lids(face: *const AnyfaceFace, side: i32) -> i32 {
    let code = |face: &AnyfaceFace| match face.0.lids()[usize::from(side != 0)] {
        Lids::Close => AnyfaceLids::Close as i32,
        Lids::Shut => AnyfaceLids::Shut as i32,
        Lids::Joined => AnyfaceLids::Joined as i32,
    };
    guard::guard_or(-1, || unsafe { face.as_ref() }.map_or(-1, code))
}

/// Length of the mesh's unit in metres if the head had human size; converts displacements to
/// millimetres. 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_metres_per_unit(face: *const AnyfaceFace) -> f64 {
    unsafe { face.as_ref() }.map_or(0.0, |face| face.0.metres_per_unit())
}

/// Copies the transform from the mesh's frame to the canonical one, in which head and gaze of a
/// motion are given: metres on a head of human size, +x to the subject's left, +y up, +z out of the
/// face, origin between the jaw's hinges.
///
/// `matrix`: `[3, 4]`, row by row: `canonical = matrix * (x, y, z, 1)`, a scaled rotation and a
/// translation. `float_count` must be 12.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_copy_to_canonical(
    face: *const AnyfaceFace,
    matrix: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let way = unsafe { pointer::handle("face", face) }?.0.to_canonical;
        let row = |i: usize| {
            let [x, y, z] = way.rotation[i].map(|cosine| (way.scale * cosine) as f32);
            [x, y, z, way.translation[i] as f32]
        };
        let values = [row(0), row(1), row(2)];
        unsafe { pointer::copy_out("matrix", values.as_flattened(), matrix, float_count) }
    };
    unsafe { guard::guard(error, work) }
}

/// Number `V` of vertices of the face's mesh; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_vertex_count(face: *const AnyfaceFace) -> usize {
    unsafe { face.as_ref() }.map_or(0, |face| face.0.mesh.positions.len())
}

/// Copies the 68 landmarks into the caller's buffers, each of which may be NULL.
///
/// `positions`: `[68, 3]`, mesh units and axes, on the surface. `vertices`: `[68]`, the nearest
/// vertex of each. `confidence`: `[68]`, 0 to 1; 1 for landmarks from the caller.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `face` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_copy_landmarks(
    face: *const AnyfaceFace,
    positions: *mut f32,
    vertices: *mut u32,
    confidence: *mut f32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let landmarks = &unsafe { pointer::handle("face", face) }?.0.landmarks;
        let places = landmarks.positions.as_flattened();
        unsafe {
            pointer::copy_where_asked("positions", places, positions)?;
            pointer::copy_where_asked("vertices", &landmarks.vertices, vertices)?;
            pointer::copy_where_asked("confidence", &landmarks.confidence, confidence)
        }
    };
    unsafe { guard::guard(error, work) }
}

/// Number of connected parts of the face's mesh, after seams are joined; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_part_count(face: *const AnyfaceFace) -> usize {
    unsafe { face.as_ref() }.map_or(0, |face| face.0.parts.parts.len())
}

/// Copies the role of each part into the caller's buffers, each of which may be NULL.
///
/// `roles`: one `AnyfacePartRole` for each of `anyface_face_part_count()` parts.
/// `part_of_vertex`: `[V]`, the part of each vertex, `UINT32_MAX` for a vertex in no triangle.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `face` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_copy_parts(
    face: *const AnyfaceFace,
    roles: *mut i32,
    part_of_vertex: *mut u32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let list = &unsafe { pointer::handle("face", face) }?.0.parts;
        let code = |role| ROLES.into_iter().find(|(_, known)| *known == role);
        let codes = list.parts.iter().filter_map(|part| code(part.role));
        let codes: Vec<i32> = codes.map(|(code, _)| code as i32).collect();
        unsafe {
            pointer::copy_where_asked("roles", &codes, roles)?;
            pointer::copy_where_asked("part_of_vertex", list.of_vertex(), part_of_vertex)
        }
    };
    unsafe { guard::guard(error, work) }
}

/// Writes the landmarks to a JSON file, which `anyface animate --landmarks` can read too.
///
/// `path`: UTF-8. Fails with `ANYFACE_STATUS_IO`; no unfinished file is left.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_write_landmarks(
    face: *const AnyfaceFace,
    path: *const c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let face = unsafe { pointer::handle("face", face) }?;
        let path = unsafe { pointer::path("path", path) }?;
        let json = face.0.landmarks.to_json();
        write_atomically(path, |file| file.write_all(json.as_bytes()))?;
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Frees a face that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_free(face: *mut AnyfaceFace) {
    unsafe { guard::free(face) }
}
