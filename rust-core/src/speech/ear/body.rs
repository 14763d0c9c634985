//! The trained part of the ear: outputs of Whisper's first layers → features at half their rate.
//!
//! Twin of `EarBody` in `training/speech/ear.py`.

use ndarray::{Array2, ArrayRef2};
use serde::Deserialize;

use crate::{
    Error, Result,
    models::Weights,
    nn::{
        elementwise::{gelu_all, vectorised},
        linear::Linear,
        matrix,
    },
    speech::{residual_block::ResidualStack, whisper_trunk::RATE_HZ},
};

/// Rows of the trunk per output frame.
pub(super) const FEATURES_EACH: usize = 2;
/// Inputs are clipped at this many standard deviations, because a few channels of Whisper's inner
/// layers have enormous values.
const LARGEST: f32 = 6.0;
const MODEL: &str = "ear";

/// Sizes of the body, as `config.json` states them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct EarConfig {
    /// Name of the encoder.
    pub model: String,
    /// Layers of the trunk whose outputs the body reads, ascending; 0 is before the first layer.
    pub taps: Vec<usize>,
    /// Channels of the trunk.
    pub width: usize,
    /// Channels `C` of the features.
    pub channels: usize,
    /// Dilations of the blocks at 50 Hz.
    pub fine_dilations: Vec<usize>,
    /// Dilations of the blocks at 25 Hz.
    pub coarse_dilations: Vec<usize>,
    /// Output frames per second, which the stride determines; always 25.
    pub rate_hz: f64,
}

impl EarConfig {
    /// Checks that the body stands on a trunk of this width with this many layers.
    ///
    /// # Errors
    /// `Weights`, naming both sides.
    pub(super) fn check(&self, width: usize, layers: usize) -> Result<()> {
        let last = self.taps.last().copied().unwrap_or(usize::MAX);
        if self.taps.windows(2).any(|pair| pair[0] >= pair[1]) || last > layers {
            return Err(bad(format!(
                "taps: expected ascending numbers up to {layers}, got {:?}",
                self.taps
            )));
        }
        if self.width == width {
            Ok(())
        } else {
            Err(bad(format!(
                "width: expected that of the trunk, {width}, got {}",
                self.width
            )))
        }
    }
}

fn bad(what: impl std::fmt::Display) -> Error {
    Error::Weights(format!("{MODEL}: {what}"))
}

/// A linear layer, residual blocks at 50 Hz, a strided convolution, and residual blocks at 25 Hz.
pub(super) struct EarBody {
    config: EarConfig,
    /// Mean of each channel of each tap, `[K, width]`.
    mean: Array2<f32>,
    /// Standard deviation of each channel of each tap, `[K, width]`.
    deviation: Array2<f32>,
    enter: Linear,
    stack: ResidualStack,
}

impl EarBody {
    /// From weights and the text of `config.json`.
    ///
    /// # Errors
    /// `Weights` if they do not fit each other.
    pub fn load(weights: &Weights, config: &str) -> Result<Self> {
        let config: EarConfig = serde_json::from_str(config).map_err(bad)?;
        let rate_hz = RATE_HZ / FEATURES_EACH as f64;
        if config.model != MODEL || config.rate_hz != rate_hz {
            return Err(bad(format!(
                "expected {MODEL} and {rate_hz} Hz, got {} and {} Hz",
                config.model, config.rate_hz
            )));
        }
        let (taps, width, channels) = (config.taps.len(), config.width, config.channels);
        let deviation = weights.matrix("deviation", taps, width)?;
        if let Some(got) = deviation.iter().find(|x| **x <= 0.0) {
            return Err(bad(format!(
                "deviation: expected positive numbers, got {got}"
            )));
        }
        let dilations = [&config.fine_dilations[..], &config.coarse_dilations];
        Ok(EarBody {
            mean: weights.matrix("mean", taps, width)?,
            deviation,
            enter: Linear::load(&weights.pp("enter"), taps * width, channels)?,
            stack: ResidualStack::load(weights, channels, dilations)?,
            config,
        })
    }

    pub fn config(&self) -> &EarConfig {
        &self.config
    }

    /// Number of output frames on either side that one output frame depends on.
    pub fn context(&self) -> usize {
        let coarse: usize = self.config.coarse_dilations.iter().sum();
        let fine: usize = self.config.fine_dilations.iter().sum();
        // The fine blocks and the strided step run at 50 Hz. Another frame covers rows that the end
        // of a span cuts in half.
        coarse + (fine + 1).div_ceil(FEATURES_EACH) + 1
    }

    /// The rows that enter the convolutions, `[T, C]`, from the outputs of the taps, `[T, width]`
    /// each.
    pub fn enter(&self, outputs: &[Array2<f32>]) -> Array2<f32> {
        let (rows, columns) = (outputs[0].nrows(), self.enter.inputs());
        let joint = matrix::by_row_blocks(rows, columns, |rows, out| {
            for (row, out) in rows.zip(out.chunks_exact_mut(columns)) {
                for (tap, out) in out.chunks_exact_mut(self.config.width).enumerate() {
                    let heard = &matrix::values(&outputs[tap])[row * out.len()..][..out.len()];
                    self.standardise(tap, heard, out);
                }
            }
        });
        self.enter.forward_then(&joint, gelu_all)
    }

    /// Writes a row of a tap with mean 0 and deviation 1 in each channel.
    fn standardise(&self, tap: usize, heard: &[f32], out: &mut [f32]) {
        let of_tap = |statistic| &matrix::values(statistic)[tap * out.len()..][..out.len()];
        let (mean, deviation) = (of_tap(&self.mean), of_tap(&self.deviation));
        vectorised(
            #[inline(always)]
            || {
                let statistics = mean.iter().zip(deviation);
                for ((out, x), (mean, deviation)) in out.iter_mut().zip(heard).zip(statistics) {
                    *out = ((x - mean) / deviation).clamp(-LARGEST, LARGEST);
                }
            },
        );
    }

    /// Features of the rows of [`EarBody::enter`]: `[T, C]` → `[⌈T / 2⌉, C]`.
    pub fn forward(&self, rows: &ArrayRef2<f32>) -> Array2<f32> {
        self.stack.forward(rows.to_owned())
    }
}
