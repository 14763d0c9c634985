//! The text tower of CLIP (Radford et al. 2021) from a user's Hugging Face folder. Cafe-Talk reads
//! texts with it (Chen et al. 2025, appendix E). Names of layers are the checkpoint's own.

use std::path::Path;

use ndarray::{Array1, Array2};
use serde::Deserialize;
use serde_json::Value;

use super::byte_pairs::BytePairs;
use crate::{
    Error, Result,
    job::{InputKind, read_text},
    models::{Weights, checkpoint},
    nn::{
        attention::{Reach, SelfAttention},
        elementwise::{gelu, sigmoid},
        linear::Linear,
        norm::LayerNorm,
    },
};

/// The fields of `config.json` that the text tower needs. Hugging Face leaves out a field whose
/// value is that of ViT-B/32.
#[derive(Debug, Deserialize)]
#[serde(default)]
struct Config {
    vocab_size: usize,
    hidden_size: usize,
    intermediate_size: usize,
    num_hidden_layers: usize,
    num_attention_heads: usize,
    max_position_embeddings: usize,
    projection_dim: usize,
    layer_norm_eps: f32,
    hidden_act: Activation,
}

impl Default for Config {
    fn default() -> Self {
        Config {
            vocab_size: 49_408,
            hidden_size: 512,
            intermediate_size: 2_048,
            num_hidden_layers: 12,
            num_attention_heads: 8,
            max_position_embeddings: 77,
            projection_dim: 512,
            layer_norm_eps: 1e-5,
            hidden_act: Activation::QuickGelu,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Activation {
    /// `x / (1 + e^(−1.702 x))`.
    QuickGelu,
    Gelu,
}

/// Turns a text into one place in CLIP's space.
#[derive(Debug, Clone)]
pub(super) struct ClipText {
    tokens: BytePairs,
    /// `[vocab_size, C]`.
    symbols: Array2<f32>,
    /// `[max_position_embeddings, C]`.
    positions: Array2<f32>,
    layers: Vec<Layer>,
    norm: LayerNorm,
    projection: Linear,
}

#[derive(Debug, Clone)]
struct Layer {
    norm1: LayerNorm,
    attention: SelfAttention,
    norm2: LayerNorm,
    fc1: Linear,
    fc2: Linear,
    activation: Activation,
}

impl ClipText {
    /// Reads `config.json`, `vocab.json`, `merges.txt`, and `model.safetensors` or
    /// `pytorch_model.bin`. The weights of the image tower may be in the same file.
    ///
    /// # Errors
    /// `Io` if a file cannot be read. `Weights` if a file is damaged, if the files do not fit each
    /// other, or if the folder holds another model.
    pub(super) fn load_folder(folder: &Path) -> Result<Self> {
        let path = folder.join("config.json");
        let text = read_text(&path, InputKind::Text)?;
        let config = Config::read(&text)
            .map_err(|what| Error::Weights(format!("{}: {what}", path.display())))?;
        let tokens = BytePairs::load_folder(folder, config.vocab_size)?;
        let named =
            |e: Error| Error::Weights(format!("{}: CLIP's text tower: {e}", folder.display()));
        ClipText::new(&config, &checkpoint::read(folder)?, tokens).map_err(named)
    }

    fn new(config: &Config, weights: &Weights, tokens: BytePairs) -> Result<Self> {
        let (width, most) = (config.hidden_size, config.max_position_embeddings);
        let text = weights.pp("text_model");
        let places = text.pp("embeddings");
        let projection = weights.matrix("text_projection.weight", config.projection_dim, width)?;
        let layers = text.pp("encoder.layers");
        Ok(ClipText {
            tokens,
            symbols: places.matrix("token_embedding.weight", config.vocab_size, width)?,
            positions: places.matrix("position_embedding.weight", most, width)?,
            layers: (0..config.num_hidden_layers)
                .map(|i| Layer::load(&layers.pp(i), config))
                .collect::<Result<_>>()?,
            norm: LayerNorm::load(&text.pp("final_layer_norm"), width, config.layer_norm_eps)?,
            projection: Linear::from_parts(&projection, Array1::zeros(config.projection_dim)),
        })
    }

    /// How many numbers a place holds.
    pub(super) fn width(&self) -> usize {
        self.projection.outputs()
    }

    /// Place `[D]` of a text, a vector of length 1. Symbols beyond `max_position_embeddings` are
    /// not read.
    pub(super) fn of(&self, text: &str) -> Array1<f32> {
        let numbers = self.tokens.of(text, self.positions.nrows());
        let shape = (numbers.len(), self.symbols.ncols());
        let mut x = Array2::from_shape_fn(shape, |(row, channel)| {
            self.symbols[[numbers[row], channel]] + self.positions[[row, channel]]
        });
        for layer in &self.layers {
            x = layer.forward(x);
        }
        // The last symbol has attended to all others.
        let last = x.slice(ndarray::s![-1.., ..]).to_owned();
        let place = self.projection.forward(&self.norm.forward(&last));
        let place = place.row(0).to_owned();
        let length = place.dot(&place).sqrt().max(f32::MIN_POSITIVE);
        place / length
    }
}

impl Config {
    fn read(text: &str) -> std::result::Result<Self, String> {
        let mut whole: Value = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let kind = whole["model_type"].as_str().unwrap_or("none");
        if !kind.starts_with("clip") {
            return Err(format!("model_type: expected clip, got {kind}"));
        }
        let inner = match whole.get_mut("text_config") {
            Some(inner) => inner.take(),
            None => whole,
        };
        let config: Config = serde_json::from_value(inner).map_err(|e| e.to_string())?;
        config.check()?;
        Ok(config)
    }

    fn check(&self) -> std::result::Result<(), String> {
        checkpoint::check_epsilon(self.layer_norm_eps)?;
        checkpoint::check_sizes(&[
            ("vocab_size", self.vocab_size, 1_000_000),
            ("hidden_size", self.hidden_size, 16_384),
            ("intermediate_size", self.intermediate_size, 65_536),
            ("num_hidden_layers", self.num_hidden_layers, 256),
            ("num_attention_heads", self.num_attention_heads, 256),
            ("projection_dim", self.projection_dim, 16_384),
            (
                "max_position_embeddings",
                self.max_position_embeddings,
                10_000,
            ),
        ])?;
        match self.max_position_embeddings {
            1 => Err("max_position_embeddings: expected 2 or more, got 1".into()),
            _ => Ok(()),
        }
    }
}

impl Layer {
    fn load(weights: &Weights, config: &Config) -> Result<Self> {
        let (width, inner) = (config.hidden_size, config.intermediate_size);
        let (heads, epsilon) = (config.num_attention_heads, config.layer_norm_eps);
        let attention = weights.pp("self_attn");
        Ok(Layer {
            norm1: LayerNorm::load(&weights.pp("layer_norm1"), width, epsilon)?,
            attention: SelfAttention::load_separate(&attention, width, heads)?,
            norm2: LayerNorm::load(&weights.pp("layer_norm2"), width, epsilon)?,
            fc1: Linear::load(&weights.pp("mlp.fc1"), width, inner)?,
            fc2: Linear::load(&weights.pp("mlp.fc2"), inner, width)?,
            activation: config.hidden_act,
        })
    }

    fn forward(&self, mut x: Array2<f32>) -> Array2<f32> {
        let attended = self.norm1.forward(&x);
        x += &self.attention.forward_within(&attended, Some(Reach::PAST));
        let hidden = self.fc1.forward(&self.norm2.forward(&x));
        let hidden = hidden.mapv_into(|x| match self.activation {
            Activation::QuickGelu => x * sigmoid(1.702 * x),
            Activation::Gelu => gelu(x),
        });
        x += &self.fc2.forward(&hidden);
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        nn::golden::{Golden, damage, distance, seeds},
        text::TextUnits,
    };

    /// Writes the golden as a Hugging Face folder.
    fn folder(golden: &Golden) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, key: &str| {
            std::fs::write(folder.path().join(name), golden.metadata(key)).unwrap();
        };
        write("config.json", "config");
        write("vocab.json", "vocab");
        write("merges.txt", "merges");
        let path = folder.path().join("model.safetensors");
        golden.write_arrays("weights.", &path, |all| all);
        folder
    }

    #[test]
    fn symbols_and_places_equal_those_of_hugging_face() {
        let golden = Golden::open("clip_text_debug");
        let clip = ClipText::load_folder(folder(&golden).path()).unwrap();
        let texts: Vec<String> = serde_json::from_str(&golden.metadata("texts")).unwrap();
        let numbers: Vec<Vec<usize>> = serde_json::from_str(&golden.metadata("tokens")).unwrap();
        for (row, (text, expected)) in texts.iter().zip(numbers).enumerate() {
            assert_eq!(
                clip.tokens.of(text, clip.positions.nrows()),
                expected,
                "{text:?}"
            );
            let error = distance(&clip.of(text), &golden.values(&format!("places.{row}")));
            assert!(error < 1e-4, "{text:?}: {error}");
        }
    }

    #[test]
    fn a_model_reads_clauses_by_the_clip_that_its_config_names() {
        let golden = Golden::open("clip_text_debug");
        let models = tempfile::tempdir().unwrap();
        let place = models.path().join("text_units");
        std::fs::create_dir(&place).unwrap();
        let config = golden.metadata("model_config");
        std::fs::write(place.join("config.json"), &config).unwrap();
        golden.write_arrays("model.", &place.join("model.safetensors"), |all| all);
        let missing = TextUnits::open(Some(models.path())).unwrap_err();
        assert!(matches!(missing, Error::Io { .. }), "{missing}");

        std::fs::rename(folder(&golden).keep(), place.join("clip")).unwrap();
        let words = TextUnits::open(Some(models.path())).unwrap();
        let texts: Vec<String> = serde_json::from_str(&golden.metadata("texts")).unwrap();
        for (row, text) in texts.iter().enumerate() {
            let clauses = words.rules.clauses(text);
            let logits = clauses
                .iter()
                .map(|clause| words.tower.forward(clause, &words.space));
            let logits: Vec<f32> = logits.flatten().collect();
            let expected = golden.values(&format!("logits.{row}"));
            assert_eq!(logits.len(), expected.len(), "{text:?}");
            assert!(distance(&logits, &expected) < 1e-4, "{text:?}");
        }
        assert_eq!(words.understand("").unwrap(), Default::default());
    }

    #[test]
    fn damaged_folders_are_refused_or_give_places() {
        let golden = Golden::open("clip_text_debug");
        for seed in seeds() {
            for file in [
                "config.json",
                "vocab.json",
                "merges.txt",
                "model.safetensors",
            ] {
                let folder = folder(&golden);
                damage(&folder.path().join(file), seed);
                if let Ok(clip) = ClipText::load_folder(folder.path()) {
                    clip.of("she smiles, 3 times: it's naïve");
                }
            }
        }
    }

    #[test]
    fn damaged_folders_are_refused_by_file_and_shape() {
        let golden = Golden::open("clip_text_debug");
        for (name, from, to, expected) in [
            (
                "config.json",
                "\"clip\"",
                "\"bert\"",
                "model_type: expected clip, got bert",
            ),
            (
                "config.json",
                "quick_gelu",
                "relu",
                "config.json: unknown variant `relu`",
            ),
            (
                "config.json",
                "\"num_hidden_layers\": 2",
                "\"num_hidden_layers\": 3",
                "layers.2",
            ),
            (
                "config.json",
                "\"num_hidden_layers\": 2",
                "\"num_hidden_layers\": 1000000000",
                "num_hidden_layers: expected 1 to 256, got 1000000000",
            ),
            (
                "vocab.json",
                "<|startoftext|>",
                "<s>",
                "vocab.json: expected the symbol <|startoftext|>",
            ),
            (
                "vocab.json",
                ": 0,",
                ": 700000,",
                "vocab.json: expected numbers below",
            ),
            (
                "merges.txt",
                "#version: 0.2",
                "one",
                "merges.txt: expected two symbols in each line",
            ),
        ] {
            let folder = folder(&golden);
            let path = folder.path().join(name);
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains(from), "{name}: {from}");
            std::fs::write(&path, text.replace(from, to)).unwrap();
            let message = ClipText::load_folder(folder.path())
                .unwrap_err()
                .to_string();
            assert!(message.contains(expected), "{message}");
        }
        let folder = folder(&golden);
        std::fs::remove_file(folder.path().join("merges.txt")).unwrap();
        let message = ClipText::load_folder(folder.path())
            .unwrap_err()
            .to_string();
        assert!(message.contains("merges.txt"), "{message}");
    }
}
