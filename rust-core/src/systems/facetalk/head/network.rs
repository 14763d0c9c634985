//! Layers that a point enters twice, with a code that is the same for all points of a head.

use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis};

use crate::{
    Result,
    nn::{Weights, linear::Linear},
};

/// Sizes of a [`Network`].
#[derive(Clone, Copy)]
pub(super) struct Shape {
    pub code: usize,
    pub width: usize,
    pub layers: usize,
    pub outputs: usize,
}

/// Point and code → hidden layers; both join again at the layer in the middle.
pub(super) struct Network {
    point: [Linear; 2],
    code: [Array2<f32>; 2],
    hidden: Vec<Linear>,
    out: Linear,
}

/// A network for one head: what its code adds is known.
pub(super) struct Prepared<'a> {
    network: &'a Network,
    added: [Array1<f32>; 2],
}

impl Network {
    pub fn load(weights: &Weights, shape: Shape) -> Result<Self> {
        let Shape {
            code,
            width,
            layers,
            outputs,
        } = shape;
        let point = |n: usize| Linear::load(&weights.pp("point").pp(n), 3, width);
        let codes = |n: usize| weights.pp("code").pp(n).matrix("weight", width, code);
        let hidden = (0..layers - 1)
            .map(|n| Linear::load(&weights.pp("hidden").pp(n), width, width))
            .collect::<Result<_>>()?;
        Ok(Network {
            point: [point(0)?, point(1)?],
            code: [codes(0)?, codes(1)?],
            hidden,
            out: Linear::load(&weights.pp("out"), width, outputs)?,
        })
    }

    pub fn prepare(&self, code: ArrayView1<'_, f32>) -> Prepared<'_> {
        Prepared {
            network: self,
            added: [self.code[0].dot(&code), self.code[1].dot(&code)],
        }
    }
}

impl Prepared<'_> {
    /// Points `[Q, 3]` → `[Q, outputs]`, with `activation` after every hidden layer.
    pub fn forward(&self, x: ArrayView2<'_, f32>, activation: impl Fn(f32) -> f32) -> Array2<f32> {
        let Network {
            point, hidden, out, ..
        } = self.network;
        let x = x.as_standard_layout();
        let add = |h: &mut Array2<f32>, row: &Array1<f32>| {
            for mut at in h.axis_iter_mut(Axis(0)) {
                at += row;
            }
        };
        let mut h = point[0].forward(&x);
        add(&mut h, &self.added[0]);
        h.mapv_inplace(&activation);
        // PyTorch's twin counts the first layer too.
        let layers = hidden.len() + 1;
        let again = layers / 2;
        for (number, layer) in hidden.iter().enumerate() {
            h = layer.forward(&h);
            if number + 1 == again {
                h += &point[1].forward(&x);
                add(&mut h, &self.added[1]);
            }
            h.mapv_inplace(&activation);
        }
        out.forward(&h)
    }
}
