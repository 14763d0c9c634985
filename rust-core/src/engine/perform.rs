//! Sound to motion, and the same performance again with other controls.

use std::{borrow::Cow, ops::Range, sync::Arc};

use ndarray::{Array2, Axis};

use super::Engine;
use crate::{
    Error, Result,
    audio::Waveform,
    conditions::{
        Control, ControlCurve, ControlStage, EmotionCurve, Event, emotion_from_voice, turn_eyes,
    },
    face::Face,
    job::{ProgressFn, report},
    motion::{
        Life, LifeStrengths, Motion, MotionRequest, Stretch, begin_in, begin_tongue_in,
        bounds::{check_life, check_motion},
        check_closures, check_fps,
    },
    nn::finite::check_result,
    speech::{Heard, HeardEmotion, NeutralVoice, UserEar},
    spread::{Movement, on_face},
    systems::{Ability, Sampled},
};

/// Pieces into which the way of a control is cut that changes over time: what controls do to motion is
/// close to linear in their value.
const PIECES: usize = 2;
/// A control whose largest and least value lie nearer together does not change.
const STILL: f64 = 1e-6;

const ARTICULATION: &str = "articulation";
/// Controls of what lives beside the face.
const HEAD: &str = "head_motion";
const GAZE: &str = "gaze";
const TONGUE: &str = "tongue";
const BREATH: &str = "breath";
/// The control by which a system that hears emotion is told where from, and its values for the voice and for the emotion
/// that is asked for.
const EMOTION_FROM: &str = "emotion_from";
const FROM_VOICE: f32 = 0.0;
const FROM_EMOTION: f32 = 1.0;
/// The control by which a system that hears emotion shows one of its layers, and its value for what is said alone.
const LAYER: &str = "layer";
const CONTENT: f32 = 1.0;

/// Motion with head, gaze and tongue, and all that is needed to perform it in another way.
///
/// ```
/// use anyface::{CachePolicy, Engine, EngineOptions, MotionRequest, audio::Waveform, job::SILENT};
///
/// let engine = Engine::new(EngineOptions { cache: CachePolicy::Off, ..Default::default() })?;
/// let sound = Waveform { samples: (0..16_000).map(|i| (i as f32 * 0.08).sin()).collect() };
/// let mut request = MotionRequest::default();
/// let plain = engine.perform(&sound, &request, SILENT)?;
/// request.controls.set("articulation", 0.0);
/// let quiet = plain.again(&engine, &request)?;
/// assert_eq!(quiet.motion.frames(), plain.motion.frames());
/// assert_ne!(quiet.motion, plain.motion);
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Clone)]
pub struct Performance {
    /// The motion.
    pub motion: Motion,
    /// Head, eyes and tongue beside it, as many frames.
    pub life: Life,
    /// As the system made it, before any control.
    pub(super) sampled: Sampled,
    pub(super) heard: Arc<Heard>,
    /// What was asked, with the emotion that was heard.
    pub(super) request: MotionRequest,
}

impl Performance {
    /// What the lips were asked for; see [`MotionRequest::articulation`].
    pub fn articulation(&self) -> f32 {
        self.request.articulation()
    }

    /// How likely each emotion is in the voice over time, as the built-in ear hears it; none where the motion does not
    /// depend on it.
    pub fn heard_emotion(&self) -> Option<&HeardEmotion> {
        self.heard.heard_before()
    }

    /// The same speech with other controls, another emotion, or seed of blinks and accents; nothing is
    /// heard or sampled again. The speaker's neutral voice, style, frame rate and whatever else the system samples with
    /// stay, among that the emotion where the models have learned it ([`crate::systems::Description::emotion`]).
    ///
    /// # Errors
    /// `InvalidInput` for a request out of range.
    pub fn again(&self, engine: &Engine, request: &MotionRequest) -> Result<Performance> {
        engine.check(request)?;
        let request = engine.resolved(request, &self.heard);
        let (sampled, heard) = (self.sampled.clone(), Arc::clone(&self.heard));
        engine.threads(|| engine.finished(sampled, heard, request))
    }

    /// What is said alone, without what is felt: the layer beside which the rest of the performance is the emotion.
    /// Nothing is heard again.
    ///
    /// # Errors
    /// `InvalidInput` for a system that does not tell them apart; `Cancelled`.
    pub fn content(&self, engine: &Engine, progress: ProgressFn<'_>) -> Result<Performance> {
        engine.registration.require(Ability::Emotion, "layers")?;
        let request = MotionRequest {
            controls: self.request.controls.with(LAYER, CONTENT),
            ..self.request.clone()
        };
        engine.threads(|| {
            let sampled = engine.system.sample(&self.heard, &request, progress)?;
            engine.finished(sampled, Arc::clone(&self.heard), request)
        })
    }

