//! Named weight arrays from a safetensors file, with errors that say what is missing.

use std::{path::Path, sync::Arc};

use ndarray::{Array1, Array2, ArrayView2};
use rayon::prelude::*;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use std::collections::HashMap;

use crate::{
    Error, Result,
    job::{InputKind, read_file},
};

/// Largest magnitude of a weight in a file.
const LARGEST: f32 = 1e6;
/// Columns of 8-bit numbers that one thread widens at once.
const COLUMNS_AT_ONCE: usize = 64;

/// One array: its shape, and its values as they lie in the file.
#[derive(Debug, Clone, PartialEq)]
struct Array {
    shape: Vec<usize>,
    numbers: Numbers,
}

/// The values of an array.
#[derive(Debug, Clone, PartialEq)]
enum Numbers {
    /// In row-major order.
    Floats(Vec<f32>),
    /// 8-bit numbers column after column: the first axis is the last one here. A row is one place on
    /// the first axis, and `scales` has a factor for each row.
    EightBits { steps: Vec<i8>, scales: Vec<f32> },
}

impl Array {
    fn check_range(&self, name: &str) -> Result<()> {
        let is_weight = |x: &f32| x.abs() <= LARGEST;
        let found = match &self.numbers {
            Numbers::Floats(values) => values.iter().copied().find(|x| !is_weight(x)),
            Numbers::EightBits { scales, .. } => {
                let largest = scales.iter().map(|scale| f32::from(i8::MIN) * scale);
                largest.into_iter().find(|x| !is_weight(x))
            }
        };
        match found {
            Some(value) => Err(Error::Weights(format!(
                "{name}: expected numbers within ±{LARGEST}, got {value}"
            ))),
            None => Ok(()),
        }
    }

    /// Values in row-major order.
    fn row_major(&self) -> Vec<f32> {
        match &self.numbers {
            Numbers::Floats(values) => values.clone(),
            Numbers::EightBits { steps, scales } => {
                let row = |(row, scale)| {
                    let column_after_column = steps.iter().skip(row).step_by(scales.len());
                    column_after_column.map(move |x| f32::from(*x) * scale)
                };
                scales.iter().enumerate().flat_map(row).collect()
            }
        }
    }

    /// Values with the first axis last.
    fn first_axis_last(&self) -> Vec<f32> {
        let rows = self.shape[0];
        match &self.numbers {
            Numbers::Floats(values) => {
                let columns = values.len() / rows.max(1);
                let matrix = ArrayView2::from_shape((rows, columns), values);
                let matrix = matrix.expect("the shape is that of the values");
                matrix
                    .t()
                    .as_standard_layout()
                    .into_owned()
                    .into_raw_vec_and_offset()
                    .0
            }
            Numbers::EightBits { steps, scales } => {
                let mut values = vec![0.0; steps.len()];
                let columns = values.par_chunks_mut(rows).zip(steps.par_chunks(rows));
                columns
                    .with_min_len(COLUMNS_AT_ONCE)
                    .for_each(|(column, steps)| {
                        for ((value, step), scale) in column.iter_mut().zip(steps).zip(scales) {
                            *value = f32::from(*step) * scale;
                        }
                    });
                values
            }
        }
    }
}

/// The arrays of a weights file under a name prefix; cheap to clone.
///
/// Half precision and 8-bit numbers save space in storage but cost time on a CPU. Half precision is
/// widened to `f32` when the file is read, an 8-bit array when a layer takes it. Each 8-bit number is
/// multiplied by the scale of its row. `NAME.scale` holds the scales of the array `NAME`. An 8-bit
/// array lies column after column in the file: its first axis is the last one there. Unsigned
/// 16-bit numbers are zigzag codes of whole numbers.
///
/// ```
/// # use anyface::models::Weights;
/// # let bytes = safetensors::serialize(
/// #     [("head.bias", safetensors::tensor::TensorView::new(
/// #         safetensors::Dtype::F32, vec![1], &[0, 0, 128, 63])?)], None)?;
/// let weights = Weights::from_bytes(&bytes)?;
/// assert_eq!(weights.pp("head").vector("bias", 1)?[0], 1.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Weights {
    arrays: Arc<HashMap<String, Array>>,
    prefix: String,
}

