//! Checks the sizes in the config of a user's network and reads its weights, from
//! `model.safetensors` or PyTorch's `pytorch_model.bin`.

use std::path::Path;

use super::Weights;
use crate::Result;

/// The name that PyTorch's checkpoints have in a Hugging Face folder.
const PYTORCH_FILE: &str = "pytorch_model.bin";

/// Checks that each size in a user's config lies between 1 and the largest that any model may have.
/// `sizes`: name, size, largest size.
///
/// # Errors
/// Names the first size that is out of range, its range and its value.
pub(crate) fn check_sizes(sizes: &[(&str, usize, usize)]) -> Result<(), String> {
    let wrong = sizes
        .iter()
        .find(|(_, size, most)| !(1..=*most).contains(size));
    match wrong {
        Some((name, size, most)) => Err(format!("{name}: expected 1 to {most}, got {size}")),
        None => Ok(()),
    }
}

/// Checks the constant that keeps a norm from dividing by zero.
///
/// # Errors
/// As [`check_sizes`].
pub(crate) fn check_epsilon(epsilon: f32) -> Result<(), String> {
    if (0.0..=1.0).contains(&epsilon) {
        Ok(())
    } else {
        Err(format!("layer_norm_eps: expected 0 to 1, got {epsilon}"))
    }
}

/// Reads the weights in `folder`: `model.safetensors`, or `pytorch_model.bin` if only that exists.
///
/// # Errors
/// `Io` if neither file exists or the file cannot be read; `Weights` if the file is damaged, or if
/// it is PyTorch's and the library lacks the feature `checkpoints`.
pub(crate) fn read(folder: &Path) -> Result<Weights> {
    let safetensors = folder.join("model.safetensors");
    let pytorch = folder.join(PYTORCH_FILE);
    if pytorch.exists() && !safetensors.exists() {
        read_pytorch(&pytorch)
    } else {
        Weights::from_file(&safetensors)
    }
}

/// Reads the zip archive that PyTorch has written since version 1.6. No code in its pickle is run.
#[cfg(feature = "checkpoints")]
fn read_pytorch(path: &Path) -> Result<Weights> {
    use super::pickle::read_tensors;
    use crate::{
        Error,
        job::{Input, InputKind, outside::guarded},
    };

    let bad = |e: String| {
        Error::Weights(format!(
            "{}: expected a whole checkpoint of PyTorch 1.6 or later: {e}",
            path.display()
        ))
    };
    let file = Input::open(path, InputKind::Weights)?;
    let arrays = guarded(Error::Weights, || read_tensors(file).map_err(bad))?;
    Ok(Weights::from_arrays(arrays))
}

#[cfg(not(feature = "checkpoints"))]
fn read_pytorch(path: &Path) -> Result<Weights> {
    Err(crate::Error::Weights(format!(
        "{}: expected model.safetensors: this build lacks the feature `checkpoints`, which reads \
         PyTorch's files",
        path.display()
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Error,
        nn::golden::{Golden, path_of},
    };

    /// A Hugging Face folder with the golden `hubert_tiny.bin`, cut to `share` of its bytes.
    fn folder(share: f64) -> tempfile::TempDir {
        let bytes = std::fs::read(path_of("hubert_tiny.bin")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let length = (bytes.len() as f64 * share) as usize;
        std::fs::write(folder.path().join(PYTORCH_FILE), &bytes[..length]).unwrap();
        folder
    }

    #[test]
    #[cfg(feature = "checkpoints")]
    fn checkpoint_of_pytorch_holds_the_arrays_of_safetensors() {
        let golden = Golden::open("hubert_tiny");
        let weights = read(folder(1.0).path()).unwrap();
        for full in golden.names() {
            let Some(name) = full.strip_prefix("weights.") else {
                continue;
            };
            let got = weights.values(name, &golden.shape(&full)).unwrap();
            // The layers in the golden file are in half precision: 11 bits.
            let allowed = if name.contains(".layers.") { 1e-3 } else { 0.0 };
            for (got, expected) in got.iter().zip(golden.values(&full)) {
                assert!((got - expected).abs() <= allowed * expected.abs() + allowed * 1e-4);
            }
        }
    }

    #[test]
    fn damaged_or_unreadable_checkpoint_is_a_weights_error() {
        let error = read(folder(0.5).path()).unwrap_err();
        assert!(matches!(&error, Error::Weights(message) if message.contains(PYTORCH_FILE)));
    }
}
