//! Motion as weights of ARKit's shapes: an artist's controls over it, and lips that meet.

mod apply_controls;
mod closing;
mod reach;
mod shapes;
mod teeth;
mod variety;

use std::borrow::Cow;

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis};

use super::{FaceModes, LandmarkClip, WeightClip, shape_fit::ShapeFit};
use crate::{Result, rig::ARKIT};

pub use apply_controls::WeightCues;
pub use closing::LipGaps;
pub use shapes::MouthLengths;
pub use teeth::LowerLip;

/// The shape of ARKit's for which the mean face has no motion.
const TONGUE: &str = "tongueOut";

impl WeightClip {
    /// The column with the weights of a shape, or `None` if the clip has no shape of this name.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }

    /// Some frames of the clip, including how far the lips have to come together in them.
    #[must_use]
    pub fn rows(&self, frames: &[usize]) -> WeightClip {
        let known = frames.iter().filter(|_| !self.together.is_empty());
        WeightClip {
            names: self.names.clone(),
            weights: self.weights.select(Axis(0), frames),
            fps: self.fps,
            together: known.map(|&t| self.together[t]).collect(),
        }
    }

    /// The clip with only the weights of ARKit's shapes.
    pub(crate) fn of_arkit(&self) -> Cow<'_, WeightClip> {
        let known = columns(&self.names, |name| ARKIT.contains(&name));
        if known.len() == self.names.len() {
            return Cow::Borrowed(self);
        }
        Cow::Owned(WeightClip {
            names: known.iter().map(|&s| self.names[s].clone()).collect(),
            weights: self.weights.select(Axis(1), &known),
            fps: self.fps,
            together: self.together.clone(),
        })
    }

    /// Adds motion `[T, 68, 3]` of the mean face's landmarks, canonical metres, as far as weights from 0 to 1 can
    /// show it.
    ///
    /// # Errors
    /// `Weights` for a name that is none of ARKit's.
    pub(crate) fn add_landmarks(
        &mut self,
        added: ArrayView3<'_, f32>,
        modes: &FaceModes,
    ) -> Result<()> {
        let shapes = modes.of_shapes(&self.names)?;
        let plain = self.landmarks(modes)?.displacements;
        let moved = &plain + &added;
        // Landmarks leave weights open. Fits with and without the motion differ by what the motion needs.
        let fit = || ShapeFit::new(&shapes, vec![None; self.names.len()]);
        let (mut before, mut after) = (fit(), fit());
        for (t, mut weights) in self.weights.outer_iter_mut().enumerate() {
            let (plain, moved) = (plain.index_axis(Axis(0), t), moved.index_axis(Axis(0), t));
            let frame = |face: ArrayView2<'_, f32>| face.iter().copied().collect::<Vec<f32>>();
            let (before, after) = (before.next(&frame(plain)), after.next(&frame(moved)));
            for (weight, (from, to)) in weights.iter_mut().zip(before.iter().zip(after)) {
                *weight = (*weight + (to - from) as f32).clamp(0.0, weight.max(1.0));
            }
        }
        Ok(())
    }

    /// The motion of the mean face's landmarks under these weights.
    ///
    /// # Errors
    /// `Weights` for a name that is none of ARKit's.
    pub fn landmarks(&self, modes: &FaceModes) -> Result<LandmarkClip> {
        let shapes = modes.of_shapes(&self.names)?;
        let (count, landmarks, axes) = shapes.dim();
        let flat = shapes.into_shape_with_order((count, landmarks * axes));
        let moved = self.weights.dot(&flat.expect("row-major array"));
        let shape = (self.weights.nrows(), landmarks, axes);
        let displacements = moved.into_shape_with_order(shape);
        Ok(LandmarkClip {
            displacements: displacements.expect("row-major array"),
            fps: self.fps,
        })
    }
}

impl FaceModes {
    /// Displacement of the landmarks at weight 1 of each of ARKit's shapes, `[S, 68, 3]`, canonical metres.
    ///
    /// ARKit writes `Left` and `Right` where the modes have `_L` and `_R`. For some pairs of modes
    /// it has one shape for both sides.
    ///
    /// # Errors
    /// `Weights` for a name that is none of ARKit's.
    pub fn of_shapes(&self, names: &[String]) -> Result<Array3<f32>> {
        let mut out = Array3::zeros((names.len(), crate::mesh::ibug::LANDMARKS, 3));
        for (name, mut shape) in names.iter().zip(out.outer_iter_mut()) {
            if name != TONGUE {
                shape.assign(&self.of_shape(name)?);
            }
        }
        Ok(out)
    }

    pub(super) fn of_shape(&self, name: &str) -> Result<Array2<f32>> {
        let sided = |stem: &str, side: &str| self.mode(&format!("{stem}{side}"));
        if let Ok(mode) = self.mode(name) {
            return Ok(mode.to_owned());
        }
        for (ending, side) in [("Left", "_L"), ("Right", "_R")] {
            if let Some(Ok(mode)) = name.strip_suffix(ending).map(|stem| sided(stem, side)) {
                return Ok(mode.to_owned());
            }
        }
        Ok(&sided(name, "_L")? + &sided(name, "_R")?)
    }
}

/// Indices of the columns whose names are chosen.
fn columns(names: &[String], is_chosen: impl Fn(&str) -> bool) -> Vec<usize> {
    let chosen = names.iter().enumerate().filter(|(_, name)| is_chosen(name));
    chosen.map(|(column, _)| column).collect()
}

fn starts(name: &str, stems: &[&str]) -> bool {
    stems.iter().any(|stem| name.starts_with(stem))
}

/// Multiplies some columns by a factor of its own for each frame.
fn scale(weights: &mut Array2<f32>, columns: &[usize], factor: impl Fn(usize) -> f32) {
    for (t, mut row) in weights.axis_iter_mut(Axis(0)).enumerate() {
        let factor = factor(t);
        for &column in columns {
            row[column] *= factor;
        }
    }
}
