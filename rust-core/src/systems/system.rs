//! What a system is, and how it is known before it is loaded.

use std::{path::Path, sync::Arc};

use super::{Slider, Windows};
use crate::{
    Result,
    conditions::{Control, ControlStage, Controls, EmotionCurve},
    deform::Decoder,
    job::ProgressFn,
    models::BuiltIn,
    motion::{
        EmotionOrigin, LandmarkClip, Motion, MotionKind, MotionRequest, MotionStream, TemplateMask,
    },
    speech::{Heard, SpeechInput},
};

/// How a system is known before it is loaded.
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
    /// The word by which it is chosen.
    pub name: &'static str,
    /// Its name for people.
    pub label: &'static str,
    /// One sentence of help.
    pub help: &'static str,
    /// Its built-in models.
    pub models: &'static [&'static BuiltIn],
    /// The controls that it understands, in groups: those shared with others and its own.
    pub controls: &'static [&'static [Control]],
    /// What its motion moves.
    pub motion: MotionKind,
    /// What it can do that others cannot.
    pub abilities: &'static [Ability],
    /// What of a finished take may still be scaled without a new run.
    pub sliders: &'static [Slider],
    /// What a second of sound takes of memory while it is performed, bytes, measured at 30 frames a second.
    pub second_bytes: u64,
    /// Loads the built-in models, or those of a folder.
    pub open: fn(Option<&Path>) -> Result<Box<dyn System>>,
}

/// What some systems can do and others cannot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ability {
    /// Shows the events of a request.
    Events,
    /// Understands words beside the categories of emotion: an emotion is a place among words to it.
    Words,
    /// Hears emotion in a voice, may take it from another recording, and tells it from what is said.
    Emotion,
    /// Goes on from a given pose.
    FirstPose,
    /// Moves the parametric head of [`crate::head`].
    Head,
}

impl Registration {
    /// Whether it can do something.
    pub fn can(&self, ability: Ability) -> bool {
        self.abilities.contains(&ability)
    }

    /// All controls, in the order in which they are shown.
    pub fn controls(&self) -> impl Iterator<Item = &'static Control> {
        self.controls.iter().copied().flatten()
    }

    /// Controls of one stage.
    pub fn controls_of(&self, stage: ControlStage) -> impl Iterator<Item = &'static Control> {
        self.controls()
            .filter(move |control| control.stage == stage)
    }
}

/// What is known of a system's models once they are loaded.
#[derive(Default)]
pub struct Description<'a> {
    /// The speech features that its models were trained with; `None` where any will do.
    pub speech: Option<&'a SpeechInput>,
    /// Whether [`Heard::voice`] has to keep the sound, for an encoder of the system's own.
    pub keeps_sound: bool,
    /// Whether another emotion needs another [`System::sample`], or [`System::apply_controls`] adds it.
    pub emotion: EmotionOrigin,
    /// Names of the speaking styles that its models know.
    pub styles: &'a [String],
    /// In which pieces it performs a long sound; `None` where it takes any length at once.
    pub windows: Option<Windows>,
}

/// Motion as the models of a system make it.
#[derive(Clone)]
pub struct Sampled {
    /// The motion.
    pub motion: Motion,
    /// How far emotion is believed beside what is said, of a system that tells them apart.
    pub mask: Option<Arc<dyn EmotionMask>>,
}

impl From<Motion> for Sampled {
    fn from(motion: Motion) -> Sampled {
        Sampled { motion, mask: None }
    }
}

/// How far emotion is believed beside what is said in one motion.
pub trait EmotionMask: Send + Sync {
    /// The share of emotion for each vertex of the system's template and each frame.
    ///
    /// # Errors
    /// `Weights` for a model without a template.
    fn shares(&self) -> Result<TemplateMask>;
}

/// Turns what was heard and asked into motion.
///
/// A performance has two halves: [`System::sample`] runs the networks, [`System::apply_controls`] puts
/// controls on the result and may be called again with others.
pub trait System: Send + Sync {
    /// What is known of its models.
    fn description(&self) -> Description<'_> {
        Description::default()
    }

    /// The motion as the models make it: `heard.frames(request.fps)` frames at `request.fps`.
    ///
    /// The controls of `request` were checked, and its emotion was heard in the voice where it asks
    /// for that.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown style, `Cancelled`.
    fn sample(
        &self,
        heard: &Heard,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Sampled>;

    /// Puts the controls of `request` on what was sampled. Blinks come as often as under `blink_emotion`, which
    /// is the request's own emotion unless only the strength of that is varied.
    ///
    /// # Errors
    /// Those of the system.
    fn apply_controls(
        &self,
        sampled: &Motion,
        heard: &Heard,
        request: &MotionRequest,
        blink_emotion: &EmotionCurve,
    ) -> Result<Motion> {
        let _ = (heard, request, blink_emotion);
        Ok(sampled.clone())
    }

    /// The system's own motion that follows landmarks of the mean face, whatever made these, on a face with such
    /// `controls`; the landmarks themselves where it has no model for that.
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

    /// The system's own way to spread landmark motion over a face with such `controls`; `None` where that of
    /// [`crate::deform`] serves.
    fn decoder(&self, controls: &Controls) -> Option<&dyn Decoder> {
        let _ = controls;
        None
    }

    /// Motion while somebody is speaking, where the system can do that.
    fn stream(&self) -> Option<Box<dyn MotionStream>> {
        None
    }
}
