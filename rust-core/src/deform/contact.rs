//! Lips that touch: their rims neither pass through one another nor stay apart.
//!
//! Weights over landmarks do not know that two rims face each other. A mouth whose landmarks meet may therefore show a
//! gap, or its lips may overlap. This module measures the gap between both rims in every frame and moves the skin
//! beside them to mend it.
//!
//! Once, in the neutral face:
//! 1. The line between the inner corners of the mouth gives each point a place along it, from 0 to 1, and a height.
//! 2. Dijkstra along the edges, from the inner landmarks of both lips, says which vertices belong to which lip.
//! 3. The line is divided into [`PIECES`]. The rim of the upper lip has the lowest vertex of each piece, that of the
//!    lower lip the highest. Only vertices within [`RIM_CM`] of their lip's landmarks count.
//! 4. Each of [`SAMPLES`] places along the line stores the two rim vertices of each lip beside it,
//!    and the neutral gap.
//! 5. The skin beside the rims, and every vertex that follows it, gets a share of each change of
//!    the gap. The share is half at the upper rim and minus half at the lower one. It fades to 0 at
//!    the reach of the slit.
//!
//! In each frame:
//! 1. Where the gap is less than 0, the rims are pushed apart until it is 0. Rims that already
//!    overlap in the neutral face may keep that overlap.
//! 2. Where the landmarks have met but the rims have not, the rims are pulled together. The pull
//!    grows as the landmarks come nearer to one another. Gaps of [`PULL_CM`] or more are not
//!    pulled, because the landmarks cannot lie on rims so far apart.
//! 3. Both are smoothed along the line, and every vertex moves up or down by its share of the change at its place.
//!
//! The preparation costs a few passes over V, and up to [`PIECES`] distances for each vertex near the mouth. A frame
//! costs one pass over the samples and one over the vertices with a share. Nothing iterates.
//!
//! Not obvious: a push is spread by the maximum over its neighbours before it is smoothed. So the
//! smoothed push is large enough everywhere to open the crossing. A pull leaves a part of the gap,
//! a larger part of a wider gap, and is only smoothed. Beside a place with a larger pull it may go
//! slightly too far. A frame in which no gap changes stays the same, bit for bit.
//!
//! What can go wrong: the corners lie less than a millimetre apart or one above the other, or a lip
//! has fewer than two rim vertices. Then there is no [`Slit`], and the mouth follows its landmarks
//! alone. A lip without edges to the skin at the landmarks belongs to neither side and gets no
//! share.
//!
//! Lengths are canonical centimetres.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::{
    face::{Skin, binding::Follows, nearest::nearest_between},
    mesh::{
        Mesh, Similarity,
        ibug::LANDMARKS,
        lips::{Lip, lip_of_vertices},
    },
};

/// Beards stick out from the rim by no more than this.
const REACH_OF_PARTS_CM: f32 = 2.0;
/// Places from corner to corner at which the gap is measured.
const SAMPLES: usize = 24;
/// Pieces from corner to corner. A rim has at most one vertex in each.
const PIECES: usize = 32;
/// A rim vertex lies at most this far from the line through its landmarks.
const RIM_CM: f32 = 0.3;
/// Two landmarks have met when they are nearer than this and nearer than half their neutral distance.
const MET_CM: f32 = 0.05;
/// Rims further apart than this stay apart, because their landmarks do not lie on them.
const PULL_CM: f32 = 0.3;

/// The landmarks of a slit.
struct Marks {
    upper: &'static [usize],
    lower: &'static [usize],
    /// A correction fades to nothing at this distance from the rims.
    reach_cm: f32,
}

const MOUTH: Marks = Marks {
    upper: &[60, 61, 62, 63, 64],
    lower: &[60, 67, 66, 65, 64],
    reach_cm: 1.2,
};

/// The numbers of two vertices or landmarks, with their shares.
type Between = [(u32, f32); 2];

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Sample {
    upper: Between,
    lower: Between,
    gap: f32,
    upper_marks: Between,
    lower_marks: Between,
    marks_gap: f32,
}

/// The rims of the mouth, and the vertices that move with them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Slit {
    /// Unit vector from the lower to the upper rim, in the mesh's own axes.
    up: [f32; 3],
    /// Mesh units to centimetres.
    to_cm: f32,
    samples: Vec<Sample>,
    /// Vertex, its place among the samples, and its share of the change of the gap there. The share is half
    /// at the upper rim and minus half at the lower one.
    touched: Vec<(u32, f32, f32)>,
}

