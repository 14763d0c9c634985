//! Landmark motion while somebody is speaking: samples in, frames out, a fifth of a second behind.
//!
//! A causal network ([`CausalModel`]) imitates encoder and denoiser together; it was trained on what they
//! perform. It speaks neutrally; the expression is added to each frame, so a change of emotion acts on the
//! very next one. Not guaranteed: equality with [`crate::Engine::perform`], which hears the whole sound.

#[cfg(test)]
mod tests;

use std::sync::Arc;

use crate::{
    Result,
    conditions::Emotion,
    mesh::ibug::LANDMARKS,
    motion::{CausalExpression, LandmarkFrame, MotionStream},
    speech::{CausalModel, CausalSpeech},
};

/// Numbers of a frame.
pub const DIMS: usize = 3 * LANDMARKS;

/// A performance in progress: push samples, pull frames.
pub struct CausalStream {
    speech: CausalSpeech,
    expression: CausalExpression,
    emotion: Emotion,
}

impl CausalStream {
    /// A neutral face before any sound. The model's rows are landmarks, metres.
    pub fn new(model: Arc<CausalModel>, expression: CausalExpression) -> Self {
        CausalStream {
            speech: CausalSpeech::new(model),
            expression,
            emotion: Emotion::default(),
        }
    }
}

impl MotionStream for CausalStream {
    fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.speech.push(samples)
    }

    fn pull(&mut self) -> Option<LandmarkFrame> {
        let index = self.speech.next_row();
        let row = self.speech.pull(|_| {})?;
        let mut displacements = [[0.0; 3]; LANDMARKS];
        displacements.as_flattened_mut().copy_from_slice(row);
        let mut frame = LandmarkFrame {
            index,
            displacements,
        };
        let quiet_s = self.speech.quiet_s();
        self.expression.add(&mut frame, &self.emotion, quiet_s);
        Some(frame)
    }

    fn finish(&mut self) -> Result<()> {
        self.speech.finish()
    }

    fn set_emotion(&mut self, emotion: &Emotion) -> Result<()> {
        if *emotion != self.emotion {
            emotion.check_finite()?;
            self.emotion = *emotion;
        }
        Ok(())
    }

    fn latency_s(&self) -> f64 {
        self.speech.config().look_ahead_s()
    }

    fn next_frame(&self) -> usize {
        self.speech.next_row()
    }

    fn fps(&self) -> f64 {
        self.speech.config().fps
    }
}
