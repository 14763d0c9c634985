//! Tensors and metadata out of safetensors files.

use std::{collections::HashMap, path::Path};

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

    /// A tensor of any number type as f32, and its shape.
    pub(super) fn floats(&self, name: &str) -> Result<(Vec<f32>, Vec<usize>)> {
        let file = SafeTensors::deserialize(&self.bytes).map_err(|e| self.bad(&e.to_string()))?;
        let view = file.tensor(name).map_err(|e| self.bad(&e.to_string()))?;
        let data = view.data();
        let values = match view.dtype() {
            Dtype::F32 => data
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                .collect(),
            Dtype::F16 => data
                .chunks_exact(2)
                .map(|b| half(u16::from_le_bytes([b[0], b[1]])))
                .collect(),
            Dtype::I16 => data
                .chunks_exact(2)
                .map(|b| f32::from(i16::from_le_bytes([b[0], b[1]])))
                .collect(),
            Dtype::U8 => data.iter().map(|b| f32::from(*b)).collect(),
            // Indices here are far below 2^24, so f32 holds them exactly.
            Dtype::I32 => data
                .chunks_exact(4)
                .map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f32)
                .collect(),
            other => return Err(self.bad(&format!("{name}: unexpected type {other:?}"))),
        };
        Ok((values, view.shape().to_vec()))
    }

    /// An error that names the file.
    pub(super) fn bad(&self, what: &str) -> Error {
        Error::InvalidInput(format!("{}: {what}", self.name))
    }
}

/// IEEE half precision to single.
fn half(bits: u16) -> f32 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = ((bits >> 10) & 0x1f, f32::from(bits & 0x3ff));
    sign * match exponent {
        0 => fraction * 2f32.powi(-24),
        31 => f32::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f32.powi(i32::from(exponent) - 15),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_read() {
        for (bits, value) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x3555, 0.333_251_95),
            (0x0001, 5.960_464_5e-8),
            (0x7bff, 65504.0),
        ] {
            assert_eq!(half(bits), value);
        }
    }
}
