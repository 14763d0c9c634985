//! A mesh with its landmarks and everything that does not depend on time.

use std::{ffi::c_char, mem::offset_of, ptr::null};

use anyface::{
    PreparedFace,
    mesh::{Axis, FaceOptions, LandmarkSource, PartRole},
    motion::LANDMARKS,
};

use crate::{
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    growing::{self, Growing},
    guard, known,
    mesh::AnyfaceMesh,
    pointer,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// A mesh made ready to be animated. Never changes after it was made: any number of threads may
/// use it at the same time.
pub struct AnyfaceFace {
    pub(crate) face: PreparedFace,
    vertices: usize,
}

const fn shared_by_threads<T: Send + Sync>() {}
const _: () = shared_by_threads::<AnyfaceFace>();

/// An axis of the mesh's own frame; for `AnyfaceFaceOptions`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceAxis {
    /// +x
    PosX = 0,
    /// -x
    NegX = 1,
    /// +y
    PosY = 2,
    /// -y
    NegY = 3,
    /// +z
    PosZ = 4,
    /// -z
    NegZ = 5,
}

/// What a connected part of the mesh is and follows; for `AnyfaceFaceOptions` and
/// `anyface_face_copy_parts()`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfacePartRole {
    /// The face itself.
    Skin = 0,
    /// Follows the lower jaw as a rigid body: lower teeth, lower gums, tongue.
    Jaw = 1,
    /// Follows the skull: upper teeth, upper gums, glasses, hair.
    Skull = 2,
    /// Holds both jaws: gums with a tongue, the mouth's lining.
    Mouth = 3,
    /// Follows the skin nearest to its roots: lashes, brows, beards.
    Nearest = 4,
    /// An eyeball; rests and never deforms.
    Gaze = 5,
    /// Nothing of the face; rests.
    Still = 6,
}

pub(crate) const ROLES: [(AnyfacePartRole, PartRole); 7] = [
    (AnyfacePartRole::Skin, PartRole::Skin),
    (AnyfacePartRole::Jaw, PartRole::Jaw),
    (AnyfacePartRole::Skull, PartRole::Skull),
    (AnyfacePartRole::Mouth, PartRole::Mouth),
    (AnyfacePartRole::Nearest, PartRole::Nearest),
    (AnyfacePartRole::Gaze, PartRole::Gaze),
    (AnyfacePartRole::Still, PartRole::Still),
];

/// What is known of a face; prepare it with `anyface_face_options_init()`.
///
/// Landmarks may come in one of three ways, or not at all: then the library finds them.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct AnyfaceFaceOptions {
    /// Bytes of this struct in the caller's header; set by `anyface_face_options_init()`.
    pub struct_size: usize,
    /// `[68, 3]`, mesh units and axes, in the order of iBUG 300-W; each is put on the nearest
    /// fitting place of the surface. NULL otherwise.
    pub landmark_positions: *const f32,
    /// `[68]` vertex numbers, NULL otherwise.
    pub landmark_vertices: *const u32,
    /// The text of a landmark file as `anyface_face_write_landmarks()` writes it, UTF-8. NULL
    /// otherwise.
    pub landmark_json: *const c_char,
    /// The axis out of the face, one of `AnyfaceAxis`; default +z, as in OBJ and glTF. Blender
    /// faces -y.
    pub forward: i32,
    /// The axis to the top of the head, one of `AnyfaceAxis`; default +y. Blender has +z.
    pub up: i32,
    /// Strength of the learned part, 0 (geometry alone) to 1, the default.
    pub learned: f32,
    /// Must be 0.
    pub reserved: u32,
    /// `[part_count]` numbers of parts whose role the caller knows, as `anyface_face_copy_parts()`
    /// counts them; NULL otherwise. All other parts are told by shape and place.
    pub part_numbers: *const u32,
    /// `[part_count]` their roles, each one of `AnyfacePartRole`; NULL otherwise.
    pub part_roles: *const i32,
    /// Number of parts whose role the caller knows.
    pub part_count: usize,
    /// `[fixed_count]` numbers, 0 to 67, of landmarks that stay where the caller puts them while the
    /// others follow; NULL otherwise.
    pub fixed_numbers: *const u32,
    /// `[fixed_count, 3]` their places, mesh units and axes; each is put on the surface. NULL
    /// otherwise.
    pub fixed_positions: *const f32,
    /// Number of landmarks that stay.
    pub fixed_count: usize,
    /// `[object_vertex_count]`: which object each vertex belongs to, for a mesh that was put together
    /// from several (a face, its teeth, its lashes); `UINT32_MAX` for none. NULL otherwise.
    pub object_of_vertex: *const u32,
    /// Number of vertices of the mesh where `object_of_vertex` is given, otherwise 0.
    pub object_vertex_count: usize,
    /// `[object_count]`: the role of every part of an object, one of `AnyfacePartRole`, or -1 for
    /// parts that are told by shape and place. `part_numbers` count before these. NULL otherwise.
    pub object_roles: *const i32,
    /// Number of objects.
    pub object_count: usize,
}

