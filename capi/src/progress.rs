//! Progress and cancellation, by callback or by polling from another thread.

use std::{
    ffi::CString,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
};

use anyface::job::Progress;
use libc::{c_char, c_int, c_void};

use crate::{error::Failure, guard, pointer, status::AnyfaceStatus};

/// Receives progress. Any result other than 0 asks the job to stop.
///
/// `stage`: "speech", "motion", "landmarks", "operators", "weights", "deform", "compress" or
/// another name. It lives as long as the progress handle. `fraction`: how much of that stage is
/// done, 0 to 1. The library calls it from a thread that may differ from the one that started the
/// job, and from call to call. Calls for one handle never overlap. It must not throw or longjmp,
/// and must not start a job with the same handle.
pub type AnyfaceProgressFn =
    Option<unsafe extern "C" fn(user: *mut c_void, stage: *const c_char, fraction: f32) -> c_int>;

/// Watches and stops jobs.
///
/// Pass the handle to a long call. Any other thread can then read and cancel it while the call
/// runs. One handle may serve several calls one after the other. Once cancelled, it stays
/// cancelled.
pub struct AnyfaceProgress {
    callback: AnyfaceProgressFn,
    user: *mut c_void,
    /// Stage number in the upper half, bits of the fraction in the lower half, so that both are
    /// read at once.
    state: AtomicU64,
    cancelled: AtomicBool,
    /// Every stage seen so far. Number 0 is "", for a job that has not begun.
    stages: Mutex<Vec<(&'static str, CString)>>,
    /// Held during the callback, so that calls never overlap.
    calling: Mutex<()>,
}

// The header says that the library's threads use `user` and `callback`. The caller vouches that
// this is safe.
unsafe impl Send for AnyfaceProgress {}
unsafe impl Sync for AnyfaceProgress {}

impl AnyfaceProgress {
    fn new(callback: AnyfaceProgressFn, user: *mut c_void) -> Self {
        AnyfaceProgress {
            callback,
            user,
            state: AtomicU64::new(0),
            cancelled: AtomicBool::new(false),
            stages: Mutex::new(vec![("", CString::default())]),
            calling: Mutex::new(()),
        }
    }

    /// Takes a progress report of the library. Returns `false` to ask it to stop.
    fn report(&self, progress: Progress) -> bool {
        if self.cancelled.load(Ordering::Relaxed) {
            return false;
        }
        let (number, stage) = self.intern(progress.stage);
        let state = number << 32 | u64::from(progress.fraction.to_bits());
        self.state.store(state, Ordering::Relaxed);
        let Some(callback) = self.callback else {
            return true;
        };
        let alone = lock(&self.calling);
        let stop = unsafe { callback(self.user, stage, progress.fraction) } != 0;
        drop(alone);
        if stop {
            self.cancelled.store(true, Ordering::Relaxed);
        }
        !stop
    }

    /// Number and C string of a stage. The string stays in place until the handle is freed.
    fn intern(&self, name: &'static str) -> (u64, *const c_char) {
        let mut stages = lock(&self.stages);
        let known = stages.iter().position(|(stage, _)| *stage == name);
        let number = known.unwrap_or_else(|| {
            stages.push((name, CString::new(name).unwrap_or_default()));
            stages.len() - 1
        });
        (number as u64, stages[number].1.as_ptr())
    }

