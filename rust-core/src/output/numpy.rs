//! Reads arrays from numpy archives (.npz), stored or deflated, which Anyface or numpy wrote.
//!
//! This does not use ndarray-npy, which allocates whatever size a header claims and follows nested
//! brackets in a header to any depth. Here a header is short text, and its shape is checked against
//! the size of the entry before an array is made.

use std::{
    fmt::Display,
    io::{BufReader, Read},
    path::{Path, PathBuf},
};

use ndarray::{Array, Dimension, IxDyn, ShapeBuilder};
use zip::ZipArchive;

use crate::{
    Error, Result,
    job::{Input, InputKind},
};

/// Longest header that is read, bytes. The limit of numpy itself is 10,000 characters.
const LONGEST_HEADER: usize = 1 << 16;
/// Most bytes that inflating one byte can yield, rounded up.
const INFLATED: u64 = 1100;

/// An archive that is open for reading.
pub(super) struct NumpyArchive {
    path: PathBuf,
    zip: ZipArchive<BufReader<Input>>,
}

/// An array as the file holds it.
struct Stored {
    /// Type of the values, such as `<f4`.
    kind: String,
    is_fortran: bool,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl NumpyArchive {
    /// # Errors
    /// `Io` if the file cannot be read, `InvalidInput` if it is no archive.
    pub(super) fn open(path: &Path) -> Result<NumpyArchive> {
        let file = Input::open(path, InputKind::Arrays)?;
        let zip = ZipArchive::new(BufReader::new(file)).map_err(|e| {
            let path = path.display();
            Error::InvalidInput(format!("{path}: expected an npz archive ({e})"))
        })?;
        let path = path.to_owned();
        Ok(NumpyArchive { path, zip })
    }

    /// Names of the arrays.
    pub(super) fn names(&self) -> Vec<&str> {
        let names = self.zip.file_names();
        names.filter_map(|name| name.strip_suffix(".npy")).collect()
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.names().contains(&name)
    }

    /// An array of f32, f64 or integers, as f32.
    ///
    /// # Errors
    /// `InvalidInput` if it is missing, damaged, not numbers or has another number of dimensions.
    pub(super) fn array<D: Dimension>(&mut self, name: &str) -> Result<Array<f32, D>> {
        let stored = self.stored(name)?;
        let values = numbers(&stored, |x| x as f32).map_err(|e| self.bad(name, &e))?;
        let shape = IxDyn(&stored.shape).set_f(stored.is_fortran);
        let array = Array::from_shape_vec(shape, values).map_err(|e| self.bad(name, &e))?;
        let (shape, dimensions) = (stored.shape, D::NDIM.unwrap_or_default());
        array.into_dimensionality::<D>().map_err(|_| {
            self.bad(
                name,
                &format!("expected {dimensions} dimensions, got {shape:?}"),
            )
        })
    }

    /// One number, f32, f64 or an integer, alone or in an array of one.
    ///
    /// # Errors
    /// Those of [`NumpyArchive::array`].
    pub(super) fn number(&mut self, name: &str) -> Result<f64> {
        let stored = self.stored(name)?;
        match numbers(&stored, |x| x).map_err(|e| self.bad(name, &e))?[..] {
            [value] => Ok(value),
            _ => Err(self.bad(
                name,
                &format!("expected one number, got {:?}", stored.shape),
            )),
        }
    }

    /// Texts of numpy's own Unicode type `<U…`: UTF-32, padded with zeros.
    ///
    /// # Errors
    /// Those of [`NumpyArchive::array`].
    pub(super) fn texts(&mut self, name: &str) -> Result<Vec<String>> {
        let stored = self.stored(name)?;
        texts(&stored).ok_or_else(|| self.bad(name, &"expected an array of text"))
    }

    fn stored(&mut self, name: &str) -> Result<Stored> {
        if !self.has(name) {
            let (path, got) = (self.path.display(), self.names().join(", "));
            return Err(Error::InvalidInput(format!(
                "{path}: expected an array {name}, got {got}"
            )));
        }
        let read = read_entry(&mut self.zip, name).map_err(|e| self.bad(name, &e))?;
        parse(read).map_err(|e| self.bad(name, &e))
    }

    fn bad(&self, name: &str, what: &dyn Display) -> Error {
        Error::InvalidInput(format!("{}: {name}: {what}", self.path.display()))
    }
}

/// Reads a whole entry, if the size that it claims is possible.
fn read_entry(zip: &mut ZipArchive<BufReader<Input>>, name: &str) -> Result<Vec<u8>, String> {
    let entry = zip.by_name(&format!("{name}.npy"));
    let mut entry = entry.map_err(|e| e.to_string())?;
    let size = entry.size();
    if size > entry.compressed_size().saturating_mul(INFLATED) {
        return Err(format!(
            "expected at most {INFLATED} times the {} bytes that are stored, got a claim of {size}",
            entry.compressed_size()
        ));
    }
    let mut bytes = Vec::new();
    let length = usize::try_from(size).map_err(|e| e.to_string())?;
    if entry.compressed_size() == size {
        // An uncompressed entry is as long as it claims, otherwise reading ends early.
        bytes
            .try_reserve(length.min(1 << 24))
            .map_err(|e| e.to_string())?;
    }
    let read = entry.by_ref().take(size).read_to_end(&mut bytes);
    read.map_err(|e| e.to_string())?;
    if bytes.len() == length {
        Ok(bytes)
    } else {
        Err(format!("expected {length} bytes, got {}", bytes.len()))
    }
}

/// Splits an .npy file into the facts of its header and its values.
fn parse(mut bytes: Vec<u8>) -> Result<Stored, String> {
    let damaged = || "expected an array of numpy's format, got something else".to_owned();
    if !bytes.starts_with(b"\x93NUMPY") {
        return Err(damaged());
    }
    let two = |at: usize| {
        Some(usize::from(u16::from_le_bytes(
            bytes.get(at..at + 2)?.try_into().ok()?,
        )))
    };
    let four =
        |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize);
    let (start, length) = match bytes.get(6) {
        Some(1) => (10, two(8)),
        Some(2 | 3) => (12, four(8)),
        _ => (0, None),
    };
    let length = length
        .filter(|n| *n <= LONGEST_HEADER)
        .ok_or_else(damaged)?;
    let header = bytes.get(start..start + length).ok_or_else(damaged)?;
    let header = std::str::from_utf8(header).map_err(|_| damaged())?;
    let after = |key: &str| {
        let rest = header.split_once(&format!("'{key}'"))?.1;
        Some(rest.trim_start().strip_prefix(':')?.trim_start())
    };
    let kind = after("descr").and_then(|rest| rest.strip_prefix('\'')?.split_once('\''));
    let kind = kind.ok_or_else(damaged)?.0.to_owned();
    let is_fortran = after("fortran_order").ok_or_else(damaged)?;
    let is_fortran = is_fortran.starts_with("True");
    let shape = after("shape").and_then(|rest| rest.strip_prefix('(')?.split_once(')'));
    let sizes = shape.ok_or_else(damaged)?.0.split(',').map(str::trim);
    let shape = sizes
        .filter(|size| !size.is_empty())
        .map(|size| size.parse::<usize>().map_err(|_| damaged()))
        .collect::<Result<Vec<usize>, String>>()?;
    let item = item_bytes(&kind)
        .ok_or_else(|| format!("expected numbers or text, got values of type {kind:?}"))?;
    let expected = shape
        .iter()
        .try_fold(item, |product, size| product.checked_mul(*size));
    let got = bytes.len() - start - length;
    if expected != Some(got) {
        return Err(format!("expected values of {shape:?}, got {got} bytes"));
    }
    bytes.drain(..start + length);
    Ok(Stored {
        kind,
        is_fortran,
        shape,
        bytes,
    })
}

