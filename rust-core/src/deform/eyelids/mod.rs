//! Closes each lid by a share of its own eye's opening and slides it over the eyeball.
//!
//! The landmarks tell the share by which an eye is closed. Eyes differ in height from head to head,
//! so only the share carries over from the canonical face.
//! [`Face::motion_on_mesh`](crate::face::Face::motion_on_mesh) lets the landmarks of the lids
//! travel as far as the eyes of this head are open. A decoder then moves the skin, but it knows
//! neither the edges of the lids nor the ball behind them. This module turns the lids that the
//! decoder moved about the centre of the eye until their edges are as far apart as the share
//! requires.
//!
//! Once, in the neutral face, [`find`] finds the edges of both lids and the vertices that they
//! carry along. Then, for each eye and frame ([`Eyelids::apply`]):
//! 1. The share by which the eye is closed is the distance by which the landmarks of the upper and
//!    the lower lid approach each other, relative to the opening of the eye.
//! 2. Each of the [`SAMPLES`] places of an edge has an elevation: its angle above the middle of the
//!    eye, seen from the centre. The difference in elevation between both lids is the opening
//!    there.
//! 3. The missing angle is the opening that the share requires, less the opening that the decoder
//!    left. The upper lid turns by [`UPPER_SHARE`] of it, and the lower lid by the rest in the
//!    opposite direction. The axis runs from corner to corner.
//! 4. Every vertex of a lid turns by its share of the angle at its place. A turn keeps the distance
//!    from the centre. Where the decoder lost some of that distance, the vertex is pushed out to
//!    its height over the ball at rest.
//! 5. A row of lashes moves with the edge and rolls as a whole. Other things on a lid turn with the
//!    skin under them. If the eye itself is skin, it returns to its rest position as the lids
//!    close.
//!
//! The cost of a frame is one pass over the samples and one over the vertices that the lids carry along.
//!
//! Not obvious:
//! - The turn fades in up to a closing of [`EXACT_FROM`], so that an open eye keeps the opening
//!   that its landmarks gave it. Lids without landmarks always turn fully.
//! - The turn fades out towards the corners. Both lids meet there, and the landmarks show best
//!   where.
//! - Shut lids overlap by [`OVERLAP_CM`], the upper lid lies [`BEFORE_CM`] in front of the lower
//!   one, and each sample closes as far as the neighbouring sample that closes furthest. Otherwise
//!   slivers would stay open between the vertices of both edges.
//! - Nearly shut lids are also drawn in where the decoder put them further out than that.
//!
//! What can go wrong: an eye with fewer than two rim vertices on a lid has no [`Eyelids`] and
//! follows its landmarks. Lids that are sculpted shut, or that form one surface with the eye, rest:
//! this module corrects nothing, and the decoder does not get the motion of their landmarks
//! ([`Eyelids::clear_silent`]).
//!
//! Lengths are canonical centimetres.

mod find;

use std::ops::Range;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::face::eyes::{Eyeball, Mix, SAMPLES, UPPER_SHARE, ease};
pub(super) use find::eyelids;

/// From this share of closing on, the opening is exactly what the landmarks require.
const EXACT_FROM: f32 = 0.5;
/// Lids that the decoder does not move open wider by at most this share.
const MAX_WIDE: f32 = 0.4;
/// Shut lids overlap by this much, so that no sliver between two vertices of their edges stays open.
const OVERLAP_CM: f32 = 0.03;
/// Shut, the upper lid lies this far in front of the lower one. At equal depth, the two edges would
/// cross in a zigzag.
const BEFORE_CM: f32 = 0.03;
/// From this share of closing on, the lids begin to overlap.
const OVERLAP_FROM: f32 = 0.6;

/// Within this many samples of a corner the correction fades out and the landmarks take over,
/// because they show best where both lids meet. The second value is for eyes without landmarks.
const FROM_CORNER: f32 = 4.0;
const FROM_CORNER_ALONE: f32 = 1.0;

/// Stands in place of a lid for the eye itself, where the eye is skin.
const BETWEEN_LIDS: u8 = 2;

/// Landmarks of the upper and the lower lid that face each other.
type LidPairs = [(usize, usize); 2];

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
    /// `[SAMPLES]`: indices into `vertices`.
    samples: Vec<Between>,
    /// `[SAMPLES]`: the edge, in the eye's frame.
    edge: Vec<[f32; 3]>,
    /// `[SAMPLES]`: elevation of the edge at rest, seen from the eye's centre, radians.
    rest: Vec<f32>,
}

/// A vertex that a lid carries along.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Touched {
    vertex: u32,
    /// 0 for the upper lid, 1 for the lower one, or [`BETWEEN_LIDS`].
    lid: u8,
    /// Its place along the edge, in samples.
    at: f32,
    /// The share by which it follows the lid.
    share: f32,
    /// Rest position of the vertex, or of its root if it has one, in the eye's frame.
    place: [f32; 3],
    /// How the vertex stands on its root, if it has one.
    stem: Option<Stem>,
}

