//! What a system is, and what is known of it before it is loaded.

use std::{path::Path, sync::Arc};

use ndarray::Array2;

use super::{Slider, Windows};
use crate::{
    Error, Result,
    conditions::{Control, ControlStage, Controls, EmotionCurve},
    deform::Decoder,
    job::ProgressFn,
    models::BuiltIn,
    motion::{
        EmotionOrigin, LandmarkClip, Motion, MotionKind, MotionRequest, MotionStream, TemplateMask,
    },
    speech::{SpeechFeatures, SpeechInput},
};

/// What is known of a system before it is loaded.
///
/// ```
/// use anyface::systems::{Registration, SYSTEMS};
///
/// let system = Registration::find(None)?;
/// assert_eq!(system.name, SYSTEMS[0].name);
/// for control in system.controls() {
///     assert!((control.low..=control.high).contains(&control.default), "{}", control.name);
/// }
/// assert!(Registration::find(Some("shouting")).is_err());
/// # Ok::<(), anyface::Error>(())
/// ```
pub struct Registration {
    /// The name by which a user chooses it.
    pub name: &'static str,
    /// The name that is shown to people.
    pub label: &'static str,
    /// One sentence of help.
    pub help: &'static str,
    /// Its built-in models.
    pub models: &'static [&'static BuiltIn],
    /// The controls that it understands, in groups: those that it shares with others, and its own.
    pub controls: &'static [&'static [Control]],
    /// The kind of its motion.
    pub motion: MotionKind,
    /// What it can do that others cannot.
    pub abilities: &'static [Ability],
    /// The controls of a system with [`Ability::Emotion`].
    pub emotion: Option<EmotionControls>,
    /// The aspects of a finished take that can be scaled without a new run.
    pub sliders: &'static [Slider],
    /// Memory that a performance needs for each second of sound, bytes, measured at 30 frames a
    /// second.
    pub second_bytes: u64,
    /// Loads the built-in models, or those of a folder.
    pub open: fn(Option<&Path>) -> Result<Box<dyn System>>,
}

/// What some systems can do and others cannot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ability {
    /// Shows the events of a request.
    Events,
    /// Understands other words than the categories of emotion, because it represents an emotion as
    /// a place among words.
    Words,
    /// Hears emotion in the voice or in another recording, and keeps it apart from what is said.
    Emotion,
    /// Starts a take from a given pose.
    FirstPose,
    /// Shows the mouth of a performer.
    Performer,
    /// Moves the parametric head of [`crate::head`].
    Head,
}

/// The controls by which a system that hears emotion chooses where it comes from and what shows it.
pub struct EmotionControls {
    /// The control of the source, with its values for the voice and for the emotion of the request.
    pub source: &'static Control,
    /// The value of `source` for the emotion that is heard.
    pub voice: f32,
    /// The value of `source` for the emotion that the request names.
    pub named: f32,
    /// The control of the layer.
    pub layer: &'static Control,
    /// The value of `layer` for speech alone.
    pub content: f32,
}

impl Registration {
    /// Whether it has an ability.
    pub fn can(&self, ability: Ability) -> bool {
        self.abilities.contains(&ability)
    }

    /// All controls, in the order in which they are shown.
    pub fn controls(&self) -> impl Iterator<Item = &'static Control> {
        self.controls.iter().copied().flatten()
    }

    /// The controls of one stage.
    pub fn controls_of(&self, stage: ControlStage) -> impl Iterator<Item = &'static Control> {
        self.controls()
            .filter(move |control| control.stage == stage)
    }
}

/// What is known of a system's models once they are loaded.
#[derive(Default)]
pub struct Description<'a> {
    /// The speech features that its models were trained with. `None` if any will do.
    pub speech: Option<&'a SpeechInput>,
    /// Whether a change of emotion needs a new [`System::sample`], or [`System::apply_controls`]
    /// adds it.
    pub emotion: EmotionOrigin,
    /// Names of the speaking styles that its models know.
    pub styles: &'a [String],
    /// The windows in which it performs a long sound. `None` if it takes any length at once.
    pub windows: Option<Windows>,
}

