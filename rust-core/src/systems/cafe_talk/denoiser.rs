//! The diffusion transformer of Cafe-Talk and its adapter for fine control.
//!
//! Chen et al. 2025, sections 3.1 and 3.2; twin of `training/systems/cafe_talk/denoiser.py`. It
//! differs from the paper in three ways. The coarse condition may change from frame to frame. The
//! modulation comes from one linear layer for all blocks and a table in each block, because only
//! this matches the number of parameters in the paper. A unit of the fine condition is active on
//! the left, on the right or on both sides.

use ndarray::{Array1, Array2, ArrayRef2, ArrayView2, Axis, concatenate, s};

use super::config::{CafeTalkConfig, CoarseWay};
use crate::{
    Result,
    conditions::{EMOTIONS, SIDES},
    models::Weights,
    nn::{
        ada_ln::{AdaLn, Modulated, PER_LAYER},
        elementwise::{add_all, gelu_all, silu_all},
        film::{Film, Modulation},
        linear::Linear,
        matrix,
        mlp::Mlp,
        norm::LayerNorm,
        rotary::{RotaryAttention, RotaryMemory},
    },
};

/// Epsilon of PyTorch's `nn.LayerNorm`.
const EPSILON: f32 = 1e-5;
/// Sub-layers of a block under AdaLN: self-attention and feed-forward.
const ADA_LAYERS: usize = 2;
/// Sub-layers of a block under FiLM: self-attention and cross-attention.
const FILM_PLACES: usize = 2;
/// Frames in the events' convolution.
const EVENT_KERNEL: usize = 3;

/// `M̂₀ = G(M_τ; τ, A, C, F)`, eq. 3, and its weights.
pub struct Denoiser {
    config: CafeTalkConfig,
    x_proj: Linear,
    mem_proj: Linear,
    null_speech: Array1<f32>,
    time_mlp: Mlp,
    coarse: CoarseCondition,
    ada: AdaLn,
    film: Film,
    blocks: Vec<Block>,
    norm: LayerNorm,
    head: Linear,
    adapter: Adapter,
    mean: Array1<f32>,
    std: Array1<f32>,
    /// `[15, E]`, vectors of the emotions in the text space.
    emotions: Array2<f32>,
}

/// The coarse condition `C` of a window.
#[derive(Debug, Clone, Copy)]
pub struct Coarse<'a> {
    /// Number of the speaking style.
    pub style: usize,
    /// `[T, E]`, vector of the emotion in the text space.
    pub emotion: ArrayView2<'a, f32>,
    /// `[T]`.
    pub intensity: &'a [f32],
}

/// The inputs that all denoising steps of a window share.
pub struct Conditions {
    /// Keys and values of the speech for each block.
    memory: Vec<RotaryMemory>,
    /// Modulation of every sub-layer, `[T, 6 d]`.
    ada: Array2<f32>,
    /// Mean of `C_f` over the window, `[d]`, if the coarse condition enters by FiLM.
    heard_by_film: Option<Vec<f32>>,
}

impl Denoiser {
    /// Builds the denoiser from its config and weights.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape.
    pub fn new(config: CafeTalkConfig, weights: &Weights) -> Result<Self> {
        let width = config.width;
        Ok(Denoiser {
            x_proj: Linear::load(&weights.pp("x_proj"), config.channels.len(), width)?,
            mem_proj: Linear::load(&weights.pp("mem_proj"), config.speech.channels, width)?,
            null_speech: weights.vector("null_speech", width)?,
            time_mlp: Mlp::load(&weights.pp("time_mlp"), width, width)?,
            coarse: CoarseCondition::load(&weights.pp("coarse"), &config)?,
            ada: AdaLn::load(&weights.pp("ada"), width, width, ADA_LAYERS)?,
            film: Film::load(&weights.pp("film"), width, width, FILM_PLACES)?,
            blocks: (0..config.blocks)
                .map(|i| Block::load(&weights.pp("blocks").pp(i), &config))
                .collect::<Result<_>>()?,
            norm: LayerNorm::load(&weights.pp("norm"), width, EPSILON)?,
            head: Linear::load(&weights.pp("head"), width, config.channels.len())?,
            adapter: Adapter::load(&weights.pp("adapter"), &config)?,
            mean: weights.vector("mean", config.channels.len())?,
            std: weights.vector("std", config.channels.len())?,
            emotions: weights.matrix("emotions", EMOTIONS.len(), config.text_width)?,
            config,
        })
    }

