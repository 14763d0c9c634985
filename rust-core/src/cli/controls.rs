//! Flags for the controls over a performance, and for emotion.

use clap::Args;

use crate::{Result, conditions::EmotionCurve, motion::PerformanceControls};

/// What the emotion is.
#[derive(Args)]
pub(super) struct EmotionArgs {
    /// Emotion and intensity: happy:0.7, a blend happy:0.4,surprised:0.3, auto (read from the voice)
    /// or off (speech alone: no blinks, no brows)
    #[arg(long, default_value = "neutral:0")]
    emotion: String,
    /// Emotion over time: "0:neutral 2.5:happy:0.8 4:sad:0.5", seconds and emotions, linear between
    #[arg(long, value_name = "KEYS", conflicts_with = "emotion")]
    emotion_keys: Option<String>,
}

impl EmotionArgs {
    pub(super) fn curve(&self) -> Result<EmotionCurve> {
        match &self.emotion_keys {
            Some(keys) => EmotionCurve::parse_keys(keys),
            None => EmotionCurve::parse(&self.emotion),
        }
    }
}

/// What is done to the sampled motion; the defaults are the library's.
#[derive(Args)]
pub(super) struct ControlArgs {
    /// Strength of what speech does to mouth and jaw, 0 to 2; closed lips stay closed
    #[arg(long, default_value_t = PerformanceControls::default().articulation)]
    articulation: f32,
    /// From lips (-1) to jaw (1)
    #[arg(long, default_value_t = PerformanceControls::default().jaw_lips, allow_hyphen_values = true)]
    jaw_lips: f32,
    /// Smoothing in seconds, 0 to 0.1; closed lips stay closed
    #[arg(long, value_name = "S", default_value_t = PerformanceControls::default().smoothing_s)]
    smoothing: f32,
    /// Strength of brows, lids and nose bridge, 0 to 2; blinks stay
    #[arg(long, default_value_t = PerformanceControls::default().upper_face)]
    upper_face: f32,
    /// Blinks a minute, 0 to 60
    #[arg(long, value_name = "N", default_value_t = PerformanceControls::default().blinks_per_minute)]
    blinks: f32,
    /// Strength of brow raises on stressed syllables, 0 to 2
    #[arg(long, default_value_t = PerformanceControls::default().brow_accents)]
    brow_accents: f32,
    /// More motion of brows and mouth corners on the subject's right (-1) or left (1)
    #[arg(long, default_value_t = PerformanceControls::default().asymmetry, allow_hyphen_values = true)]
    asymmetry: f32,
}

impl ControlArgs {
    pub(super) fn controls(&self) -> Result<PerformanceControls> {
        let controls = PerformanceControls {
            articulation: self.articulation,
            jaw_lips: self.jaw_lips,
            smoothing_s: self.smoothing,
            upper_face: self.upper_face,
            blinks_per_minute: self.blinks,
            brow_accents: self.brow_accents,
            asymmetry: self.asymmetry,
        };
        controls.check()?;
        Ok(controls)
    }
}
