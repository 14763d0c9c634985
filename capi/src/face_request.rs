//! What a request knows about a face, for `anyface_face_new()`.

use anyface::{
    Error, Result,
    conditions::Controls,
    face::FaceOptions,
    mesh::{
        Axis, FixedLandmark, KnownLandmark, LandmarkPlace, LandmarkSource, ObjectNames,
        PartChoices, PartRole, PartSelector, ibug::LANDMARKS,
    },
    systems::{FieldValue, NamedValue},
};
use ndarray::ArrayView1;

use crate::{
    error::Failure,
    numbers::{refuse, rows, whole},
};

/// What a connected part of the mesh is, and what it follows; for `anyface_face_new()` and
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

/// The number of no object, and of a role that the library recognises.
const NONE: f64 = -1.0;

/// What is known about a face.
#[derive(Default)]
pub(crate) struct FaceRequest {
    /// Landmarks as positions or from a file, fixed landmarks, and axes.
    known: FaceOptions,
    landmark_vertices: Option<Vec<u32>>,
    part_roles: Vec<(PartSelector, PartRole)>,
    /// `[V]`: the object of each vertex, `u32::MAX` for none.
    object_of_vertex: Vec<u32>,
    /// The role of the parts of each object; `None` if the library shall recognise them.
    object_roles: Vec<Option<PartRole>>,
}

impl FaceRequest {
    pub(crate) fn set_forward(&mut self, value: &NamedValue<'_>) -> Result<()> {
        self.known.forward = axis(value)?.unwrap_or(Axis::PosZ);
        Ok(())
    }

    pub(crate) fn set_up(&mut self, value: &NamedValue<'_>) -> Result<()> {
        self.known.up = axis(value)?.unwrap_or(Axis::PosY);
        Ok(())
    }

    pub(crate) fn set_landmarks(&mut self, value: &NamedValue<'_>) -> Result<()> {
        self.known.landmarks = match &value.value {
            FieldValue::Text(_) => value.text()?.map(LandmarkSource::from_json).transpose()?,
            FieldValue::Rows(None, rows) if rows.dim() == (LANDMARKS, 3) => {
                let positions = rows.outer_iter().map(|row| point(row));
                Some(LandmarkSource::Positions(positions.collect()))
            }
            _ => value.refuse("68 rows of 3, or the text of a landmark file")?,
        };
        Ok(())
    }

    pub(crate) fn set_landmark_vertices(&mut self, value: &NamedValue<'_>) -> Result<()> {
        let column = rows(value, 1)?;
        if column.nrows() != LANDMARKS {
            return refuse(value, "68 rows", column.nrows() as f64);
        }
        let vertices = column.iter().map(|&number| whole(value, number));
        self.landmark_vertices = Some(vertices.collect::<Result<_>>()?);
        Ok(())
    }

    pub(crate) fn set_fixed_landmarks(&mut self, value: &NamedValue<'_>) -> Result<()> {
        let rows = rows(value, 4)?;
        let fixed = rows.outer_iter().map(|row| {
            Ok(FixedLandmark {
                index: whole(value, row[0])? as usize,
                place: LandmarkPlace::Position(point(row.slice_move(ndarray::s![1..]))),
            })
        });
        self.known.fixed = fixed.collect::<Result<_>>()?;
        Ok(())
    }

    pub(crate) fn set_part_roles(&mut self, value: &NamedValue<'_>) -> Result<()> {
        let rows = rows(value, 2)?;
        let roles = rows.outer_iter().map(|row| {
            let part = PartSelector::Number(whole(value, row[0])?);
            Ok((part, role(value, row[1])?))
        });
        self.part_roles = roles.collect::<Result<_>>()?;
        Ok(())
    }

    pub(crate) fn set_object_of_vertex(&mut self, value: &NamedValue<'_>) -> Result<()> {
        let objects = rows(value, 1)?.into_iter().map(|&number| match number {
            NONE => Ok(u32::MAX),
            number => whole(value, number),
        });
        self.object_of_vertex = objects.collect::<Result<_>>()?;
        Ok(())
    }

    pub(crate) fn set_object_roles(&mut self, value: &NamedValue<'_>) -> Result<()> {
        let roles = rows(value, 1)?.into_iter().map(|&number| match number {
            NONE => Ok(None),
            number => role(value, number).map(Some),
        });
        self.object_roles = roles.collect::<Result<_>>()?;
        Ok(())
    }

