//! Lids that close by a share of their own eye's opening and slide over its ball.
//!
//! Landmarks say by which share of its opening an eye is closed: the opening of a head is its own, that of
//! the motion is the canonical face's. The share counts. [`Eyelids::own_landmarks`] lets the landmarks of
//! the lids travel as far as this eye is open; what a decoder makes of them is then turned about the eye's
//! own centre, parallel to the line from corner to corner, until the edges of the lids are as far apart as
//! the share says. A turn keeps the distance from the centre; where the decoder lost some of it, skin is
//! pushed out to where it lay over the ball. Lashes turn with the edge. Where the landmarks leave the lids
//! at rest nothing changes, bit for bit.
//!
//! Lengths are canonical centimetres.

use serde::{Deserialize, Serialize};

use super::{
    binding::Follows,
    eye_opening::{EyeFrame, Head, Opening, SAMPLES},
    eyeball::{Eyeball, dot},
    lids::follow_share,
    skin::Skin,
};
use crate::{
    ibug::{EYES, Eye},
    mesh::{Similarity, canonical_landmarks},
};

/// How far the lids of the canonical face travel towards each other until they are shut: `eyeBlink` of the
/// built-in face modes, mean of two pairs.
const CANONICAL_WAY_CM: f32 = 0.789;
/// What the upper lid does of a change of the opening; the lower lid does the rest.
const UPPER_SHARE: f32 = 0.9;
/// From this share of closing on the opening is exactly what the landmarks ask for.
const EXACT_FROM: f32 = 0.3;
/// Shut lids overlap by this much, so that no sliver between two vertices of their edges stays open.
const OVERLAP_CM: f32 = 0.04;
/// From this share of closing on they begin to.
const OVERLAP_FROM: f32 = 0.6;
/// Lids keep at least this distance from the ball, and at most so much of it is added to what they had.
const CLEAR_CM: (f32, f32) = (0.015, 0.12);
/// An edge of the lids has its vertex within this distance, in widths of the eye.
const RIM_OF_WIDTH: f32 = 0.2;

/// Two vertices of a rim with their shares.
type Between = [(u32, f32); 2];

/// A vertex at the edge of a lid, in the eye's frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct RimVertex {
    vertex: u32,
    place: [f32; 3],
}

/// The edge of one lid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Rim {
    vertices: Vec<RimVertex>,
    /// `[SAMPLES]`: numbers among the vertices.
    samples: Vec<Between>,
    /// `[SAMPLES]`: elevation of the edge seen from the eye's centre, radians.
    rest: Vec<f32>,
}

/// A vertex that lids carry along.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Touched {
    vertex: u32,
    /// 0 the upper lid, 1 the lower one, 2 the eye itself where that is skin.
    lid: u8,
    /// Where its place lies among the samples.
    at: f32,
    /// By which share it follows the lid.
    share: f32,
    /// In the neutral face: where it, or what it is rooted in, lies in the eye's frame.
    place: [f32; 3],
    /// From its root to itself.
    lash: Option<[f32; 3]>,
}

/// The lids of one eye.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Eyelids {
    /// Numbers of the landmarks.
    first: usize,
    pairs: [(usize, usize); 2],
    /// Opening of this eye at the pairs.
    openings: [f32; 2],
    is_shut: bool,
    /// The eye's axes and the canonical way up, in the mesh's own axes.
    axes: [[f32; 3]; 3],
    up: [f32; 3],
    /// Mesh units to centimetres.
    to_cm: f32,
    ball: Eyeball,
    /// How far shut lids are lifted off the ball.
    lift: f32,
    rims: [Rim; 2],
    touched: Vec<Touched>,
}

/// How far both edges turn in a frame.
struct Turns {
    /// Added to what the decoder made, radians.
    added: [[f32; SAMPLES]; 2],
    /// From the neutral face, radians.
    whole: [[f32; SAMPLES]; 2],
    /// By which share the eye's opening is decided here.
    hold: f32,
}

