//! The similarity from a user's mesh to the canonical face frame.

use ndarray::{Array3, ArrayView3};

/// `y = scale · rotation · x + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// Uniform, positive.
    pub scale: f64,
    /// Row-major rotation, determinant +1.
    pub rotation: [[f64; 3]; 3],
    /// In the target's units.
    pub translation: [f64; 3],
}

impl Similarity {
    /// Moves a point from the mesh's frame to the target frame.
    pub fn apply(&self, point: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|i| {
            let turned: f64 = (0..3)
                .map(|j| self.rotation[i][j] * f64::from(point[j]))
                .sum();
            (self.scale * turned + self.translation[i]) as f32
        })
    }

    /// Brings displacements in the target frame back to the mesh's own units and axes.
    ///
    /// `displacements`: `[T, N, 3]`, target units. Returns `[T, N, 3]`, mesh units.
    pub fn displacements_to_mesh(&self, displacements: ArrayView3<'_, f32>) -> Array3<f32> {
        let mut out = Array3::zeros(displacements.dim());
        for (from, mut to) in displacements.rows().into_iter().zip(out.rows_mut()) {
            for i in 0..3 {
                let turned: f64 = (0..3)
                    .map(|j| self.rotation[j][i] * f64::from(from[j]))
                    .sum();
                to[i] = (turned / self.scale) as f32;
            }
        }
        out
    }
}
