//! Makes triangles finer where a mesh is coarse, and puts a vertex at every landmark.
//!
//! A head of a thousand triangles has no vertex where a landmark lies, and too few vertices for the
//! bending of a plate. The solve adds both. The surface stays the same. Its own vertices stay too,
//! and take their values from the result. So a head moves the same way however it was triangulated.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::mesh::{
    simplify::Rings,
    tree::{blend, closest_weights},
};

/// A landmark nearer to its vertex than this counts as lying on it, centimetres.
const AT_VERTEX_CM: f64 = 0.01;
/// A landmark with less weight than this on a corner counts as lying on the opposite side.
const ON_SIDE: f64 = 0.02;
/// Where up to this many landmarks lie in one triangle, the search still finds all pieces of it.
const MAX_CUTS: usize = 3;
/// The most rounds of splitting.
const MAX_ROUNDS: usize = 8;

/// A surface that is being refined. Vertices of the mesh come first.
pub(super) struct Refined {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Vertices from this number on were added.
    first_added: u32,
    /// Triangles that a landmark's vertex may split, ascending.
    near: Vec<usize>,
}

impl Refined {
    pub(super) fn new(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Refined {
        Refined {
            first_added: positions.len() as u32,
            positions,
            triangles,
            near: Vec::new(),
        }
    }

    /// Puts a vertex at each landmark. `anchors`: on entry the nearest vertices, on return the
    /// landmarks' own.
    pub(super) fn add_landmarks(&mut self, landmarks: &[[f32; 3]], anchors: &mut [u32]) {
        let mut away: Vec<(u32, f64, usize)> = Vec::new();
        for (n, (landmark, &anchor)) in landmarks.iter().zip(anchors.iter()).enumerate() {
            let way = exact(*landmark).distance(self.positions[anchor as usize]);
            if way > AT_VERTEX_CM {
                away.push((anchor, way, n));
            }
        }
        // This order ignores left and right, so that a mirrored face is cut the same way.
        away.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        self.near = self.two_rings(away.iter().map(|place| place.0));
        for (anchor, _, n) in away {
            if let Some((face, weights)) = self.place(exact(landmarks[n]), anchor) {
                anchors[n] = self.split_at(face, weights);
            }
        }
    }

    /// Triangles that touch one of the vertices, and the triangles that touch those.
    fn two_rings(&self, vertices: impl Iterator<Item = u32>) -> Vec<usize> {
        let mut inner = vec![false; self.positions.len()];
        vertices.for_each(|v| inner[v as usize] = true);
        let touches = |t: &&[u32; 3], of: &[bool]| t.iter().any(|&v| of[v as usize]);
        let mut outer = inner.clone();
        let around = self.triangles.iter().filter(|t| touches(t, &inner));
        around.flatten().for_each(|&v| outer[v as usize] = true);
        let numbered = self.triangles.iter().enumerate();
        let touching = numbered.filter(|(_, t)| touches(t, &outer));
        touching.map(|(f, _)| f).collect()
    }

    /// The closest triangle around `vertex` or around vertices that were added there, because
    /// another landmark may already have cut the triangle.
    fn place(&self, point: DVec3, vertex: u32) -> Option<(usize, [f64; 3])> {
        let mut near = vec![vertex];
        for _ in 0..MAX_CUTS {
            let around = self.near.iter().map(|&f| self.triangles[f]);
            let mut added: Vec<u32> = around
                .filter(|t| meets(t, &near))
                .flatten()
                .filter(|v| *v >= self.first_added && !near.contains(v))
                .collect();
            added.sort_unstable();
            added.dedup();
            if added.is_empty() {
                break;
            }
            near.extend(added);
        }
        let around = self.near.iter().copied();
        let around = around.filter(|&f| meets(&self.triangles[f], &near));
        let places = around.map(|f| {
            let corners = self.triangles[f].map(|v| self.positions[v as usize]);
            let weights = closest_weights(point, corners);
            (point.distance_squared(blend(corners, weights)), f, weights)
        });
        let nearest = places.min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map(|(_, f, weights)| (f, weights))
    }

    /// Adds a vertex inside a triangle or on its side, or returns the corner where it would lie.
    fn split_at(&mut self, face: usize, weights: [f64; 3]) -> u32 {
        let t = self.triangles[face];
        let light: Vec<usize> = (0..3).filter(|&i| weights[i] < ON_SIDE).collect();
        match light[..] {
            [] => {
                let new = self.add(blend(t.map(|v| self.positions[v as usize]), weights));
                self.triangles[face] = [t[0], t[1], new];
                self.push([t[1], t[2], new]);
                self.push([t[2], t[0], new]);
                new
            }
            [i] => {
                let (a, b) = (t[(i + 1) % 3], t[(i + 2) % 3]);
                let share = weights[(i + 2) % 3] / (1.0 - weights[i]);
                let (p, q) = (self.positions[a as usize], self.positions[b as usize]);
                let new = self.add(p + share * (q - p));
                self.split_side(a, b, new);
                new
            }
            _ => t[(0..3).find(|i| !light.contains(i)).unwrap_or(0)],
        }
    }

    /// Cuts each triangle beside a side in two, at `middle`.
    fn split_side(&mut self, a: u32, b: u32, middle: u32) {
        for f in self.near.clone() {
            let t = self.triangles[f];
            if t.contains(&a) && t.contains(&b) {
                let swap = |from: u32| t.map(|v| if v == from { middle } else { v });
                self.triangles[f] = swap(a);
                self.push(swap(b));
            }
        }
    }

    /// Adds a triangle beside a landmark.
    fn push(&mut self, triangle: [u32; 3]) {
        self.near.push(self.triangles.len());
        self.triangles.push(triangle);
    }

    fn add(&mut self, position: DVec3) -> u32 {
        self.positions.push(position);
        self.positions.len() as u32 - 1
    }

    /// Splits sides longer than `longest` at their middle until none is left or `most` vertices are
    /// in use. `least`: sides shorter than this are never split.
    pub(super) fn split_long(&mut self, least: f64, longest: impl Fn(DVec3) -> f64, most: usize) {
        let mut used = Rings::of(self.positions.len(), &self.triangles).used();
        for _ in 0..MAX_ROUNDS {
            let mut long: Vec<(f64, (u32, u32))> = Vec::new();
            for t in &self.triangles {
                for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                    let (p, q) = (self.positions[a as usize], self.positions[b as usize]);
                    let length = p.distance(q);
                    if length < least {
                        continue;
                    }
                    let middle = 0.5 * (p + q);
                    let excess = length / longest(middle);
                    if excess > 1.0 {
                        long.push((excess, (a.min(b), a.max(b))));
                    }
                }
            }
            long.sort_unstable_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
            long.dedup_by_key(|side| side.1);
            long.truncate(most.saturating_sub(used));
            if long.is_empty() {
                break;
            }
            let mut middles = HashMap::new();
            for (_, (a, b)) in long {
                let (p, q) = (self.positions[a as usize], self.positions[b as usize]);
                let new = self.add(0.5 * (p + q));
                used += usize::from(middles.insert((a, b), new).is_none());
            }
            self.split_sides(&middles);
        }
    }