/// How something other than skin stands on a lid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Stem {
    offset: [f32; 3],
    /// Whether the root lies on the edge of the lid instead of on the skin that the vertex follows.
    is_lash: bool,
}

/// The lids of one eye.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Eyelids {
    /// For each eye of the landmarks that drives these lids: its pairs of upper and lower landmark,
    /// and how far that eye is open at each pair.
    eyes: Vec<(LidPairs, [f32; 2])>,
    /// Whether the eye that closes further counts if there are several; otherwise the one that
    /// closes less counts.
    larger: bool,
    /// Landmarks that move no skin. They only tell how far lids close, if anything.
    silent: Range<usize>,
    /// Whether the decoder leaves these lids alone because no landmarks lie on them.
    alone: bool,
    /// Whether these lids cannot close.
    at_rest: bool,
    /// The eye's axes and the canonical up direction, in the mesh's own axes.
    axes: [[f32; 3]; 3],
    up: [f32; 3],
    /// Centimetres per mesh unit.
    to_cm: f32,
    ball: Eyeball,
    /// How far shut lids are lifted off the ball.
    lift: f32,
    rims: [Rim; 2],
    touched: Vec<Touched>,
}

/// How far both edges turn in one frame.
struct Turns {
    /// Added to the decoder's motion, radians.
    added: [[f32; SAMPLES]; 2],
    /// Turn relative to the neutral face, radians.
    whole: [[f32; SAMPLES]; 2],
    /// Mean of `whole` over the middle half of each edge, because a row of lashes rolls as a whole.
    roll: [f32; 2],
    /// Final displacements of the edges.
    edges: [[[f32; 3]; SAMPLES]; 2],
    lift: [Lift; 2],
    /// The share to which this module, and not the decoder, sets the eye's opening.
    hold: f32,
}

/// How a lid lies over the ball.
#[derive(Clone, Copy)]
struct Lift {
    /// How much further out the lid lies than in the neutral face.
    out: f32,
    /// The share by which the lid is drawn in where the decoder put it further out than that.
    hug: f32,
}

impl Lift {
    /// The lift scaled by `share`, as for a place near a corner.
    fn times(self, share: f32) -> Lift {
        Lift {
            out: share * self.out,
            hug: share * self.hug,
        }
    }
}

impl Eyelids {
    /// The vertices that determine the opening.
    pub(super) fn rims(&self) -> impl Iterator<Item = u32> {
        let both = self.rims.iter().flat_map(|rim| &rim.vertices);
        both.map(|v| v.vertex)
    }

    /// The rim vertices between the corners of the eye, without those at the corners.
    pub(super) fn edges(&self) -> impl Iterator<Item = u32> {
        let corner = FROM_CORNER as usize;
        self.rims.iter().flat_map(move |rim| {
            let between = rim.edge[corner][0]..rim.edge[SAMPLES - 1 - corner][0];
            let vertices = rim.vertices.iter();
            vertices
                .filter(move |v| between.contains(&v.place[0]))
                .map(|v| v.vertex)
        })
    }

    /// The vertices that the lids carry along.
    pub(super) fn touched_vertices(&self) -> impl Iterator<Item = u32> {
        self.touched.iter().map(|touched| touched.vertex)
    }

    /// The same lids on a reduced mesh. `new` gives the new number of a vertex that is left; every
    /// rim vertex must have one.
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

    /// Sets the landmarks of one frame `[204]` that move no skin to 0.
    pub(super) fn clear_silent(&self, landmarks: &mut [f32]) {
        landmarks[3 * self.silent.start..3 * self.silent.end].fill(0.0);
    }

    /// How far a landmark rises, centimetres.
    fn height(&self, landmarks: &[f32], n: usize) -> f32 {
        let moved = [0, 1, 2].map(|i| landmarks[3 * n + i]);
        self.to_cm * Vec3::from(moved).dot(self.up.into())
    }

    /// Corrects the displacements of a frame, `[V * 3]`; `landmarks`: `[204]`. Mesh units.
    pub(super) fn apply(&self, landmarks: &[f32], frame: &mut [f32]) {
        if self.at_rest {
            return;
        }
        let turns = self.turns(self.closed(landmarks), frame);
        for touched in &self.touched {
            let d = &mut frame[3 * touched.vertex as usize..][..3];
            let moved = [d[0], d[1], d[2]];
            let [across, up, out] = self.change(touched, self.local(moved), &turns);
            let [a, b, c] = &self.axes;
            let [a, b, c] = [Vec3::from(*a), Vec3::from(*b), Vec3::from(*c)];
            let change = (a * across + b * up + c * out) / self.to_cm;
            for (to, by) in d.iter_mut().zip(change.to_array()) {
                *to += by;
            }
        }
    }

