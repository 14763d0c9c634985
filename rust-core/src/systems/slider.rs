//! The aspects of a finished take that a user can scale.

/// An aspect of a take that can be scaled. At 1 the take stays as it was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slider {
    /// How far speech moves the mouth and the jaw: 0 to 2. Scales the control `articulation`.
    Articulation,
    /// How strongly the emotion shows: 0 to 1.5. Blinks stay where they are.
    Emotion,
    /// How far the eyes close in blinks: 0 to 1. At 0 it equals a `blinks_per_minute` of 0.
    Blinks,
    /// The change that emotion and blinks make together, beyond what each makes alone: how far the
    /// lids travel in a blink depends on how far the emotion opens the eyes. Its position is
    /// [`Slider::both`] of the other two positions.
    EmotionAndBlinks,
}

impl Slider {
    /// All sliders. The last one depends on those before it.
    pub const ALL: [Slider; 4] = [
        Slider::Articulation,
        Slider::Emotion,
        Slider::Blinks,
        Slider::EmotionAndBlinks,
    ];

    /// The position of [`Slider::EmotionAndBlinks`]: 1 if either slider is at 1, and 0 if both are
    /// at 0.
    pub fn both(emotion: f32, blinks: f32) -> f32 {
        1.0 - (1.0 - emotion) * (1.0 - blinks)
    }
}
