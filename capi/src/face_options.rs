//! What a caller knows about a mesh, and options for making its face.

use anyface::{
    Engine,
    face::FaceOptions,
    job::ProgressFn,
    mesh::{
        Axis, FixedLandmark, KnownLandmark, LandmarkPlace, LandmarkSource, Mesh, ObjectNames,
        PartChoices, PartRole, PartSelector, ibug::LANDMARKS,
    },
};
use libc::c_char;

use crate::{
    engine::AnyfaceEngine,
    error::Failure,
    mesh::AnyfaceMesh,
    pointer,
    progress::{AnyfaceProgress, watched},
    request::AnyfaceRequest,
    status::AnyfaceStatus,
    versioned_options::{self, Versioned},
};

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

/// What a connected part of the mesh is, and what it follows; for `AnyfaceFaceOptions` and
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
    /// Belongs to both jaws: gums with a tongue, the lining of the mouth.
    Mouth = 3,
    /// Follows the skin next to its roots: lashes, brows, beards.
    Nearest = 4,
    /// An eyeball; stays at rest and never deforms.
    Gaze = 5,
    /// Not part of the face; stays at rest.
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

/// What is known about a face; prepare it with `anyface_face_options_init()`.
///
/// Landmarks may be given as positions, as vertices, as both, or as JSON. Without any the library
/// finds them.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct AnyfaceFaceOptions {
    /// Bytes of this struct in the caller's header; set by `anyface_face_options_init()`.
    pub struct_size: usize,
    /// `[68, 3]`, mesh units and axes, in the order of iBUG 300-W. Each moves to the nearest
    /// suitable place on the surface, unless it lies at its vertex in `landmark_vertices`. NULL if
    /// not given.
    pub landmark_positions: *const f32,
    /// `[68]` vertex numbers, NULL if not given. Together with positions, a point that lies exactly
    /// at its vertex stays on that vertex. Points of `anyface_opened_face_copy_landmarks()` need
    /// this where rims touch.
    pub landmark_vertices: *const u32,
    /// The text of a landmark file as `anyface_face_write_landmarks()` writes it, UTF-8. NULL if
    /// not given.
    pub landmark_json: *const c_char,
    /// The axis out of the face, one of `AnyfaceAxis`; default +z, as in OBJ and glTF. Blender
    /// faces -y.
    pub forward: i32,
    /// The axis to the top of the head, one of `AnyfaceAxis`; default +y. Blender has +z.
    pub up: i32,
    /// The controls of the stage "face" that are set in it, such as "learned", act on the face. The
    /// handle is used only until the call returns. NULL: all have their defaults.
    pub request: *const AnyfaceRequest,
    /// `[part_count]` numbers of the parts whose role the caller knows, as in
    /// `anyface_face_copy_parts()`; NULL if there are none. The library recognises all other parts
    /// by their shape and place.
    pub part_numbers: *const u32,
    /// `[part_count]` roles of these parts, each one of `AnyfacePartRole`; NULL if there are none.
    pub part_roles: *const i32,
    /// Number of parts whose role the caller knows.
    pub part_count: usize,
    /// `[fixed_count]` numbers, 0 to 67, of landmarks that stay where the caller puts them while the
    /// others adapt; NULL if there are none.
    pub fixed_numbers: *const u32,
    /// `[fixed_count, 3]` positions of these landmarks, mesh units and axes; each moves onto the
    /// surface. NULL if there are none.
    pub fixed_positions: *const f32,
    /// Number of landmarks that stay.
    pub fixed_count: usize,
    /// `[object_vertex_count]`: which object each vertex belongs to, for a mesh that was joined
    /// from several objects (a face, its teeth, its lashes); `UINT32_MAX` for none. NULL if not
    /// given.
    pub object_of_vertex: *const u32,
    /// Number of vertices of the mesh if `object_of_vertex` is given, otherwise 0.
    pub object_vertex_count: usize,
    /// `[object_count]`: the role of every part of an object, one of `AnyfacePartRole`, or -1 if
    /// the library should recognise its parts by their shape and place. `part_numbers` take
    /// precedence over these. NULL if there are no objects.
    pub object_roles: *const i32,
    /// Number of objects.
    pub object_count: usize,
}

