//! Landmark motion while somebody is speaking: samples in, frames out, a fifth of a second behind.
//!
//! A small convolutional network that imitates encoder and denoiser together (it was trained on what
//! they perform). Log-mel passes a running normalisation, a strided stem to 50 Hz, a strided step to
//! 25 Hz, blocks that look a little ahead, and blocks that look back only. Twin of
//! `training/systems/freetalk/stream.py`. It speaks neutrally; the expression is added to each frame, so
//! a change of emotion acts on the very next one.
//!
//! Guaranteed: frame `t` depends on samples below `640 t + look_ahead_samples` alone, and is the same
//! bit for bit however the samples were cut into pushes, because every layer takes one frame at a
//! time. State is bounded; only samples that were pushed and not yet pulled as frames pile up.
//! Not guaranteed: equality with [`crate::Engine::perform`], which hears the whole sound.

mod config;
mod layers;
mod normaliser;
#[cfg(test)]
mod tests;

use std::{collections::VecDeque, sync::Arc};

use crate::{
    Error, Result,
    audio::SAMPLE_RATE_HZ,
    conditions::Emotion,
    ibug::LANDMARKS,
    motion::{CausalExpression, LandmarkFrame, MotionStream},
    nn::{Weights, linear::Linear, norm::LayerNorm},
    speech::{BANDS, FRAME, HOP, MelAnalyser},
};
pub use config::{Block, NormaliserConfig, StreamConfig};
use config::{DOWN_AHEAD, SAMPLES_PER_FRAME, STEM_AHEAD, STEM_TAPS, TAPS};
use layers::{BlockState, CausalBlock, Halving, HalvingState, through};
use normaliser::RunningNormaliser;

const EPSILON: f32 = 1e-5;
const DIMS: usize = 3 * LANDMARKS;
/// Time from one mel frame to the next, seconds.
const MEL_S: f64 = HOP as f64 / SAMPLE_RATE_HZ as f64;
/// Beyond this a sample is limited, so that its square stays a number.
const LOUDEST: f32 = 1e4;

/// The weights of the streaming network.
pub struct StreamModel {
    config: StreamConfig,
    stem: Halving,
    fine: Vec<CausalBlock>,
    down: Halving,
    listen: Vec<CausalBlock>,
    perform: Vec<CausalBlock>,
    norm: LayerNorm,
    head: Linear,
    mean: Vec<f32>,
    std: Vec<f32>,
}

impl StreamModel {
    /// From the bytes of `model.safetensors` and the text of `config.json`.
    ///
    /// # Errors
    /// `Weights` if either is damaged or they do not fit each other.
    pub fn load(weights: &[u8], config: &str) -> Result<Self> {
        Self::new(
            StreamConfig::from_json(config)?,
            &Weights::from_bytes(weights)?,
        )
    }

    fn new(config: StreamConfig, weights: &Weights) -> Result<Self> {
        let channels = config.channels;
        let blocks = |name: &str, blocks: &[Block]| -> Result<Vec<CausalBlock>> {
            let weights = weights.pp(name);
            let block = |(i, block)| CausalBlock::load(&weights.pp(i), channels, block);
            blocks.iter().enumerate().map(block).collect()
        };
        let stem = [channels, config.bands, STEM_TAPS];
        Ok(StreamModel {
            stem: Halving::load(&weights.pp("stem"), stem, STEM_AHEAD)?,
            fine: blocks("fine", &config.fine)?,
            down: Halving::load(&weights.pp("down"), [channels, channels, TAPS], DOWN_AHEAD)?,
            listen: blocks("listen", &config.listen)?,
            perform: blocks("perform", &config.perform)?,
            norm: LayerNorm::load(&weights.pp("norm"), channels, EPSILON)?,
            head: Linear::load(&weights.pp("head"), channels, DIMS)?,
            mean: weights.values("mean", &[DIMS])?,
            std: weights.values("std", &[DIMS])?,
            config,
        })
    }

    /// Sizes and look-ahead.
    pub fn config(&self) -> &StreamConfig {
        &self.config
    }
}

/// A performance in progress: push samples, pull frames.
pub struct CausalStream {
    model: Arc<StreamModel>,
    analyser: MelAnalyser,
    normaliser: RunningNormaliser,
    stem: HalvingState,
    fine: Vec<BlockState>,
    down: HalvingState,
    listen: Vec<BlockState>,
    perform: Vec<BlockState>,
    expression: CausalExpression,
    emotion: Emotion,
    /// Seconds since somebody was last heard to speak.
    quiet_s: f64,
    /// From the start of the next mel frame on.
    samples: VecDeque<f32>,
    pushed: u64,
    next_frame: usize,
    /// Frames in all, once the sound has ended.
    total: Option<usize>,
    row: Vec<f32>,
}

