//! The compact speech encoder: log-mel → features at 25 Hz, about 1.4 million parameters.
//!
//! Twin of `training/speech/compact.py`; a golden file checks that both agree. Output frame `i` is
//! centred on mel frame `4 i`, that is on second `i / 25`. A linear read-out of the features says
//! when the lips are together. Long sounds are encoded in spans. Each span has enough context on
//! both sides to give the same result as the whole sound at once.

use ndarray::{Array1, Array2, ArrayRef2, ArrayView2, Axis, Slice};

use super::{
    COMPACT_MODEL, FeatureTrack, SpeechEncoder,
    log_mel::{BANDS, log_mel},
    quantile::quantile,
    residual_block::{EPSILON, ResidualBlock, residual_blocks, same_length},
};
use crate::{
    Error, Result,
    audio::Waveform,
    job::{ProgressFn, report},
    models::Weights,
    nn::{
        conv::Conv1d,
        elementwise::{gelu_all, sigmoid},
        linear::Linear,
        norm::LayerNorm,
    },
};

const ACTIVE_QUANTILE: f64 = 0.95;
pub(crate) const ACTIVE_RANGE: f32 = 4.0;
pub(crate) const QUIETEST_LEVEL: f32 = -9.0;
pub(crate) const DEEPEST: f32 = -12.0;
pub(crate) const SCALE: f32 = 4.0;
/// Mel frames per output frame.
const STRIDE: usize = 4;
/// Output frames of a span, without its context.
const SPAN: usize = 1024;

/// Sizes of the encoder, as `config.json` states them.
#[derive(Debug, Clone, PartialEq, serde::Deserialize)]
pub struct CompactConfig {
    /// Name of the encoder.
    pub model: String,
    /// Mel bands; always [`BANDS`].
    pub bands: usize,
    /// Channels `C` of the features.
    pub channels: usize,
    /// Dilations of the blocks at 50 Hz.
    pub fine_dilations: Vec<usize>,
    /// Dilations of the blocks at 25 Hz.
    pub coarse_dilations: Vec<usize>,
    /// Output frames per second, which the strides determine; always 25.
    pub rate_hz: f64,
}

/// The default speech encoder.
pub struct CompactEncoder {
    config: CompactConfig,
    stem: Conv1d,
    fine: Vec<ResidualBlock>,
    down: Conv1d,
    coarse: Vec<ResidualBlock>,
    norm: LayerNorm,
    closure: Linear,
}

impl CompactEncoder {
    /// From the bytes of `model.safetensors` and the text of `config.json`.
    ///
    /// # Errors
    /// `Weights` if either is damaged or they do not fit each other.
    pub fn load(weights: &[u8], config: &str) -> Result<Self> {
        let bad = |e: &dyn std::fmt::Display| Error::Weights(format!("compact_speech: {e}"));
        let config: CompactConfig = serde_json::from_str(config).map_err(|e| bad(&e))?;
        if config.bands != BANDS || config.rate_hz != 25.0 {
            return Err(bad(&format!(
                "expected {BANDS} bands and 25 Hz, got {} and {} Hz",
                config.bands, config.rate_hz
            )));
        }
        CompactEncoder::of_weights(config, &Weights::from_bytes(weights)?)
    }

    /// From weights, for any number of bands.
    pub(super) fn of_weights(config: CompactConfig, weights: &Weights) -> Result<Self> {
        let channels = config.channels;
        let blocks = |name, dilations| residual_blocks(&weights.pp(name), channels, dilations);
        Ok(CompactEncoder {
            stem: same_length(&weights.pp("stem"), [channels, config.bands, 5], 2, 1)?,
            fine: blocks("fine", &config.fine_dilations)?,
            down: same_length(&weights.pp("down"), [channels, channels, 3], 2, 1)?,
            coarse: blocks("coarse", &config.coarse_dilations)?,
            norm: LayerNorm::load(&weights.pp("norm"), channels, EPSILON)?,
            closure: Linear::load(&weights.pp("closure"), channels, 1)?,
            config,
        })
    }

