//! Ends the command in good order when memory runs out.
//!
//! It removes half-written files, prints the error, and exits with its code. Without this, Rust would end the
//! process by SIGABRT, leave the files, and tell scripts nothing.
#![allow(unsafe_code)]

use std::{
    alloc::{GlobalAlloc, Layout, System},
    sync::atomic::{AtomicBool, Ordering},
};

/// The system's allocator, which also notes when memory runs out.
struct Watched;

#[global_allocator]
static ALLOCATOR: Watched = Watched;

static HAS_ENDED: AtomicBool = AtomicBool::new(false);

fn note(place: *mut u8) -> *mut u8 {
    if place.is_null() {
        HAS_ENDED.store(true, Ordering::Relaxed);
    }
    place
}

// SAFETY: every call is passed on unchanged to the system's allocator.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(unsafe { System.alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note(unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note(unsafe { System.realloc(place, layout, size) })
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        unsafe { System.dealloc(place, layout) };
    }
}

/// From now on, ends the process in good order when memory runs out.
#[cfg(unix)]
pub fn guard(json: bool) {
    use std::{
        io::Write,
        panic,
        sync::{Arc, Mutex},
    };

    use anyface::{Error, job::remove_unfinished};
    use signal_hook::{consts::SIGABRT, low_level};

    use crate::console::error_text;

    /// Bytes kept back until memory runs out, so that the clean-up has room.
    const RESERVE: usize = 256 << 10;

    let reserve = Mutex::new(Some(vec![1_u8; RESERVE]));
    let message = "the memory that this process may take has ended; more memory, a shorter sound or a smaller mesh helps";
    let error = Error::OutOfMemory(message.to_owned());
    let code = i32::from(error.exit_code());
    let text = error_text(&error, json) + "\n";
    let end = Arc::new(move || {
        if !HAS_ENDED.load(Ordering::Relaxed) {
            return;
        }
        if let Ok(mut reserve) = reserve.try_lock() {
            *reserve = None;
        }
        remove_unfinished();
        let _ = std::io::stderr().write_all(text.as_bytes());
        low_level::exit(code);
    });
    // Some crates panic instead when they get no memory, as faer does.
    let (end_of_panic, report) = (Arc::clone(&end), panic::take_hook());
    panic::set_hook(Box::new(move |info| {
        end_of_panic();
        report(info);
    }));
    // SAFETY: the signal is raised by the thread that found no memory, outside of the allocator and of the lock of
    // standard error; nothing else sends it.
    let _ = unsafe { low_level::register(SIGABRT, move || end()) };
}

#[cfg(not(unix))]
pub fn guard(_json: bool) {}
