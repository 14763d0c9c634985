//! What a caller knows of a mesh beside its landmarks, and how landmarks and parts are copied out.

use anyface::{
    deform::PartList,
    mesh::{
        FixedLandmark, LandmarkPlace, Landmarks, ObjectNames, PartChoices, PartRole, PartSelector,
    },
    motion::LANDMARKS,
};

use crate::{
    error::Failure,
    face::{AnyfaceFaceOptions, ROLES},
    pointer,
};

/// The role of an object whose parts are told by shape and place.
const BY_SHAPE: i32 = -1;

/// The landmarks that stay.
///
/// # Safety
/// Every pointer of `options` is NULL or as its field says.
pub(crate) unsafe fn fixed(options: &AnyfaceFaceOptions) -> Result<Vec<FixedLandmark>, Failure> {
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

/// Roles of objects, then roles of single parts: of several for one part the last one counts.
///
/// # Safety
/// Every pointer of `options` is NULL or as its field says.
pub(crate) unsafe fn parts(options: &AnyfaceFaceOptions) -> Result<PartChoices, Failure> {
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

fn role(field: &str, code: i32) -> Result<PartRole, Failure> {
    let known = ROLES.into_iter().find(|(known, _)| *known as i32 == code);
    known
        .map(|(_, role)| role)
        .ok_or_else(|| Failure::invalid(format!("{field}: expected 0 to 6, got {code}")))
}

/// Copies the 68 landmarks into buffers, each of which may be NULL.
///
/// # Safety
/// Each buffer is NULL or has room for what it takes.
pub(crate) unsafe fn copy_landmarks(
    landmarks: &Landmarks,
    positions: *mut f32,
    vertices: *mut u32,
    confidence: *mut f32,
) -> Result<(), Failure> {
    if !positions.is_null() {
        let values = landmarks.positions.as_flattened();
        unsafe { pointer::copy_out("positions", values, positions, values.len()) }?;
    }
    if !vertices.is_null() {
        unsafe { pointer::copy_out("vertices", &landmarks.vertices, vertices, LANDMARKS) }?;
    }
    if !confidence.is_null() {
        let values = &landmarks.confidence;
        unsafe { pointer::copy_out("confidence", values, confidence, LANDMARKS) }?;
    }
    Ok(())
}

/// Copies what each part is into buffers, each of which may be NULL.
///
/// # Safety
/// Each buffer is NULL or has room for what it takes.
pub(crate) unsafe fn copy_parts(
    list: &PartList,
    roles: *mut i32,
    part_of_vertex: *mut u32,
) -> Result<(), Failure> {
    if !roles.is_null() {
        let code = |role| ROLES.into_iter().find(|(_, known)| *known == role);
        let parts = list.parts.iter();
        let values: Vec<i32> = parts
            .filter_map(|part| code(part.role).map(|(code, _)| code as i32))
            .collect();
        unsafe { pointer::copy_out("roles", &values, roles, list.parts.len()) }?;
    }
    if !part_of_vertex.is_null() {
        let values = list.of_vertex();
        unsafe { pointer::copy_out("part_of_vertex", values, part_of_vertex, values.len()) }?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        face::AnyfacePartRole,
        growing::{self, Growing},
    };

    fn options() -> AnyfaceFaceOptions {
        Growing::defaults()
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

    #[test]
    fn an_older_host_says_nothing_of_fixed_landmarks() {
        let mut old = options();
        old.struct_size = std::mem::offset_of!(AnyfaceFaceOptions, fixed_numbers);
        old.fixed_count = 9;
        old.object_count = 9;
        let read = unsafe { growing::read(&raw const old) }.unwrap();
        let library = unsafe { read.to_library() }.unwrap();
        assert_eq!(library, anyface::mesh::FaceOptions::default());
    }
}
