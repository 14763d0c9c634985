//! The vertices of a glTF for a mesh. The vertices of the mesh come first, in their order. Copies
//! follow for vertices that have several texture coordinates.

use std::collections::BTreeMap;

use crate::mesh::Mesh;

/// Vertices and triangles as the file holds them.
pub(super) struct Layout {
    /// `[W]`: the mesh vertex that each written vertex stands for.
    pub sources: Vec<u32>,
    /// `[W]`, with 0 at the top; `None` if the mesh has no texture coordinates.
    pub coordinates: Option<Vec<[f32; 2]>>,
    pub triangles: Vec<[u32; 3]>,
    /// The copies of each mesh vertex that has any.
    copies: BTreeMap<u32, Vec<u32>>,
}

impl Layout {
    /// `corners` `[F, 3]`: texture coordinates, with 0 at the bottom.
    pub fn new(mesh: &Mesh, corners: Option<&[[[f32; 2]; 3]]>) -> Layout {
        let count = mesh.positions.len();
        let mut layout = Layout {
            sources: (0..count as u32).collect(),
            coordinates: None,
            triangles: mesh.triangles.clone(),
            copies: BTreeMap::new(),
        };
        let Some(corners) = corners else {
            return layout;
        };
        let mut placed: Vec<Option<[f32; 2]>> = vec![None; count];
        for (triangle, places) in layout.triangles.iter_mut().zip(corners) {
            for (corner, [u, v]) in triangle.iter_mut().zip(places) {
                let (place, vertex) = ([*u, 1.0 - v], *corner);
                let has = |v: u32| placed[v as usize].is_none_or(|known| known == place);
                let copies = layout.copies.get(&vertex).map_or(&[][..], Vec::as_slice);
                let mut all = std::iter::once(vertex).chain(copies.iter().copied());
                *corner = all.find(|v| has(*v)).unwrap_or(placed.len() as u32);
                match placed.get_mut(*corner as usize) {
                    Some(known) => *known = Some(place),
                    None => {
                        placed.push(Some(place));
                        layout.sources.push(vertex);
                        layout.copies.entry(vertex).or_default().push(*corner);
                    }
                }
            }
        }
        let places = placed.into_iter().map(Option::unwrap_or_default);
        layout.coordinates = Some(places.collect());
        layout
    }

    /// Values of the mesh vertices, repeated for the copies.
    pub fn spread(&self, of_mesh: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let of = |v: &u32| of_mesh[*v as usize];
        self.sources.iter().map(of).collect()
    }

    /// Displacements of mesh vertices, followed by those of their copies.
    pub fn moved(&self, of_mesh: &[(u32, [f32; 3])]) -> Vec<(u32, [f32; 3])> {
        let copies = of_mesh.iter().flat_map(|(v, d)| {
            let copies = self.copies.get(v).map_or(&[][..], Vec::as_slice);
            copies.iter().map(move |copy| (*copy, *d))
        });
        let mut copies: Vec<_> = copies.collect();
        copies.sort_by_key(|(v, _)| *v);
        of_mesh.iter().copied().chain(copies).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vertex_on_a_seam_stands_twice_and_moves_alike() {
        let corner = |x: f32, y: f32| [x, y, 0.0];
        let positions = vec![
            corner(0.0, 0.0),
            corner(1.0, 0.0),
            corner(1.0, 1.0),
            corner(0.0, 1.0),
        ];
        let mesh = Mesh {
            positions,
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        let (a, b) = (
            [[0.0, 0.0], [0.5, 0.0], [0.5, 1.0]],
            [[0.0, 0.0], [0.75, 1.0], [1.0, 1.0]],
        );
        let layout = Layout::new(&mesh, Some(&[a, b]));
        assert_eq!(layout.sources, [0, 1, 2, 3, 2]);
        assert_eq!(layout.triangles, [[0, 1, 2], [0, 4, 3]]);
        let expected = [[0.0, 1.0], [0.5, 1.0], [0.5, 0.0], [1.0, 0.0], [0.75, 0.0]];
        assert_eq!(layout.coordinates.as_deref(), Some(&expected[..]));
        let moved = layout.moved(&[(2, [1.0; 3]), (3, [2.0; 3])]);
        assert_eq!(moved, [(2, [1.0; 3]), (3, [2.0; 3]), (4, [1.0; 3])]);
    }
}
