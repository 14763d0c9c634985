//! Tensors and metadata from safetensors files.

use std::{collections::HashMap, path::Path};

use half::f16;
use safetensors::{Dtype, SafeTensors};

use anyface::{Error, Result};

/// The bytes of a file and its metadata.
pub(super) struct TensorFile {
    name: String,
    bytes: Vec<u8>,
    metadata: HashMap<String, String>,
}

impl TensorFile {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        let name = path.display().to_string();
        let (_, header) = SafeTensors::read_metadata(&bytes)
            .map_err(|e| Error::InvalidInput(format!("{name}: {e}")))?;
        let metadata = header.metadata().clone().unwrap_or_default();
        Ok(TensorFile {
            name,
            bytes,
            metadata,
        })
    }

    /// A list of words that the metadata holds as JSON.
    pub(super) fn words(&self, key: &str) -> Result<Vec<String>> {
        let text = self.metadata.get(key).map_or("", String::as_str);
        serde_json::from_str(text).map_err(|e| self.bad(&format!("metadata {key}: {e}")))
    }

    /// A tensor of type f32, f16, i16, u8 or i32 as f32, and its shape.
    pub(super) fn floats(&self, name: &str) -> Result<(Vec<f32>, Vec<usize>)> {
        let file = SafeTensors::deserialize(&self.bytes).map_err(|e| self.bad(&e.to_string()))?;
        let view = file.tensor(name).map_err(|e| self.bad(&e.to_string()))?;
        let data = view.data();
        let values = match view.dtype() {
            Dtype::F32 => numbers(data, f32::from_le_bytes),
            Dtype::F16 => numbers(data, |bytes| f16::from_le_bytes(bytes).to_f32()),
            Dtype::I16 => numbers(data, |bytes| i16::from_le_bytes(bytes).into()),
            Dtype::U8 => numbers(data, |[byte]| byte.into()),
            // Indices here are far below 2^24, so f32 holds them exactly.
            Dtype::I32 => numbers(data, |bytes| i32::from_le_bytes(bytes) as f32),
            other => return Err(self.bad(&format!("{name}: unexpected type {other:?}"))),
        };
        Ok((values, view.shape().to_vec()))
    }

    /// An error that names the file.
    pub(super) fn bad(&self, what: &str) -> Error {
        Error::InvalidInput(format!("{}: {what}", self.name))
    }
}

/// Values of `N` bytes each.
fn numbers<const N: usize>(data: &[u8], read: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    data.as_chunks()
        .0
        .iter()
        .map(|bytes| read(*bytes))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use safetensors::tensor::{TensorView, serialize};

    #[test]
    fn numbers_of_every_type_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers.safetensors");
        for (dtype, bytes, value) in [
            (Dtype::F32, &(-2.5f32).to_le_bytes()[..], -2.5),
            (Dtype::F16, &0x3555u16.to_le_bytes(), 0.333_251_95),
            (Dtype::F16, &0x0001u16.to_le_bytes(), 5.960_464_5e-8),
            (Dtype::I16, &(-300i16).to_le_bytes(), -300.0),
            (Dtype::U8, &[200], 200.0),
            (Dtype::I32, &70_000i32.to_le_bytes(), 70_000.0),
        ] {
            let view = TensorView::new(dtype, vec![1], bytes).unwrap();
            std::fs::write(&path, serialize([("x", view)], None).unwrap()).unwrap();
            let file = TensorFile::read(&path).unwrap();
            assert_eq!(file.floats("x").unwrap(), (vec![value], vec![1]));
        }
    }
}
