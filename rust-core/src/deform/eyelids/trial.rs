//! Lids are shut once when a face is prepared: where seen skin about them would turn over or stretch, it goes
//! evenly with what lies round it.
//!
//! A triangle turns with its lid about the ball; what counts is how far it has turned beside that. Lengths are
//! canonical centimetres.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;

use super::{
    BETWEEN_LIDS, Eyelids,
    axis::{elevation, turn},
    even::{EvenSkin, near_axis},
};
use crate::{
    Result,
    face::{
        Skin,
        eyes::{SAMPLES, ease},
        nearest::nearest_between,
    },
    mesh::FrontView,
};

/// A triangle that turns further than this beside its lid is about to look the other way.
const TURNED_DEG: f32 = 88.0;
/// Of the whole turn, that of the lid with it: its shading then runs over from light to dark.
const TURNED_IN_ALL_DEG: f32 = 89.0;
/// Nor does it grow by more than this, as areas.
const GROWN: f32 = 3.8;
/// Skin this near to the middle of the eye is known, may go evenly, and is looked at, in the eye's widths.
const NEAR: f32 = 1.5;
const NEAR_EVEN: f32 = 1.25;
const NEAR_SEEN: f32 = 1.0;
/// Smaller triangles are not seen, as a share of the square of the eye's width.
const LEAST_AREA: f32 = 1e-5;
/// The eye is looked at from the front and so far from both sides, degrees.
const VIEWS_DEG: [f32; 3] = [0.0, -40.0, 40.0];
/// Cells of a view over the width of the eye, and how far behind what is seen a place counts as seen, in the
/// eye's widths.
const CELLS: f32 = 120.0;
const BEHIND: f32 = 0.02;
/// A triangle that turns in one of so many first frames, mere blinks, counts as so many in others.
const BLINKS: (usize, usize) = (3, 8);
/// How far about a triangle that turns over skin goes evenly, in widths of the eye, and by how much further in each
/// round.
const REACH: (f32, f32) = (0.02, 0.02);
/// The edges of the lids stay where they meet: so much beside them, in widths of the eye; the less the nearer to a
/// corner, from so far on and from so much further in each round.
const MARGIN: f32 = 0.1;
const CORNER: (f32, f32) = (0.08, 0.01);
/// From this round on single vertices of an edge give way, so near to a corner, where a triangle needs it.
const YIELDING: (usize, f32) = (3, 0.2);

/// The skin about one eye.
pub(in crate::deform) struct Trial {
    /// Numbers in the mesh, rising.
    vertices: Vec<u32>,
    /// In the eye's frame.
    places: Vec<[f32; 3]>,
    /// Triangles that are looked at, numbers among `vertices`.
    seen: Vec<[u32; 3]>,
    /// Edges with their lengths, and the neighbours of each vertex.
    edges: Vec<(u32, u32, f32)>,
    beside: Vec<Vec<u32>>,
    /// Vertices that the lids need where they are.
    is_firm: Vec<bool>,
    /// Vertices of the edges that need not stay with them.
    yields: Vec<bool>,
    /// Vertices that go evenly.
    is_even: Vec<bool>,
    /// Vertices of the mesh that move like another one.
    others: BTreeMap<u32, Vec<u32>>,
    width: f32,
    /// The fewest triangles that turned over or stretched so far, those of a mere blink by their weight, and what went evenly then.
    best: Option<(usize, EvenSkin)>,
}

impl Trial {
    /// About the eye of `lids`; `positions`: canonical centimetres.
    pub(in crate::deform) fn of(lids: &Eyelids, positions: &[[f32; 3]], skin: &Skin) -> Trial {
        let local = |v: u32| lids.frame.local(positions[v as usize]);
        let width = lids.width;
        let middle = lids.middle();
        let near = |p: [f32; 3]| Vec3::from(p).distance(middle.into()) < NEAR * width;
        let all = skin.surface.triangles.iter();
        let triangles = all.filter(|t| t.iter().all(|v| near(local(*v))));
        let triangles: Vec<[u32; 3]> = triangles.copied().collect();
        let vertices: BTreeSet<u32> = triangles.as_flattened().iter().copied().collect();
        let vertices = Vec::from_iter(vertices);
        let number = |v: u32| vertices.binary_search(&v).ok();
        let known = |v: u32| number(v).expect("a corner of a triangle") as u32;
        let own: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(known)).collect();
        let places: Vec<[f32; 3]> = vertices.iter().map(|v| local(*v)).collect();
        let mut trial = Trial {
            is_firm: vec![false; vertices.len()],
            is_even: vec![false; vertices.len()],
            yields: vec![false; vertices.len()],
            others: BTreeMap::new(),
            edges: Vec::new(),
            beside: vec![Vec::new(); vertices.len()],
            seen: seen(&own, &places, middle, width),
            best: None,
            width,
            places,
            vertices: vertices.clone(),
        };
        let ends = |t: &[u32; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
        let edges = own.iter().flat_map(ends).map(|(a, b)| (a.min(b), a.max(b)));
        for (a, b) in BTreeSet::from_iter(edges) {
            let [p, q] = [a, b].map(|v| Vec3::from(trial.places[v as usize]));
            trial.edges.push((a, b, p.distance(q)));
            trial.beside[a as usize].push(b);
            trial.beside[b as usize].push(a);
        }
        for (v, &like) in skin.sewn.iter().enumerate() {
            if v as u32 != like && number(like).is_some() && skin.is_skin[v] {
                trial.others.entry(like).or_default().push(v as u32);
            }
        }
        for v in lids.eye() {
            if let Some(n) = number(skin.sewn[v as usize]) {
                trial.is_firm[n] = true;
            }
        }
        // What lies beyond the skin that is looked at is not known, so the rim of it stays.
        for (n, p) in trial.places.iter().enumerate() {
            trial.is_firm[n] |= Vec3::from(*p).distance(middle.into()) > NEAR_EVEN * width;
        }
        trial
    }

