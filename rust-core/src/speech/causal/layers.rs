//! Layers that take one frame at a time and keep only the past frames they still need.
//!
//! A layer that looks ahead has a delay: it gives no output for its first frames, then each frame
//! yields the output of an earlier one. Zeros stand before the first frame.

use ndarray::Array2;

use super::config::{Block, TAPS};
use crate::{
    Result,
    models::Weights,
    nn::{
        elementwise::{add_all, gelu_all},
        linear::Linear,
        norm::LayerNorm,
    },
};

const EPSILON: f32 = 1e-5;

/// The last frames of a sequence, in a ring.
#[derive(Debug, Clone)]
pub(super) struct History {
    rows: Vec<f32>,
    channels: usize,
    /// Frames that were pushed so far.
    pub count: usize,
}

impl History {
    pub fn new(frames: usize, channels: usize) -> Self {
        History {
            rows: vec![0.0; frames * channels],
            channels,
            count: 0,
        }
    }

    /// Overwrites the oldest frame with a new one and returns the stored copy.
    pub fn push(&mut self, row: &[f32]) -> &mut [f32] {
        let at = self.place(self.count);
        self.count += 1;
        let target = &mut self.rows[at..at + self.channels];
        target.copy_from_slice(row);
        target
    }

    /// The frame `age` frames before the newest.
    pub fn back(&self, age: usize) -> &[f32] {
        let frames = self.rows.len() / self.channels;
        let at = self.place(self.count + frames - 1 - age);
        &self.rows[at..at + self.channels]
    }

    fn place(&self, frame: usize) -> usize {
        frame % (self.rows.len() / self.channels) * self.channels
    }
}

/// A convolution like PyTorch's `nn.Conv1d`, computed as one product over its gathered taps.
pub(super) struct Taps {
    product: Linear,
    taps: usize,
    dilation: usize,
}

impl Taps {
    /// Reads `weight` `[out, in, taps]` and `bias` `[out]`.
    pub fn load(weights: &Weights, shape: [usize; 3], dilation: usize) -> Result<Self> {
        let [outputs, inputs, taps] = shape;
        let values = weights.values("weight", &shape)?;
        let weight = Array2::from_shape_fn((outputs, taps * inputs), |(out, column)| {
            values[(out * inputs + column % inputs) * taps + column / inputs]
        });
        Ok(Taps {
            product: Linear::from_parts(&weight, weights.vector("bias", outputs)?),
            taps,
            dilation,
        })
    }

    /// An empty history with room for the frames that the convolution needs.
    pub fn history(&self) -> History {
        let channels = self.product.inputs() / self.taps;
        History::new((self.taps - 1) * self.dilation + 1, channels)
    }

    pub fn outputs(&self) -> usize {
        self.product.outputs()
    }

    /// Output for the newest taps of `past`. `gathered` is scratch memory.
    pub fn apply(&self, past: &History, gathered: &mut Vec<f32>, out: &mut [f32]) {
        gathered.clear();
        for tap in (0..self.taps).rev() {
            gathered.extend_from_slice(past.back(tap * self.dilation));
        }
        self.product.forward_row(gathered, out);
    }
}

/// A convolution with stride 2 and GELU.
pub(super) struct Halving {
    taps: Taps,
    ahead: usize,
}

impl Halving {
    /// `shape`: `[out, in, taps]`. `ahead` taps lie after the current frame.
    pub fn load(weights: &Weights, shape: [usize; 3], ahead: usize) -> Result<Self> {
        let taps = Taps::load(weights, shape, 1)?;
        Ok(Halving { taps, ahead })
    }

    pub fn state(&self) -> HalvingState {
        HalvingState {
            past: self.taps.history(),
            gathered: Vec::new(),
            out: vec![0.0; self.taps.outputs()],
        }
    }

    /// Takes a frame. Every second frame completes an output.
    pub fn step<'s>(&self, state: &'s mut HalvingState, x: &[f32]) -> Option<&'s [f32]> {
        state.past.push(x);
        let last = state.past.count - 1;
        if last < self.ahead || !(last - self.ahead).is_multiple_of(2) {
            return None;
        }
        self.taps
            .apply(&state.past, &mut state.gathered, &mut state.out);
        gelu_all(&mut state.out);
        Some(&state.out)
    }
}

/// State of a [`Halving`].
#[derive(Debug, Clone)]
pub(super) struct HalvingState {
    past: History,
    gathered: Vec<f32>,
    out: Vec<f32>,
}

/// x + mix(GELU(conv(norm(x)))). The output comes `reach` frames late.
pub(super) struct CausalBlock {
    norm: LayerNorm,
    conv: Taps,
    mix: Linear,
    reach: usize,
}

impl CausalBlock {
    pub fn load(weights: &Weights, channels: usize, block: &Block) -> Result<Self> {
        let shape = [channels, channels, TAPS];
        Ok(CausalBlock {
            norm: LayerNorm::load(&weights.pp("norm"), channels, EPSILON)?,
            conv: Taps::load(&weights.pp("conv"), shape, block.dilation)?,
            mix: Linear::load(&weights.pp("mix"), channels, channels)?,
            reach: block.reach(),
        })
    }

    pub fn state(&self) -> BlockState {
        let channels = self.mix.inputs();
        BlockState {
            inputs: History::new(self.reach + 1, channels),
            normed: self.conv.history(),
            gathered: Vec::new(),
            hidden: vec![0.0; channels],
            out: vec![0.0; channels],
        }
    }

    /// Takes a frame. Returns the output of the frame `reach` earlier, once there is one.
    pub fn step<'s>(&self, state: &'s mut BlockState, x: &[f32]) -> Option<&'s [f32]> {
        state.inputs.push(x);
        self.norm.forward_rows(state.normed.push(x));
        if state.inputs.count <= self.reach {
            return None;
        }
        self.conv
            .apply(&state.normed, &mut state.gathered, &mut state.hidden);
        gelu_all(&mut state.hidden);
        self.mix.forward_row(&state.hidden, &mut state.out);
        add_all(&mut state.out, state.inputs.back(self.reach));
        Some(&state.out)
    }
}

/// State of a [`CausalBlock`].
#[derive(Debug, Clone)]
pub(super) struct BlockState {
    inputs: History,
    normed: History,
    gathered: Vec<f32>,
    hidden: Vec<f32>,
    out: Vec<f32>,
}

/// Passes a frame through blocks in turn, in place. `None` while one of them waits for more frames.
pub(super) fn through(
    blocks: &[CausalBlock],
    states: &mut [BlockState],
    x: &mut [f32],
) -> Option<()> {
    for (block, state) in blocks.iter().zip(states) {
        let y = block.step(state, x)?;
        x.copy_from_slice(y);
    }
    Some(())
}