    /// The share by which the landmarks close the lids: 0 as in the neutral face, 1 shut, below 0
    /// wider open.
    fn closed(&self, landmarks: &[f32]) -> f32 {
        let share = |(pairs, openings): &(LidPairs, [f32; 2])| {
            let closing = |&(upper, lower): &(usize, usize)| {
                self.height(landmarks, lower) - self.height(landmarks, upper)
            };
            let whole = openings[0] + openings[1];
            pairs.iter().map(closing).sum::<f32>() / whole.max(1e-6)
        };
        let shares = self.eyes.iter().map(share);
        let of_all = if self.larger {
            shares.reduce(f32::max)
        } else {
            shares.reduce(f32::min)
        };
        of_all.unwrap_or(0.0).min(1.0)
    }

    /// The share of the correction at a place along the edge, in samples: less near the corners.
    fn off_corners(&self, at: f32) -> f32 {
        let from_corner = if self.alone {
            FROM_CORNER_ALONE
        } else {
            FROM_CORNER
        };
        off_corners(at, from_corner)
    }

    /// Converts a displacement from the mesh's axes and units to the eye's frame, centimetres.
    fn local(&self, moved: [f32; 3]) -> [f32; 3] {
        let [across, up, out] = &self.axes;
        let along = |axis: &[f32; 3]| self.to_cm * Vec3::from(*axis).dot(moved.into());
        [along(across), along(up), along(out)]
    }

    fn turns(&self, closed: f32, frame: &[f32]) -> Turns {
        let (closed, hold) = if self.alone {
            (closed.max(-MAX_WIDE), 1.0)
        } else {
            (closed, ease(closed / EXACT_FROM))
        };
        let shut = ease((closed - OVERLAP_FROM) / (1.0 - OVERLAP_FROM));
        let lift = [BEFORE_CM * shut, 0.0].map(|before| Lift {
            out: before + hold * self.lift,
            hug: shut,
        });
        let elevations = self.rims.each_ref().map(|rim| self.elevations(rim, frame));
        let shortfall = self.shortfall(closed, shut, &elevations);
        let change: [f32; SAMPLES] =
            std::array::from_fn(|k| hold * self.off_corners(k as f32) * shortfall[k]);
        let added = [UPPER_SHARE, UPPER_SHARE - 1.0].map(|share| change.map(|x| share * x));
        let whole: [[f32; SAMPLES]; 2] = std::array::from_fn(|lid| {
            std::array::from_fn(|k| elevations[lid][k] + added[lid][k] - self.rims[lid].rest[k])
        });
        let edges = std::array::from_fn(|lid| {
            std::array::from_fn(|k| {
                let rim: &Rim = &self.rims[lid];
                let moved = self.edge_moved(rim, k, frame);
                let lift = lift[lid].times(self.off_corners(k as f32));
                let change = self.slide(rim.edge[k], moved, added[lid][k], 1.0, lift);
                std::array::from_fn(|i| moved[i] + change[i])
            })
        });
        let middle = SAMPLES / 4..SAMPLES - SAMPLES / 4;
        let roll = whole.map(|of| of[middle.clone()].iter().sum::<f32>() / middle.len() as f32);
        Turns {
            added,
            whole,
            roll,
            edges,
            lift,
            hold,
        }
    }

    /// How far the decoder's openings fall short of the required ones, radians. `elevations`: of
    /// both edges, as the decoder moved them.
    fn shortfall(
        &self,
        closed: f32,
        shut: f32,
        elevations: &[[f32; SAMPLES]; 2],
    ) -> [f32; SAMPLES] {
        let overlap = shut * OVERLAP_CM / self.ball.radius;
        let change: [f32; SAMPLES] = std::array::from_fn(|k| {
            let rest = self.rims[0].rest[k] - self.rims[1].rest[k];
            let opening = rest * (1.0 - closed) - overlap.min(0.5 * rest.max(0.0));
            opening - (elevations[0][k] - elevations[1][k])
        });
        // Where lids shut, no gap may stay open between the samples.
        let most = beside(&change, |before, here, after| {
            here + shut * (before.min(here).min(after) - here)
        });
        beside(&most, |before, here, after| {
            0.25 * before + 0.5 * here + 0.25 * after
        })
    }

    /// How the decoder displaces sample `k` of an edge, in the eye's frame.
    fn edge_moved(&self, rim: &Rim, k: usize, frame: &[f32]) -> [f32; 3] {
        let mut moved = [0.0f32; 3];
        for (number, share) in rim.samples[k] {
            let at = 3 * rim.vertices[number as usize].vertex as usize;
            let of_vertex = self.local([frame[at], frame[at + 1], frame[at + 2]]);
            (0..3).for_each(|i| moved[i] += share * of_vertex[i]);
        }
        moved
    }