/// Bytes of a value of a type such as `<f4`, `|u1` or `<U12`.
fn item_bytes(kind: &str) -> Option<usize> {
    let size = kind.get(2..)?.parse::<usize>().ok()?;
    match kind.as_bytes().get(1)? {
        b'f' | b'i' | b'u' => matches!(size, 1 | 2 | 4 | 8).then_some(size),
        b'U' => size.checked_mul(4).filter(|bytes| *bytes > 0),
        _ => None,
    }
}

fn numbers<T>(stored: &Stored, convert: fn(f64) -> T) -> Result<Vec<T>, String> {
    macro_rules! decode {
        ($kind:ty) => {{
            let (items, _) = stored.bytes.as_chunks::<{ size_of::<$kind>() }>();
            let is_big = stored.kind.starts_with('>');
            let number = |item: &[u8; size_of::<$kind>()]| {
                if is_big {
                    <$kind>::from_be_bytes(*item)
                } else {
                    <$kind>::from_le_bytes(*item)
                }
            };
            Ok(items
                .iter()
                .map(|item| convert(number(item) as f64))
                .collect())
        }};
    }
    match &stored.kind[1..] {
        "f4" => decode!(f32),
        "f8" => decode!(f64),
        "i1" => decode!(i8),
        "i2" => decode!(i16),
        "i4" => decode!(i32),
        "i8" => decode!(i64),
        "u1" => decode!(u8),
        "u2" => decode!(u16),
        "u4" => decode!(u32),
        "u8" => decode!(u64),
        _ => Err(format!("expected numbers, got type {:?}", stored.kind)),
    }
}

