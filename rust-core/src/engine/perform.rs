//! Sound to motion, and the same performance again with other controls.

use std::{borrow::Cow, sync::Arc};

use ndarray::Axis;

use super::Engine;
use crate::{
    Error, Result,
    audio::Waveform,
    conditions::{
        Control, ControlCurve, ControlStage, EmotionCurve, Event, MotionRequest, check_closures,
        check_fps, emotion_from_voice,
    },
    finite::check_result,
    motion::{Life, LifeStrengths, Motion, Stretch, begin_in},
    progress::{ProgressFn, report},
    speech::Heard,
    systems::{Registration, SYSTEMS},
};

/// Pieces into which the way of a control is cut that changes over time: what controls do to motion is
/// close to linear in their value.
const PIECES: usize = 2;
/// A control whose largest and least value lie nearer together does not change.
const STILL: f64 = 1e-6;

const FIRST_POSE: &str = "first pose: expected a system that goes on from one";
/// Controls of what lives beside the face.
const HEAD: &str = "head_motion";
const GAZE: &str = "gaze";
const BREATH: &str = "breath";

/// Motion with head and gaze, and all that is needed to perform it in another way.
///
/// ```
/// use anyface::{CachePolicy, Engine, EngineOptions, MotionRequest, audio::Waveform, progress::SILENT};
///
/// let engine = Engine::new(EngineOptions { cache: CachePolicy::Off, ..Default::default() })?;
/// let sound = Waveform { samples: (0..16_000).map(|i| (i as f32 * 0.08).sin()).collect() };
/// let mut request = MotionRequest::default();
/// let plain = engine.perform(&sound, &request, SILENT)?;
/// request.controls.set("articulation", 0.0);
/// let quiet = engine.perform_again(&plain, &request)?;
/// assert_eq!(quiet.motion.frames(), plain.motion.frames());
/// assert_ne!(quiet.motion, plain.motion);
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Clone)]
pub struct Performance {
    /// The motion.
    pub motion: Motion,
    /// Head and eyes beside it, as many frames.
    pub life: Life,
    /// As the system made it, before any control.
    pub(super) sampled: Motion,
    pub(super) heard: Arc<Heard>,
    /// What was asked, with the emotion that was heard.
    pub(super) request: MotionRequest,
}

impl Performance {
    /// What the lips were asked for, the mean over all keys where that changes; 1 is normal.
    pub fn articulation(&self) -> f32 {
        const NAME: &str = "articulation";
        let controls = &self.request.controls;
        let Some(curve) = controls.animated(NAME) else {
            return controls.get(NAME).unwrap_or(1.0);
        };
        let sum: f64 = curve.keys.iter().map(|(_, value)| value).sum();
        (sum / curve.keys.len() as f64) as f32
    }

