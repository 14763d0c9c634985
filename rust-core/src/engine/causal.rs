//! Motion in real time while somebody speaks, and the same motion for a whole recording.

use std::sync::Arc;

use super::Engine;
use crate::{
    Error, Result,
    audio::Waveform,
    conditions::{ControlStage, EmotionCurve},
    job::ProgressFn,
    motion::{
        Ears, LandmarkClip, MotionRequest, MotionStream, WeightStream, check_fps, stream_whole,
    },
    nn::finite::check_result,
    speech::{EmotionEncoder, frames_of},
};

impl Engine {
    /// Landmark motion in real time: push samples, pull frames. It starts with a neutral face.
    ///
    /// The stream keeps the weights alive by itself; it may outlive the engine.
    ///
    /// # Errors
    /// `InvalidInput` for a system that needs the whole sound.
    pub fn stream(&self) -> Result<Box<dyn MotionStream>> {
        self.system.stream().ok_or_else(|| {
            let name = self.registration.name;
            Error::InvalidInput(format!("stream: {name} needs the whole sound"))
        })
    }

    /// Weights of ARKit's shapes and of visemes in real time, with blinks, eyes and head: push samples, pull frames.
    ///
    /// # Errors
    /// `InvalidInput` for a system that needs the whole sound, `Weights` or `Io` where a model is damaged.
    pub fn weight_stream(&self) -> Result<WeightStream> {
        let encoder = EmotionEncoder::open(self.model_folder.as_deref())?;
        let ears = Ears {
            encoder: Arc::new(encoder),
            ear: Arc::clone(self.shared.ear.get()?),
        };
        WeightStream::new(
            self.stream()?,
            ears,
            &self.shared.face_modes,
            self.rig_model()?.visemes(),
        )
    }

    /// The motion that [`Engine::stream`] makes of a whole sound, where every sound moves the face
    /// ([`MotionStream::hear_all`]). At the stream's own rate it is the same bit for bit.
    ///
    /// Other frame rates are interpolated. Causal motion has one style and no noise. Nothing that
    /// needs the whole sound is added to it: no blinks, no accents, no other controls.
    ///
    /// # Errors
    /// `Audio` for samples that are not finite, `InvalidInput` for a request out of range or one
    /// that asks for a style, controls, an emotion from the voice or a performer that the stream cannot show,
    /// `Cancelled`.
    pub fn causal_motion(
        &self,
        waveform: &Waveform,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<LandmarkClip> {
        check_fps(request.fps)?;
        self.check_causal(request)?;
        let mut stream = self.stream()?;
        // Someone who chooses a recording wants all of its sound to move the face.
        stream.hear_all();
        stream.set_performer(request.performer.clone(), request.performer_strength)?;
        let samples = &waveform.samples;
        let clip = stream_whole(stream.as_mut(), samples, &request.emotion, progress)?;
        check_result("motion", clip.displacements.view().into_dyn())?;
        Ok(clip.at_rate(request.fps, frames_of(waveform.duration_s(), request.fps)))
    }

    fn check_causal(&self, request: &MotionRequest) -> Result<()> {
        let known = self.registration.controls_of(ControlStage::Motion);
        let problem = if let Some(style) = &request.style {
            format!("no style, got {style:?}")
        } else if matches!(request.emotion, EmotionCurve::Auto | EmotionCurve::Arousal) {
            "an emotion by name, got one from the voice, which needs the whole sound".into()
        } else if !request.controls.ask_nothing(known) {
            format!("no controls, got {:?}", request.controls)
        } else {
            return Ok(());
        };
        Err(Error::InvalidInput(format!(
            "causal motion: expected {problem}"
        )))
    }
}
