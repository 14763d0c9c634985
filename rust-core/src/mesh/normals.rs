//! Normals, areas and the bounding box.

use super::{
    Mesh,
    vec3::{cross, dot, sub},
};

impl Mesh {
    /// Position of vertex `v` in double precision.
    pub(crate) fn point(&self, v: u32) -> [f64; 3] {
        self.positions[v as usize].map(f64::from)
    }

    /// Twice the area times the unit normal of each face. Returns `[F]`, mesh units squared.
    pub(crate) fn face_area_vectors(&self) -> Vec<[f64; 3]> {
        let vector = |&[a, b, c]: &[u32; 3]| {
            let origin = self.point(a);
            cross(sub(self.point(b), origin), sub(self.point(c), origin))
        };
        self.triangles.iter().map(vector).collect()
    }

    /// Area of each face. Returns `[F]`, mesh units squared.
    pub fn face_areas(&self) -> Vec<f64> {
        let vectors = self.face_area_vectors();
        vectors.iter().map(|&n| 0.5 * dot(n, n).sqrt()).collect()
    }

    /// Area-weighted unit normal of each vertex. Returns `[V, 3]`; zero where a vertex has no
    /// face, or faces that cancel.
    pub fn vertex_normals(&self) -> Vec<[f32; 3]> {
        let mut sums = vec![[0f64; 3]; self.positions.len()];
        for (t, n) in self.triangles.iter().zip(self.face_area_vectors()) {
            for &v in t {
                for axis in 0..3 {
                    sums[v as usize][axis] += n[axis];
                }
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
            let d = sub(high.map(f64::from), low.map(f64::from));
            dot(d, d).sqrt()
        })
    }
}

fn unit_or_zero(v: [f64; 3]) -> [f32; 3] {
    let length = dot(v, v).sqrt();
    if length > 0.0 {
        v.map(|x| (x / length) as f32)
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
