//! Progress and cancellation: one callback, called from the threads that do the work.

use crate::{Error, Result};

/// A step of a job and how much of that step is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Name of the stage, such as "landmarks", "speech", "motion", "operators", "weights",
    /// "deform", "compress", "sliders", "curves", "write".
    pub stage: &'static str,
    /// Share of the stage that is done, 0 to 1.
    pub fraction: f32,
}

/// Receives progress; returning `false` asks the job to stop with [`Error::Cancelled`].
pub type ProgressFn<'a> = &'a (dyn Fn(Progress) -> bool + Sync);

/// A callback that ignores progress and never cancels.
pub const SILENT: ProgressFn<'static> = &|_| true;

/// Reports `fraction` of `stage`.
///
/// # Errors
/// [`Error::Cancelled`] if the callback returns `false`.
pub fn report(progress: ProgressFn<'_>, stage: &'static str, fraction: f32) -> Result<()> {
    if progress(Progress { stage, fraction }) {
        Ok(())
    } else {
        Err(Error::Cancelled)
    }
}