    /// How far emotion is believed beside what is said in some frames, for each vertex of a face, `[V, t]` from 0 to 1:
    /// `w` of EmoFace's Mesh Attention.
    ///
    /// # Errors
    /// `InvalidInput` for a system that does not tell them apart, or frames that the performance lacks; `Mesh` if
    /// the landmarks of the face lie on no usable face.
    pub fn emotion_mask(
        &self,
        engine: &Engine,
        face: &Face,
        frames: Range<usize>,
    ) -> Result<Array2<f32>> {
        let count = self.motion.frames();
        if frames.start > frames.end || frames.end > count {
            return Err(Error::InvalidInput(format!(
                "frames: expected some of {count}, got {frames:?}"
            )));
        }
        let Some(mask) = &self.sampled.mask else {
            engine.registration.require(Ability::Emotion, "mask")?;
            return Err(Error::InvalidInput(
                "mask: expected a performance of this engine, got one of another system".into(),
            ));
        };
        engine.threads(|| {
            let mask = mask.shares()?;
            let shares = mask.at(frames, self.motion.fps());
            on_face(face, &mask.template, shares.view())
        })
    }

    /// Motion, head, eyes and tongue with `stretch` of them as in `again`; see [`Motion::redone`].
    ///
    /// # Errors
    /// Those of [`Motion::redone`].
    pub fn redone(&self, again: &Performance, stretch: &Stretch) -> Result<(Motion, Life)> {
        let motion = self.motion.redone(&again.motion, stretch)?;
        Ok((
            motion,
            self.life.redone(&again.life, stretch, self.motion.fps())?,
        ))
    }
}

impl<'a> From<&'a Performance> for Movement<'a> {
    fn from(performance: &'a Performance) -> Movement<'a> {
        Movement::Motion(&performance.motion).with_tongue(&performance.life)
    }
}

