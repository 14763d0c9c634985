//! What of a finished take may be scaled.

/// Something of a take that can be scaled; 1 is the take as it was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slider {
    /// What speech does to mouth and jaw: 0 to 2. Scales the control `articulation`.
    Articulation,
    /// How strongly the emotion shows: 0 to 1.5. Blinks stay where they are.
    Emotion,
    /// How far the eyes close: 0 to 1. Takes away the control `blinks_per_minute`.
    Blinks,
    /// What emotion and blinks change together beyond what each does alone: lids travel as far as the
    /// emotion leaves them open. Stands at [`Slider::both`] of those two.
    EmotionAndBlinks,
}

impl Slider {
    /// All of them; the last one builds on those before it.
    pub const ALL: [Slider; 4] = [
        Slider::Articulation,
        Slider::Emotion,
        Slider::Blinks,
        Slider::EmotionAndBlinks,
    ];

    /// Where [`Slider::EmotionAndBlinks`] stands: at 1 unless both are elsewhere, at 0 where both are.
    pub fn both(emotion: f32, blinks: f32) -> f32 {
        1.0 - (1.0 - emotion) * (1.0 - blinks)
    }
}
