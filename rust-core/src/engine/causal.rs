//! Motion while somebody is speaking, and the same of a whole sound.

use std::sync::Arc;

use super::{Engine, MotionRequest, check_fps, frames_of};
use crate::{
    Error, Result,
    audio::Waveform,
    conditions::{Emotion, EmotionCurve},
    motion::{MotionClip, PerformanceControls},
    progress::{self, ProgressFn},
    systems::freetalk::stream::MotionStream,
};

/// How a [`MotionStream`] starts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StreamOptions {
    /// Emotion of the first frame; [`MotionStream::set_emotion`] changes it.
    pub emotion: Emotion,
}

impl Engine {
    /// Landmark motion in real time: push samples, pull frames at 25 fps.
    ///
    /// The stream keeps the weights alive by itself; it may outlive the engine.
    ///
    /// # Errors
    /// `InvalidInput` for an emotion that is not finite.
    pub fn stream(&self, options: &StreamOptions) -> Result<MotionStream> {
        let mut stream = MotionStream::new(Arc::clone(&self.stream));
        stream.set_emotion(&options.emotion)?;
        Ok(stream)
    }

    /// What [`Engine::stream`] makes of a whole sound; at 25 fps bit for bit the same.
    ///
    /// Other frame rates are interpolated. Causal motion has one style and no noise, and nothing
    /// that needs the whole sound is added to it: no blinks, no accents, no other controls.
    ///
    /// # Errors
    /// `Audio` for samples that are not finite, `InvalidInput` for a request out of range or one
    /// that asks for a style, a number of steps, controls or an emotion from the voice, `Cancelled`.
    pub fn causal_motion(
        &self,
        waveform: &Waveform,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<MotionClip> {
        check_fps(request.fps)?;
        check_causal(request)?;
        progress::report(progress, "motion", 0.0)?;
        let clip = self.stream.motion(waveform, &request.emotion)?;
        progress::report(progress, "motion", 1.0)?;
        Ok(clip.at_rate(request.fps, frames_of(waveform, request.fps)))
    }
}

fn check_causal(request: &MotionRequest) -> Result<()> {
    let plain = [
        PerformanceControls::default(),
        PerformanceControls::as_sampled(),
    ];
    let problem = if request.style.is_some() || request.steps.is_some() {
        let (style, steps) = (&request.style, request.steps);
        format!("no style and no steps, got {style:?} and {steps:?}")
    } else if request.emotion == EmotionCurve::Auto {
        "an emotion that is given, got one from the voice, which needs the whole sound".into()
    } else if !plain.contains(&request.controls) {
        format!("no controls, got {:?}", request.controls)
    } else {
        return Ok(());
    };
    Err(Error::InvalidInput(format!(
        "causal motion: expected {problem}"
    )))
}
