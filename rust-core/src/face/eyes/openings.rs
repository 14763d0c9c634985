//! How far both eyes of a head are open, beside those of the canonical face.

use ndarray::Array3;

use super::{Head, Lids, Opening, ease};
use crate::{
    face::PartList,
    mesh::{Landmarks, Mesh, PartRole, Similarity, ibug::EYES},
};

/// What the upper lid does of a change of the opening; the lower lid does the rest.
pub(crate) const UPPER_SHARE: f32 = 0.9;
/// How far the lids of the canonical face travel towards each other until they are shut: `eyeBlink` of the
/// built-in face modes, mean of two pairs.
const CANONICAL_WAY_CM: f32 = 0.789;

/// A whole blink of an eye whose lids rest lowers its brow by this much, and from this share of closing on it does,
/// canonical metres.
const SQUINT_M: f32 = 0.003;
const SQUINT_FROM: f32 = 0.4;

/// The openings of the subject's right and left eye.
pub(crate) struct Openings([Option<Opening>; 2]);

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
        Openings(EYES.each_ref().map(|eye| Opening::find(&head, eye)))
    }

    /// Those of the right and of the left eye; `None` where there are no corners of an eye.
    pub(crate) fn each(&self) -> &[Option<Opening>; 2] {
        &self.0
    }

    /// What the lids of both eyes can do.
    pub(crate) fn lids(&self) -> [Lids; 2] {
        let lids = |eye: &Option<Opening>| eye.as_ref().map_or(Lids::Close, |eye| eye.lids);
        self.0.each_ref().map(lids)
    }

    /// Lets lids travel as far as these eyes are open. Where lids rest, the brow is lowered instead.
    /// `moved`: `[T, 68, 3]`, canonical metres.
    pub(crate) fn to_own(&self, moved: &mut Array3<f32>) {
        self.squint(moved);
        self.travel(moved, |height| height / CANONICAL_WAY_CM);
    }

    /// The way back of [`Openings::to_own`], but for lids that rest.
    pub(crate) fn to_canonical(&self, moved: &mut Array3<f32>) {
        self.travel(moved, |height| CANONICAL_WAY_CM / height);
    }

    /// Lowers the brows of eyes whose lids rest, by the share that these are asked to close.
    fn squint(&self, moved: &mut Array3<f32>) {
        for mut frame in moved.outer_iter_mut() {
            for (eye, marks) in self.0.iter().zip(&EYES) {
                if eye.as_ref().is_none_or(|eye| eye.lids == Lids::Close) {
                    continue;
                }
                let ways = marks.pairs.map(|(u, l)| frame[[l, 1]] - frame[[u, 1]]);
                let closed = 50.0 * (ways[0] + ways[1]) / CANONICAL_WAY_CM;
                let squint = ease((closed - SQUINT_FROM) / (1.0 - SQUINT_FROM));
                marks
                    .brow
                    .clone()
                    .for_each(|n| frame[[n, 1]] -= SQUINT_M * squint);
            }
        }
    }

    /// Makes lids travel so many times as far, told by the height of an opening in centimetres.
    fn travel(&self, moved: &mut Array3<f32>, times: impl Fn(f32) -> f32) {
        for mut frame in moved.outer_iter_mut() {
            for (eye, marks) in self.0.iter().zip(&EYES) {
                let Some(eye) = eye else {
                    continue;
                };
                if eye.lids != Lids::Close {
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
    use super::{
        super::{EyeFrame, Eyeball, SAMPLES},
        *,
    };
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
    fn lids_travel_by_the_same_share_of_a_wider_eye_and_rest_where_they_cannot_close() {
        let eye = |height: f32, lids: Lids| Opening {
            frame: EyeFrame {
                origin: [0.0; 3],
                axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            },
            ball: Eyeball::new(1.2, &[]),
            width: 2.8,
            edges: [[[0.0; 3]; SAMPLES]; 2],
            heights: [height; 2],
            lids,
        };
        let wide = eye(2.0 * CANONICAL_WAY_CM, Lids::Close);
        let joined = eye(CANONICAL_WAY_CM, Lids::Joined);
        let mut moved = Array3::zeros((1, 68, 3));
        for n in [37, 38, 43, 44] {
            moved[[0, n, 1]] = -0.004;
        }
        moved[[0, 19, 1]] = 0.002;
        Openings([Some(wide), Some(joined)]).to_own(&mut moved);
        let closing = |u: usize, l: usize| moved[[0, l, 1]] - moved[[0, u, 1]];
        assert!((closing(37, 41) - 0.008f32).abs() < 1e-6 && moved[[0, 19, 1]] == 0.002);
        assert_eq!(closing(43, 47), 0.0);
        assert!(moved[[0, 24, 1]] < 0.0, "the brow squints instead");
    }
}
