//! Signals that ask the command to end: the first cancels, the second ends it at once.

use std::{
    process::exit,
    sync::atomic::{AtomicBool, Ordering},
};

use anyface::job::remove_unfinished;

/// Exit code of the second signal: 128 and the number of SIGINT, as shells have it.
const AT_ONCE: i32 = 130;

static TO_END: AtomicBool = AtomicBool::new(false);

/// Whether somebody has asked the command to end.
pub fn are_to_end() -> bool {
    TO_END.load(Ordering::Relaxed)
}

/// Listens for SIGINT, SIGTERM and SIGHUP from now on. The first makes the next report of progress cancel the
/// job, which then removes its half-written files. The second ends the process without waiting for that.
///
/// SIGXFSZ would end a process whose file grows beyond `ulimit -f`. The command only notes the signal, so that the write
/// fails like any other.
#[cfg(unix)]
pub fn listen() {
    use signal_hook::{
        consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ},
        flag,
        iterator::Signals,
    };
    // Without it such a write ends the command, and leaves files.
    let _ = flag::register(SIGXFSZ, std::sync::Arc::default());
    let Ok(mut signals) = Signals::new([SIGINT, SIGTERM, SIGHUP]) else {
        return;
    };
    // A command without this thread can still be ended, only not politely.
    let _ = std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || {
            for _ in signals.forever() {
                end();
            }
        });
}

/// Listens for Ctrl-C, Ctrl-Break and the end of the session from now on; see the other systems' `listen`.
#[cfg(windows)]
pub fn listen() {
    // A command without it can still be ended, only not politely.
    let _ = ctrlc::set_handler(end);
}

fn end() {
    if TO_END.swap(true, Ordering::Relaxed) {
        remove_unfinished();
        exit(AT_ONCE);
    }
}
