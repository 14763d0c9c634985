//! Simplifies a surface by collapsing edges.
//!
//! Quadric errors after Garland and Heckbert 1997, half-edge collapses in passes of independent
//! sets. It differs from the usual method in two ways, both for solving on the result:
//!
//! - An edge's cost includes its length relative to a requested length, so that triangles become
//!   even. A flat cheek of three huge triangles is exact and useless.
//! - Every removed vertex names the neighbour into which it collapsed. A value of one surface can
//!   therefore be found on the other by walking along it, and lips that touch in space stay apart.
//!
//! meshoptimizer's simplifier offers neither and would put a C++ runtime into every host. Remaining
//! vertices keep their place. An edge with at most two faces never gets a third. Vertices on a rim
//! collapse only along the rim.
//!
//! The result depends on the input alone, not on the number of threads.

use glam::DVec3;
use rayon::prelude::*;

/// The most passes.
const MAX_PASSES: usize = 200;
/// When a corner moves, the cosine between the old and the new normal of a face stays above this.
const LEAST_COSINE: f64 = 0.2;
/// How much a rim resists leaving its line.
const RIM_WEIGHT: f64 = 10.0;
/// While the surface has more than this many times the requested vertices, a pass collapses more
/// edges: a later pass would collapse them anyway.
const FAR: usize = 4;
/// One pass grants this share of the wishes, the cheapest ones, near the end. A vertex whose
/// collapse is bad in this pass may have a better one in a later pass.
const NEAR_SHARE: f64 = 0.5;
/// The same share far from the end.
const FAR_SHARE: f64 = 0.9;

/// Limits of a simplification.
#[derive(Debug, Clone, Copy)]
pub struct SimplifyOptions {
    /// Requested number of vertices.
    pub vertices: usize,
    /// Largest distance by which the surface may move, mesh units: the root mean square distance
    /// from a vertex to the faces around all vertices that it stands for.
    pub error: f64,
}

/// A coarser surface over the same vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct Simplified {
    /// `[F']`, with the vertex numbers of the input.
    pub triangles: Vec<[u32; 3]>,
    /// `[V]`: for a removed vertex, the vertex of the result into which it collapsed. For all
    /// others, its own number.
    pub stands_for: Vec<u32>,
}

/// Collapses edges until `options.vertices` are left or no edge may collapse any more.
///
/// # Shapes and units
/// `positions`: `[V]`, mesh units. `triangles`: `[F]`. `edge_lengths`: `[V]`, edge length near each
/// vertex, mesh units. `locked`: `[V]`, vertices that must stay.
pub fn simplify(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    edge_lengths: &[f32],
    locked: &[bool],
    options: &SimplifyOptions,
) -> Simplified {
    let mut work = Work::new(positions, triangles, edge_lengths, locked);
    for _ in 0..MAX_PASSES {
        let excess = work.used.saturating_sub(options.vertices);
        let is_far = work.used > FAR * options.vertices;
        let share = if is_far { FAR_SHARE } else { NEAR_SHARE };
        if excess == 0 || work.pass(excess, options.error, share) == 0 {
            break;
        }
    }
    work.finish()
}

/// Weighted sum of squared distances to planes, as `p A p + 2 b p + c`, and the area of the faces
/// in it.
#[derive(Clone, Copy, Default)]
struct Quadric {
    /// xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: DVec3,
    c: f64,
    area: f64,
}

impl Quadric {
    fn of_plane(normal: DVec3, point: DVec3, weight: f64) -> Quadric {
        let [x, y, z] = normal.to_array();
        let d = -normal.dot(point);
        Quadric {
            a: [x * x, x * y, x * z, y * y, y * z, z * z].map(|v| weight * v),
            b: weight * d * normal,
            c: weight * d * d,
            area: 0.0,
        }
    }

    fn add(&mut self, other: &Quadric) {
        (0..6).for_each(|i| self.a[i] += other.a[i]);
        self.b += other.b;
        self.c += other.c;
        self.area += other.area;
    }

