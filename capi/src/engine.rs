//! Loaded weights and settings, shared by any number of jobs.

use anyface::Engine;

use crate::{error::AnyfaceError, guard, request::AnyfaceRequest, status::AnyfaceStatus};

/// Loaded weights and settings. Any number of threads may use one engine at the same time.
pub struct AnyfaceEngine(pub(crate) Engine);

const _: () = guard::shared_by_threads::<AnyfaceEngine>();

/// Loads the weights. This takes some tenths of a second, so keep the engine.
///
/// `request` may be NULL. An engine reads of it:
/// - "system", a text: the name of the system that turns speech into motion; without it the first
///   of `anyface_describe()`.
/// - "weights_dir", a text: a folder of model files that replace the built-in ones.
/// - "speech_dir", a text: a folder of a HuBERT or wav2vec2 model (`config.json` and
///   `model.safetensors`) that replaces the built-in speech encoder. "weights_dir" must then hold
///   weights that were trained with it.
/// - "cache", a text: a folder for results that depend only on a mesh, or "off". Without it they
///   are kept in the user's cache folder, bounded in size.
/// - "threads", a number: worker threads; 0, the default, for one per core. The result does not
///   depend on it.
///
/// Free with `anyface_engine_free()`.
/// Fails with `ANYFACE_STATUS_WEIGHTS` if a model file is missing, truncated or does not fit its
/// config, and with `ANYFACE_STATUS_INVALID_INPUT` for an unknown system.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_engine_new(
    request: *const AnyfaceRequest,
    out: *mut *mut AnyfaceEngine,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let engine = Engine::new(unsafe { AnyfaceRequest::engine(request) })?;
        Ok(AnyfaceEngine(engine))
    };
    unsafe { guard::give(out, error, make) }
}

/// Estimates the peak memory that motion on a mesh needs, bytes, before the work starts. The
/// estimate is within 40 % of the measured values. 0 for NULL.
///
/// `frames_at_once`: frames in memory at once: all of them for `anyface_clip_new()`, two blocks for
/// `anyface_clip_stream()`. `sound_s`: length of the sound for `anyface_motion_new()`, seconds.
/// `anyface_face_new()` and `anyface_clip_new()` fail with `ANYFACE_STATUS_OUT_OF_MEMORY` if the
/// work certainly does not fit into memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_engine_memory_needed(
    engine: *const AnyfaceEngine,
    vertex_count: usize,
    frames_at_once: usize,
    sound_s: f64,
) -> u64 {
    let need = |engine: &AnyfaceEngine| {
        let sound_s = sound_s.max(0.0);
        let need = engine.0.memory_need(vertex_count, frames_at_once, sound_s);
        need.bytes()
    };
    guard::guard_or(0, || unsafe { engine.as_ref() }.map_or(0, need))
}

/// Memory that this process may still take, bytes; `UINT64_MAX` if the operating system does not
/// say.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_memory_left() -> u64 {
    guard::guard_or(u64::MAX, || {
        anyface::job::memory::available().unwrap_or(u64::MAX)
    })
}

/// Frees an engine that no running call uses; nothing happens for NULL.
///
/// Faces, motions and clips that were made with it stay valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_engine_free(engine: *mut AnyfaceEngine) {
    unsafe { guard::free(engine) }
}
