//! Networks that a point enters twice and a code up to three times.
//!
//! Twin of `training/systems/facetalk/network.py`. The contribution of a code is the same for all
//! points of a head (or a frame). So it is computed once, as rows to add and as a part of the last
//! matrix.

pub(super) mod slopes;

use std::f32::consts::PI;

use ndarray::{Array2, ArrayView1};

use crate::{
    Result,
    models::Weights,
    nn::{
        elementwise::{add_to_rows, silu_all},
        linear::Linear,
        matrix,
        panels::{Finish, Panels, Start},
    },
};

/// A point and its sines and cosines in some octaves: `[3 + 6 · octaves]` for each point of `[Q, 3]`.
pub(super) fn encode(points: &[[f32; 3]], octaves: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(points.len() * encoded(octaves));
    for point in points {
        out.extend(point);
        for octave in 0..octaves {
            let both = point.map(|x| ((1 << octave) as f32 * PI * x).sin_cos());
            out.extend(both.map(|(sin, _)| sin));
            out.extend(both.map(|(_, cos)| cos));
        }
    }
    out
}

/// Length of one encoded point.
pub(super) fn encoded(octaves: usize) -> usize {
    3 + 6 * octaves
}

/// A linear layer whose matrix is packed.
struct Layer {
    panels: Panels,
    bias: Vec<f32>,
}

impl Layer {
    fn load(weights: &Weights, inputs: usize, outputs: usize) -> Result<Self> {
        let linear = Linear::load(weights, inputs, outputs)?;
        Ok(Layer {
            panels: Panels::new(linear.weight()),
            bias: linear.bias().to_vec(),
        })
    }
}

/// Sizes of a [`Network`].
#[derive(Clone, Copy)]
pub(super) struct Shape<'a> {
    pub inputs: usize,
    pub code: usize,
    pub width: usize,
    pub layers: usize,
    pub outputs: usize,
    /// Layers that the code joins.
    pub code_layers: &'a [usize],
}

/// Hidden layers that take a point and a code. The point enters again at the middle layer.
pub(super) struct Network {
    point: [Layer; 2],
    code: Vec<(usize, Array2<f32>)>,
    hidden: Vec<Layer>,
    out: Array2<f32>,
    out_bias: Vec<f32>,
    out_code: Array2<f32>,
}

/// A network for one code, whose contribution is already computed.
pub(super) struct Prepared<'a> {
    network: &'a Network,
    /// The row that is added before each activation.
    rows: Vec<Vec<f32>>,
    out: Layer,
}

impl Network {
    pub fn load(weights: &Weights, shape: Shape<'_>) -> Result<Self> {
        let Shape {
            inputs,
            code,
            width,
            layers,
            outputs,
            code_layers,
        } = shape;
        let point = |n: usize| Layer::load(&weights.pp("point").pp(n), inputs, width);
        let hidden = |n: usize| Layer::load(&weights.pp("hidden").pp(n), width, width);
        let codes = code_layers.iter().enumerate().map(|(n, layer)| {
            let matrix = weights.pp("code").pp(n).matrix("weight", width, code)?;
            Ok((*layer, matrix))
        });
        let out = weights.pp("out");
        Ok(Network {
            point: [point(0)?, point(1)?],
            code: codes.collect::<Result<_>>()?,
            hidden: (0..layers - 1).map(hidden).collect::<Result<_>>()?,
            out: out.matrix("weight", outputs, width)?,
            out_bias: out.values("bias", &[outputs])?,
            out_code: weights
                .pp("out_code")
                .matrix("weight", outputs * (width + 1), code)?,
        })
    }

