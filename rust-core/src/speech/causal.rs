//! Turns speech into rows of numbers at 25 Hz while somebody is speaking, at most a fifth of a
//! second late.
//!
//! A small convolutional network. Log-mel passes a running normalisation, a strided stem to 50 Hz,
//! a strided step to 25 Hz, blocks that look a little ahead, and blocks that only look back. The
//! caller decides what the rows mean: FreeTalk's stream gets landmarks, EmoFace's gets the features
//! of its content branch. Twin of `training/speech/causal.py`.
//!
//! Guaranteed: row `t` depends only on samples below `640 t + look_ahead_samples`. It is bit for bit
//! the same however the samples were cut into pushes, because every layer takes one frame at a time.
//! The state is bounded. Only samples that were pushed and not yet pulled as rows accumulate.

mod config;
mod layers;
mod normaliser;
#[cfg(test)]
mod tests;

use std::{collections::VecDeque, sync::Arc};

use super::log_mel::{BANDS, FRAME, HOP, MelAnalyser};
use crate::{
    Error, Result,
    audio::SAMPLE_RATE_HZ,
    models::Weights,
    nn::{linear::Linear, norm::LayerNorm},
};
pub(crate) use config::seconds_of;
pub use config::{Block, CausalConfig};
use config::{DOWN_AHEAD, SAMPLES_PER_FRAME, STEM_AHEAD, STEM_TAPS, TAPS};
use layers::{BlockState, CausalBlock, Halving, HalvingState, through};
use normaliser::RunningNormaliser;

const EPSILON: f32 = 1e-5;
/// Time from one mel frame to the next, seconds.
const MEL_S: f64 = HOP as f64 / SAMPLE_RATE_HZ as f64;
/// Samples are clamped to this magnitude, so that their squares stay finite.
const LOUDEST: f32 = 1e4;

/// The weights of a causal network.
pub struct CausalModel {
    config: CausalConfig,
    stem: Halving,
    fine: Vec<CausalBlock>,
    down: Halving,
    listen: Vec<CausalBlock>,
    perform: Vec<CausalBlock>,
    norm: LayerNorm,
    head: Linear,
    sooner: Vec<SoonerHead>,
    mean: Vec<f32>,
    std: Vec<f32>,
}

/// A further head: predicts a row some frames ahead of the main head from the same sound.
struct SoonerHead {
    block: CausalBlock,
    norm: LayerNorm,
    head: Linear,
}

impl SoonerHead {
    /// Sees a row and the two before it.
    const BLOCK: Block = Block {
        dilation: 1,
        ahead: 0,
    };

    fn load(weights: &Weights, channels: usize, outputs: usize) -> Result<Self> {
        Ok(SoonerHead {
            block: CausalBlock::load(&weights.pp("block"), channels, &Self::BLOCK)?,
            norm: LayerNorm::load(&weights.pp("norm"), channels, EPSILON)?,
            head: Linear::load(&weights.pp("head"), channels, outputs)?,
        })
    }
}

impl CausalModel {
    /// From the bytes of `model.safetensors` and the text of `config.json`. `outputs` is the length
    /// of a row that the caller expects.
    ///
    /// # Errors
    /// `Weights` if either is damaged, they do not fit each other, or rows have a different length.
    pub fn load(weights: &[u8], config: &str, outputs: usize) -> Result<Self> {
        let config = CausalConfig::from_json(config)?;
        if config.outputs != outputs {
            return Err(Error::Weights(format!(
                "{}: outputs: expected {outputs}, got {}",
                config.model, config.outputs
            )));
        }
        Self::new(config, &Weights::from_bytes(weights)?)
    }