    /// The model's configuration.
    pub fn config(&self) -> &CafeTalkConfig {
        &self.config
    }

    /// Vectors in the text space, `[T, E]`, for mixtures of the emotions `[T, 15]`.
    pub fn places(&self, mixtures: ArrayView2<'_, f32>) -> Array2<f32> {
        mixtures.dot(&self.emotions)
    }

    /// Conditions of a window of `frames` frames. If `speech` `[T, C]` or `coarse` is `None`, the
    /// null condition takes its place.
    pub fn conditions(
        &self,
        frames: usize,
        speech: Option<ArrayView2<'_, f32>>,
        coarse: Option<Coarse<'_>>,
    ) -> Conditions {
        let heard = match speech {
            Some(speech) => self.mem_proj.forward(&speech.as_standard_layout()),
            None => rows_of(&self.null_speech, frames),
        };
        let condition = match coarse {
            Some(coarse) => self.coarse.forward(&coarse),
            None => rows_of(&self.coarse.null, frames),
        };
        let by_film = self.config.coarse == CoarseWay::Film;
        let mean = condition.mean_axis(Axis(0)).expect("a frame at least");
        let modulating = if by_film {
            Array2::zeros(condition.dim())
        } else {
            condition
        };
        Conditions {
            memory: self
                .blocks
                .iter()
                .map(|block| block.cross_attn.memory(&heard))
                .collect(),
            ada: self.ada.forward(modulating),
            heard_by_film: by_film.then(|| mean.to_vec()),
        }
    }

    /// The adapter's input for active units `[T, 32]` (left, then right): `[T, d]`.
    pub fn events(&self, active: ArrayView2<'_, f32>) -> Array2<f32> {
        self.adapter.condition(active)
    }

    /// One pass in standardised space, from noisy `[T, 51]` to clean. Without events, only the base
    /// model runs.
    pub fn denoise(
        &self,
        noisy: &ArrayRef2<f32>,
        timestep: usize,
        conditions: &Conditions,
        events: Option<&Array2<f32>>,
    ) -> Array2<f32> {
        let time = self.time_mlp.of_timestep(timestep);
        let mut heard = time.clone();
        if let Some(mean) = &conditions.heard_by_film {
            add_all(&mut heard, mean);
        }
        let films = self.film.forward(&heard);
        let place = self.adapter.film.forward(&time);
        let mut x = self.x_proj.forward(noisy);
        let blocks = self.blocks.iter().zip(&self.adapter.blocks);
        for ((block, beside), memory) in blocks.zip(&conditions.memory) {
            block.attend(&mut x, memory, &conditions.ada, &films, self.config.band);
            if let Some(events) = events {
                let added = beside.forward(&x, events, &place[0]);
                add_all(
                    x.as_slice_mut().expect("row-major array"),
                    matrix::values(&added),
                );
            }
            block.feed(&mut x, &conditions.ada);
        }
        self.norm.forward_in_place(&mut x);
        self.head.forward(&x)
    }

    /// Converts `x` `[T, 51]` from the model's space to weights, in place.
    pub fn to_weights(&self, x: &mut Array2<f32>) {
        *x *= &self.std;
        *x += &self.mean;
    }
}

fn rows_of(row: &Array1<f32>, frames: usize) -> Array2<f32> {
    let rows = row.broadcast((frames, row.len())).expect("a row repeats");
    rows.to_owned()
}