/// The parts of the neutral face that the search for rims needs, canonical centimetres.
struct NeutralFace<'a> {
    /// The skin with its seams sewn up.
    mesh: &'a Mesh,
    landmarks: &'a [[f32; 3]; LANDMARKS],
    /// Vertex of the skin at each landmark.
    vertices: &'a [u32; LANDMARKS],
    /// `[V]`, for each vertex the vertex of `mesh` that stands for it.
    sewn: &'a [u32],
    follows: &'a [Follows],
}

/// Finds the mouth's slit; `None` if the mouth does not have two rims.
///
/// `landmarks`: of the neutral face, canonical centimetres.
pub(super) fn mouth_slit(
    skin: &Skin,
    landmarks: &[[f32; 3]; LANDMARKS],
    follows: &[Follows],
    to_canonical: &Similarity,
) -> Option<Slit> {
    let face = NeutralFace {
        mesh: &skin.surface,
        landmarks,
        vertices: &skin.landmark_vertices,
        sewn: &skin.sewn,
        follows,
    };
    face.slit(&MOUTH, to_canonical)
}

impl NeutralFace<'_> {
    fn slit(&self, marks: &Marks, to_canonical: &Similarity) -> Option<Slit> {
        let line = Line::of(self.landmarks, marks)?;
        let seeds = |marks: &[usize]| -> Vec<u32> {
            let inner = &marks[1..marks.len() - 1];
            inner.iter().map(|&n| self.vertices[n]).collect()
        };
        let radius = line.length + marks.reach_cm;
        let sides = lip_of_vertices(self.mesh, &seeds(marks.upper), &seeds(marks.lower), radius);
        let upper = self.rim(&line, marks.upper, &sides, Lip::Upper);
        let lower = self.rim(&line, marks.lower, &sides, Lip::Lower);
        if upper.len() < 2 || lower.len() < 2 {
            return None;
        }
        let samples = self.samples(&line, marks, &upper, &lower);
        let touched = self.touched(&line, marks, &sides, &upper, &lower);
        Some(Slit {
            up: to_canonical.inverse().rotate(line.up),
            to_cm: 100.0 * to_canonical.scale as f32,
            samples,
            touched,
        })
    }

    /// Vertices of a rim from corner to corner with their place along the line.
    fn rim(
        &self,
        line: &Line,
        marks: &[usize],
        sides: &[Option<Lip>],
        side: Lip,
    ) -> Vec<(f32, u32)> {
        let outward = if side == Lip::Upper { -1.0 } else { 1.0 };
        let mut best: Vec<Option<(f32, f32, u32)>> = vec![None; PIECES];
        for (v, &p) in self.mesh.positions.iter().enumerate() {
            let place = line.place(p);
            let inside = (0.0..1.0).contains(&place) && sides[v] == Some(side);
            if !inside || self.away_from_marks(marks, p) > RIM_CM {
                continue;
            }
            let slot = &mut best[(place * PIECES as f32) as usize];
            let height = outward * line.height(p);
            if slot.is_none_or(|(most, ..)| height > most) {
                *slot = Some((height, place, v as u32));
            }
        }
        let mut rim: Vec<(f32, u32)> = best.into_iter().flatten().map(|(_, s, v)| (s, v)).collect();
        rim.sort_by(|a, b| a.0.total_cmp(&b.0));
        rim
    }

    /// Distance from a point to the line through the landmarks of a rim.
    fn away_from_marks(&self, marks: &[usize], p: [f32; 3]) -> f32 {
        let pieces = marks.windows(2);
        pieces
            .map(|ends| from_piece(p, self.landmarks[ends[0]], self.landmarks[ends[1]]))
            .fold(f32::INFINITY, f32::min)
    }

    fn samples(
        &self,
        line: &Line,
        marks: &Marks,
        upper: &[(f32, u32)],
        lower: &[(f32, u32)],
    ) -> Vec<Sample> {
        let of_marks = |marks: &[usize]| -> Vec<(f32, u32)> {
            let at = |&n: &usize| (line.place(self.landmarks[n]), n as u32);
            marks.iter().map(at).collect()
        };
        let (upper_marks, lower_marks) = (of_marks(marks.upper), of_marks(marks.lower));
        let height = |of: Between, points: &dyn Fn(u32) -> [f32; 3]| -> f32 {
            of.iter().map(|&(v, w)| w * line.height(points(v))).sum()
        };
        let vertex = |v: u32| self.mesh.positions[v as usize];
        let landmark = |n: u32| self.landmarks[n as usize];
        (0..SAMPLES)
            .map(|k| {
                let place = sample_place(k);
                let [upper, lower] = [upper, lower].map(|rim| between(rim, place));
                let [above, below] = [&upper_marks, &lower_marks].map(|rim| between(rim, place));
                Sample {
                    gap: height(upper, &vertex) - height(lower, &vertex),
                    marks_gap: height(above, &landmark) - height(below, &landmark),
                    upper,
                    lower,
                    upper_marks: above,
                    lower_marks: below,
                }
            })
            .collect()
    }

    /// The skin beside the rims and the vertices that follow it, with their places and shares.
    fn touched(
        &self,
        line: &Line,
        marks: &Marks,
        sides: &[Option<Lip>],
        upper: &[(f32, u32)],
        lower: &[(f32, u32)],
    ) -> Vec<(u32, f32, f32)> {
        let place = |v: u32| self.mesh.positions[v as usize];
        let share = |v: u32| -> f32 {
            let p = place(v);
            let (rim, sign) = match sides[v as usize] {
                Some(Lip::Upper) => (upper, 0.5),
                Some(Lip::Lower) => (lower, -0.5),
                None => return 0.0,
            };
            let pieces = rim.windows(2);
            let away = pieces.map(|ends| from_piece(p, place(ends[0].1), place(ends[1].1)));
            let away = away.fold(f32::INFINITY, f32::min) / marks.reach_cm;
            let left = (1.0 - away * away).max(0.0);
            sign * left * left
        };
        let mut touched = Vec::new();
        for (v, follows) in self.follows.iter().enumerate() {
            let Follows::Skin(corners) = follows else {
                continue;
            };
            let p = place(v as u32);
            if !line.is_beside(p, marks.reach_cm + REACH_OF_PARTS_CM) {
                continue;
            }
            let corners = corners.iter().filter(|(_, w)| *w != 0.0);
            let gap_share: f32 = corners
                .map(|&(v, w)| w * share(self.sewn[v as usize]))
                .sum();
            if gap_share != 0.0 {
                let at = line.place(p) * SAMPLES as f32 - 0.5;
                touched.push((v as u32, at.clamp(0.0, (SAMPLES - 1) as f32), gap_share));
            }
        }
        touched
    }
}

