//! Lids that close by a share of their own eye's opening and slide over its ball.
//!
//! Landmarks say by which share of its opening an eye is closed: the opening of a head is its own, that of
//! canonical motion is the canonical face's. The share counts. [`Face::own_motion`](crate::face::Face::own_motion)
//! lets the landmarks of the lids travel as far as a head's eyes are open; what a decoder makes of them is then turned about the
//! eye's own centre, parallel to the line from corner to corner, until the edges of the lids are as far apart as
//! the share says. A turn keeps the distance from the centre; where the decoder lost some of it, skin is
//! pushed out to where it lay over the ball. Lashes turn with the edge. An eye that is sculpted shut rests, and so do lids without a slit between them.
//!
//! Lengths are canonical centimetres.

mod axis;
mod even;
mod find;
mod trial;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use self::{
    axis::{elevation, turn},
    even::{EvenSkin, Resting},
};
use crate::face::eyes::{EyeFrame, Eyeball, Mix, SAMPLES, UPPER_SHARE, ease};
pub(super) use find::eyelids;
pub(super) use trial::Trial;

/// From this share of closing on the opening is exactly what the landmarks ask for.
const EXACT_FROM: f32 = 0.5;
/// Shut lids overlap by this much, so that no sliver between two vertices of their edges stays open.
const OVERLAP_CM: f32 = 0.03;
/// The upper lid then lies this far before the lower one: two edges at one depth would cross in a zigzag.
const BEFORE_CM: f32 = 0.03;
/// From this share of closing on they begin to.
const OVERLAP_FROM: f32 = 0.6;
/// Both lids are one skin at a corner of the eye: what the edges do beyond the opening that is asked for, and how
/// far they are lifted, begins there and is full from the last of these samples on.
const FROM_CORNER: [f32; 3] = [0.0, 0.35, 0.8];

/// Skin that goes evenly keeps so far off the ball, where it lay as far off.
const LEAST_OFF_CM: f32 = 0.15;

/// Instead of a lid: the eye itself, where that is skin.
const BETWEEN_LIDS: u8 = 2;

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
    /// `[SAMPLES]`: the edge, in the eye's frame.
    edge: Vec<[f32; 3]>,
    /// `[SAMPLES]`: its elevation seen from the eye's centre, radians.
    rest: Vec<f32>,
}

/// A vertex that lids carry along.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Touched {
    vertex: u32,
    /// 0 the upper lid, 1 the lower one, or [`BETWEEN_LIDS`].
    lid: u8,
    /// Where its place lies among the samples.
    at: f32,
    /// By which share it follows the lid.
    share: f32,
    /// In the neutral face: where it, or what it is rooted in, lies in the eye's frame.
    place: [f32; 3],
    /// From its root to itself, where it has one.
    stem: Option<Stem>,
}

impl Touched {
    fn is_lash(&self) -> bool {
        self.stem.is_some_and(|stem| stem.is_lash)
    }
}

/// How something that is no skin stands on a lid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Stem {
    offset: [f32; 3],
    /// Whether the root is a place of the lid's edge, and not of the skin that it follows.
    is_lash: bool,
}

/// The lids of one eye.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Eyelids {
    /// Numbers of the landmarks.
    first: usize,
    pairs: [(usize, usize); 2],
    /// Opening of this eye at the pairs.
    openings: [f32; 2],
    /// Where the eye is sculpted shut or its lids have no slit.
    rests: bool,
    /// Canonical centimetres, and the width of the eye.
    frame: EyeFrame,
    width: f32,
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
    /// Skin that would turn over or stretch by itself.
    even: EvenSkin,
}

/// How far both edges turn in a frame.
struct Turns {
    /// Added to what the decoder made, radians.
    added: [[f32; SAMPLES]; 2],
    /// From the neutral face, radians.
    whole: [[f32; SAMPLES]; 2],
    /// The mean of that over the middle half of each edge: a row of lashes rolls as one.
    roll: [f32; 2],
    /// Displacements of the edges.
    edges: [[[f32; 3]; SAMPLES]; 2],
    /// How much further out of the ball than in the neutral face both edges lie.
    out: [[f32; SAMPLES]; 2],
    /// By which share lids are drawn in where the decoder has them further out than that.
    hug: f32,
    /// By which share the eye's opening is decided here.
    hold: f32,
}

/// How a place of a lid lies over the ball.
#[derive(Clone, Copy)]
struct Lift {
    out: f32,
    hug: f32,
}

impl Eyelids {
    /// Vertices by which the opening is known, and those between which skin goes evenly.
    pub(super) fn rims(&self) -> impl Iterator<Item = u32> {
        let both = self.rims.iter().flat_map(|rim| &rim.vertices);
        both.map(|v| v.vertex).chain(self.even.needs())
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
        lids.even = self.even.renumbered(new);
        lids
    }

    /// Lets the lids of one frame `[204]` rest where nothing closes them.
    pub(super) fn own_landmarks(&self, landmarks: &mut [f32]) {
        if self.rests {
            landmarks[3 * self.first..3 * (self.first + 6)].fill(0.0);
        }
    }

