//! The kinds of errors. The kind decides the exit code and the C status.

use std::path::PathBuf;

/// Every fallible function of the library returns this.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An error says what was expected and what arrived.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A value outside its stated range, NaN, or an unknown name.
    #[error("{0}")]
    InvalidInput(String),
    /// An array of the wrong shape: "positions: expected [5023, 3], got [5023, 4]".
    #[error("{what}: expected {expected}, got {got}")]
    ShapeMismatch {
        /// Name of the array.
        what: &'static str,
        /// Expected shape, as text.
        expected: String,
        /// Shape that arrived, as text.
        got: String,
    },
    /// A sound that cannot be decoded or used.
    #[error("audio: {0}")]
    Audio(String),
    /// A sound file of which too much is missing. Whoever accepts any damage can use the rest.
    #[error("audio: {0}")]
    DamagedSound(String),
    /// A mesh that cannot be read or used.
    #[error("mesh: {0}")]
    Mesh(String),
    /// No face was found on the mesh. The message says why and what would help.
    #[error("no face found: {0}")]
    FaceNotFound(String),
    /// Weights that are missing, truncated or do not fit their config.
    #[error("weights: {0}")]
    Weights(String),
    /// A numerical method that did not converge, or a result that is not finite.
    #[error("numerics: {0}")]
    Numerics(String),
    /// A file that could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The error from the operating system.
        source: std::io::Error,
    },
    /// The caller's progress callback asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// A job or a result that does not fit into memory.
    #[error("out of memory: {0}")]
    OutOfMemory(String),
}

impl Error {
    /// Attaches the path to an I/O error.
    pub fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.into();
        move |source| Error::Io { path, source }
    }

    /// Exit code of the command for this kind of error. clap uses 2 for usage errors.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::InvalidInput(_) | Error::ShapeMismatch { .. } => 3,
            Error::Audio(_) | Error::DamagedSound(_) => 4,
            Error::Mesh(_) => 5,
            Error::FaceNotFound(_) => 6,
            Error::Weights(_) => 7,
            Error::Io { .. } => 8,
            Error::Cancelled => 9,
            Error::Numerics(_) => 10,
            // The add-on uses 11 and 12 for its own errors.
            Error::OutOfMemory(_) => 13,
        }
    }
}
