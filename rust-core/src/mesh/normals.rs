//! Normals, areas and the bounding box.

use glam::{DVec3, Vec3};

use super::Mesh;

impl Mesh {
    /// Position of vertex `v` in double precision.
    pub fn point(&self, v: u32) -> DVec3 {
        Vec3::from(self.positions[v as usize]).as_dvec3()
    }

    /// Twice the area times the unit normal of each face. Returns `[F]`, mesh units squared.
    pub(crate) fn face_area_vectors(&self) -> Vec<DVec3> {
        let vector = |&[a, b, c]: &[u32; 3]| {
            let origin = self.point(a);
            (self.point(b) - origin).cross(self.point(c) - origin)
        };
        self.triangles.iter().map(vector).collect()
    }

    /// Area of each face. Returns `[F]`, mesh units squared.
    pub fn face_areas(&self) -> Vec<f64> {
        let vectors = self.face_area_vectors();
        vectors.iter().map(|&n| 0.5 * n.length()).collect()
    }

    /// Area-weighted unit normal of each vertex. Returns `[V, 3]`; zero for a vertex that has no
    /// face or whose faces cancel out.
    pub fn vertex_normals(&self) -> Vec<[f32; 3]> {
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        for (t, n) in self.triangles.iter().zip(self.face_area_vectors()) {
            for &v in t {
                sums[v as usize] += n;
            }
        }
        sums.into_iter().map(unit_or_zero).collect()
    }

    /// Smallest and largest coordinate on each axis; `None` without vertices.
    pub fn bounding_box(&self) -> Option<([f32; 3], [f32; 3])> {
        let first = *self.positions.first()?;
        let fold = |(low, high): ([f32; 3], [f32; 3]), p: &[f32; 3]| {
            let axes = [0, 1, 2];
            (
                axes.map(|i| low[i].min(p[i])),
                axes.map(|i| high[i].max(p[i])),
            )
        };
        Some(self.positions.iter().fold((first, first), fold))
    }

    /// Length of the bounding box's diagonal; zero without vertices.
    pub fn diagonal(&self) -> f64 {
        self.bounding_box().map_or(0.0, |(low, high)| {
            let [low, high] = [low, high].map(|p| Vec3::from(p).as_dvec3());
            high.distance(low)
        })
    }
}

fn unit_or_zero(v: DVec3) -> [f32; 3] {
    let length = v.length();
    if length > 0.0 {
        (v / length).as_vec3().into()
    } else {
        [0.0; 3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_big_face_outweighs_a_small_one() {
        let mesh = Mesh {
            positions: vec![
                [0.0; 3],
                [3.0, 0.0, 0.0],
                [0.0, 3.0, 0.0],
                [0.0, 0.0, 1.0],
                [9.0; 3],
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        assert_eq!(mesh.face_areas(), [4.5, 1.5]);
        let n = mesh.vertex_normals();
        assert_eq!(n[1], [0.0, 0.0, 1.0]);
        assert!(
            (n[0][2] - 9.0 / 90f32.sqrt()).abs() < 1e-6
                && (n[0][0] - 3.0 / 90f32.sqrt()).abs() < 1e-6
        );
        assert_eq!(n[4], [0.0; 3]);
        assert_eq!(mesh.bounding_box(), Some(([0.0; 3], [9.0; 3])));
    }
}
