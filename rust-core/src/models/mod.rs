//! Finds and reads the weights of models. They come from the library itself, from a host that
//! fetches them, from a folder that overrides both, or from a user's own checkpoint.

pub(crate) mod checkpoint;
mod opened;
#[cfg(feature = "checkpoints")]
mod pickle;
mod weights;

use std::{
    borrow::Cow,
    fs,
    io::{self, Read},
    path::{Path, PathBuf},
    sync::OnceLock,
};

use anyface_weights_shared::Model;
use flate2::read::GzDecoder;
use serde_json::Value;

use crate::{
    Error, Result,
    cache::CacheKey,
    job::{InputKind, read_file, read_text},
};
pub(crate) use opened::Opened;
pub use weights::Weights;

/// Names of the weights file: as training writes it, and as it is shipped. Both files hold the same
/// bytes, see [`unpack`].
const PLAIN: &str = "model.safetensors";
const PACKED: &str = "model.planes.gz";
/// The most bytes of weights that a packed file may hold.
const MAX_BYTES: u64 = 2 << 30;
/// A packed file may hold this many bytes of weights, and in addition [`INFLATED`] times its size.
const ANY_WEIGHTS: u64 = 16 << 20;
/// The shipped weights take at least a fifth of their bytes. Zeros alone would take a thousandth.
const INFLATED: u64 = 32;
/// Largest magnitude of a number in a config.
const LARGEST_NUMBER: f64 = 1e5;
/// Names of numbers in configs, each with the smallest and largest value that any model may have.
const RANGES: [(&str, f64, f64); 33] = [
    ("adapter_inner", 1.0, 16_384.0),
    ("alpha", -100.0, 100.0),
    ("band", 0.0, 1_000.0),
    ("beta", -100.0, 100.0),
    ("blocks", 0.0, 256.0),
    ("channels", 1.0, 16_384.0),
    ("coarse_dilations", 1.0, 1_000.0),
    ("codes", 1.0, 10_000_000.0),
    ("delta", 1.0, 1_000.0),
    ("dilation", 1.0, 1_000.0),
    ("feedforward", 1.0, 65_536.0),
    ("fine_dilations", 1.0, 1_000.0),
    ("fps", 1.0, 240.0),
    ("heads", 1.0, 256.0),
    ("inner", 1.0, 16_384.0),
    ("kernel", 1.0, 1_000.0),
    ("latent", 1.0, 16_384.0),
    ("layers", 0.0, 256.0),
    ("look_back", 0.0, 10_000.0),
    ("memory_frames", 1.0, 100_000.0),
    ("outputs", 1.0, 65_536.0),
    ("overlap_frames", 0.0, 10_000.0),
    ("period", 1.0, 10_000.0),
    ("prior_colour", -100.0, 100.0),
    ("prior_peak", -100.0, 100.0),
    ("radius", 0.0, 10_000.0),
    ("scale_m", 1e-6, 10.0),
    ("steps", 1.0, 1_000.0),
    ("temperature", 0.0, 10.0),
    ("noise_s", 0.0, 10.0),
    ("train_steps", 1.0, 10_000.0),
    ("width", 1.0, 16_384.0),
    ("window_frames", 1.0, 10_000.0),
];

/// The two files of a model.
pub struct ModelFiles {
    /// The bytes of `model.safetensors`.
    pub weights: Vec<u8>,
    /// `config.json`.
    pub config: Cow<'static, str>,
}

/// A model that is built in, or that another feature would build in.
pub struct BuiltIn {
    /// Its folder's name.
    pub name: &'static str,
    /// If the model comes in several sizes, the name before the size, such as `ats` in `ats_paper`.
    /// `None` if it comes in one size.
    pub sizes_of: Option<&'static str>,
    /// `model.planes.gz`; empty if the build lacks it.
    pub packed: &'static [u8],
    /// `model.planes.gz` from a host that has fetched it, for a build that lacks it
    /// ([`BuiltIn::take_fetched`]).
    fetched: OnceLock<Vec<u8>>,
    /// `config.json`.
    pub config: &'static str,
    /// Its model card, Markdown.
    pub card: &'static str,
}

