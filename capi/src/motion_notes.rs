//! Says in words which parts of a performance and its events a face cannot show.

use anyface::spread::tongue_note;
use libc::c_char;

use crate::{
    engine::AnyfaceEngine,
    error::AnyfaceError,
    face::AnyfaceFace,
    guard,
    motion::AnyfaceMotion,
    pointer::handles,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// Finds the parts of a motion and its events that nobody will see on this face. Long if the shapes
/// of the face have not been made yet: accepts a progress handle.
///
/// There are sentences about:
/// - events that start after the end of the sound;
/// - units that this face cannot show, such as brows if it has none;
/// - a mouth that cannot show all of speech: lips that hardly part, lips that do not meet in p, b
///   and m, a lower lip that does not reach the upper teeth in f and v, lips that something hides;
/// - a face without a tongue that can move by itself, if the motion moves the tongue;
/// - a face that no head of the system's own model resembles, so that landmarks alone moved it.
///   This is known only once a clip of this face was made.
///
/// `motion`: from `anyface_motion_new()`. `progress` may be NULL. `json` receives a list of sentences
/// in English; free it with `anyface_text_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for motion that was not made from speech,
/// `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_motion_notes(
    engine: *const AnyfaceEngine,
    face: *const AnyfaceFace,
    motion: *const AnyfaceMotion,
    progress: *const AnyfaceProgress,
    json: *mut *mut c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, face, motion) = handles!(engine, face, motion);
        let performance = motion.spoken()?;
        let find = |watch: anyface::job::ProgressFn<'_>| {
            let mut notes = performance.unseen_events(&engine.0, &face.0, watch)?;
            let reach = engine.0.mouth_reach(&face.0, watch)?;
            notes.extend(reach.iter().flat_map(anyface::MouthReach::sentences));
            Ok(notes)
        };
        let notes = unsafe { watched(progress, find) }?;
        let speaks = performance.life.tongue.iter().any(|share| *share != 0.0);
        let tongue = speaks.then(|| tongue_note(&face.0)).flatten();
        let texts = notes.into_iter().chain(face.0.field_note());
        let texts = texts.chain(tongue.map(str::to_owned));
        Ok(serde_json::to_string(&texts.collect::<Vec<String>>()).unwrap_or_default())
    };
    unsafe { guard::give_text(json, error, make) }
}

#[cfg(test)]
mod tests {
    use std::{
        ffi::CStr,
        ptr::{null, null_mut},
    };

    use anyface::{
        CachePolicy, Engine, EngineOptions, MotionRequest, audio::Waveform, face::FaceOptions,
        head::Head, job::SILENT, mesh::LandmarkSource,
    };

    use super::*;
    use crate::{
        clip::{anyface_clip_free, anyface_clip_new},
        motion::MotionSource,
        text::anyface_text_free,
    };

    #[test]
    fn a_face_that_no_head_is_like_is_told_after_its_clip() {
        let options = EngineOptions {
            system: Some("facetalk".into()),
            cache: CachePolicy::Off,
            ..EngineOptions::default()
        };
        let engine = Engine::new(options).unwrap();
        let head = Head::open(None).unwrap();
        let code = head.identity_code(&Head::random(6)).unwrap();
        let mut narrow = head.one(code).unwrap().mesh(72, SILENT).unwrap();
        narrow.mesh.positions.iter_mut().for_each(|p| p[0] *= 3.0);
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::Vertices(narrow.landmarks.vertices.to_vec())),
            ..FaceOptions::default()
        };
        let face = AnyfaceFace(engine.prepare(&narrow.mesh, &options, SILENT).unwrap());
        let samples = (0..8000).map(|i| (i as f32 * 0.08).sin()).collect();
        let spoken = engine.perform(&Waveform { samples }, &MotionRequest::default(), SILENT);
        let motion = AnyfaceMotion::new(MotionSource::Spoken(Box::new(spoken.unwrap())));
        let engine = AnyfaceEngine(engine);
        let notes = || unsafe {
            let mut json = null_mut();
            let status =
                anyface_motion_notes(&engine, &face, &motion, null(), &mut json, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            let notes: Vec<String> =
                serde_json::from_str(CStr::from_ptr(json).to_str().unwrap()).unwrap();
            anyface_text_free(json);
            notes
        };
        // The head was made without a tongue.
        let without_tongue = "no tongue was found in the mouth";
        assert_eq!(notes(), [without_tongue]);
        unsafe {
            let mut clip = null_mut();
            let status = anyface_clip_new(&engine, &face, &motion, null(), &mut clip, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            anyface_clip_free(clip);
        }
        let lines = notes();
        assert!(
            lines.len() == 2 && lines[0].contains("landmarks alone") && lines[1] == without_tongue,
            "{lines:?}"
        );
    }
}
