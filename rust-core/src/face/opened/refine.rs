//! Makes triangles along a cut finer where a mesh is coarse, since a rim of long edges cannot bend
//! smoothly.
//!
//! Long edges near the cut are halved until they are short; the surface stays the same. An edge is
//! identified by the positions of its ends, so that both banks of a texture seam are halved alike.

use std::collections::HashSet;

use glam::DVec3;

use super::source::TriangleSource;
use crate::mesh::Mesh;

/// Longest edge at the cut, in widths of the mouth or the eye (2 mm).
const LONGEST: f64 = 0.04;
/// How much longer an edge may be for each width between it and the cut.
const GROWTH: f64 = 0.5;
/// Rounds of halving. They bring an edge of ten widths down to the longest one at the cut.
const MAX_ROUNDS: usize = 8;

/// The positions of both ends, as bits, the smaller first.
type Edge = [[u32; 3]; 2];

/// A mesh with more triangles on the same surface. Old vertices come first, and pieces of old
/// triangles keep the order of the triangles.
pub(in crate::face) struct FineMesh {
    pub mesh: Mesh,
    /// Old vertices and their shares, three for each vertex.
    pub vertex_sources: Vec<[(u32, f32); 3]>,
    pub triangle_sources: Vec<TriangleSource>,
}

impl FineMesh {
    /// Halves long edges of some triangles beside a cut. `place` returns a point of the mesh in
    /// widths, and its distance from the cut in widths.
    pub fn beside(
        mesh: &Mesh,
        triangles: &[u32],
        place: impl Fn(DVec3) -> (DVec3, f64),
    ) -> FineMesh {
        FineMesh::unchanged(mesh).refined(triangles, place)
    }

    /// [`FineMesh::beside`] for a mesh that may already be finer elsewhere.
    pub fn refined(mut self, triangles: &[u32], place: impl Fn(DVec3) -> (DVec3, f64)) -> FineMesh {
        let fine = &mut self;
        let mut near: HashSet<u32> = triangles.iter().copied().collect();
        for _ in 0..MAX_ROUNDS {
            let edges = fine.long_edges(&near, &place);
            if edges.is_empty() {
                break;
            }
            fine.halve(&mut near, &edges);
        }
        self
    }

    /// The mesh as it is, not refined.
    pub fn unchanged(mesh: &Mesh) -> FineMesh {
        let vertices = (0..mesh.positions.len() as u32).map(|v| [(v, 1.0), (v, 0.0), (v, 0.0)]);
        let triangles = (0..mesh.triangles.len() as u32).map(TriangleSource::whole);
        FineMesh {
            mesh: mesh.clone(),
            vertex_sources: vertices.collect(),
            triangle_sources: triangles.collect(),
        }
    }

