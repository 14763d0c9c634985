//! Sizes of a causal network, and the look-ahead that follows from them.

use crate::{
    Error, Result,
    audio::SAMPLE_RATE_HZ,
    speech::{BANDS, FRAME, HOP},
};

/// Mel frames per motion frame.
pub(super) const MEL_PER_FRAME: usize = 4;
/// Samples from one motion frame to the next.
pub(super) const SAMPLES_PER_FRAME: usize = MEL_PER_FRAME * HOP;
/// Taps of every convolution except the stem.
pub(super) const TAPS: usize = 3;
pub(super) const STEM_TAPS: usize = 5;
/// Taps of the stem after the current frame.
pub(super) const STEM_AHEAD: usize = 2;
/// Taps of the step to 25 Hz after the current frame.
pub(super) const DOWN_AHEAD: usize = 1;
/// The longest look-ahead that a model may have.
const MAX_LOOK_AHEAD_S: f64 = 0.2;
/// How much longer a head's real look-ahead may be than the requested one, because people round.
const ROUNDING_S: f64 = 0.005;

/// Sizes of the network, as `config.json` states them.
#[derive(Debug, Clone, PartialEq, serde::Deserialize)]
pub struct CausalConfig {
    /// Name of the model. Its error messages begin with this name.
    pub model: String,
    /// Numbers per frame.
    pub outputs: usize,
    /// Frames per second; always 25.
    pub fps: f64,
    /// Mel bands; always [`BANDS`].
    pub bands: usize,
    /// Channels of every layer.
    pub channels: usize,
    /// Blocks at 50 Hz.
    pub fine: Vec<Block>,
    /// Blocks at 25 Hz that may look ahead.
    pub listen: Vec<Block>,
    /// Blocks at 25 Hz that only look back.
    pub perform: Vec<Block>,
    /// Constants of the running normalisation.
    pub normaliser: NormaliserConfig,
    /// One number for each further head: from the same sound, it predicts the frame this many
    /// frames after the main head's.
    #[serde(default)]
    pub sooner: Vec<usize>,
}

/// A residual block: 3 taps `dilation` apart, `ahead` of them after the current frame.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize)]
pub struct Block {
    /// Frames from tap to tap, at least 1.
    pub dilation: usize,
    /// 0 only looks back, 1 is centred.
    pub ahead: usize,
}

impl Block {
    /// Number of later frames that a frame depends on.
    pub(super) fn reach(&self) -> usize {
        self.ahead * self.dilation
    }
}

/// Constants of the running normalisation. Levels are nepers of power, counts are mel frames.
#[derive(Debug, Clone, PartialEq, serde::Deserialize)]
pub struct NormaliserConfig {
    /// `[64]`, mean log-mel that is assumed for the voice before any sound.
    pub prior_colour: Vec<f32>,
    /// Level of loud frames that is assumed before any sound.
    pub prior_peak: f32,
    /// Weight of the prior colour, as a number of active frames.
    pub prior_frames: f32,
    /// Number of active frames after which the mean begins to forget.
    pub memory_frames: f32,
    /// Number of active frames during which the peak takes longer steps.
    pub start_frames: f32,
    /// Step of the peak at the start.
    pub start_step: f32,
    /// Step of the peak later on.
    pub step: f32,
    /// How far the peak may stand above the colour's mean.
    pub peak_over_level: f32,
}

impl CausalConfig {
    /// From the text of `config.json`.
    ///
    /// # Errors
    /// `Weights` if it is unreadable or needs something that this code does not support.
    pub fn from_json(text: &str) -> Result<Self> {
        let config: CausalConfig =
            serde_json::from_str(text).map_err(|e| Error::Weights(format!("causal model: {e}")))?;
        match config.problem() {
            Some(problem) => Err(Error::Weights(format!("{}: {problem}", config.model))),
            None => Ok(config),
        }
    }

    fn problem(&self) -> Option<String> {
        let fixed = (self.fps, self.bands);
        let blocks = self.fine.iter().chain(&self.listen).chain(&self.perform);
        let expected = |what: &str, requirement: &str, got: String| {
            Some(format!("{what}: expected {requirement}, got {got}"))
        };
        if fixed != (25.0, BANDS) {
            expected("fps, bands", "25, 64", format!("{fixed:?}"))
        } else if self.channels == 0
            || self.outputs == 0
            || self.normaliser.prior_colour.len() != BANDS
        {
            let got = (
                self.channels,
                self.outputs,
                self.normaliser.prior_colour.len(),
            );
            expected(
                "channels, outputs, prior_colour",
                "some, some, 64",
                format!("{got:?}"),
            )
        } else if let Some(block) = blocks.clone().find(|b| b.dilation == 0 || b.ahead > 1) {
            expected(
                "block",
                "a dilation from 1 on and ahead 0 or 1",
                format!("{block:?}"),
            )
        } else if self.perform.iter().any(|block| block.ahead > 0) {
            expected(
                "perform",
                "blocks that look back only",
                format!("{:?}", self.perform),
            )
        } else if self.look_ahead_s() > MAX_LOOK_AHEAD_S {
            let got = format!("{} s", self.look_ahead_s());
            expected("look-ahead", "0.2 s at most", got)
        } else {
            None
        }
    }

    /// Number of mel frames after `4 t` that frame `t` depends on.
    fn mel_ahead(&self) -> usize {
        let reach = |blocks: &[Block]| blocks.iter().map(Block::reach).sum::<usize>();
        let fine = STEM_AHEAD + 2 * reach(&self.fine) + 2 * DOWN_AHEAD;
        fine + MEL_PER_FRAME * reach(&self.listen)
    }

    /// Frame `t` depends on samples below `640 t` plus this number. It includes half of a mel
    /// frame's window.
    pub fn look_ahead_samples(&self) -> usize {
        HOP * self.mel_ahead() + FRAME / 2
    }

    /// The same for a further head, or for the main one.
    pub fn look_ahead_samples_of(&self, head: Option<usize>) -> usize {
        let sooner = head.map_or(0, |number| SAMPLES_PER_FRAME * self.sooner[number]);
        self.look_ahead_samples().saturating_sub(sooner)
    }

    /// The head with the longest look-ahead of at most `seconds`, with 5 ms of tolerance because
    /// people round. `None` if every head looks further ahead.
    pub fn head_within(&self, seconds: f64) -> Option<Option<usize>> {
        let heads = std::iter::once(None).chain((0..self.sooner.len()).map(Some));
        let within = heads
            .filter(|head| seconds_of(self.look_ahead_samples_of(*head)) <= seconds + ROUNDING_S);
        within.max_by_key(|head| self.look_ahead_samples_of(*head))
    }

    /// Look-ahead of the main head, seconds.
    pub fn look_ahead_s(&self) -> f64 {
        seconds_of(self.look_ahead_samples())
    }
}

/// The duration of some samples.
pub(crate) fn seconds_of(samples: usize) -> f64 {
    samples as f64 / f64::from(SAMPLE_RATE_HZ)
}
