//! A clip as morph targets: sparse shapes, each with a weight from 0 to 1 in every frame.
//!
//! Files of scenes hold no vertex positions over time, or hold them so that few programs read them; all read shapes and
//! weights. Many programs cut weights below 0 off, so a component that goes both ways becomes two shapes.

use ndarray::{Array2, ArrayView2, Axis};

use crate::{
    Result,
    deform::{VertexClip, compression::compress},
    job::SILENT,
    mesh::{canonical_landmarks, ibug::LANDMARKS},
};

/// Every vertex comes this near to its place in every frame, metres on a head of human size.
const MAX_ERROR_M: f32 = 8e-6;
/// A shape holds a vertex that it moves by more than this.
const LEAST_M: f32 = 2e-8;
/// Outer corners of the eyes.
const EYES: (usize, usize) = (36, 45);

/// One shape.
pub(super) struct Target {
    pub name: String,
    /// Vertices with their displacements at weight 1, mesh units, in the order of their numbers.
    pub moved: Vec<(u32, [f32; 3])>,
}

/// A clip as shapes and weights.
pub(super) struct Targets {
    pub shapes: Vec<Target>,
    /// `[T, N]`, within 0 to 1.
    pub weights: Array2<f32>,
    /// Frames per second.
    pub fps: f64,
}

impl Targets {
    /// Of a clip on a mesh with these landmarks at rest.
    ///
    /// # Errors
    /// Those of [`compress`].
    pub(super) fn new(clip: &VertexClip, landmarks: &[[f32; 3]; LANDMARKS]) -> Result<Targets> {
        let units_per_metre = eye_span(landmarks) / eye_span(canonical_landmarks());
        let frames = clip.displacements.dim().0;
        let basis = compress(clip, MAX_ERROR_M * units_per_metre, frames.max(1), SILENT)?;
        let mut shapes = Vec::new();
        let mut columns = Vec::new();
        let components = basis.shapes.outer_iter().zip(basis.weights.columns());
        for (k, (shape, weights)) in components.enumerate() {
            for (sign, side) in [(1.0, ""), (-1.0, " back")] {
                let most = weights.iter().map(|w| sign * w).fold(0.0, f32::max);
                if most > 0.0 {
                    columns.push(weights.mapv(|w| (sign * w).max(0.0) / most));
                    shapes.push(Target {
                        name: format!("Anyface {}{side}", k + 1),
                        moved: sparse(shape, sign * most, LEAST_M * units_per_metre),
                    });
                }
            }
        }
        let mut weights = Array2::zeros((frames, columns.len()));
        for (mut to, from) in weights.axis_iter_mut(Axis(1)).zip(&columns) {
            to.assign(from);
        }
        Ok(Targets {
            shapes,
            weights,
            fps: clip.fps,
        })
    }
}

/// What a shape `[V, 3]` times a scale moves by more than `least`.
fn sparse(shape: ArrayView2<'_, f32>, scale: f32, least: f32) -> Vec<(u32, [f32; 3])> {
    let rows = shape.outer_iter().enumerate();
    let moved = rows.map(|(v, row)| (v as u32, [0, 1, 2].map(|i| scale * row[i])));
    moved
        .filter(|(_, moved)| moved.iter().any(|x| x.abs() > least))
        .collect()
}

fn eye_span(landmarks: &[[f32; 3]; LANDMARKS]) -> f32 {
    let [a, b] = [EYES.0, EYES.1].map(|n| glam::Vec3::from(landmarks[n]));
    a.distance(b)
}