impl BuiltIn {
    /// A model that comes in one size.
    pub(crate) const fn new(model: &Model) -> Self {
        BuiltIn::of(model, None)
    }

    const fn of(model: &Model, sizes_of: Option<&'static str>) -> Self {
        BuiltIn {
            name: model.name,
            sizes_of,
            packed: model.weights,
            fetched: OnceLock::new(),
            config: model.config,
            card: model.card,
        }
    }

    /// A model that comes in several sizes, whose folder names all begin with `family`.
    pub(crate) const fn sized(model: &Model, family: &'static str) -> Self {
        BuiltIn::of(model, Some(family))
    }

    /// A model that this build lacks but a folder may hold.
    #[allow(dead_code)] // Where every feature is on, no model is absent.
    pub(crate) const fn absent(name: &'static str, sizes_of: Option<&'static str>) -> Self {
        BuiltIn {
            name,
            sizes_of,
            packed: &[],
            fetched: OnceLock::new(),
            config: "",
            card: "Not in this build",
        }
    }

    /// Takes the bytes of `model.planes.gz` from a host that has fetched them, for a build without
    /// the feature `embedded`.
    ///
    /// # Errors
    /// `Weights` if the bytes are damaged or the build lacks the model; `InvalidInput` if the
    /// weights are already here.
    pub fn take_fetched(&self, packed: Vec<u8>) -> Result<()> {
        if self.config.is_empty() {
            return Err(self.no_feature());
        }
        let bytes = unpack(&packed).map_err(|e| self.damaged(&e))?;
        Weights::from_bytes(&bytes)?.check_range()?;
        let is_new = self.packed.is_empty() && self.fetched.set(packed).is_ok();
        is_new.then_some(()).ok_or_else(|| {
            let expected = "expected weights that are not loaded yet, got them a second time";
            Error::InvalidInput(format!("{}: {expected}", self.name))
        })
    }

    /// Bytes of the built-in or fetched `model.planes.gz`. Empty if there are none.
    fn shipped(&self) -> &[u8] {
        match self.packed {
            [] => self.fetched.get().map_or(&[], Vec::as_slice),
            packed => packed,
        }
    }

    fn no_feature(&self) -> Error {
        Error::Weights(format!(
            "{}: expected a folder of models with this one, since this build lacks the feature of its system",
            self.name
        ))
    }

    fn damaged(&self, error: &io::Error) -> Error {
        Error::Weights(format!("{}: {error}", self.name))
    }

    /// Opens the model in `folder`, whatever its size there, or else the built-in one.
    ///
    /// # Errors
    /// Those of [`BuiltIn::place`]; `Io` if the model's folder lacks one of its two files;
    /// `Weights` if a file is damaged, or if neither the folder nor this build holds the model.
    pub fn open(&self, folder: Option<&Path>) -> Result<ModelFiles> {
        match self.place(folder)? {
            Some(place) => ModelFiles::read(&place),
            None if self.config.is_empty() => Err(self.no_feature()),
            None if self.shipped().is_empty() => Err(Error::Weights(format!(
                "{0}: expected its weights, which this build does not contain; fetch {0}/{PACKED} and pass it to take_fetched first",
                self.name
            ))),
            None => Ok(ModelFiles {
                weights: unpack(self.shipped()).map_err(|e| self.damaged(&e))?,
                config: self.config.into(),
            }),
        }
    }

    /// Whether its weights still have to be fetched.
    pub(crate) fn is_awaited(&self, folder: Option<&Path>) -> Result<bool> {
        let is_here = self.config.is_empty() || !self.shipped().is_empty();
        Ok(!is_here && self.place(folder)?.is_none())
    }

