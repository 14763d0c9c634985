//! Turns speech into motion, before any mesh is known.

use std::ffi::CString;

use anyface::{
    MotionRequest, Performance,
    job::ProgressFn,
    mesh::ibug::LANDMARKS,
    motion::{LandmarkClip, Life, Motion, Pose, Stretch, bounds::DISPLACEMENT, check_fps},
    spread::pose_on,
    systems::FieldValue,
};
use libc::c_char;
use ndarray::{ArrayView2, ArrayView3};

use crate::{
    audio::AnyfaceAudio,
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    face::AnyfaceFace,
    guard,
    pointer::{self, handles},
    progress::{AnyfaceProgress, watched},
    request::AnyfaceRequest,
    status::AnyfaceStatus,
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

/// Turns speech into motion. Long: accepts a progress handle.
///
/// `request` and `progress` may be NULL. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use, `ANYFACE_STATUS_INVALID_INPUT`
/// for a control out of range or something that the system does not obey,
/// `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_new(
    engine: *const AnyfaceEngine,
    audio: *const AnyfaceAudio,
    request: *const AnyfaceRequest,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, audio) = handles!(engine, audio);
        let request = unsafe { AnyfaceRequest::motion(request) };
        let perform = |watch: ProgressFn<'_>| engine.0.perform(&audio.0, &request, watch);
        let performance = unsafe { watched(progress, perform) }?;
        Ok(AnyfaceMotion::new(MotionSource::Spoken(Box::new(
            performance,
        ))))
    };
    unsafe { guard::give(out, error, make) }
}

/// Performs the same speech with other controls, another emotion, or another seed of blinks and
/// accents. It takes only milliseconds, because nothing is heard or sampled again. Another `onset`
/// takes longer in systems whose models have learned emotion, because they sample again.
///
/// Style, frame rate and everything else that the system samples with stay those of `motion`. If
/// the models have learned emotion themselves (the built-in ones have not), the emotion that they
/// show stays too. `request` may be NULL. Free with `anyface_motion_free()`; `motion` may be freed
/// first.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a motion that the caller brought or that was
/// redone or cut from another one, or for a control out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_new_again(
    engine: *const AnyfaceEngine,
    motion: *const AnyfaceMotion,
    request: *const AnyfaceRequest,
    out: *mut *mut AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, motion) = handles!(engine, motion);
        let request = unsafe { AnyfaceRequest::motion(request) };
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
/// redone or cut from another one, or for a system that does not separate emotion from speech (the
/// ability "emotion" of `anyface_describe()`), and with `ANYFACE_STATUS_CANCELLED`.
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

/// Makes a motion of one frame from the pose of a face whose vertices are displaced. Pass it to
/// `anyface_request_set_motion()` as "starts_from". The array is copied.
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

/// Asks for a field of the kind "pose": the last frame of a motion of landmarks, which is copied, with
/// its tongue.
///
/// Fails like `anyface_request_set_text()`, also for a motion without frames or of another kind.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_request_set_motion(
    request: *mut AnyfaceRequest,
    name: *const c_char,
    motion: *const AnyfaceMotion,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    unsafe {
        AnyfaceRequest::set(request, name, error, || {
            let pose = last_pose(pointer::handle("motion", motion)?)?;
            Ok(FieldValue::Pose(Box::new(pose)))
        })
    }
}

fn last_pose(whole: &AnyfaceMotion) -> Result<Pose, Failure> {
    let motion = whole.motion();
    let clip = motion.landmarks();
    let last = clip.and_then(|clip| clip.displacements.outer_iter().last());
    let last = last.zip(whole.life().tongue.outer_iter().last());
    let (landmarks, tongue) = last.ok_or_else(|| {
        let (frames, kind) = (motion.frames(), motion.kind());
        Failure::invalid(format!(
            "motion: expected frames of landmarks, got {frames} of {kind}"
        ))
    })?;
    Ok(Pose::of_frame(landmarks, tongue))
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