    /// Mean squared distance at `p`.
    fn error(&self, p: DVec3) -> f64 {
        let [x, y, z] = p.to_array();
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let squares = xx * x * x + yy * y * y + zz * z * z;
        let mixed = 2.0 * (xy * x * y + xz * x * z + yz * y * z);
        let linear = 2.0 * self.b.dot(p);
        ((squares + mixed + linear + self.c) / self.area.max(f64::MIN_POSITIVE)).max(0.0)
    }
}

/// The collapse that suits a vertex best.
#[derive(Clone, Copy)]
struct Wish {
    cost: f32,
    from: u32,
    to: u32,
}

/// Buffers that are reused from vertex to vertex.
#[derive(Default)]
struct Scratch {
    /// Neighbours, and how many faces contain both.
    neighbours: Vec<(u32, u32)>,
    wishes: Vec<Wish>,
    shared: Vec<u32>,
}

struct Work<'a> {
    positions: &'a [DVec3],
    edge_lengths: &'a [f32],
    /// Vertices that the caller locked, and vertices on an edge with more than two faces.
    locked: Vec<bool>,
    triangles: Vec<[u32; 3]>,
    quadrics: Vec<Quadric>,
    stands_for: Vec<u32>,
    used: usize,
}

impl<'a> Work<'a> {
    fn new(
        positions: &'a [DVec3],
        triangles: &[[u32; 3]],
        edge_lengths: &'a [f32],
        locked: &[bool],
    ) -> Self {
        let proper = |t: &&[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        let triangles: Vec<_> = triangles.iter().filter(proper).copied().collect();
        let mut used = vec![false; positions.len()];
        triangles
            .iter()
            .flatten()
            .for_each(|&v| used[v as usize] = true);
        let mut work = Work {
            positions,
            edge_lengths,
            locked: locked.to_vec(),
            quadrics: vec![Quadric::default(); positions.len()],
            stands_for: (0..positions.len() as u32).collect(),
            used: used.iter().filter(|used| **used).count(),
            triangles,
        };
        work.add_planes();
        work
    }

    fn corners(&self, t: [u32; 3]) -> [DVec3; 3] {
        t.map(|v| self.positions[v as usize])
    }

    /// Adds the quadrics of faces and of walls along the rims. Locks the ends of edges with more
    /// than two faces.
    fn add_planes(&mut self) {
        for t in self.triangles.clone() {
            let [a, b, c] = self.corners(t);
            let normal = (b - a).cross(c - a);
            let twice_area = normal.length();
            if twice_area <= 0.0 {
                continue;
            }
            let mut plane = Quadric::of_plane(normal / twice_area, a, twice_area / 6.0);
            plane.area = twice_area / 6.0;
            t.iter()
                .for_each(|&v| self.quadrics[v as usize].add(&plane));
        }
        let ring = Rings::of(self.positions.len(), &self.triangles);
        for v in 0..self.positions.len() as u32 {
            for &(other, faces) in &ring.neighbours(v, &self.triangles) {
                match faces {
                    1 if v < other => self.add_wall(v, other),
                    1 | 2 => {}
                    _ => self.locked[v as usize] = true,
                }
            }
        }
    }

    fn add_wall(&mut self, a: u32, b: u32) {
        let (p, q) = (self.positions[a as usize], self.positions[b as usize]);
        let along = q - p;
        let squared = along.length_squared();
        if squared <= 0.0 {
            return;
        }
        // The squared distance to a line with unit direction d has A = I − d dᵀ, like two planes.
        let [x, y, z] = along.to_array();
        let weight = RIM_WEIGHT * squared;
        let a6 = [
            1.0 - x * x / squared,
            -x * y / squared,
            -x * z / squared,
            1.0 - y * y / squared,
            -y * z / squared,
            1.0 - z * z / squared,
        ];
        let times = |v: DVec3| {
            DVec3::new(
                a6[0] * v[0] + a6[1] * v[1] + a6[2] * v[2],
                a6[1] * v[0] + a6[3] * v[1] + a6[4] * v[2],
                a6[2] * v[0] + a6[4] * v[1] + a6[5] * v[2],
            )
        };
        let image = times(p);
        let wall = Quadric {
            a: a6.map(|v| weight * v),
            b: -weight * image,
            c: weight * p.dot(image),
            area: 0.0,
        };
        self.quadrics[a as usize].add(&wall);
        self.quadrics[b as usize].add(&wall);
    }

    /// Collapses up to `excess` edges that do not touch each other, from the cheapest `share` of
    /// the wishes. Returns how many edges it collapsed.
    fn pass(&mut self, excess: usize, error: f64, share: f64) -> usize {
        let rings = Rings::of(self.positions.len(), &self.triangles);
        let mut wishes: Vec<Wish> = (0..self.positions.len() as u32)
            .into_par_iter()
            .filter(|&v| !self.locked[v as usize] && !rings.faces(v).is_empty())
            .map_init(Scratch::default, |scratch, v| {
                self.wish(&rings, v, error, scratch)
            })
            .flatten()
            .collect();
        wishes.par_sort_unstable_by(|a, b| a.cost.total_cmp(&b.cost).then(a.from.cmp(&b.from)));
        let last = (share * wishes.len() as f64) as usize;
        let worst = wishes.get(last).map_or(0.0, |wish| wish.cost);
        let mut touched = vec![false; self.positions.len()];
        let mut done = 0;
        for wish in wishes.iter().take_while(|wish| wish.cost <= worst) {
            if done == excess {
                break;
            }
            if touched[wish.from as usize] || touched[wish.to as usize] {
                continue;
            }
            for &f in rings.faces(wish.from) {
                let t = &mut self.triangles[f as usize];
                t.iter().for_each(|&v| touched[v as usize] = true);
                t.iter_mut()
                    .filter(|v| **v == wish.from)
                    .for_each(|v| *v = wish.to);
            }
            let quadric = self.quadrics[wish.from as usize];
            self.quadrics[wish.to as usize].add(&quadric);
            self.stands_for[wish.from as usize] = wish.to;
            done += 1;
        }
        self.triangles
            .retain(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
        self.used -= done;
        done
    }

    /// The cheapest collapse of `v` that is allowed.
    fn wish(&self, rings: &Rings, v: u32, error: f64, scratch: &mut Scratch) -> Option<Wish> {
        let Scratch {
            neighbours,
            wishes,
            shared,
        } = scratch;
        rings.find_neighbours(v, &self.triangles, neighbours);
        let on_rim = neighbours.iter().any(|&(_, faces)| faces == 1);
        if neighbours.iter().any(|&(_, faces)| faces > 2) {
            return None;
        }
        wishes.clear();
        for &(to, faces) in neighbours.iter() {
            if !on_rim || faces == 1 {
                let (cost, moved) = self.cost(v, to);
                if moved <= error * error {
                    wishes.push(Wish { cost, from: v, to });
                }
            }
        }
        // The cheapest wish is nearly always allowed, so sorting all of them would waste time.
        while let Some(best) = cheapest(wishes) {
            let wish = wishes.swap_remove(best);
            if keeps_the_form(rings, &self.triangles, wish, neighbours, shared)
                && self.keeps_facing(rings, wish.from, wish.to)
            {
                return Some(wish);
            }
        }
        None
    }

    /// The cost of a collapse, and its squared error.
    fn cost(&self, from: u32, to: u32) -> (f32, f64) {
        let (p, q) = (self.positions[from as usize], self.positions[to as usize]);
        let edge_length =
            f64::from(0.5 * (self.edge_lengths[from as usize] + self.edge_lengths[to as usize]));
        let mut quadric = self.quadrics[from as usize];
        quadric.add(&self.quadrics[to as usize]);
        let moved = quadric.error(q);
        // An error of a tenth of the requested length weighs as much as an edge of that length.
        let cost = (p.distance_squared(q) + 100.0 * moved) / (edge_length * edge_length);
        (cost as f32, moved)
    }

    /// Whether every remaining face of `from` keeps an area and faces much the same way when `from`
    /// moves to `to`.
    fn keeps_facing(&self, rings: &Rings, from: u32, to: u32) -> bool {
        rings.faces(from).iter().all(|&f| {
            let t = self.triangles[f as usize];
            if t.contains(&to) {
                return true;
            }
            let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
            let before = normal(self.corners(t));
            let after = normal(self.corners(t.map(|v| if v == from { to } else { v })));
            before.dot(after) > LEAST_COSINE * before.length() * after.length()
        })
    }

    fn finish(mut self) -> Simplified {
        for v in 0..self.stands_for.len() {
            let mut root = self.stands_for[v];
            while self.stands_for[root as usize] != root {
                root = self.stands_for[root as usize];
            }
            let mut at = v as u32;
            while self.stands_for[at as usize] != root {
                at = std::mem::replace(&mut self.stands_for[at as usize], root);
            }
        }
        Simplified {
            triangles: self.triangles,
            stands_for: self.stands_for,
        }
    }
}

/// Index of the cheapest wish. Among equally cheap ones, the lowest target vertex wins.
fn cheapest(wishes: &[Wish]) -> Option<usize> {
    let order = |a: &Wish, b: &Wish| a.cost.total_cmp(&b.cost).then(a.to.cmp(&b.to));
    let best = wishes.iter().enumerate().min_by(|a, b| order(a.1, b.1));
    best.map(|(at, _)| at)
}

/// The link condition: the ends of the edge share the third corners of its faces and no other
/// neighbour. `neighbours`: those of `wish.from`. `shared`: a scratch buffer.
fn keeps_the_form(
    rings: &Rings,
    triangles: &[[u32; 3]],
    wish: Wish,
    neighbours: &[(u32, u32)],
    shared: &mut Vec<u32>,
) -> bool {
    let across = neighbours.iter().find(|n| n.0 == wish.to);
    let across = across.map_or(0, |n| n.1 as usize);
    shared.clear();
    for v in rings
        .faces(wish.to)
        .iter()
        .flat_map(|&f| triangles[f as usize])
    {
        let is_shared = v != wish.from && v != wish.to && neighbours.iter().any(|n| n.0 == v);
        if is_shared && !shared.contains(&v) {
            shared.push(v);
        }
    }
    shared.len() == across
}

/// Faces around every vertex.
pub(crate) struct Rings {
    start: Vec<u32>,
    faces: Vec<u32>,
}

impl Rings {
    pub(crate) fn of(vertices: usize, triangles: &[[u32; 3]]) -> Rings {
        let mut start = vec![0u32; vertices + 1];
        triangles
            .iter()
            .flatten()
            .for_each(|&v| start[v as usize + 1] += 1);
        (0..vertices).for_each(|v| start[v + 1] += start[v]);
        let mut next = start.clone();
        let mut faces = vec![0; 3 * triangles.len()];
        for (f, t) in triangles.iter().enumerate() {
            for &v in t {
                faces[next[v as usize] as usize] = f as u32;
                next[v as usize] += 1;
            }
        }
        Rings { start, faces }
    }

    /// Number of vertices that have a face.
    pub(crate) fn used(&self) -> usize {
        self.start
            .windows(2)
            .filter(|pair| pair[0] < pair[1])
            .count()
    }

    /// Faces of one vertex, ascending.
    pub(crate) fn faces(&self, v: u32) -> &[u32] {
        &self.faces[self.start[v as usize] as usize..self.start[v as usize + 1] as usize]
    }

    /// Neighbours of one vertex, and how many faces contain both.
    pub(crate) fn neighbours(&self, v: u32, triangles: &[[u32; 3]]) -> Vec<(u32, u32)> {
        let mut out = Vec::with_capacity(8);
        self.find_neighbours(v, triangles, &mut out);
        out
    }

    /// Like [`Rings::neighbours`], but writes into the caller's buffer.
    fn find_neighbours(&self, v: u32, triangles: &[[u32; 3]], out: &mut Vec<(u32, u32)>) {
        out.clear();
        for other in self.faces(v).iter().flat_map(|&f| triangles[f as usize]) {
            match out.iter_mut().find(|n| n.0 == other) {
                _ if other == v => {}
                Some(known) => known.1 += 1,
                None => out.push((other, 1)),
            }
        }
    }
}

#[cfg(test)]
mod tests;
