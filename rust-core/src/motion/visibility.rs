//! Tells whether a viewer sees the face speak, so that a face that does not move is never passed
//! over.

use ndarray::{ArrayView3, Axis, s};

use crate::mesh::ibug::MOUTH;

/// A face does not visibly move if no vertex is displaced by this much, in mm on a head of human
/// size.
pub const VISIBLE_MM: f32 = 0.05;
/// Lips speak if they travel at least this far from their usual position, in mm on a head of human
/// size. With the default weights they travel by up to 0.9 mm under noise, hiss and clicks, and by
/// 4.8 mm under a spoken sentence, even if it is a hundred times quieter.
pub const SPOKEN_MM: f32 = 1.0;
/// An articulation below this means that the lips are not meant to move.
const NO_ARTICULATION: f32 = 0.05;

/// What a viewer sees of a performance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Visibility {
    /// The mouth speaks, or was asked to rest.
    Speaks,
    /// The face moves, such as lids and brows, but the lips do not.
    LipsRest,
    /// Nothing moves.
    Nothing,
}

impl Visibility {
    /// `largest_mm`: the largest displacement of any vertex in any frame. `lips_mm`: [`lip_travel`]
    /// in mm. Both are for a head of human size. `articulation`: the requested articulation, 1 is
    /// normal.
    pub fn of(largest_mm: f32, lips_mm: f32, articulation: f32) -> Visibility {
        if largest_mm < VISIBLE_MM {
            Visibility::Nothing
        } else if articulation >= NO_ARTICULATION && lips_mm < SPOKEN_MM * articulation {
            Visibility::LipsRest
        } else {
            Visibility::Speaks
        }
    }
}

/// The largest displacements over all frames of a motion, in its own unit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Extent {
    /// The largest of any vertex, if there is a mesh.
    pub largest: Option<f32>,
    /// The largest of any landmark.
    pub landmarks: f32,
    /// The largest of the lips from their usual position: [`lip_travel`].
    pub lips: f32,
}

impl Extent {
    /// `largest`: the largest of any vertex, if there is a mesh. `landmarks`: `[T, 68, 3]`.
    pub fn of(largest: Option<f32>, landmarks: ArrayView3<'_, f32>) -> Extent {
        let rows = landmarks.rows().into_iter();
        Extent {
            largest,
            landmarks: rows.map(|d| d.dot(&d)).fold(0.0, f32::max).sqrt(),
            lips: lip_travel(landmarks),
        }
    }

    /// The extent of this part of a motion and another part together.
    #[must_use]
    pub fn with(self, other: Extent) -> Extent {
        let largest = self.largest.into_iter().chain(other.largest);
        Extent {
            largest: largest.reduce(f32::max),
            landmarks: self.landmarks.max(other.landmarks),
            lips: self.lips.max(other.lips),
        }
    }
}

/// The farthest that any lip landmark gets from its median position, in the unit of `landmarks`
/// `[T, 68, 3]`.
///
/// Blinks, brows and a lasting expression do not count.
pub fn lip_travel(landmarks: ArrayView3<'_, f32>) -> f32 {
    let lips = landmarks.slice(s![.., MOUTH, ..]);
    let middle = lips.map_axis(Axis(0), |track| median(track.to_vec()));
    let mut most = 0.0f32;
    for frame in lips.outer_iter() {
        let away = &frame - &middle;
        let squares = away.rows().into_iter().map(|d| d.dot(&d));
        most = squares.fold(most, f32::max);
    }
    most.sqrt()
}

fn median(mut values: Vec<f32>) -> f32 {
    values.sort_by(f32::total_cmp);
    let half = values.len() / 2;
    match values.len() {
        0 => 0.0,
        count if count % 2 == 1 => values[half],
        _ => 0.5 * (values[half - 1] + values[half]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn a_lasting_smile_and_a_blink_are_no_speech_but_an_opening_mouth_is() {
        let mut motion = Array3::zeros((9, 68, 3));
        motion.slice_mut(s![.., 48, 0]).fill(5.0);
        motion[[4, 43, 1]] = -8.0;
        assert_eq!(lip_travel(motion.view()), 0.0);
        motion[[4, 66, 1]] = -4.0;
        assert_eq!(lip_travel(motion.view()), 4.0);
        assert_eq!(lip_travel(Array3::zeros((0, 68, 3)).view()), 0.0);
    }

    #[test]
    fn the_extent_of_parts_is_that_of_the_whole() {
        let mut motion = Array3::zeros((9, 68, 3));
        motion[[7, 66, 1]] = -4.0;
        motion[[2, 20, 2]] = 5.0;
        let part = |rows, largest| Extent::of(Some(largest), motion.slice(s![rows, .., ..]));
        let parts = part(0..4, 6.0).with(part(4..9, 1.0));
        assert_eq!(parts, Extent::of(Some(6.0), motion.view()));
        assert_eq!((parts.landmarks, parts.lips), (5.0, 4.0));
    }

    #[test]
    fn what_is_seen_depends_on_the_lips_and_on_what_was_asked_of_them() {
        assert_eq!(Visibility::of(0.04, 0.0, 1.0), Visibility::Nothing);
        assert_eq!(Visibility::of(8.0, 0.9, 1.0), Visibility::LipsRest);
        assert_eq!(Visibility::of(8.0, 0.9, 0.5), Visibility::Speaks);
        assert_eq!(Visibility::of(8.0, 0.0, 0.0), Visibility::Speaks);
        assert_eq!(Visibility::of(8.0, 1.0, 1.0), Visibility::Speaks);
    }
}
