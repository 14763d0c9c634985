//! How far the eyes of a head are open, compared with those of the canonical face. A head may have
//! one eye, or more than two.

use std::ops::Range;

use glam::Vec3;
use ndarray::{Array3, ArrayViewMut2};

use super::{
    Head, Lids, Opening,
    balls::{Ball, Owner},
    ease,
};
use crate::{
    face::PartList,
    mesh::{
        Landmarks, Mesh, PartRole, Similarity,
        ibug::{EYES, Eye, LANDMARKS, MIRROR},
    },
};

/// The upper lid's share of a change of the opening. The lower lid does the rest.
pub(crate) const UPPER_SHARE: f32 = 0.9;
/// How far the lids of the canonical face travel towards each other until they are shut. This is
/// the mean over two pairs of landmarks in `eyeBlink` of the built-in face modes.
const CANONICAL_WAY_CM: f32 = 0.789;

/// Where lids cannot close, a whole blink lowers the brow by this much, canonical metres.
pub(crate) const SQUINT_M: f32 = 0.003;
/// The share of the blink at which the brow starts to move.
const SQUINT_FROM: f32 = 0.4;

/// The eyes of a head.
pub(crate) struct Openings {
    /// The subject's right and left eye. `None` where the landmarks are not the corners of an eye,
    /// or where one eye stands for both.
    of_landmarks: [Option<Opening>; 2],
    /// Further eyes: one in the middle that stands for both, or a third.
    more: Vec<Opening>,
    /// Whether the head is a cyclops, whose eye in the middle stands for both.
    is_one: bool,
}

/// The lids of one eye, and the eyes whose landmarks say how far these lids close.
pub(crate) struct LidDrive<'a> {
    pub opening: &'a Opening,
    /// Indices into [`EYES`], and how far each of those eyes is open at its pairs of landmarks,
    /// centimetres.
    pub eyes: Vec<(usize, [f32; 2])>,
    /// Whether the eye that closes furthest counts where there are several. Otherwise the eye that
    /// closes least counts.
    pub larger: bool,
    /// Landmarks that move no skin. At most they say how far these lids close.
    pub silent: Range<usize>,
    /// Whether no landmarks lie on these lids.
    pub is_alone: bool,
}

impl Openings {
    /// Measures the eyes of the neutral face.
    pub(crate) fn of(
        mesh: &Mesh,
        landmarks: &Landmarks,
        to_canonical: &Similarity,
        parts: &PartList,
    ) -> Openings {
        let cm = |p: &[f32; 3]| to_canonical.apply(*p).map(|x| 100.0 * x);
        let positions: Vec<[f32; 3]> = mesh.positions.iter().map(cm).collect();
        let skin = mesh.triangles.iter().copied();
        let skin: Vec<[u32; 3]> = skin
            .filter(|t| parts.is(t[0] as usize, PartRole::Skin))
            .collect();
        let marks = landmarks.positions.map(|p| cm(&p));
        let head = Head {
            positions: &positions,
            landmarks: &marks,
            skin: &skin,
        };
        let balls = Ball::of(&positions, &mesh.triangles, parts);
        let owners = Ball::owners(&balls, EYES.each_ref().map(|eye| eye_at(&marks, eye)));
        let about = |owner: Owner| {
            let pairs = owners.iter().zip(&balls);
            pairs
                .filter(move |(of, _)| **of == owner)
                .map(|(_, ball)| ball)
        };
        let one = about(Owner::Both).find_map(|ball| Opening::about(&head, ball));
        let find = |eye: usize| {
            let ball = about(Owner::Eye(eye)).next();
            let ball = ball.or_else(|| about(Owner::Both).next());
            let triangles = ball.map_or(&[][..], |ball| &ball.triangles);
            Opening::find(&head, &EYES[eye], triangles)
        };
        let third = about(Owner::Nobody).filter_map(|ball| Opening::about(&head, ball));
        match one {
            Some(one) => Openings {
                of_landmarks: [None, None],
                more: std::iter::once(one).chain(third).collect(),
                is_one: true,
            },
            None => Openings {
                of_landmarks: [0, 1].map(find),
                more: third.collect(),
                is_one: false,
            },
        }
    }

