//! The first layers of Whisper base, on which Anyface's speech encoder builds.

use anyface_weights_shared::{Model, model};

/// Turns the log-mel of speech into features that Whisper's first layers find in it.
pub static WHISPER_TRUNK: Model = model!("whisper_trunk");