    /// Features of a normalised log-mel.
    ///
    /// `mel`: `[T, 64]` from [`normalise`]. Returns `[⌈⌈T/2⌉/2⌉, C]`.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn forward(
        &self,
        mel: ArrayView2<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let frames = mel.nrows().div_ceil(STRIDE);
        let context = self.context();
        let mut out = Array2::zeros((frames, self.config.channels));
        for start in (0..frames).step_by(SPAN) {
            report(progress, "speech", start as f32 / frames as f32)?;
            let end = (start + SPAN).min(frames);
            let first = start.saturating_sub(context);
            let last = ((end + context) * STRIDE).min(mel.nrows());
            let rows = |from: usize, to: usize| Slice::from(from..to);
            let features = self.forward_span(&mel.slice_axis(Axis(0), rows(first * STRIDE, last)));
            out.slice_axis_mut(Axis(0), rows(start, end))
                .assign(&features.slice_axis(Axis(0), rows(start - first, end - first)));
        }
        Ok(out)
    }

    /// Number of output frames on either side that one output frame depends on.
    fn context(&self) -> usize {
        let coarse: usize = self.config.coarse_dilations.iter().sum();
        let fine: usize = self.config.fine_dilations.iter().sum();
        // The fine blocks and the strided step run at 50 Hz. The stem's 2 mel frames are rounded up.
        coarse + (fine + 1).div_ceil(2) + 1
    }

    /// The same for one span by itself, `[T, bands]`.
    pub(super) fn forward_span(&self, mel: &ArrayRef2<f32>) -> Array2<f32> {
        let mut x = self.stem.forward_then(mel, gelu_all);
        for block in &self.fine {
            block.forward_in_place(&mut x);
        }
        let mut x = self.down.forward_then(&x, gelu_all);
        for block in &self.coarse {
            block.forward_in_place(&mut x);
        }
        self.norm.forward_in_place(&mut x);
        x
    }
}

impl SpeechEncoder for CompactEncoder {
    fn name(&self) -> &'static str {
        COMPACT_MODEL.name
    }

    fn channels(&self) -> usize {
        self.config.channels
    }

    fn closed_lips(&self, features: ArrayView2<'_, f32>) -> Option<Vec<f32>> {
        let logits = self.closure.forward(&features);
        Some(logits.into_iter().map(sigmoid).collect())
    }

    fn encode(&self, waveform: &Waveform, progress: ProgressFn<'_>) -> Result<FeatureTrack> {
        if waveform.samples.is_empty() {
            return Err(Error::Audio("expected sound, got no samples".into()));
        }
        let mel = normalise(log_mel(&waveform.samples));
        Ok(FeatureTrack {
            features: self.forward(mel.view(), progress)?,
            rate_hz: self.config.rate_hz,
            first_s: 0.0,
        })
    }
}

