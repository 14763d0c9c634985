//! Whisper's encoder (Radford et al. 2022) from a user's Hugging Face folder.
//!
//! Twin of `training/speech/whisper.py`. Unlike Whisper's own programs, it does not pad sounds to
//! 30 s. So the features do not depend on silence after the sound, and a short sound costs little.

use std::path::Path;

use ndarray::{Array1, Array2, ArrayRef2, Axis, Slice, s};
use serde::Deserialize;

use super::{
    FeatureTrack, SpeechEncoder,
    whisper_mel::{BANDS, whisper_mel},
};
use crate::{
    Error, Result,
    audio::Waveform,
    job::{InputKind, ProgressFn, read_text, report},
    models::{
        Weights,
        checkpoint::{self, check_sizes},
    },
    nn::{
        attention::SelfAttention, conv::Conv1d, elementwise::gelu_all, linear::Linear,
        norm::LayerNorm,
    },
};

/// Features a second.
pub(super) const RATE_HZ: f64 = 50.0;
/// Features that are computed together: 12 s.
const SPAN: usize = 600;
/// Features of context on either side of a span: 1.5 s.
const CONTEXT: usize = 75;
/// Frames of log-mel per feature.
const STRIDE: usize = 2;
const EPSILON: f32 = 1e-5;
/// Copies of one checkpoint's bias differ by less than this, even if one of them is in f16.
const BIAS_TOLERANCE: f32 = 1e-3;
/// The first feature needs at least this many samples.
const LEAST_SAMPLES: usize = 400;

/// The part of a Hugging Face `config.json` that the encoder needs.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Config {
    model_type: String,
    d_model: usize,
    encoder_layers: usize,
    encoder_attention_heads: usize,
    encoder_ffn_dim: usize,
    num_mel_bins: usize,
    max_source_positions: usize,
    #[serde(default = "gelu_name")]
    activation_function: String,
}

fn gelu_name() -> String {
    "gelu".into()
}

impl Config {
    fn check(&self) -> std::result::Result<(), String> {
        for (name, expected, got) in [
            ("model_type", "whisper", &self.model_type),
            ("activation_function", "gelu", &self.activation_function),
        ] {
            if got != expected {
                return Err(format!("{name}: expected {expected}, got {got}"));
            }
        }
        if self.num_mel_bins != BANDS {
            let got = self.num_mel_bins;
            return Err(format!("num_mel_bins: expected {BANDS}, got {got}"));
        }
        let (least, got) = (SPAN + 2 * CONTEXT, self.max_source_positions);
        if got < least {
            return Err(format!(
                "max_source_positions: expected {least} or more, got {got}"
            ));
        }
        check_sizes(&[
            ("d_model", self.d_model, 16_384),
            ("encoder_layers", self.encoder_layers, 256),
            ("encoder_attention_heads", self.encoder_attention_heads, 256),
            ("encoder_ffn_dim", self.encoder_ffn_dim, 65_536),
            ("max_source_positions", got, 100_000),
        ])
    }
}

/// Two convolutions, position embeddings and transformer layers.
pub struct Whisper {
    first: Conv1d,
    second: Conv1d,
    /// `[max_source_positions, C]`
    places: Array2<f32>,
    layers: Vec<Layer>,
    norm: LayerNorm,
    /// Number of layers that run. The norm only follows the last layer of the whole model.
    depth: usize,
}

impl Whisper {
    /// Reads `config.json` and the weights as [`super::from_folder`] does. Ignores a decoder beside
    /// the encoder.
    ///
    /// `layer` chooses the result: 0 is before the first layer, `None` is the output, which has the
    /// final norm.
    ///
    /// # Errors
    /// `Io` if a file cannot be read; `Weights` if one is damaged, they do not fit each other, or the folder holds
    /// another model; `InvalidInput` for a layer that does not exist.
    pub fn load_folder(folder: &Path, layer: Option<usize>) -> Result<Self> {
        let text = read_text(&folder.join("config.json"), InputKind::Text)?;
        Self::load(&text, &checkpoint::read(folder)?, layer)
    }

    /// Like [`Whisper::load_folder`], from the text of `config.json` and the weights under the
    /// checkpoint's own names.
    ///
    /// # Errors
    /// Those of [`Whisper::load_folder`].
    pub fn load(config: &str, weights: &Weights, layer: Option<usize>) -> Result<Self> {
        let wrong = |complaint: String| Error::Weights(format!("config.json: {complaint}"));
        let config: Config = serde_json::from_str(config).map_err(|e| wrong(e.to_string()))?;
        config.check().map_err(wrong)?;
        if let Some(layer) = layer.filter(|layer| *layer > config.encoder_layers) {
            return Err(Error::InvalidInput(format!(
                "layer: expected 0 to {}, got {layer}",
                config.encoder_layers
            )));
        }
        // In models that also write text, the encoder lies one level down.
        let weights = match weights.contains("encoder.conv1.weight") {
            true => weights.pp("encoder"),
            false => weights.pp("model.encoder"),
        };
        let width = config.d_model;
        let conv = |name: &str, inputs, stride| {
            let conv = Conv1d::load(&weights.pp(name), [width, inputs, 3], stride, true)?;
            Ok::<_, Error>(conv.padded(1))
        };
        Ok(Whisper {
            first: conv("conv1", BANDS, 1)?,
            second: conv("conv2", width, STRIDE)?,
            places: weights.matrix("embed_positions.weight", config.max_source_positions, width)?,
            layers: (0..config.encoder_layers)
                .map(|i| Layer::load(&weights.pp("layers").pp(i), &config))
                .collect::<Result<_>>()?,
            norm: LayerNorm::load(&weights.pp("layer_norm"), width, EPSILON)?,
            depth: layer.unwrap_or(config.encoder_layers),
        })
    }

