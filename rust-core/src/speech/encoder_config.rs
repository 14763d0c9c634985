//! The configuration files of a Hugging Face speech encoder.

use serde::Deserialize;

use crate::{
    Error, Result,
    audio::SAMPLE_RATE_HZ,
    models::checkpoint::{check_epsilon, check_sizes},
};

/// Where the convolutions are normalised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum FeatureNorm {
    /// Over time, after the first convolution.
    Group,
    /// Over channels, after each convolution.
    Layer,
}

/// The part of a Hugging Face `config.json` that the forward pass needs.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[allow(missing_docs)] // the names are Hugging Face's
pub(super) struct EncoderConfig {
    pub model_type: String,
    pub hidden_size: usize,
    pub num_hidden_layers: usize,
    pub num_attention_heads: usize,
    pub intermediate_size: usize,
    #[serde(default = "gelu_name")]
    pub hidden_act: String,
    #[serde(default = "gelu_name")]
    pub feat_extract_activation: String,
    #[serde(default = "default_epsilon")]
    pub layer_norm_eps: f32,
    pub feat_extract_norm: FeatureNorm,
    pub conv_dim: Vec<usize>,
    pub conv_stride: Vec<usize>,
    pub conv_kernel: Vec<usize>,
    #[serde(default)]
    pub conv_bias: bool,
    pub num_conv_pos_embeddings: usize,
    pub num_conv_pos_embedding_groups: usize,
    #[serde(default)]
    pub conv_pos_batch_norm: bool,
    #[serde(default)]
    pub do_stable_layer_norm: bool,
    #[serde(default = "yes")]
    pub feat_proj_layer_norm: bool,
}

fn gelu_name() -> String {
    "gelu".into()
}

fn default_epsilon() -> f32 {
    1e-5
}

fn yes() -> bool {
    true
}

/// `preprocessor_config.json`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
struct Preprocessor {
    #[serde(default = "yes")]
    do_normalize: bool,
    #[serde(default = "usual_rate")]
    sampling_rate: u32,
}

fn usual_rate() -> u32 {
    SAMPLE_RATE_HZ
}

impl EncoderConfig {
    /// Reads and checks `config.json`.
    ///
    /// # Errors
    /// `Weights` if it is not such a file or needs something that is not supported.
    pub fn from_json(text: &str) -> Result<Self> {
        let config: EncoderConfig =
            serde_json::from_str(text).map_err(|e| Error::Weights(format!("config.json: {e}")))?;
        config
            .check()
            .map_err(|complaint| Error::Weights(format!("config.json: {complaint}")))?;
        Ok(config)
    }

    fn check(&self) -> std::result::Result<(), String> {
        for (what, name) in [
            ("hidden_act", &self.hidden_act),
            ("feat_extract_activation", &self.feat_extract_activation),
        ] {
            if name != "gelu" {
                return Err(format!("{what}: expected gelu, got {name}"));
            }
        }
        if self.conv_pos_batch_norm {
            return Err("conv_pos_batch_norm: expected false, got true".into());
        }
        let layers = self.conv_dim.len();
        let (strides, kernels) = (self.conv_stride.len(), self.conv_kernel.len());
        if layers == 0 || strides != layers || kernels != layers {
            return Err(format!(
                "conv_stride and conv_kernel: expected {layers} values as in conv_dim, \
                 got {strides} and {kernels}"
            ));
        }
        self.check_sizes()?;
        let groups = self.num_conv_pos_embedding_groups;
        if groups == 0 || !self.hidden_size.is_multiple_of(groups) {
            let hidden = self.hidden_size;
            return Err(format!(
                "num_conv_pos_embedding_groups: expected a divisor of {hidden}, got {groups}"
            ));
        }
        Ok(())
    }

    fn check_sizes(&self) -> std::result::Result<(), String> {
        check_epsilon(self.layer_norm_eps)?;
        check_sizes(&[
            ("hidden_size", self.hidden_size, 16_384),
            ("num_hidden_layers", self.num_hidden_layers, 256),
            ("num_attention_heads", self.num_attention_heads, 256),
            ("intermediate_size", self.intermediate_size, 65_536),
            (
                "num_conv_pos_embeddings",
                self.num_conv_pos_embeddings,
                1_000,
            ),
        ])?;
        let each = |name, sizes: &[usize], most| {
            let sizes: Vec<_> = sizes.iter().map(|size| (name, *size, most)).collect();
            check_sizes(&sizes)
        };
        each("conv_dim", &self.conv_dim, 16_384)?;
        each("conv_kernel", &self.conv_kernel, 1_000)?;
        each("conv_stride", &self.conv_stride, 1_000)?;
        // A hop longer than a second is too coarse for speech.
        let hop = self
            .conv_stride
            .iter()
            .try_fold(1, |hop: usize, s| hop.checked_mul(*s));
        let hop = hop.unwrap_or(usize::MAX);
        check_sizes(&[("conv_stride, all together", hop, SAMPLE_RATE_HZ as usize)])
    }
}

/// Reads whether the encoder expects normalised input.
pub(super) fn read_preprocessor(text: &str) -> Result<bool> {
    let wrong =
        |complaint: String| Error::Weights(format!("preprocessor_config.json: {complaint}"));
    let config: Preprocessor = serde_json::from_str(text).map_err(|e| wrong(e.to_string()))?;
    match config.sampling_rate {
        SAMPLE_RATE_HZ => Ok(config.do_normalize),
        rate => Err(wrong(format!(
            "sampling_rate: expected {SAMPLE_RATE_HZ}, got {rate}"
        ))),
    }
}