    /// By how much a landmark rises, centimetres.
    fn height(&self, landmarks: &[f32], n: usize) -> f32 {
        let moved = [0, 1, 2].map(|i| landmarks[3 * n + i]);
        self.to_cm * Vec3::from(moved).dot(self.up.into())
    }

    /// Corrects the displacements of a frame, `[V * 3]`; `landmarks`: `[204]`. Mesh units.
    pub(super) fn apply(&self, landmarks: &[f32], frame: &mut [f32]) {
        if self.rests {
            return;
        }
        let mut turns = self.turns(self.closed(landmarks), frame);
        let (lashes, skin): (Vec<&Touched>, Vec<&Touched>) =
            self.touched.iter().partition(|touched| touched.is_lash());
        skin.iter().for_each(|at| self.correct(at, &turns, frame));
        self.go_evenly(turns.hold, frame);
        // Lashes stand on the edges as these are in the end.
        turns.edges = self
            .rims
            .each_ref()
            .map(|rim| std::array::from_fn(|k| self.edge_moved(rim, k, frame)));
        lashes.iter().for_each(|at| self.correct(at, &turns, frame));
    }

    /// Takes skin a share of the way to where it goes evenly.
    fn go_evenly(&self, share: f32, frame: &mut [f32]) {
        if share <= 0.0 {
            return;
        }
        let moved = |frame: &[f32], v: u32| {
            let d = &frame[3 * v as usize..][..3];
            self.local([d[0], d[1], d[2]])
        };
        let wanted: Vec<(Resting, [f32; 3])> = self.even.moves(|v| moved(frame, v)).collect();
        for (Resting { vertex: v, place }, wanted) in wanted {
            let wanted = self.off_ball(place, wanted);
            let now = moved(frame, v);
            let change = std::array::from_fn(|i| share * (wanted[i] - now[i]));
            self.add(change, &mut frame[3 * v as usize..][..3]);
        }
    }

    /// A displacement after which a place lies before the ball by no less than it did, or than lids must.
    fn off_ball(&self, place: [f32; 3], moved: [f32; 3]) -> [f32; 3] {
        let height = |p: [f32; 3]| {
            let length = Vec3::from(p).length();
            (length, length - self.ball.radius_below(p, length))
        };
        let came: [f32; 3] = std::array::from_fn(|i| place[i] + moved[i]);
        let (length, now) = height(came);
        let lacking = (height(place).1.min(LEAST_OFF_CM) - now).max(0.0);
        let scale = 1.0 + lacking / length.max(1e-6);
        std::array::from_fn(|i| scale * came[i] - place[i])
    }

    /// Adds to a displacement, mesh units, one in the eye's frame.
    fn add(&self, change: [f32; 3], to: &mut [f32]) {
        for (i, to) in to.iter_mut().enumerate() {
            let along = self.axes.iter().zip(change);
            *to += along.map(|(axis, x)| axis[i] * x).sum::<f32>() / self.to_cm;
        }
    }

    /// Corrects the displacement of one vertex.
    fn correct(&self, touched: &Touched, turns: &Turns, frame: &mut [f32]) {
        let d = &mut frame[3 * touched.vertex as usize..][..3];
        let moved = [0, 1, 2].map(|i| d[i]);
        let change = self.change(touched, self.local(moved), turns);
        self.add(change, d);
    }

    /// Landmarks of one frame, `[68][3]` in canonical metres, by which the lids close by a share of the eye's
    /// opening, and by so much of it through the upper lid.
    pub(super) fn close(&self, landmarks: &mut [[f32; 3]], closed: f32, upper_share: f32) {
        for ((upper, lower), height) in self.pairs.into_iter().zip(self.openings) {
            let way = 0.01 * closed * height;
            landmarks[upper][1] -= upper_share * way;
            landmarks[lower][1] += (1.0 - upper_share) * way;
        }
    }

    /// Whether nothing closes these lids.
    pub(super) fn rests(&self) -> bool {
        self.rests
    }

    /// By which share the lids are asked to close: 0 as in the neutral face, 1 shut, below 0 wide open.
    fn closed(&self, landmarks: &[f32]) -> f32 {
        let closing = |&(upper, lower): &(usize, usize)| {
            self.height(landmarks, lower) - self.height(landmarks, upper)
        };
        let whole = self.openings[0] + self.openings[1];
        (self.pairs.iter().map(closing).sum::<f32>() / whole.max(1e-6)).min(1.0)
    }

    /// A displacement in the eye's frame, centimetres.
    fn local(&self, moved: [f32; 3]) -> [f32; 3] {
        self.axes
            .map(|axis| self.to_cm * Vec3::from(axis).dot(moved.into()))
    }