    /// Elevations of the edge of a lid as the decoder moved it, radians.
    fn elevations(&self, rim: &Rim, frame: &[f32]) -> [f32; SAMPLES] {
        std::array::from_fn(|k| {
            let moved = self.edge_moved(rim, k, frame);
            elevation(std::array::from_fn(|i| rim.edge[k][i] + moved[i]))
        })
    }

    /// The correction to add to a vertex's displacement, both in the eye's frame.
    fn change(&self, touched: &Touched, moved: [f32; 3], turns: &Turns) -> [f32; 3] {
        let Touched {
            place, share, at, ..
        } = *touched;
        if touched.lid == BETWEEN_LIDS {
            return moved.map(|x| -turns.hold * x);
        }
        let lid = usize::from(touched.lid);
        let rolled = |offset: [f32; 3], angle: f32| -> [f32; 3] {
            let turned = turn(offset, share * angle);
            std::array::from_fn(|i| turned[i] - offset[i])
        };
        let slide = || {
            let angle = share * between_samples(&turns.added[lid], at);
            self.slide(
                place,
                moved,
                angle,
                share,
                turns.lift[lid].times(self.off_corners(at)),
            )
        };
        match touched.stem {
            None => slide(),
            Some(stem) if stem.is_lash => {
                let edge = between_samples(&turns.edges[lid], at);
                let roll = rolled(stem.offset, turns.roll[lid]);
                std::array::from_fn(|i| edge[i] + roll[i] - moved[i])
            }
            Some(stem) => {
                let angle = between_samples(&turns.whole[lid], at);
                let (root, roll) = (slide(), rolled(stem.offset, angle));
                std::array::from_fn(|i| root[i] + roll[i])
            }
        }
    }

    /// The correction to the displacement of a rest position, such that the point turns by `angle`
    /// and stays off the ball. `share`: by which it follows its lid. `lift`: how far the lid is
    /// lifted.
    fn slide(
        &self,
        place: [f32; 3],
        moved: [f32; 3],
        angle: f32,
        share: f32,
        lift: Lift,
    ) -> [f32; 3] {
        let came = Vec3::from(place) + Vec3::from(moved);
        let turned = turn(came.into(), angle);
        let over = |p: [f32; 3]| {
            let length = Vec3::from(p).length();
            (length, length - self.ball.radius_below(p, length))
        };
        let ((length, height), (_, before)) = (over(turned), over(place));
        let shortfall = before + lift.out - height;
        let scale = 1.0 + share * shortfall.max(lift.hug * shortfall) / length.max(1e-6);
        (scale * Vec3::from(turned) - came).into()
    }
}

/// Angle of a point above the plane that the across and front axes span, radians.
#[inline]
fn elevation(p: [f32; 3]) -> f32 {
    p[1].atan2(p[2])
}

/// Turns a point up by an angle about the across axis.
#[inline]
fn turn(p: [f32; 3], angle: f32) -> [f32; 3] {
    let (sine, cosine) = angle.sin_cos();
    [
        p[0],
        cosine * p[1] + sine * p[2],
        cosine * p[2] - sine * p[1],
    ]
}

/// Rises from 0 at a corner of the eye to 1 at `from_corner` samples from it.
#[inline]
fn off_corners(at: f32, from_corner: f32) -> f32 {
    ease(at.min((SAMPLES - 1) as f32 - at) / from_corner)
}

/// Interpolates between samples.
#[inline]
fn between_samples<T: Mix>(values: &[T; SAMPLES], place: f32) -> T {
    let (first, rest) = (place as usize, place.fract());
    let next = (first + 1).min(SAMPLES - 1);
    values[first].mixed(values[next], rest)
}

/// Applies `of` to each value with its two neighbours. A value at an end counts as its own
/// neighbour.
fn beside(values: &[f32; SAMPLES], of: impl Fn(f32, f32, f32) -> f32) -> [f32; SAMPLES] {
    std::array::from_fn(|k| {
        let (before, after) = (k.saturating_sub(1), (k + 1).min(SAMPLES - 1));
        of(values[before], values[k], values[after])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_keeps_the_distance_from_the_axis() {
        let p = turn([0.4, 0.3, 1.1], 0.7);
        assert!((p[1].hypot(p[2]) - 0.3f32.hypot(1.1)).abs() < 1e-6);
        assert!((elevation(p) - elevation([0.4, 0.3, 1.1]) - 0.7).abs() < 1e-6);
        assert_eq!(turn([0.4, 0.3, 1.1], 0.0), [0.4, 0.3, 1.1]);
    }
}