/// Finds the lids of a face; an eye without skin about it is left out.
pub(super) fn eyelids(
    head: &Head<'_>,
    skin: &Skin,
    follows: &[Follows],
    to_canonical: &Similarity,
) -> Vec<Eyelids> {
    let found = EYES.iter().filter_map(|eye| {
        let opening = Opening::find(head, eye.lids.start)?;
        let face = Face {
            head,
            skin,
            follows,
            opening: &opening,
        };
        face.eyelids(eye, to_canonical)
    });
    found.collect()
}

/// One eye of a neutral head.
struct Face<'a> {
    head: &'a Head<'a>,
    skin: &'a Skin,
    follows: &'a [Follows],
    opening: &'a Opening,
}

impl Face<'_> {
    fn eyelids(&self, eye: &Eye, to_canonical: &Similarity) -> Option<Eyelids> {
        let EyeFrame { axes, .. } = self.opening.frame;
        let back = to_canonical.inverse();
        let rims = [self.rim(0)?, self.rim(1)?];
        let touched = self.touched();
        let mark = |n: usize| self.opening.frame.local(self.head.landmarks[n])[0];
        let height = |(u, l)| self.opening.height_at(0.5 * (mark(u) + mark(l)));
        Some(Eyelids {
            first: eye.lids.start,
            pairs: eye.pairs,
            openings: eye.pairs.map(height),
            is_shut: self.opening.is_shut,
            axes: axes.map(|axis| back.rotate(axis)),
            up: back.rotate([0.0, 1.0, 0.0]),
            to_cm: 100.0 * to_canonical.scale as f32,
            ball: self.opening.ball,
            lift: self.lift(&rims),
            rims,
            touched,
        })
    }

    /// The vertices nearest to a lid's edge, and the edge between them.
    fn rim(&self, lid: usize) -> Option<Rim> {
        let edge = &self.opening.edges[lid];
        let mut nearest = [(f32::INFINITY, 0u32, [0.0f32; 3]); SAMPLES];
        for (v, &p) in self.head.positions.iter().enumerate() {
            let p = self.opening.frame.local(p);
            let far = dot(p, p) > (2.0 * self.opening.width).powi(2);
            if far || !self.skin.is_skin[v] || self.lid_of(p) != lid as u8 {
                continue;
            }
            for (best, at) in nearest.iter_mut().zip(edge) {
                let offset: [f32; 3] = std::array::from_fn(|i| p[i] - at[i]);
                let away = dot(offset, offset);
                if away < best.0 {
                    *best = (away, v as u32, p);
                }
            }
        }
        let reach = (RIM_OF_WIDTH * self.opening.width).powi(2);
        let mut vertices: Vec<RimVertex> = (nearest.iter())
            .filter(|(away, ..)| *away < reach)
            .map(|&(_, vertex, place)| RimVertex { vertex, place })
            .collect();
        vertices.sort_by(|a, b| a.place[0].total_cmp(&b.place[0]));
        vertices.dedup_by_key(|v| v.vertex);
        if vertices.len() < 2 {
            return None;
        }
        let samples = edge.iter().map(|p| between(&vertices, p[0]));
        Some(Rim {
            samples: samples.collect(),
            rest: edge.iter().map(|p| elevation(*p)).collect(),
            vertices,
        })
    }

    /// On which lid a point lies: 0 the upper one, 1 the lower one.
    fn lid_of(&self, p: [f32; 3]) -> u8 {
        let k = self.opening.sample_at(p[0]).round() as usize;
        let edges = &self.opening.edges;
        let middle = 0.5 * (elevation(edges[0][k]) + elevation(edges[1][k]));
        u8::from(elevation(p) < middle)
    }

    /// Everything that the lids carry along.
    fn touched(&self) -> Vec<Touched> {
        let marks = canonical_landmarks();
        let usual: [f32; 3] = std::array::from_fn(|i| 100.0 * (marks[45][i] - marks[42][i]));
        let size = self.opening.width / dot(usual, usual).sqrt();
        let mut touched = Vec::new();
        for (v, follows) in self.follows.iter().enumerate() {
            let Follows::Skin(corners) = follows else {
                continue;
            };
            let local = |v: u32| (self.opening.frame).local(self.head.positions[v as usize]);
            let own = local(v as u32);
            if dot(own, own) > (3.0 * self.opening.width).powi(2) {
                continue;
            }
            let whole: f32 = corners.iter().map(|(_, share)| share).sum();
            let rooted = !self.skin.is_skin[v] && whole > 0.0;
            let place = match rooted {
                true => std::array::from_fn(|i| {
                    let along = corners.iter().map(|&(v, share)| share * local(v)[i]);
                    along.sum::<f32>() / whole
                }),
                false => own,
            };
            let lid = match self.opening.is_between(place) {
                true => 2,
                false => self.lid_of(place),
            };
            let share = whole.min(1.0) * self.share(lid, place, size);
            if share > 0.0 {
                touched.push(Touched {
                    vertex: v as u32,
                    lid,
                    at: self.opening.sample_at(place[0]),
                    share,
                    place,
                    lash: rooted.then(|| std::array::from_fn(|i| own[i] - place[i])),
                });
            }
        }
        touched
    }

    /// By which share a place follows its lid; `size`: of this eye to the usual one.
    fn share(&self, lid: u8, place: [f32; 3], size: f32) -> f32 {
        if lid == 2 {
            return 1.0;
        }
        let edge = &self.opening.edges[usize::from(lid)];
        let pieces = edge.windows(2).map(|ends| nearest_on(place, ends));
        let Some((squared, nearest)) = pieces.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return 0.0;
        };
        let (distance, behind) = (squared.sqrt() / size, (nearest[2] - place[2]) / size);
        follow_share(f64::from(distance), f64::from(behind)) as f32
    }

    /// What the vertices of both edges lack to keep clear of the ball when they slide over it: flat
    /// triangles between them cut into it by the square of their size.
    fn lift(&self, rims: &[Rim; 2]) -> f32 {
        let heights = rims.iter().flat_map(|rim| &rim.vertices).map(|v| {
            let length = dot(v.place, v.place).sqrt();
            length - self.opening.ball.radius_below(v.place, length)
        });
        let mut heights: Vec<f32> = heights.collect();
        heights.sort_by(f32::total_cmp);
        let low = heights[heights.len() / 4];
        let steps = rims.iter().flat_map(|rim| rim.vertices.windows(2));
        let steps = steps.map(|ends| ends[1].place[0] - ends[0].place[0]);
        let widest = steps.fold(0.0, f32::max).min(0.5 * self.opening.width);
        let sagitta = widest * widest / (8.0 * self.opening.ball.radius);
        (CLEAR_CM.0 + sagitta - low).clamp(0.0, CLEAR_CM.1)
    }
}