    /// Edges of the triangles `near` that are too long for their distance from the cut.
    fn long_edges(
        &self,
        near: &HashSet<u32>,
        place: &impl Fn(DVec3) -> (DVec3, f64),
    ) -> HashSet<Edge> {
        let mut edges = HashSet::new();
        for &face in near {
            let t = self.mesh.triangles[face as usize];
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let [p, q] = [a, b].map(|v| self.mesh.point(v));
                // Of five places along the edge, the nearest to the cut.
                let places = (0..5).map(|i| place(p.lerp(q, 0.25 * f64::from(i))).1);
                let away = places.fold(f64::INFINITY, f64::min);
                if place(p).0.distance(place(q).0) > LONGEST + GROWTH * away {
                    edges.insert(self.edge(a, b));
                }
            }
        }
        edges
    }

    fn edge(&self, a: u32, b: u32) -> Edge {
        // Adding zero turns −0 into 0, so that both are one place.
        let place = |v: u32| self.mesh.positions[v as usize].map(|x| (x + 0.0).to_bits());
        let [p, q] = [place(a), place(b)];
        [p.min(q), p.max(q)]
    }

    /// Halves edges. Replaces the triangles in `near` by their pieces.
    fn halve(&mut self, near: &mut HashSet<u32>, edges: &HashSet<Edge>) {
        let mut middles = std::collections::HashMap::new();
        let triangles = std::mem::take(&mut self.mesh.triangles);
        let sources = std::mem::take(&mut self.triangle_sources);
        let mut new_near = HashSet::new();
        for (face, (t, source)) in triangles.into_iter().zip(sources).enumerate() {
            let first = self.mesh.triangles.len() as u32;
            let mut corners: Vec<(u32, [f32; 3])> = Vec::with_capacity(6);
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                corners.push((a, source.corners[k]));
                if edges.contains(&self.edge(a, b)) {
                    let [x, y] = [source.corners[k], source.corners[(k + 1) % 3]];
                    let shares = std::array::from_fn(|i| 0.5 * (x[i] + y[i]));
                    let middle = middles.entry((a.min(b), a.max(b)));
                    let middle = *middle.or_insert_with(|| self.middle(a, b));
                    corners.push((middle, shares));
                }
            }
            for piece in self.pieces(t, corners) {
                self.mesh.triangles.push(piece.map(|corner| corner.0));
                self.triangle_sources.push(TriangleSource {
                    triangle: source.triangle,
                    corners: piece.map(|corner| corner.1),
                });
            }
            if near.contains(&(face as u32)) {
                new_near.extend(first..self.mesh.triangles.len() as u32);
            }
        }
        *near = new_near;
    }

    fn middle(&mut self, a: u32, b: u32) -> u32 {
        let [p, q] = [a, b].map(|v| self.mesh.positions[v as usize]);
        let middle = std::array::from_fn(|i| 0.5 * (p[i] + q[i]));
        self.mesh.positions.push(middle);
        let ends = [(a, 0.5), (b, 0.5), (a, 0.0)];
        self.vertex_sources.push(mixed(&self.vertex_sources, ends));
        self.mesh.positions.len() as u32 - 1
    }

    /// Divides a triangle. `around`: its corners and the middles of some of its edges, in order.
    fn pieces<C: Copy>(&self, t: [u32; 3], around: Vec<(u32, C)>) -> Vec<[(u32, C); 3]> {
        let is_middle = |i: usize| !t.contains(&around[i % around.len()].0);
        let at = |i: usize| around[i % around.len()];
        let away = |a: u32, b: u32| self.mesh.point(a).distance(self.mesh.point(b));
        match around.len() {
            3 => vec![[at(0), at(1), at(2)]],
            4 => {
                let m = (0..4).find(|&i| is_middle(i)).unwrap_or(0);
                vec![[at(m), at(m + 1), at(m + 2)], [at(m), at(m + 2), at(m + 3)]]
            }
            5 => {
                // Two middles cut off the corner between them. The rest is cut along its shorter
                // diagonal.
                let m = (0..5)
                    .find(|&i| is_middle(i) && is_middle(i + 2))
                    .unwrap_or(0);
                let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|i| at(m + i));
                let rest = if away(a.0, d.0) < away(c.0, e.0) {
                    [[a, c, d], [a, d, e]]
                } else {
                    [[a, c, e], [c, d, e]]
                };
                vec![[a, b, c], rest[0], rest[1]]
            }
            _ => {
                let [a, m, b, n, c, o] = [0, 1, 2, 3, 4, 5].map(at);
                vec![[a, m, o], [m, b, n], [o, n, c], [m, n, o]]
            }
        }
    }
}

/// Expresses a mixture of vertices as a mixture of the old vertices in `sources`. All of these
/// belong to one old triangle.
pub(in crate::face) fn mixed(
    sources: &[[(u32, f32); 3]],
    shares: [(u32, f32); 3],
) -> [(u32, f32); 3] {
    let mut sum: Vec<(u32, f32)> = Vec::with_capacity(3);
    for (vertex, share) in shares.into_iter().filter(|(_, share)| *share > 0.0) {
        for (old, part) in sources[vertex as usize] {
            match sum.iter_mut().find(|(known, _)| *known == old) {
                Some((_, known)) => *known += share * part,
                None if part > 0.0 => sum.push((old, share * part)),
                None => {}
            }
        }
    }
    let first = sum[0].0;
    std::array::from_fn(|k| sum.get(k).copied().unwrap_or((first, 0.0)))
}
