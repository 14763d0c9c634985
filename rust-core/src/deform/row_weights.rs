//! Weights of the rows on which a mesh is solved, and how they pass to its vertices.

use ndarray::Array2;

use super::static_weights::Correction;
use crate::{
    deform::{LandmarkWeights, PlateWeights},
    face::proxy::Prolongation,
    mesh::{Similarity, ibug::LANDMARKS},
};

const COORDINATES: usize = 3 * LANDMARKS;
/// If a mesh has more than this many vertices for each row, its weights stay on the rows.
const MANY: usize = 2;

/// Everything that moves the rows of a skin, in the canonical frame.
pub(super) struct RowWeights {
    /// `[R, 68]`.
    mix: Array2<f32>,
    /// `[R, 3 · rank]`, axis by axis.
    cross: Array2<f32>,
    /// `[rank, 204]`.
    motion: Array2<f32>,
}

impl RowWeights {
    /// `plate`: the training-free weights. `strength`: of the learned part.
    pub(super) fn new(
        rows: usize,
        plate: &PlateWeights,
        correction: Option<&Correction>,
        strength: f32,
    ) -> RowWeights {
        let mut mix = Array2::zeros((rows, LANDMARKS));
        let weights = mix.as_slice_mut().expect("a new array is row-major");
        weights.copy_from_slice(&plate.weights);
        let Some(correction) = correction else {
            let (cross, motion) = (Array2::zeros((rows, 0)), Array2::zeros((0, COORDINATES)));
            return RowWeights { mix, cross, motion };
        };
        mix.scaled_add(strength, &correction.mix);
        RowWeights {
            mix,
            cross: strength * &correction.cross,
            motion: correction.motion.clone(),
        }
    }

    /// Converts canonical weights to the mesh's own axes: `C R` and `Rᵀ B`. The scale cancels.
    pub(super) fn turn(&mut self, to_canonical: &Similarity) {
        let r = to_canonical.rotation.map(|row| row.map(|x| x as f32));
        let rank = self.motion.nrows();
        for mut row in self.motion.rows_mut() {
            for c in (0..COORDINATES).step_by(3) {
                let old = [row[c], row[c + 1], row[c + 2]];
                for j in 0..3 {
                    row[c + j] = (0..3).map(|i| old[i] * r[i][j]).sum();
                }
            }
        }
        for mut row in self.cross.rows_mut() {
            for k in 0..rank {
                let old = [row[k], row[rank + k], row[2 * rank + k]];
                for j in 0..3 {
                    row[j * rank + k] = (0..3).map(|i| old[i] * r[i][j]).sum();
                }
            }
        }
    }

    /// Passes the weights of the rows to the vertices that follow them. `follows`: `[V, R]`. On a
    /// mesh with few vertices each gets weights of its own. On a mesh with many the weights stay on
    /// the rows.
    pub(super) fn spread(self, follows: Prolongation) -> LandmarkWeights {
        let of_rows = LandmarkWeights {
            mix: self.mix,
            cross: self.cross,
            motion: self.motion,
            follows: Some(follows),
        };
        if of_rows.vertices() > MANY * of_rows.mix.nrows() {
            of_rows
        } else {
            of_rows.with_row_per_vertex()
        }
    }
}
