//! One block of the network.

use ndarray::{Array1, Array2};
use rayon::prelude::*;

use crate::{
    Result,
    models::Weights,
    nn::{
        elementwise::{exp, vectorised},
        linear::Linear,
        matrix::{self, view},
        panels::{Finish, Panels, Start},
    },
};

/// The shortest diffusion time, as in the authors' code.
const LEAST_TIME: f32 = 1e-8;

/// `x + mlp(x, diffused x, gradient features)`.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// Diffusion times, `[C]`, in the surface's unit of area.
    pub(super) time: Array1<f32>,
    pub(super) rotation: Rotation,
    /// The MLP's first weight for the diffused input, `[C, C]`.
    pub(super) from_diffused: Panels,
    /// The MLP's first weight for the input.
    pub(super) from_x: Panels,
    /// The MLP's first weight for the gradient features.
    pub(super) from_features: Panels,
    pub(super) middle: Panels,
    pub(super) last: Panels,
    /// Biases of the MLP's three layers.
    pub(super) biases: [Vec<f32>; 3],
}

/// The matrix `A` that rotates the gradients, as three real matrices `[C, C]`.
#[derive(Debug, Clone)]
pub(super) struct Rotation {
    /// `Re Aᵀ`.
    pub(super) real: Panels,
    /// `(Im A − Re A)ᵀ`.
    pub(super) difference: Panels,
    /// `(Re A + Im A)ᵀ`.
    pub(super) sum: Panels,
}

impl Block {
    pub(super) fn load(weights: &Weights, width: usize) -> Result<Self> {
        let layer = |i: usize, inputs| {
            let name = format!("mlp.miniMLP_mlp_layer_{i:03}");
            Linear::load(&weights.pp(name), inputs, width)
        };
        let [first, middle, last] = [layer(0, 3 * width)?, layer(1, width)?, layer(2, width)?];
        let part = |index| Panels::new(first.weight().subrows(index * width, width));
        Ok(Block {
            time: weights.pp("diffusion").vector("diffusion_time", width)?,
            rotation: Rotation::load(&weights.pp("gradient_features"), width)?,
            from_x: part(0),
            from_diffused: part(1),
            from_features: part(2),
            middle: Panels::new(middle.weight()),
            last: Panels::new(last.weight()),
            biases: [&first, &middle, &last].map(|layer| layer.bias().to_vec()),
        })
    }

    /// Diffuses one field's spectrum `[K, C]` and prepares it for the pass over the vertices.
    pub(super) fn coefficients(
        &self,
        mut spectrum: Array2<f32>,
        evals: &Array1<f32>,
    ) -> Coefficients {
        vectorised(
            #[inline(always)]
            || {
                for (mut row, eval) in spectrum.rows_mut().into_iter().zip(evals) {
                    let row = row.as_slice_mut().expect("row-major array");
                    for (value, time) in row.iter_mut().zip(&self.time) {
                        *value *= exp(-eval * time.max(LEAST_TIME));
                    }
                }
            },
        );
        let factors = [
            &self.from_diffused,
            &self.rotation.real,
            &self.rotation.difference,
            &self.rotation.sum,
        ];
        let mut products: Vec<Panels> = factors
            .into_par_iter()
            .map(|factor| Panels::new(view(&times(&spectrum, factor))))
            .collect();
        let mut next = || products.pop().expect("four products");
        let (sum, difference, turned, mixed) = (next(), next(), next(), next());
        Coefficients {
            diffused: Panels::new(view(&spectrum)),
            mixed,
            turned,
            difference,
            sum,
        }
    }
}

impl Rotation {
    /// Reads `A_re` and `A_im`.
    pub(super) fn load(weights: &Weights, width: usize) -> Result<Self> {
        let a = |name: &str| weights.pp(name).matrix("weight", width, width);
        let (re, im) = (a("A_re")?, a("A_im")?);
        let packed = |a: &Array2<f32>| Panels::new(view(a).transpose());
        Ok(Rotation {
            difference: packed(&(&im - &re)),
            sum: packed(&(&re + &im)),
            real: packed(&re),
        })
    }
}

fn times(lhs: &Array2<f32>, rhs: &Panels) -> Array2<f32> {
    let mut out = Array2::zeros((lhs.nrows(), rhs.columns()));
    let target = out.as_slice_mut().expect("new array");
    rhs.multiply(matrix::values(lhs), Start::Zero, Finish::Plain, target);
    out
}

/// One diffused field `y` in the eigenbasis, and its products with the matrices that act on
/// channels, `[K, C]` each.
pub(super) struct Coefficients {
    /// `y`.
    pub(super) diffused: Panels,
    /// `y W_d`.
    pub(super) mixed: Panels,
    /// `y Re Aᵀ`.
    pub(super) turned: Panels,
    /// `y (Im A − Re A)ᵀ`.
    pub(super) difference: Panels,
    /// `y (Re A + Im A)ᵀ`.
    pub(super) sum: Panels,
}