    /// Lets more skin go evenly where a frame, `[V * 3]`, turns it over or stretches it, the further about the
    /// later the round. Whether nothing had to be mended.
    pub(in crate::deform) fn mend<'a>(
        &mut self,
        lids: &mut Eyelids,
        frames: impl Iterator<Item = &'a [f32]>,
        round: usize,
    ) -> Result<bool> {
        let edge: Vec<bool> = self
            .places
            .iter()
            .map(|p| lids.is_edge(*p, round))
            .collect();
        let is_firm = self.is_firm.clone();
        let yields = self.yields.clone();
        let firm = |n: usize| is_firm[n] || (edge[n] && !yields[n]);
        let (mut bad, mut weight) = (BTreeSet::new(), 0);
        for (n, frame) in frames.enumerate() {
            let moved = self.moved(lids, frame);
            let is_firm = |n: &u32| firm(*n as usize);
            let bound = |t: &&[u32; 3]| t.iter().all(is_firm);
            let free = self.seen.iter().filter(|t| !bound(t));
            for t in free.filter(|t| self.is_bad(t, &moved)) {
                bad.extend(*t);
                weight += if n < BLINKS.0 { BLINKS.1 } else { 1 };
            }
        }
        if bad.is_empty() {
            return Ok(true);
        }
        if self.best.as_ref().is_none_or(|(least, _)| weight < *least) {
            self.best = Some((weight, lids.even.clone()));
        }
        self.spread(&bad, round);
        let (from, near) = YIELDING;
        for n in bad.iter().map(|n| *n as usize).filter(|_| round >= from) {
            self.yields[n] |= lids.within_corner(self.places[n]) < near * self.width;
        }
        let firm = |n: usize| is_firm[n] || (edge[n] && !self.yields[n]);
        let inside = (0..self.vertices.len()).filter(|n| self.is_even[*n] && !firm(*n));
        let inside: Vec<u32> = inside.map(|n| self.vertices[n]).collect();
        let edges = self.edges.iter().map(|&(a, b, length)| {
            let [a, b] = [a, b].map(|n| self.vertices[n as usize]);
            (a, b, length)
        });
        let place = |v: u32| {
            let n = self.vertices.binary_search(&v).expect("one of these");
            self.places[n]
        };
        lids.even = EvenSkin::of(&inside, &Vec::from_iter(edges), &self.others, place)?;
        Ok(false)
    }

    /// Leaves the lids as they were in the best round, where no round mended all.
    pub(in crate::deform) fn leave_best(self, lids: &mut Eyelids) {
        if let Some((_, even)) = self.best {
            lids.even = even;
        }
    }

    /// Where a frame puts the vertices, in the eye's frame.
    fn moved(&self, lids: &Eyelids, frame: &[f32]) -> Vec<[f32; 3]> {
        let moved = self.vertices.iter().zip(&self.places).map(|(v, p)| {
            let d = &frame[3 * *v as usize..][..3];
            let d = lids.local([d[0], d[1], d[2]]);
            std::array::from_fn(|i| p[i] + d[i])
        });
        moved.collect()
    }

    /// Whether a triangle turns over or stretches.
    fn is_bad(&self, t: &[u32; 3], moved: &[[f32; 3]]) -> bool {
        let [rest, now] = [&self.places, moved].map(|of| t.map(|n| of[n as usize]));
        let [before, after] = [rest, now].map(across);
        let (size, after_size) = (before.length(), after.length());
        let angle: f32 = (0..3)
            .map(|i| {
                let by = near_axis(rest[i]) * (elevation(now[i]) - elevation(rest[i]));
                // Behind the axis elevations leap.
                if by.abs() > 2.0 { 0.0 } else { by / 3.0 }
            })
            .sum();
        let with_lid = Vec3::from(turn(before.into(), angle));
        let cosine = |of: Vec3| of.dot(after) / (size * after_size).max(1e-20);
        after_size > GROWN * size
            || cosine(with_lid) < TURNED_DEG.to_radians().cos()
            || cosine(before) < TURNED_IN_ALL_DEG.to_radians().cos()
    }

    /// Lets skin about vertices go evenly.
    fn spread(&mut self, from: &BTreeSet<u32>, round: usize) {
        let reach = (REACH.0 + REACH.1 * round as f32) * self.width;
        let mut reached: BTreeMap<u32, u32> = from.iter().map(|v| (*v, *v)).collect();
        let mut last: Vec<u32> = from.iter().copied().collect();
        let mut ring = 0;
        while !last.is_empty() {
            let mut next = Vec::new();
            for v in last {
                let start = reached[&v];
                for &to in &self.beside[v as usize] {
                    let [p, q] = [start, to].map(|v| Vec3::from(self.places[v as usize]));
                    let is_near = ring <= round || p.distance(q) < reach;
                    if is_near && !reached.contains_key(&to) {
                        reached.insert(to, start);
                        next.push(to);
                    }
                }
            }
            (last, ring) = (next, ring + 1);
        }
        for v in reached.keys() {
            self.is_even[*v as usize] = true;
        }
    }
}

