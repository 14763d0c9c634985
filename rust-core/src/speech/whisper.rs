//! Whisper's encoder (Radford et al. 2022) from a user's Hugging Face folder.
//!
//! Reads the folder; `whisper_trunk.rs` computes.

use std::path::Path;

use ndarray::Array2;
use serde::Deserialize;

use super::{
    FeatureTrack, SpeechEncoder,
    whisper_mel::{BANDS, whisper_mel},
    whisper_trunk::{EPSILON, PLACES, RATE_HZ, TrunkSizes, WhisperTrunk},
};
use crate::{
    Error, Result,
    audio::Waveform,
    job::{InputKind, ProgressFn, read_text},
    models::{
        Weights,
        checkpoint::{self, check_sizes},
    },
    nn::norm::LayerNorm,
};

/// The first feature needs at least this many samples.
pub(super) const LEAST_SAMPLES: usize = 400;

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
        let got = self.max_source_positions;
        if got < PLACES {
            return Err(format!(
                "max_source_positions: expected {PLACES} or more, got {got}"
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

/// The whole encoder: convolutions, positions, transformer layers, and a norm after the last.
pub struct Whisper {
    trunk: WhisperTrunk,
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
        let weights = if weights.contains("encoder.conv1.weight") {
            weights.pp("encoder")
        } else {
            weights.pp("model.encoder")
        };
        let sizes = TrunkSizes {
            width: config.d_model,
            heads: config.encoder_attention_heads,
            feedforward: config.encoder_ffn_dim,
            layers: config.encoder_layers,
        };
        Ok(Whisper {
            trunk: WhisperTrunk::of_checkpoint(&weights, sizes, config.max_source_positions)?,
            norm: LayerNorm::load(&weights.pp("layer_norm"), sizes.width, EPSILON)?,
            depth: layer.unwrap_or(sizes.layers),
        })
    }

    /// Number of layers of the model.
    fn layers(&self) -> usize {
        self.trunk.layers()
    }

    /// The outputs of `layers`, ascending, for a sound, `[T, C]` each at 50 Hz. Computes them in
    /// spans of 12 s with 1.5 s of context on either side.
    ///
    /// # Errors
    /// `Audio` for a sound shorter than 25 ms; `Cancelled`.
    fn hear(
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
        let mut features = self.trunk.hear_whole(&mel, layers, progress)?;
        for (layer, output) in layers.iter().zip(&mut features) {
            if *layer == self.layers() {
                self.norm.forward_in_place(output);
            }
        }
        Ok(features)
    }
}

impl SpeechEncoder for Whisper {
    fn name(&self) -> &'static str {
        "whisper"
    }

    fn channels(&self) -> usize {
        self.trunk.channels()
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
        let mel = whisper_mel(&samples);
        let mut whole = model.trunk.run(&mel, &[model.depth]).remove(0);
        model.norm.forward_in_place(&mut whole);
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
