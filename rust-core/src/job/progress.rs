//! Progress and cancellation: one callback, called from the threads that do the work.

use std::sync::atomic::{AtomicBool, Ordering};

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

/// Asks from within loops over many threads whether the job is still wanted, and remembers the
/// answer. Once it is not, such loops skip what is left, and their caller returns the error of
/// [`Watch::check`] instead of the unfinished values.
pub(crate) struct Watch<'a> {
    progress: ProgressFn<'a>,
    at: Progress,
    is_cancelled: AtomicBool,
}

impl<'a> Watch<'a> {
    /// Each question reports `fraction` of `stage`.
    pub fn new(progress: ProgressFn<'a>, stage: &'static str, fraction: f32) -> Watch<'a> {
        Watch {
            progress,
            at: Progress { stage, fraction },
            is_cancelled: AtomicBool::new(false),
        }
    }

    /// Whether the job is still wanted. Loops ask at least every few milliseconds.
    pub fn is_wanted(&self) -> bool {
        if self.is_cancelled.load(Ordering::Relaxed) {
            return false;
        }
        let is_wanted = (self.progress)(self.at);
        if !is_wanted {
            self.is_cancelled.store(true, Ordering::Relaxed);
        }
        is_wanted
    }

    /// # Errors
    /// [`Error::Cancelled`] if the job is not wanted any more.
    pub fn check(&self) -> Result<()> {
        if self.is_wanted() {
            Ok(())
        } else {
            Err(Error::Cancelled)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_that_cancels_once_has_cancelled() {
        let is_first = AtomicBool::new(true);
        let host = |_: Progress| !is_first.swap(false, Ordering::Relaxed);
        let watch = Watch::new(&host, "deform", 0.5);
        assert!(matches!(watch.check(), Err(Error::Cancelled)));
        assert!(host(watch.at) && !watch.is_wanted());
    }
}
