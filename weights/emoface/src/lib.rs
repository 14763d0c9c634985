//! EmoFace's weights for Anyface, and its speech while it is spoken.

use anyface_weights_shared::{Model, model};

/// Speech and emotion to vertices of a template.
pub static EMOFACE_COMPACT: Model = model!("emoface_compact");
/// Speech to features while it is spoken.
pub static CAUSAL_SPEECH: Model = model!("causal_speech");
