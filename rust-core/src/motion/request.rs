//! The request for a performance.

use std::{ops::RangeInclusive, sync::Arc};

use ndarray::{Array3, Axis};

use crate::{
    Error, Result,
    conditions::{Controls, EmotionCurve, Event},
    mesh::ibug::LANDMARKS,
    speech::{Script, SpeechFeatures, VoiceTrack},
};

use super::{ARTICULATION, LandmarkClip, ONSET, Performer, Pose};

/// The frame rates that a result may have, in frames per second.
pub const FPS: RangeInclusive<f64> = 1.0..=240.0;

/// The request for a performance.
///
/// ```
/// use anyface::{MotionRequest, conditions::EmotionCurve};
///
/// let mut request = MotionRequest { fps: 24.0, seed: 7, ..MotionRequest::default() };
/// request.emotion = EmotionCurve::parse("happy:0.4,surprised:0.3")?;
/// request.controls.set("articulation", 1.2);
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct MotionRequest {
    /// Emotion and intensity over time.
    pub emotion: EmotionCurve,
    /// Frames per second of the result, within [`FPS`].
    pub fps: f64,
    /// The same seed gives the same motion.
    pub seed: u64,
    /// Speaking style by name; `None` takes the model's default.
    pub style: Option<String>,
    /// The values of the system's own controls.
    pub controls: Controls,
    /// The times at which the lips are together, `[start_s, end_s]` in rising order. They replace
    /// the times found in the sound; see [`crate::annotation::Annotation::closures`].
    pub closures: Option<Vec<[f64; 2]>>,
    /// What is said in the sound, as far as it is known. Lips, tongue and shapes of the mouth then
    /// follow its phones; `closures` still replaces the times at which lips close. For systems with the
    /// built-in ear.
    pub script: Option<Arc<Script>>,
    /// Events that the face has to show, in any order. They may overlap. A system that shows no
    /// events refuses them.
    pub events: Vec<Event>,
    /// Another recording, of any length, that supplies the emotion if the system hears emotion
    /// (`emotion_from` of EmoFace).
    pub emotion_of: Option<Arc<VoiceTrack>>,
    /// A recording in which the same person speaks neutrally, made by [`VoiceTrack::neutral`]. The
    /// longer it is the better. The emotion of the voice is then heard as the difference from it.
    /// It has no effect if no emotion is heard.
    pub neutral_voice: Option<Arc<VoiceTrack>>,
    /// The person whose mouth the face shows.
    pub performer: Option<Arc<Performer>>,
    /// How strongly `performer` counts, 0 to 2: 1 is as the person speaks, 0 as the model's own speaker does.
    pub performer_strength: f32,
    /// The pose of the face in the first frame, such as the last pose of another motion. `None` is
    /// rest. For systems that make each frame from the frames before it.
    pub starts_from: Option<Pose>,
}

impl Default for MotionRequest {
    fn default() -> Self {
        MotionRequest {
            emotion: EmotionCurve::default(),
            fps: 30.0,
            seed: 0,
            style: None,
            controls: Controls::default(),
            closures: None,
            script: None,
            events: Vec::new(),
            emotion_of: None,
            neutral_voice: None,
            performer: None,
            performer_strength: 1.0,
            starts_from: None,
        }
    }
}

impl MotionRequest {
    /// The factor on the times in which emotions and events come and go.
    pub(crate) fn onset(&self) -> f32 {
        self.controls.get(ONSET).unwrap_or(1.0)
    }

    /// The requested articulation of the lips, 1 is normal. If animated, the mean of its keys.
    pub fn articulation(&self) -> f32 {
        let Some(curve) = self.controls.animated(ARTICULATION) else {
            return self.controls.get(ARTICULATION).unwrap_or(1.0);
        };
        let sum: f64 = curve.keys.iter().map(|(_, value)| value).sum();
        (sum / curve.keys.len() as f64) as f32
    }

    /// Adds what the performer does beyond the model's speaker to `clip`, or to finished motion if the performer
    /// `corrects`. Returns whether there is a performer of that kind. The features are heard at `features_fps`.
    ///
    /// # Errors
    /// Those of [`Performer::add_to`].
    pub(crate) fn add_performer(
        &self,
        clip: &mut LandmarkClip,
        (heard, features_fps): (&SpeechFeatures, f64),
        corrects: bool,
    ) -> Result<bool> {
        let performer = self.performer.as_ref();
        let Some(performer) = performer.filter(|known| known.card().corrects == corrects) else {
            return Ok(false);
        };
        let features = heard.features(features_fps);
        let mut own = LandmarkClip {
            displacements: Array3::zeros((features.nrows(), LANDMARKS, 3)),
            fps: features_fps,
        };
        let read_from = (features.view(), heard.encoder_name());
        performer.add_to(
            own.displacements.view_mut(),
            read_from,
            self.performer_strength,
        )?;
        let frames = clip.displacements.len_of(Axis(0));
        if (clip.fps, frames) != (own.fps, features.nrows()) {
            own = own.at_rate(clip.fps, frames);
        }
        clip.displacements += &own.displacements;
        Ok(true)
    }

    /// The same request for the sound from `start_s` on. All times move earlier by `start_s`.
    /// Closures, events, words and phones that end before the new start are dropped.
    #[must_use]
    pub(crate) fn after_second(&self, start_s: f64) -> MotionRequest {
        let earlier = |[start, end]: [f64; 2]| {
            let slot = [(start - start_s).max(0.0), end - start_s];
            (slot[1] > 0.0).then_some(slot)
        };
        let (closures, script) = (self.closures.as_ref(), self.script.as_ref());
        let events = self.events.iter().filter_map(|event| {
            let slot_s = earlier(event.slot_s)?;
            Some(Event {
                slot_s,
                ..event.clone()
            })
        });
        MotionRequest {
            emotion: self.emotion.after_second(start_s),
            controls: self.controls.after_second(start_s),
            closures: closures.map(|all| all.iter().copied().filter_map(earlier).collect()),
            script: script.map(|script| Arc::new(script.between(start_s, f64::INFINITY))),
            events: events.collect(),
            ..self.clone()
        }
    }
}

/// The number of the style `name` among the `styles` of a model. `None` stands for `default`.
///
/// # Errors
/// `InvalidInput` for a name that is not among them.
pub fn style_number(name: Option<&str>, styles: &[String], default: &str) -> Result<usize> {
    let name = name.unwrap_or(default);
    let number = styles.iter().position(|known| known == name);
    number.ok_or_else(|| {
        let known = styles.join(", ");
        Error::InvalidInput(format!("style: expected one of {known}, got {name:?}"))
    })
}

/// Checks that the closures are valid intervals.
///
/// # Errors
/// `InvalidInput` for a time that is not finite or below 0, or an end before its start.
pub fn check_closures(closures: &[[f64; 2]]) -> Result<()> {
    for &[start, end] in closures {
        if !(start.is_finite() && end.is_finite() && 0.0 <= start && start <= end) {
            return Err(Error::InvalidInput(format!(
                "closures: expected seconds of at least 0, the end not before the start, got {start} \
                 to {end}"
            )));
        }
    }
    Ok(())
}

/// Checks that a result can have this frame rate.
///
/// # Errors
/// `InvalidInput` for a rate outside [`FPS`].
pub fn check_fps(fps: f64) -> Result<()> {
    if FPS.contains(&fps) {
        Ok(())
    } else {
        Err(Error::InvalidInput(format!(
            "fps: expected {} to {}, got {fps}",
            FPS.start(),
            FPS.end()
        )))
    }
}
