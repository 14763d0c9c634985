//! Turns speech into motion, before any mesh is known.

use std::{ffi::CString, sync::Arc};

use anyface::{
    MotionRequest, Performance,
    conditions::{Emotion, EmotionCurve, Event},
    job::ProgressFn,
    mesh::ibug::LANDMARKS,
    motion::{LandmarkClip, Life, Motion, Pose, Stretch, bounds::DISPLACEMENT, check_fps},
    speech::{Script, VoiceTrack},
    spread::pose_on,
};
use libc::c_char;
use ndarray::{ArrayView2, ArrayView3};

use crate::{
    audio::AnyfaceAudio,
    controls::{self, AnyfaceControlSetting},
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    events::AnyfaceEvents,
    face::AnyfaceFace,
    guard,
    pointer::{self, handles},
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
    version::ANYFACE_EMOTION_COUNT,
    versioned_options::{self, Versioned},
};

/// Motion before any mesh is known: of landmarks, or of whatever else the system moves. It fits
/// every face and never changes once it is made.
pub struct AnyfaceMotion {
    pub(crate) source: MotionSource,
    /// Names of the weights, if the motion consists of weights.
    pub(crate) names: Vec<CString>,
    /// The emotion that was heard, as JSON, if the motion depends on it.
    pub(crate) heard_emotion: Option<CString>,
}

/// Where a motion comes from.
pub(crate) enum MotionSource {
    /// Made from speech, with everything needed to vary it.
    Spoken(Box<Performance>),
    /// Made from other motion: a stretch of it was made again, or it is a range of its frames.
    Redone(Motion, Box<Life>),
    /// Handed in by the caller. The tongue rests, except in a pose.
    Imported(Motion, Box<Life>),
}

impl MotionSource {
    fn motion(&self) -> &Motion {
        match self {
            MotionSource::Spoken(performance) => &performance.motion,
            MotionSource::Redone(motion, _) | MotionSource::Imported(motion, _) => motion,
        }
    }
}

impl AnyfaceMotion {
    pub(crate) fn new(source: MotionSource) -> AnyfaceMotion {
        let names = AnyfaceMotion::shape_names(source.motion());
        let heard = match &source {
            MotionSource::Spoken(performance) => performance.heard_emotion(),
            MotionSource::Redone(..) | MotionSource::Imported(..) => None,
        };
        AnyfaceMotion {
            heard_emotion: heard.map(|heard| pointer::c_text(&heard.to_json())),
            source,
            names,
        }
    }

    /// Wraps a motion that the caller hands in. Its head, eyes and tongue rest.
    pub(crate) fn import(motion: Motion) -> AnyfaceMotion {
        let life = Box::new(Life::still(motion.frames()));
        AnyfaceMotion::new(MotionSource::Imported(motion, life))
    }

    /// The motion itself.
    pub(crate) fn motion(&self) -> &Motion {
        self.source.motion()
    }
    /// The performance, if the motion comes from speech.
    pub(crate) fn performance(&self) -> Option<&Performance> {
        match &self.source {
            MotionSource::Spoken(performance) => Some(performance),
            MotionSource::Redone(..) | MotionSource::Imported(..) => None,
        }
    }

    /// Motion of head, eyes and tongue. Head and eyes rest if the caller handed in the motion.
    pub(crate) fn life(&self) -> &Life {
        match &self.source {
            MotionSource::Spoken(performance) => &performance.life,
            MotionSource::Redone(_, life) | MotionSource::Imported(_, life) => life,
        }
    }

    /// The performance, or an error if the motion does not come from speech.
    pub(crate) fn spoken(&self) -> Result<&Performance, Failure> {
        self.performance().ok_or_else(|| {
            Failure::invalid(
                "motion: expected motion of a sound, got motion of the caller or a stretch that was made again",
            )
        })
    }

