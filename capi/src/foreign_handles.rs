//! Tests that handles which do not belong together are refused or made to fit, never a panic.

use std::{
    ffi::{CString, c_int, c_void},
    ptr::{null, null_mut},
};

use anyface::{
    CachePolicy, Engine, EngineOptions, MotionRequest, audio::Waveform, face::FaceOptions,
    head::Head, job::SILENT, mesh::LandmarkSource, systems,
};

use crate::{
    basis::{AnyfaceBasis, anyface_basis_new},
    clip::{
        AnyfaceClip, anyface_clip_new, anyface_clip_new_difference, anyface_clip_write,
        anyface_clip_write_shapes,
    },
    clip_stream::anyface_clip_stream,
    engine::AnyfaceEngine,
    error::{AnyfaceError, anyface_error_free, anyface_error_message},
    face::AnyfaceFace,
    mesh::AnyfaceMesh,
    motion::{
        AnyfaceMotion, MotionSource, anyface_motion_new_again, anyface_motion_new_content,
        anyface_motion_new_frames, anyface_motion_new_redone, anyface_request_set_motion,
    },
    motion_notes::anyface_motion_notes,
    motion_values::anyface_motion_copy_mask,
    pointer,
    request::{AnyfaceRequest, anyface_request_new, anyface_request_set_number},
    rig::{AnyfaceRig, anyface_rig_new},
    sliders::{AnyfaceSliders, anyface_sliders_new},
    status::AnyfaceStatus,
    text::anyface_text_free,
};

/// Calls a function whose last argument is the error, and returns its status and message.
fn status_of(
    call: impl FnOnce(*mut *mut AnyfaceError) -> AnyfaceStatus,
) -> (AnyfaceStatus, String) {
    let mut error = null_mut();
    let status = call(&mut error);
    let message = unsafe { pointer::text("message", anyface_error_message(error)) };
    let message = message.unwrap_or_default().to_owned();
    unsafe { anyface_error_free(error) };
    assert_ne!(status, AnyfaceStatus::Panic, "{message}");
    (status, message)
}

/// Calls a function that makes an object. The object is not freed: the test ends soon.
fn object_of<T>(
    call: impl FnOnce(*mut *mut T, *mut *mut AnyfaceError) -> AnyfaceStatus,
) -> Option<&'static T> {
    let mut out = null_mut();
    status_of(|error| call(&mut out, error));
    unsafe { out.as_ref() }
}

fn engine(system: &str) -> AnyfaceEngine {
    let options = EngineOptions {
        system: Some(system.into()),
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    };
    AnyfaceEngine(Engine::new(options).unwrap())
}

/// A head of about `resolution`² vertices, as a face and as a mesh.
fn head(engine: &AnyfaceEngine, resolution: usize) -> (AnyfaceFace, AnyfaceMesh) {
    let heads = Head::open(None).unwrap();
    let code = heads.identity_code(&Head::random(6)).unwrap();
    let head = heads.one(code).unwrap().mesh(resolution, SILENT).unwrap();
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Vertices(head.landmarks.vertices.to_vec())),
        ..FaceOptions::default()
    };
    let face = engine.0.prepare(&head.mesh, &options, SILENT).unwrap();
    let mesh = AnyfaceMesh((*face.mesh).clone());
    (AnyfaceFace(face), mesh)
}

fn speech(engine: &AnyfaceEngine, samples: usize) -> AnyfaceMotion {
    let samples = (0..samples).map(|i| (i as f32 * 0.08).sin()).collect();
    let request = MotionRequest::default();
    let spoken = engine.0.perform(&Waveform { samples }, &request, SILENT);
    AnyfaceMotion::new(MotionSource::Spoken(Box::new(spoken.unwrap())))
}

unsafe extern "C" fn skip(_: *mut c_void, _: usize, _: usize, _: *const f32) -> c_int {
    0
}

fn clip_of(
    engine: &AnyfaceEngine,
    face: &AnyfaceFace,
    motion: &AnyfaceMotion,
) -> &'static AnyfaceClip {
    object_of(|out, error| unsafe { anyface_clip_new(engine, face, motion, null(), out, error) })
        .expect("a clip")
}

fn basis_of(engine: &AnyfaceEngine, clip: &AnyfaceClip) -> &'static AnyfaceBasis {
    object_of(|out, error| unsafe { anyface_basis_new(engine, clip, 1e-4, 20, null(), out, error) })
        .expect("a basis")
}

#[test]
fn sliders_of_another_face_clip_or_basis_are_refused() {
    let engine = engine("freetalk");
    let faces = [head(&engine, 64).0, head(&engine, 56).0];
    let motions = [speech(&engine, 16000), speech(&engine, 12000)];
    let clips = faces.each_ref().map(|face| {
        motions
            .each_ref()
            .map(|motion| clip_of(&engine, face, motion))
    });
    let bases = clips.map(|clips| clips.map(|clip| basis_of(&engine, clip)));
    for (face, clip, basis) in indices([2, 4, 4]) {
        let (status, message) = status_of(|error| {
            let (clip, basis) = (clips[clip / 2][clip % 2], bases[basis / 2][basis % 2]);
            let mut sliders: *mut AnyfaceSliders = null_mut();
            let (face, motion) = (&faces[face], &motions[0]);
            unsafe {
                anyface_sliders_new(
                    &engine,
                    face,
                    motion,
                    clip,
                    basis,
                    null(),
                    &mut sliders,
                    error,
                )
            }
        });
        let belong = (clip, basis) == (2 * face, 2 * face);
        let expected = if belong {
            AnyfaceStatus::Ok
        } else {
            AnyfaceStatus::InvalidInput
        };
        assert_eq!(
            status, expected,
            "face {face}, clip {clip}, basis {basis}: {message}"
        );
    }
}

