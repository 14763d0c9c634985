//! Landmarks of the mean face, and how ARKit's shapes move them.

use anyface::{
    Result,
    mesh::ibug::LANDMARKS,
    motion::{FaceModes, Motion, WeightClip},
    rig::ARKIT,
};
use ndarray::Array2;

/// How many numbers a frame of landmarks has.
pub(crate) const LANDMARK_NUMBERS: usize = 3 * LANDMARKS;
/// Displacements of landmarks on the mean face, metres.
pub(crate) type Landmarks = [f32; LANDMARK_NUMBERS];
/// Weights of ARKit's shapes.
pub(crate) type Weights = [f32; ARKIT.len()];

/// How far each of ARKit's shapes moves the landmarks at weight 1.
pub(crate) struct Shapes(Vec<Landmarks>);

impl Shapes {
    pub fn open() -> Result<Shapes> {
        let each = Motion::Weights(WeightClip {
            names: ARKIT.map(str::to_owned).to_vec(),
            weights: Array2::eye(ARKIT.len()),
            fps: 1.0,
            together: Vec::new(),
        });
        let moved = each.on_mean_face(&FaceModes::open(None)?)?.displacements;
        let numbers: Vec<f32> = moved.iter().copied().collect();
        let (shapes, _) = numbers.as_chunks();
        Ok(Shapes(shapes.to_vec()))
    }

    /// Adds the motion of the shapes at these weights to the landmarks.
    pub fn add(&self, weights: &Weights, to: &mut Landmarks) {
        let shapes = weights.iter().zip(&self.0);
        for (weight, shape) in shapes.filter(|(weight, _)| **weight != 0.0) {
            to.iter_mut()
                .zip(shape)
                .for_each(|(to, by)| *to += weight * by);
        }
    }
}
