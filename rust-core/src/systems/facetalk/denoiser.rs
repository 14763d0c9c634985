//! Speech to expression codes: a transformer decoder that predicts clean codes (§4, fig. 2; eq. 2 to 10).
//!
//! Twin of `training/systems/facetalk/motion.py`. It differs from the paper: the norm comes before
//! each layer, and the layer's output is modulated. Positions are rotary. A frame sees as many
//! earlier frames as a training window had, so that a sound of any length is sampled in one go.
//! The augmentation r of eq. 8 is an input of the model, so that it can be a control.

use std::cell::Cell;

use ndarray::{Array1, Array2, ArrayRef2, ArrayView2};

use super::config::{MotionConfig, Sampling};
use crate::{
    Error, Result,
    diffusion::{Ddim, guided},
    job::{ProgressFn, report},
    models::Weights,
    nn::{
        elementwise::{add_all, gelu_all, silu_all},
        film::{Film, Modulation},
        linear::Linear,
        norm::LayerNorm,
        rotary::{RotaryAttention, RotaryMemory},
        timestep::timestep_embedding,
    },
};

/// Epsilon of PyTorch's `nn.LayerNorm`.
const EPSILON: f32 = 1e-5;
/// Modulated layers of a block.
const PLACES: usize = 3;

/// x̂₀ = D(x_t; t, speech, r) and its weights.
pub struct Denoiser {
    config: MotionConfig,
    x_proj: Linear,
    mem_proj: Linear,
    /// A memory row that stands for dropped speech, `[d]`.
    null_speech: Array1<f32>,
    time: [Linear; 3],
    vividness: Linear,
    film: Film,
    blocks: Vec<Block>,
    norm: LayerNorm,
    head: Linear,
    /// A layer on the speech features whose output is added to the clean codes.
    direct: Option<Linear>,
    mean: Array1<f32>,
    std: Array1<f32>,
}

/// Self-attention, cross-attention and feed-forward, each followed by FiLM.
struct Block {
    self_attn: RotaryAttention,
    cross_attn: RotaryAttention,
    linear1: Linear,
    linear2: Linear,
    norms: [LayerNorm; PLACES],
}

/// The speech in the form of the blocks' memory.
pub struct Memory {
    blocks: Vec<RotaryMemory>,
    /// The amount to add to clean codes, `[T, X]`.
    direct: Option<Array2<f32>>,
}

impl Denoiser {
    /// Builds the denoiser from its config and weights.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape.
    pub fn new(config: MotionConfig, weights: &Weights) -> Result<Self> {
        let MotionConfig { codes, width, .. } = config;
        let linear = |name: &str, inputs, outputs| Linear::load(&weights.pp(name), inputs, outputs);
        let time = |n: usize| linear(&format!("time.linear{n}"), width, width);
        Ok(Denoiser {
            x_proj: linear("x_proj", codes, width)?,
            mem_proj: linear("mem_proj", config.speech.channels, width)?,
            null_speech: weights.vector("null_speech", width)?,
            time: [time(1)?, time(2)?, time(3)?],
            vividness: linear("vividness", 1, width)?,
            film: Film::load(&weights.pp("film"), width, width, PLACES * config.blocks)?,
            blocks: (0..config.blocks)
                .map(|i| Block::load(&weights.pp("blocks").pp(i), &config))
                .collect::<Result<_>>()?,
            norm: LayerNorm::load(&weights.pp("norm"), width, EPSILON)?,
            head: linear("head", width, codes)?,
            direct: if config.direct {
                Some(linear("direct", config.speech.channels, codes)?)
            } else {
                None
            },
            mean: weights.vector("mean", codes)?,
            std: weights.vector("std", codes)?,
            config,
        })
    }

    /// The model's configuration.
    pub fn config(&self) -> &MotionConfig {
        &self.config
    }

    /// Turns `speech` `[T, C]` into the blocks' memory.
    pub fn heard(&self, speech: ArrayView2<'_, f32>) -> Memory {
        let speech = speech.as_standard_layout();
        Memory {
            direct: self.direct.as_ref().map(|layer| layer.forward(&speech)),
            ..self.memory(&self.mem_proj.forward(&speech))
        }
    }

    /// The blocks' memory for `frames` frames without speech.
    pub fn unheard(&self, frames: usize) -> Memory {
        let rows = self
            .null_speech
            .broadcast((frames, self.config.width))
            .expect("a row repeats");
        self.memory(&rows.to_owned())
    }