unsafe impl Growing for AnyfaceFaceOptions {
    const NAME: &'static str = "anyface_face_options";
    const FIRST_SIZE: usize = offset_of!(Self, part_numbers);
    fn defaults() -> Self {
        AnyfaceFaceOptions {
            struct_size: size_of::<Self>(),
            landmark_positions: null(),
            landmark_vertices: null(),
            landmark_json: null(),
            forward: AnyfaceAxis::PosZ as i32,
            up: AnyfaceAxis::PosY as i32,
            learned: FaceOptions::default().learned,
            reserved: 0,
            part_numbers: null(),
            part_roles: null(),
            part_count: 0,
            fixed_numbers: null(),
            fixed_positions: null(),
            fixed_count: 0,
            object_of_vertex: null(),
            object_vertex_count: 0,
            object_roles: null(),
            object_count: 0,
        }
    }
}

impl AnyfaceFaceOptions {
    /// # Safety
    /// Every pointer is NULL or as its field says.
    pub(crate) unsafe fn to_library(self) -> Result<FaceOptions, Failure> {
        let forward = axis("forward", self.forward)?;
        let up = axis("up", self.up)?;
        if self.forward / 2 == self.up / 2 {
            return Err(Failure::invalid(format!(
                "up: expected an axis across forward, got {up:?} with {forward:?}"
            )));
        }
        if !(0.0..=1.0).contains(&self.learned) {
            return Err(Failure::invalid(format!(
                "learned: expected 0 to 1, got {}",
                self.learned
            )));
        }
        if self.reserved != 0 {
            return Err(Failure::invalid(format!(
                "reserved: expected 0, got {}",
                self.reserved
            )));
        }
        let landmarks = unsafe { self.landmarks() }?;
        Ok(FaceOptions {
            landmarks,
            fixed: unsafe { known::fixed(&self) }?,
            forward,
            up,
            learned: self.learned,
            parts: unsafe { known::parts(&self) }?,
            ..FaceOptions::default()
        })
    }

    unsafe fn landmarks(&self) -> Result<Option<LandmarkSource>, Failure> {
        let given = [
            self.landmark_positions.is_null(),
            self.landmark_vertices.is_null(),
            self.landmark_json.is_null(),
        ];
        match given {
            [true, true, true] => Ok(None),
            [false, true, true] => {
                let positions = self.landmark_positions;
                let values =
                    unsafe { pointer::slice("landmark_positions", positions, LANDMARKS, 3) }?;
                Ok(Some(LandmarkSource::Positions(
                    values.as_chunks().0.to_vec(),
                )))
            }
            [true, false, true] => {
                let vertices = self.landmark_vertices;
                let values =
                    unsafe { pointer::slice("landmark_vertices", vertices, LANDMARKS, 1) }?;
                Ok(Some(LandmarkSource::Vertices(values.to_vec())))
            }
            [true, true, false] => {
                let text = unsafe { pointer::text("landmark_json", self.landmark_json) }?;
                Ok(Some(LandmarkSource::from_json(text)?))
            }
            _ => Err(Failure::invalid(
                "landmarks: expected positions, vertices or JSON, got more than one of them",
            )),
        }
    }
}

