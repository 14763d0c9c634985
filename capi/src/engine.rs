//! Loaded weights and settings, shared by any number of jobs.

use std::path::PathBuf;

use anyface::{CachePolicy, Engine, EngineOptions};
use libc::c_char;

use crate::{
    error::{AnyfaceError, Failure},
    guard, pointer,
    status::AnyfaceStatus,
    versioned_options::{self, Versioned},
};

/// Loaded weights and settings. Any number of threads may use one engine at the same time.
pub struct AnyfaceEngine(pub(crate) Engine);

const _: () = guard::shared_by_threads::<AnyfaceEngine>();

/// Where results that depend only on the mesh are kept between runs; for `AnyfaceEngineOptions`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceCache {
    /// In the user's cache folder, bounded in size. The default.
    User = 0,
    /// Nothing is read or written.
    Off = 1,
    /// In the folder `cache_dir`.
    Folder = 2,
}

/// Options of an engine; prepare them with `anyface_engine_options_init()`.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct AnyfaceEngineOptions {
    /// Bytes of this struct in the caller's header; set by `anyface_engine_options_init()`.
    pub struct_size: usize,
    /// Folder of model files that replace the built-in ones, UTF-8; NULL for the built-in ones.
    pub weights_dir: *const c_char,
    /// Folder of a HuBERT or wav2vec2 model (`config.json` and `model.safetensors`) that replaces
    /// the built-in speech encoder, UTF-8; `weights_dir` must then hold weights trained with it.
    /// NULL, the default, for the built-in one.
    pub speech_dir: *const c_char,
    /// Folder for `ANYFACE_CACHE_FOLDER`, UTF-8; otherwise NULL.
    pub cache_dir: *const c_char,
    /// One of `AnyfaceCache`; default `ANYFACE_CACHE_USER`.
    pub cache: i32,
    /// Worker threads; 0, the default, for one per core. The result does not depend on this number.
    pub threads: u32,
    /// Name of the system that turns speech into motion, from `anyface_system_name()`, UTF-8; NULL,
    /// the default, for the first.
    pub system: *const c_char,
    /// Folder of a model that replaces the built-in recognition of emotions wherever the emotion is
    /// taken from the voice, UTF-8: Whisper base (`openai/whisper-base`) or an emotion classifier
    /// on HuBERT or wav2vec2 (`config.json` with labels, weights). NULL, the default, for the
    /// built-in one.
    pub emotion_model_dir: *const c_char,
}

unsafe impl Versioned for AnyfaceEngineOptions {
    const NAME: &'static str = "anyface_engine_options";
    const FIRST_SIZE: usize = size_of::<Self>();
    fn defaults() -> Self {
        AnyfaceEngineOptions {
            struct_size: size_of::<Self>(),
            cache: AnyfaceCache::User as i32,
            ..Self::zero()
        }
    }
}

impl AnyfaceEngineOptions {
    /// # Safety
    /// The strings are NULL or NUL-terminated.
    unsafe fn to_library(self) -> Result<EngineOptions, Failure> {
        let models = unsafe { pointer::optional_text("weights_dir", self.weights_dir) }?;
        let speech = unsafe { pointer::optional_text("speech_dir", self.speech_dir) }?;
        let emotion_model = self.emotion_model_dir;
        let emotion_model = unsafe { pointer::optional_text("emotion_model_dir", emotion_model) }?;
        let system = unsafe { pointer::optional_text("system", self.system) }?;
        Ok(EngineOptions {
            system: system.map(str::to_owned),
            emotion_model: emotion_model.map(PathBuf::from),
            models: models.map(PathBuf::from),
            speech: speech.map(PathBuf::from),
            cache: unsafe { self.cache_policy() }?,
            threads: (self.threads > 0).then_some(self.threads as usize),
        })
    }

    unsafe fn cache_policy(&self) -> Result<CachePolicy, Failure> {
        use AnyfaceCache::{Folder, Off, User};
        let known = [User, Off, Folder].map(|cache| (cache as i32, cache));
        Ok(match pointer::one_of("cache", self.cache, known)? {
            User => CachePolicy::UserFolder,
            Off => CachePolicy::Off,
            Folder => {
                let path = unsafe { pointer::path("cache_dir", self.cache_dir) }?;
                CachePolicy::Folder(path.to_owned())
            }
        })
    }
}

/// Sets every option to its default. `struct_size` is `sizeof *options`.
///
/// Fails with `ANYFACE_STATUS_NULL_POINTER`, or `ANYFACE_STATUS_INVALID_INPUT` for a size that no
/// version had.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_engine_options_init(
    options: *mut AnyfaceEngineOptions,
    struct_size: usize,
) -> AnyfaceStatus {
    unsafe { versioned_options::init(options, struct_size) }
}

/// Loads the weights. This takes some tenths of a second, so keep the engine.
///
/// `options` may be NULL for the defaults. Free with `anyface_engine_free()`.
/// Fails with `ANYFACE_STATUS_WEIGHTS` if a model file is missing, truncated or does not fit its
/// config, and with `ANYFACE_STATUS_INVALID_INPUT` for an unknown system or an option out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_engine_new(
    options: *const AnyfaceEngineOptions,
    out: *mut *mut AnyfaceEngine,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let options = unsafe { versioned_options::read(options)?.to_library() }?;
        let engine = Engine::new(options)?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    fn policy(cache: i32, cache_dir: &CStr) -> Result<CachePolicy, Failure> {
        let cache_dir = cache_dir.as_ptr();
        let options = AnyfaceEngineOptions {
            cache,
            cache_dir,
            ..Versioned::defaults()
        };
        unsafe { options.cache_policy() }
    }

    #[test]
    fn cache_numbers_outside_the_list_are_refused() {
        assert_eq!(policy(0, c"x").unwrap(), CachePolicy::UserFolder);
        assert_eq!(policy(1, c"x").unwrap(), CachePolicy::Off);
        assert_eq!(policy(2, c"x").unwrap(), CachePolicy::Folder("x".into()));
        assert!(policy(2, c"").is_err() && policy(3, c"x").is_err() && policy(-1, c"x").is_err());
    }

    #[test]
    fn no_threads_means_one_for_each_core() {
        let options: AnyfaceEngineOptions = Versioned::defaults();
        let library = unsafe { options.to_library() }.unwrap();
        assert_eq!(library, EngineOptions::default());
    }
}