impl Engine {
    /// Speech to motion.
    ///
    /// The motion has one frame for every started `1 / fps` seconds of sound, at least one.
    ///
    /// # Errors
    /// `Audio` for a sound too short to use or a neutral voice without a voice, `InvalidInput` for a request out of range
    /// or a neutral voice beside another's model of emotions, `Numerics` where the weights of a model lead to numbers that are none, `Cancelled`.
    pub fn perform(
        &self,
        waveform: &Waveform,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Performance> {
        self.check(request)?;
        self.threads(|| {
            let neutral_voice = self.neutral_voice(request, progress)?;
            let mut heard = self.hear(waveform, progress)?;
            heard.neutral_voice = neutral_voice;
            if self.system.description().keeps_sound {
                heard.voice = heard.voice.with_sound(waveform);
            }
            match &self.user_ear {
                Some(UserEar::Classifier(model)) => {
                    heard.emotion = Some(model.emotion(waveform, progress)?);
                }
                Some(UserEar::Whisper(ear)) => {
                    let neutral = heard.neutral_voice.as_ref();
                    let emotion = ear.heard(waveform, &heard.voice, neutral, progress)?;
                    heard.hear_emotion(emotion);
                }
                None => {}
            }
            report(progress, "speech", 1.0)?;
            let request = self.resolved(request, &heard);
            let sampled = self.system.sample(&heard, &request, progress)?;
            self.finished(sampled, Arc::new(heard), request)
        })
    }

    /// How the speaker sounds while he feels nothing, where the request says so.
    fn neutral_voice(
        &self,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Option<NeutralVoice>> {
        let Some(voice) = &request.neutral_voice else {
            return Ok(None);
        };
        match (&self.user_ear, voice.sound()) {
            (Some(UserEar::Classifier(_)), _) => Err(Error::InvalidInput(
                "neutral voice: expected the built-in ear or Whisper, got a classifier of emotions, which hears no neutral voice"
                    .into(),
            )),
            (Some(UserEar::Whisper(ear)), Some(sound)) => {
                ear.neutral_voice(sound, voice, progress).map(Some)
            }
            _ => self.ear.get()?.neutral_voice(voice).map(Some),
        }
    }

    pub(super) fn check(&self, request: &MotionRequest) -> Result<()> {
        check_fps(request.fps)?;
        check_closures(request.closures.as_deref().unwrap_or_default())?;
        request.events.iter().try_for_each(Event::check)?;
        let tasks = [
            (!request.events.is_empty(), Ability::Events, "events"),
            (
                request.emotion_of.is_some(),
                Ability::Emotion,
                "emotion of another recording",
            ),
            (
                request.starts_from.is_some(),
                Ability::FirstPose,
                "first pose",
            ),
        ];
        for (_, ability, task) in tasks.into_iter().filter(|(is_used, ..)| *is_used) {
            self.registration.require(ability, task)?;
        }
        let known = self.registration.controls();
        request.controls.check(known, ControlStage::Motion)
    }

    /// The request with the emotion that the voice has, if it asks for that one. A system that hears emotion shows an
    /// emotion that the request names, unless the request has another recording to hear the emotion in.
    fn resolved(&self, request: &MotionRequest, heard: &Heard) -> MotionRequest {
        let emotion = match &request.emotion {
            EmotionCurve::Auto => heard.emotion_curve(),
            EmotionCurve::Arousal => emotion_from_voice(&heard.prosody),
            named => named.clone(),
        };
        let mut controls = request.controls.clone();
        let by_name = request.emotion.strongest() > 0.0 && request.emotion_of.is_none();
        if by_name && self.knows(EMOTION_FROM) && self.control(request, EMOTION_FROM) == FROM_VOICE
        {
            controls.set(EMOTION_FROM, FROM_EMOTION);
        }
        MotionRequest {
            emotion,
            controls,
            ..request.clone()
        }
    }

    fn finished(
        &self,
        sampled: Sampled,
        heard: Arc<Heard>,
        request: MotionRequest,
    ) -> Result<Performance> {
        let (motion, life) =
            self.controlled(&sampled.motion, &heard, &request, &request.emotion)?;
        check_result("motion", motion.values())?;
        check_result("head", life.head.view().into_dyn())?;
        check_result("gaze", life.gaze.view().into_dyn())?;
        check_result("tongue", life.tongue.view().into_dyn())?;
        check_motion(&motion)?;
        check_life(&life)?;
        Ok(Performance {
            motion,
            life,
            sampled,
            heard,
            request,
        })
    }

    /// Head, eyes and tongue beside `motion`; head and eyes, which `emotion` carries, are still where only speech is asked
    /// for.
    fn life(
        &self,
        motion: &Motion,
        heard: &Heard,
        request: &MotionRequest,
        emotion: &EmotionCurve,
    ) -> Life {
        Life {
            tongue: self.tongue(motion, heard, request),
            ..self.head_and_eyes(motion, heard, request, emotion)
        }
    }

    /// What the tongue does, `[T, 4]`, 0 to 1: what is heard, as strong as it and all articulation are asked to be.
    fn tongue(&self, motion: &Motion, heard: &Heard, request: &MotionRequest) -> Array2<f32> {
        let (frames, fps) = (motion.frames(), motion.fps());
        let articulates = self.knows(ARTICULATION);
        let at = |t: usize| {
            let at = |name: &str| self.control_at(request, name, t as f64 / fps) as f32;
            at(TONGUE) * if articulates { at(ARTICULATION) } else { 1.0 }
        };
        let strengths: Vec<f32> = (0..frames).map(at).collect();
        let mut tongue = Life::still(frames).tongue;
        if strengths.iter().any(|strength| *strength != 0.0) {
            let heard = heard.tongue(fps);
            let rows = tongue.outer_iter_mut().zip(heard.outer_iter());
            for ((mut row, heard), strength) in rows.zip(strengths) {
                row.assign(&heard.mapv(|share| strengthened(share, strength)));
            }
        }
        tongue
    }

    fn head_and_eyes(
        &self,
        motion: &Motion,
        heard: &Heard,
        request: &MotionRequest,
        emotion: &EmotionCurve,
    ) -> Life {
        let (frames, fps) = (motion.frames(), motion.fps());
        if request.emotion == EmotionCurve::Off {
            return Life::still(frames);
        }
        let at = |name: &str, time_s: f64| self.control_at(request, name, time_s);
        let strengths = |t: usize| {
            let time_s = t as f64 / fps;
            LifeStrengths {
                head: at(HEAD, time_s),
                gaze: at(GAZE, time_s),
                breath: at(BREATH, time_s),
            }
        };
        let strengths: Vec<LifeStrengths> = (0..frames).map(strengths).collect();
        let affect = emotion.sample(frames, fps);
        Life::of_speech(&heard.prosody, affect.view(), request.seed, fps, &strengths)
    }

    /// What a control is asked to be at a time; 0 where the system has no such control.
    fn control_at(&self, request: &MotionRequest, name: &str, time_s: f64) -> f64 {
        match request.controls.animated(name) {
            Some(curve) => curve.at(time_s),
            None => f64::from(self.control(request, name)),
        }
    }

    fn knows(&self, name: &str) -> bool {
        let mut known = self.registration.controls();
        known.any(|control| control.name == name)
    }

    /// What a control is asked to be; 0 where the system has no such control.
    pub(super) fn control(&self, request: &MotionRequest, name: &str) -> f32 {
        let mut known = self.registration.controls();
        let control = known.find(|control| control.name == name);
        control.map_or(0.0, |control| control.value(&request.controls))
    }

    /// Puts the controls of `request` on what was sampled, those that change over time frame by frame; lids
    /// follow the gaze.
    pub(super) fn controlled(
        &self,
        sampled: &Motion,
        heard: &Heard,
        request: &MotionRequest,
        blink_emotion: &EmotionCurve,
    ) -> Result<(Motion, Life)> {
        let base = self
            .system
            .apply_controls(sampled, heard, request, blink_emotion)?;
        let mut moved = Cow::Borrowed(&base);
        let on_motion = |control: &&Control| ![HEAD, GAZE, TONGUE].contains(&control.name);
        for control in self.registration.controls().filter(on_motion) {
            if let Some(curve) = request.controls.animated(control.name) {
                let at = |value: f64| {
                    let controls = request.controls.with(control.name, value as f32);
                    let request = MotionRequest {
                        controls,
                        ..request.clone()
                    };
                    self.system
                        .apply_controls(sampled, heard, &request, blink_emotion)
                };
                moved = Cow::Owned(along(&base, &moved, curve, at)?);
            }
        }
        let mut moved = moved.into_owned();
        let mut life = self.life(&moved, heard, request, blink_emotion);
        turn_eyes(&request.events, &mut life.gaze, moved.fps());
        match &mut moved {
            Motion::Landmarks(clip) => self
                .face_modes
                .follow_gaze(&mut clip.displacements, life.gaze.view())?,
            Motion::Weights(clip) => clip.follow_gaze(&self.face_modes, life.gaze.view())?,
            Motion::Codes(clip) => self
                .face_modes
                .follow_gaze(&mut clip.landmarks.displacements, life.gaze.view())?,
        }
        let fps = moved.fps();
        if let (Some(pose), Some(clip)) = (&request.starts_from, moved.landmarks_mut()) {
            // Last, so that nothing that is put on a performance takes it away from the pose.
            begin_in(&pose.landmarks, clip.displacements.view_mut(), fps);
            begin_tongue_in(&pose.tongue, life.tongue.view_mut(), fps);
        }
        Ok((moved, life))
    }
}

/// A share of the way to contact under a strength: that much of it up to 1, beyond it nearer and nearer to contact.
fn strengthened(share: f32, strength: f32) -> f32 {
    match strength > 1.0 {
        true => 1.0 - (1.0 - share).powf(strength),
        false => strength * share,
    }
}

/// `moved`, and what one control changes of `base` where it follows its curve. Between its least and
/// its largest value lie [`PIECES`]; each frame mixes the motions at the ends of its own piece.
fn along(
    base: &Motion,
    moved: &Motion,
    curve: &ControlCurve,
    motion_at: impl Fn(f64) -> Result<Motion>,
) -> Result<Motion> {
    let (frames, fps) = (base.frames(), base.fps());
    let values: Vec<f64> = (0..frames).map(|t| curve.at(t as f64 / fps)).collect();
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (base, mut out) = (base.values(), moved.values().to_owned());
    if high - low < STILL {
        out += &(&motion_at(low)?.values() - &base);
        return Ok(moved.with_values(out));
    }
    let knot = |k: usize| match k == PIECES {
        true => high,
        false => low + (high - low) / PIECES as f64 * k as f64,
    };
    let motions = (0..=PIECES).map(|k| motion_at(knot(k)));
    let motions = motions.collect::<Result<Vec<_>>>()?;
    let at_knots: Vec<_> = motions.iter().map(Motion::values).collect();
    for (t, value) in values.iter().enumerate() {
        let place = (value - low) / (high - low) * PIECES as f64;
        let first = (place as usize).min(PIECES - 1);
        let share = place - first as f64;
        let frame = |k: usize| at_knots[k].index_axis(Axis(0), t);
        let ends = frame(first).into_iter().zip(frame(first + 1));
        let was = base.index_axis(Axis(0), t);
        let mut now = out.index_axis_mut(Axis(0), t);
        for (x, ((from, to), was)) in now.iter_mut().zip(ends.zip(was)) {
            let mixed = f64::from(*from) * (1.0 - share) + f64::from(*to) * share;
            *x = (f64::from(*x) + (mixed - f64::from(*was))) as f32;
        }
    }
    Ok(moved.with_values(out))
}