impl Eyelids {
    /// Vertices by which the opening is known.
    pub(super) fn rims(&self) -> impl Iterator<Item = u32> {
        let both = self.rims.iter().flat_map(|rim| &rim.vertices);
        both.map(|v| v.vertex)
    }

    /// Whether the eye is sculpted shut: it does not blink.
    pub(super) fn is_shut(&self) -> bool {
        self.is_shut
    }

    /// The same where only some vertices are left; `new` gives their numbers, also those of the rims.
    pub(super) fn renumbered(&self, new: impl Fn(u32) -> Option<u32>) -> Eyelids {
        let mut lids = self.clone();
        for v in lids.rims.iter_mut().flat_map(|rim| &mut rim.vertices) {
            v.vertex = new(v.vertex).expect("rims are left");
        }
        let left = lids.touched.into_iter();
        let left = left.filter_map(|t| {
            let vertex = new(t.vertex)?;
            Some(Touched { vertex, ..t })
        });
        lids.touched = left.collect();
        lids
    }

    /// Lets the lids of one frame `[204]`, mesh units, travel as far as this eye is open.
    pub(super) fn own_landmarks(&self, landmarks: &mut [f32]) {
        if self.is_shut {
            landmarks[3 * self.first..3 * (self.first + 6)].fill(0.0);
            return;
        }
        for ((upper, lower), opening) in self.pairs.into_iter().zip(self.openings) {
            let closing = self.height(landmarks, lower) - self.height(landmarks, upper);
            let more = closing * (opening / CANONICAL_WAY_CM - 1.0) / self.to_cm;
            for i in 0..3 {
                landmarks[3 * upper + i] -= UPPER_SHARE * more * self.up[i];
                landmarks[3 * lower + i] += (1.0 - UPPER_SHARE) * more * self.up[i];
            }
        }
    }

