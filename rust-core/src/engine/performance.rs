//! Speech as it was performed, with all that is needed to perform it in another way.

use ndarray::{Array2, ArrayView2};

use super::{Engine, MotionRequest, check_fps, frames_of};
use crate::{
    Result,
    audio::{Prosody, Waveform},
    conditions::EmotionCurve,
    motion::{self, Cues, MotionClip},
    progress::{self, ProgressFn},
    speech::at_motion_frames,
    systems::freetalk::AtsRequest,
};

/// Landmark motion, and what it was made from.
#[derive(Debug, Clone)]
pub struct Performance {
    /// The motion, canonical metres.
    pub motion: MotionClip,
    /// As the model made it, before any control.
    pub(super) sampled: MotionClip,
    /// `[T, C]`, speech features at the model's own rate.
    pub(super) features: Array2<f32>,
    pub(super) prosody: Prosody,
    /// What was asked, with the emotion that was heard.
    pub(super) request: MotionRequest,
}

impl Engine {
    /// [`Engine::motion`] that remembers how it was made, for [`Engine::slider_changes`].
    ///
    /// # Errors
    /// Those of [`Engine::motion`].
    pub fn performance(
        &self,
        waveform: &Waveform,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Performance> {
        request.controls.check()?;
        check_fps(request.fps)?;
        let prosody = Prosody::of(waveform);
        let request = MotionRequest {
            emotion: request.emotion.heard(&prosody).into_owned(),
            ..request.clone()
        };
        let frames = frames_of(waveform, request.fps);
        let (features, sampled) = self.threads(|| -> Result<_> {
            let features = self.hear(waveform, progress)?;
            let sampled = self.sample_heard(features.view(), frames, &request, progress)?;
            Ok((features, sampled))
        })?;
        let motion = self.perform_heard(&sampled, &prosody, &request, &request.emotion)?;
        Ok(Performance {
            motion,
            sampled,
            features,
            prosody,
            request,
        })
    }

    /// Speech features at the model's own rate, `[T, C]`.
    pub(super) fn hear(
        &self,
        waveform: &Waveform,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        progress::report(progress, "speech", 0.0)?;
        let fps = self.ats.config().fps;
        let track = self.speech.encode(waveform)?;
        let features = at_motion_frames(&track, frames_of(waveform, fps), fps);
        progress::report(progress, "speech", 1.0)?;
        Ok(features)
    }

    /// What the model makes of features `[T, C]`: `frames` frames at the rate of `request`, whose
    /// emotion was heard.
    pub(super) fn sample_heard(
        &self,
        features: ArrayView2<'_, f32>,
        frames: usize,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<MotionClip> {
        let model_fps = self.ats.config().fps;
        let affect = request.emotion.sample(features.nrows(), model_fps);
        let mut displacements = self.ats.sample(
            &AtsRequest {
                speech: features,
                affect: affect.view(),
                style: request.style.as_deref(),
                seed: request.seed,
                steps: request.steps,
                temperature: None,
            },
            progress,
        )?;
        if self.ats.config().closes_lips(request.style.as_deref())
            && let Some(closed) = self.speech.closed_lips(features)
        {
            motion::close_lips(&mut displacements, &closed)?;
        }
        let clip = MotionClip {
            displacements,
            fps: model_fps,
        };
        Ok(clip.at_rate(request.fps, frames))
    }

    /// Puts the controls of `request` on what was sampled; blinks come as often as under `urge`.
    pub(super) fn perform_heard(
        &self,
        sampled: &MotionClip,
        prosody: &Prosody,
        request: &MotionRequest,
        urge: &EmotionCurve,
    ) -> Result<MotionClip> {
        let (emotion, urge) = (request.emotion.heard(prosody), urge.heard(prosody));
        let frames = sampled.displacements.dim().0;
        let affect = emotion.sample(frames, sampled.fps);
        let urge = urge.sample(frames, sampled.fps);
        let cues = Cues {
            affect: affect.view(),
            urge: urge.view(),
            speech_only: *emotion == EmotionCurve::Off,
            prosody,
            seed: request.seed,
        };
        self.modes.perform(sampled, &cues, &request.controls)
    }
}