    /// The path of the model's own folder in `folder`; `None` if it is not there.
    ///
    /// # Errors
    /// `Weights` if `folder` does not exist, or if it holds the model in several sizes.
    pub fn place(&self, folder: Option<&Path>) -> Result<Option<PathBuf>> {
        let Some(folder) = folder else {
            return Ok(None);
        };
        let mut names = folders_in(folder)?;
        names.retain(|name| self.is_called(name));
        match &names[..] {
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

    /// Adds the model's weights and config to the cache key of a result that is made with it. Its
    /// card does not count.
    ///
    /// # Errors
    /// Those of [`BuiltIn::open`].
    pub(crate) fn add_to(&self, key: CacheKey, folder: Option<&Path>) -> Result<CacheKey> {
        Ok(match self.place(folder)? {
            Some(place) => {
                let files = ModelFiles::read(&place)?;
                key.bytes(&files.weights).text(&files.config)
            }
            None => key.bytes(self.shipped()).text(self.config),
        })
    }

    fn is_called(&self, name: &str) -> bool {
        let size = self
            .sizes_of
            .and_then(|family| name.strip_prefix(family)?.strip_prefix('_'));
        name == self.name || size.is_some()
    }
}

/// Checks that a folder of models holds at least one, and none that the library would silently
/// ignore.
///
/// `others`: names of folders that other code reads, such as those of speech encoders.
///
/// # Errors
/// `Weights`, which says which folders were expected and what was found.
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
        file("config.json") || file(PLAIN) || file(PACKED)
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
    // A mistyped folder must not silently lead to the built-in weights.
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
        let config = folder.join("config.json");
        let files = ModelFiles {
            weights: read_weights(folder)?,
            config: read_text(&config, InputKind::Text)?.into(),
        };
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let named = |message: String| Error::Weights(format!("{name}: {message}"));
        check_numbers(&files.config).map_err(|e| named(format!("config.json: {e}")))?;
        match Weights::from_bytes(&files.weights)?.check_range() {
            Err(Error::Weights(message)) => Err(named(message)),
            other => other.map(|()| files),
        }
    }
}

/// The bytes of a folder's `model.safetensors`, from that file or the packed one.
fn read_weights(folder: &Path) -> Result<Vec<u8>> {
    let (plain, packed) = (folder.join(PLAIN), folder.join(PACKED));
    if plain.is_file() || !packed.is_file() {
        return read_file(&plain, InputKind::Weights);
    }
    let bytes = read_file(&packed, InputKind::Weights)?;
    let damaged = |e| {
        Error::Weights(format!(
            "{}: expected a whole gzip file: {e}",
            packed.display()
        ))
    };
    unpack(&bytes).map_err(damaged)
}

/// Turns the bytes of a `model.planes.gz` into those of a `model.safetensors`. The packed file
/// holds, in gzip, first the bytes at even places and then those at odd places.
///
/// The high bytes of weights in f16 and f32 resemble each other, so they compress by a third more
/// when they lie side by side. For 8-bit numbers the order does not matter. `pack` in
/// training/nn/checkpoint.py is the inverse.
fn unpack(packed: &[u8]) -> io::Result<Vec<u8>> {
    let mut planes = Vec::with_capacity(packed.len() * 5 / 4);
    let most = (packed.len() as u64 * INFLATED + ANY_WEIGHTS).min(MAX_BYTES);
    GzDecoder::new(packed)
        .take(most + 1)
        .read_to_end(&mut planes)?;
    if planes.len() as u64 > most {
        let message = format!("expected at most {} MiB in it, got more", most >> 20);
        return Err(io::Error::other(message));
    }
    let (even, odd) = planes.split_at(planes.len().div_ceil(2));
    let mut bytes = vec![0; planes.len()];
    for ((pair, low), high) in bytes.chunks_exact_mut(2).zip(even).zip(odd) {
        pair.copy_from_slice(&[*low, *high]);
    }
    if even.len() > odd.len() {
        bytes[2 * odd.len()] = even[odd.len()];
    }
    Ok(bytes)
}

