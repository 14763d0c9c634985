//! One folder per paper, and the registry of them; systems never import each other.
//!
//! A system is its folder, its `mod` line and its entry in [`SYSTEMS`], under the feature of its name: take these
//! away, and the rest compiles. `CONTRIBUTING.md` says how to add one.

#[cfg(feature = "cafe-talk")]
pub mod cafe_talk;
#[cfg(feature = "emoface")]
pub mod emoface;
#[cfg(feature = "facetalk")]
pub mod facetalk;
#[cfg(feature = "freetalk")]
pub mod freetalk;

mod slider;
mod windows;

use std::{path::Path, sync::Arc};

use crate::{
    Error, Result,
    cache::Cache,
    conditions::{Control, ControlStage, Controls, EmotionCurve, MotionRequest},
    deform::{self, CodeField, Deformer},
    face::Face,
    head::{self, Head},
    mesh,
    models::BuiltIn,
    motion::{self, CodeClip, LandmarkClip, LipClosures, Motion, MotionStream, TemplateMask},
    progress::ProgressFn,
    rig,
    speech::{self, Heard, SpeechInput},
    text,
};
pub use slider::Slider;
pub use windows::Windows;

/// Every system, the default one first.
pub static SYSTEMS: &[&Registration] = &[
    #[cfg(feature = "freetalk")]
    &freetalk::REGISTRATION,
    #[cfg(feature = "cafe-talk")]
    &cafe_talk::REGISTRATION,
    #[cfg(feature = "emoface")]
    &emoface::REGISTRATION,
    #[cfg(feature = "facetalk")]
    &facetalk::REGISTRATION,
];

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
    /// Whether it shows the events of a request.
    pub takes_events: bool,
    /// Whether emotion is a place among words to it, so that words beside the categories are understood.
    pub takes_words: bool,
    /// Whether it hears feeling in a voice, and may take it from another recording.
    pub hears_feeling: bool,
    /// Whether it goes on from a given pose.
    pub starts_from_pose: bool,
    /// What of a finished take may still be scaled without a new run.
    pub sliders: &'static [Slider],
    /// Loads the built-in models, or those of a folder.
    pub open: fn(Option<&Path>) -> Result<Box<dyn System>>,
}

impl Registration {
    /// The system of this name; the default one for `None`.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown name.
    pub fn find(name: Option<&str>) -> Result<&'static Registration> {
        let mut systems = SYSTEMS.iter().copied();
        let found = match name {
            Some(name) => systems.find(|system| system.name == name),
            None => systems.next(),
        };
        found.ok_or_else(|| {
            let known: Vec<&str> = SYSTEMS.iter().map(|system| system.name).collect();
            let (known, name) = (known.join(", "), name.unwrap_or_default());
            Error::InvalidInput(format!("system: expected one of {known}, got {name:?}"))
        })
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

/// Every model that is built in: those that serve all systems, then those of each system.
pub fn built_in_models() -> impl Iterator<Item = &'static BuiltIn> {
    let shared = [
        &speech::COMPACT_MODEL,
        &speech::PHONE_MODEL,
        &speech::FEELING_MODEL,
        &mesh::LANDMARK_MODEL,
        &head::MODEL,
        &deform::static_weights::MODEL,
        &deform::creases::MODEL,
        &motion::FACE_MODES_MODEL,
        &motion::EXPRESSIONS_MODEL,
        &rig::MODEL,
        &text::MODEL,
    ];
    let own = SYSTEMS
        .iter()
        .flat_map(|system| system.models.iter().copied());
    shared.into_iter().chain(own)
}

/// Turns what was heard and asked into motion.
///
/// A performance has two halves: [`System::sample`] runs the networks, [`System::perform`] puts
/// controls on the result and may be called again with others.
pub trait System: Send + Sync {
    /// The speech features that its models were trained with; `None` where any will do.
    fn speech(&self) -> Option<&SpeechInput> {
        None
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
    ) -> Result<Motion>;

    /// Whether another emotion needs another [`System::sample`]; else [`System::perform`] shows it.
    fn samples_emotion(&self) -> bool {
        true
    }

    /// Puts the controls of `request` on what was sampled. Blinks come as often as under `blink_emotion`, which
    /// is the request's own emotion unless only the strength of that is varied.
    ///
    /// # Errors
    /// Those of the system.
    fn perform(
        &self,
        sampled: &Motion,
        heard: &Heard,
        request: &MotionRequest,
        blink_emotion: &EmotionCurve,
    ) -> Result<Motion> {
        let _ = (heard, request, blink_emotion);
        Ok(sampled.clone())
    }

    /// When its lips are together: as it hears it, or in the `given` intervals `[start_s, end_s]`.
    fn closures(&self, heard: &Heard, given: Option<&[[f64; 2]]>) -> LipClosures {
        heard.closures(given)
    }

    /// Whether a face that is asked for with `controls` is worked on without a proxy.
    fn works_on_every_vertex(&self, controls: &Controls) -> bool {
        let _ = controls;
        false
    }

    /// Whether it hears feeling by an encoder of its own, for which [`Heard::voice`] has to keep the sound.
    fn hears_feeling_in_sound(&self) -> bool {
        false
    }

    /// Whether its motion moves shapes, which are made for each mesh.
    fn moves_by_shapes(&self) -> bool {
        false
    }

    /// Arrays of displacements `[t, V, 3]` that lie in memory while `t` frames are made.
    fn copies_of_frames(&self) -> usize {
        1
    }

    /// The system's own way to spread landmark motion over a face; `None` where that of
    /// [`crate::deform`] serves.
    ///
    /// # Errors
    /// Those of preparing it.
    fn deformer(
        &self,
        face: &Face,
        cache: &Cache,
        progress: ProgressFn<'_>,
    ) -> Result<Option<Arc<dyn Deformer>>> {
        let _ = (face, cache, progress);
        Ok(None)
    }

    /// The field by which codes move a face's own vertices, kept in `cache`; `None` where landmarks alone move it.
    ///
    /// # Errors
    /// `Mesh` if the landmarks lie on no usable face, `Cancelled`.
    fn field<'a>(
        &self,
        face: &'a Face,
        cache: &Cache,
        progress: ProgressFn<'_>,
    ) -> Result<Option<&'a dyn CodeField>> {
        let _ = (face, cache, progress);
        Ok(None)
    }

    /// Codes under which its head moves as landmarks of the mean face do, metres; `None` where it has no model for that.
    ///
    /// # Errors
    /// `Cancelled`.
    fn codes_of(&self, clip: &LandmarkClip, progress: ProgressFn<'_>) -> Result<Option<CodeClip>> {
        let _ = (clip, progress);
        Ok(None)
    }

    /// The parametric head whose codes its motion has; `None` where it has another kind of motion.
    fn head(&self) -> Option<&Arc<Head>> {
        None
    }

    /// Motion while somebody is speaking, where the system can do that.
    fn stream(&self) -> Option<Box<dyn MotionStream>> {
        None
    }

    /// How far feeling is believed beside what is said, for each vertex of its template and frame; `None` where
    /// it does not tell them apart.
    ///
    /// # Errors
    /// Those of [`System::sample`].
    fn believed(&self, heard: &Heard, request: &MotionRequest) -> Result<Option<TemplateMask>> {
        let _ = (heard, request);
        Ok(None)
    }

    /// Names of the speaking styles that its models know.
    fn styles(&self) -> &[String] {
        &[]
    }

    /// In which pieces it performs a long sound; `None` where it takes any length at once.
    fn windows(&self) -> Option<Windows> {
        None
    }
}
