//! Cafe-Talk's weights for Anyface, and the words of its events.

use anyface_weights_shared::{Model, model};

/// Speech, emotion and events to weights of shapes.
pub static CAFE_TALK_COMPACT: Model = model!("cafe_talk_compact");
/// Words to action units.
pub static TEXT_UNITS: Model = model!("text_units");
