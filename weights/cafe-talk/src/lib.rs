//! Cafe-Talk's weights for Anyface, and those that understand events in words.

use anyface_weights_shared::{Model, model};

/// Turns speech, emotion and events into weights of shapes.
pub static CAFE_TALK_COMPACT: Model = model!("cafe_talk_compact");
/// Turns words into action units.
pub static TEXT_UNITS: Model = model!("text_units");