impl Slit {
    /// Vertices between which the gap is measured.
    pub(super) fn rims(&self) -> impl Iterator<Item = u32> {
        let places = self.samples.iter().flat_map(|s| [s.upper, s.lower]);
        places.flatten().map(|(vertex, _)| vertex)
    }

    /// Vertices that it moves.
    pub(super) fn touched_vertices(&self) -> impl Iterator<Item = u32> {
        self.touched.iter().map(|(vertex, ..)| *vertex)
    }

    /// The same slit on a mesh with fewer vertices. `new` gives the new number of a vertex, or
    /// `None` if it is not left. All vertices of the rims must be left.
    pub(super) fn renumbered(&self, new: impl Fn(u32) -> Option<u32>) -> Slit {
        let all = |of: Between| of.map(|(v, share)| (new(v).expect("rims are left"), share));
        let samples = self.samples.iter().map(|sample| Sample {
            upper: all(sample.upper),
            lower: all(sample.lower),
            ..sample.clone()
        });
        let left = |&(v, at, share): &(u32, f32, f32)| Some((new(v)?, at, share));
        Slit {
            samples: samples.collect(),
            touched: self.touched.iter().filter_map(left).collect(),
            ..*self
        }
    }

    /// Corrects the displacements of a frame, `[V * 3]`; `landmarks`: `[204]`. Mesh units.
    pub(super) fn apply(&self, landmarks: &[f32], frame: &mut [f32]) {
        let changes = self.changes(landmarks, frame);
        if changes.iter().all(|c| *c == 0.0) {
            return;
        }
        for &(v, at, share) in &self.touched {
            let (first, rest) = (at as usize, at.fract());
            let next = (first + 1).min(SAMPLES - 1);
            let change = changes[first] * (1.0 - rest) + changes[next] * rest;
            let length = share * change / self.to_cm;
            for (to, up) in frame[3 * v as usize..].iter_mut().zip(self.up) {
                *to += length * up;
            }
        }
    }

