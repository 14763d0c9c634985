//! A model from the user that recognises emotions in place of the built-in ear.

use std::path::Path;

use serde::Deserialize;

use super::{EmotionModel, WhisperEar};
use crate::{
    Error, Result,
    job::{InputKind, read_text},
};

/// The kinds of model in a Hugging Face folder that can recognise emotions.
pub enum UserEar {
    /// A classifier of emotions.
    Classifier(EmotionModel),
    /// Whisper base, under the built-in layer for emotions.
    Whisper(WhisperEar),
}

/// The part of `config.json` that names the kind of model.
#[derive(Deserialize)]
struct Config {
    model_type: String,
}

impl UserEar {
    /// Reads the model in `folder`. `models`: a folder of models that replace built-in ones.
    ///
    /// # Errors
    /// Those of [`WhisperEar::open`] if `config.json` names Whisper, otherwise those of
    /// [`EmotionModel::load_folder`]; `Weights` for a model of another kind.
    pub fn open(folder: &Path, models: Option<&Path>) -> Result<Self> {
        let path = folder.join("config.json");
        let text = read_text(&path, InputKind::Text)?;
        let bad = |what: String| Error::Weights(format!("{}: {what}", path.display()));
        let config: Config = serde_json::from_str(&text).map_err(|e| bad(e.to_string()))?;
        match config.model_type.as_str() {
            "whisper" => Ok(UserEar::Whisper(WhisperEar::open(folder, models)?)),
            "hubert" | "wav2vec2" => Ok(UserEar::Classifier(EmotionModel::load_folder(folder)?)),
            other => Err(bad(format!(
                "model_type: expected whisper, hubert or wav2vec2, got {other}"
            ))),
        }
    }
}