fn axis(name: &str, code: i32) -> Result<Axis, Failure> {
    const AXES: [(AnyfaceAxis, Axis); 6] = [
        (AnyfaceAxis::PosX, Axis::PosX),
        (AnyfaceAxis::NegX, Axis::NegX),
        (AnyfaceAxis::PosY, Axis::PosY),
        (AnyfaceAxis::NegY, Axis::NegY),
        (AnyfaceAxis::PosZ, Axis::PosZ),
        (AnyfaceAxis::NegZ, Axis::NegZ),
    ];
    AXES.into_iter()
        .find(|(number, _)| *number as i32 == code)
        .map(|(_, axis)| axis)
        .ok_or_else(|| Failure::invalid(format!("{name}: expected 0 to 5, got {code}")))
}

/// Sets every option to its default. `struct_size` is `sizeof *options`.
///
/// Fails with `ANYFACE_STATUS_NULL_POINTER`, or `ANYFACE_STATUS_INVALID_INPUT` for a size that no
/// version had.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_options_init(
    options: *mut AnyfaceFaceOptions,
    struct_size: usize,
) -> AnyfaceStatus {
    unsafe { growing::init(options, struct_size) }
}

/// Takes or finds the landmarks of a mesh and computes all that does not depend on time. Long:
/// accepts a progress handle; kept in the engine's cache.
///
/// `options` and `progress` may be NULL. The mesh may be freed afterwards. Free with
/// `anyface_face_free()`.
/// Fails with `ANYFACE_STATUS_FACE_NOT_FOUND`, `ANYFACE_STATUS_MESH` for a mesh that cannot be
/// used, `ANYFACE_STATUS_INVALID_INPUT` for unusable landmarks or options,
/// `ANYFACE_STATUS_CANCELLED`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_new(
    engine: *const AnyfaceEngine,
    mesh: *const AnyfaceMesh,
    options: *const AnyfaceFaceOptions,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceFace,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("out", out)?;
        let engine = unsafe { pointer::handle("engine", engine) }?;
        let mesh = unsafe { pointer::handle("mesh", mesh) }?;
        let options = unsafe { growing::read(options)?.to_library() }?;
        let face =
            unsafe { watched(progress, |watch| engine.0.prepare(&mesh.0, &options, watch)) }?;
        let vertices = mesh.0.positions.len();
        unsafe { pointer::give(out, AnyfaceFace { face, vertices }) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Number `V` of vertices of its mesh; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_vertex_count(face: *const AnyfaceFace) -> usize {
    unsafe { face.as_ref() }.map_or(0, |face| face.vertices)
}

/// Copies the 68 landmarks into the caller's buffers, each of which may be NULL.
///
/// `positions`: `[68, 3]`, mesh units and axes, on the surface. `vertices`: `[68]`, the nearest
/// vertex of each. `confidence`: `[68]`, 0 to 1; 1 for landmarks that the caller gave.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `face` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_copy_landmarks(
    face: *const AnyfaceFace,
    positions: *mut f32,
    vertices: *mut u32,
    confidence: *mut f32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let landmarks = &unsafe { pointer::handle("face", face) }?.face.landmarks;
        unsafe { known::copy_landmarks(landmarks, positions, vertices, confidence) }
    };
    unsafe { guard::guard(error, work) }
}

/// Number of connected parts of its mesh, seams sewn up; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_part_count(face: *const AnyfaceFace) -> usize {
    unsafe { face.as_ref() }.map_or(0, |face| face.face.parts.parts.len())
}