/// Removes loudness, microphone and voice colour from one clip.
///
/// The level of a frame is its mean over bands. Frames within 4 nepers (of power) of the 95 %
/// quantile of levels are active (quantile with linear interpolation). Each band's mean over the
/// active frames is subtracted. If the mean of these means is below −9, all of them are first raised
/// by the same amount to bring it to −9, so that near-silence is not amplified. Then values below
/// −12 become −12, and the result is divided by 4.
///
/// `mel`: `[T, 64]` from [`log_mel`], at least one frame. Returns the same shape, unitless.
pub fn normalise(mut mel: Array2<f32>) -> Array2<f32> {
    let bands = mel.ncols() as f32;
    let levels: Vec<f32> = mel
        .rows()
        .into_iter()
        .map(|row| row.sum() / bands)
        .collect();
    let threshold = quantile(&levels, ACTIVE_QUANTILE) - ACTIVE_RANGE;
    // Sums in double precision: an hour has 360,000 frames.
    let mut colour = Array1::<f64>::zeros(mel.ncols());
    let mut active = 0.0;
    for (row, level) in mel.rows().into_iter().zip(&levels) {
        if *level >= threshold {
            colour.zip_mut_with(&row, |sum, x| *sum += f64::from(*x));
            active += 1.0;
        }
    }
    let colour = colour.mapv(|sum| (sum / active) as f32);
    let raise = (QUIETEST_LEVEL - colour.sum() / bands).max(0.0);
    for mut row in mel.axis_iter_mut(Axis(0)) {
        row.zip_mut_with(&colour, |x, c| *x = (*x - c - raise).max(DEEPEST) / SCALE);
    }
    mel
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{audio::SAMPLE_RATE_HZ, job::SILENT};
    use safetensors::{SafeTensors, tensor::TensorView};
    use std::collections::HashMap;

    fn golden(name: &str) -> Vec<u8> {
        let path = format!("{}/../tests/goldens/{name}", env!("CARGO_MANIFEST_DIR"));
        std::fs::read(path).unwrap()
    }

    fn array(file: &SafeTensors<'_>, name: &str) -> Array2<f32> {
        let view = file.tensor(name).unwrap();
        let shape = (view.shape()[0], view.shape().get(1).copied().unwrap_or(1));
        Array2::from_shape_vec(shape, floats(&view)).unwrap()
    }

    fn floats(view: &TensorView<'_>) -> Vec<f32> {
        view.data()
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect()
    }

    fn largest_difference(a: &Array2<f32>, b: &Array2<f32>) -> f32 {
        assert_eq!(a.dim(), b.dim());
        let pairs = a.iter().zip(b);
        pairs.fold(0.0, |most, (x, y)| most.max((x - y).abs()))
    }

    fn debug_encoder() -> (CompactEncoder, Vec<u8>) {
        let bytes = golden("compact_speech_debug.safetensors");
        let (_, metadata) = SafeTensors::read_metadata(&bytes).unwrap();
        let config = metadata.metadata().as_ref().unwrap()["config"].clone();
        let weights = weights_alone(&bytes);
        (CompactEncoder::load(&weights, &config).unwrap(), bytes)
    }

    fn weights_alone(bytes: &[u8]) -> Vec<u8> {
        let file = SafeTensors::deserialize(bytes).unwrap();
        let weights: HashMap<String, TensorView<'_>> = file
            .tensors()
            .into_iter()
            .filter_map(|(name, view)| Some((name.strip_prefix("weights.")?.to_string(), view)))
            .collect();
        safetensors::serialize(&weights, None).unwrap()
    }

    #[test]
    fn log_mel_matches_the_training_code() {
        let bytes = golden("log_mel_debug.safetensors");
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let samples = floats(&file.tensor("input").unwrap());
        let mel = log_mel(&samples);
        // The chirp leaves some bands 100 dB down, where FFTs in single precision disagree.
        assert!(largest_difference(&mel, &array(&file, "output")) < 1e-3);
        assert!(largest_difference(&normalise(mel), &array(&file, "normalised")) < 1e-3);
    }

    #[test]
    fn features_match_the_training_code() {
        let (encoder, bytes) = debug_encoder();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let mel = normalise(array(&file, "input"));
        let features = encoder.forward(mel.view(), SILENT).unwrap();
        assert!(largest_difference(&features, &array(&file, "output")) < 1e-4);
        let closed = encoder.closed_lips(features.view()).unwrap();
        let known = floats(&file.tensor("closed").unwrap());
        assert!(closed.iter().zip(known).all(|(a, b)| (a - b).abs() < 1e-4));
    }

    #[test]
    fn spans_give_the_same_as_the_whole() {
        let (encoder, _) = debug_encoder();
        let frames = 2 * SPAN * STRIDE + 77;
        let mel = Array2::from_shape_fn((frames, BANDS), |(t, b)| {
            ((t * 7 + b * 13) % 101) as f32 / 50.0 - 1.0
        });
        let whole = encoder.forward_span(&mel);
        let spans = encoder.forward(mel.view(), SILENT).unwrap();
        assert!(largest_difference(&whole, &spans) < 1e-5);
    }

    #[test]
    fn one_sample_and_silence_give_finite_features() {
        let (encoder, _) = debug_encoder();
        for samples in [vec![0.3; 1], vec![0.0; SAMPLE_RATE_HZ as usize / 50]] {
            let track = encoder.encode(&Waveform { samples }, SILENT).unwrap();
            assert_eq!(track.features.dim(), (1, encoder.channels()));
            assert!(track.features.iter().all(|x| x.is_finite()));
        }
    }

    #[test]
    fn a_clip_far_too_quiet_stays_quiet() {
        let mel = Array2::from_elem((50, BANDS), -13.0);
        assert!(normalise(mel).iter().all(|x| *x == -1.0));
    }

    #[test]
    fn damaged_weights_are_refused() {
        let (encoder, bytes) = debug_encoder();
        let weights = weights_alone(&bytes);
        let config = |channels: usize| {
            format!(
                r#"{{"model":"compact_speech","bands":64,"channels":{channels},"fine_dilations":[1],"coarse_dilations":[1,2],"rate_hz":25.0}}"#
            )
        };
        assert_eq!(encoder.channels(), 16);
        assert!(CompactEncoder::load(&weights, &config(16)).is_ok());
        let refused = [
            CompactEncoder::load(&weights[..weights.len() / 2], &config(16)),
            CompactEncoder::load(&weights, &config(32)),
            CompactEncoder::load(&weights, "{"),
            CompactEncoder::load(&[], &config(16)),
        ];
        for result in refused {
            assert!(matches!(result, Err(Error::Weights(_))));
        }
    }
}
