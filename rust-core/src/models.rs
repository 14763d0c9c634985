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
    /// `model.safetensors`.
    pub weights: &'static [u8],
    /// `config.json`.
    pub config: &'static str,
    /// Its model card, Markdown.
    pub card: &'static str,
}

/// The built-in model of a folder in `rust-core/models`.
macro_rules! built_in {
    ($name:literal) => {
        $crate::models::BuiltIn {
            name: $name,
            weights: include_bytes!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/models/",
                $name,
                "/model.safetensors"
            )),
            config: include_str!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/models/",
                $name,
                "/config.json"
            )),
            card: include_str!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/models/",
                $name,
                "/README.md"
            )),
        }
    };
}
pub(crate) use built_in;

impl BuiltIn {
    /// The model of this name in `folder` if it is there, else the built-in one.
    ///
    /// # Errors
    /// `Weights` if there is no such folder; `Io` if the model's folder lacks one of its two files.
    pub fn open(&self, folder: Option<&Path>) -> Result<ModelFiles> {
        if let Some(folder) = folder {
            // A mistyped folder must not quietly give the built-in weights.
            if !folder.is_dir() {
                let message = format!("{}: expected a folder, found none", folder.display());
                return Err(Error::Weights(message));
            }
            let folder = folder.join(self.name);
            if folder.is_dir() {
                return ModelFiles::read(&folder);
            }
        }
        Ok(ModelFiles {
            weights: self.weights.into(),
            config: self.config.into(),
        })
    }
}

impl ModelFiles {
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
