//! The model under measurement. All of the report's requests to the engine are made in this one
//! place.

use std::path::PathBuf;

use ndarray::{Array3, Axis, Slice};

use super::clip::Clip;
use anyface::{
    Engine, Error, MotionRequest, Performance, Result,
    audio::Waveform,
    conditions::{Controls, Emotion, EmotionCurve, Event},
    job::SILENT,
    motion::{Motion, PerformanceControls},
    systems::Ability,
};

/// What a performance should be like. The default is neutral, with the model's own settings.
#[derive(Clone, Default)]
pub(super) struct Wish {
    pub emotion: Emotion,
    pub seed: u64,
    /// Denoising steps; `None`: the model's own.
    pub steps: Option<usize>,
    /// Speaking style; `None`: the model's default.
    pub style: Option<String>,
    /// Uses the default controls, as a user gets them. Otherwise only the model's own motion.
    pub default_controls: bool,
    /// What the face does and when, for systems that can show it.
    pub events: Vec<Event>,
}

/// The engine under measurement.
pub(super) struct Speaker {
    pub engine: Engine,
    /// Folder of model files that override the embedded ones.
    pub weights: Option<PathBuf>,
}

impl Speaker {
    /// Motion for a sound of any length, `[T, 68, 3]` metres.
    pub(super) fn perform(
        &self,
        waveform: &Waveform,
        fps: f64,
        wish: &Wish,
    ) -> Result<Array3<f64>> {
        self.landmarks(&self.performance(waveform, fps, wish)?.motion)
    }

    /// Whether the system knows a control of this name.
    pub(super) fn has(&self, control: &str) -> bool {
        let mut known = self.engine.system().controls();
        known.any(|known| known.name == control)
    }

    /// Whether the system shows the emotion of a wish. Systems that hear emotion show what they
    /// hear instead.
    pub(super) fn shows_emotion(&self) -> bool {
        !self.engine.system().can(Ability::Emotion)
    }

    /// The whole performance of the engine.
    pub(super) fn performance(
        &self,
        waveform: &Waveform,
        fps: f64,
        wish: &Wish,
    ) -> Result<Performance> {
        let mut controls = if wish.default_controls {
            Controls::default()
        } else {
            Controls::from(PerformanceControls::as_sampled()).among(self.engine.system().controls())
        };
        if let Some(steps) = wish.steps {
            controls.set("steps", steps as f32);
        }
        let request = MotionRequest {
            emotion: EmotionCurve::Constant(wish.emotion),
            fps,
            seed: wish.seed,
            style: wish.style.clone(),
            controls,
            events: wish.events.clone(),
            ..MotionRequest::default()
        };
        self.engine.perform(waveform, &request, SILENT)
    }

    /// The landmarks of the mean face under any motion, `[T, 68, 3]` metres.
    pub(super) fn landmarks(&self, motion: &Motion) -> Result<Array3<f64>> {
        Ok(self
            .engine
            .landmarks_of(motion)?
            .displacements
            .mapv(f64::from))
    }

    /// Motion for a clip's sound, as long as the clip.
    pub(super) fn speak(&self, clip: &Clip, wish: &Wish) -> Result<Array3<f64>> {
        as_long_as(clip, self.perform(&clip.waveform, clip.fps, wish)?)
    }

    /// Motion of the causal stream for a clip's sound, as long as the clip.
    pub(super) fn stream(&self, clip: &Clip) -> Result<Array3<f64>> {
        let request = MotionRequest {
            fps: clip.fps,
            ..MotionRequest::default()
        };
        let motion = self
            .engine
            .causal_motion(&clip.waveform, &request, SILENT)?;
        as_long_as(clip, motion.displacements.mapv(f64::from))
    }
}

fn as_long_as(clip: &Clip, motion: Array3<f64>) -> Result<Array3<f64>> {
    fitted(motion, clip.frames())
        .ok_or_else(|| Error::InvalidInput(format!("{}: no frame was made", clip.name)))
}

/// The first `frames` frames. Where there are fewer, the last one is held; `None` where there is
/// nothing to hold.
pub(super) fn fitted(motion: Array3<f64>, frames: usize) -> Option<Array3<f64>> {
    let length = motion.dim().0;
    if length >= frames {
        return Some(motion.slice_axis(Axis(0), Slice::from(..frames)).to_owned());
    }
    let rows: Vec<usize> = (0..frames)
        .map(|t| t.min(length.saturating_sub(1)))
        .collect();
    (length > 0).then(|| motion.select(Axis(0), &rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_is_cut_or_held_to_length() {
        let motion = Array3::from_shape_fn((3, 1, 1), |(t, _, _)| t as f64);
        let long = fitted(motion.clone(), 5).unwrap();
        assert_eq!(long.as_slice().unwrap(), [0.0, 1.0, 2.0, 2.0, 2.0]);
        assert_eq!(fitted(motion, 2).unwrap().as_slice().unwrap(), [0.0, 1.0]);
        assert!(fitted(Array3::zeros((0, 1, 1)), 2).is_none());
    }
}
