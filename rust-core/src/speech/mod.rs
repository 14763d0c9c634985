//! Speech features: one trait and four encoders (ear, HuBERT, wav2vec2, Whisper). Also finds
//! phones and words from these features.

mod alignment;
mod causal;
mod clock;
mod closures;
mod contacts;
mod conv_features;
mod ear;
mod emotion_ear;
mod emotion_encoder;
mod emotion_listener;
mod encoder;
mod encoder_config;
mod features;
mod letters;
mod lip_shapes;
mod log_mel;
mod phones;
mod pronunciations;
mod quantile;
mod resample;
mod residual_block;
mod script;
mod shown_emotion;
mod tongue;
mod transformer_encoder;
mod travel;
mod voice_gate;
mod whisper;
mod whisper_mel;
mod whisper_trunk;

pub(crate) use causal::seconds_of;
pub use causal::{CausalConfig, CausalModel, CausalSpeech};
pub(crate) use closures::closure_share;
pub use closures::{Contact, LipClosures};
pub use contacts::LipContacts;
pub(crate) use ear::EAR_BYTES;
pub use ear::{Ear, EarConfig};
pub use emotion_ear::{
    EMOTION_EAR, EMOTION_OF_WHISPER, EmotionEar, EmotionEarConfig, HeardEmotion, LiveEar,
    NeutralVoice, WhisperEar,
};
pub use emotion_encoder::{
    EMOTION_ENCODER, EmotionEncoder, EmotionEncoderConfig, LiveEmotion, VoiceTrack, VoiceWindow,
};
pub use emotion_listener::EmotionListener;
pub use encoder::{EAR_MODEL, FeatureTrack, SpeechEncoder, SpeechInput, TRUNK_MODEL, frames_of};
pub use features::SpeechFeatures;
pub use lip_shapes::{LIP_SHAPES, LipShape, LipShapes};
pub use log_mel::{BANDS, FRAME, HOP, MelAnalyser};
pub use phones::{PHONE_MODEL, PhoneConfig, PhoneModel, Said};
pub use pronunciations::{PRONUNCIATIONS, Pronunciations};
pub use resample::at_motion_frames;
pub use script::Script;
pub use tongue::TONGUE_PLACES;
pub use voice_gate::VoiceGate;

use std::path::Path;

use crate::{
    Error, Result,
    job::{InputKind, read_text},
};
use transformer_encoder::TransformerEncoder;

/// The ear with its built-in weights, or those of `folder`: `whisper_trunk` and `ear`.
///
/// # Errors
/// Those of `BuiltIn::open` and [`Ear::load`].
pub fn ear(folder: Option<&Path>) -> Result<Ear> {
    // Most of the time goes into gzip, on one thread for each of the two files.
    let (trunk, body) = rayon::join(
        || whisper_trunk::WhisperTrunk::open(folder),
        || EAR_MODEL.open(folder),
    );
    Ear::load(trunk?, &body?)
}

/// Opens the encoder that `required` names, or the ear. It is read from `checkpoint`, a
/// Hugging Face folder, if that is given, otherwise from the folder of that name in `models`. The
/// ear comes from `ear`.
///
/// # Errors
/// Those of `ear` and [`from_folder`]; `Weights`, naming both sides, if the encoder is not
/// the required one or gives another number of channels, or if there is none.
pub fn open(
    required: Option<&SpeechInput>,
    checkpoint: Option<&Path>,
    models: Option<&Path>,
    ear: impl FnOnce() -> Result<Ear>,
) -> Result<Box<dyn SpeechEncoder>> {
    let name = required.map_or(EAR_MODEL.name, |input| &input.encoder);
    let fps = transformer_fps(required)?;
    let encoder = match (checkpoint, models) {
        (Some(checkpoint), _) => from_folder(checkpoint, None, fps)?,
        (None, _) if name == EAR_MODEL.name => Box::new(ear()?),
        (None, Some(models)) if models.join(name).is_dir() => {
            from_folder(&models.join(name), None, fps)?
        }
        _ => {
            return Err(Error::Weights(format!(
                "the model was trained with features of {name}: expected its Hugging Face checkpoint, either by \
                     itself or as the folder {name} beside the model"
            )));
        }
    };
    match required {
        Some(required) => required.checked(encoder),
        None => Ok(encoder),
    }
}