/// Motion as the models of a system make it.
#[derive(Clone)]
pub struct Sampled {
    /// The motion.
    pub motion: Motion,
    /// The weight of emotion against speech, if the system keeps the two apart.
    pub mask: Option<Arc<dyn EmotionMask>>,
}

impl From<Motion> for Sampled {
    fn from(motion: Motion) -> Sampled {
        Sampled { motion, mask: None }
    }
}

/// The weight of emotion against speech in one motion.
pub trait EmotionMask: Send + Sync {
    /// The share of emotion for each vertex of the system's template and each frame.
    ///
    /// # Errors
    /// `Weights` for a model without a template.
    fn shares(&self) -> Result<TemplateMask>;
}

/// Turns a heard sound and a request into motion.
///
/// A performance has two halves. [`System::sample`] runs the networks. [`System::apply_controls`]
/// applies controls to the result and may be called again with other controls.
pub trait System: Send + Sync {
    /// Describes the system's loaded models.
    fn description(&self) -> Description<'_> {
        Description::default()
    }

    /// Makes the motion with the models: `heard.frames(request.fps)` frames at `request.fps`.
    ///
    /// The caller has checked the controls of `request`. If the request asks for the emotion of the
    /// voice, the caller has already filled in the emotion that it heard.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown style, `Cancelled`.
    fn sample(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Sampled>;

    /// What the models do with a sound at their own frame rate, without noise, contacts or a performer. A
    /// performer's motion is learned as the difference from it. For systems with [`Ability::Performer`].
    ///
    /// # Errors
    /// `InvalidInput` for a system without it; `Cancelled`.
    fn own_speaker(
        &self,
        heard: &SpeechFeatures,
        progress: ProgressFn<'_>,
    ) -> Result<LandmarkClip> {
        let _ = (heard, progress);
        Err(Error::InvalidInput(
            "performers: expected a system that shows them".into(),
        ))
    }

    /// What the live stream hears in samples `[S]` at 16 kHz, features `[T, C]`, and what it does with them before
    /// contacts. `None` for a system whose stream shows no performers.
    ///
    /// # Errors
    /// `Audio` for samples that are not finite.
    fn live_speaker(&self, samples: &[f32]) -> Result<Option<(Array2<f32>, LandmarkClip)>> {
        let _ = samples;
        Ok(None)
    }

    /// Applies the controls of `request` to the sampled motion. Blinks come as often as under
    /// `blink_emotion`. This is the request's own emotion, unless only its strength is varied.
    ///
    /// # Errors
    /// Those of the system.
    fn apply_controls(
        &self,
        sampled: &Motion,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        blink_emotion: &EmotionCurve,
    ) -> Result<Motion> {
        let _ = (heard, request, blink_emotion);
        Ok(sampled.clone())
    }

    /// Makes the system's own motion from landmarks of the mean face, whatever made them, for a
    /// face with these `controls`. Returns the landmarks themselves if the system has no model for
    /// that.
    ///
    /// # Errors
    /// `Cancelled`.
    fn follow(
        &self,
        landmarks: &LandmarkClip,
        controls: &Controls,
        progress: ProgressFn<'_>,
    ) -> Result<Motion> {
        let _ = (controls, progress);
        Ok(Motion::Landmarks(landmarks.clone()))
    }

    /// The system's own decoder, which spreads landmark motion over a face with these `controls`.
    /// `None` if the decoder of [`crate::deform`] serves.
    fn decoder(&self, controls: &Controls) -> Option<&dyn Decoder> {
        let _ = controls;
        None
    }

    /// A stream that makes motion while somebody is speaking, if the system can do that.
    fn stream(&self) -> Option<Box<dyn MotionStream>> {
        None
    }
}