    /// Copies values of a motion into the caller's buffer. `float_count` must be their exact number.
    ///
    /// # Safety
    /// `motion` is NULL or a motion that is not freed during the call. For `buffer` and `error` see
    /// [`guard::copy`].
    pub(crate) unsafe fn copy(
        motion: *const AnyfaceMotion,
        buffer: *mut f32,
        float_count: usize,
        error: *mut *mut AnyfaceError,
        values: impl FnOnce(&AnyfaceMotion) -> Result<Vec<f32>, Failure>,
    ) -> AnyfaceStatus {
        let values = || values(unsafe { pointer::handle("motion", motion) }?);
        unsafe { guard::copy(buffer, float_count, error, values) }
    }

    pub(crate) fn landmarks(&self) -> Result<&LandmarkClip, Failure> {
        let motion = self.motion();
        motion.landmarks().ok_or_else(|| {
            Failure::invalid(format!(
                "motion: expected motion of landmarks, got {}",
                motion.kind()
            ))
        })
    }
}

/// The source of a performance's emotion; for `AnyfaceMotionOptions`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceEmotionSource {
    /// `emotion_strengths`; the default.
    Given = 0,
    /// The emotion that is heard in the voice: anger, joy, fear, sadness, disgust, calm, or none
    /// where that is not certain.
    Voice = 1,
    /// No emotion, and no other motion that speech does not cause: no blinks, no motion of brows
    /// and lids.
    Off = 2,
    /// Arousal: how excited the voice sounds, not which emotion it has. Glad, afraid and angry
    /// voices all widen the eyes and raise the brows.
    Arousal = 3,
}

/// Options of a performance. Prepare them with `anyface_motion_options_init()`.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct AnyfaceMotionOptions {
    /// Size in bytes of this struct in the caller's header; set by `anyface_motion_options_init()`.
    pub struct_size: usize,
    /// `[emotion_count, ANYFACE_EMOTION_COUNT]`: strength of each emotion, 0 or more. Each row sums
    /// to at most 1.5. NULL with a count of 0, the default, is neutral throughout.
    pub emotion_strengths: *const f32,
    /// `[emotion_count]`: the times of the rows, seconds, rising. Strengths are linear between the
    /// rows and constant before the first and after the last. May be NULL if there is only one row,
    /// which then applies throughout.
    pub emotion_times_s: *const f64,
    /// Number of rows.
    pub emotion_count: usize,
    /// Frames per second of the result, 1 to 240; default 30.
    pub fps: f64,
    /// The same seed gives the same motion; default 0. It determines blinks, brow accents, head,
    /// gaze and variety, and the noise of models that sample with noise. The built-in one uses none.
    pub seed: u64,
    /// Name of the speaking style, UTF-8. NULL, the default, takes the model's own style.
    pub style: *const c_char,
    /// An `AnyfaceEmotionSource`; default `ANYFACE_EMOTION_SOURCE_GIVEN`. With any other source,
    /// `emotion_count` must be 0.
    pub emotion_source: i32,
    /// Must be 0.
    pub reserved: u32,
    /// `[control_count]`: settings of the system's controls that act on a performance, such as
    /// "articulation". All other controls have their defaults. May be NULL if there are none.
    pub controls: *const AnyfaceControlSetting,
    /// Number of settings in `controls`.
    pub control_count: usize,
    /// `[closure_count, 2]`: start and end in seconds of the intervals in which the lips are
    /// together, in rising order. Only used if `has_closures` is 1; see
    /// `anyface_sounds_copy_closures()`.
    pub closures_s: *const f64,
    /// Number of intervals. It must be 0 if `has_closures` is 0. If `has_closures` is 1, a count
    /// of 0 means that the lips never close.
    pub closure_count: usize,
    /// 1: the lips close in these intervals. 0, the default: they close where that is heard.
    pub has_closures: i32,
    /// Must be 0.
    pub reserved_2: u32,
    /// Events that the face has to show. The handle is used only until the call returns. NULL, the
    /// default, means none. A system that cannot show events refuses them: see
    /// `anyface_system_takes_events()`.
    pub events: *const AnyfaceEvents,
    /// Another recording whose emotion the face shows. The handle is used only until the call
    /// returns. NULL, the default, takes the voice itself. A system that does not hear emotion
    /// refuses it: see `anyface_system_hears_emotion()`.
    pub emotion_of: *const AnyfaceAudio,
    /// A motion of landmarks. The face and its tongue start in the pose of its last frame. The
    /// handle is used only until the call returns. NULL, the default, starts at rest. A system that
    /// cannot start from a pose refuses it: see `anyface_system_starts_from_pose()`.
    pub starts_from: *const AnyfaceMotion,
    /// A recording in which the same person speaks neutrally, ten seconds or more. The handle is
    /// used only until the call returns. The emotion of the voice is then heard as the difference
    /// from this recording. NULL, the default, compares the voice with people reading aloud.
    pub neutral_voice: *const AnyfaceAudio,
    /// The words that are spoken, UTF-8. Their places are found in the sound, and the mouth then shows
    /// their sounds. NULL, the default, takes what is heard alone.
    pub text: *const c_char,
}