    /// Number of layers of the model.
    pub(super) fn layers(&self) -> usize {
        self.layers.len()
    }

    /// Whether the weights belong to a checkpoint whose first convolution has this bias, `[C]`.
    pub(super) fn has_first_bias(&self, bias: &Array1<f32>) -> bool {
        let first_bias = self.first.bias();
        first_bias.len() == bias.len()
            && (first_bias - bias)
                .iter()
                .all(|apart| apart.abs() < BIAS_TOLERANCE)
    }

    /// The outputs of `layers`, in their order, for log-mel `[T, 80]` at 100 Hz. Runs in one piece.
    /// Each output is `[⌈T / 2⌉, C]`.
    ///
    /// `layers` must exist and ascend. Layers above the highest of them are not computed.
    fn run(&self, mel: &ArrayRef2<f32>, layers: &[usize]) -> Vec<Array2<f32>> {
        let x = self.first.forward_then(mel, gelu_all);
        let mut x = self.second.forward_then(&x, gelu_all);
        x += &self.places.slice(s![..x.nrows(), ..]);
        let (mut depth, mut outputs) = (0, Vec::with_capacity(layers.len()));
        for &layer in layers {
            for next in &self.layers[depth..layer] {
                x = next.forward(x);
            }
            depth = layer;
            let mut output = x.clone();
            if layer == self.layers.len() {
                self.norm.forward_in_place(&mut output);
            }
            outputs.push(output);
        }
        outputs
    }

    /// The outputs of `layers`, ascending, for a sound, `[T, C]` each at 50 Hz. Computes them in
    /// spans of 12 s with 1.5 s of context on either side.
    ///
    /// # Errors
    /// `Audio` for a sound shorter than 25 ms; `Cancelled`.
    pub(super) fn hear(
        &self,
        waveform: &Waveform,
        layers: &[usize],
        progress: ProgressFn<'_>,
    ) -> Result<Vec<Array2<f32>>> {
        let got = waveform.samples.len();
        if got < LEAST_SAMPLES {
            return Err(Error::Audio(format!(
                "expected at least {LEAST_SAMPLES} samples at 16 kHz, got {got}"
            )));
        }
        let mel = whisper_mel(&waveform.samples);
        let total = mel.nrows().div_ceil(STRIDE);
        let mut features = vec![Array2::zeros((total, self.channels())); layers.len()];
        let mut start = 0;
        while start < total {
            report(progress, "speech", start as f32 / total as f32)?;
            let end = match total - start < SPAN + CONTEXT {
                true => total,
                false => start + SPAN,
            };
            let first = start.saturating_sub(CONTEXT);
            let last = (end + CONTEXT).min(total);
            let window = Slice::from(STRIDE * first..(STRIDE * last).min(mel.nrows()));
            let heard = self.run(&mel.slice_axis(Axis(0), window), layers);
            for (to, from) in features.iter_mut().zip(heard) {
                to.slice_mut(s![start..end, ..])
                    .assign(&from.slice(s![start - first..end - first, ..]));
            }
            start = end;
        }
        Ok(features)
    }
}

impl SpeechEncoder for Whisper {
    fn name(&self) -> &'static str {
        "whisper"
    }

    fn channels(&self) -> usize {
        self.places.ncols()
    }

    fn encode(&self, waveform: &Waveform, progress: ProgressFn<'_>) -> Result<FeatureTrack> {
        let mut outputs = self.hear(waveform, &[self.depth], progress)?;
        Ok(FeatureTrack {
            features: outputs.pop().expect("one layer"),
            rate_hz: RATE_HZ,
            first_s: 0.0,
        })
    }
}

/// Attention and feed-forward, each after a norm.
struct Layer {
    attention_norm: LayerNorm,
    attention: SelfAttention,
    feed_norm: LayerNorm,
    wide: Linear,
    narrow: Linear,
}