    pub(crate) fn to_library(
        &self,
        controls: Controls,
    ) -> std::result::Result<FaceOptions, Failure> {
        let FaceOptions { forward, up, .. } = self.known;
        if forward.direction().map(f64::abs) == up.direction().map(f64::abs) {
            return Err(Failure::invalid(format!(
                "up: expected an axis across forward, got {up} with {forward}"
            )));
        }
        Ok(FaceOptions {
            landmarks: self.landmarks()?,
            parts: self.parts()?,
            controls,
            ..self.known.clone()
        })
    }

    fn landmarks(&self) -> Result<Option<LandmarkSource>> {
        let landmarks = self.known.landmarks.clone();
        let Some(vertices) = &self.landmark_vertices else {
            return Ok(landmarks);
        };
        match landmarks {
            None => Ok(Some(LandmarkSource::Vertices(vertices.clone()))),
            Some(LandmarkSource::Positions(positions)) => {
                let pairs = positions.into_iter().zip(vertices);
                let known = pairs.map(|(position, &vertex)| KnownLandmark {
                    position,
                    vertex,
                    confidence: 1.0,
                });
                Ok(Some(LandmarkSource::Known(known.collect())))
            }
            Some(_) => Err(Error::InvalidInput(
                "landmark_vertices: expected landmarks as rows beside them, got a landmark file"
                    .into(),
            )),
        }
    }

    /// Roles of objects, then roles of single parts. If a part has several, the last one counts.
    fn parts(&self) -> Result<PartChoices> {
        let count = self.object_roles.len();
        let beyond = |object: u32| object != u32::MAX && object as usize >= count;
        if let Some(wrong) = self.object_of_vertex.iter().find(|&&object| beyond(object)) {
            return Err(Error::InvalidInput(format!(
                "object_of_vertex: expected below {count}, the number of object_roles, got {wrong}"
            )));
        }
        let mut is_used = vec![false; count];
        for &object in &self.object_of_vertex {
            if let Some(used) = is_used.get_mut(object as usize) {
                *used = true;
            }
        }
        let roles = self.object_roles.iter().zip(is_used).enumerate();
        let of_objects = roles.filter_map(|(object, (role, is_used))| {
            let role = role.filter(|_| is_used)?;
            Some((PartSelector::Name(object.to_string()), role))
        });
        Ok(PartChoices {
            roles: of_objects.chain(self.part_roles.iter().cloned()).collect(),
            names: ObjectNames {
                names: (0..count).map(|object| object.to_string()).collect(),
                of_vertex: self.object_of_vertex.clone(),
            },
        })
    }
}

fn axis(value: &NamedValue<'_>) -> Result<Option<Axis>> {
    let Some(text) = value.text()? else {
        return Ok(None);
    };
    let axis = Axis::ALL.into_iter().find(|axis| axis.to_string() == text);
    match axis {
        Some(axis) => Ok(Some(axis)),
        None => value.refuse("one of +x, -x, +y, -y, +z and -z"),
    }
}

fn point(row: ArrayView1<'_, f64>) -> [f32; 3] {
    std::array::from_fn(|axis| row[axis] as f32)
}