unsafe impl Versioned for AnyfaceMotionOptions {
    const NAME: &'static str = "anyface_motion_options";
    const FIRST_SIZE: usize = std::mem::offset_of!(AnyfaceMotionOptions, closures_s);
    fn defaults() -> Self {
        let MotionRequest { fps, seed, .. } = MotionRequest::default();
        AnyfaceMotionOptions {
            struct_size: size_of::<Self>(),
            fps,
            seed,
            emotion_source: AnyfaceEmotionSource::Given as i32,
            ..Self::zero()
        }
    }
}

impl AnyfaceMotionOptions {
    /// # Safety
    /// Every pointer is NULL or as the doc comment of its field says.
    pub(crate) unsafe fn to_library(self) -> Result<MotionRequest, Failure> {
        for reserved in [self.reserved, self.reserved_2] {
            if reserved != 0 {
                let message = format!("reserved: expected 0, got {reserved}");
                return Err(Failure::invalid(message));
            }
        }
        let style = unsafe { pointer::optional_text("style", self.style) }?;
        let text = unsafe { pointer::optional_text("text", self.text) }?;
        Ok(MotionRequest {
            emotion: unsafe { self.emotion() }?,
            fps: self.fps,
            seed: self.seed,
            style: style.map(str::to_owned),
            controls: unsafe { controls::read(self.controls, self.control_count) }?,
            closures: unsafe { self.closures() }?,
            script: text.map(|text| Arc::new(Script::Text(text.to_owned()))),
            events: unsafe { self.events() }?,
            emotion_of: unsafe { self.emotion_of() }?,
            neutral_voice: unsafe { self.neutral_voice() }?,
            starts_from: unsafe { self.starts_from() }?,
        })
    }

    unsafe fn starts_from(&self) -> Result<Option<Pose>, Failure> {
        if self.starts_from.is_null() {
            return Ok(None);
        }
        let whole = unsafe { pointer::handle("starts_from", self.starts_from) }?;
        let motion = whole.motion();
        let clip = motion.landmarks();
        let last = clip.and_then(|clip| clip.displacements.outer_iter().last());
        let last = last.zip(whole.life().tongue.outer_iter().last());
        let (landmarks, tongue) = last.ok_or_else(|| {
            let (frames, kind) = (motion.frames(), motion.kind());
            Failure::invalid(format!(
                "starts_from: expected frames of landmarks, got {frames} of {kind}"
            ))
        })?;
        Ok(Some(Pose::of_frame(landmarks, tongue)))
    }

    unsafe fn emotion_of(&self) -> Result<Option<Arc<VoiceTrack>>, Failure> {
        if self.emotion_of.is_null() {
            return Ok(None);
        }
        let sound = unsafe { pointer::handle("emotion_of", self.emotion_of) }?;
        Ok(Some(Arc::new(VoiceTrack::checked(&sound.0)?)))
    }

