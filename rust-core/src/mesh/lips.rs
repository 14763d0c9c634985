//! Decides which lip a vertex belongs to.
//!
//! A closed mouth consists of two surfaces that almost touch. The surface nearest to an inner-lip
//! landmark is the wrong lip as often as the right one, and a landmark on the wrong lip drags that
//! lip along. Distance along the surface tells the lips apart. Skin of the upper lip is nearer to
//! the upper outer-lip landmarks than to the lower ones, because every path to the other lip leads
//! around a corner of the mouth or through its inside.

use std::collections::BinaryHeap;

use glam::Vec3;

use super::{Mesh, dijkstra::QueueEntry};

/// One of the two lips.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lip {
    Upper,
    Lower,
}

/// The lip that an inner-lip landmark lies on; `None` for every other landmark.
pub(crate) fn lip_of_landmark(index: usize) -> Option<Lip> {
    match index {
        61..=63 => Some(Lip::Upper),
        65..=67 => Some(Lip::Lower),
        _ => None,
    }
}

/// `[V]`: the lip whose outer landmarks are nearer along the edges, within `radius` (mesh units).
///
/// Runs Dijkstra's algorithm from both lips at once. `upper` and `lower` are the vertices of
/// landmarks 49–53 and 55–59. Vertices that neither lip reaches stay `None`, for example those of a
/// lip modelled as a separate part.
pub(crate) fn lip_of_vertices(
    mesh: &Mesh,
    upper: &[u32],
    lower: &[u32],
    radius: f32,
) -> Vec<Option<Lip>> {
    let neighbours = neighbours_within(mesh, upper.iter().chain(lower), radius);
    let mut lips = vec![None; mesh.positions.len()];
    let mut heap = BinaryHeap::new();
    for (seeds, lip) in [(upper, Lip::Upper), (lower, Lip::Lower)] {
        for &vertex in seeds {
            heap.push(QueueEntry(0.0, vertex, lip));
        }
    }
    while let Some(QueueEntry(distance, vertex, lip)) = heap.pop() {
        if distance > radius || lips[vertex as usize].is_some() {
            continue;
        }
        lips[vertex as usize] = Some(lip);
        for &next in neighbours.of(vertex) {
            if lips[next as usize].is_none() {
                let here = mesh.positions[vertex as usize];
                let length = Vec3::from(mesh.positions[next as usize]).distance(here.into());
                heap.push(QueueEntry(distance + length, next, lip));
            }
        }
    }
    lips
}

/// Edges in compressed rows. Only triangles near the seeds count, so the rest of a body is left
/// out.
struct Neighbours {
    starts: Vec<u32>,
    vertices: Vec<u32>,
}

impl Neighbours {
    fn of(&self, vertex: u32) -> &[u32] {
        let range = self.starts[vertex as usize]..self.starts[vertex as usize + 1];
        &self.vertices[range.start as usize..range.end as usize]
    }
}

fn neighbours_within<'a>(
    mesh: &Mesh,
    seeds: impl Iterator<Item = &'a u32>,
    radius: f32,
) -> Neighbours {
    let (low, high) = bounds(mesh, seeds);
    let near = |v: u32| {
        let p = mesh.positions[v as usize];
        (0..3).all(|i| p[i] >= low[i] - radius && p[i] <= high[i] + radius)
    };
    let mut edges: Vec<(u32, u32)> = Vec::new();
    for t in mesh.triangles.iter().filter(|t| t.iter().any(|&v| near(v))) {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            edges.extend([(a, b), (b, a)]);
        }
    }
    edges.sort_unstable();
    edges.dedup();
    let mut starts = vec![0; mesh.positions.len() + 1];
    for &(a, _) in &edges {
        starts[a as usize + 1] += 1;
    }
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    Neighbours {
        starts,
        vertices: edges.into_iter().map(|(_, b)| b).collect(),
    }
}

fn bounds<'a>(mesh: &Mesh, vertices: impl Iterator<Item = &'a u32>) -> ([f32; 3], [f32; 3]) {
    let start = ([f32::MAX; 3], [f32::MIN; 3]);
    vertices.fold(start, |(low, high), &v| {
        let p = mesh.positions[v as usize];
        (
            std::array::from_fn(|i| low[i].min(p[i])),
            std::array::from_fn(|i| high[i].max(p[i])),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two strips whose inner edges coincide in space, joined only at their far left end.
    fn slit() -> Mesh {
        let mut positions = Vec::new();
        for side in [1.0f32, -1.0] {
            for i in 0..11 {
                positions.push([i as f32 * 0.1, 0.0, 0.0]);
                positions.push([i as f32 * 0.1, side, 0.0]);
            }
        }
        let mut triangles = Vec::new();
        for strip in [0u32, 22] {
            for i in 0..10 {
                let a = strip + 2 * i;
                triangles.extend([[a, a + 2, a + 1], [a + 1, a + 2, a + 3]]);
            }
        }
        triangles.push([0, 22, 1]);
        Mesh {
            positions,
            triangles,
        }
    }

    #[test]
    fn touching_edges_keep_their_own_lip() {
        let mesh = slit();
        let lips = lip_of_vertices(&mesh, &[11], &[33], 5.0);
        for i in 2..11 {
            assert_eq!(lips[2 * i], Some(Lip::Upper));
            assert_eq!(lips[22 + 2 * i], Some(Lip::Lower));
        }
    }

    #[test]
    fn vertices_out_of_reach_belong_to_no_lip() {
        let lips = lip_of_vertices(&slit(), &[21], &[43], 0.35);
        assert_eq!(lips[1], None);
        assert_eq!(lips[21], Some(Lip::Upper));
    }
}
