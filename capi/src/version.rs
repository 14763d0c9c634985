//! The version of the library that a program was linked to, and its constants.

use std::ffi::CStr;

use libc::c_char;

/// Version of this interface, for comparison with `anyface_abi_version()`.
pub const ANYFACE_ABI_VERSION: u32 = 1;

/// Number `N` of face landmarks, in the order of iBUG 300-W.
pub const ANYFACE_LANDMARK_COUNT: usize = 68;

/// Number of emotion categories; `emotions` of `anyface_describe()` are their names.
pub const ANYFACE_EMOTION_COUNT: usize = 15;

const VERSION: &CStr =
    match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => panic!("the version holds a NUL"),
    };

const _: () = assert!(ANYFACE_LANDMARK_COUNT == anyface::mesh::ibug::LANDMARKS);
const _: () = assert!(ANYFACE_EMOTION_COUNT == anyface::conditions::EMOTIONS.len());

/// Version of the loaded library's interface.
///
/// It is raised when an existing part of the interface changes its meaning or goes away. A program
/// that loads the library at run time should stop if this differs from its own
/// `ANYFACE_ABI_VERSION`. New functions and new names of a request do not raise it. It counts from the first release on. Until 0.1.0 is out it stays 1 whatever changes,
/// and a program has to be rebuilt with each library.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_abi_version() -> u32 {
    ANYFACE_ABI_VERSION
}

/// Version of the library, such as "0.1.0". It lives as long as the library is loaded.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_version() -> *const c_char {
    VERSION.as_ptr()
}