impl Weights {
    /// Reads a safetensors file from memory. Arrays of integers other than signed 8-bit and unsigned
    /// 16-bit ones are skipped.
    ///
    /// # Errors
    /// `Weights` if the bytes are truncated or not safetensors, or if 8-bit numbers have no scales
    /// that fit.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let file = SafeTensors::deserialize(bytes).map_err(|error| {
            Error::Weights(format!(
                "expected a whole safetensors file, got {} bytes: {error}",
                bytes.len()
            ))
        })?;
        let mut arrays = HashMap::new();
        for (name, view) in file.iter() {
            let array = match view.dtype() {
                Dtype::I8 => Some(scaled(&file, name, &view)?),
                Dtype::U16 => Some(whole_numbers(&view)),
                _ => floats(&view).map(|values| Array {
                    shape: view.shape().to_vec(),
                    numbers: Numbers::Floats(values),
                }),
            };
            if let Some(array) = array {
                arrays.insert(name.to_owned(), array);
            }
        }
        Ok(Self::of(arrays))
    }

    /// Makes weights from names, shapes and row-major values.
    #[cfg(any(feature = "checkpoints", test))]
    pub(crate) fn from_arrays(
        arrays: impl IntoIterator<Item = (String, (Vec<usize>, Vec<f32>))>,
    ) -> Self {
        let array = |(shape, values)| Array {
            shape,
            numbers: Numbers::Floats(values),
        };
        let named = |(name, both)| (name, array(both));
        Self::of(arrays.into_iter().map(named).collect())
    }

    fn of(arrays: HashMap<String, Array>) -> Self {
        Weights {
            arrays: Arc::new(arrays),
            prefix: String::new(),
        }
    }

    /// Reads a safetensors file from disk.
    ///
    /// # Errors
    /// `Io` if it cannot be read, else those of [`Weights::from_bytes`].
    pub fn from_file(path: &Path) -> Result<Self> {
        let bytes = read_file(path, InputKind::Weights)?;
        Self::from_bytes(&bytes).map_err(|error| match error {
            Error::Weights(message) => Error::Weights(format!("{}: {message}", path.display())),
            other => other,
        })
    }

    /// Checks that every number of every array can be a weight: finite, and within ±1,000,000. No
    /// training gives larger weights, and products of a few numbers within this limit stay finite.
    ///
    /// # Errors
    /// `Weights`, which names the first array with a number beyond the limit.
    pub fn check_range(&self) -> Result<()> {
        let mut names: Vec<&String> = self.arrays.keys().collect();
        names.sort();
        for name in names {
            self.arrays[name].check_range(name)?;
        }
        Ok(())
    }

    /// The same arrays one level down: `weights.pp("layers").pp(0)` reads `layers.0.*`.
    pub fn pp(&self, name: impl std::fmt::Display) -> Self {
        Weights {
            arrays: Arc::clone(&self.arrays),
            prefix: if self.prefix.is_empty() {
                name.to_string()
            } else {
                format!("{}.{name}", self.prefix)
            },
        }
    }

    /// Whether there is an array with this name.
    pub fn contains(&self, name: &str) -> bool {
        self.arrays.contains_key(&self.full_name(name))
    }

    /// An array of a known shape, values in row-major order.
    ///
    /// # Errors
    /// `Weights` if it is missing, has another shape, or holds a number that cannot be a weight:
    /// NaN, infinity, or one beyond ±1,000,000.
    pub fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        Ok(self.array(name, shape)?.row_major())
    }

    /// The values of [`Weights::values`] with the first axis last: a matrix is transposed. 8-bit
    /// numbers lie so in the file, which saves most of the time to load a large layer.
    ///
    /// # Errors
    /// Those of [`Weights::values`].
    pub fn first_axis_last(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        Ok(self.array(name, shape)?.first_axis_last())
    }

    fn array(&self, name: &str, shape: &[usize]) -> Result<&Array> {
        let full = self.full_name(name);
        let array = self.arrays.get(&full).ok_or_else(|| {
            Error::Weights(format!("{full}: expected {shape:?}, got no such array"))
        })?;
        if array.shape != shape {
            let got = &array.shape;
            return Err(Error::Weights(format!(
                "{full}: expected {shape:?}, got {got:?}"
            )));
        }
        array.check_range(&full)?;
        Ok(array)
    }

    /// A vector of `length` values.
    ///
    /// # Errors
    /// Those of [`Weights::values`].
    pub fn vector(&self, name: &str, length: usize) -> Result<Array1<f32>> {
        Ok(Array1::from_vec(self.values(name, &[length])?))
    }

    /// A matrix `[rows, columns]`.
    ///
    /// # Errors
    /// Those of [`Weights::values`].
    pub fn matrix(&self, name: &str, rows: usize, columns: usize) -> Result<Array2<f32>> {
        let values = self.values(name, &[rows, columns])?;
        Ok(Array2::from_shape_vec((rows, columns), values).expect("the shape was checked"))
    }

    fn full_name(&self, name: &str) -> String {
        if self.prefix.is_empty() {
            name.to_owned()
        } else {
            format!("{}.{name}", self.prefix)
        }
    }
}