unsafe impl Versioned for AnyfaceFaceOptions {
    const NAME: &'static str = "anyface_face_options";
    const FIRST_SIZE: usize = size_of::<Self>();
    fn defaults() -> Self {
        AnyfaceFaceOptions {
            struct_size: size_of::<Self>(),
            forward: AnyfaceAxis::PosZ as i32,
            up: AnyfaceAxis::PosY as i32,
            ..Self::zero()
        }
    }
}

impl AnyfaceFaceOptions {
    /// # Safety
    /// Every pointer is NULL or meets the documentation of its field.
    pub(crate) unsafe fn to_library(self) -> Result<FaceOptions, Failure> {
        let forward = axis("forward", self.forward)?;
        let up = axis("up", self.up)?;
        if self.forward / 2 == self.up / 2 {
            return Err(Failure::invalid(format!(
                "up: expected an axis across forward, got {up:?} with {forward:?}"
            )));
        }
        let landmarks = unsafe { self.landmarks() }?;
        Ok(FaceOptions {
            landmarks,
            fixed: unsafe { fixed(&self) }?,
            forward,
            up,
            controls: unsafe { AnyfaceRequest::face_controls(self.request) },
            parts: unsafe { parts(&self) }?,
            ..FaceOptions::default()
        })
    }

    unsafe fn landmarks(&self) -> Result<Option<LandmarkSource>, Failure> {
        let sources = [
            self.landmark_positions.is_null(),
            self.landmark_vertices.is_null(),
            self.landmark_json.is_null(),
        ];
        match sources {
            [true, true, true] => Ok(None),
            [false, true, true] => {
                let positions = unsafe { self.positions() }?;
                Ok(Some(LandmarkSource::Positions(positions.to_vec())))
            }
            [true, false, true] => {
                let vertices = unsafe { self.vertices() }?;
                Ok(Some(LandmarkSource::Vertices(vertices.to_vec())))
            }
            [false, false, true] => {
                let positions = unsafe { self.positions() }?.iter().copied();
                let vertices = unsafe { self.vertices() }?.iter().copied();
                let known = positions
                    .zip(vertices)
                    .map(|(position, vertex)| KnownLandmark {
                        position,
                        vertex,
                        confidence: 1.0,
                    });
                Ok(Some(LandmarkSource::Known(known.collect())))
            }
            [true, true, false] => {
                let text = unsafe { pointer::text("landmark_json", self.landmark_json) }?;
                Ok(Some(LandmarkSource::from_json(text)?))
            }
            _ => Err(Failure::invalid(
                "landmarks: expected positions, vertices, both of them, or JSON; got JSON with another",
            )),
        }
    }

    unsafe fn positions(&self) -> Result<&[[f32; 3]], Failure> {
        let positions = self.landmark_positions;
        let values = unsafe { pointer::slice("landmark_positions", positions, LANDMARKS, 3) }?;
        Ok(values.as_chunks().0)
    }

    unsafe fn vertices(&self) -> Result<&[u32], Failure> {
        unsafe { pointer::slice("landmark_vertices", self.landmark_vertices, LANDMARKS, 1) }
    }
}

fn axis(name: &'static str, code: i32) -> Result<Axis, Failure> {
    const AXES: [(AnyfaceAxis, Axis); 6] = [
        (AnyfaceAxis::PosX, Axis::PosX),
        (AnyfaceAxis::NegX, Axis::NegX),
        (AnyfaceAxis::PosY, Axis::PosY),
        (AnyfaceAxis::NegY, Axis::NegY),
        (AnyfaceAxis::PosZ, Axis::PosZ),
        (AnyfaceAxis::NegZ, Axis::NegZ),
    ];
    pointer::one_of(name, code, AXES.map(|(c, axis)| (c as i32, axis)))
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
    unsafe { versioned_options::init(options, struct_size) }
}