    /// Computes the contribution of `code`, `[C]`.
    pub fn prepare(&self, code: ArrayView1<'_, f32>) -> Prepared<'_> {
        let biases = std::iter::once(&self.point[0]).chain(&self.hidden);
        let mut rows: Vec<Vec<f32>> = biases.map(|layer| layer.bias.clone()).collect();
        let mut add = |layer: usize, row: &[f32]| {
            rows[layer].iter_mut().zip(row).for_each(|(to, x)| *to += x);
        };
        add(self.again(), &self.point[1].bias);
        for (layer, matrix) in &self.code {
            add(*layer, &matrix.dot(&code).to_vec());
        }
        let (outputs, width) = self.out.dim();
        let from_code = self.out_code.dot(&code);
        let from_code = from_code.as_slice().expect("a new vector is contiguous");
        let mut weight = Array2::zeros((width, outputs));
        let mut bias = self.out_bias.clone();
        for (n, added) in from_code.chunks_exact(width + 1).enumerate() {
            for k in 0..width {
                weight[[k, n]] = self.out[[n, k]] + added[k];
            }
            bias[n] += added[width];
        }
        Prepared {
            network: self,
            rows,
            out: Layer {
                panels: Panels::new(matrix::view(&weight)),
                bias,
            },
        }
    }

    fn again(&self) -> usize {
        self.hidden.len().div_ceil(2)
    }
}

impl Prepared<'_> {
    /// Inputs `[Q, inputs]` → `[Q, outputs]`.
    pub fn forward(&self, x: &[f32], points: usize) -> Vec<f32> {
        self.finish(self.trunk(x, points), points)
    }

    /// The output of the last hidden layer before its row and activation, `[Q, width]`. It does not
    /// depend on a code that joins only at that layer.
    pub fn trunk(&self, x: &[f32], points: usize) -> Vec<f32> {
        let Network { point, hidden, .. } = self.network;
        let width = self.rows[0].len();
        let mut h = vec![0.0; points * width];
        let mut next = vec![0.0; points * width];
        let start = Start::Row(&self.rows[0]);
        point[0].panels.multiply(x, start, Finish::Plain, &mut h);
        for (number, layer) in hidden.iter().enumerate().map(|(n, layer)| (n + 1, layer)) {
            silu_all(&mut h);
            let start = if number == hidden.len() {
                Start::Zero
            } else {
                Start::Row(&self.rows[number])
            };
            layer.panels.multiply(&h, start, Finish::Plain, &mut next);
            if number == self.network.again() {
                let panels = &point[1].panels;
                panels.multiply(x, Start::Output, Finish::Plain, &mut next);
            }
            std::mem::swap(&mut h, &mut next);
        }
        h
    }

    /// The outputs `[Q, outputs]` from the result of [`Prepared::trunk`], which may come from
    /// another code.
    pub fn finish(&self, mut trunk: Vec<f32>, points: usize) -> Vec<f32> {
        add_to_rows(&mut trunk, &self.rows[self.network.hidden.len()]);
        silu_all(&mut trunk);
        let mut out = vec![0.0; points * self.out.bias.len()];
        let start = Start::Row(&self.out.bias);
        self.out
            .panels
            .multiply(&trunk, start, Finish::Plain, &mut out);
        out
    }
}

/// The signed distance from the mean head in its canonical pose, in units of the field.
pub(super) struct Template {
    layers: Vec<Layer>,
}

impl Template {
    pub fn load(weights: &Weights, octaves: usize, width: usize, layers: usize) -> Result<Self> {
        let layer = |n: usize| {
            let inputs = if n == 0 { encoded(octaves) } else { width };
            let outputs = if n == layers { 1 } else { width };
            Layer::load(&weights.pp("layers").pp(n), inputs, outputs)
        };
        Ok(Template {
            layers: (0..=layers).map(layer).collect::<Result<_>>()?,
        })
    }

    /// Encoded places on the mean head `[Q, 3 + 6 · octaves]` → distances `[Q]`.
    pub fn forward(&self, x: &[f32], points: usize) -> Vec<f32> {
        let mut h = x.to_vec();
        for (number, layer) in self.layers.iter().enumerate() {
            let mut next = vec![0.0; points * layer.bias.len()];
            let start = Start::Row(&layer.bias);
            layer.panels.multiply(&h, start, Finish::Plain, &mut next);
            if number + 1 < self.layers.len() {
                silu_all(&mut next);
            }
            h = next;
        }
        h
    }
}