/// Whole numbers from their zigzag codes: `2n` stands for `n`, and `2n + 1` for `−n − 1`. Small
/// numbers of either sign have a high byte of 0, which takes no space in gzip. `zigzag` in
/// training/nn/checkpoint.py is the inverse.
fn whole_numbers(view: &TensorView<'_>) -> Array {
    let codes = view.data().chunks_exact(2);
    let codes = codes.map(|bytes| i32::from(u16::from_le_bytes([bytes[0], bytes[1]])));
    let numbers = codes.map(|code| ((code >> 1) ^ -(code & 1)) as f32);
    Array {
        shape: view.shape().to_vec(),
        numbers: Numbers::Floats(numbers.collect()),
    }
}

/// An array of 8-bit numbers with its scales. Its last axis is the first one of the array for which
/// it stands. `quantised` in training/nn/checkpoint.py is the inverse.
fn scaled(file: &SafeTensors<'_>, name: &str, view: &TensorView<'_>) -> Result<Array> {
    let expected = |what: String| Error::Weights(format!("{name}.scale: expected {what}"));
    let scales = file
        .tensor(&format!("{name}.scale"))
        .ok()
        .and_then(|scales| floats(&scales))
        .ok_or_else(|| {
            expected(format!(
                "the scales of the 8-bit numbers of {name}, got none"
            ))
        })?;
    let (rows, mut shape) = (scales.len(), view.shape().to_vec());
    if rows == 0 || shape.last() != Some(&rows) {
        return Err(expected(format!(
            "one for each of the last axis of {name}, which has the shape {shape:?}, got {rows}"
        )));
    }
    shape.rotate_right(1);
    let steps = view.data().iter().map(|x| x.cast_signed()).collect();
    Ok(Array {
        shape,
        numbers: Numbers::EightBits { steps, scales },
    })
}

/// Widens the numbers of an array to `f32`; `None` for a type that holds no weights by itself.
fn floats(view: &TensorView<'_>) -> Option<Vec<f32>> {
    let data = view.data();
    Some(match view.dtype() {
        Dtype::F32 => chunks(data, f32::from_le_bytes),
        Dtype::F64 => chunks(data, |bytes| f64::from_le_bytes(bytes) as f32),
        Dtype::F16 => chunks(data, |bytes| widen_f16(u16::from_le_bytes(bytes))),
        Dtype::BF16 => chunks(data, |bytes| {
            f32::from_bits(u32::from(u16::from_le_bytes(bytes)) << 16)
        }),
        _ => return None,
    })
}

fn chunks<const N: usize>(data: &[u8], convert: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    data.chunks_exact(N)
        .map(|chunk| convert(chunk.try_into().expect("chunks have N bytes")))
        .collect()
}

