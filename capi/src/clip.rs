//! The finished animation of one mesh.

use std::{borrow::Cow, ptr::null};

use anyface::{
    Face, Performance,
    deform::VertexClip,
    job::ProgressFn,
    motion::{Life, Motion, Visibility, lip_travel},
    output::ClipFile,
    spread::{Animation, Collector, Movement},
};
use libc::c_char;
use ndarray::Axis;

use crate::{
    audio::AnyfaceAudio,
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    face::AnyfaceFace,
    guard,
    mesh::AnyfaceMesh,
    motion::AnyfaceMotion,
    pointer::{self, handles},
    progress::{AnyfaceProgress, watched},
    request::AnyfaceRequest,
    rig::AnyfaceRig,
    status::AnyfaceStatus,
};

/// Displacements of every vertex over time, in the mesh's own units, axes and vertex order. They
/// never change once they are made: any number of threads may read them at the same time.
pub struct AnyfaceClip {
    pub(crate) animation: Animation,
    /// Largest displacement of any vertex, mesh units.
    largest: f32,
    visibility: Visibility,
    /// Head, gaze and tongue, if the motion was made from speech.
    life: Option<Life>,
}

/// How much of a clip a viewer can see.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceVisibility {
    /// The mouth speaks, or the options told it to rest.
    Speaks = 0,
    /// Lids and brows move but the lips do not: the sound probably contains no speech.
    LipsRest = 1,
    /// Nothing moves.
    Nothing = 2,
}

impl AnyfaceClip {
    /// Makes both arrays contiguous, so that pointers into them can be lent.
    pub(crate) fn new(mut animation: Animation, largest: f32, visibility: Visibility) -> Self {
        let vertices = &mut animation.vertices.displacements;
        if !vertices.is_standard_layout() {
            *vertices = vertices.as_standard_layout().into_owned();
        }
        let landmarks = &mut animation.landmark_displacements;
        if !landmarks.is_standard_layout() {
            *landmarks = landmarks.as_standard_layout().into_owned();
        }
        AnyfaceClip {
            animation,
            largest,
            visibility,
            life: None,
        }
    }

    /// Puts motion and the motion of the tongue on a face. `performance`: their source, if they
    /// were made from speech.
    fn spread(
        engine: &AnyfaceEngine,
        face: &Face,
        (motion, tongue): (&Motion, &Life),
        performance: Option<&Performance>,
        watch: ProgressFn<'_>,
    ) -> anyface::Result<Self> {
        let mut collector = Collector::default();
        let motion = followed(engine, face, motion, watch)?;
        let movement = Movement::from(&*motion).with_tongue(tongue);
        let moved = engine.0.spread(face, movement, &mut collector, watch)?;
        let mm = 1000.0 * face.metres_per_unit() as f32;
        let lips_mm = mm * lip_travel(moved.landmarks.view());
        // In motion that the caller supplied, the lips may rest on purpose.
        let articulation = performance.map_or(0.0, Performance::articulation);
        let visibility = Visibility::of(mm * moved.largest, lips_mm, articulation);
        let life = performance.map(|performance| performance.life.clone());
        Ok(AnyfaceClip {
            life,
            ..AnyfaceClip::new(collector.into_animation(), moved.largest, visibility)
        })
    }

    fn less(&self, other: &AnyfaceClip) -> Result<AnyfaceClip, Failure> {
        let shape = |clip: &AnyfaceClip| (clip.frame_count(), clip.vertex_count(), clip.fps());
        let (expected, got) = (shape(self), shape(other));
        if expected != got {
            return Err(Failure::invalid(format!(
                "other: expected frames, vertices and rate {expected:?}, got {got:?}"
            )));
        }
        let (whole, part) = (&self.animation, &other.animation);
        let animation = Animation {
            vertices: VertexClip {
                displacements: &whole.vertices.displacements - &part.vertices.displacements,
                fps: self.fps(),
            },
            landmarks_neutral: whole.landmarks_neutral,
            landmark_displacements: &whole.landmark_displacements - &part.landmark_displacements,
        };
        let squares = animation.vertices.displacements.rows().into_iter();
        let largest = squares.map(|row| row.dot(&row)).fold(0.0, f32::max);
        Ok(AnyfaceClip::new(animation, largest.sqrt(), self.visibility))
    }

    fn fps(&self) -> f64 {
        self.animation.vertices.fps
    }

    /// `[T, V, 3]`.
    fn vertices(&self) -> &[f32] {
        self.animation
            .vertices
            .displacements
            .as_slice()
            .unwrap_or_default()
    }

    /// `[T, 68, 3]`.
    fn landmarks(&self) -> &[f32] {
        self.animation
            .landmark_displacements
            .as_slice()
            .unwrap_or_default()
    }

    fn frame_count(&self) -> usize {
        self.animation.vertices.displacements.len_of(Axis(0))
    }

    fn vertex_count(&self) -> usize {
        self.animation.vertices.displacements.len_of(Axis(1))
    }
}