/// Opens the encoder for a model's emotion features: the checkpoint in the folder `emotion_hubert`
/// or `emotion_wav2vec2` of `models`, depending on `required`.
///
/// # Errors
/// Those of [`from_folder`]; `Weights` if the folder is missing or its encoder is not the required
/// one.
pub fn open_emotion(
    required: &SpeechInput,
    models: Option<&Path>,
) -> Result<Box<dyn SpeechEncoder>> {
    let name = format!("emotion_{}", required.encoder);
    let folder = models.map(|models| models.join(&name));
    let Some(folder) = folder.filter(|folder| folder.is_dir()) else {
        return Err(Error::Weights(format!(
            "the model uses {} for emotion: expected its Hugging Face checkpoint as the folder {name} \
             beside the model, got none",
            required.encoder
        )));
    };
    required.checked(from_folder(
        &folder,
        None,
        transformer_fps(Some(required))?,
    )?)
}

fn transformer_fps(required: Option<&SpeechInput>) -> Result<Option<f64>> {
    match required.and_then(|input| input.transformer_fps) {
        Some(fps) if !(fps > 0.0 && fps.is_finite()) => Err(Error::Weights(format!(
            "config.json: speech: transformer_fps: expected a positive number, got {fps}"
        ))),
        fps => Ok(fps),
    }
}

impl SpeechInput {
    /// Returns `encoder` if it is the required one.
    fn checked(&self, encoder: Box<dyn SpeechEncoder>) -> Result<Box<dyn SpeechEncoder>> {
        let (name, channels) = (encoder.name(), encoder.channels());
        if (self.encoder.as_str(), self.channels) == (name, channels) {
            return Ok(encoder);
        }
        Err(Error::Weights(format!(
            "the model was trained with {} features of {}, the speech encoder is {name} and gives {channels}",
            self.channels, self.encoder
        )))
    }
}

/// Names of the checkpoint folders in a folder of models: speech encoders, then emotion encoders
/// ([`open_emotion`]).
pub const CHECKPOINTS: [&str; 5] = [
    "hubert",
    "wav2vec2",
    "whisper",
    "emotion_hubert",
    "emotion_wav2vec2",
];

/// Reads HuBERT, wav2vec2 or Whisper from a Hugging Face folder, whichever `config.json` names. The
/// weights are in `model.safetensors` or, with the feature `checkpoints`, in `pytorch_model.bin`.
///
/// `layer` chooses a hidden state: 0 is before the first layer, `None` is the output.
/// `transformer_fps` means the same as in [`SpeechInput`].
///
/// # Errors
/// `Io` if a file cannot be read; `Weights` if one is damaged, they do not fit each other, or the
/// folder holds another model; `InvalidInput` for a layer that does not exist.
pub fn from_folder(
    folder: &Path,
    layer: Option<usize>,
    transformer_fps: Option<f64>,
) -> Result<Box<dyn SpeechEncoder>> {
    #[derive(serde::Deserialize)]
    struct Kind {
        model_type: String,
    }
    let path = folder.join("config.json");
    let text = read_text(&path, InputKind::Text)?;
    let kind: Kind =
        serde_json::from_str(&text).map_err(|e| Error::Weights(format!("config.json: {e}")))?;
    match kind.model_type.as_str() {
        "hubert" | "wav2vec2" => {
            let encoder = TransformerEncoder::load_folder(folder, layer)?;
            Ok(Box::new(encoder.resampled(transformer_fps)))
        }
        "whisper" => match transformer_fps {
            None => Ok(Box::new(whisper::Whisper::load_folder(folder, layer)?)),
            Some(fps) => Err(Error::Weights(format!(
                "config.json: transformer_fps: expected none for whisper, whose places are those of its own rate, \
                 got {fps}"
            ))),
        },
        other => Err(Error::Weights(format!(
            "config.json: model_type: expected hubert, wav2vec2 or whisper, got {other}"
        ))),
    }
}