    pub(crate) fn new(config: CausalConfig, weights: &Weights) -> Result<Self> {
        let (channels, outputs) = (config.channels, config.outputs);
        let blocks = |name: &str, blocks: &[Block]| -> Result<Vec<CausalBlock>> {
            let weights = weights.pp(name);
            let block = |(i, block)| CausalBlock::load(&weights.pp(i), channels, block);
            blocks.iter().enumerate().map(block).collect()
        };
        let stem = [channels, config.bands, STEM_TAPS];
        let sooner = weights.pp("sooner");
        let sooner = |number| SoonerHead::load(&sooner.pp(number), channels, outputs);
        Ok(CausalModel {
            stem: Halving::load(&weights.pp("stem"), stem, STEM_AHEAD)?,
            fine: blocks("fine", &config.fine)?,
            down: Halving::load(&weights.pp("down"), [channels, channels, TAPS], DOWN_AHEAD)?,
            listen: blocks("listen", &config.listen)?,
            perform: blocks("perform", &config.perform)?,
            norm: LayerNorm::load(&weights.pp("norm"), channels, EPSILON)?,
            head: Linear::load(&weights.pp("head"), channels, outputs)?,
            sooner: (0..config.sooner.len())
                .map(sooner)
                .collect::<Result<_>>()?,
            mean: weights.values("mean", &[outputs])?,
            std: weights.values("std", &[outputs])?,
            config,
        })
    }

    /// Sizes and look-ahead.
    pub fn config(&self) -> &CausalConfig {
        &self.config
    }
}

/// A stream of speech: push samples, pull rows.
pub struct CausalSpeech {
    model: Arc<CausalModel>,
    analyser: MelAnalyser,
    normaliser: RunningNormaliser,
    stem: HalvingState,
    fine: Vec<BlockState>,
    down: HalvingState,
    listen: Vec<BlockState>,
    perform: Vec<BlockState>,
    /// The further head that gives the rows, and its state. `None` for the main head.
    sooner: Option<(usize, BlockState)>,
    /// Seconds since somebody was last heard to speak.
    quiet_s: f64,
    /// Samples from the start of the next mel frame onwards.
    samples: VecDeque<f32>,
    pushed: u64,
    next_row: usize,
    /// Number of rows of the whole sound, once it has ended.
    total: Option<usize>,
    row: Vec<f32>,
    out: Vec<f32>,
}

impl CausalSpeech {
    /// Before any sound.
    pub fn new(model: Arc<CausalModel>) -> Self {
        Self::by(model, None)
    }