impl Layer {
    fn load(weights: &Weights, config: &Config) -> Result<Self> {
        let (width, inner) = (config.d_model, config.encoder_ffn_dim);
        let (attention, heads) = (weights.pp("self_attn"), config.encoder_attention_heads);
        let norm = |name| LayerNorm::load(&weights.pp(name), width, EPSILON);
        Ok(Layer {
            attention_norm: norm("self_attn_layer_norm")?,
            attention: SelfAttention::load_without_key_bias(&attention, width, heads)?,
            feed_norm: norm("final_layer_norm")?,
            wide: Linear::load(&weights.pp("fc1"), width, inner)?,
            narrow: Linear::load(&weights.pp("fc2"), inner, width)?,
        })
    }

    fn forward(&self, mut x: Array2<f32>) -> Array2<f32> {
        x += &self.attention.forward(&self.attention_norm.forward(&x));
        let inner = self
            .wide
            .forward_then(&self.feed_norm.forward(&x), gelu_all);
        x += &self.narrow.forward(&inner);
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        job::SILENT,
        nn::golden::{Golden, distance},
        speech::from_folder,
    };

    fn encoder(golden: &Golden, layer: Option<usize>) -> Whisper {
        Whisper::load(&golden.metadata("config"), &golden.weights(), layer).unwrap()
    }

    fn heard(golden: &Golden) -> Waveform {
        Waveform {
            samples: golden.values("input"),
        }
    }

    #[test]
    fn the_output_and_a_layer_are_those_of_training() {
        let golden = Golden::open("whisper_tiny");
        for (name, layer) in [("output", None), ("layer_1", Some(1)), ("layer_0", Some(0))] {
            let track = encoder(&golden, layer)
                .encode(&heard(&golden), SILENT)
                .unwrap();
            let error = distance(&track.features, &golden.values(name));
            assert!(error < 1e-4, "{name}: {error}");
            assert_eq!((track.rate_hz, track.first_s), (50.0, 0.0));
        }
    }

    #[test]
    fn spans_join_where_the_whole_would_not_differ_much() {
        let golden = Golden::open("whisper_tiny");
        let model = encoder(&golden, None);
        let second = heard(&golden).samples;
        let samples: Vec<f32> = second.iter().copied().cycle().take(16_000 * 14).collect();
        let whole = model.run(&whisper_mel(&samples), &[model.depth]).remove(0);
        let parts = model
            .encode(&Waveform { samples }, SILENT)
            .unwrap()
            .features;
        assert_eq!(parts.dim(), whole.dim());
        // With random weights attention is broad, so sound beyond the context counts a little.
        let mean = (&parts - &whole).mapv(f32::abs).mean().unwrap();
        assert!(mean < 0.2, "{mean}");
    }

    #[test]
    fn too_short_a_sound_and_another_model_are_refused_with_both_sides() {
        let golden = Golden::open("whisper_tiny");
        let short = Waveform {
            samples: vec![0.1; 399],
        };
        let said = encoder(&golden, None).encode(&short, SILENT).unwrap_err();
        assert!(said.to_string().contains("at least 400 samples"), "{said}");
        let load = |config: &str, layer| {
            let result = Whisper::load(config, &golden.weights(), layer);
            result.err().expect("refused").to_string()
        };
        let config = golden.metadata("config");
        let said = load(
            &config.replace("\"num_mel_bins\": 80", "\"num_mel_bins\": 128"),
            None,
        );
        assert!(
            said.contains("num_mel_bins: expected 80, got 128"),
            "{said}"
        );
        let said = load(&config, Some(3));
        assert!(said.contains("layer: expected 0 to 2, got 3"), "{said}");
        let said = load(&config.replace("\"whisper\"", "\"bark\""), None);
        assert!(
            said.contains("model_type: expected whisper, got bark"),
            "{said}"
        );
    }

    #[test]
    #[ignore = "needs Whisper base as Hugging Face has it (ANYFACE_WHISPER) and ../shared"]
    fn the_real_encoder_gives_the_numbers_of_ctranslate2() {
        // Features 0, 137, 274, … of jfk.wav, first four channels, by ctranslate2 4.8.5 in float32.
        let expected = [
            [-1.8456, 0.1496, -1.3777, -0.7869],
            [-1.3885, -0.5401, 0.4337, 0.2675],
            [0.8157, -0.1380, 0.0765, 0.2754],
            [-0.1228, -0.2779, 0.1954, 0.9242],
            [-0.2246, 0.5254, 1.1761, -0.1614f32],
        ];
        let Some(folder) = std::env::var_os("ANYFACE_WHISPER") else {
            return;
        };
        let shared = std::env::var_os("ANYFACE_SHARED").expect("ANYFACE_SHARED");
        let encoder = from_folder(Path::new(&folder), None, None).unwrap();
        let sound = Path::new(&shared).join("data/clips/jfk.wav");
        let track = encoder
            .encode(&Waveform::from_file(&sound).unwrap(), SILENT)
            .unwrap();
        for (row, expected) in expected.iter().enumerate() {
            for (channel, value) in expected.iter().enumerate() {
                let got = track.features[[137 * row, channel]];
                assert!(
                    (got - value).abs() < 2e-3,
                    "[{row}, {channel}]: {got} {value}"
                );
            }
        }
    }
}
