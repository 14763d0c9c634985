//! Named arrays as one block of bytes, in the safetensors format.

use std::{collections::BTreeMap, io};

use safetensors::{Dtype, SafeTensors, serialize, tensor::TensorView};
use serde::{Serialize, de::DeserializeOwned};

/// One array: its shape and its numbers in row-major order.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)]
pub enum Values {
    F32(Vec<f32>),
    F64(Vec<f64>),
    U32(Vec<u32>),
    U8(Vec<u8>),
}

/// Named arrays. Taking an array out moves it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Arrays(BTreeMap<String, (Vec<usize>, Values)>);

impl Arrays {
    /// Adds an array of any type.
    ///
    /// # Panics
    /// If `shape` does not fit the number of values.
    pub fn insert(&mut self, name: &str, shape: &[usize], values: Values) {
        let count = match &values {
            Values::F32(v) => v.len(),
            Values::F64(v) => v.len(),
            Values::U32(v) => v.len(),
            Values::U8(v) => v.len(),
        };
        assert_eq!(shape.iter().product::<usize>(), count, "shape of {name}");
        self.0.insert(name.to_owned(), (shape.to_vec(), values));
    }

    /// Adds an array of `f32`.
    ///
    /// # Panics
    /// If `shape` does not fit.
    pub fn insert_f32(&mut self, name: &str, shape: &[usize], values: Vec<f32>) {
        self.insert(name, shape, Values::F32(values));
    }

    /// Adds an array of `f64`.
    ///
    /// # Panics
    /// If `shape` does not fit.
    pub fn insert_f64(&mut self, name: &str, shape: &[usize], values: Vec<f64>) {
        self.insert(name, shape, Values::F64(values));
    }

    /// Adds an array of `u32`.
    ///
    /// # Panics
    /// If `shape` does not fit.
    pub fn insert_u32(&mut self, name: &str, shape: &[usize], values: Vec<u32>) {
        self.insert(name, shape, Values::U32(values));
    }

    /// Adds a value of any type, as JSON.
    pub fn insert_json(&mut self, name: &str, value: &impl Serialize) {
        let text =
            serde_json::to_vec(value).expect("plain data has no map with other keys than text");
        self.insert(name, &[text.len()], Values::U8(text));
    }

    /// Takes out an `f32` array: its shape and values; `None` if it is absent or another type.
    pub fn take_f32(&mut self, name: &str) -> Option<(Vec<usize>, Vec<f32>)> {
        match self.0.remove(name)? {
            (shape, Values::F32(values)) => Some((shape, values)),
            _ => None,
        }
    }

    /// Takes out a value that [`Arrays::insert_json`] added; `None` if absent or another type.
    pub fn take_json<T: DeserializeOwned>(&mut self, name: &str) -> Option<T> {
        match self.0.remove(name)? {
            (_, Values::U8(text)) => serde_json::from_slice(&text).ok(),
            _ => None,
        }
    }

    /// Takes out an `f64` array.
    pub fn take_f64(&mut self, name: &str) -> Option<(Vec<usize>, Vec<f64>)> {
        match self.0.remove(name)? {
            (shape, Values::F64(values)) => Some((shape, values)),
            _ => None,
        }
    }

    /// Takes out a `u32` array.
    pub fn take_u32(&mut self, name: &str) -> Option<(Vec<usize>, Vec<u32>)> {
        match self.0.remove(name)? {
            (shape, Values::U32(values)) => Some((shape, values)),
            _ => None,
        }
    }

    /// All arrays as a safetensors file.
    pub(super) fn to_bytes(&self) -> io::Result<Vec<u8>> {
        let raw: Vec<_> = self
            .0
            .iter()
            .map(|(name, (shape, v))| (name, shape, v.to_bytes()))
            .collect();
        let mut views = Vec::with_capacity(raw.len());
        for (name, shape, (dtype, bytes)) in &raw {
            let view = TensorView::new(*dtype, shape.to_vec(), bytes).map_err(io::Error::other)?;
            views.push((name.as_str(), view));
        }
        serialize(views, None).map_err(io::Error::other)
    }

    /// The inverse of [`Arrays::to_bytes`]; `None` for anything else.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Arrays> {
        let file = SafeTensors::deserialize(bytes).ok()?;
        let mut arrays = Arrays::default();
        for (name, view) in file.iter() {
            let values = Values::from_bytes(view.dtype(), view.data())?;
            arrays
                .0
                .insert(name.to_owned(), (view.shape().to_vec(), values));
        }
        Some(arrays)
    }
}

impl Values {
    fn to_bytes(&self) -> (Dtype, Vec<u8>) {
        fn bytes<const N: usize, T: Copy>(values: &[T], encode: fn(T) -> [u8; N]) -> Vec<u8> {
            let mut out = vec![0; N * values.len()];
            let (items, _) = out.as_chunks_mut::<N>();
            let pairs = items.iter_mut().zip(values);
            pairs.for_each(|(item, &value)| *item = encode(value));
            out
        }
        match self {
            Values::F32(v) => (Dtype::F32, bytes(v, f32::to_le_bytes)),
            Values::F64(v) => (Dtype::F64, bytes(v, f64::to_le_bytes)),
            Values::U32(v) => (Dtype::U32, bytes(v, u32::to_le_bytes)),
            Values::U8(v) => (Dtype::U8, v.clone()),
        }
    }

    fn from_bytes(dtype: Dtype, bytes: &[u8]) -> Option<Values> {
        fn items<const N: usize, T>(bytes: &[u8], decode: fn([u8; N]) -> T) -> Vec<T> {
            let (items, _) = bytes.as_chunks::<N>();
            items.iter().map(|&item| decode(item)).collect()
        }
        match dtype {
            Dtype::F32 => Some(Values::F32(items(bytes, f32::from_le_bytes))),
            Dtype::F64 => Some(Values::F64(items(bytes, f64::from_le_bytes))),
            Dtype::U32 => Some(Values::U32(items(bytes, u32::from_le_bytes))),
            Dtype::U8 => Some(Values::U8(bytes.to_vec())),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_survive_the_way_through_bytes() {
        let mut arrays = Arrays::default();
        arrays.insert_f32("a", &[1, 3], vec![1.0, f32::MIN_POSITIVE, -0.0]);
        arrays.insert_f64("b", &[2], vec![std::f64::consts::PI, f64::INFINITY]);
        arrays.insert_u32("c", &[0], vec![]);
        arrays.insert_json("d", &("x", 0.1f32, 1e-300f64));
        let mut back = Arrays::from_bytes(&arrays.to_bytes().unwrap()).unwrap();
        assert_eq!(arrays, back);
        assert_eq!(back.take_u32("b"), None);
        let json = back.take_json::<(String, f32, f64)>("d");
        assert_eq!(json, Some(("x".into(), 0.1, 1e-300)));
        assert_eq!(back.take_f32("a").unwrap().0, [1, 3]);
        assert_eq!(back.take_f32("a"), None);
        assert_eq!(Arrays::from_bytes(b"noise"), None);
    }
}