    /// Motion, head and eyes with `stretch` of them as in `again`; see [`Motion::redone`].
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

impl Engine {
    /// Speech to motion.
    ///
    /// The motion has one frame for every started `1 / fps` seconds of sound, at least one.
    ///
    /// # Errors
    /// `Audio` for a sound too short to use, `InvalidInput` for a request out of range, `Numerics` where the
    /// weights of a model lead to numbers that are none, `Cancelled`.
    pub fn perform(
        &self,
        waveform: &Waveform,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Performance> {
        self.check(request)?;
        self.threads(|| {
            report(progress, "speech", 0.0)?;
            let mut heard = Heard::of(waveform, &self.encoder)?;
            if self.system.hears_feeling_in_sound() {
                heard.voice = heard.voice.with_sound(waveform);
            }
            if let Some(model) = &self.emotion_model {
                heard.emotion = Some(model.emotion(waveform)?);
            }
            report(progress, "speech", 1.0)?;
            let request = self.resolved(request, &heard);
            let sampled = self.system.sample(&heard, &request, progress)?;
            self.finished(sampled, Arc::new(heard), request)
        })
    }

    /// The same speech with other controls, another emotion, or seed of blinks and accents; nothing is
    /// heard or sampled again. Style, frame rate and whatever else the system samples with stay, among
    /// that the emotion where [`crate::systems::System::samples_emotion`].
    ///
    /// # Errors
    /// `InvalidInput` for a request out of range.
    pub fn perform_again(
        &self,
        performance: &Performance,
        request: &MotionRequest,
    ) -> Result<Performance> {
        self.check(request)?;
        let request = self.resolved(request, &performance.heard);
        let (sampled, heard) = (performance.sampled.clone(), Arc::clone(&performance.heard));
        self.threads(|| self.finished(sampled, heard, request))
    }

    fn check(&self, request: &MotionRequest) -> Result<()> {
        check_fps(request.fps)?;
        check_closures(request.closures.as_deref().unwrap_or_default())?;
        self.check_events(&request.events)?;
        let expected = "feeling of another recording: expected a system that hears it";
        self.able(request.felt_as.is_none(), expected, |system| {
            system.hears_feeling
        })?;
        self.able(request.starts_from.is_none(), FIRST_POSE, |system| {
            system.starts_from_pose
        })?;
        let known = self.registration.controls();
        request.controls.check(known, ControlStage::Motion)
    }

    fn check_events(&self, events: &[Event]) -> Result<()> {
        events.iter().try_for_each(Event::check)?;
        self.able(
            events.is_empty(),
            "events: expected a system that shows them",
            |system| system.takes_events,
        )
    }

    /// Whether nothing is asked that this system cannot do.
    fn able(
        &self,
        is_asked_nothing: bool,
        expected: &str,
        can: fn(&Registration) -> bool,
    ) -> Result<()> {
        if is_asked_nothing || can(self.registration) {
            return Ok(());
        }
        let able = SYSTEMS.iter().filter(|system| can(system));
        let able: Vec<&str> = able.map(|system| system.name).collect();
        let (able, name) = (able.join(", "), self.registration.name);
        Err(Error::InvalidInput(format!(
            "{expected} ({able}), got {name}"
        )))
    }

    /// The request with the emotion that is heard in the voice.
    fn resolved(&self, request: &MotionRequest, heard: &Heard) -> MotionRequest {
        let emotion = match &request.emotion {
            EmotionCurve::Auto => match &heard.emotion {
                Some(emotion) => emotion.clone(),
                None => self.feeling.emotion(&heard.voice),
            },
            EmotionCurve::Arousal => emotion_from_voice(&heard.prosody),
            given => given.clone(),
        };
        MotionRequest {
            emotion,
            ..request.clone()
        }
    }

    fn finished(
        &self,
        sampled: Motion,
        heard: Arc<Heard>,
        request: MotionRequest,
    ) -> Result<Performance> {
        let (motion, life) = self.controlled(&sampled, &heard, &request, &request.emotion)?;
        check_result("motion", motion.values())?;
        check_result("head", life.head.view().into_dyn())?;
        check_result("gaze", life.gaze.view().into_dyn())?;
        Ok(Performance {
            motion,
            life,
            sampled,
            heard,
            request,
        })
    }

    /// Head and eyes beside `motion`; still where only speech is asked for.
    fn life(&self, motion: &Motion, heard: &Heard, request: &MotionRequest) -> Life {
        let (frames, fps) = (motion.frames(), motion.fps());
        if request.emotion == EmotionCurve::Off {
            return Life::still(frames);
        }
        let at = |name: &str, time_s: f64| match request.controls.animated(name) {
            Some(curve) => curve.at(time_s),
            None => f64::from(self.control(request, name)),
        };
        let strengths = |t: usize| {
            let time_s = t as f64 / fps;
            LifeStrengths {
                head: at(HEAD, time_s),
                gaze: at(GAZE, time_s),
                breath: at(BREATH, time_s),
            }
        };
        let strengths: Vec<LifeStrengths> = (0..frames).map(strengths).collect();
        Life::perform(&heard.prosody, request.seed, fps, &strengths)
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
            .perform(sampled, heard, request, blink_emotion)?;
        let mut moved = Cow::Borrowed(&base);
        let on_motion = |control: &&Control| ![HEAD, GAZE].contains(&control.name);
        for control in self.registration.controls().filter(on_motion) {
            if let Some(curve) = request.controls.animated(control.name) {
                let at = |value: f64| {
                    let controls = request.controls.with(control.name, value as f32);
                    let request = MotionRequest {
                        controls,
                        ..request.clone()
                    };
                    self.system.perform(sampled, heard, &request, blink_emotion)
                };
                moved = Cow::Owned(along(&base, &moved, curve, at)?);
            }
        }
        let mut moved = moved.into_owned();
        let life = self.life(&moved, heard, request);
        match &mut moved {
            Motion::Landmarks(clip) => self
                .face_modes
                .follow_gaze(&mut clip.displacements, life.gaze.view())?,
            Motion::Weights(clip) => clip.follow_gaze(&self.face_modes, life.gaze.view())?,
            Motion::Codes(clip) => self
                .face_modes
                .follow_gaze(&mut clip.landmarks.displacements, life.gaze.view())?,
            Motion::Template(_) => {}
        }
        let fps = moved.fps();
        if let (Some(pose), Some(clip)) = (&request.starts_from, moved.landmarks_mut()) {
            // Last, so that nothing that is put on a performance takes it away from the pose.
            begin_in(pose, clip.displacements.view_mut(), fps);
        }
        Ok((moved, life))
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
