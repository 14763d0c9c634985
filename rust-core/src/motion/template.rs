//! A face whose vertices a system moves, and masks over its vertices.

use std::{ops::Range, sync::Arc};

use ndarray::{Array2, Axis};

use crate::mesh::{Mesh, ibug::LANDMARKS};

/// A face whose vertices a system moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Template {
    /// Canonical metres.
    pub mesh: Mesh,
    /// The vertex of each landmark.
    pub landmarks: [usize; LANDMARKS],
}

impl Template {
    /// The positions of the landmarks, canonical metres.
    pub fn landmark_positions(&self) -> [[f32; 3]; LANDMARKS] {
        self.landmarks.map(|v| self.mesh.positions[v])
    }
}

/// A share over time for each vertex of a template.
#[derive(Debug, Clone, PartialEq)]
pub struct TemplateMask {
    /// The template that the vertices belong to.
    pub template: Arc<Template>,
    /// `[T, V]`, 0 to 1.
    pub shares: Array2<f32>,
    /// Frames per second.
    pub fps: f64,
}

impl TemplateMask {
    /// The shares `[V, t]` at some frames of a motion at `fps`. Each comes from the nearest frame
    /// of the mask.
    pub fn at(&self, frames: Range<usize>, fps: f64) -> Array2<f32> {
        let last = self.shares.nrows().saturating_sub(1);
        let nearest = |t: usize| ((t as f64 * self.fps / fps).round() as usize).min(last);
        let rows: Vec<usize> = frames.map(nearest).collect();
        self.shares.select(Axis(0), &rows).reversed_axes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_at_another_rate_has_the_shares_of_the_nearest_frames() {
        let template = Template {
            mesh: Mesh {
                positions: vec![[0.0; 3]; 2],
                triangles: Vec::new(),
            },
            landmarks: [0; LANDMARKS],
        };
        let mask = TemplateMask {
            template: Arc::new(template),
            shares: Array2::from_shape_fn((3, 2), |(t, v)| 0.1 * t as f32 + 0.5 * v as f32),
            fps: 25.0,
        };
        let at = mask.at(1..6, 50.0);
        assert_eq!(at.dim(), (2, 5));
        assert_eq!(at.row(0).to_vec(), [0.1, 0.1, 0.2, 0.2, 0.2]);
        assert_eq!(at[[1, 0]], 0.6);
    }
}