    /// By how much a landmark rises, centimetres.
    fn height(&self, landmarks: &[f32], n: usize) -> f32 {
        let moved = [0, 1, 2].map(|i| landmarks[3 * n + i]);
        self.to_cm * dot(moved, self.up)
    }

    /// Corrects the displacements of a frame, `[V * 3]`; `landmarks`: `[204]`, as they were asked for.
    /// Mesh units.
    pub(super) fn apply(&self, landmarks: &[f32], frame: &mut [f32]) {
        let marks = &landmarks[3 * self.first..3 * (self.first + 6)];
        if self.is_shut || marks.iter().all(|x| *x == 0.0) {
            return;
        }
        let turns = self.turns(self.closed(landmarks), frame);
        for touched in &self.touched {
            let d = &mut frame[3 * touched.vertex as usize..][..3];
            let moved = [0, 1, 2].map(|i| d[i]);
            let change = self.change(touched, self.local(moved), &turns);
            for (i, to) in d.iter_mut().enumerate() {
                let along = self.axes.iter().zip(change);
                *to += along.map(|(axis, x)| axis[i] * x).sum::<f32>() / self.to_cm;
            }
        }
    }

    /// By which share the lids are asked to close: 0 as in the neutral face, 1 shut, below 0 wide open.
    fn closed(&self, landmarks: &[f32]) -> f32 {
        let closing = self.pairs.iter().map(|&(upper, lower)| {
            self.height(landmarks, lower) - self.height(landmarks, upper)
        });
        (closing.sum::<f32>() / (2.0 * CANONICAL_WAY_CM)).min(1.0)
    }

    /// A displacement in the eye's frame, centimetres.
    fn local(&self, moved: [f32; 3]) -> [f32; 3] {
        self.axes.map(|axis| self.to_cm * dot(axis, moved))
    }

    fn turns(&self, closed: f32, frame: &[f32]) -> Turns {
        let hold = ease(closed / EXACT_FROM);
        let overlap = ease((closed - OVERLAP_FROM) / (1.0 - OVERLAP_FROM)) * OVERLAP_CM;
        let overlap = overlap / self.ball.radius;
        let made = self.rims.each_ref().map(|rim| self.elevations(rim, frame));
        let change: [f32; SAMPLES] = std::array::from_fn(|k| {
            let rest = self.rims[0].rest[k] - self.rims[1].rest[k];
            let wanted = rest * (1.0 - closed) - overlap.min(0.5 * rest.max(0.0));
            hold * (wanted - (made[0][k] - made[1][k]))
        });
        let change = smoothed(&change);
        let added = [UPPER_SHARE, UPPER_SHARE - 1.0].map(|share| change.map(|x| share * x));
        let whole = std::array::from_fn(|lid| {
            std::array::from_fn(|k| made[lid][k] + added[lid][k] - self.rims[lid].rest[k])
        });
        Turns { added, whole, hold }
    }

    /// Where the decoder has put the edge of a lid: elevations, radians.
    fn elevations(&self, rim: &Rim, frame: &[f32]) -> [f32; SAMPLES] {
        let raised = |number: u32| {
            let RimVertex { vertex, place } = rim.vertices[number as usize];
            let moved = self.local([0, 1, 2].map(|i| frame[3 * vertex as usize + i]));
            elevation(std::array::from_fn(|i| place[i] + moved[i])) - elevation(place)
        };
        std::array::from_fn(|k| {
            let sample = rim.samples[k].iter();
            let turned: f32 = sample.map(|&(number, share)| share * raised(number)).sum();
            rim.rest[k] + turned
        })
    }