/// The motion that a face shows. If landmarks come from elsewhere and the system has a model that
/// follows them, this is the system's own motion.
pub(crate) fn followed<'a>(
    engine: &AnyfaceEngine,
    face: &Face,
    motion: &'a Motion,
    watch: ProgressFn<'_>,
) -> anyface::Result<Cow<'a, Motion>> {
    match motion {
        Motion::Landmarks(clip) => {
            let controls = &face.options.controls;
            engine.0.follow(clip, controls, watch).map(Cow::Owned)
        }
        Motion::Weights(_) | Motion::Codes(_) => Ok(Cow::Borrowed(motion)),
    }
}

/// Makes a clip from speech and a face: `anyface_motion_new()` and `anyface_clip_new()` in one
/// call. Long: accepts a progress handle.
///
/// `request` and `progress` may be NULL. Free with `anyface_clip_free()`.
/// Fails like those two functions.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_engine_animate(
    engine: *const AnyfaceEngine,
    face: *const AnyfaceFace,
    audio: *const AnyfaceAudio,
    request: *const AnyfaceRequest,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceClip,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, face, audio) = handles!(engine, face, audio);
        let request = unsafe { AnyfaceRequest::motion(request) };
        let animate = |watch: ProgressFn<'_>| {
            let performance = engine.0.perform(&audio.0, &request, watch)?;
            AnyfaceClip::spread(
                engine,
                &face.0,
                (&performance.motion, &performance.life),
                Some(&performance),
                watch,
            )
        };
        let clip = unsafe { watched(progress, animate) }?;
        Ok(clip)
    };
    unsafe { guard::give(out, error, make) }
}

/// Puts motion on a face. Long: accepts a progress handle.
///
/// `progress` may be NULL. Free with `anyface_clip_free()`; face and motion may be freed before.
/// Fails with `ANYFACE_STATUS_CANCELLED`, and with `ANYFACE_STATUS_OUT_OF_MEMORY` if memory cannot
/// hold all frames at once. In that case use `anyface_clip_stream()`, which passes them on block by
/// block.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_new(
    engine: *const AnyfaceEngine,
    face: *const AnyfaceFace,
    motion: *const AnyfaceMotion,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceClip,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (engine, face, motion) = handles!(engine, face, motion);
        let spread = |watch: ProgressFn<'_>| {
            AnyfaceClip::spread(
                engine,
                &face.0,
                (motion.motion(), motion.life()),
                motion.performance(),
                watch,
            )
        };
        let clip = unsafe { watched(progress, spread) }?;
        Ok(clip)
    };
    unsafe { guard::give(out, error, make) }
}

/// Subtracts another clip of the same face, for example to separate the emotion from the speech:
/// `other` and the result add up to `clip`.
///
/// The result has no tracks for head, gaze and tongue. Free with `anyface_clip_free()`; both clips
/// may be freed before.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if frame counts, vertex counts or frame rates differ.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_new_difference(
    clip: *const AnyfaceClip,
    other: *const AnyfaceClip,
    out: *mut *mut AnyfaceClip,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let (clip, other) = handles!(clip, other);
        clip.less(other)
    };
    unsafe { guard::give(out, error, make) }
}

/// Number `T` of frames; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_frame_count(clip: *const AnyfaceClip) -> usize {
    unsafe { clip.as_ref() }.map_or(0, AnyfaceClip::frame_count)
}

/// Number `V` of vertices; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_vertex_count(clip: *const AnyfaceClip) -> usize {
    unsafe { clip.as_ref() }.map_or(0, AnyfaceClip::vertex_count)
}

/// Frames per second; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_fps(clip: *const AnyfaceClip) -> f64 {
    unsafe { clip.as_ref() }.map_or(0.0, |clip| clip.animation.vertices.fps)
}

/// Length of the largest displacement of any vertex in any frame, mesh units; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_largest_displacement(clip: *const AnyfaceClip) -> f32 {
    unsafe { clip.as_ref() }.map_or(0.0, |clip| clip.largest)
}

/// How much of the clip a viewer can see, an `AnyfaceVisibility`; -1 for NULL. Warn the user if it
/// is not `ANYFACE_VISIBILITY_SPEAKS`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_visibility(clip: *const AnyfaceClip) -> i32 {
    let code = |clip: &AnyfaceClip| match clip.visibility {
        Visibility::Speaks => AnyfaceVisibility::Speaks as i32,
        Visibility::LipsRest => AnyfaceVisibility::LipsRest as i32,
        Visibility::Nothing => AnyfaceVisibility::Nothing as i32,
    };
    unsafe { clip.as_ref() }.map_or(-1, code)
}

/// Lends all displacements: `[T, V, 3]`, mesh units, added to the neutral positions.
///
/// The pointer is valid until the clip is freed; the values never change. NULL for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_displacements(clip: *const AnyfaceClip) -> *const f32 {
    unsafe { clip.as_ref() }.map_or(null(), |clip| clip.vertices().as_ptr())
}