/// Checks that every number of a config lies within its range of [`RANGES`] or within
/// [`LARGEST_NUMBER`], so that no size and no constant of a model is absurd.
fn check_numbers(config: &str) -> Result<(), String> {
    let value: Value = serde_json::from_str(config).map_err(|e| e.to_string())?;
    let mut left = vec![(String::new(), &value)];
    while let Some((name, value)) = left.pop() {
        match value {
            Value::Object(fields) => {
                left.extend(fields.iter().map(|(key, value)| (key.clone(), value)));
            }
            Value::Array(items) => left.extend(items.iter().map(|item| (name.clone(), item))),
            Value::Number(number) => {
                let known = RANGES.iter().find(|(known, ..)| *known == name);
                let (low, high) = match known {
                    Some((_, low, high)) => (*low, *high),
                    None => (-LARGEST_NUMBER, LARGEST_NUMBER),
                };
                let is_within = number.as_f64().is_some_and(|x| (low..=high).contains(&x));
                if !is_within {
                    return Err(format!("{name}: expected {low} to {high}, got {number}"));
                }
            }
            Value::Null | Value::Bool(_) | Value::String(_) => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_weights_that_grow_far_beyond_their_file_are_refused() {
        use std::io::Write;
        let zeros = |bytes: usize| {
            let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
            packer.write_all(&vec![0; bytes]).unwrap();
            packer.finish().unwrap()
        };
        assert_eq!(unpack(&zeros(1 << 20)).unwrap().len(), 1 << 20);
        let message = unpack(&zeros(24 << 20)).unwrap_err().to_string();
        assert!(message.contains("MiB in it, got more"), "{message}");
    }

    #[test]
    fn built_in_models_are_within_the_ranges_and_absurd_ones_are_named() {
        for model in crate::systems::built_in_models() {
            check_numbers(model.config).unwrap();
            let weights = Weights::from_bytes(&unpack(model.packed).unwrap()).unwrap();
            weights
                .check_range()
                .unwrap_or_else(|e| panic!("{}: {e}", model.name));
        }
        for (config, words) in [
            (r#"{"a": [{"steps": 1e300}]}"#, "steps: expected 1 to 1000"),
            (r#"{"width": 99999999999999999999}"#, "width: expected"),
            (r#"{"heads": 0}"#, "heads: expected 1 to 256, got 0"),
            (r#"{"step": 1e38}"#, "step: expected -100000 to 100000"),
            ("[", "EOF"),
        ] {
            let message = check_numbers(config).unwrap_err();
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn packed_weights_are_the_plain_ones_and_damage_is_named() {
        // Python's gzip made these bytes from "ac" and "b", the planes of "abc".
        const ABC: [u8; 23] = [
            31, 139, 8, 0, 0, 0, 0, 0, 2, 3, 75, 76, 78, 2, 0, 21, 64, 56, 91, 3, 0, 0, 0,
        ];
        assert_eq!(unpack(&ABC).unwrap(), b"abc");
        let shipped = &crate::mesh::LANDMARK_MODEL;
        let folder = tempfile::tempdir().unwrap();
        let model_folder = folder.path().join(shipped.name);
        fs::create_dir(&model_folder).unwrap();
        fs::write(model_folder.join("config.json"), shipped.config).unwrap();
        fs::write(model_folder.join(PACKED), shipped.packed).unwrap();
        let built_in = shipped.open(None).unwrap();
        let read = shipped.open(Some(folder.path())).unwrap();
        assert_eq!(read.weights, built_in.weights);
        fs::write(
            model_folder.join(PACKED),
            &shipped.packed[..shipped.packed.len() / 2],
        )
        .unwrap();
        let message = shipped.open(Some(folder.path())).err().unwrap().to_string();
        assert!(message.contains(PACKED), "{message}");
        fs::write(model_folder.join(PLAIN), &built_in.weights).unwrap();
        let read = shipped.open(Some(folder.path())).unwrap();
        assert_eq!(read.weights, built_in.weights);
    }

    #[test]
    fn what_is_made_with_a_model_is_named_by_its_weights_and_config_and_not_its_card() {
        let model = &crate::mesh::LANDMARK_MODEL;
        let name = |model: &BuiltIn| {
            let key = model.add_to(CacheKey::new("made", 1), None).unwrap();
            key.digest()
        };
        let other = |weights, config, card| {
            BuiltIn::new(&Model {
                name: model.name,
                weights,
                config,
                card,
            })
        };
        let (packed, config) = (model.packed, model.config);
        assert_eq!(name(&other(packed, config, "")), name(model));
        assert_ne!(name(&other(&packed[1..], config, "")), name(model));
        assert_ne!(name(&other(packed, &config[1..], "")), name(model));
    }

    #[test]
    fn fetched_weights_serve_like_embedded_ones_and_are_named_before() {
        let shipped = &crate::mesh::LANDMARK_MODEL;
        let bare = BuiltIn::new(&Model {
            name: shipped.name,
            weights: &[],
            config: shipped.config,
            card: "",
        });
        let opened = || Opened::of(&bare, None, || bare.open(None)).unwrap();
        for message in [
            opened().get().err().unwrap().to_string(),
            bare.open(None).err().unwrap().to_string(),
        ] {
            assert!(
                message.contains("fetch landmarks/model.planes.gz"),
                "{message}"
            );
        }
        let half = shipped.packed[..shipped.packed.len() / 2].to_vec();
        assert!(matches!(bare.take_fetched(half), Err(Error::Weights(_))));
        bare.take_fetched(shipped.packed.to_vec()).unwrap();
        let weights = shipped.open(None).unwrap().weights;
        assert_eq!(bare.open(None).unwrap().weights, weights);
        assert_eq!(opened().get().unwrap().weights, weights);
        let name = |model: &BuiltIn| {
            let key = model.add_to(CacheKey::new("made", 1), None).unwrap();
            key.digest()
        };
        assert_eq!(name(&bare), name(shipped));
        for model in [&bare, shipped] {
            let again = model.take_fetched(shipped.packed.to_vec());
            assert!(matches!(again, Err(Error::InvalidInput(_))));
        }
    }

    #[test]
    fn a_folder_of_infinite_weights_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        for model in crate::systems::built_in_models() {
            let model_folder = folder.path().join(model.name);
            fs::create_dir(&model_folder).unwrap();
            let mut bytes = unpack(model.packed).unwrap();
            let place = {
                let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
                let infinity = |dtype| -> Option<&[u8]> {
                    Some(match dtype {
                        safetensors::Dtype::F32 => &[0, 0, 0x80, 0xff],
                        safetensors::Dtype::F16 => &[0, 0xfc],
                        safetensors::Dtype::BF16 => &[0x80, 0xff],
                        _ => return None,
                    })
                };
                let place = |data: &[u8]| data.as_ptr() as usize - bytes.as_ptr() as usize;
                file.iter()
                    .find_map(|(_, view)| Some((infinity(view.dtype())?, place(view.data()))))
            };
            let Some((infinity, at)) = place else {
                // Whole numbers alone cannot be infinite.
                fs::remove_dir(&model_folder).unwrap();
                continue;
            };
            bytes[at..at + infinity.len()].copy_from_slice(infinity);
            fs::write(model_folder.join("model.safetensors"), &bytes).unwrap();
            fs::write(model_folder.join("config.json"), model.config).unwrap();
            let error = model.open(Some(folder.path())).map(|_| ()).unwrap_err();
            let message = error.to_string();
            assert!(
                matches!(error, Error::Weights(_)) && message.contains(model.name),
                "{message}"
            );
            fs::remove_dir_all(&model_folder).unwrap();
        }
    }
}
