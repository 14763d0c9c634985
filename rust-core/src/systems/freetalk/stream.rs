//! Landmark motion while somebody is speaking: samples in, frames out, a fifth of a second behind.
//!
//! A causal network ([`CausalModel`]) imitates the encoder and the denoiser together. It was
//! trained on the motion that they make, with a squared error, which blurs p, b and m. A smaller
//! network beside it therefore detects when the lips are together, and the stream closes them
//! there. While nobody speaks, the face rests. The networks speak neutrally and the stream adds the
//! expression to each frame, so a change of emotion acts on the very next frame. The result may
//! differ from that of [`crate::Engine::perform`], which hears the whole sound.

#[cfg(test)]
mod tests;

use std::sync::Arc;

use ndarray::ArrayViewMut2;

use crate::{
    Error, Result,
    conditions::Emotion,
    mesh::ibug::LANDMARKS,
    motion::{
        CausalExpression, LandmarkFrame, LiveClosures, MotionStream, Performer, WidthGain,
        mouth_width, too_short,
    },
    speech::{CausalModel, CausalSpeech, VoiceGate, seconds_of},
};

/// How many numbers a frame holds: three for each landmark.
pub const DIMS: usize = 3 * LANDMARKS;

/// A performance in progress: push samples, pull frames.
pub struct CausalStream {
    speech: CausalSpeech,
    closures: LiveClosures,
    gate: VoiceGate,
    expression: CausalExpression,
    width: WidthGain,
    emotion: Emotion,
    /// With how strongly it is shown.
    performer: Option<(Arc<Performer>, f32)>,
}

impl CausalStream {
    /// Starts with a neutral face, before any sound. Rows of `model` are landmark displacements,
    /// metres. Rows of `closures` are the logit that the lips are together.
    pub fn new(
        model: Arc<CausalModel>,
        closures: Arc<CausalModel>,
        expression: CausalExpression,
        width: WidthGain,
    ) -> Self {
        let fps = model.config().fps;
        let speech = CausalSpeech::new(model);
        let closures = LiveClosures::new(closures, None);
        CausalStream {
            gate: VoiceGate::new(fps, longest_look_ahead(&speech, closures.speech())),
            speech,
            closures,
            expression,
            width,
            emotion: Emotion::default(),
            performer: None,
        }
    }

    /// Adds the performer, or one that `corrects`, to the frame that was pulled last.
    fn add_performer(&self, face: &mut ArrayViewMut2<'_, f32>, corrects: bool) {
        if let Some((performer, strength)) = &self.performer
            && performer.card().corrects == corrects
        {
            performer.add_to_frame(face, self.speech.hidden(), *strength);
        }
    }
}

/// Refuses a performer with a further head, whose features are others.
fn check_head(has_performer: bool, has_main_head: bool) -> Result<()> {
    if has_performer && !has_main_head {
        return Err(Error::InvalidInput(
            "performer: expected the whole look-ahead of the stream, with which performers are learned, got a \
             shorter one"
                .into(),
        ));
    }
    Ok(())
}

/// How many samples after a frame's instant the slower of two networks needs.
fn longest_look_ahead(one: &CausalSpeech, other: &CausalSpeech) -> usize {
    one.look_ahead_samples().max(other.look_ahead_samples())
}

impl MotionStream for CausalStream {
    fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.speech.push(samples)?;
        self.closures.push(samples)?;
        self.gate.push(samples);
        Ok(())
    }

    fn pull(&mut self) -> Option<LandmarkFrame> {
        if !self.closures.is_ready() {
            return None;
        }
        let index = self.speech.next_row();
        let row = self.speech.pull(|_| {})?;
        let mut displacements = [[0.0; 3]; LANDMARKS];
        displacements.as_flattened_mut().copy_from_slice(row);
        let mut frame = LandmarkFrame {
            index,
            displacements,
        };
        let mut face = ArrayViewMut2::from(&mut frame.displacements);
        self.add_performer(&mut face, false);
        let said = mouth_width(face.view());
        self.width.widen(&mut face, said);
        self.add_performer(&mut face, true);
        self.closures.close(&mut frame, 1.0);
        let spoken = self.gate.share(index);
        let said = frame.displacements.as_flattened_mut();
        said.iter_mut().for_each(|x| *x *= spoken);
        let quiet_s = self.speech.quiet_s().max(self.gate.closed_s());
        self.expression.add(&mut frame, &self.emotion, quiet_s);
        Some(frame)
    }

    fn finish(&mut self) -> Result<()> {
        self.speech.finish()?;
        self.closures.finish()
    }

    fn set_emotion(&mut self, emotion: &Emotion) -> Result<()> {
        if *emotion != self.emotion {
            emotion.check_finite()?;
            self.emotion = *emotion;
        }
        Ok(())
    }

    fn set_onset(&mut self, onset: f32) {
        self.expression.set_onset(onset);
    }

    fn set_performer(&mut self, performer: Option<Arc<Performer>>, strength: f32) -> Result<()> {
        if let Some(performer) = &performer {
            performer.check_live(self.speech.hidden().len())?;
        }
        check_head(performer.is_some(), self.speech.has_main_head())?;
        self.performer = performer.map(|performer| (performer, strength));
        Ok(())
    }

    fn look_ahead(&mut self, seconds: f64) -> Result<()> {
        let models = [&self.speech, self.closures.speech()].map(CausalSpeech::model);
        let heads = models
            .each_ref()
            .map(|model| model.config().head_within(seconds));
        let [Some(head), Some(closing)] = heads else {
            return Err(too_short(0.0, seconds));
        };
        if self.speech.has_heard() {
            return Err(Error::InvalidInput(
                "look-ahead: expected a value before the first sound, got one after it; begin a new stream"
                    .into(),
            ));
        }
        check_head(self.performer.is_some(), head.is_none())?;
        let [model, closures] = models;
        self.speech = CausalSpeech::by(model, head);
        self.closures = LiveClosures::new(closures, closing);
        self.gate
            .wait_for(longest_look_ahead(&self.speech, self.closures.speech()));
        Ok(())
    }

    fn hear_all(&mut self) {
        self.gate.hear_all();
    }

    fn latency_s(&self) -> f64 {
        seconds_of(longest_look_ahead(&self.speech, self.closures.speech()))
    }

    fn next_frame(&self) -> usize {
        self.speech.next_row()
    }

    fn fps(&self) -> f64 {
        self.speech.config().fps
    }
}