/// IEEE half precision to single; exact.
fn widen_f16(half: u16) -> f32 {
    let sign = u32::from(half >> 15) << 31;
    let exponent = u32::from(half >> 10) & 0x1f;
    let fraction = u32::from(half & 0x3ff);
    match exponent {
        0 => f32::from_bits(sign | 0x3380_0000) * fraction as f32, // subnormal: ±2⁻²⁴ · fraction
        0x1f => f32::from_bits(sign | 0x7f80_0000 | fraction << 13),
        _ => f32::from_bits(sign | (exponent + 112) << 23 | fraction << 13),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::Golden;

    fn file(values: &[f32]) -> Vec<u8> {
        let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = TensorView::new(Dtype::F32, vec![values.len()], &data).unwrap();
        safetensors::serialize([("a.bias", view)], None).unwrap()
    }

    #[test]
    fn half_precision_is_widened_exactly() {
        for (half, single) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x0001, 2f32.powi(-24)),
            (0x83ff, -1023.0 * 2f32.powi(-24)),
            (0x7bff, 65504.0),
            (0x7c00, f32::INFINITY),
        ] {
            assert_eq!(widen_f16(half), single, "{half:#06x}");
        }
    }

    /// Reads a file that holds the 8-bit matrix `a.weight`, `[2, 3]`, and the arrays in `others`.
    fn quantised(others: &[(&str, Dtype, &[u8])]) -> Result<Weights> {
        let eight = [127u8, 1, 0x81, 0, 2, 3]; // rows 127, -127, 2 and 1, 0, 3
        let matrix = TensorView::new(Dtype::I8, vec![3, 2], &eight).unwrap();
        let others = others.iter().map(|(name, dtype, data)| {
            let count = data.len() * 8 / dtype.bitsize();
            let view = TensorView::new(*dtype, vec![count], data).unwrap();
            (*name, view)
        });
        let views = others.chain([("a.weight", matrix)]);
        Weights::from_bytes(&safetensors::serialize(views, None).unwrap())
    }

    #[test]
    fn eight_bit_numbers_are_multiples_of_the_scale_of_their_row() {
        // 0.5 and 2 in bf16, one for each row.
        let scales: &[u8] = &[0x00, 0x3f, 0x00, 0x40];
        let rows = quantised(&[("a.weight.scale", Dtype::BF16, scales)]).unwrap();
        let got = rows.values("a.weight", &[2, 3]).unwrap();
        assert_eq!(got, [63.5, -63.5, 1.0, 2.0, 0.0, 6.0]);
    }

    #[test]
    fn packed_numbers_are_read_as_training_reads_them() {
        let golden = Golden::open("eight_bits");
        for name in ["matrix", "kernel", "whole"] {
            let floats = format!("floats.{name}");
            let got = golden.weights().values(name, &golden.shape(&floats));
            let got = got.unwrap();
            assert_eq!(got, golden.values(&floats), "{name}");
            assert!(got.iter().any(|x| *x != 0.0));
            let shape = golden.shape(&floats);
            let turned = golden.weights().first_axis_last(name, &shape).unwrap();
            let (rows, columns) = (shape[0], got.len() / shape[0]);
            for (index, value) in turned.iter().enumerate() {
                assert_eq!(*value, got[index % rows * columns + index / rows], "{name}");
            }
        }
    }

    #[test]
    fn scales_that_are_missing_or_do_not_fit_are_named() {
        let name = "a.weight.scale";
        for (others, words) in [
            (
                vec![],
                "expected the scales of the 8-bit numbers of a.weight",
            ),
            (vec![(name, Dtype::I16, &[0u8; 4][..])], "got none"),
            (vec![(name, Dtype::BF16, &[])], "the shape [3, 2], got 0"),
            (
                vec![(name, Dtype::BF16, &[0; 6])],
                "the shape [3, 2], got 3",
            ),
            (
                vec![(name, Dtype::BF16, &[0; 10])],
                "the shape [3, 2], got 5",
            ),
        ] {
            let message = quantised(&others).unwrap_err().to_string();
            let is_named = message.contains("a.weight.scale: ") && message.contains(words);
            assert!(is_named, "{message}");
        }
        for scale in [f32::NAN, f32::INFINITY, 1e5] {
            let scales = [scale.to_le_bytes(), 1f32.to_le_bytes()].concat();
            let damaged = quantised(&[(name, Dtype::F32, &scales)]).unwrap();
            let message = damaged.check_range().unwrap_err().to_string();
            assert!(
                message.contains("a.weight: expected numbers within"),
                "{message}"
            );
        }
    }

    #[test]
    fn weights_without_measure_are_named() {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e38, -2e6] {
            let weights = Weights::from_bytes(&file(&[1.0, value])).unwrap();
            let message = weights.check_range().unwrap_err().to_string();
            assert!(
                message.contains("a.bias: expected numbers within"),
                "{message}"
            );
        }
        Weights::from_bytes(&file(&[1.0, -1e6]))
            .unwrap()
            .check_range()
            .unwrap();
    }

    #[test]
    fn wrong_shape_says_expected_and_got() {
        let weights = Weights::from_bytes(&file(&[1.0, 2.0])).unwrap().pp("a");
        let message = weights.vector("bias", 3).unwrap_err().to_string();
        assert_eq!(message, "weights: a.bias: expected [3], got [2]");
        let message = weights.vector("weight", 3).unwrap_err().to_string();
        assert!(message.contains("no such array"), "{message}");
    }

    #[test]
    fn truncated_file_and_nan_are_weights_errors() {
        let bytes = file(&[1.0, f32::NAN]);
        let cut = Weights::from_bytes(&bytes[..bytes.len() - 3]);
        assert!(matches!(cut, Err(Error::Weights(_))));
        let whole = Weights::from_bytes(&bytes).unwrap();
        assert!(matches!(whole.vector("a.bias", 2), Err(Error::Weights(_))));
    }
}
