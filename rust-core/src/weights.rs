//! Default weights inside the library, and a folder that may override them.

use std::{borrow::Cow, fs, path::Path};

use crate::{Error, Result};

/// The two files of a model.
pub struct ModelFiles {
    /// `model.safetensors`.
    pub weights: Cow<'static, [u8]>,
    /// `config.json`.
    pub config: Cow<'static, str>,
}

/// A model that is built in.
pub struct BuiltIn {
    /// Its folder's name.
    pub name: &'static str,
    weights: &'static [u8],
    config: &'static str,
    /// Its model card, Markdown.
    pub card: &'static str,
}

macro_rules! built_in {
    ($name:literal) => {
        BuiltIn {
            name: $name,
            weights: include_bytes!(concat!("../models/", $name, "/model.safetensors")),
            config: include_str!(concat!("../models/", $name, "/config.json")),
            card: include_str!(concat!("../models/", $name, "/README.md")),
        }
    };
}

/// Every model that is built in.
pub static BUILT_IN: [BuiltIn; 8] = [
    built_in!("compact_speech"),
    built_in!("ats_compact"),
    built_in!("stm_static"),
    built_in!("landmarks"),
    built_in!("stm_paper"),
    built_in!("face_modes"),
    built_in!("stream"),
    built_in!("rig"),
];

impl ModelFiles {
    /// The model `name` from `folder/name` if that exists, else the built-in one.
    ///
    /// # Errors
    /// `Weights` if there is no such model or no such folder; `Io` if the model's folder lacks one
    /// of its two files.
    pub fn open(name: &str, folder: Option<&Path>) -> Result<Self> {
        if let Some(folder) = folder {
            // A mistyped folder must not quietly give the built-in weights.
            if !folder.is_dir() {
                let message = format!("{}: expected a folder, found none", folder.display());
                return Err(Error::Weights(message));
            }
            let folder = folder.join(name);
            if folder.is_dir() {
                return Self::read(&folder);
            }
        }
        let model = BUILT_IN
            .iter()
            .find(|model| model.name == name)
            .ok_or_else(|| {
                let known: Vec<&str> = BUILT_IN.iter().map(|model| model.name).collect();
                Error::Weights(format!(
                    "expected one of {}, got {name:?}",
                    known.join(", ")
                ))
            })?;
        Ok(ModelFiles {
            weights: model.weights.into(),
            config: model.config.into(),
        })
    }

    fn read(folder: &Path) -> Result<Self> {
        let weights = folder.join("model.safetensors");
        let config = folder.join("config.json");
        Ok(ModelFiles {
            weights: fs::read(&weights).map_err(Error::io(weights))?.into(),
            config: fs::read_to_string(&config)
                .map_err(Error::io(config))?
                .into(),
        })
    }
}