/// Copies the 68 landmarks at rest into the caller's buffer.
///
/// `buffer`: `[68, 3]`, mesh units; `float_count` must be 204.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_copy_landmarks_neutral(
    clip: *const AnyfaceClip,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let clip = unsafe { pointer::handle("clip", clip) }?;
        Ok(clip.animation.landmarks_neutral.as_flattened())
    };
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Copies the displacements of the 68 landmarks into the caller's buffer.
///
/// `buffer`: `[T, 68, 3]`, mesh units; `float_count` must be `T * 68 * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_copy_landmark_displacements(
    clip: *const AnyfaceClip,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || Ok(unsafe { pointer::handle("clip", clip) }?.landmarks());
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Writes the clip to a file in the format that the extension of `path` names.
///
/// .npz for numpy: `displacements` `[T, V, 3]`, `landmarks_neutral` `[68, 3]`,
/// `landmark_displacements` `[T, 68, 3]`, mesh units, and `fps`. If the motion was made from
/// speech, also `head` `[T, 3]` and `gaze` `[T, 2, 2]` as `anyface_motion_copy_head()` and
/// `_gaze()` return them, and `tongue` `[T, 4]`, whose motion the displacements already contain.
/// .pc2 and .mdd: point caches of positions for Blender, Maya, Houdini and others.
/// .glb: morph targets and their weights over time for browsers and engines. .usda: the same as USD
/// blend shapes. Both hold the mesh without materials and, if the motion was made from speech, the
/// turns of the head. `anyface_clip_write_shapes()` writes ARKit's shapes instead, and .vrma.
/// `mesh`: the mesh of the clip's face. `path`: UTF-8.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another extension or another mesh, and with
/// `ANYFACE_STATUS_IO` if the file cannot be written. On failure no unfinished file is left.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_write(
    clip: *const AnyfaceClip,
    mesh: *const AnyfaceMesh,
    path: *const c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let (clip, mesh) = handles!(clip, mesh);
        let path = unsafe { pointer::path("path", path) }?;
        anyface::output::write_animation(path, &clip.animation, clip.life.as_ref(), &mesh.0)?;
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Writes the clip as weights of the shapes of its mesh, in the format that the extension of `path`
/// names.
///
/// .glb and .usda: the 52 ARKit shapes of `rig` and their weights over time, solved for the clip.
/// .vrma: a VRM animation for any avatar, with the expressions of VRM, those of ARKit under the
/// names of Perfect Sync, the turns of the head and the gaze. Other formats are as in
/// `anyface_clip_write()`. `rig`: the rig of the clip's mesh. `path`: UTF-8.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another extension or the rig of another mesh, and
/// with `ANYFACE_STATUS_IO` if the file cannot be written. On failure no unfinished file is left.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_write_shapes(
    clip: *const AnyfaceClip,
    rig: *const AnyfaceRig,
    path: *const c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let (clip, rig) = handles!(clip, rig);
        let path = unsafe { pointer::path("path", path) }?;
        let file = ClipFile::new(path)?.with_shapes(rig.shapes_of_take());
        file.write_whole(&clip.animation, clip.life.as_ref(), &rig.mesh)?;
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Frees a clip that no running call uses, with everything it lent; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_free(clip: *mut AnyfaceClip) {
    unsafe { guard::free(clip) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::deform::VertexClip;
    use ndarray::Array3;

    /// Two frames of three vertices. The input arrays are transposed in memory.
    fn clip() -> AnyfaceClip {
        let values = |(t, v, c): (usize, usize, usize)| (100 * t + 10 * v + c) as f32;
        let transposed = |rows: usize| {
            Array3::from_shape_fn((3, rows, 2), |(c, v, t)| values((t, v, c))).reversed_axes()
        };
        let animation = Animation {
            vertices: VertexClip {
                displacements: transposed(3),
                fps: 25.0,
            },
            landmarks_neutral: [[0.5; 3]; 68],
            landmark_displacements: transposed(68),
        };
        AnyfaceClip::new(animation, 211.0, Visibility::Speaks)
    }

    #[test]
    fn frames_are_lent_in_order() {
        let clip = clip();
        let lent = unsafe { anyface_clip_displacements(&clip) };
        let lent = unsafe { std::slice::from_raw_parts(lent, 18) };
        assert_eq!(&lent[..6], [0.0, 1.0, 2.0, 10.0, 11.0, 12.0]);
        assert_eq!(lent[13], 111.0);
    }

    #[test]
    fn a_clip_says_how_far_it_moves_and_what_is_seen() {
        let clip = clip();
        assert_eq!(unsafe { anyface_clip_largest_displacement(&clip) }, 211.0);
        assert_eq!(unsafe { anyface_clip_visibility(&clip) }, 0);
        assert_eq!(unsafe { anyface_clip_visibility(null()) }, -1);
    }
}