    /// Splits every triangle that has one of the sides (smaller vertex, larger vertex) at the side's
    /// new vertex.
    fn split_sides(&mut self, middles: &HashMap<(u32, u32), u32>) {
        let mut out = Vec::with_capacity(self.triangles.len() + 2 * middles.len());
        for &t in &self.triangles {
            let middle = |i: usize| {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                middles.get(&(a.min(b), a.max(b))).copied()
            };
            split(
                t,
                [middle(0), middle(1), middle(2)],
                &self.positions,
                &mut out,
            );
        }
        self.triangles = out;
    }
}

fn exact(p: [f32; 3]) -> DVec3 {
    Vec3::from(p).as_dvec3()
}

fn meets(t: &[u32; 3], vertices: &[u32]) -> bool {
    t.iter().any(|v| vertices.contains(v))
}

/// Cuts a triangle at the middles of its sides (first to second corner, second to third, third to
/// first).
fn split(t: [u32; 3], middles: [Option<u32>; 3], positions: &[DVec3], out: &mut Vec<[u32; 3]>) {
    let length = |a: u32, b: u32| positions[a as usize].distance(positions[b as usize]);
    let turned = |by: usize| -> ([u32; 3], [Option<u32>; 3]) {
        (
            [0, 1, 2].map(|i| t[(i + by) % 3]),
            [0, 1, 2].map(|i| middles[(i + by) % 3]),
        )
    };
    for by in 0..3 {
        let ([a, b, c], sides) = turned(by);
        match sides {
            [None, None, None] => return out.push(t),
            [Some(m), None, None] => return out.extend([[a, m, c], [m, b, c]]),
            [Some(m), Some(n), None] => {
                // Cut the remaining four corners along the shorter diagonal.
                let rest = if length(a, n) < length(m, c) {
                    [[a, m, n], [a, n, c]]
                } else {
                    [[a, m, c], [m, n, c]]
                };
                out.push([m, b, n]);
                return out.extend(rest);
            }
            [Some(m), Some(n), Some(o)] => {
                return out.extend([[a, m, o], [m, b, n], [o, n, c], [m, n, o]]);
            }
            _ => {}
        }
    }
}