fn texts(stored: &Stored) -> Option<Vec<String>> {
    let size = 4 * stored.kind.strip_prefix("<U")?.parse::<usize>().ok()?;
    let text = |item: &[u8]| {
        let (codes, _) = item.as_chunks::<4>();
        let codes = codes.iter().map(|code| u32::from_le_bytes(*code));
        codes
            .take_while(|code| *code != 0)
            .map(char::from_u32)
            .collect()
    };
    stored.bytes.chunks_exact(size).map(text).collect()
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;
    use ndarray::{Array2, Ix2, array};

    fn npy(header: &str, values: &[u8]) -> Vec<u8> {
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend((header.len() as u16).to_le_bytes());
        file.extend(header.as_bytes());
        file.extend(values);
        file
    }

    fn dict(kind: &str, order: &str, shape: &str) -> String {
        format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}\n")
    }

    fn bytes(values: [f32; 6]) -> Vec<u8> {
        values.iter().flat_map(|x| x.to_le_bytes()).collect()
    }

    #[test]
    fn values_are_held_against_the_shape() {
        let six = bytes([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert!(parse(npy(&dict("<f4", "False", "(2, 3)"), &six)).is_ok());
        for shape in [
            "(2, 4)",
            "(1000000000000000000,)",
            "(4294967296, 4294967296, 3)",
            "(0, 1000000000000)",
            "(-2, -3)",
            "(2, 3",
            "2, 3",
        ] {
            assert!(
                parse(npy(&dict("<f4", "False", shape), &six)).is_err(),
                "{shape}"
            );
        }
        for kind in ["|O", "<f3", "<c8", "f", "", "<U0", "<U99999999999999999999"] {
            assert!(
                parse(npy(&dict(kind, "False", "(2, 3)"), &six)).is_err(),
                "{kind}"
            );
        }
        let deep = format!("{{'descr': '<f4', 'shape': {}", "(".repeat(60_000));
        assert!(parse(npy(&deep, &six)).is_err());
        let mut long = npy("", &[]);
        long[6] = 2;
        long.extend([255; 64]);
        assert!(parse(long).is_err());
    }

    #[test]
    fn every_order_and_type_of_numpy_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let mut writer = ndarray_npy::NpzWriter::new(File::create(&path).unwrap());
        let expected: Array2<f32> = array![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
        writer.add_array("f4", &expected).unwrap();
        writer.add_array("f8", &expected.mapv(f64::from)).unwrap();
        writer
            .add_array("i8", &expected.mapv(|x| x as i64))
            .unwrap();
        writer.add_array("u1", &expected.mapv(|x| x as u8)).unwrap();
        let fortran = Array::from_shape_vec((2, 3).f(), vec![1.0f32, 4.0, 2.0, 5.0, 3.0, 6.0]);
        writer.add_array("turned", &fortran.unwrap()).unwrap();
        writer.finish().unwrap();
        let mut archive = NumpyArchive::open(&path).unwrap();
        for name in ["f4", "f8", "i8", "u1", "turned"] {
            assert_eq!(archive.array::<Ix2>(name).unwrap(), expected, "{name}");
        }
        let message = archive.array::<ndarray::Ix3>("f4").unwrap_err().to_string();
        assert!(message.contains("3 dimensions, got [2, 3]"), "{message}");
        let message = archive.number("f4").unwrap_err().to_string();
        assert!(message.contains("one number"), "{message}");
        assert!(archive.texts("f4").is_err() && archive.number("none").is_err());
    }

    #[test]
    fn deflated_arrays_are_read_and_false_sizes_are_not() {
        use std::io::Write;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated);
        let mut writer = zip::ZipWriter::new(File::create(&path).unwrap());
        writer.start_file("a.npy", options).unwrap();
        let six = bytes([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let file = npy(&dict("<f4", "False", "(2, 3)"), &six);
        writer.write_all(&file).unwrap();
        writer.finish().unwrap();
        let mut archive = NumpyArchive::open(&path).unwrap();
        assert_eq!(archive.array::<Ix2>("a").unwrap()[[1, 2]], 6.0);
        // The directory at the end now claims four gigabytes.
        let mut bytes = std::fs::read(&path).unwrap();
        let size = (file.len() as u32).to_le_bytes();
        let at = bytes.windows(4).rposition(|four| four == size).unwrap();
        bytes[at..at + 4].copy_from_slice(&0xf000_0000u32.to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        let mut archive = NumpyArchive::open(&path).unwrap();
        let message = archive.array::<Ix2>("a").unwrap_err().to_string();
        assert!(message.contains("a claim of 4026531840"), "{message}");
    }

    #[test]
    fn big_endian_numbers_are_turned() {
        let values: Vec<u8> = [1.5f32, -2.0]
            .iter()
            .flat_map(|x| x.to_be_bytes())
            .collect();
        let stored = parse(npy(&dict(">f4", "False", "(2,)"), &values)).unwrap();
        assert_eq!(numbers(&stored, |x| x).unwrap(), [1.5, -2.0]);
    }
}
