//! Runs third-party decoders on files from outside and turns their panics into errors of those
//! files.

use std::{
    any::Any,
    cell::Cell,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Once,
};

use crate::{Error, Result};

thread_local! {
    /// How many calls of `guarded` this thread is in.
    static DEPTH: Cell<u32> = const { Cell::new(0) };
}

/// Runs a decoder. If it panics, `refuse` makes an error of the panic's message.
///
/// Nothing is printed: the panic hook is silent for this thread while the decoder runs. For all
/// other threads it works as before.
///
/// # Errors
/// Those of `work`; that of `refuse` if it panics.
pub(crate) fn guarded<T>(
    refuse: fn(String) -> Error,
    work: impl FnOnce() -> Result<T>,
) -> Result<T> {
    keep_quiet();
    DEPTH.set(DEPTH.get() + 1);
    let result = catch_unwind(AssertUnwindSafe(work));
    DEPTH.set(DEPTH.get() - 1);
    result.unwrap_or_else(|panic| {
        Err(refuse(format!(
            "the file is damaged: its decoder stopped ({})",
            message(panic.as_ref())
        )))
    })
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("without a word")
}

fn keep_quiet() {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if DEPTH.get() == 0 {
                before(info);
            }
        }));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_of_the_file() {
        let index = std::hint::black_box(7);
        let error = guarded(Error::Audio, || Ok([1, 2, 3][index])).unwrap_err();
        assert!(
            matches!(&error, Error::Audio(m) if m.contains("index is 7")),
            "{error}"
        );
        let nested = guarded(Error::Mesh, || {
            guarded::<()>(Error::Audio, || panic!("inner")).unwrap_err();
            panic!("outer")
        });
        let error: Error = Result::<()>::unwrap_err(nested);
        assert!(
            matches!(&error, Error::Mesh(m) if m.contains("outer")),
            "{error}"
        );
        assert_eq!(DEPTH.get(), 0);
        assert_eq!(guarded(Error::Mesh, || Ok(5)).unwrap(), 5);
    }
}
