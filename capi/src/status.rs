//! One code for each kind of failure.

use std::ffi::CStr;

use libc::c_char;

/// How a call ended. The codes from 3 on are also the exit codes of the `anyface` command.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceStatus {
    /// The call succeeded.
    Ok = 0,
    /// A pointer that must not be NULL was NULL.
    NullPointer = 1,
    /// A defect in the library, which was caught. The call's handles stay valid and can be freed.
    Panic = 2,
    /// A value outside its stated range, NaN, an unknown name, text that is not UTF-8, or an array
    /// of the wrong length.
    InvalidInput = 3,
    /// A sound that cannot be decoded or used.
    Audio = 4,
    /// A mesh that cannot be read or used.
    Mesh = 5,
    /// No face was found on the mesh. The message says why and what would help.
    FaceNotFound = 6,
    /// Model weights that are missing or truncated, or that do not fit their config.
    Weights = 7,
    /// A file that could not be read or written.
    Io = 8,
    /// The caller asked to stop.
    Cancelled = 9,
    /// A numerical method that did not converge, or a defect in the library.
    Internal = 10,
    /// A result that does not fit into memory. Take it block by block from `anyface_clip_stream()`.
    OutOfMemory = 13,
}

impl AnyfaceStatus {
    /// The status of an error of the library.
    pub(crate) fn of(error: &anyface::Error) -> Self {
        use anyface::Error;
        match error {
            Error::InvalidInput(_) | Error::ShapeMismatch { .. } => Self::InvalidInput,
            Error::Audio(_) | Error::DamagedSound(_) => Self::Audio,
            Error::Mesh(_) => Self::Mesh,
            Error::FaceNotFound(_) => Self::FaceNotFound,
            Error::Weights(_) => Self::Weights,
            Error::Io { .. } => Self::Io,
            Error::Cancelled => Self::Cancelled,
            Error::Numerics(_) => Self::Internal,
            Error::OutOfMemory(_) => Self::OutOfMemory,
        }
    }

    fn name(self) -> &'static CStr {
        match self {
            Self::Ok => c"ok",
            Self::NullPointer => c"null pointer",
            Self::Panic => c"panic",
            Self::InvalidInput => c"invalid input",
            Self::Audio => c"audio",
            Self::Mesh => c"mesh",
            Self::FaceNotFound => c"face not found",
            Self::Weights => c"weights",
            Self::Io => c"input or output",
            Self::Cancelled => c"cancelled",
            Self::Internal => c"internal",
            Self::OutOfMemory => c"out of memory",
        }
    }

    /// The status with this number. `None` if there is none, because C can pass any number.
    fn from_code(code: i32) -> Option<Self> {
        const ALL: [AnyfaceStatus; 12] = [
            AnyfaceStatus::Ok,
            AnyfaceStatus::NullPointer,
            AnyfaceStatus::Panic,
            AnyfaceStatus::InvalidInput,
            AnyfaceStatus::Audio,
            AnyfaceStatus::Mesh,
            AnyfaceStatus::FaceNotFound,
            AnyfaceStatus::Weights,
            AnyfaceStatus::Io,
            AnyfaceStatus::Cancelled,
            AnyfaceStatus::Internal,
            AnyfaceStatus::OutOfMemory,
        ];
        ALL.into_iter().find(|status| *status as i32 == code)
    }
}

/// A short name of a status, such as "face not found". "unknown" for a number that is no status.
///
/// The text lives as long as the library is loaded.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_status_name(status: i32) -> *const c_char {
    AnyfaceStatus::from_code(status)
        .map_or(c"unknown", AnyfaceStatus::name)
        .as_ptr()
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::Error;

    #[test]
    fn statuses_equal_exit_codes() {
        let errors = [
            Error::InvalidInput(String::new()),
            Error::Audio(String::new()),
            Error::Mesh(String::new()),
            Error::FaceNotFound(String::new()),
            Error::Weights(String::new()),
            Error::io("file")(std::io::ErrorKind::NotFound.into()),
            Error::Cancelled,
            Error::Numerics(String::new()),
            Error::OutOfMemory(String::new()),
        ];
        for error in errors {
            assert_eq!(
                AnyfaceStatus::of(&error) as i32,
                i32::from(error.exit_code()),
                "{error:?}"
            );
        }
    }

    #[test]
    fn every_number_has_a_name() {
        let name = |code| unsafe { CStr::from_ptr(anyface_status_name(code)) };
        assert_eq!(name(6), c"face not found");
        assert_eq!(name(-1), c"unknown");
        assert_eq!(name(11), c"unknown");
    }
}
