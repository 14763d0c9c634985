//! A mesh with its landmarks and everything that does not depend on time.

use std::io::Write;

use anyface::{
    Engine, Face,
    face::PartList,
    job::write_atomically,
    mesh::{Landmarks, Mouth, ibug::LANDMARKS},
};
use libc::c_char;

use crate::{
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    face_options::{AnyfaceFaceOptions, ROLES, of_mesh},
    guard,
    mesh::AnyfaceMesh,
    pointer,
    progress::AnyfaceProgress,
    status::AnyfaceStatus,
};

/// Everything known of one mesh: its landmarks, how its lips meet, what its parts are, and what moving it
/// needs. Never changes after it was made: any number of threads may use it at the same time.
pub struct AnyfaceFace(pub(crate) Face);

const fn shared_by_threads<T: Send + Sync>() {}
const _: () = shared_by_threads::<AnyfaceFace>();

/// How the lips of a mesh meet.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceMouth {
    /// Apart, with nothing or the mouth's inside between them.
    Open = 0,
    /// Closed, but not joined: they part.
    Slit = 1,
    /// One surface that cannot part.
    Welded = 2,
}

/// Takes or finds the landmarks of a mesh and computes all that does not depend on time. Long:
/// accepts a progress handle; kept in the engine's cache.
///
/// `options` and `progress` may be NULL. The mesh may be freed afterwards. Free with
/// `anyface_face_free()`.
/// Fails with `ANYFACE_STATUS_FACE_NOT_FOUND`, `ANYFACE_STATUS_MESH` for a mesh that cannot be
/// used, `ANYFACE_STATUS_INVALID_INPUT` for unusable landmarks or options,
/// `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_new(
    engine: *const AnyfaceEngine,
    mesh: *const AnyfaceMesh,
    options: *const AnyfaceFaceOptions,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceFace,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("out", out)?;
        let face = unsafe { of_mesh(engine, mesh, options, progress, Engine::prepare) }?;
        unsafe { pointer::give(out, AnyfaceFace(face)) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// The quick part of `anyface_face_new()`, whose result it shares through the engine's cache: where the
/// face is, without what moving it needs. That is computed when the face is first moved.
///
/// Arguments and failures are those of `anyface_face_new()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_find(
    engine: *const AnyfaceEngine,
    mesh: *const AnyfaceMesh,
    options: *const AnyfaceFaceOptions,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceFace,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("out", out)?;
        let face = unsafe { of_mesh(engine, mesh, options, progress, Engine::find) }?;
        unsafe { pointer::give(out, AnyfaceFace(face)) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
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

/// Which eyes are sculpted shut, and so never blink: 0 none, 1 the subject's right one, 2 the left one, 3 both;
/// -1 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_shut_eyes(face: *const AnyfaceFace) -> i32 {
    let code = |face: &AnyfaceFace| {
        let [right, left] = face.0.shut_eyes();
        i32::from(right) + 2 * i32::from(left)
    };
    guard::guard_or(-1, || unsafe { face.as_ref() }.map_or(-1, code))
}

/// Size of the mesh's unit in metres on a head of human size: what makes millimetres of displacements;
/// 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_metres_per_unit(face: *const AnyfaceFace) -> f64 {
    unsafe { face.as_ref() }.map_or(0.0, |face| face.0.metres_per_unit())
}

/// Copies the way from the mesh's frame to the canonical one, in which head and gaze of a motion are given:
/// metres on a head of human size, +x to the subject's left, +y up, +z out of the face, origin between the
/// jaw's hinges.
///
/// `matrix`: `[3, 4]`, rows: `canonical = matrix * (x, y, z, 1)`, a scaled rotation and a shift. `float_count`
/// must be 12. Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
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

/// Number `V` of vertices of its mesh; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_vertex_count(face: *const AnyfaceFace) -> usize {
    unsafe { face.as_ref() }.map_or(0, |face| face.0.mesh.positions.len())
}

/// Copies the 68 landmarks into the caller's buffers, each of which may be NULL.
///
/// `positions`: `[68, 3]`, mesh units and axes, on the surface. `vertices`: `[68]`, the nearest
/// vertex of each. `confidence`: `[68]`, 0 to 1; 1 for landmarks that the caller gave.
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
        unsafe { copy_landmarks(landmarks, positions, vertices, confidence) }
    };
    unsafe { guard::guard(error, work) }
}

/// Number of connected parts of its mesh, seams sewn up; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_part_count(face: *const AnyfaceFace) -> usize {
    unsafe { face.as_ref() }.map_or(0, |face| face.0.parts.parts.len())
}

/// Copies what each part is into the caller's buffers, each of which may be NULL.
///
/// `roles`: one `AnyfacePartRole` for each of `anyface_face_part_count()` parts.
/// `part_of_vertex`: `[V]`, the part of each vertex, `UINT32_MAX` for a vertex in no face.
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
        unsafe { copy_parts(list, roles, part_of_vertex) }
    };
    unsafe { guard::guard(error, work) }
}

/// Writes the landmarks as a JSON file that `anyface animate --landmarks` reads too.
///
/// `path`: UTF-8. Fails with `ANYFACE_STATUS_IO`; then nothing is left of the file.
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

/// Copies the 68 landmarks into buffers, each of which may be NULL.
///
/// # Safety
/// Each buffer is NULL or has room for what it takes.
unsafe fn copy_landmarks(
    landmarks: &Landmarks,
    positions: *mut f32,
    vertices: *mut u32,
    confidence: *mut f32,
) -> Result<(), Failure> {
    if !positions.is_null() {
        let values = landmarks.positions.as_flattened();
        unsafe { pointer::copy_out("positions", values, positions, values.len()) }?;
    }
    if !vertices.is_null() {
        unsafe { pointer::copy_out("vertices", &landmarks.vertices, vertices, LANDMARKS) }?;
    }
    if !confidence.is_null() {
        let values = &landmarks.confidence;
        unsafe { pointer::copy_out("confidence", values, confidence, LANDMARKS) }?;
    }
    Ok(())
}

/// Copies what each part is into buffers, each of which may be NULL.
///
/// # Safety
/// Each buffer is NULL or has room for what it takes.
unsafe fn copy_parts(
    list: &PartList,
    roles: *mut i32,
    part_of_vertex: *mut u32,
) -> Result<(), Failure> {
    if !roles.is_null() {
        let code = |role| ROLES.into_iter().find(|(_, known)| *known == role);
        let parts = list.parts.iter();
        let values: Vec<i32> = parts
            .filter_map(|part| code(part.role).map(|(code, _)| code as i32))
            .collect();
        unsafe { pointer::copy_out("roles", &values, roles, list.parts.len()) }?;
    }
    if !part_of_vertex.is_null() {
        let values = list.of_vertex();
        unsafe { pointer::copy_out("part_of_vertex", values, part_of_vertex, values.len()) }?;
    }
    Ok(())
}
