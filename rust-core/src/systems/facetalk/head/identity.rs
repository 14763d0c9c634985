//! The canonical field I(x; z_id): small networks at anchors, blended.
//!
//! NPHM (Giebenhain et al. 2023, §3.2); twin of `training/systems/facetalk/identity.py`. A point asks only the
//! networks whose blend weight is not zero.

use ndarray::{Array2, ArrayView2, s};

use super::{
    HeadConfig,
    network::{Network, Prepared, Shape},
};
use crate::{
    Result,
    nn::{
        Weights,
        elementwise::{relu_all, softmax},
        linear::Linear,
    },
};

/// The weights of the field and of the network that places its anchors.
pub(super) struct Identity {
    hidden: Linear,
    out: Linear,
    locals: Vec<Network>,
}

/// The field of one head.
pub(super) struct IdentityField<'a> {
    config: &'a HeadConfig,
    /// `[A]`, in units of the field.
    pub anchors: Vec<[f32; 3]>,
    locals: Vec<Prepared<'a>>,
}

impl Identity {
    pub fn load(weights: &Weights, config: &HeadConfig) -> Result<Self> {
        let networks = config.pairs.len() + config.middle.len() + 1;
        let shape = Shape {
            code: config.global_code + config.local_code,
            width: config.width,
            layers: config.layers,
            outputs: 1,
        };
        let locals = (0..networks)
            .map(|n| Network::load(&weights.pp("locals").pp(n), shape))
            .collect::<Result<_>>()?;
        let anchors = weights.pp("anchors");
        let (width, outputs) = (config.anchor_width, 3 * config.anchors());
        Ok(Identity {
            hidden: Linear::load(&anchors.pp("hidden"), config.global_code, width)?,
            out: Linear::load(&anchors.pp("out"), width, outputs)?,
            locals,
        })
    }

    /// The field of the head of `z` `[Z]`.
    pub fn of<'a>(&'a self, config: &'a HeadConfig, z: &[f32]) -> IdentityField<'a> {
        let (own, local) = z.split_at(config.global_code);
        let mut hidden = vec![0.0; config.anchor_width];
        self.hidden.forward_row(own, &mut hidden);
        relu_all(&mut hidden);
        let mut at = vec![0.0; 3 * config.anchors()];
        self.out.forward_row(&hidden, &mut at);
        let locals = local
            .chunks_exact(config.local_code)
            .enumerate()
            .map(|(number, local)| {
                let code: Vec<f32> = own.iter().chain(local).copied().collect();
                self.locals[network_of(config, number)].prepare(code.as_slice().into())
            })
            .collect();
        IdentityField {
            config,
            anchors: at.as_chunks::<3>().0.to_vec(),
            locals,
        }
    }
}

/// Which network an anchor asks: both of a pair ask the same, the background the last.
fn network_of(config: &HeadConfig, anchor: usize) -> usize {
    let pairs = config.pairs.len();
    match anchor < 2 * pairs {
        true => anchor / 2,
        false => anchor - pairs,
    }
}

impl IdentityField<'_> {
    /// Signed distance, negative inside, at points `[Q, 3]`; both in units of the field.
    pub fn at(&self, points: ArrayView2<'_, f32>) -> Vec<f32> {
        let mut total = vec![0.0; points.nrows()];
        let weights = self.blend(points);
        let background = self.anchors.len();
        for (number, local) in self.locals.iter().enumerate() {
            let rows: Vec<usize> = (0..points.nrows())
                .filter(|row| weights[[*row, number]] > 0.0)
                .collect();
            if rows.is_empty() {
                continue;
            }
            let mut frame = Array2::zeros((rows.len(), 3));
            for (to, row) in rows.iter().enumerate() {
                let x = points.row(*row);
                for axis in 0..3 {
                    frame[[to, axis]] = match number == background {
                        true => x[axis] / self.config.background.sqrt(),
                        false => (x[axis] - self.anchors[number][axis]) / self.config.sigma,
                    };
                }
            }
            if number < 2 * self.config.pairs.len() && number % 2 == 1 {
                frame.slice_mut(s![.., 0]).mapv_inplace(|x| -x);
            }
            let made = local.forward(frame.view(), |x| softplus(x, self.config.beta));
            for (row, made) in rows.iter().zip(made.column(0)) {
                total[*row] += weights[[*row, number]] * made;
            }
        }
        total
    }

    /// Weights of anchors and background, `[Q, A + 1]`; each row sums to 1.
    fn blend(&self, points: ArrayView2<'_, f32>) -> Array2<f32> {
        let sharpness = -0.5 / (self.config.sigma * self.config.sigma);
        let mut weights = Array2::zeros((points.nrows(), self.anchors.len() + 1));
        for (x, mut row) in points.outer_iter().zip(weights.outer_iter_mut()) {
            for (anchor, weight) in self.anchors.iter().zip(row.iter_mut()) {
                let squares: f32 = (0..3).map(|axis| (x[axis] - anchor[axis]).powi(2)).sum();
                *weight = sharpness * squares;
            }
            row[self.anchors.len()] = sharpness * self.config.background;
            let row = row.as_slice_mut().expect("rows are contiguous");
            softmax(row);
            for weight in row.iter_mut() {
                *weight = (*weight - self.config.least_weight).max(0.0);
            }
            let sum: f32 = row.iter().sum();
            for weight in row {
                *weight /= sum;
            }
        }
        weights
    }
}

/// `ln(1 + e^(βx)) / β`, linear where PyTorch's is.
fn softplus(x: f32, beta: f32) -> f32 {
    let scaled = x * beta;
    match scaled > 20.0 {
        true => x,
        false => scaled.exp().ln_1p() / beta,
    }
}
