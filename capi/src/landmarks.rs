//! Where the face of a mesh is, without what animating it needs.

use anyface::{FoundFace, mesh::Mouth};

use crate::{
    engine::AnyfaceEngine,
    error::AnyfaceError,
    face::AnyfaceFaceOptions,
    growing, guard, known,
    mesh::AnyfaceMesh,
    pointer,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// The landmarks of a mesh, how its lips meet and what its parts are. Never changes after it was
/// made: any number of threads may use it at the same time.
pub struct AnyfaceLandmarks(FoundFace);

const fn shared_by_threads<T: Send + Sync>() {}
const _: () = shared_by_threads::<AnyfaceLandmarks>();

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

/// Takes or finds the landmarks of a mesh: the quick part of `anyface_face_new()`, whose result it
/// shares through the engine's cache.
///
/// `options` and `progress` may be NULL. The mesh may be freed afterwards. Free with
/// `anyface_landmarks_free()`.
/// Fails as `anyface_face_new()` does.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_landmarks_new(
    engine: *const AnyfaceEngine,
    mesh: *const AnyfaceMesh,
    options: *const AnyfaceFaceOptions,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceLandmarks,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("out", out)?;
        let engine = unsafe { pointer::handle("engine", engine) }?;
        let mesh = unsafe { pointer::handle("mesh", mesh) }?;
        let options = unsafe { growing::read(options)?.to_library() }?;
        let found = unsafe { watched(progress, |watch| engine.0.find(&mesh.0, &options, watch)) }?;
        unsafe { pointer::give(out, AnyfaceLandmarks(found)) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Copies the 68 landmarks into the caller's buffers, each of which may be NULL.
///
/// `positions`: `[68, 3]`, mesh units and axes, on the surface. `vertices`: `[68]`, the nearest
/// vertex of each. `confidence`: `[68]`, 0 to 1; 1 for landmarks that the caller gave or fixed.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `landmarks` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_landmarks_copy(
    landmarks: *const AnyfaceLandmarks,
    positions: *mut f32,
    vertices: *mut u32,
    confidence: *mut f32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let found = &unsafe { pointer::handle("landmarks", landmarks) }?
            .0
            .landmarks;
        unsafe { known::copy_landmarks(found, positions, vertices, confidence) }
    };
    unsafe { guard::guard(error, work) }
}

/// How the lips meet, an `AnyfaceMouth`; -1 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_landmarks_mouth(landmarks: *const AnyfaceLandmarks) -> i32 {
    let code = |found: &AnyfaceLandmarks| match found.0.mouth {
        Mouth::Open => AnyfaceMouth::Open as i32,
        Mouth::Slit => AnyfaceMouth::Slit as i32,
        Mouth::Welded => AnyfaceMouth::Welded as i32,
    };
    unsafe { landmarks.as_ref() }.map_or(-1, code)
}

/// Number of connected parts of the mesh, seams sewn up; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_landmarks_part_count(landmarks: *const AnyfaceLandmarks) -> usize {
    unsafe { landmarks.as_ref() }.map_or(0, |found| found.0.parts.parts.len())
}

/// Copies what each part is into the caller's buffers, each of which may be NULL.
///
/// `roles`: one `AnyfacePartRole` for each of `anyface_landmarks_part_count()` parts.
/// `part_of_vertex`: `[V]`, the part of each vertex, `UINT32_MAX` for a vertex in no face.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `landmarks` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_landmarks_copy_parts(
    landmarks: *const AnyfaceLandmarks,
    roles: *mut i32,
    part_of_vertex: *mut u32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let list = &unsafe { pointer::handle("landmarks", landmarks) }?.0.parts;
        unsafe { known::copy_parts(list, roles, part_of_vertex) }
    };
    unsafe { guard::guard(error, work) }
}

/// Frees landmarks that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_landmarks_free(landmarks: *mut AnyfaceLandmarks) {
    unsafe { guard::free(landmarks) }
}