    fn memory(&self, heard: &Array2<f32>) -> Memory {
        let of_block = |block: &Block| block.cross_attn.memory(heard);
        Memory {
            blocks: self.blocks.iter().map(of_block).collect(),
            direct: None,
        }
    }

    /// One pass in standardised space, from noisy `[T, X]` to clean, with vividness `r`. An error
    /// of `after_block` ends the pass.
    ///
    /// # Errors
    /// Those of `after_block`.
    fn denoise(
        &self,
        noisy: &ArrayRef2<f32>,
        timestep: usize,
        memory: &Memory,
        r: f32,
        after_block: impl Fn() -> Result<()>,
    ) -> Result<Array2<f32>> {
        let films = self.film.forward(&self.condition(timestep, r));
        let mut x = self.x_proj.forward(noisy);
        let places = films.as_chunks::<PLACES>().0;
        for ((block, memory), films) in self.blocks.iter().zip(&memory.blocks).zip(places) {
            block.forward(&mut x, memory, films, &self.config);
            after_block()?;
        }
        self.norm.forward_in_place(&mut x);
        let mut clean = self.head.forward(&x);
        if let Some(direct) = &memory.direct {
            clean += direct;
        }
        Ok(clean)
    }

    /// The condition for the modulation, `[d]`: an MLP of three layers on the timestep's sinusoids,
    /// plus a linear layer on r − 1.
    fn condition(&self, timestep: usize, r: f32) -> Vec<f32> {
        let mut x = timestep_embedding(timestep, self.config.width);
        for (number, linear) in self.time.iter().enumerate() {
            if number > 0 {
                silu_all(&mut x);
            }
            let mut out = vec![0.0; linear.outputs()];
            linear.forward_row(&x, &mut out);
            x = out;
        }
        let mut from_vividness = vec![0.0; self.config.width];
        self.vividness.forward_row(&[r - 1.0], &mut from_vividness);
        add_all(&mut x, &from_vividness);
        x
    }

    /// Samples z_ex `[T, X]` of a whole sound from unit noise `[T, X]`. `speech`: `[T, C]`.
    ///
    /// # Errors
    /// `ShapeMismatch` if the noise has another shape, `InvalidInput` for steps out of range,
    /// `Cancelled`.
    pub fn sample(
        &self,
        noise: Array2<f32>,
        speech: ArrayView2<'_, f32>,
        sampling: &Sampling,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let frames = speech.nrows();
        if noise.dim() != (frames, self.config.codes) {
            return Err(Error::ShapeMismatch {
                what: "noise",
                expected: format!("[{frames}, {}]", self.config.codes),
                got: format!("{:?}", noise.shape()),
            });
        }
        let diffusion = self.config.diffusion;
        let ddim = Ddim::new(
            diffusion.schedule,
            diffusion.train_steps,
            sampling.spacing,
            sampling.steps,
        )?;
        let Sampling {
            guidance,
            vividness,
            ..
        } = *sampling;
        let heard = self.heard(speech);
        let unheard = (guidance != 1.0).then(|| self.unheard(frames));
        let passes = sampling.steps * (1 + usize::from(unheard.is_some()));
        let (blocks, done) = (passes * self.blocks.len(), Cell::new(0));
        // A pass covers the whole sound and takes long, so each block checks for cancellation.
        let after_block = || {
            done.set(done.get() + 1);
            report(progress, "motion", done.get() as f32 / blocks as f32)
        };
        let pass = |x: &ArrayRef2<f32>, timestep, memory| {
            self.denoise(x, timestep, memory, vividness, after_block)
        };
        let predict = |x: &ArrayRef2<f32>, timestep: usize| {
            let clean = pass(x, timestep, &heard)?;
            Ok(match &unheard {
                Some(unheard) => guided(&pass(x, timestep, unheard)?, &clean, guidance),
                None => clean,
            })
        };
        let start = noise * sampling.temperature;
        let mut codes = ddim.sample(start, predict, progress, (0.0, 1.0))?;
        codes *= &self.std;
        codes += &self.mean;
        Ok(codes)
    }
}

impl Block {
    fn load(weights: &Weights, config: &MotionConfig) -> Result<Self> {
        let (width, feed) = (config.width, config.feedforward);
        let attention = |name: &str| {
            RotaryAttention::load(&weights.pp(name), width, config.inner, config.heads)
        };
        let norm = |name: &str| LayerNorm::load(&weights.pp(name), width, EPSILON);
        Ok(Block {
            self_attn: attention("self_attn")?,
            cross_attn: attention("cross_attn")?,
            linear1: Linear::load(&weights.pp("linear1"), width, feed)?,
            linear2: Linear::load(&weights.pp("linear2"), feed, width)?,
            norms: [norm("norm1")?, norm("norm2")?, norm("norm3")?],
        })
    }

