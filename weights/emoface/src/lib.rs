//! EmoFace's weights for Anyface, and the speech encoder of its stream.

use anyface_weights_shared::{Model, model};

/// Turns speech and emotion into the motion of a template's vertices.
pub static EMOFACE_COMPACT: Model = model!("emoface_compact");
/// Turns speech into features while it is being spoken.
pub static CAUSAL_SPEECH: Model = model!("causal_speech");
