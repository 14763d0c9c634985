//! Subdivision: gives a surface more triangles without changing its form.

use std::collections::HashMap;

use super::Mesh;

impl Mesh {
    /// Cuts every triangle into four, with a new vertex in the middle of each edge. The mesh's own
    /// vertices come first and keep their places. The surface stays the same.
    #[must_use]
    pub fn cut_in_four(&self) -> Mesh {
        let mut positions = self.positions.clone();
        let mut middles = HashMap::new();
        let mut triangles = Vec::with_capacity(4 * self.triangles.len());
        for &[a, b, c] in &self.triangles {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| {
                *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    let (p, q) = (positions[p as usize], positions[q as usize]);
                    positions.push(std::array::from_fn(|i| 0.5 * (p[i] + q[i])));
                    positions.len() as u32 - 1
                })
            });
            triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        Mesh {
            positions,
            triangles,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::mesh::Mesh;

    #[test]
    fn neighbours_share_the_vertex_between_them_and_own_vertices_stay() {
        let square = Mesh {
            positions: vec![[0., 0., 0.], [2., 0., 0.], [2., 2., 0.], [0., 2., 0.]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        let finer = square.cut_in_four();
        assert_eq!(finer.positions[..4], square.positions);
        // Four vertices and five edges: both triangles share the new vertex on the diagonal.
        assert_eq!(finer.positions.len(), 9);
        assert_eq!(finer.triangles.len(), 8);
        let area = |mesh: &Mesh| -> f32 {
            (mesh.triangles.iter())
                .map(|t| {
                    let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
                    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
                })
                .sum()
        };
        assert_eq!(area(&finer), 4.0);
    }
}