    /// Applies the block to `x` `[T, d]`, in place.
    fn forward(
        &self,
        x: &mut Array2<f32>,
        memory: &RotaryMemory,
        films: &[Modulation; PLACES],
        config: &MotionConfig,
    ) {
        let [before_self, before_cross, before_feed] = &self.norms;
        let look_back = config.look_back_frames;
        let y = self
            .self_attn
            .forward_behind(&before_self.forward(x), look_back);
        films[0].add(x, &y);
        let heard = before_cross.forward(x);
        let y = self.cross_attn.forward(&heard, memory, Some(config.band));
        films[1].add(x, &y);
        let hidden = self.linear1.forward_then(&before_feed.forward(x), gelu_all);
        films[2].add(x, &self.linear2.forward(&hidden));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        job::SILENT,
        nn::golden::{Golden, distance},
        systems::facetalk::MotionConfigs,
    };

    fn golden() -> (Golden, Denoiser) {
        let golden = Golden::open("facetalk_motion_debug");
        let config = format!("{{\"motion\": {}}}", golden.metadata("config"));
        let config = MotionConfigs::from_json(&config).unwrap().motion;
        let denoiser = Denoiser::new(config, &golden.weights()).unwrap();
        (golden, denoiser)
    }

    #[test]
    fn single_passes_match_pytorch_with_and_without_speech() {
        let (golden, denoiser) = golden();
        let [noisy, speech] = ["noisy", "speech"].map(|name| golden.matrix(name));
        let (timestep, r) = (
            golden.integers("timestep")[0],
            golden.values("vividness")[0],
        );
        for (name, memory) in [
            ("clean", denoiser.heard(speech.view())),
            ("clean_null", denoiser.unheard(noisy.nrows())),
        ] {
            let got = denoiser
                .denoise(&noisy, timestep, &memory, r, || Ok(()))
                .unwrap();
            let error = distance(&got, &golden.matrix(name));
            assert!(error < 1e-4, "{name} {error}");
        }
    }

    #[test]
    fn whole_runs_match_pytorch_with_and_without_guidance() {
        let (golden, denoiser) = golden();
        let [noise, speech] = ["noise", "speech"].map(|name| golden.matrix(name));
        let usual = denoiser.config().sampling;
        let plain = Sampling {
            guidance: 1.0,
            ..usual
        };
        let strong = Sampling {
            guidance: 1.7,
            vividness: 1.2,
            temperature: 0.8,
            ..usual
        };
        for (name, sampling) in [("codes", plain), ("guided", strong)] {
            let got = denoiser
                .sample(noise.clone(), speech.view(), &sampling, SILENT)
                .unwrap();
            let error = distance(&got, &golden.matrix(name));
            assert!(error < 1e-4, "{name} {error}");
        }
    }

    #[test]
    fn what_comes_later_changes_nothing() {
        let (golden, denoiser) = golden();
        let [noise, mut speech] = ["noise", "speech"].map(|name| golden.matrix(name));
        let sampling = denoiser.config().sampling;
        let run = |speech: &Array2<f32>| {
            denoiser
                .sample(noise.clone(), speech.view(), &sampling, SILENT)
                .unwrap()
        };
        let before = run(&speech);
        speech.row_mut(12).fill(3.0);
        let after = run(&speech);
        for t in 0..speech.nrows() {
            let apart = distance(before.row(t), after.row(t));
            assert_eq!(apart < 1e-6, t < 12, "frame {t}: {apart}");
        }
    }

    #[test]
    fn a_config_without_motion_is_refused() {
        let refused = MotionConfigs::from_json("{}").unwrap_err().to_string();
        assert!(refused.contains("missing field `motion`"), "{refused}");
        let config = Golden::open("facetalk_motion_debug").metadata("config");
        let both = format!("{{\"motion\": {config}, \"landmark_motion\": {config}}}");
        let refused = MotionConfigs::from_json(&both).unwrap_err().to_string();
        assert!(
            refused.contains("expected 204 channels of landmarks, got 16 of ear"),
            "{refused}"
        );
        let (_, denoiser) = golden();
        let noise = Array2::zeros((4, 2));
        let speech = Array2::zeros((4, denoiser.config().speech.channels));
        let sampling = denoiser.config().sampling;
        let refused = denoiser.sample(noise, speech.view(), &sampling, SILENT);
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains("expected [4, 5]"), "{refused}");
    }
}