/// `C_f = W [C_ts ‖ C_emo ‖ i·e_int]`, section 3.1.1.
struct CoarseCondition {
    style: Array2<f32>,
    intensity: Array1<f32>,
    linear: Linear,
    null: Array1<f32>,
}

impl CoarseCondition {
    fn load(weights: &Weights, config: &CafeTalkConfig) -> Result<Self> {
        let (styles, place, text) = (config.styles.len(), config.style_width, config.text_width);
        Ok(CoarseCondition {
            style: weights.pp("style").matrix("weight", styles, place)?,
            intensity: weights.vector("intensity", text)?,
            linear: Linear::load(&weights.pp("linear"), place + 2 * text, config.width)?,
            null: weights.vector("null", config.width)?,
        })
    }

    fn forward(&self, coarse: &Coarse<'_>) -> Array2<f32> {
        let (place, text) = (self.style.ncols(), self.intensity.len());
        let mut joined = Array2::zeros((coarse.intensity.len(), place + 2 * text));
        for (t, mut row) in joined.rows_mut().into_iter().enumerate() {
            row.slice_mut(s![..place])
                .assign(&self.style.row(coarse.style));
            row.slice_mut(s![place..place + text])
                .assign(&coarse.emotion.row(t));
            row.slice_mut(s![place + text..])
                .assign(&(&self.intensity * coarse.intensity[t]));
        }
        self.linear.forward(&joined)
    }
}

/// AdaLN self-attention, FiLM self-attention, FiLM cross-attention, AdaLN feed-forward (figure 2).
struct Block {
    coarse_attn: RotaryAttention,
    self_attn: RotaryAttention,
    cross_attn: RotaryAttention,
    linear1: Linear,
    linear2: Linear,
    norm1: LayerNorm,
    norm2: LayerNorm,
    ada_table: Array2<f32>,
}

impl Block {
    fn load(weights: &Weights, config: &CafeTalkConfig) -> Result<Self> {
        let (width, feed) = (config.width, config.feedforward);
        let attention = |name: &str| {
            RotaryAttention::load(&weights.pp(name), width, config.inner, config.heads)
        };
        Ok(Block {
            coarse_attn: attention("coarse_attn")?,
            self_attn: attention("self_attn")?,
            cross_attn: attention("cross_attn")?,
            linear1: Linear::load(&weights.pp("linear1"), width, feed)?,
            linear2: Linear::load(&weights.pp("linear2"), feed, width)?,
            norm1: LayerNorm::load(&weights.pp("norm1"), width, EPSILON)?,
            norm2: LayerNorm::load(&weights.pp("norm2"), width, EPSILON)?,
            ada_table: weights.matrix("ada_table", PER_LAYER * ADA_LAYERS, width)?,
        })
    }

    fn modulated<'a>(&'a self, ada: &'a Array2<f32>, layer: usize) -> Modulated<'a> {
        Modulated {
            ada,
            table: &self.ada_table,
            layer,
        }
    }

    /// The three attentions, in place; `x`: `[T, d]`.
    fn attend(
        &self,
        x: &mut Array2<f32>,
        memory: &RotaryMemory,
        ada: &Array2<f32>,
        films: &[Modulation],
        band: usize,
    ) {
        let coarse = self.modulated(ada, 0);
        let y = self.coarse_attn.forward_self(&coarse.norm(x));
        coarse.add(x, &y);
        let y = self.self_attn.forward_self(&self.norm1.forward(x));
        films[0].add(x, &y);
        let y = self
            .cross_attn
            .forward(&self.norm2.forward(x), memory, Some(band));
        films[1].add(x, &y);
    }

    /// The feed-forward layer, in place; `x`: `[T, d]`.
    fn feed(&self, x: &mut Array2<f32>, ada: &Array2<f32>) {
        let coarse = self.modulated(ada, 1);
        let hidden = self.linear1.forward_then(&coarse.norm(x), gelu_all);
        coarse.add(x, &self.linear2.forward(&hidden));
    }
}