impl CausalStream {
    /// A neutral face before any sound.
    pub fn new(model: Arc<StreamModel>, expression: CausalExpression) -> Self {
        let states = |blocks: &[CausalBlock]| blocks.iter().map(CausalBlock::state).collect();
        CausalStream {
            analyser: MelAnalyser::new(),
            normaliser: RunningNormaliser::new(&model.config.normaliser),
            stem: model.stem.state(),
            fine: states(&model.fine),
            down: model.down.state(),
            listen: states(&model.listen),
            perform: states(&model.perform),
            expression,
            emotion: Emotion::default(),
            quiet_s: f64::INFINITY,
            samples: VecDeque::from([0.0; FRAME / 2]),
            pushed: 0,
            next_frame: 0,
            total: None,
            row: vec![0.0; model.config.channels],
            model,
        }
    }

    fn check_open(&self, what: &str) -> Result<()> {
        match self.total {
            None => Ok(()),
            Some(total) => Err(Error::InvalidInput(format!(
                "{what}: expected an open stream, got one that was finished after {total} frames"
            ))),
        }
    }

    /// Raw log-mel of the next 10 ms.
    fn next_mel(&mut self) -> Option<[f32; BANDS]> {
        if self.samples.len() < FRAME {
            return None;
        }
        let mut stretch = [0.0; FRAME];
        for (to, from) in stretch.iter_mut().zip(&self.samples) {
            *to = *from;
        }
        self.samples.drain(..HOP);
        let mut mel = [0.0; BANDS];
        self.analyser.frame(&stretch, &mut mel);
        Some(mel)
    }

    /// Takes one mel frame; now and then that completes what a motion frame hears, in `row`.
    fn listen(&mut self, mel: &[f32; BANDS]) -> Option<()> {
        let model = &self.model;
        self.row
            .copy_from_slice(model.stem.step(&mut self.stem, mel)?);
        through(&model.fine, &mut self.fine, &mut self.row)?;
        let down = model.down.step(&mut self.down, &self.row)?;
        self.row.copy_from_slice(down);
        through(&model.listen, &mut self.listen, &mut self.row)
    }

    /// Turns what was heard into a frame, with the emotion of now.
    fn perform(&mut self) -> LandmarkFrame {
        let model = &self.model;
        through(&model.perform, &mut self.perform, &mut self.row).expect("blocks that look back");
        model.norm.forward_rows(&mut self.row);
        let mut displacements = [[0.0; 3]; LANDMARKS];
        let flat = displacements.as_flattened_mut();
        model.head.forward_row(&self.row, flat);
        for ((x, std), mean) in flat.iter_mut().zip(&model.std).zip(&model.mean) {
            *x = *x * std + mean;
        }
        let index = self.next_frame;
        self.next_frame += 1;
        let mut frame = LandmarkFrame {
            index,
            displacements,
        };
        self.expression.add(&mut frame, &self.emotion, self.quiet_s);
        frame
    }
}

impl MotionStream for CausalStream {
    fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.check_open("push")?;
        if let Some(at) = samples.iter().position(|x| !x.is_finite()) {
            let count = samples.iter().filter(|x| !x.is_finite()).count();
            return Err(Error::Audio(format!(
                "expected finite samples, got {count} of {} that are NaN or infinite, the first at {at}",
                samples.len()
            )));
        }
        let limited = samples.iter().map(|x| x.clamp(-LOUDEST, LOUDEST));
        self.samples.extend(limited);
        self.pushed += samples.len() as u64;
        Ok(())
    }

    fn pull(&mut self) -> Option<LandmarkFrame> {
        if self.total.is_some_and(|total| self.next_frame >= total) {
            return None;
        }
        loop {
            let mut mel = self.next_mel()?;
            let is_active = self.normaliser.hear(&mut mel);
            self.quiet_s = if is_active { 0.0 } else { self.quiet_s + MEL_S };
            if self.listen(&mel).is_some() {
                return Some(self.perform());
            }
        }
    }

    fn finish(&mut self) -> Result<()> {
        self.check_open("finish")?;
        let frame = SAMPLES_PER_FRAME as u64;
        self.total = Some(self.pushed.div_ceil(frame) as usize);
        let silence = self.model.config.look_ahead_samples() + FRAME;
        self.samples.extend(std::iter::repeat_n(0.0, silence));
        Ok(())
    }

    fn set_emotion(&mut self, emotion: &Emotion) -> Result<()> {
        if *emotion == self.emotion {
            return Ok(());
        }
        let mut values = emotion.mixture.iter().chain([&emotion.intensity]);
        if let Some(value) = values.find(|value| !value.is_finite()) {
            return Err(Error::InvalidInput(format!(
                "emotion: expected finite numbers, got {value}"
            )));
        }
        self.emotion = *emotion;
        Ok(())
    }

    fn latency_s(&self) -> f64 {
        self.model.config.look_ahead_s()
    }

    fn next_frame(&self) -> usize {
        self.next_frame
    }

    fn fps(&self) -> f64 {
        self.model.config.fps
    }
}
