//! How far both eyes of a head are open, beside those of the canonical face.

use ndarray::Array3;

use super::{Head, Opening};
use crate::{
    face::PartList,
    mesh::{Landmarks, Mesh, PartRole, Similarity, ibug::EYES},
};

/// What the upper lid does of a change of the opening; the lower lid does the rest.
pub(crate) const UPPER_SHARE: f32 = 0.9;
/// How far the lids of the canonical face travel towards each other until they are shut: `eyeBlink` of the
/// built-in face modes, mean of two pairs.
const CANONICAL_WAY_CM: f32 = 0.789;

/// The openings of the subject's right and left eye.
pub(crate) struct Openings([Option<Eye>; 2]);

struct Eye {
    /// At both pairs of landmarks, canonical centimetres.
    heights: [f32; 2],
    is_shut: bool,
}

impl Openings {
    /// Of the neutral face.
    pub(crate) fn of(
        mesh: &Mesh,
        landmarks: &Landmarks,
        to_canonical: &Similarity,
        parts: &PartList,
    ) -> Openings {
        let cm = |p: &[f32; 3]| to_canonical.apply(*p).map(|x| 100.0 * x);
        let positions: Vec<[f32; 3]> = mesh.positions.iter().map(cm).collect();
        let of = |role| -> Vec<[u32; 3]> {
            let all = mesh.triangles.iter().copied();
            all.filter(|t| parts.is(t[0] as usize, role)).collect()
        };
        let head = Head {
            positions: &positions,
            landmarks: &landmarks.positions.map(|p| cm(&p)),
            skin: &of(PartRole::Skin),
            eyeballs: &of(PartRole::Gaze),
        };
        Openings(EYES.each_ref().map(|eye| {
            let opening = Opening::find(&head, eye.lids.start)?;
            Some(Eye {
                heights: eye
                    .pairs
                    .map(|pair| opening.height_at(head.landmarks, pair)),
                is_shut: opening.is_shut,
            })
        }))
    }

    /// Whether each eye is sculpted shut.
    pub(crate) fn shut(&self) -> [bool; 2] {
        let shut = |eye: &Option<Eye>| eye.as_ref().is_some_and(|eye| eye.is_shut);
        self.0.each_ref().map(shut)
    }

    /// Lets lids travel as far as these eyes are open, and not at all where they are sculpted shut.
    /// `moved`: `[T, 68, 3]`, canonical metres.
    pub(crate) fn to_own(&self, moved: &mut Array3<f32>) {
        self.travel(moved, |height| height / CANONICAL_WAY_CM);
    }

    /// The way back of [`Openings::to_own`]; lids that are sculpted shut rest.
    pub(crate) fn to_canonical(&self, moved: &mut Array3<f32>) {
        self.travel(moved, |height| CANONICAL_WAY_CM / height);
    }

    /// Makes lids travel so many times as far, told by the height of an opening in centimetres.
    fn travel(&self, moved: &mut Array3<f32>, times: impl Fn(f32) -> f32) {
        for mut frame in moved.outer_iter_mut() {
            for (eye, marks) in self.0.iter().zip(&EYES) {
                let Some(eye) = eye else {
                    continue;
                };
                if eye.is_shut {
                    marks.lids.clone().for_each(|n| frame.row_mut(n).fill(0.0));
                    continue;
                }
                for ((upper, lower), height) in marks.pairs.into_iter().zip(eye.heights) {
                    let closing = frame[[lower, 1]] - frame[[upper, 1]];
                    let more = closing * (times(height) - 1.0);
                    frame[[upper, 1]] -= UPPER_SHARE * more;
                    frame[[lower, 1]] += (1.0 - UPPER_SHARE) * more;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::FaceModes;

    #[test]
    fn the_canonical_way_is_that_of_the_blink_of_the_face_modes() {
        let modes = FaceModes::open(None).unwrap();
        for eye in &EYES {
            let blink = modes.mode(eye.mode).unwrap();
            let ways = eye.pairs.map(|(u, l)| blink[[l, 1]] - blink[[u, 1]]);
            let way = 100.0 * 0.5 * (ways[0] + ways[1]);
            assert!((way - CANONICAL_WAY_CM).abs() < 2e-3, "{way}");
        }
    }

    #[test]
    fn lids_travel_by_the_same_share_of_a_wider_eye_and_rest_where_it_is_shut() {
        let wide = Eye {
            heights: [2.0 * CANONICAL_WAY_CM; 2],
            is_shut: false,
        };
        let shut = Eye {
            heights: [0.1; 2],
            is_shut: true,
        };
        let mut moved = Array3::zeros((1, 68, 3));
        for n in [37, 38, 43, 44] {
            moved[[0, n, 1]] = -0.004;
        }
        moved[[0, 19, 1]] = 0.002;
        Openings([Some(wide), Some(shut)]).to_own(&mut moved);
        let closing = |u: usize, l: usize| moved[[0, l, 1]] - moved[[0, u, 1]];
        assert!((closing(37, 41) - 0.008f32).abs() < 1e-6 && moved[[0, 19, 1]] == 0.002);
        assert_eq!(closing(43, 47), 0.0);
    }
}