/// The role of an object whose parts are recognised by their shape and place.
const BY_SHAPE: i32 = -1;

/// Runs `make` on a caller's mesh and reports to the caller's progress handle.
///
/// # Safety
/// Every pointer is NULL or valid. The pointers in `options` meet the documentation of their
/// fields.
pub(crate) unsafe fn of_mesh<T>(
    engine: *const AnyfaceEngine,
    mesh: *const AnyfaceMesh,
    options: *const AnyfaceFaceOptions,
    progress: *const AnyfaceProgress,
    make: impl FnOnce(&Engine, &Mesh, &FaceOptions, ProgressFn<'_>) -> anyface::Result<T>,
) -> Result<T, Failure> {
    let engine = unsafe { pointer::handle("engine", engine) }?;
    let mesh = unsafe { pointer::handle("mesh", mesh) }?;
    let options = unsafe { versioned_options::read(options)?.to_library() }?;
    unsafe { watched(progress, |watch| make(&engine.0, &mesh.0, &options, watch)) }
}

/// The landmarks that stay where the caller puts them.
///
/// # Safety
/// Every pointer of `options` is NULL or meets the documentation of its field.
unsafe fn fixed(options: &AnyfaceFaceOptions) -> Result<Vec<FixedLandmark>, Failure> {
    let count = options.fixed_count;
    let numbers = unsafe { pointer::slice("fixed_numbers", options.fixed_numbers, count, 1) }?;
    let places = unsafe { pointer::slice("fixed_positions", options.fixed_positions, count, 3) }?;
    let pairs = numbers.iter().zip(places.as_chunks().0);
    Ok(pairs
        .map(|(&index, &position)| FixedLandmark {
            index: index as usize,
            place: LandmarkPlace::Position(position),
        })
        .collect())
}

/// Roles of objects, then roles of single parts. If a part has several, the last one counts.
///
/// # Safety
/// Every pointer of `options` is NULL or meets the documentation of its field.
unsafe fn parts(options: &AnyfaceFaceOptions) -> Result<PartChoices, Failure> {
    let count = options.part_count;
    let numbers = unsafe { pointer::slice("part_numbers", options.part_numbers, count, 1) }?;
    let codes = unsafe { pointer::slice("part_roles", options.part_roles, count, 1) }?;
    let mut choices = unsafe { objects(options) }?;
    for (&number, &code) in numbers.iter().zip(codes) {
        let role = role("part_roles", code)?;
        choices.roles.push((PartSelector::Number(number), role));
    }
    Ok(choices)
}

unsafe fn objects(options: &AnyfaceFaceOptions) -> Result<PartChoices, Failure> {
    let (vertices, count) = (options.object_vertex_count, options.object_count);
    let owners = options.object_of_vertex;
    let of_vertex = unsafe { pointer::slice("object_of_vertex", owners, vertices, 1) }?;
    let codes = unsafe { pointer::slice("object_roles", options.object_roles, count, 1) }?;
    if let Some(wrong) = of_vertex
        .iter()
        .find(|&&o| o != u32::MAX && o as usize >= count)
    {
        return Err(Failure::invalid(format!(
            "object_of_vertex: expected below {count} or UINT32_MAX, got {wrong}"
        )));
    }
    let mut choices = PartChoices::default();
    let used = |object: usize| of_vertex.contains(&(object as u32));
    for (object, &code) in codes.iter().enumerate() {
        if code != BY_SHAPE && used(object) {
            let name = PartSelector::Name(object.to_string());
            choices.roles.push((name, role("object_roles", code)?));
        }
    }
    choices.names = ObjectNames {
        names: (0..count).map(|object| object.to_string()).collect(),
        of_vertex: of_vertex.to_vec(),
    };
    Ok(choices)
}

fn role(field: &'static str, code: i32) -> Result<PartRole, Failure> {
    pointer::one_of(field, code, ROLES.map(|(c, role)| (c as i32, role)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> AnyfaceFaceOptions {
        Versioned::defaults()
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
    fn landmarks_come_as_places_numbers_both_or_text() {
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
        let library = AnyfaceFaceOptions {
            landmark_positions,
            ..by_number
        };
        let library = unsafe { library.to_library() }.unwrap();
        let known = positions
            .into_iter()
            .zip(vertices)
            .map(|(position, vertex)| KnownLandmark {
                position,
                vertex,
                confidence: 1.0,
            });
        assert_eq!(
            library.landmarks,
            Some(LandmarkSource::Known(known.collect()))
        );
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

    #[test]
    fn parts_have_the_numbers_of_the_librarys_roles() {
        let numbers = [4u32, 2];
        let roles = [AnyfacePartRole::Jaw as i32, AnyfacePartRole::Still as i32];
        let chosen = AnyfaceFaceOptions {
            part_numbers: numbers.as_ptr(),
            part_roles: roles.as_ptr(),
            part_count: 2,
            ..options()
        };
        let library = unsafe { chosen.to_library() }.unwrap();
        let expected = [(4, PartRole::Jaw), (2, PartRole::Still)];
        let expected = expected.map(|(n, role)| (PartSelector::Number(n), role));
        assert_eq!(library.parts.roles, expected);
        let beyond = [7, 0];
        let beyond = AnyfaceFaceOptions {
            part_roles: beyond.as_ptr(),
            ..chosen
        };
        assert!(unsafe { beyond.to_library() }.is_err());
    }

    #[test]
    fn fixed_landmarks_reach_the_library() {
        let (numbers, places) = ([8u32, 48], [0.0f32, 1.0, 2.0, 3.0, 4.0, 5.0]);
        let chosen = AnyfaceFaceOptions {
            fixed_numbers: numbers.as_ptr(),
            fixed_positions: places.as_ptr(),
            fixed_count: 2,
            ..options()
        };
        let library = unsafe { chosen.to_library() }.unwrap();
        let expected = [(8, [0.0, 1.0, 2.0]), (48, [3.0, 4.0, 5.0])];
        assert_eq!(
            library.fixed,
            expected.map(|(index, position)| FixedLandmark {
                index,
                place: LandmarkPlace::Position(position)
            })
        );
        let without_places = AnyfaceFaceOptions {
            fixed_positions: std::ptr::null(),
            ..chosen
        };
        assert!(unsafe { without_places.to_library() }.is_err());
    }

    #[test]
    fn roles_of_objects_come_before_roles_of_parts() {
        let (owners, roles) = ([0u32, 1, 1, u32::MAX, 2], [-1, 1, 5]);
        let (number, part_role) = ([3u32], [6]);
        let chosen = AnyfaceFaceOptions {
            object_of_vertex: owners.as_ptr(),
            object_vertex_count: owners.len(),
            object_roles: roles.as_ptr(),
            object_count: roles.len(),
            part_numbers: number.as_ptr(),
            part_roles: part_role.as_ptr(),
            part_count: 1,
            ..options()
        };
        let parts = unsafe { chosen.to_library() }.unwrap().parts;
        let named = |name: &str| PartSelector::Name(name.into());
        let expected = [
            (named("1"), PartRole::Jaw),
            (named("2"), PartRole::Gaze),
            (PartSelector::Number(3), PartRole::Still),
        ];
        assert_eq!(parts.roles, expected);
        assert_eq!(parts.names.of_vertex, owners);
        let too_few = AnyfaceFaceOptions {
            object_count: 2,
            ..chosen
        };
        assert!(unsafe { too_few.to_library() }.is_err());
    }
}