    /// The same with the rows of a further head, or of the main one for `None`.
    pub fn by(model: Arc<CausalModel>, head: Option<usize>) -> Self {
        // A further head predicts a later frame. This much silence before the sound makes its first
        // row the first frame's.
        let before = model.config.look_ahead_samples() - model.config.look_ahead_samples_of(head);
        let states = |blocks: &[CausalBlock]| blocks.iter().map(CausalBlock::state).collect();
        CausalSpeech {
            analyser: MelAnalyser::new(),
            normaliser: RunningNormaliser::new(&model.config.normaliser),
            stem: model.stem.state(),
            fine: states(&model.fine),
            down: model.down.state(),
            listen: states(&model.listen),
            perform: states(&model.perform),
            sooner: head.map(|number| (number, model.sooner[number].block.state())),
            quiet_s: f64::INFINITY,
            samples: VecDeque::from(vec![0.0; FRAME / 2 + before]),
            pushed: 0,
            next_row: 0,
            total: None,
            row: vec![0.0; model.config.channels],
            out: vec![0.0; model.config.outputs],
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

    /// Takes samples `[S]`, mono at 16 kHz.
    ///
    /// # Errors
    /// `Audio` if a sample is not finite (then none is taken); `InvalidInput` after
    /// [`CausalSpeech::finish`].
    pub fn push(&mut self, samples: &[f32]) -> Result<()> {
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

    /// Ends the sound. Silence follows it, so that the last rows have their look-ahead.
    ///
    /// # Errors
    /// `InvalidInput` if the stream was finished before.
    pub fn finish(&mut self) -> Result<()> {
        self.check_open("finish")?;
        let frame = SAMPLES_PER_FRAME as u64;
        self.total = Some(self.pushed.div_ceil(frame) as usize);
        let silence = self.model.config.look_ahead_samples() + FRAME;
        self.samples.extend(std::iter::repeat_n(0.0, silence));
        Ok(())
    }

    /// The next row `[outputs]`, if enough sound has come for it. Also calls `listener` with the
    /// samples around every 10 ms, in order.
    pub fn pull(&mut self, mut listener: impl FnMut(&[f32; FRAME])) -> Option<&[f32]> {
        if self.total.is_some_and(|total| self.next_row >= total) {
            return None;
        }
        loop {
            let mut mel = self.next_mel(&mut listener)?;
            let is_active = self.normaliser.hear(&mut mel);
            self.quiet_s = if is_active { 0.0 } else { self.quiet_s + MEL_S };
            if self.listen(&mel).is_some() {
                return Some(self.say());
            }
        }
    }

    /// The features `[C]` from which the last row was read.
    pub fn hidden(&self) -> &[f32] {
        &self.row
    }

    /// Whether the main head gives the rows, which looks ahead farthest.
    pub fn has_main_head(&self) -> bool {
        self.sooner.is_none()
    }

    /// Index of the row that [`CausalSpeech::pull`] gives next.
    pub fn next_row(&self) -> usize {
        self.next_row
    }

    /// Seconds since somebody was last heard to speak; infinite before anybody has spoken.
    pub fn quiet_s(&self) -> f64 {
        self.quiet_s
    }

    /// Sizes and look-ahead.
    pub fn config(&self) -> &CausalConfig {
        &self.model.config
    }

    /// The network.
    pub fn model(&self) -> Arc<CausalModel> {
        Arc::clone(&self.model)
    }

    /// Whether any sample was pushed.
    pub fn has_heard(&self) -> bool {
        self.pushed > 0
    }

    /// Number of samples after a frame's time that its row waits for.
    pub fn look_ahead_samples(&self) -> usize {
        let head = self.sooner.as_ref().map(|(number, _)| *number);
        self.model.config.look_ahead_samples_of(head)
    }

    /// Raw log-mel of the next 10 ms, if its samples have come.
    fn next_mel(&mut self, listener: &mut impl FnMut(&[f32; FRAME])) -> Option<[f32; BANDS]> {
        if self.samples.len() < FRAME {
            return None;
        }
        let mut stretch = [0.0; FRAME];
        for (to, from) in stretch.iter_mut().zip(&self.samples) {
            *to = *from;
        }
        self.samples.drain(..HOP);
        listener(&stretch);
        let mut mel = [0.0; BANDS];
        self.analyser.frame(&stretch, &mut mel);
        Some(mel)
    }

    /// Takes one mel frame. `Some` if it completes the look-ahead of a row; its features are in
    /// `row`.
    fn listen(&mut self, mel: &[f32; BANDS]) -> Option<()> {
        let model = &self.model;
        self.row
            .copy_from_slice(model.stem.step(&mut self.stem, mel)?);
        through(&model.fine, &mut self.fine, &mut self.row)?;
        let down = model.down.step(&mut self.down, &self.row)?;
        self.row.copy_from_slice(down);
        through(&model.listen, &mut self.listen, &mut self.row)
    }

    /// Turns the features in `row` into the next output row.
    fn say(&mut self) -> &[f32] {
        let model = &self.model;
        through(&model.perform, &mut self.perform, &mut self.row).expect("blocks that look back");
        let (norm, head) = match &mut self.sooner {
            None => (&model.norm, &model.head),
            Some((number, state)) => {
                let SoonerHead { block, norm, head } = &model.sooner[*number];
                through(
                    std::slice::from_ref(block),
                    std::slice::from_mut(state),
                    &mut self.row,
                )
                .expect("a block that looks back");
                (norm, head)
            }
        };
        norm.forward_rows(&mut self.row);
        head.forward_row(&self.row, &mut self.out);
        for ((x, std), mean) in self.out.iter_mut().zip(&model.std).zip(&model.mean) {
            *x = *x * std + mean;
        }
        self.next_row += 1;
        &self.out
    }
}
