//! The boundary to C: no panic crosses it, and every failure becomes a status and an error.

use std::{
    any::Any,
    cell::{Cell, RefCell},
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Once,
};

use libc::c_char;

use crate::{
    error::{AnyfaceError, Failure},
    pointer,
    status::AnyfaceStatus,
};

thread_local! {
    /// Number of calls of this thread that are inside the library.
    static DEPTH: Cell<u32> = const { Cell::new(0) };
    /// Where in the source the last panic of this thread happened.
    static PLACE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Runs a fallible call: catches panics, stores the error, returns the status.
///
/// # Safety
/// `error` is NULL or points to writable memory for a pointer.
pub(crate) unsafe fn guard(
    error: *mut *mut AnyfaceError,
    work: impl FnOnce() -> Result<(), Failure>,
) -> AnyfaceStatus {
    let failure = match catch(work) {
        Ok(Ok(())) => return AnyfaceStatus::Ok,
        Ok(Err(failure)) => failure,
        Err(message) => Failure::Panic(message),
    };
    if !error.is_null() {
        let owned = Box::into_raw(Box::new(AnyfaceError::new(&failure)));
        unsafe { error.write(owned) };
    }
    failure.status()
}

/// Runs a call that makes an object, and passes it to the caller as the last step.
///
/// # Safety
/// `out` and `error` are each NULL or point to writable memory for a pointer.
pub(crate) unsafe fn give<T>(
    out: *mut *mut T,
    error: *mut *mut AnyfaceError,
    make: impl FnOnce() -> Result<T, Failure>,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("out", out)?;
        let object = Box::new(make()?);
        unsafe { out.write(Box::into_raw(object)) };
        Ok(())
    };
    unsafe { guard(error, work) }
}

/// Runs a call that makes a text, which the caller frees with `anyface_text_free()`.
///
/// # Safety
/// As [`give`].
pub(crate) unsafe fn give_text(
    out: *mut *mut c_char,
    error: *mut *mut AnyfaceError,
    make: impl FnOnce() -> Result<String, Failure>,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("json", out)?;
        let text = pointer::c_text(&make()?);
        unsafe { out.write(text.into_raw()) };
        Ok(())
    };
    unsafe { guard(error, work) }
}

/// Runs a call that copies values into the caller's buffer. Its `capacity` must equal their number.
///
/// # Safety
/// `buffer` is NULL or valid for writes of `capacity` values; `error` as for [`guard`].
pub(crate) unsafe fn copy<T: Copy, V: AsRef<[T]>>(
    buffer: *mut T,
    capacity: usize,
    error: *mut *mut AnyfaceError,
    values: impl FnOnce() -> Result<V, Failure>,
) -> AnyfaceStatus {
    let work = || unsafe { pointer::copy_out("buffer", values()?.as_ref(), buffer, capacity) };
    unsafe { guard(error, work) }
}

/// Asserts that any number of threads may use objects of this type at the same time. A `const` that
/// holds its result compiles only then.
pub(crate) const fn shared_by_threads<T: Send + Sync>() {}

/// Runs a call that cannot report errors. It returns `fallback` after a panic.
pub(crate) fn guard_or<T>(fallback: T, work: impl FnOnce() -> T) -> T {
    catch(work).unwrap_or(fallback)
}

/// Frees a handle.
///
/// # Safety
/// `handle` is NULL, or it came from `Box::into_raw` and is not used again.
pub(crate) unsafe fn free<T>(handle: *mut T) {
    if !handle.is_null() {
        guard_or((), || drop(unsafe { Box::from_raw(handle) }));
    }
}

fn catch<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    keep_panics_quiet();
    PLACE.take();
    DEPTH.set(DEPTH.get() + 1);
    let result = catch_unwind(AssertUnwindSafe(work));
    DEPTH.set(DEPTH.get() - 1);
    result.map_err(|payload| describe(payload.as_ref()))
}

fn describe(payload: &(dyn Any + Send)) -> String {
    let text = payload
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned())
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "no message".into());
    // The place of a panic in a worker thread is not known here.
    match PLACE.take() {
        Some(place) => format!("{text} ({place})"),
        None => text,
    }
}

/// Installs a panic hook that stores the place of a panic instead of printing it to stderr, because
/// the library never prints.
///
/// The hook belongs to this library's own copy of Rust's runtime, never to the host's. A thread
/// outside any call is one of the library's own workers. Its panics reach the caller without the
/// hook.
fn keep_panics_quiet() {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if DEPTH.get() > 0 {
                PLACE.set(info.location().map(ToString::to_string));
            } else if cfg!(test) {
                before(info);
            }
        }));
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{anyface_error_free, anyface_error_message, anyface_error_status};
    use std::{ffi::CStr, ptr::null_mut};

    fn message_of(error: *mut AnyfaceError) -> String {
        let text = unsafe { CStr::from_ptr(anyface_error_message(error)) };
        let text = text.to_str().unwrap().to_owned();
        unsafe { anyface_error_free(error) };
        text
    }

    #[test]
    fn a_panic_becomes_a_status_with_its_place() {
        let mut error = null_mut();
        let status = unsafe { guard(&mut error, || panic!("index {} of {}", 5, 3)) };
        assert_eq!(status, AnyfaceStatus::Panic);
        assert_eq!(unsafe { anyface_error_status(error) }, AnyfaceStatus::Panic);
        let text = message_of(error);
        assert!(
            text.contains("index 5 of 3") && text.contains("guard.rs:"),
            "{text}"
        );
    }

    #[test]
    fn a_panic_of_a_worker_thread_becomes_a_status() {
        let mut error = null_mut();
        let work = || {
            let worker = std::thread::spawn(|| {
                if std::hint::black_box(true) {
                    std::panic::resume_unwind(Box::new("worker failed"));
                }
            });
            worker
                .join()
                .map_err(|payload| std::panic::resume_unwind(payload))
        };
        let status = unsafe { guard(&mut error, work) };
        assert_eq!(status, AnyfaceStatus::Panic);
        assert!(message_of(error).contains("worker failed"));
    }

    #[test]
    fn a_panic_without_a_place_for_the_error_is_still_caught() {
        let status = unsafe { guard(null_mut(), || panic!("quiet")) };
        assert_eq!(status, AnyfaceStatus::Panic);
        assert_eq!(guard_or(7, || panic!("quiet")), 7);
    }

    #[test]
    fn success_leaves_the_error_alone() {
        let mut error = std::ptr::dangling_mut();
        let before = error;
        let status = unsafe { guard(&mut error, || Ok(())) };
        assert_eq!((status, error), (AnyfaceStatus::Ok, before));
    }

    #[test]
    fn a_panic_while_freeing_is_caught() {
        struct Bomb;
        impl Drop for Bomb {
            fn drop(&mut self) {
                panic!("cannot drop");
            }
        }
        unsafe { free(Box::into_raw(Box::new(Bomb))) };
    }

    #[test]
    fn a_message_with_nul_is_kept_whole() {
        let mut error = null_mut();
        let status = unsafe { guard(&mut error, || Err(Failure::invalid("a\0b"))) };
        assert_eq!(status, AnyfaceStatus::InvalidInput);
        assert_eq!(message_of(error), "a?b");
    }
}