/// All triples of numbers below `ends`.
fn indices([a, b, c]: [usize; 3]) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..a).flat_map(move |x| (0..b).flat_map(move |y| (0..c).map(move |z| (x, y, z))))
}

#[test]
fn clips_are_written_only_with_their_own_mesh_and_rig() {
    let engine = engine("freetalk");
    let [(face, mesh), (other_face, other_mesh)] = [head(&engine, 64), head(&engine, 56)];
    let motion = speech(&engine, 8000);
    let [clip, other] = [&face, &other_face].map(|face| clip_of(&engine, face, &motion));
    let mut by_field: *mut AnyfaceRequest = null_mut();
    unsafe {
        anyface_request_new(&mut by_field, null_mut());
        anyface_request_set_number(by_field, c"by_field".as_ptr(), 1.0, null_mut());
    }
    let rig_of = |mesh: &AnyfaceMesh| {
        object_of(|out, error| unsafe {
            anyface_rig_new(&engine, mesh, by_field, null(), out, error)
        })
    };
    let rigs: [Option<&AnyfaceRig>; 2] = [&mesh, &other_mesh].map(rig_of);
    let folder = std::env::temp_dir().join(format!("anyface-foreign-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for ending in ["glb", "usda", "npz", "pc2", "mdd", "vrma", "csv", "json"] {
        let path = folder.join(format!("clip.{ending}"));
        let path = CString::new(path.to_str().unwrap()).unwrap();
        let write = |mesh| {
            status_of(|error| unsafe { anyface_clip_write(clip, mesh, path.as_ptr(), error) }).0
        };
        if write(&mesh) == AnyfaceStatus::Ok {
            assert_eq!(write(&other_mesh), AnyfaceStatus::InvalidInput, "{ending}");
        }
        for rig in rigs.iter().flatten() {
            let belongs = std::ptr::eq(*rig, rigs[0].unwrap());
            let (status, message) = status_of(|error| unsafe {
                anyface_clip_write_shapes(clip, *rig, path.as_ptr(), error)
            });
            assert!(
                belongs || status == AnyfaceStatus::InvalidInput,
                "{ending}: {status:?} {message}"
            );
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
    let difference =
        object_of(|out, error| unsafe { anyface_clip_new_difference(clip, other, out, error) });
    assert!(difference.is_none());
}

#[test]
fn motion_faces_and_engines_of_different_systems_never_panic() {
    let engines: Vec<AnyfaceEngine> = systems::SYSTEMS
        .iter()
        .map(|system| engine(system.name))
        .collect();
    let faces = [head(&engines[0], 64).0, head(&engines[0], 56).0];
    let mut motions: Vec<AnyfaceMotion> =
        engines.iter().map(|engine| speech(engine, 8000)).collect();
    let part = |motion: &AnyfaceMotion| {
        let mut out = null_mut();
        status_of(|error| unsafe { anyface_motion_new_frames(motion, 1, 4, &mut out, error) });
        *unsafe { Box::from_raw(out) }
    };
    let parts: Vec<AnyfaceMotion> = motions.iter().map(part).collect();
    motions.extend(parts);
    for motion in &motions {
        for other in &motions {
            object_of(|out, error| unsafe {
                anyface_motion_new_redone(motion, other, 0.05, 0.2, out, error)
            });
        }
        for engine in &engines {
            let mut request: *mut AnyfaceRequest = null_mut();
            unsafe { anyface_request_new(&mut request, null_mut()) };
            status_of(|error| unsafe {
                anyface_request_set_motion(request, c"starts_from".as_ptr(), motion, error)
            });
            for other in &motions {
                object_of(|out, error| unsafe {
                    anyface_motion_new_again(engine, other, request, out, error)
                });
            }
            object_of(|out, error| unsafe {
                anyface_motion_new_content(engine, motion, null(), out, error)
            });
            for face in &faces {
                let clip = object_of(|out, error| unsafe {
                    anyface_clip_new(engine, face, motion, null(), out, error)
                });
                status_of(|error| unsafe {
                    anyface_clip_stream(
                        engine,
                        face,
                        motion,
                        3,
                        Some(skip),
                        null_mut(),
                        null(),
                        error,
                    )
                });
                let mut notes = null_mut();
                status_of(|error| unsafe {
                    anyface_motion_notes(engine, face, motion, null(), &mut notes, error)
                });
                unsafe { anyface_text_free(notes) };
                let mut mask = vec![0.0; face.0.mesh.positions.len()];
                status_of(|error| unsafe {
                    anyface_motion_copy_mask(
                        motion,
                        engine,
                        face,
                        1,
                        mask.as_mut_ptr(),
                        mask.len(),
                        error,
                    )
                });
                if let Some(clip) = clip {
                    let basis = basis_of(engine, clip);
                    object_of(|out, error| unsafe {
                        anyface_sliders_new(engine, face, motion, clip, basis, null(), out, error)
                    });
                }
            }
        }
    }
}
