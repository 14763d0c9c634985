//! Landmarks that the caller fixes. The library finds the others.
//!
//! They are read from JSON in the format of `Landmarks`. Any of the 68 may be left out:
//! `{"version": 1, "landmarks": [{"index": 48, "vertex": 1201}, {"index": 8, "position": [x, y, z]}]}`.
//! Where an entry has both a vertex and a position, the position counts.

use super::{Mesh, ibug::LANDMARKS};
use crate::{Error, Result};

/// A landmark that stays where the caller puts it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixedLandmark {
    /// 0 to 67, iBUG order.
    pub index: usize,
    /// Where it is.
    pub place: LandmarkPlace,
}

/// The five landmarks that say where a face is: the outer corners of its right and left eye, the
/// tip of its nose, and the right and left corner of its mouth. Right and left are the subject's.
pub const FIVE_POINTS: [usize; 5] = [36, 45, 30, 48, 54];

/// Where a fixed landmark is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LandmarkPlace {
    /// A point in the mesh's own units. It moves to the nearest suitable point on the surface.
    Position([f32; 3]),
    /// A vertex number.
    Vertex(u32),
}

impl FixedLandmark {
    /// Its place, mesh units.
    ///
    /// # Errors
    /// `InvalidInput` if the index is not below 68, the mesh lacks the vertex, or the position is
    /// not finite.
    pub(super) fn position_on(&self, mesh: &Mesh) -> Result<[f32; 3]> {
        let index = self.index;
        if index >= LANDMARKS {
            return Err(Error::InvalidInput(format!(
                "fixed landmarks: expected index below 68, got {index}"
            )));
        }
        let count = mesh.positions.len();
        let place = match self.place {
            LandmarkPlace::Position(position) => Some(position),
            LandmarkPlace::Vertex(vertex) => mesh.positions.get(vertex as usize).copied(),
        };
        let place = place.ok_or_else(|| {
            Error::InvalidInput(format!(
                "fixed landmark {index}: expected a vertex below {count}, got {:?}",
                self.place
            ))
        })?;
        if place.iter().all(|x| x.is_finite()) {
            Ok(place)
        } else {
            Err(Error::InvalidInput(format!(
                "fixed landmark {index}: position is not finite"
            )))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_landmarks_by_vertex_and_some_by_place_are_read() {
        let text = r#"{"version": 1, "landmarks": [{"index": 48, "vertex": 7},
            {"index": 8, "position": [1.0, 2.0, 3.0], "vertex": 2, "confidence": 0.5}]}"#;
        let fixed = FixedLandmark::from_json(text).unwrap();
        let place = |index, place| FixedLandmark { index, place };
        let position = LandmarkPlace::Position([1.0, 2.0, 3.0]);
        assert_eq!(fixed[0], place(8, position));
        assert_eq!(fixed[1], place(48, LandmarkPlace::Vertex(7)));
    }

    #[test]
    fn defects_of_fixed_landmarks_are_named() {
        let wrap = |entries: &str| format!("{{\"version\": 1, \"landmarks\": [{entries}]}}");
        for (text, expected) in [
            (wrap(r#"{"index": 68, "vertex": 1}"#), "below 68, got 68"),
            (wrap(r#"{"index": 3}"#), "3 has neither"),
            (
                wrap(r#"{"index": 3, "vertex": 1}, {"index": 3, "vertex": 2}"#),
                "3 appears twice",
            ),
            ("[1, 2]".into(), "landmarks: "),
        ] {
            let error = FixedLandmark::from_json(&text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error} does not say {expected}");
        }
    }

    #[test]
    fn a_vertex_that_the_mesh_does_not_have_is_named() {
        let fixed = FixedLandmark {
            index: 30,
            place: LandmarkPlace::Vertex(9),
        };
        let error = fixed.position_on(&Mesh::default()).unwrap_err().to_string();
        assert!(
            error.contains("landmark 30") && error.contains("below 0"),
            "{error}"
        );
    }
}