    unsafe fn neutral_voice(&self) -> Result<Option<Arc<VoiceTrack>>, Failure> {
        if self.neutral_voice.is_null() {
            return Ok(None);
        }
        let sound = unsafe { pointer::handle("neutral_voice", self.neutral_voice) }?;
        Ok(Some(Arc::new(VoiceTrack::neutral(&sound.0)?)))
    }

    unsafe fn events(&self) -> Result<Vec<Event>, Failure> {
        if self.events.is_null() {
            Ok(Vec::new())
        } else {
            Ok(unsafe { pointer::handle("events", self.events) }?
                .rows
                .clone())
        }
    }

    unsafe fn closures(&self) -> Result<Option<Vec<[f64; 2]>>, Failure> {
        let count = self.closure_count;
        match self.has_closures {
            0 if count == 0 => Ok(None),
            0 => Err(Failure::invalid(format!(
                "closure_count: expected 0 where has_closures is 0, got {count}"
            ))),
            1 => {
                let times = unsafe { pointer::slice("closures_s", self.closures_s, count, 2) }?;
                Ok(Some(times.as_chunks::<2>().0.to_vec()))
            }
            other => Err(Failure::invalid(format!(
                "has_closures: expected 0 or 1, got {other}"
            ))),
        }
    }

    unsafe fn emotion(&self) -> Result<EmotionCurve, Failure> {
        use AnyfaceEmotionSource::{Arousal, Given, Off, Voice};
        let known = [Given, Voice, Off, Arousal].map(|source| (source as i32, source));
        let source = pointer::one_of("emotion_source", self.emotion_source, known)?;
        match (source, self.emotion_count) {
            (Given, _) => unsafe { self.given_emotion() },
            (Voice, 0) => Ok(EmotionCurve::Auto),
            (Off, 0) => Ok(EmotionCurve::Off),
            (Arousal, 0) => Ok(EmotionCurve::Arousal),
            (_, rows) => Err(Failure::invalid(format!(
                "emotion_count: expected 0 where the emotion is not given, got {rows}"
            ))),
        }
    }

    unsafe fn given_emotion(&self) -> Result<EmotionCurve, Failure> {
        let (rows, columns) = (self.emotion_count, ANYFACE_EMOTION_COUNT);
        let values =
            unsafe { pointer::slice("emotion_strengths", self.emotion_strengths, rows, columns) }?;
        let emotions = values
            .as_chunks::<ANYFACE_EMOTION_COUNT>()
            .0
            .iter()
            .map(|row| Emotion::from_strengths(*row))
            .collect::<Result<Vec<_>, _>>()?;
        match emotions.as_slice() {
            [] => Ok(EmotionCurve::default()),
            [only] if self.emotion_times_s.is_null() => Ok(EmotionCurve::Constant(*only)),
            _ => {
                let times =
                    unsafe { pointer::slice("emotion_times_s", self.emotion_times_s, rows, 1) }?;
                check_rising(times)?;
                Ok(EmotionCurve::Keys(
                    times.iter().copied().zip(emotions).collect(),
                ))
            }
        }
    }
}

fn check_rising(times: &[f64]) -> Result<(), Failure> {
    let finite = times.iter().all(|time| time.is_finite());
    if finite && times.windows(2).all(|pair| pair[0] < pair[1]) {
        Ok(())
    } else {
        Err(Failure::invalid(format!(
            "emotion_times_s: expected finite times, each above the one before, got {times:?}"
        )))
    }
}

/// Sets every option to its default. `struct_size` is `sizeof *options`.
///
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `options` is NULL, or with
/// `ANYFACE_STATUS_INVALID_INPUT` for a size that no version had.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_options_init(
    options: *mut AnyfaceMotionOptions,
    struct_size: usize,
) -> AnyfaceStatus {
    unsafe { versioned_options::init(options, struct_size) }
}