/// Fine control on top of the frozen base (section 3.2, figure 3).
struct Adapter {
    events: Linear,
    /// The convolution over neighbouring frames as one matrix product, `[3 d] → [d]`.
    spread: Linear,
    film: Film,
    blocks: Vec<AdapterBlock>,
}

impl Adapter {
    fn load(weights: &Weights, config: &CafeTalkConfig) -> Result<Self> {
        let width = config.width;
        let units = SIDES * config.units.len();
        Ok(Adapter {
            events: Linear::load(&weights.pp("events"), units, width)?,
            spread: unfolded(&weights.pp("spread"), width)?,
            film: Film::load(&weights.pp("film"), width, width, 1)?,
            blocks: (0..config.blocks)
                .map(|i| AdapterBlock::load(&weights.pp("blocks").pp(i), config))
                .collect::<Result<_>>()?,
        })
    }

    /// `[T, 32]` to `[T, d]`; exactly 0 in frames two or more away from any event.
    fn condition(&self, active: ArrayView2<'_, f32>) -> Array2<f32> {
        let frames = active.nrows();
        let has_event: Vec<bool> = active
            .rows()
            .into_iter()
            .map(|row| row.iter().any(|x| *x != 0.0))
            .collect();
        let mut heard = self
            .events
            .forward_then(&active.as_standard_layout(), silu_all);
        for (t, mut row) in heard.rows_mut().into_iter().enumerate() {
            if !has_event[t] {
                row.fill(0.0);
            }
        }
        let edge = Array2::zeros((1, heard.ncols()));
        let padded =
            concatenate(Axis(0), &[edge.view(), heard.view(), edge.view()]).expect("equal widths");
        let beside = [0, 1, 2].map(|k| padded.slice(s![k..k + frames, ..]));
        let beside = concatenate(Axis(1), &beside).expect("equal lengths");
        let mut out = self.spread.forward(&beside.as_standard_layout());
        for (t, mut row) in out.rows_mut().into_iter().enumerate() {
            let near = t.saturating_sub(1)..(t + 2).min(frames);
            if !has_event[near].contains(&true) {
                row.fill(0.0);
            }
        }
        out
    }
}

/// PyTorch's `Conv1d` weight `[d, d, 3]` as a linear layer over three frames side by side.
fn unfolded(weights: &Weights, width: usize) -> Result<Linear> {
    let values = weights.values("weight", &[width, width, EVENT_KERNEL])?;
    let weight = Array2::from_shape_fn((width, EVENT_KERNEL * width), |(out, column)| {
        let (k, input) = (column / width, column % width);
        values[(out * width + input) * EVENT_KERNEL + k]
    });
    Ok(Linear::from_parts(&weight, weights.vector("bias", width)?))
}

/// A FiLM self-attention layer over the events, and a zero convolution after it.
struct AdapterBlock {
    norm: LayerNorm,
    attn: RotaryAttention,
    zero: Linear,
}

impl AdapterBlock {
    fn load(weights: &Weights, config: &CafeTalkConfig) -> Result<Self> {
        let width = config.width;
        Ok(AdapterBlock {
            norm: LayerNorm::load(&weights.pp("norm"), width, EPSILON)?,
            attn: RotaryAttention::load(
                &weights.pp("attn"),
                width,
                config.adapter_inner,
                config.heads,
            )?,
            zero: Linear::load(&weights.pp("zero"), width, width)?,
        })
    }

    /// The amount to add to `x`, computed from `x` and `events`, all `[T, d]`.
    fn forward(&self, x: &Array2<f32>, events: &Array2<f32>, place: &Modulation) -> Array2<f32> {
        let mut heard = self.norm.forward(x);
        heard += events;
        let y = self.attn.forward_self(&heard);
        place.add(&mut heard, &y);
        self.zero.forward(&heard)
    }
}

#[cfg(test)]
mod tests;