/// Copies what each part is into the caller's buffers, each of which may be NULL.
///
/// `roles`: one `AnyfacePartRole` for each of `anyface_face_part_count()` parts.
/// `part_of_vertex`: `[V]`, the part of each vertex, `UINT32_MAX` for a vertex in no face.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `face` is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_copy_parts(
    face: *const AnyfaceFace,
    roles: *mut i32,
    part_of_vertex: *mut u32,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let list = &unsafe { pointer::handle("face", face) }?.face.parts;
        unsafe { known::copy_parts(list, roles, part_of_vertex) }
    };
    unsafe { guard::guard(error, work) }
}

/// Writes the landmarks as a JSON file that `anyface animate --landmarks` reads too.
///
/// `path`: UTF-8. Fails with `ANYFACE_STATUS_IO`; then nothing is left of the file.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_write_landmarks(
    face: *const AnyfaceFace,
    path: *const c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let face = unsafe { pointer::handle("face", face) }?;
        face.face
            .landmarks
            .write(unsafe { pointer::path("path", path) }?)?;
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Frees a face that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_face_free(face: *mut AnyfaceFace) {
    unsafe { guard::free(face) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> AnyfaceFaceOptions {
        Growing::defaults()
    }

    fn refused(options: AnyfaceFaceOptions) -> bool {
        let result = unsafe { options.to_library() };
        result.is_err_and(|failure| failure.status() == AnyfaceStatus::InvalidInput)
    }

    #[test]
    fn defaults_are_the_librarys() {
        assert_eq!(
            unsafe { options().to_library() }.unwrap(),
            FaceOptions::default()
        );
    }

    #[test]
    fn an_older_host_says_nothing_of_parts() {
        let mut old = options();
        old.struct_size = AnyfaceFaceOptions::FIRST_SIZE;
        old.part_count = 9;
        let read = unsafe { growing::read(&raw const old) }.unwrap();
        assert_eq!(
            unsafe { read.to_library() }.unwrap(),
            FaceOptions::default()
        );
    }

    #[test]
    fn axes_must_exist_and_cross() {
        let blender = AnyfaceFaceOptions {
            forward: AnyfaceAxis::NegY as i32,
            up: AnyfaceAxis::PosZ as i32,
            ..options()
        };
        let library = unsafe { blender.to_library() }.unwrap();
        assert_eq!((library.forward, library.up), (Axis::NegY, Axis::PosZ));
        assert!(refused(AnyfaceFaceOptions {
            forward: 6,
            ..options()
        }));
        assert!(refused(AnyfaceFaceOptions {
            forward: -1,
            ..options()
        }));
        assert!(refused(AnyfaceFaceOptions {
            forward: AnyfaceAxis::NegY as i32,
            ..options()
        }));
    }

    #[test]
    fn learned_is_a_share() {
        for learned in [-0.1, 1.1, f32::NAN] {
            assert!(refused(AnyfaceFaceOptions {
                learned,
                ..options()
            }));
        }
    }

    #[test]
    fn landmarks_come_in_one_way_at_a_time() {
        let vertices: [u32; 68] = std::array::from_fn(|i| i as u32);
        let positions = [[0.5f32; 3]; 68];
        let by_number = AnyfaceFaceOptions {
            landmark_vertices: vertices.as_ptr(),
            ..options()
        };
        let library = unsafe { by_number.to_library() }.unwrap();
        assert_eq!(
            library.landmarks,
            Some(LandmarkSource::Vertices(vertices.into()))
        );
        let landmark_positions = positions.as_flattened().as_ptr();
        assert!(refused(AnyfaceFaceOptions {
            landmark_positions,
            ..by_number
        }));
        let by_place = AnyfaceFaceOptions {
            landmark_positions,
            ..options()
        };
        let library = unsafe { by_place.to_library() }.unwrap();
        assert_eq!(
            library.landmarks,
            Some(LandmarkSource::Positions(positions.into()))
        );
        assert!(refused(AnyfaceFaceOptions {
            landmark_json: c"[1, 2".as_ptr(),
            ..options()
        }));
    }
}
