//! One branch: computes the next frame from the frames before and the current features
//! (FaceFormer's decoder, with one layer).
//!
//! Where a frame attends only to itself, attention amounts to a linear layer and is implemented as
//! one.

use super::EmoFaceConfig;
use crate::{
    Result,
    models::Weights,
    nn::{
        biased_attention::{BiasedSelfAttention, PastRows, add_periodic_position},
        elementwise::{add_all, gelu_all},
        linear::Linear,
        norm::LayerNorm,
    },
};

/// Epsilon of PyTorch's `nn.LayerNorm`.
const EPSILON: f32 = 1e-5;

/// The weights of a branch.
pub struct Branch {
    period: usize,
    motion_in: Linear,
    self_attn: BiasedSelfAttention,
    own_frame: Linear,
    linear1: Linear,
    linear2: Linear,
    norms: [LayerNorm; 3],
    motion_out: Linear,
}

/// A branch's inputs for one frame.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    /// The frame's number, counted from the start of the performance.
    pub number: usize,
    /// `[3 V]`, the previous frame in units of the model.
    pub before: &'a [f32],
    /// `[C]`.
    pub heard: &'a [f32],
    /// `[d]`.
    pub condition: &'a [f32],
}

impl Branch {
    /// Reads the arrays by their names in `training/systems/emoface/model.py`.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape.
    pub fn load(weights: &Weights, config: &EmoFaceConfig) -> Result<Self> {
        let EmoFaceConfig {
            width,
            heads,
            period,
            look_back,
            channels,
            ..
        } = *config;
        let linear = |name: &str, inputs, outputs| Linear::load(&weights.pp(name), inputs, outputs);
        let norm = |name: &str| LayerNorm::load(&weights.pp(name), width, EPSILON);
        let attention = weights.pp("self_attn");
        Ok(Branch {
            period,
            motion_in: linear("motion_in", 3 * config.vertices, width)?,
            self_attn: BiasedSelfAttention::load(&attention, width, heads, period, look_back)?,
            own_frame: linear("own_frame", channels, width)?,
            linear1: linear("linear1", width, 2 * width)?,
            linear2: linear("linear2", 2 * width, width)?,
            norms: [norm("norm1")?, norm("norm2")?, norm("norm3")?],
            motion_out: linear("motion_out", width, 3 * config.vertices)?,
        })
    }

    /// Writes the frame to `out`, `[3 V]` in units of the model. Returns the input of the last
    /// layer, `[d]`.
    pub fn step(&self, frame: Frame<'_>, past: &mut PastRows, out: &mut [f32]) -> Vec<f32> {
        let width = self.motion_in.outputs();
        let (mut x, mut y) = (vec![0.0; width], vec![0.0; width]);
        self.motion_in.forward_row(frame.before, &mut x);
        add_all(&mut x, frame.condition);
        add_periodic_position(&mut x, frame.number, self.period);
        self.self_attn.step(&x, past, &mut y);
        self.joined(&mut x, &y, 0);
        self.own_frame.forward_row(frame.heard, &mut y);
        self.joined(&mut x, &y, 1);
        let mut wide = vec![0.0; self.linear1.outputs()];
        self.linear1.forward_row(&x, &mut wide);
        gelu_all(&mut wide);
        self.linear2.forward_row(&wide, &mut y);
        self.joined(&mut x, &y, 2);
        self.motion_out.forward_row(&x, out);
        x
    }

    /// The last layer, which outputs the displacements, `[3 V, d]`.
    pub fn last_layer(&self) -> &Linear {
        &self.motion_out
    }

    fn joined(&self, x: &mut [f32], y: &[f32], norm: usize) {
        add_all(x, y);
        self.norms[norm].forward_rows(x);
    }
}
