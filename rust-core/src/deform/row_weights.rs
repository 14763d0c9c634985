//! Weights of the rows on which a mesh is solved, and how vertices take them up.

use ndarray::Array2;
use rayon::prelude::*;

use super::static_weights::Correction;
use crate::{
    deform::{LandmarkWeights, PlateWeights},
    ibug::LANDMARKS,
    mesh::Similarity,
};

const COORDINATES: usize = 3 * LANDMARKS;

/// Everything that moves the rows of a skin, canonical frame.
pub(super) struct RowWeights {
    /// `[R, 68]`.
    mix: Array2<f32>,
    /// `[R, 3 · rank]`, axis by axis.
    cross: Array2<f32>,
    /// `[rank, 204]`.
    motion: Array2<f32>,
}

impl RowWeights {
    /// `plate`: the training-free weights, where the skin follows them. `strength`: of the
    /// learned part.
    pub(super) fn new(
        rows: usize,
        plate: Option<&PlateWeights>,
        correction: Option<&Correction>,
        strength: f32,
    ) -> RowWeights {
        let mut mix = Array2::zeros((rows, LANDMARKS));
        if let Some(plate) = plate {
            let weights = mix.as_slice_mut().expect("a new array is row-major");
            weights.copy_from_slice(&plate.weights);
        }
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

    /// Adds one row's share to a vertex that follows it.
    pub(super) fn add(&self, row: usize, share: f32, mix: &mut [f32], cross: &mut [f32]) {
        // Slices, since ndarray's own way takes half of all the time here.
        for (to, from) in [(mix, &self.mix), (cross, &self.cross)] {
            let from = from.row(row);
            let from = from.as_slice().expect("row-major");
            to.iter_mut()
                .zip(from)
                .for_each(|(to, from)| *to += share * from);
        }
    }

    /// Turns canonical weights into weights of the mesh's own axes: `C R` and `Rᵀ B`. Scale cancels.
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

    /// Weights of `vertices` vertices; `fill` writes those of one.
    pub(super) fn spread(
        self,
        vertices: usize,
        fill: impl Fn(&Self, usize, &mut [f32], &mut [f32]) + Sync,
    ) -> LandmarkWeights {
        let mut mix = Array2::zeros((vertices, LANDMARKS));
        let mut cross = Array2::zeros((vertices, self.cross.ncols()));
        mix.outer_iter_mut()
            .into_par_iter()
            .zip(cross.outer_iter_mut().into_par_iter())
            .enumerate()
            .for_each(|(v, (mut mix, mut cross))| {
                let (mix, cross) = (mix.as_slice_mut(), cross.as_slice_mut());
                fill(&self, v, mix.expect("row-major"), cross.expect("row-major"));
            });
        LandmarkWeights {
            mix,
            cross,
            motion: self.motion,
        }
    }
}
