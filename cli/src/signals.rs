//! Signals that ask the command to end: the first cancels, the second ends it at once.

use std::{
    process::exit,
    sync::atomic::{AtomicBool, Ordering},
};

use anyface::job::remove_unfinished;

/// Exit code after the second signal: 128 plus the number of SIGINT, as in shells.
const AT_ONCE: i32 = 130;

static TO_END: AtomicBool = AtomicBool::new(false);

/// Whether somebody has asked the command to end.
pub fn are_to_end() -> bool {
    TO_END.load(Ordering::Relaxed)
}

/// From now on, listens for SIGINT, SIGTERM and SIGHUP. After the first, the next report of progress
/// cancels the job, which then removes its half-written files. The second ends the process without waiting
/// for that.
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
    // Without this, such a write would end the command and leave half-written files.
    let _ = flag::register(SIGXFSZ, std::sync::Arc::default());
    let Ok(mut signals) = Signals::new([SIGINT, SIGTERM, SIGHUP]) else {
        return;
    };
    // Without this thread, a signal still ends the command, but without the clean-up.
    let _ = std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || {
            for _ in signals.forever() {
                end();
            }
        });
}

/// From now on, listens for Ctrl-C, Ctrl-Break and the end of the session, like `listen` of other systems.
#[cfg(windows)]
pub fn listen() {
    // Without this handler, they still end the command, but without the clean-up.
    let _ = ctrlc::set_handler(end);
}

fn end() {
    if TO_END.swap(true, Ordering::Relaxed) {
        remove_unfinished();
        exit(AT_ONCE);
    }
}
