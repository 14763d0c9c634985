//! An owned error with its message.

use std::ffi::CString;

use libc::c_char;

use crate::status::AnyfaceStatus;

/// Why a call failed: a status and a message in English. Owned by the caller.
pub struct AnyfaceError {
    status: AnyfaceStatus,
    message: CString,
}

/// Why the inside of a call failed. The caller gets it as an [`AnyfaceError`].
#[derive(Debug)]
pub(crate) enum Failure {
    /// The argument of this name was NULL.
    Null(&'static str),
    /// The library's own error.
    Library(anyface::Error),
    /// A panic with its message and, if known, its place in the source.
    Panic(String),
}

impl From<anyface::Error> for Failure {
    fn from(error: anyface::Error) -> Self {
        Failure::Library(error)
    }
}

impl Failure {
    /// An input outside its stated range.
    pub(crate) fn invalid(message: impl Into<String>) -> Self {
        Failure::Library(anyface::Error::InvalidInput(message.into()))
    }

    pub(crate) fn status(&self) -> AnyfaceStatus {
        match self {
            Failure::Null(_) => AnyfaceStatus::NullPointer,
            Failure::Library(error) => AnyfaceStatus::of(error),
            Failure::Panic(_) => AnyfaceStatus::Panic,
        }
    }

    pub(crate) fn message(&self) -> String {
        match self {
            Failure::Null(name) => format!("{name}: expected a pointer, got NULL"),
            Failure::Library(error) => error.to_string(),
            Failure::Panic(message) => format!("defect in the library: {message}"),
        }
    }
}

impl AnyfaceError {
    pub(crate) fn new(failure: &Failure) -> Self {
        let mut text = failure.message().into_bytes();
        // A C string ends at the first NUL. File names from the caller cannot contain one, but a
        // message that quotes the content of a file could.
        text.iter_mut()
            .filter(|byte| **byte == 0)
            .for_each(|byte| *byte = b'?');
        AnyfaceError {
            status: failure.status(),
            message: CString::new(text).unwrap_or_default(),
        }
    }
}

/// The message, UTF-8; lives until the error is freed. "" for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_error_message(error: *const AnyfaceError) -> *const c_char {
    match unsafe { error.as_ref() } {
        Some(error) => error.message.as_ptr(),
        None => c"".as_ptr(),
    }
}

/// The status that the failed call returned; `ANYFACE_STATUS_OK` for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_error_status(error: *const AnyfaceError) -> AnyfaceStatus {
    unsafe { error.as_ref() }.map_or(AnyfaceStatus::Ok, |error| error.status)
}

/// Frees an error; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_error_free(error: *mut AnyfaceError) {
    // Dropping a text and a number cannot panic. So this function alone frees without `guard`,
    // which itself depends on this file.
    if !error.is_null() {
        drop(unsafe { Box::from_raw(error) });
    }
}
