//! Turns sound into motion, and repeats a performance with other controls.

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
    job::{ProgressFn, SILENT, report},
    motion::{
        ARTICULATION, BESIDE_THE_FACE, BREATH, EmotionOrigin, GAZE, HEAD, Life, LifeStrengths,
        Motion, MotionRequest, ONSET, Stretch, TONGUE, begin_in, begin_tongue_in,
        bounds::{check_life, check_motion},
        check_closures, check_fps,
    },
    nn::finite::check_result,
    speech::{HeardEmotion, NeutralVoice, SpeechFeatures},
    spread::{Movement, on_face},
    systems::{Ability, Sampled, check_abilities},
};

/// The range of a control that changes over time is divided into this many pieces. The effect of a
/// control on motion is close to linear in its value.
const PIECES: usize = 2;
/// A control counts as constant if its largest and smallest value differ by less than this.
const STILL: f64 = 1e-6;

/// Motion with head, gaze and tongue, and everything needed to perform it again in another way.
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
    /// Head, eyes and tongue, with as many frames as the motion.
    pub life: Life,
    /// The motion as the system made it, before any control is applied.
    pub(super) sampled: Sampled,
    pub(super) heard: Arc<SpeechFeatures>,
    /// The request. If it asks for the emotion of the voice, that emotion is filled in.
    pub(super) request: MotionRequest,
    /// The request that the system sampled with.
    sampled_with: Arc<MotionRequest>,
}

impl Performance {
    /// The strength of articulation in the request; see [`MotionRequest::articulation`].
    pub fn articulation(&self) -> f32 {
        self.request.articulation()
    }

    /// How likely each emotion is over time, in the voice or in the other recording whose emotion the
    /// face shows, with the seconds of that recording. `None` if the motion did not need it.
    pub fn heard_emotion(&self) -> Option<&HeardEmotion> {
        self.heard.heard_before()
    }

    /// Performs the same speech with other controls, another emotion, or another seed of blinks and
    /// accents. Nothing is heard again, and only another `onset` makes a system whose models have
    /// learned emotion sample again. Everything else that the system samples with stays the same: the
    /// speaker's neutral voice, the style, the frame rate, and also the emotion if the models have
    /// learned it ([`crate::systems::Description::emotion`]).
    ///
    /// # Errors
    /// `InvalidInput` for a request out of range.
    pub fn again(&self, engine: &Engine, request: &MotionRequest) -> Result<Performance> {
        engine.check(request)?;
        let request = engine.resolved(request, &self.heard, SILENT)?;
        let (mut sampled_with, onset) = (Arc::clone(&self.sampled_with), request.onset());
        let is_learned = engine.system.description().emotion == EmotionOrigin::Learned;
        engine.threads(|| {
            let sampled = if is_learned && onset != sampled_with.onset() {
                sampled_with = Arc::new(MotionRequest {
                    controls: sampled_with.controls.with(ONSET, onset),
                    ..(*sampled_with).clone()
                });
                engine.system.sample(&self.heard, &sampled_with, SILENT)?
            } else {
                self.sampled.clone()
            };
            let heard = Arc::clone(&self.heard);
            engine.finished((sampled, sampled_with), heard, request)
        })
    }

    /// Performs only the speech, without emotion. The rest of the performance, beside this layer,
    /// is the emotion. The sound is not analysed again.
    ///
    /// # Errors
    /// `InvalidInput` for a system that does not separate emotion from speech; `Cancelled`.
    pub fn content(&self, engine: &Engine, progress: ProgressFn<'_>) -> Result<Performance> {
        engine.registration.require(Ability::Emotion, "layers")?;
        let mut request = self.request.clone();
        if let Some(own) = &engine.registration.emotion {
            request.controls.set(own.layer.name, own.content);
        }
        engine.threads(|| {
            let sampled = engine.system.sample(&self.heard, &request, progress)?;
            let sampled = (sampled, Arc::new(request.clone()));
            engine.finished(sampled, Arc::clone(&self.heard), request)
        })
    }

    /// How much emotion counts compared with speech in some frames, for each vertex of a face,
    /// `[V, t]` from 0 to 1. This is `w` of EmoFace's Mesh Attention.
    ///
    /// # Errors
    /// `InvalidInput` for a system that does not separate emotion from speech, or for frames that
    /// the performance lacks; `Mesh` if the landmarks of the face lie on no usable face.
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