impl Eyelids {
    /// The middle between the corners, in the eye's frame.
    fn middle(&self) -> [f32; 3] {
        let edge = &self.rims[0].edge;
        let (a, b) = (Vec3::from(edge[0]), Vec3::from(edge[SAMPLES - 1]));
        (0.5 * (a + b)).into()
    }

    /// How far within the nearer corner a place lies.
    fn within_corner(&self, p: [f32; 3]) -> f32 {
        let edge = &self.rims[0].edge;
        (p[0] - edge[0][0]).min(edge[SAMPLES - 1][0] - p[0])
    }

    /// Whether a place lies at the edge of a lid, away from its ends, in this round.
    fn is_edge(&self, p: [f32; 3], round: usize) -> bool {
        let corner = (CORNER.0 + CORNER.1 * round as f32) * self.width;
        let margin = MARGIN * self.width * ease(self.within_corner(p) / corner - 0.2);
        let mut pieces = self.rims.iter().flat_map(|rim| rim.edge.windows(2));
        pieces.any(|ends| {
            let nearest = nearest_between(p.into(), ends[0].into(), ends[1].into());
            nearest.distance(p.into()) < margin
        })
    }

    /// Vertices of the eye itself, where that is skin.
    fn eye(&self) -> impl Iterator<Item = u32> {
        let eye = self.touched.iter().filter(|t| t.lid == BETWEEN_LIDS);
        eye.map(|t| t.vertex)
    }
}

/// The triangles that are seen from before the eye or from its sides.
fn seen(
    triangles: &[[u32; 3]],
    places: &[[f32; 3]],
    middle: [f32; 3],
    width: f32,
) -> Vec<[u32; 3]> {
    let mut is_seen = vec![false; triangles.len()];
    for degrees in VIEWS_DEG {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let turned = places.iter().map(|p| {
            let [x, y, z] = [0, 1, 2].map(|i| p[i] - middle[i]);
            [cosine * x + sine * z, y, cosine * z - sine * x]
        });
        let turned: Vec<[f32; 3]> = turned.collect();
        let side = NEAR * width;
        let mut view = FrontView::new([-side; 2], [side; 2], width / CELLS);
        let corners = |t: &[u32; 3]| t.map(|n| turned[n as usize]);
        triangles.iter().for_each(|t| view.draw(corners(t), 1));
        for (t, is_seen) in triangles.iter().zip(&mut is_seen) {
            let corners = corners(t);
            let middle: Vec3 = corners.iter().map(|p| Vec3::from(*p)).sum::<Vec3>() / 3.0;
            let [column, row] = view.cell_at([middle.x, middle.y]);
            *is_seen |=
                across(corners).z > 0.0 && middle.z > view.depth(column, row) - BEHIND * width;
        }
    }
    let counts = |t: &[u32; 3]| {
        let corners = t.map(|n| places[n as usize]);
        let at = corners.iter().map(|p| Vec3::from(*p)).sum::<Vec3>() / 3.0;
        at.distance(middle.into()) < NEAR_SEEN * width
            && 0.5 * across(corners).length() > LEAST_AREA * width * width
    };
    let found = triangles.iter().zip(is_seen);
    let found = found.filter(|(t, is_seen)| *is_seen && counts(t));
    found.map(|(t, _)| *t).collect()
}

/// Twice the area of a triangle, as a vector across it.
fn across([a, b, c]: [[f32; 3]; 3]) -> Vec3 {
    let [a, b, c] = [a, b, c].map(Vec3::from);
    (b - a).cross(c - a)
}