    fn turns(&self, closed: f32, frame: &[f32]) -> Turns {
        let hold = ease(closed / EXACT_FROM);
        let shut = ease((closed - OVERLAP_FROM) / (1.0 - OVERLAP_FROM));
        let out: [[f32; SAMPLES]; 2] = [BEFORE_CM * shut, 0.0].map(|before| {
            let full = before + hold * self.lift;
            std::array::from_fn(|k| from_corner(k) * full)
        });
        let made = self.rims.each_ref().map(|rim| self.elevations(rim, frame));
        let change = self.shortfall(closed, shut, &made).map(|x| hold * x);
        let added = [UPPER_SHARE, UPPER_SHARE - 1.0].map(|share| change.map(|x| share * x));
        let whole: [[f32; SAMPLES]; 2] = std::array::from_fn(|lid| {
            std::array::from_fn(|k| made[lid][k] + added[lid][k] - self.rims[lid].rest[k])
        });
        let middle = SAMPLES / 4..SAMPLES - SAMPLES / 4;
        let roll = whole.map(|of| of[middle.clone()].iter().sum::<f32>() / middle.len() as f32);
        Turns {
            added,
            whole,
            roll,
            edges: [[[0.0; 3]; SAMPLES]; 2],
            out,
            hug: shut,
            hold,
        }
    }

    /// What the openings that a decoder made lack to those that are asked for, radians; `made`: elevations of
    /// both edges.
    fn shortfall(&self, closed: f32, shut: f32, made: &[[f32; SAMPLES]; 2]) -> [f32; SAMPLES] {
        let overlap = shut * OVERLAP_CM / self.ball.radius;
        let change: [f32; SAMPLES] = std::array::from_fn(|k| {
            let rest = self.rims[0].rest[k] - self.rims[1].rest[k];
            let wanted = rest * (1.0 - closed) - overlap.min(0.5 * rest.max(0.0));
            wanted - (made[0][k] - made[1][k])
        });
        // Where lids shut, nothing between the samples stays open.
        let most = beside(&change, |before, here, after| {
            here + shut * (before.min(here).min(after) - here)
        });
        let even = beside(&most, |before, here, after| {
            0.25 * before + 0.5 * here + 0.25 * after
        });
        std::array::from_fn(|k| change[k].mixed(even[k], from_corner(k)))
    }

    /// What the decoder made of a place of an edge: its displacement in the eye's frame.
    fn edge_moved(&self, rim: &Rim, k: usize, frame: &[f32]) -> [f32; 3] {
        let mut moved = [0.0f32; 3];
        for (number, share) in rim.samples[k] {
            let at = 3 * rim.vertices[number as usize].vertex as usize;
            let of_vertex = self.local([frame[at], frame[at + 1], frame[at + 2]]);
            (0..3).for_each(|i| moved[i] += share * of_vertex[i]);
        }
        moved
    }

    /// Where the decoder has put the edge of a lid: elevations, radians.
    fn elevations(&self, rim: &Rim, frame: &[f32]) -> [f32; SAMPLES] {
        std::array::from_fn(|k| {
            let moved = self.edge_moved(rim, k, frame);
            elevation(std::array::from_fn(|i| rim.edge[k][i] + moved[i]))
        })
    }

    /// What a displacement of a vertex lacks, both in the eye's frame.
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
            let lift = Lift {
                out: between_samples(&turns.out[lid], at),
                hug: turns.hug,
            };
            self.slide(place, moved, angle, share, lift)
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

    /// What a displacement of a neutral place lacks where it shall turn by an angle and keep off the ball;
    /// by which share it follows its lid, and how far the lid is lifted.
    fn slide(
        &self,
        place: [f32; 3],
        moved: [f32; 3],
        angle: f32,
        share: f32,
        lift: Lift,
    ) -> [f32; 3] {
        let came: [f32; 3] = std::array::from_fn(|i| place[i] + moved[i]);
        let turned = turn(came, angle);
        let over = |p: [f32; 3]| {
            let length = Vec3::from(p).length();
            (length, length - self.ball.radius_below(p, length))
        };
        let ((length, height), (_, before)) = (over(turned), over(place));
        let shortfall = before + lift.out - height;
        let scale = 1.0 + share * shortfall.max(lift.hug * shortfall) / length.max(1e-6);
        std::array::from_fn(|i| scale * turned[i] - came[i])
    }
}

/// How much of what is full along the middle of an edge counts at one of its samples.
fn from_corner(k: usize) -> f32 {
    let from_end = k.min(SAMPLES - 1 - k);
    FROM_CORNER.get(from_end).copied().unwrap_or(1.0)
}

/// A value between samples.
fn between_samples<T: Mix>(values: &[T; SAMPLES], place: f32) -> T {
    let (first, rest) = (place as usize, place.fract());
    let next = (first + 1).min(SAMPLES - 1);
    values[first].mixed(values[next], rest)
}

/// Each value with its two neighbours; the ends have themselves for a neighbour.
fn beside(values: &[f32; SAMPLES], of: impl Fn(f32, f32, f32) -> f32) -> [f32; SAMPLES] {
    std::array::from_fn(|k| {
        let (before, after) = (k.saturating_sub(1), (k + 1).min(SAMPLES - 1));
        of(values[before], values[k], values[after])
    })
}