    /// The lids of every eye of the head, and the landmarks that drive them.
    pub(crate) fn drives(&self) -> Vec<LidDrive<'_>> {
        let closing: Vec<(usize, [f32; 2])> = (0..2)
            .filter_map(|eye| {
                let opening = self.of_landmarks[eye]
                    .as_ref()
                    .filter(|opening| opening.lids == Lids::Close)?;
                Some((eye, opening.heights))
            })
            .collect();
        let canonical = [0, 1].map(|eye| (eye, [CANONICAL_WAY_CM; 2]));
        let drives = (0..2).filter_map(|eye| {
            let opening = self.of_landmarks[eye].as_ref()?;
            Some(LidDrive {
                opening,
                eyes: vec![(eye, opening.heights)],
                larger: true,
                silent: match opening.lids {
                    Lids::Close => 0..0,
                    Lids::Shut | Lids::Joined => EYES[eye].lids.clone(),
                },
                is_alone: false,
            })
        });
        let more = self.more.iter().map(|opening| LidDrive {
            opening,
            eyes: if closing.is_empty() {
                canonical.to_vec()
            } else {
                closing.clone()
            },
            larger: closing.is_empty(),
            silent: if self.is_one {
                EYES[0].lids.start..EYES[1].lids.end
            } else {
                0..0
            },
            is_alone: true,
        });
        drives.chain(more).collect()
    }

    /// The right (0) or left (1) eye at the landmarks. `None` where the landmarks are not the
    /// corners of an eye, or where one eye stands for both.
    pub(crate) fn of_eye(&self, eye: usize) -> Option<&Opening> {
        self.of_landmarks[eye].as_ref()
    }

    /// Whether one eye in the middle stands for both.
    pub(crate) fn is_one(&self) -> bool {
        self.is_one
    }

    /// What the lids of both eyes can do.
    pub(crate) fn lids(&self) -> [Lids; 2] {
        let lids = |eye: &Option<Opening>| eye.as_ref().map_or(Lids::Close, |eye| eye.lids);
        self.of_landmarks.each_ref().map(lids)
    }

    /// Converts landmark motion of the canonical face, `moved` `[T, 68, 3]`, canonical metres, to
    /// motion for these eyes.
    ///
    /// A whole blink moves the lids by the height of these openings. Where the lids cannot close,
    /// the brow goes down instead. A face with one eye in the middle has one brow.
    pub(crate) fn to_face(&self, moved: &mut Array3<f32>) {
        if self.is_one {
            moved.outer_iter_mut().for_each(join_brows)
        } else {
            self.squint(moved);
            self.travel(moved, |height| height / CANONICAL_WAY_CM);
        }
    }

    /// The inverse of [`Openings::to_face`], except for lids that cannot close.
    pub(crate) fn to_canonical(&self, moved: &mut Array3<f32>) {
        self.travel(moved, |height| CANONICAL_WAY_CM / height);
    }

    /// Whether only eyes without landmarks can blink.
    fn is_elsewhere(&self) -> bool {
        let closes =
            |eye: &Option<Opening>| eye.as_ref().is_some_and(|eye| eye.lids == Lids::Close);
        !self.more.is_empty() && !self.of_landmarks.iter().any(closes)
    }

    /// Whether each eye may move the lids at its landmarks, the subject's right eye first. The brow of
    /// an eye that may not squints instead.
    pub(crate) fn can_close(&self) -> [bool; 2] {
        let closes = |eye: &Option<Opening>| eye.as_ref().is_none_or(|eye| eye.lids == Lids::Close);
        let each = self.of_landmarks.each_ref().map(closes);
        each.map(|closes| closes || self.is_elsewhere())
    }

    /// Lowers the brow over lids that cannot close. The further they should close, the lower it
    /// goes.
    fn squint(&self, moved: &mut Array3<f32>) {
        for mut frame in moved.outer_iter_mut() {
            for (marks, can_close) in EYES.iter().zip(self.can_close()) {
                if can_close {
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

    /// Scales how far the lids travel. `times` gives the factor for the height of an opening in
    /// centimetres.
    fn travel(&self, moved: &mut Array3<f32>, times: impl Fn(f32) -> f32) {
        for mut frame in moved.outer_iter_mut() {
            for (eye, marks) in self.of_landmarks.iter().zip(&EYES) {
                let Some(eye) = eye else {
                    continue;
                };
                if eye.lids != Lids::Close {
                    if self.is_elsewhere() {
                        continue;
                    }
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

/// The middle between the corner landmarks of an eye, and its width.
fn eye_at(marks: &[[f32; 3]; LANDMARKS], eye: &Eye) -> Option<([f32; 3], f32)> {
    let [start, end] = [eye.lids.start, eye.lids.start + 3].map(|n| Vec3::from(marks[n]));
    let width = start.distance(end);
    (width > 0.0).then(|| (start.midpoint(end).into(), width))
}

/// Gives both brows the same motion, mostly that of the brow that moves more. `frame`: `[68, 3]`.
fn join_brows(mut frame: ArrayViewMut2<'_, f32>) {
    for n in EYES[0].brow.clone() {
        for (axis, side) in [(0, -1.0), (1, 1.0), (2, 1.0)] {
            let (right, left) = (frame[[n, axis]], side * frame[[MIRROR[n], axis]]);
            // Their mean, weighted by how far each moves.
            let whole = right.abs() + left.abs();
            let both = (right * right.abs() + left * left.abs()) / whole.max(1e-9);
            frame[[n, axis]] = both;
            frame[[MIRROR[n], axis]] = side * both;
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
        let openings = Openings {
            of_landmarks: [Some(wide), Some(joined)],
            more: Vec::new(),
            is_one: false,
        };
        openings.to_face(&mut moved);
        let closing = |u: usize, l: usize| moved[[0, l, 1]] - moved[[0, u, 1]];
        assert!((closing(37, 41) - 0.008f32).abs() < 1e-6 && moved[[0, 19, 1]] == 0.002);
        assert_eq!(closing(43, 47), 0.0);
        assert!(moved[[0, 24, 1]] < 0.0, "the brow squints instead");
    }
}