/// Turns speech into motion. Long: accepts a progress handle.
///
/// `options` and `progress` may be NULL. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use, `ANYFACE_STATUS_INVALID_INPUT`
/// for an option out of range, `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_new(
    engine: *const AnyfaceEngine,
    audio: *const AnyfaceAudio,
    options: *const AnyfaceMotionOptions,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, audio) = handles!(engine, audio);
        let request = unsafe { versioned_options::read(options)?.to_library() }?;
        let perform = |watch: ProgressFn<'_>| engine.0.perform(&audio.0, &request, watch);
        let performance = unsafe { watched(progress, perform) }?;
        Ok(AnyfaceMotion::new(MotionSource::Spoken(Box::new(
            performance,
        ))))
    };
    unsafe { guard::give(out, error, make) }
}

/// Performs the same speech with other controls, another emotion, or another seed of blinks and
/// accents. It takes only milliseconds, because nothing is heard or sampled again.
///
/// Style, frame rate and everything else that the system samples with stay those of `motion`. If
/// the models have learned emotion themselves (the built-in ones have not), the emotion that they
/// show stays too. `options` may be NULL. Free with `anyface_motion_free()`; `motion` may be freed
/// first.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a motion that the caller brought or that was
/// redone or cut from another one, or for an option out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_new_again(
    engine: *const AnyfaceEngine,
    motion: *const AnyfaceMotion,
    options: *const AnyfaceMotionOptions,
    out: *mut *mut AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, motion) = handles!(engine, motion);
        let request = unsafe { versioned_options::read(options)?.to_library() }?;
        let again = motion.spoken()?.again(&engine.0, &request)?;
        Ok(AnyfaceMotion::new(MotionSource::Spoken(Box::new(again))))
    };
    unsafe { guard::give(out, error, make) }
}

/// Performs only the speech of a motion, without the emotion. The sound is the same and is not
/// heard again. The clip of `motion` minus the clip of the result, by
/// `anyface_clip_new_difference()`, is the emotion. Long: accepts a progress handle.
///
/// `progress` may be NULL. Free with `anyface_motion_free()`; `motion` may be freed first.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a motion that the caller brought or that was
/// redone or cut from another one, or for a system that does not separate emotion from speech (see
/// `anyface_system_hears_emotion()`), and with `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_new_content(
    engine: *const AnyfaceEngine,
    motion: *const AnyfaceMotion,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, motion) = handles!(engine, motion);
        let performance = motion.spoken()?;
        let perform = |watch: ProgressFn<'_>| performance.content(&engine.0, watch);
        let performance = unsafe { watched(progress, perform) }?;
        Ok(AnyfaceMotion::new(MotionSource::Spoken(Box::new(
            performance,
        ))))
    };
    unsafe { guard::give(out, error, make) }
}

/// Copies `motion` with one stretch replaced by that of `again`, which was made from the same sound
/// in another way: with another seed, emotion, controls or closures.
///
/// Frames at or before `start_s` and at or after `end_s` stay the same bit for bit. At both ends of
/// the stretch the old and the new motion are blended within a tenth of a second, or within a
/// quarter of the stretch if that is less. An end at the start or end of the sound is not blended.
/// Head, eyes and tongue are replaced too. Free with `anyface_motion_free()`; both motions may be
/// freed first. The result cannot be performed again.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that hold no frame, for motion of another
/// kind, frame rate or length, or for motion that the caller brought.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_new_redone(
    motion: *const AnyfaceMotion,
    again: *const AnyfaceMotion,
    start_s: f64,
    end_s: f64,
    out: *mut *mut AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (motion, again) = handles!(motion, again);
        let is_imported =
            |motion: &AnyfaceMotion| matches!(motion.source, MotionSource::Imported(..));
        if is_imported(motion) || is_imported(again) {
            let message = "motion: expected motion of a sound, got motion of the caller";
            return Err(Failure::invalid(message));
        }
        let stretch = Stretch::new(start_s, end_s)?;
        let moved = motion.motion().redone(again.motion(), &stretch)?;
        let life = motion.life().redone(again.life(), &stretch, moved.fps())?;
        Ok(AnyfaceMotion::new(MotionSource::Redone(
            moved,
            Box::new(life),
        )))
    };
    unsafe { guard::give(out, error, make) }
}

