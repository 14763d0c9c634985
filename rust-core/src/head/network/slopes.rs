//! Slopes of a network's outputs with respect to its inputs and its code, by the chain rule, for
//! many points at once.

use std::f32::consts::PI;

use super::{Network, Prepared, Template};
use crate::nn::{
    elementwise::{silu_all, silu_slopes},
    matrix,
    panels::{Finish, Panels, Start},
};

/// A network's matrices, packed for the backward pass.
pub(in crate::head) struct NetworkSlopes {
    point: [Panels; 2],
    hidden: Vec<Panels>,
    code: Vec<(usize, Panels)>,
    out_code: Panels,
    codes: usize,
}

/// The values of a forward pass that its slopes need.
pub(in crate::head) struct Trace {
    /// The values of each layer before its activation, `[Q, width]`.
    before: Vec<Vec<f32>>,
    /// `[Q, outputs]`.
    pub out: Vec<f32>,
}

/// Slopes of one number with respect to inputs `[Q, inputs]` and the code `[Q, C]`.
pub(in crate::head) struct Slopes {
    pub inputs: Vec<f32>,
    pub code: Vec<f32>,
}

impl NetworkSlopes {
    pub fn new(network: &Network) -> Self {
        let code = network.code.iter();
        NetworkSlopes {
            point: [0, 1].map(|n| network.point[n].panels.transposed()),
            hidden: network
                .hidden
                .iter()
                .map(|l| l.panels.transposed())
                .collect(),
            code: code
                .map(|(n, m)| (*n, Panels::new(matrix::view(m))))
                .collect(),
            out_code: Panels::new(matrix::view(&network.out_code)),
            codes: network.out_code.ncols(),
        }
    }

    /// Slopes of one number for each point, whose slopes with respect to the outputs are `pull`,
    /// `[Q, outputs]`.
    pub fn slopes(&self, of: &Prepared<'_>, trace: &Trace, pull: &[f32]) -> Slopes {
        let (width, outputs) = (of.rows[0].len(), of.out.bias.len());
        let points = pull.len() / outputs;
        let mut slopes = Slopes {
            inputs: vec![0.0; points * self.point[0].columns()],
            code: vec![0.0; points * self.codes],
        };
        let last = self.hidden.len();
        let mut active = trace.before[last].clone();
        silu_all(&mut active);
        // Slopes with respect to the code's part of the last matrix and of its bias.
        let mut of_last = Vec::with_capacity(points * outputs * (width + 1));
        for (pull, active) in pull.chunks_exact(outputs).zip(active.chunks_exact(width)) {
            for by in pull {
                of_last.extend(active.iter().map(|x| by * x));
                of_last.push(*by);
            }
        }
        add(&self.out_code, &of_last, &mut slopes.code);
        let mut here = vec![0.0; points * width];
        add(&of.out.panels.transposed(), pull, &mut here);
        for layer in (0..=last).rev() {
            silu_slopes(&mut here, &trace.before[layer]);
            for (_, code) in self.code.iter().filter(|(n, _)| *n == layer) {
                add(code, &here, &mut slopes.code);
            }
            if layer == 0 {
                add(&self.point[0], &here, &mut slopes.inputs);
                break;
            }
            if layer == of.network.again() {
                add(&self.point[1], &here, &mut slopes.inputs);
            }
            let mut before = vec![0.0; points * width];
            add(&self.hidden[layer - 1], &here, &mut before);
            here = before;
        }
        slopes
    }
}

/// `to += lhs · rhs`.
fn add(rhs: &Panels, lhs: &[f32], to: &mut [f32]) {
    rhs.multiply(lhs, Start::Output, Finish::Plain, to);
}

impl Prepared<'_> {
    /// Does the work of [`Prepared::forward`] and keeps the values that its slopes need.
    pub fn trace(&self, x: &[f32], points: usize) -> Trace {
        let Network { point, hidden, .. } = self.network;
        let width = self.rows[0].len();
        let mut h = vec![0.0; points * width];
        let start = Start::Row(&self.rows[0]);
        point[0].panels.multiply(x, start, Finish::Plain, &mut h);
        let mut before = Vec::with_capacity(hidden.len() + 1);
        for (number, layer) in hidden.iter().enumerate().map(|(n, layer)| (n + 1, layer)) {
            before.push(h.clone());
            silu_all(&mut h);
            let mut next = vec![0.0; points * width];
            let start = Start::Row(&self.rows[number]);
            layer.panels.multiply(&h, start, Finish::Plain, &mut next);
            if number == self.network.again() {
                add(&point[1].panels, x, &mut next);
            }
            h = next;
        }
        before.push(h.clone());
        silu_all(&mut h);
        let mut out = vec![0.0; points * self.out.bias.len()];
        let start = Start::Row(&self.out.bias);
        let panels = &self.out.panels;
        panels.multiply(&h, start, Finish::Plain, &mut out);
        Trace { before, out }
    }
}

/// The mean head's matrices, packed for the backward pass.
pub(in crate::head) struct TemplateSlopes(Vec<Panels>);

impl TemplateSlopes {
    pub fn new(template: &Template) -> Self {
        let layers = template.layers.iter();
        TemplateSlopes(layers.map(|l| l.panels.transposed()).collect())
    }

    /// Distance `[Q]` at encoded places, and its slopes with respect to the encoded values,
    /// `[Q, encoded]`.
    pub fn at(&self, template: &Template, x: &[f32], points: usize) -> (Vec<f32>, Vec<f32>) {
        let last = template.layers.len() - 1;
        let mut before: Vec<Vec<f32>> = Vec::with_capacity(last);
        let mut h = x.to_vec();
        for (number, layer) in template.layers.iter().enumerate() {
            let mut next = vec![0.0; points * layer.bias.len()];
            let start = Start::Row(&layer.bias);
            layer.panels.multiply(&h, start, Finish::Plain, &mut next);
            h = next;
            if number < last {
                before.push(h.clone());
                silu_all(&mut h);
            }
        }
        let mut here = vec![1.0; points];
        for layer in (0..=last).rev() {
            if layer < last {
                silu_slopes(&mut here, &before[layer]);
            }
            let mut next = vec![0.0; points * self.0[layer].columns()];
            add(&self.0[layer], &here, &mut next);
            here = next;
        }
        (h, here)
    }
}

/// Turns slopes with respect to encoded points (see [`super::encode`]), `[Q, 3 + 6 · octaves]`,
/// into slopes with respect to the points.
pub(in crate::head) fn through_encoding(
    inputs: &[f32],
    slopes: &[f32],
    octaves: usize,
) -> Vec<[f32; 3]> {
    let columns = super::encoded(octaves);
    let rows = inputs
        .chunks_exact(columns)
        .zip(slopes.chunks_exact(columns));
    rows.map(|(inputs, slope)| {
        std::array::from_fn(|axis| {
            let waves = (0..octaves).map(|octave| {
                let (sin, cos) = (3 + 6 * octave + axis, 6 + 6 * octave + axis);
                (1 << octave) as f32 * PI * (inputs[cos] * slope[sin] - inputs[sin] * slope[cos])
            });
            slope[axis] + waves.sum::<f32>()
        })
    })
    .collect()
}