    /// How much wider each sample's gap becomes, centimetres: negative where the rims come together.
    fn changes(&self, landmarks: &[f32], frame: &[f32]) -> [f32; SAMPLES] {
        let mut push = [0.0f32; SAMPLES];
        let mut pull = [0.0f32; SAMPLES];
        for (k, sample) in self.samples.iter().enumerate() {
            let gap = sample.gap + self.raised(sample.upper, sample.lower, frame);
            push[k] = (sample.gap.min(0.0) - gap).max(0.0);
            let marks = self.raised(sample.upper_marks, sample.lower_marks, landmarks);
            pull[k] = sample.pull(gap, sample.marks_gap + marks);
        }
        let widest = spread(&push, |a, b, c| a.max(b).max(c));
        let push = spread(&widest, |a, b, c| 0.25 * a + 0.5 * b + 0.25 * c);
        let pull = spread(&pull, |a, b, c| 0.25 * a + 0.5 * b + 0.25 * c);
        std::array::from_fn(|k| push[k] - pull[k])
    }

    /// How much further apart two places are than in the neutral face, centimetres.
    fn raised(&self, upper: Between, lower: Between, moved: &[f32]) -> f32 {
        let height = |(n, share): (u32, f32)| -> f32 {
            let at = 3 * n as usize;
            let along: f32 = (0..3).map(|i| self.up[i] * moved[at + i]).sum();
            share * along
        };
        let sum = |of: Between| height(of[0]) + height(of[1]);
        self.to_cm * (sum(upper) - sum(lower))
    }
}

impl Sample {
    /// How far rims that are `gap` apart come together when their landmarks are `marks` apart.
    fn pull(&self, gap: f32, marks: f32) -> f32 {
        let met = MET_CM.min(0.5 * self.marks_gap);
        if met < 1e-3 || !(0.0..PULL_CM).contains(&gap) {
            return 0.0;
        }
        let share = (1.0 - marks / met).clamp(0.0, 1.0);
        share * gap * (1.0 - gap / PULL_CM)
    }
}

fn sample_place(k: usize) -> f32 {
    (k as f32 + 0.5) / SAMPLES as f32
}

/// Calls `of` with each value between its two neighbours. At an end the value is its own neighbour.
fn spread(values: &[f32; SAMPLES], of: impl Fn(f32, f32, f32) -> f32) -> [f32; SAMPLES] {
    std::array::from_fn(|k| {
        let (before, after) = (k.saturating_sub(1), (k + 1).min(SAMPLES - 1));
        of(values[before], values[k], values[after])
    })
}

/// The two points of a rim between which `place` lies, with their shares.
fn between(rim: &[(f32, u32)], place: f32) -> Between {
    let after = rim
        .partition_point(|(s, _)| *s < place)
        .clamp(1, rim.len() - 1);
    let (a, b) = (rim[after - 1], rim[after]);
    let along = ((place - a.0) / (b.0 - a.0).max(1e-6)).clamp(0.0, 1.0);
    [(a.1, 1.0 - along), (b.1, along)]
}

/// The line from one corner of a slit to the other.
struct Line {
    start: [f32; 3],
    across: [f32; 3],
    up: [f32; 3],
    length: f32,
}

impl Line {
    fn of(landmarks: &[[f32; 3]; LANDMARKS], marks: &Marks) -> Option<Line> {
        let (start, end) = (landmarks[marks.upper[0]], landmarks[*marks.upper.last()?]);
        let way: [f32; 3] = std::array::from_fn(|i| end[i] - start[i]);
        let length = Vec3::from(way).length();
        if length < 0.1 {
            return None;
        }
        let across = way.map(|x| x / length);
        let up: [f32; 3] = std::array::from_fn(|i| f32::from(i == 1) - across[1] * across[i]);
        let size = Vec3::from(up).length();
        (size > 0.5).then(|| Line {
            start,
            across,
            up: up.map(|x| x / size),
            length,
        })
    }

    /// 0 at one corner, 1 at the other.
    fn place(&self, p: [f32; 3]) -> f32 {
        Vec3::from(std::array::from_fn(|i| p[i] - self.start[i])).dot(self.across.into())
            / self.length
    }

    fn height(&self, p: [f32; 3]) -> f32 {
        Vec3::from(p).dot(self.up.into())
    }

    fn is_beside(&self, p: [f32; 3], reach: f32) -> bool {
        let middle: [f32; 3] =
            std::array::from_fn(|i| self.start[i] + 0.5 * self.length * self.across[i]);
        let offset: [f32; 3] = std::array::from_fn(|i| p[i] - middle[i]);
        Vec3::from(offset).length() < 0.5 * self.length + reach
    }
}

/// Distance from a point to the line segment between two others.
fn from_piece(p: [f32; 3], a: [f32; 3], b: [f32; 3]) -> f32 {
    let [p, a, b] = [p, a, b].map(Vec3::from);
    p.distance(nearest_between(p, a, b))
}