/// Copies `count` frames of a motion from frame `first` on, including head, eyes and tongue.
///
/// Free with `anyface_motion_free()`; `motion` may be freed first. The result cannot be performed
/// again. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a count of 0, or for frames that the motion
/// does not have.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_new_frames(
    motion: *const AnyfaceMotion,
    first: usize,
    count: usize,
    out: *mut *mut AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let motion = unsafe { pointer::handle("motion", motion) }?;
        let frames = motion.motion().frames();
        let end = first.saturating_add(count);
        if count == 0 || end > frames {
            return Err(Failure::invalid(format!(
                "frames: expected some of {frames}, got {count} from {first} on"
            )));
        }
        let moved = motion.motion().frames_of(first..end);
        let life = motion.life().frames_of(first..end);
        let source = MotionSource::Redone(moved, Box::new(life));
        Ok(AnyfaceMotion::new(source))
    };
    unsafe { guard::give(out, error, make) }
}

/// Makes a motion from the caller's own displacements: from a tracker, or edited. The array is
/// copied.
///
/// `displacements`: `[frame_count, 68, 3]` from the neutral face, canonical metres.
/// `fps`: frames per second, 1 to 240. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if there are no frames, if a value is not finite or
/// beyond 10 metres, or if the frame rate is out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_new_displacements(
    displacements: *const f32,
    frame_count: usize,
    fps: f64,
    out: *mut *mut AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let columns = LANDMARKS * 3;
        let values =
            unsafe { pointer::slice("displacements", displacements, frame_count, columns) }?;
        let motion = motion_from(values, frame_count, fps)?;
        Ok(AnyfaceMotion::import(motion))
    };
    unsafe { guard::give(out, error, make) }
}

/// Makes a motion of one frame from the pose of a face whose vertices are displaced. Pass it as
/// `starts_from` of `AnyfaceMotionOptions`. The array is copied.
///
/// `displacements`: `[vertex_count, 3]` from the face at rest, mesh units and axes. The pose keeps
/// the landmarks. If the face has a tongue that moves by itself, it also keeps the tongue's motion
/// relative to the jaw. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if `vertex_count` is not the face's number of
/// vertices, or if a value is not finite.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_new_pose(
    face: *const AnyfaceFace,
    displacements: *const f32,
    vertex_count: usize,
    out: *mut *mut AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let face = &unsafe { pointer::handle("face", face) }?.0;
        let values = unsafe { pointer::slice("displacements", displacements, vertex_count, 3) }?;
        let moved = ArrayView2::from_shape((vertex_count, 3), values)
            .map_err(|error| Failure::invalid(format!("displacements: {error}")))?;
        let pose = pose_on(face, moved)?;
        let life = Life {
            tongue: ndarray::arr2(&[pose.tongue]),
            ..Life::still(1)
        };
        let landmarks = pose.landmarks.as_flattened();
        let displacements = ArrayView3::from_shape((1, LANDMARKS, 3), landmarks)
            .map_err(|error| Failure::invalid(format!("displacements: {error}")))?;
        let clip = LandmarkClip {
            displacements: displacements.to_owned(),
            fps: MotionRequest::default().fps,
        };
        let source = MotionSource::Imported(Motion::Landmarks(clip), Box::new(life));
        Ok(AnyfaceMotion::new(source))
    };
    unsafe { guard::give(out, error, make) }
}