    fn read(&self) -> (*const c_char, f32) {
        let state = self.state.load(Ordering::Relaxed);
        let stages = lock(&self.stages);
        (
            stages[(state >> 32) as usize].1.as_ptr(),
            f32::from_bits(state as u32),
        )
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs a job of the library with the caller's progress handle. NULL means that nobody watches it.
///
/// # Safety
/// `progress` is NULL or a live handle.
pub(crate) unsafe fn watched<T>(
    progress: *const AnyfaceProgress,
    job: impl FnOnce(anyface::job::ProgressFn<'_>) -> anyface::Result<T>,
) -> Result<T, Failure> {
    let result = match unsafe { progress.as_ref() } {
        None => job(anyface::job::SILENT),
        Some(progress) => job(&|step| progress.report(step)),
    };
    Ok(result?)
}

/// Makes a handle that watches and stops jobs. The result is never NULL. Free with
/// `anyface_progress_free()`.
///
/// `callback` may be NULL if the program calls `anyface_progress_read()` instead. `user` is passed
/// to the callback unchanged.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_progress_new(
    callback: AnyfaceProgressFn,
    user: *mut c_void,
) -> *mut AnyfaceProgress {
    Box::into_raw(Box::new(AnyfaceProgress::new(callback, user)))
}

/// Reads how far the job is. May be called from any thread at any time.
///
/// `stage` receives the name of the stage ("" before the first), which lives until the handle is
/// freed. `fraction` receives how much of that stage is done, 0 to 1. Either may be NULL.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `progress` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_progress_read(
    progress: *const AnyfaceProgress,
    stage: *mut *const c_char,
    fraction: *mut f32,
) -> AnyfaceStatus {
    let read = || -> Result<(), Failure> {
        let (name, share) = unsafe { pointer::handle("progress", progress) }?.read();
        if !stage.is_null() {
            unsafe { stage.write(name) };
        }
        if !fraction.is_null() {
            unsafe { fraction.write(share) };
        }
        Ok(())
    };
    unsafe { guard::guard(std::ptr::null_mut(), read) }
}

/// Asks the job to stop. May be called from any thread. The running call returns
/// `ANYFACE_STATUS_CANCELLED` as soon as it can. Nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_progress_cancel(progress: *const AnyfaceProgress) {
    if let Some(progress) = unsafe { progress.as_ref() } {
        progress.cancelled.store(true, Ordering::Relaxed);
    }
}

/// Frees a progress handle that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_progress_free(progress: *mut AnyfaceProgress) {
    unsafe { guard::free(progress) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{ffi::CStr, ptr::null_mut};

    /// Counts calls in `user` and asks to stop at the third.
    unsafe extern "C" fn third_time(user: *mut c_void, _: *const c_char, _: f32) -> c_int {
        let calls = unsafe { &mut *user.cast::<i32>() };
        *calls += 1;
        c_int::from(*calls == 3)
    }

    fn step(stage: &'static str, fraction: f32) -> Progress {
        Progress { stage, fraction }
    }

    #[test]
    fn a_callback_stops_the_job_for_good() {
        let mut calls = 0;
        let progress = AnyfaceProgress::new(Some(third_time), (&raw mut calls).cast());
        assert!(progress.report(step("speech", 0.0)) && progress.report(step("speech", 0.5)));
        assert!(!progress.report(step("speech", 1.0)));
        assert!(!progress.report(step("motion", 0.0)));
        assert_eq!(calls, 3);
        assert!(progress.cancelled.load(Ordering::Relaxed));
    }

    #[test]
    fn another_thread_reads_stage_and_fraction_as_one() {
        let progress = AnyfaceProgress::new(None, null_mut());
        let read = || {
            let (stage, fraction) = progress.read();
            (unsafe { CStr::from_ptr(stage) }.to_str().unwrap(), fraction)
        };
        assert_eq!(read(), ("", 0.0));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for _ in 0..10_000 {
                    progress.report(step("speech", 0.25));
                    progress.report(step("motion", 0.75));
                }
            });
            for _ in 0..10_000 {
                assert!([("", 0.0), ("speech", 0.25), ("motion", 0.75)].contains(&read()));
            }
        });
        assert_eq!(progress.stages.lock().unwrap().len(), 3);
    }

    #[test]
    fn a_cancelled_job_ends_with_its_status() {
        let progress = AnyfaceProgress::new(None, null_mut());
        unsafe { anyface_progress_cancel(&progress) };
        let job = |watch: anyface::job::ProgressFn<'_>| anyface::job::report(watch, "speech", 0.0);
        let failure = unsafe { watched(&progress, job) }.unwrap_err();
        assert_eq!(failure.status(), AnyfaceStatus::Cancelled);
    }
}