    /// This performance's motion, head, eyes and tongue, with `stretch` taken from `again`; see
    /// [`Motion::redone`].
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
    /// Turns speech into motion.
    ///
    /// The motion has one frame for every `1 / fps` seconds of sound or part thereof, and at least
    /// one.
    ///
    /// # Errors
    /// `Audio` for a sound too short to use or a neutral voice in which no voice is heard,
    /// `InvalidInput` for a request out of range, `Numerics` if the weights of a model give values
    /// that are not finite, `Cancelled`.
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
            if let Some(script) = &request.script {
                heard.follow(script)?;
            }
            if let Some(other) = &request.emotion_of {
                heard.hear_other(other, progress)?;
            }
            report(progress, "speech", 1.0)?;
            let request = self.resolved(request, &heard, progress)?;
            let sampled = self.system.sample(&heard, &request, progress)?;
            let sampled = (sampled, Arc::new(request.clone()));
            self.finished(sampled, Arc::new(heard), request)
        })
    }

    /// The speaker's voice without emotion, if the request has a neutral voice.
    fn neutral_voice(
        &self,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Option<NeutralVoice>> {
        let Some(voice) = &request.neutral_voice else {
            return Ok(None);
        };
        let ear = self.shared.whisper_ear.get()?;
        ear.neutral_voice(voice, progress).map(Some)
    }

    pub(super) fn check(&self, request: &MotionRequest) -> Result<()> {
        check_fps(request.fps)?;
        check_closures(request.closures.as_deref().unwrap_or_default())?;
        request.events.iter().try_for_each(Event::check)?;
        check_abilities(request, self.registration)?;
        let known = self.registration.controls();
        request.controls.check(known, ControlStage::Motion)
    }

    /// Fills in the emotion of the voice if the request asks for it. If the request names an
    /// emotion, a system that hears emotion shows the named one, unless the request has another
    /// recording to hear the emotion in.
    ///
    /// # Errors
    /// Those of [`SpeechFeatures::heard_emotion`].
    fn resolved(
        &self,
        request: &MotionRequest,
        heard: &SpeechFeatures,
        progress: ProgressFn<'_>,
    ) -> Result<MotionRequest> {
        let emotion = match &request.emotion {
            EmotionCurve::Auto => heard.emotion_curve(progress)?,
            EmotionCurve::Arousal => emotion_from_voice(&heard.prosody),
            named => named.clone(),
        };
        let mut controls = request.controls.clone();
        let by_name = request.emotion.strongest() > 0.0 && request.emotion_of.is_none();
        if let Some(own) = self.registration.emotion.as_ref().filter(|_| by_name)
            && own.source.value(&controls) == own.voice
        {
            controls.set(own.source.name, own.named);
        }
        Ok(MotionRequest {
            emotion,
            controls,
            ..request.clone()
        })
    }

    /// Applies the controls of `request` to what a system `sampled`, which comes with the request that
    /// the system sampled with.
    fn finished(
        &self,
        (sampled, sampled_with): (Sampled, Arc<MotionRequest>),
        heard: Arc<SpeechFeatures>,
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
            sampled_with,
        })
    }

    /// Head, eyes and tongue for `motion`. Head and eyes follow `emotion`, and stay still if the
    /// request asks for speech alone.
    fn life(
        &self,
        motion: &Motion,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        emotion: &EmotionCurve,
    ) -> Life {
        Life {
            tongue: self.tongue(motion, heard, request),
            ..self.head_and_eyes(motion, heard, request, emotion)
        }
    }

    /// The motion of the tongue, `[T, 4]`, 0 to 1: what was heard, scaled by the controls of the
    /// tongue and of articulation.
    fn tongue(
        &self,
        motion: &Motion,
        heard: &SpeechFeatures,
        request: &MotionRequest,
    ) -> Array2<f32> {
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
        heard: &SpeechFeatures,
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

    /// The value of a control at a time; 0 if the system has no such control.
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

    /// The value of a control; 0 if the system has no such control.
    pub(super) fn control(&self, request: &MotionRequest, name: &str) -> f32 {
        let mut known = self.registration.controls();
        let control = known.find(|control| control.name == name);
        control.map_or(0.0, |control| control.value(&request.controls))
    }

    /// Applies the controls of `request` to the sampled motion, frame by frame if they change over
    /// time. The lids follow the gaze.
    pub(super) fn controlled(
        &self,
        sampled: &Motion,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        blink_emotion: &EmotionCurve,
    ) -> Result<(Motion, Life)> {
        let base = self
            .system
            .apply_controls(sampled, heard, request, blink_emotion)?;
        let mut moved = Cow::Borrowed(&base);
        let on_motion = |control: &&Control| !BESIDE_THE_FACE.contains(&control.name);
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
        let onset = f64::from(request.onset());
        turn_eyes(&request.events, &mut life.gaze, moved.fps(), onset);
        match &mut moved {
            Motion::Landmarks(clip) => self
                .shared
                .face_modes
                .follow_gaze(&mut clip.displacements, life.gaze.view())?,
            Motion::Weights(clip) => clip.follow_gaze(&self.shared.face_modes, life.gaze.view())?,
            Motion::Codes(clip) => self
                .shared
                .face_modes
                .follow_gaze(&mut clip.landmarks.displacements, life.gaze.view())?,
        }
        let fps = moved.fps();
        if let (Some(pose), Some(clip)) = (&request.starts_from, moved.landmarks_mut()) {
            // This comes last, so that nothing else moves the start of the performance away from
            // the pose.
            begin_in(&pose.landmarks, clip.displacements.view_mut(), fps);
            begin_tongue_in(&pose.tongue, life.tongue.view_mut(), fps);
        }
        Ok((moved, life))
    }
}

/// Scales a share of the way to contact by a strength. Up to 1, the result is proportional to the
/// strength. Beyond 1, it comes ever closer to contact.
fn strengthened(share: f32, strength: f32) -> f32 {
    if strength > 1.0 {
        1.0 - (1.0 - share).powf(strength)
    } else {
        strength * share
    }
}

/// Adds to `moved` what one control changes in `base` as it follows its curve. The range from its
/// smallest to its largest value is divided into [`PIECES`]. Each frame mixes the motions at the
/// ends of its own piece.
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
    let knot = |k: usize| {
        if k == PIECES {
            high
        } else {
            low + (high - low) / PIECES as f64 * k as f64
        }
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
