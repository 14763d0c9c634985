//! Performers: one person's own mouth, learned from a few seconds of that person's face.

use std::path::PathBuf;

use libc::c_char;

use crate::{
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    guard, pointer,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// Learns how a person speaks from sounds and the motion of that person's face, fifteen seconds or more in
/// all, and writes a file for the field "performer" of a request. Long: accepts a progress handle.
///
/// `takes`: UTF-8, a JSON list of pairs of files, `[["a.wav", "a.csv"]]`: sounds and motions that begin with
/// them, each a .csv of Live Link Face, or an .npz of landmarks or weights. `path`: UTF-8, the file to write. It is
/// a safetensors file with a card in its metadata: how well the performer follows the person, with and
/// without. `progress` may be NULL.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a system without performers, for takes that are too short,
/// whose face is still, says something else or drifts against its sound, and if the result would follow the
/// person no better than the system does; with `ANYFACE_STATUS_AUDIO` for a sound that cannot be used, and with
/// `ANYFACE_STATUS_IO` if a file cannot be read or written. Then no file is left behind.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_performer_learn(
    engine: *const AnyfaceEngine,
    takes: *const c_char,
    progress: *const AnyfaceProgress,
    path: *const c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let engine = &unsafe { pointer::handle("engine", engine) }?.0;
        let path = unsafe { pointer::path("path", path) }?;
        let files: Vec<(PathBuf, PathBuf)> =
            serde_json::from_str(unsafe { pointer::text("takes", takes) }?).map_err(|e| {
                Failure::invalid(format!(
                    "takes: expected pairs of files as JSON, such as [[\"a.wav\", \"a.csv\"]]: {e}"
                ))
            })?;
        let takes = files
            .iter()
            .map(|(sound, motion)| engine.captured_take(sound, motion));
        let takes = takes.collect::<anyface::Result<Vec<_>>>()?;
        let learned = unsafe { watched(progress, |watch| engine.learn_performer(&takes, watch)) }?;
        Ok(learned.write(path)?)
    };
    unsafe { guard::guard(error, work) }
}
