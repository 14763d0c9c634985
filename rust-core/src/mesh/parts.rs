//! Finds the connected parts of a mesh, and the seams to sew up.

use std::collections::HashMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Sets that only ever merge.
#[derive(Debug, Clone)]
pub(crate) struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    pub fn new(count: usize) -> Self {
        DisjointSets {
            parent: (0..count as u32).collect(),
        }
    }

    pub fn find(&mut self, mut x: u32) -> u32 {
        while self.parent[x as usize] != x {
            self.parent[x as usize] = self.parent[self.parent[x as usize] as usize];
            x = self.parent[x as usize];
        }
        x
    }

    /// The smaller representative stays, so that results do not depend on the order of merging.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

/// The part number of a vertex that belongs to no face.
pub const NO_PART: u32 = u32::MAX;

/// Connected parts of a mesh, in the order of their first vertex.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Parts {
    /// `[V]`, part of each vertex; [`NO_PART`] for a vertex in no face.
    pub of_vertex: Vec<u32>,
    /// Number of parts.
    pub count: usize,
}

impl Parts {
    /// Parts of the graph whose edges are the sides of `triangles` over `vertex_count` vertices.
    pub fn of(vertex_count: usize, triangles: &[[u32; 3]]) -> Parts {
        let mut sets = DisjointSets::new(vertex_count);
        let mut used = vec![false; vertex_count];
        for &[a, b, c] in triangles {
            sets.join(a, b);
            sets.join(b, c);
            for v in [a, b, c] {
                used[v as usize] = true;
            }
        }
        let mut number = vec![NO_PART; vertex_count];
        let mut of_vertex = vec![NO_PART; vertex_count];
        let mut count = 0;
        for v in (0..vertex_count).filter(|&v| used[v]) {
            let root = sets.find(v as u32) as usize;
            if number[root] == NO_PART {
                number[root] = count;
                count += 1;
            }
            of_vertex[v] = number[root];
        }
        Parts {
            of_vertex,
            count: count as usize,
        }
    }

    /// Vertices of every part, ascending.
    pub fn vertices(&self) -> Vec<Vec<u32>> {
        let mut lists = vec![Vec::new(); self.count];
        for (v, &part) in self.of_vertex.iter().enumerate() {
            if part != NO_PART {
                lists[part as usize].push(v as u32);
            }
        }
        lists
    }

    /// Faces of one part, ascending.
    pub fn faces(&self, part: u32, triangles: &[[u32; 3]]) -> Vec<u32> {
        let is_in = |t: &[u32; 3]| self.of_vertex[t[0] as usize] == part;
        let numbered = triangles.iter().enumerate();
        numbered
            .filter(|(_, t)| is_in(t))
            .map(|(f, _)| f as u32)
            .collect()
    }
}

/// Two rims are a seam only if at least this share of the edges of one of them face other edges.
/// Parts that merely touch, such as lashes on the fluid of the eye, share an edge or two by chance.
const SEAM_SHARE: f64 = 0.2;

/// Sews up seams: returns for each vertex the vertex that stands for it (itself for most).
///
/// Exporters split vertices along texture seams. Both banks of the seam then have boundary edges
/// at exactly the same place, which run opposite ways. Only such pairs are sewn, and only if each
/// bank has exactly one edge there and a fifth of the edges of either rim have such a partner.
/// Touching lips or lids stay apart, because their edges are not boundaries or their vertices
/// merely coincide. Connectivity cannot tell a seam from a mouth whose closed lips are the two
/// halves of one open slit: name the vertices of such a mouth in `keep_apart`.
///
/// # Shapes
/// `positions`: `[V]`; `triangles`: `[F]`; `keep_apart`: vertices that are never sewn.
/// Returns `[V]`; each entry is the smallest vertex of its group.
pub fn weld_seams(positions: &[[f32; 3]], triangles: &[[u32; 3]], keep_apart: &[u32]) -> Vec<u32> {
    let mut apart = vec![false; positions.len()];
    for &v in keep_apart
        .iter()
        .filter(|&&v| (v as usize) < positions.len())
    {
        apart[v as usize] = true;
    }
    let edges = boundary_edges(triangles);
    let pairs = facing_edges(positions, &edges);
    let mut rims = DisjointSets::new(positions.len());
    edges.iter().for_each(|&(a, b)| rims.join(a, b));
    let rim_of = |edge: &(u32, u32), rims: &mut DisjointSets| rims.find(edge.0);
    let mut rim_edges: HashMap<u32, (f64, f64)> = HashMap::new();
    for edge in &edges {
        rim_edges.entry(rim_of(edge, &mut rims)).or_default().0 += 1.0;
    }
    for (edge, _) in &pairs {
        rim_edges.entry(rim_of(edge, &mut rims)).or_default().1 += 1.0;
    }
    let mut sets = DisjointSets::new(positions.len());
    for (one, other) in &pairs {
        let fits = [one, other].into_iter().any(|edge| {
            let (all, facing) = rim_edges[&rim_of(edge, &mut rims)];
            facing >= SEAM_SHARE * all
        });
        for (v, w) in [(one.0, other.1), (one.1, other.0)] {
            if fits && !apart[v as usize] && !apart[w as usize] {
                sets.join(v, w);
            }
        }
    }
    (0..positions.len() as u32).map(|v| sets.find(v)).collect()
}

