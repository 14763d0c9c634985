//! Default weights inside the library, and a folder that may override them.

use std::{
    borrow::Cow,
    fs,
    path::{Path, PathBuf},
};

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
    /// What the folders of all its sizes begin with, as in `ats_paper`; `None` where it has one.
    pub sizes_of: Option<&'static str>,
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
        $crate::models::built_in!($name, None)
    };
    ($name:literal, $sizes_of:expr) => {
        $crate::models::BuiltIn {
            name: $name,
            sizes_of: $sizes_of,
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
    /// The model in `folder` if it is there, of whatever size, else the built-in one.
    ///
    /// # Errors
    /// Those of [`BuiltIn::place`]; `Io` if the model's folder lacks one of its two files.
    pub fn open(&self, folder: Option<&Path>) -> Result<ModelFiles> {
        match self.place(folder)? {
            Some(place) => ModelFiles::read(&place),
            None => Ok(ModelFiles {
                weights: self.weights.into(),
                config: self.config.into(),
            }),
        }
    }

    /// Where in `folder` the model lies; `None` if it does not.
    ///
    /// # Errors
    /// `Weights` if there is no such folder, or if it holds the model in several sizes.
    pub fn place(&self, folder: Option<&Path>) -> Result<Option<PathBuf>> {
        let Some(folder) = folder else {
            return Ok(None);
        };
        let mut found = folders_in(folder)?;
        found.retain(|name| self.is_called(name));
        match &found[..] {
            [] => Ok(None),
            [name] => Ok(Some(folder.join(name))),
            several => Err(Error::Weights(format!(
                "{}: expected one size of {}, got {}",
                folder.display(),
                self.sizes_of.unwrap_or(self.name),
                several.join(", ")
            ))),
        }
    }

    fn is_called(&self, name: &str) -> bool {
        let size = self
            .sizes_of
            .and_then(|family| name.strip_prefix(family)?.strip_prefix('_'));
        name == self.name || size.is_some()
    }
}

/// Checks that a folder of models holds some, and none that would be passed over in silence.
///
/// `others` are names that are read by other ways, such as those of speech encoders.
///
/// # Errors
/// `Weights` that names the folder's content and what was expected.
pub fn check_folder(
    folder: &Path,
    known: impl Iterator<Item = &'static BuiltIn>,
    others: &[&str],
) -> Result<()> {
    let known: Vec<&BuiltIn> = known.collect();
    let is_known =
        |name: &String| others.contains(&name.as_str()) || known.iter().any(|m| m.is_called(name));
    let (models, strange): (Vec<_>, Vec<_>) = folders_in(folder)?.into_iter().partition(is_known);
    let strange = strange.iter().find(|name| {
        let file = |file| folder.join(name).join(file).is_file();
        file("config.json") || file("model.safetensors")
    });
    if strange.is_none() && !models.is_empty() {
        return Ok(());
    }
    let names: Vec<&str> = known.iter().map(|model| model.name).collect();
    Err(Error::Weights(format!(
        "{}: expected folders of models ({}, {}), got {}",
        folder.display(),
        names.join(", "),
        others.join(", "),
        strange.map_or("none", String::as_str)
    )))
}

/// Names of the folders in `folder`, in order.
fn folders_in(folder: &Path) -> Result<Vec<String>> {
    // A mistyped folder must not quietly give the built-in weights.
    if !folder.is_dir() {
        let message = format!("{}: expected a folder, found none", folder.display());
        return Err(Error::Weights(message));
    }
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let entry = entry.map_err(Error::io(folder))?;
        if entry.path().is_dir() {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
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
