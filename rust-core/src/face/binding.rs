//! Decides what each vertex that is not skin follows, by the role of its part.
//!
//! Lengths are canonical centimetres.

use std::{
    cell::OnceCell,
    collections::{BinaryHeap, HashMap},
};

use glam::Vec3;
use rayon::prelude::*;

use super::{
    box3::Box3,
    nearest::PointGrid,
    part_list::{PartList, skin_tree},
    role_rules::{REACH_CM, RoleRules},
};
use crate::mesh::{Mesh, PartRole, SurfaceTree, dijkstra::QueueEntry, ibug::LANDMARKS};

/// A part that is this near to the skin follows it fully. The share falls to zero at [`REACH_CM`].
const FOLLOW_CM: f32 = 1.0;
/// The roots of a part are its vertex nearest to the skin, and all vertices at most this much
/// farther from the skin.
const ROOT_CM: f32 = 0.15;
/// A part larger than this (hair, clothes) follows the skin vertex by vertex.
const SMALL_CM: f32 = 6.0;
/// The highest vertices in the front half of a mouth part surely belong to the upper jaw, and the
/// lowest to the lower jaw. This is their share at each end.
const SURE_SHARE: f32 = 0.05;
/// A vertex of a mouth part follows one jaw alone if its path to the other jaw is longer by at
/// least this. Otherwise it follows both.
const PASSAGE_CM: f32 = 0.3;

/// Three vertices with their shares.
pub type Corners = [(u32, f32); 3];

/// What moves a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Follows {
    /// Up to three vertices of the skin, each by its share; together at most 1.
    Skin(Corners),
    /// The lower jaw, by a share.
    Jaw(f32),
    /// Nothing: it rests with the skull.
    Skull,
}

impl Follows {
    /// A vertex of the skin, which follows itself.
    fn itself(v: u32) -> Follows {
        Follows::Skin([(v, 1.0), (v, 0.0), (v, 0.0)])
    }
}

/// Decides for every vertex what it follows.
///
/// `mesh`: in canonical centimetres. `skin`: `[V]`, whether landmark motion is solved at a vertex.
/// Such a vertex follows itself. `landmarks`: those of the neutral face.
pub fn bind(
    mesh: &Mesh,
    list: &PartList,
    skin: &[bool],
    landmarks: &[[f32; 3]; LANDMARKS],
) -> Vec<Follows> {
    let mut follows: Vec<Follows> = (0..mesh.positions.len() as u32)
        .map(|v| {
            if skin[v as usize] {
                Follows::itself(v)
            } else {
                Follows::Skull
            }
        })
        .collect();
    let surface = OnceCell::new();
    let tree = || surface.get_or_init(|| skin_tree(mesh, skin));
    let unit = RoleRules::of(landmarks).mouth_unit();
    for (part, vertices) in list.parts.iter().zip(list.connected.vertices()) {
        let others: Vec<u32> = vertices
            .into_iter()
            .filter(|&v| !skin[v as usize])
            .collect();
        if others.is_empty() {
            continue;
        }
        let bindings = match part.role {
            PartRole::Jaw => vec![Follows::Jaw(1.0); others.len()],
            PartRole::Mouth => jaw_shares(mesh, &others, unit),
            PartRole::Nearest | PartRole::Skin => follow_skin(mesh, &others, tree()),
            PartRole::Skull | PartRole::Gaze | PartRole::Still => continue,
        };
        for (v, of_vertex) in others.into_iter().zip(bindings) {
            follows[v as usize] = of_vertex;
        }
    }
    follows
}

/// What each vertex of a part follows: the point of the skin nearest to the vertex or, for a small
/// part, nearest to the root closest to the vertex.
fn follow_skin(mesh: &Mesh, part: &[u32], tree: &SurfaceTree) -> Vec<Follows> {
    let points: Vec<[f32; 3]> = part.iter().map(|&v| mesh.positions[v as usize]).collect();
    let nearest: Vec<_> = points.par_iter().map(|&p| place(mesh, tree, p)).collect();
    let fade = |d: f32| ((REACH_CM - d) / (REACH_CM - FOLLOW_CM)).clamp(0.0, 1.0);
    let by = |(corners, d): (Corners, f32)| match fade(d) {
        0.0 => Follows::Skull,
        share => Follows::Skin(corners.map(|(v, w)| (v, w * share))),
    };
    if Box3::of(points.iter().copied()).largest() > SMALL_CM {
        let far = nearest.iter().map(|hit| hit.map_or(Follows::Skull, by));
        return far.collect();
    }
    let least = nearest.iter().flatten().map(|hit| hit.1);
    let least = least.fold(f32::INFINITY, f32::min);
    let (roots, places): (Vec<_>, Vec<Corners>) = points
        .iter()
        .zip(&nearest)
        .filter_map(|(&p, hit)| {
            hit.filter(|hit| hit.1 <= least + ROOT_CM)
                .map(|hit| (p, hit.0))
        })
        .unzip();
    if roots.is_empty() {
        return vec![Follows::Skull; part.len()];
    }
    let grid = PointGrid::new(&roots, 0.5);
    let root = |&p: &[f32; 3]| {
        grid.nearest(p, 2.0 * SMALL_CM)
            .map_or(0, |hit| hit.0 as usize)
    };
    points
        .iter()
        .map(|p| by((places[root(p)], least)))
        .collect()
}