/// Pairs of boundary edges that lie at the same place, run opposite ways and have no third edge
/// there. Each pair appears in both orders.
fn facing_edges(positions: &[[f32; 3]], edges: &[(u32, u32)]) -> Vec<((u32, u32), (u32, u32))> {
    // Adding zero turns −0 into 0, so that both are the same place.
    let place = |v: u32| positions[v as usize].map(|x| (x + 0.0).to_bits());
    let mut banks: HashMap<_, Vec<(u32, u32)>> = HashMap::new();
    for &(a, b) in edges {
        banks.entry((place(a), place(b))).or_default().push((a, b));
    }
    let facing = |&(a, b): &(u32, u32)| {
        let here = &banks[&(place(a), place(b))];
        match (
            here.as_slice(),
            banks.get(&(place(b), place(a))).map(Vec::as_slice),
        ) {
            ([one], Some([other])) => Some((*one, *other)),
            _ => None,
        }
    };
    edges.iter().filter_map(facing).collect()
}

/// Directed edges that have exactly one face, in ascending order.
pub fn boundary_edges(triangles: &[[u32; 3]]) -> Vec<(u32, u32)> {
    let mut edges: Vec<(u64, bool)> = Vec::with_capacity(3 * triangles.len());
    for t in triangles {
        for s in 0..3 {
            let (a, b) = (t[s], t[(s + 1) % 3]);
            if a != b {
                edges.push((u64::from(a.min(b)) << 32 | u64::from(a.max(b)), a < b));
            }
        }
    }
    edges.par_sort_unstable();
    let mut lone = Vec::new();
    for group in edges.chunk_by(|x, y| x.0 == y.0) {
        if let [(ends, forward)] = *group {
            let (a, b) = ((ends >> 32) as u32, ends as u32);
            lone.push(if forward { (a, b) } else { (b, a) });
        }
    }
    lone.sort_unstable();
    lone
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_triangles_and_a_loose_vertex_are_two_parts() {
        let parts = Parts::of(7, &[[4, 5, 6], [0, 1, 2]]);
        assert_eq!(parts.count, 2);
        assert_eq!(parts.of_vertex, [0, 0, 0, NO_PART, 1, 1, 1]);
        assert_eq!(parts.faces(1, &[[4, 5, 6], [0, 1, 2]]), [0]);
        assert_eq!(parts.vertices()[1], [4, 5, 6]);
    }

    #[test]
    fn a_split_seam_is_sewn_and_a_touching_point_is_not() {
        // Two triangles form a square whose diagonal has doubled vertices. A third triangle touches
        // one corner.
        let positions = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [0.0, 0.0, -0.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 2.0, 0.0],
            [1.0, 2.0, 0.0],
        ];
        let triangles = [[0, 1, 2], [3, 4, 5], [6, 8, 7]];
        let weld = weld_seams(&positions, &triangles, &[]);
        assert_eq!(weld, [0, 1, 2, 0, 2, 5, 6, 7, 8]);
        let apart = weld_seams(&positions, &triangles, &[4]);
        assert_eq!(apart, [0, 1, 2, 0, 4, 5, 6, 7, 8]);
    }

    #[test]
    fn parts_that_share_one_edge_by_chance_stay_apart() {
        // Two strips of eight cells each touch end to end, along one edge.
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for offset in [0.0, 8.0] {
            let base = positions.len() as u32;
            for i in 0..=8 {
                positions.extend([[offset + i as f32, 0.0, 0.0], [offset + i as f32, 1.0, 0.0]]);
            }
            for i in 0..8 {
                let [a, b, c, d] = [0, 2, 3, 1].map(|k| base + 2 * i + k);
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        let weld = weld_seams(&positions, &triangles, &[]);
        assert!(weld.iter().enumerate().all(|(v, &w)| v as u32 == w));
    }
}