fn motion_from(values: &[f32], frames: usize, fps: f64) -> Result<Motion, Failure> {
    if frames == 0 {
        return Err(Failure::invalid(
            "displacements: expected at least one frame, got none",
        ));
    }
    if let Some(i) = values.iter().position(|x| !x.is_finite()) {
        let (frame, landmark) = (i / (LANDMARKS * 3), i / 3 % LANDMARKS);
        let message = format!("displacements: not finite at frame {frame}, landmark {landmark}");
        return Err(Failure::invalid(message));
    }
    check_fps(fps)?;
    DISPLACEMENT.check(values)?;
    let shape = (frames, LANDMARKS, 3);
    let displacements = ArrayView3::from_shape(shape, values)
        .map_err(|error| Failure::invalid(format!("displacements: {error}")))?
        .to_owned();
    Ok(Motion::Landmarks(LandmarkClip { displacements, fps }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controls::tests::setting;
    use anyface::audio::Waveform;
    use std::ptr::null;

    fn with_emotions(strengths: &[f32], times: &[f64]) -> Result<EmotionCurve, Failure> {
        let options = AnyfaceMotionOptions {
            emotion_strengths: strengths.as_ptr(),
            emotion_times_s: if times.is_empty() {
                null()
            } else {
                times.as_ptr()
            },
            emotion_count: strengths.len() / ANYFACE_EMOTION_COUNT,
            ..Versioned::defaults()
        };
        unsafe { options.emotion() }
    }

    #[test]
    fn defaults_are_the_librarys() {
        let options: AnyfaceMotionOptions = Versioned::defaults();
        assert_eq!(
            unsafe { options.to_library() }.unwrap(),
            MotionRequest::default()
        );
    }

    #[test]
    fn emotion_from_the_voice_or_off_takes_no_rows() {
        let from = |emotion_source| AnyfaceMotionOptions {
            emotion_source,
            ..Versioned::defaults()
        };
        assert_eq!(unsafe { from(1).emotion() }.unwrap(), EmotionCurve::Auto);
        assert_eq!(unsafe { from(2).emotion() }.unwrap(), EmotionCurve::Off);
        assert_eq!(unsafe { from(3).emotion() }.unwrap(), EmotionCurve::Arousal);
        assert!(unsafe { from(4).emotion() }.is_err());
        let rows = [0.0; ANYFACE_EMOTION_COUNT];
        let both = AnyfaceMotionOptions {
            emotion_strengths: rows.as_ptr(),
            emotion_count: 1,
            ..from(2)
        };
        assert!(unsafe { both.emotion() }.is_err());
    }

    #[test]
    fn frames_of_a_motion_have_their_head_and_eyes() {
        let values: Vec<f32> = (0..5 * LANDMARKS * 3).map(|i| i as f32 / 1024.0).collect();
        let life = Life {
            head: ndarray::Array2::from_shape_fn((5, 3), |(t, _)| t as f32),
            gaze: ndarray::Array3::zeros((5, 2, 2)),
            tongue: ndarray::Array2::zeros((5, 4)),
        };
        let whole = AnyfaceMotion::new(MotionSource::Redone(
            motion_from(&values, 5, 30.0).unwrap(),
            Box::new(life),
        ));
        let (mut part, mut error) = (std::ptr::null_mut(), std::ptr::null_mut());
        let status = unsafe { anyface_motion_new_frames(&whole, 1, 3, &mut part, &mut error) };
        assert_eq!(status, AnyfaceStatus::Ok);
        let part = unsafe { Box::from_raw(part) };
        let clip = part.motion().landmarks().unwrap();
        assert_eq!(clip.displacements.dim(), (3, LANDMARKS, 3));
        assert_eq!(
            clip.displacements[[0, 0, 0]],
            (LANDMARKS * 3) as f32 / 1024.0
        );
        assert_eq!(part.life().head.column(0).to_vec(), [1.0, 2.0, 3.0]);
        for (first, count) in [(3, 3), (0, 0), (usize::MAX, 2)] {
            let mut none = std::ptr::null_mut();
            let status =
                unsafe { anyface_motion_new_frames(&whole, first, count, &mut none, &mut error) };
            assert_eq!(status, AnyfaceStatus::InvalidInput);
            assert!(none.is_null());
            drop(unsafe { Box::from_raw(error) });
        }
    }

    #[test]
    fn controls_reach_the_library() {
        let controls = [setting(c"articulation", 1.5)];
        let options = AnyfaceMotionOptions {
            controls: controls.as_ptr(),
            control_count: 1,
            ..Versioned::defaults()
        };
        let request = unsafe { options.to_library() }.unwrap();
        assert_eq!(request.controls.get("articulation"), Some(1.5));
    }

    #[test]
    fn events_reach_the_library_and_an_older_program_has_none() {
        let events = AnyfaceEvents::new(vec![Event::parse("1-2:45L").unwrap()]);
        let mut options = AnyfaceMotionOptions {
            events: &events,
            ..Versioned::defaults()
        };
        let request = unsafe { options.to_library() }.unwrap();
        assert_eq!(request.events, events.rows);
        // A header from before events existed ends where `events` begins.
        options.struct_size = std::mem::offset_of!(AnyfaceMotionOptions, events);
        let read: AnyfaceMotionOptions = unsafe { versioned_options::read(&options) }.unwrap();
        assert!(read.events.is_null());
        options.struct_size = size_of::<AnyfaceMotionOptions>() + 5000;
        assert!(unsafe { versioned_options::read(&options) }.is_err());
    }

    #[test]
    fn a_neutral_voice_reaches_the_library_or_is_refused_in_words() {
        let sound = |samples: Vec<f32>| AnyfaceAudio::from(Waveform { samples });
        let spoken = sound((0..16_000).map(|i| (i as f32 * 0.08).sin()).collect());
        let mut options = AnyfaceMotionOptions {
            neutral_voice: &spoken,
            ..Versioned::defaults()
        };
        let request = unsafe { options.to_library() }.unwrap();
        assert!(request.neutral_voice.is_some() && request.emotion_of.is_none());
        let silent = sound(vec![0.0; 16_000]);
        options.neutral_voice = &silent;
        let message = format!("{:?}", unsafe { options.to_library() }.unwrap_err());
        assert!(
            message.contains("neutral voice") && message.contains("silence"),
            "{message}"
        );
        options.text = c"hello".as_ptr();
        options.neutral_voice = null();
        let request = unsafe { options.to_library() }.unwrap();
        assert_eq!(
            request.script.as_deref(),
            Some(&Script::Text("hello".into()))
        );
        // A header from before the neutral voice existed ends where `neutral_voice` begins.
        options.struct_size = std::mem::offset_of!(AnyfaceMotionOptions, neutral_voice);
        let read: AnyfaceMotionOptions = unsafe { versioned_options::read(&options) }.unwrap();
        assert!(read.neutral_voice.is_null());
    }

    #[test]
    fn one_row_holds_throughout_and_more_are_keys() {
        let mut rows = [0.0; 2 * ANYFACE_EMOTION_COUNT];
        rows[1] = 0.5;
        rows[ANYFACE_EMOTION_COUNT + 5] = 1.0;
        let constant = with_emotions(&rows[..ANYFACE_EMOTION_COUNT], &[]).unwrap();
        assert_eq!(constant.at(3.0).intensity, 0.5);
        let keys = with_emotions(&rows, &[1.0, 2.0]).unwrap();
        assert!((keys.at(1.5).intensity - 0.75).abs() < 1e-6);
    }

    #[test]
    fn keys_need_rising_finite_times() {
        let rows = [0.0; 2 * ANYFACE_EMOTION_COUNT];
        for times in [[2.0, 1.0], [1.0, 1.0], [0.0, f64::NAN]] {
            assert!(with_emotions(&rows, &times).is_err(), "{times:?}");
        }
        let failure = with_emotions(&rows, &[]).unwrap_err();
        assert_eq!(failure.status(), AnyfaceStatus::NullPointer);
    }

    #[test]
    fn motion_of_the_caller_is_checked() {
        let mut values = vec![0.001; 2 * LANDMARKS * 3];
        let motion = motion_from(&values, 2, 25.0).unwrap();
        assert_eq!(motion.values().shape(), [2, 68, 3]);
        assert!(motion_from(&[], 0, 25.0).is_err() && motion_from(&values, 2, 0.0).is_err());
        values[LANDMARKS * 3 + 7] = f32::NAN;
        let message = format!("{:?}", motion_from(&values, 2, 25.0).unwrap_err());
        assert!(message.contains("frame 1, landmark 2"), "{message}");
    }
}