/// The corners of the skin's triangle nearest to a point, with their shares, and the distance.
fn place(mesh: &Mesh, tree: &SurfaceTree, point: [f32; 3]) -> Option<(Corners, f32)> {
    let hit = tree.closest(point)?;
    let corners = mesh.triangles[hit.face as usize];
    let shares = std::array::from_fn(|i| (corners[i], hit.barycentric[i] as f32));
    Some((shares, hit.distance as f32))
}

/// How far each vertex follows the lower jaw, in a part that belongs to both jaws.
///
/// The highest and the lowest vertices of its front half surely belong to one jaw each. Every other
/// vertex belongs to the jaw that is nearer along the edges of the part. On ICT FaceKit's gums with
/// tongue, 4 % of the vertices come out on the wrong jaw, in the throat. `unit`: one length unit of
/// the mouth.
fn jaw_shares(mesh: &Mesh, part: &[u32], unit: f32) -> Vec<Follows> {
    let at = |v: &u32| mesh.positions[*v as usize];
    let mut depths: Vec<f32> = part.iter().map(|v| at(v)[2]).collect();
    depths.sort_by(f32::total_cmp);
    let middle = depths[depths.len() / 2];
    let mut front: Vec<u32> = part
        .iter()
        .copied()
        .filter(|v| at(v)[2] >= middle)
        .collect();
    front.sort_by(|a, b| at(a)[1].total_cmp(&at(b)[1]));
    let count = ((front.len() as f32 * SURE_SHARE) as usize).clamp(1, front.len());
    let ways = EdgeWays::new(mesh, part);
    let down = ways.shortest_from(&front[..count]);
    let up = ways.shortest_from(&front[front.len() - count..]);
    let passage = PASSAGE_CM * unit;
    let share = |(up, down): (f32, f32)| match (up.is_finite(), down.is_finite()) {
        (true, true) => (0.5 + (up - down) / (2.0 * passage)).clamp(0.0, 1.0),
        // A loose piece follows the jaw if it reaches lowest vertices and no highest ones. Any
        // other loose piece rests.
        (upper, lower) => f32::from(lower && !upper),
    };
    let follows = |ways| match share(ways) {
        0.0 => Follows::Skull,
        share => Follows::Jaw(share),
    };
    up.into_iter().zip(down).map(follows).collect()
}

/// Paths along the edges of one part.
struct EdgeWays {
    /// Neighbours of each vertex of the part, by position in the part, with the edge's length.
    edges: Vec<Vec<(u32, f32)>>,
    number: HashMap<u32, u32>,
}

impl EdgeWays {
    fn new(mesh: &Mesh, part: &[u32]) -> EdgeWays {
        let number: HashMap<u32, u32> = part
            .iter()
            .enumerate()
            .map(|(i, &v)| (v, i as u32))
            .collect();
        let mut edges = vec![Vec::new(); part.len()];
        for t in &mesh.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                if let (Some(&i), Some(&j)) = (number.get(&a), number.get(&b)) {
                    let length = Vec3::from(mesh.positions[a as usize])
                        .distance(mesh.positions[b as usize].into());
                    edges[i as usize].push((j, length));
                    edges[j as usize].push((i, length));
                }
            }
        }
        EdgeWays { edges, number }
    }

    /// Length of the shortest path from each vertex to any of `seeds` (vertices of the mesh).
    fn shortest_from(&self, seeds: &[u32]) -> Vec<f32> {
        let mut ways = vec![f32::INFINITY; self.edges.len()];
        let mut heap: BinaryHeap<QueueEntry> = (seeds.iter())
            .map(|v| QueueEntry(0.0, self.number[v], ()))
            .collect();
        while let Some(QueueEntry(way, at, ())) = heap.pop() {
            if way >= ways[at as usize] {
                continue;
            }
            ways[at as usize] = way;
            for &(next, length) in &self.edges[at as usize] {
                if way + length < ways[next as usize] {
                    heap.push(QueueEntry(way + length, next, ()));
                }
            }
        }
        ways
    }
}