    /// What a displacement of a vertex lacks, both in the eye's frame.
    fn change(&self, touched: &Touched, moved: [f32; 3], turns: &Turns) -> [f32; 3] {
        let Touched { place, share, .. } = *touched;
        if touched.lid == 2 {
            return moved.map(|x| -turns.hold * x);
        }
        let lid = usize::from(touched.lid);
        let came: [f32; 3] = std::array::from_fn(|i| place[i] + moved[i]);
        let turned = turn(came, share * at(&turns.added[lid], touched.at));
        let out = self.outside(turned, touched, turns.hold);
        let mut change = std::array::from_fn(|i| out[i] - came[i]);
        if let Some(lash) = touched.lash {
            let rolled = turn(lash, share * at(&turns.whole[lid], touched.at));
            (0..3).for_each(|i| change[i] += rolled[i] - lash[i]);
        }
        change
    }

    /// The point pushed out to where it lay over the ball in the neutral face, and by the lift.
    fn outside(&self, p: [f32; 3], touched: &Touched, hold: f32) -> [f32; 3] {
        let over = |p: [f32; 3]| {
            let length = dot(p, p).sqrt();
            (length, length - self.ball.radius_below(p, length))
        };
        let ((length, height), (_, before)) = (over(p), over(touched.place));
        let lacking = (before + hold * self.lift - height).max(0.0);
        let scale = 1.0 + touched.share * lacking / length.max(1e-6);
        p.map(|x| scale * x)
    }
}

/// Angle of a point above the plane of across and front, radians.
fn elevation(p: [f32; 3]) -> f32 {
    p[1].atan2(p[2])
}

/// A point turned up by an angle about the axis across.
fn turn(p: [f32; 3], angle: f32) -> [f32; 3] {
    let (sine, cosine) = angle.sin_cos();
    [
        p[0],
        cosine * p[1] + sine * p[2],
        cosine * p[2] - sine * p[1],
    ]
}

/// A value between samples.
fn at(values: &[f32; SAMPLES], place: f32) -> f32 {
    let (first, rest) = (place as usize, place.fract());
    let next = (first + 1).min(SAMPLES - 1);
    values[first] * (1.0 - rest) + values[next] * rest
}

fn smoothed(values: &[f32; SAMPLES]) -> [f32; SAMPLES] {
    std::array::from_fn(|k| {
        let (before, after) = (k.saturating_sub(1), (k + 1).min(SAMPLES - 1));
        0.25 * values[before] + 0.5 * values[k] + 0.25 * values[after]
    })
}

/// 0 up to 0, 1 from 1 on, smooth between.
fn ease(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// The two of a rim between which `across` lies, with their shares.
fn between(vertices: &[RimVertex], across: f32) -> Between {
    let after = vertices.partition_point(|v| v.place[0] < across);
    let after = after.clamp(1, vertices.len() - 1);
    let (a, b) = (vertices[after - 1].place[0], vertices[after].place[0]);
    let along = ((across - a) / (b - a).max(1e-6)).clamp(0.0, 1.0);
    [(after as u32 - 1, 1.0 - along), (after as u32, along)]
}

/// Squared distance to the straight way between two points, and the nearest point on it.
fn nearest_on(p: [f32; 3], ends: &[[f32; 3]]) -> (f32, [f32; 3]) {
    let way: [f32; 3] = std::array::from_fn(|i| ends[1][i] - ends[0][i]);
    let offset: [f32; 3] = std::array::from_fn(|i| p[i] - ends[0][i]);
    let along = (dot(offset, way) / dot(way, way).max(1e-12)).clamp(0.0, 1.0);
    let nearest: [f32; 3] = std::array::from_fn(|i| ends[0][i] + along * way[i]);
    let rest: [f32; 3] = std::array::from_fn(|i| p[i] - nearest[i]);
    (dot(rest, rest), nearest)
}