fn role(value: &NamedValue<'_>, number: f64) -> Result<PartRole> {
    let known = ROLES.into_iter();
    let mut known = known.filter(|(code, _)| f64::from(*code as i32) == number);
    match known.next() {
        Some((_, role)) => Ok(role),
        None => refuse(value, "a role, 0 to 6", number),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{Options, find};
    use ndarray::{Array1, Array2};

    /// Sets one value after another.
    fn with(values: &[(&str, Given<'_>)]) -> std::result::Result<FaceOptions, Failure> {
        let mut options = Options::default();
        for (name, value) in values {
            let value = match value {
                Given::Text(text) => FieldValue::Text(text),
                Given::Rows(rows) => FieldValue::Rows(None, rows.view()),
            };
            (find(name).unwrap().set)(&mut options, &NamedValue { name, value })?;
        }
        options.face.to_library(Controls::default())
    }

    enum Given<'a> {
        Text(&'a str),
        Rows(Array2<f64>),
    }

    fn text(text: &str) -> Given<'_> {
        Given::Text(text)
    }

    fn rows_of<const N: usize>(rows: &[[f64; N]]) -> Given<'static> {
        Given::Rows(Array2::from_shape_fn((rows.len(), N), |(row, column)| {
            rows[row][column]
        }))
    }

    #[test]
    fn nothing_gives_the_defaults() {
        assert_eq!(with(&[]).unwrap(), FaceOptions::default());
    }

    #[test]
    fn axes_must_exist_and_cross() {
        let blender = with(&[("forward", text("-y")), ("up", text("+z"))]).unwrap();
        assert_eq!((blender.forward, blender.up), (Axis::NegY, Axis::PosZ));
        assert!(with(&[("forward", text("y"))]).is_err());
        let message = with(&[("forward", text("-y"))]).unwrap_err().message();
        assert!(message.contains("got +y with -y"), "{message}");
    }

    #[test]
    fn landmarks_come_as_places_numbers_both_or_text() {
        let numbers = Array1::from_iter((0..68).map(f64::from));
        let vertices = || Given::Rows(numbers.clone().insert_axis(ndarray::Axis(1)));
        let places = || Given::Rows(Array2::from_elem((68, 3), 0.5));
        let landmarks = |values: &[_]| with(values).unwrap().landmarks;
        assert_eq!(
            landmarks(&[("landmark_vertices", vertices())]),
            Some(LandmarkSource::Vertices((0..68).collect()))
        );
        assert_eq!(
            landmarks(&[("landmarks", places())]),
            Some(LandmarkSource::Positions(vec![[0.5; 3]; 68]))
        );
        let known = (0..68).map(|vertex| KnownLandmark {
            position: [0.5; 3],
            vertex,
            confidence: 1.0,
        });
        assert_eq!(
            landmarks(&[("landmarks", places()), ("landmark_vertices", vertices())]),
            Some(LandmarkSource::Known(known.collect()))
        );
        assert_eq!(
            landmarks(&[("landmarks", places()), ("landmarks", text(""))]),
            None
        );
        assert!(with(&[("landmarks", text("[1, 2"))]).is_err());
        assert!(with(&[("landmark_vertices", rows_of(&[[1.0]]))]).is_err());
        assert!(with(&[("landmarks", rows_of(&[[1.0, 2.0, 3.0]]))]).is_err());
    }

    #[test]
    fn parts_have_the_numbers_of_the_librarys_roles() {
        let parts = with(&[("part_roles", rows_of(&[[4.0, 1.0], [2.0, 6.0]]))])
            .unwrap()
            .parts;
        let expected = [(4, PartRole::Jaw), (2, PartRole::Still)];
        let expected = expected.map(|(n, role)| (PartSelector::Number(n), role));
        assert_eq!(parts.roles, expected);
        assert!(with(&[("part_roles", rows_of(&[[4.0, 7.0]]))]).is_err());
        assert!(with(&[("part_roles", rows_of(&[[-4.0, 1.0]]))]).is_err());
    }

    #[test]
    fn fixed_landmarks_reach_the_library() {
        let rows = [[8.0, 0.0, 1.0, 2.0], [48.0, 3.0, 4.0, 5.0]];
        let fixed = with(&[("fixed_landmarks", rows_of(&rows))]).unwrap().fixed;
        let expected = [(8, [0.0, 1.0, 2.0]), (48, [3.0, 4.0, 5.0])];
        let expected = expected.map(|(index, position)| FixedLandmark {
            index,
            place: LandmarkPlace::Position(position),
        });
        assert_eq!(fixed, expected);
        assert!(with(&[("fixed_landmarks", rows_of(&[[8.0, 0.0, 1.0]]))]).is_err());
    }

    #[test]
    fn roles_of_objects_come_before_roles_of_parts() {
        let owners = || rows_of(&[[0.0], [1.0], [1.0], [-1.0], [2.0]]);
        // No vertex belongs to the last object.
        let roles = rows_of(&[[-1.0], [1.0], [5.0], [6.0]]);
        let one = rows_of(&[[3.0, 6.0]]);
        let values = [
            ("object_of_vertex", owners()),
            ("object_roles", roles),
            ("part_roles", one),
        ];
        let parts = with(&values).unwrap().parts;
        let named = |name: &str| PartSelector::Name(name.into());
        let expected = [
            (named("1"), PartRole::Jaw),
            (named("2"), PartRole::Gaze),
            (PartSelector::Number(3), PartRole::Still),
        ];
        assert_eq!(parts.roles, expected);
        assert_eq!(parts.names.of_vertex, [0, 1, 1, u32::MAX, 2]);
        let too_few = [
            ("object_of_vertex", owners()),
            ("object_roles", rows_of(&[[1.0], [1.0]])),
        ];
        assert!(with(&too_few).is_err());
    }
}
