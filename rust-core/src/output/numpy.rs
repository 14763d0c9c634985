//! Reads arrays from numpy archives (.npz), stored or deflated, which Anyface or numpy wrote.
//!
//! This does not use ndarray-npy, which allocates whatever size a header claims and follows nested
//! brackets in a header to any depth. Here a header is short text. Its shape is checked against the
//! size of the file before an array is made, and values are converted while they are read.

use std::{
    fmt::Display,
    io::{BufReader, Read},
    path::{Path, PathBuf},
};

use ndarray::{Array, Dimension, IxDyn, ShapeBuilder};
use zip::{ZipArchive, read::ZipFile};

use crate::{
    Error, Result,
    job::{Input, InputKind},
};

/// Longest header that is read, bytes. The limit of numpy itself is 10,000 characters.
const LONGEST_HEADER: usize = 1 << 16;
/// An array may take this much memory, bytes, and in addition [`INFLATED`] times the bytes that the
/// archive has for it.
const ANY_ARRAY: u64 = 64 << 20;
/// Deflated motion takes a third of its bytes, and a tenth if most of the mesh rests. Zeros alone,
/// which deflate to a thousandth, would fill any memory.
const INFLATED: u64 = 64;
/// Most bytes of texts. Each becomes a string of its own, which takes ten times its bytes.
const MAX_TEXT: u64 = 16 << 20;
/// Bytes that are converted at a time, a multiple of every size of a number.
const CHUNK: usize = 1 << 16;

/// An archive that is open for reading.
pub(super) struct NumpyArchive {
    path: PathBuf,
    zip: ZipArchive<BufReader<Input>>,
    /// Size of the file, bytes.
    length: u64,
}

/// What an array's header says.
struct Header {
    /// Type of the values, such as `<f4`.
    kind: String,
    is_fortran: bool,
    shape: Vec<usize>,
    /// Number of values.
    count: usize,
}

/// An array whose header was read. Its values follow.
struct Stored<'a> {
    header: Header,
    values: ZipFile<'a, BufReader<Input>>,
    /// The most memory that the values may take, bytes.
    most_memory: u64,
}

impl NumpyArchive {
    /// # Errors
    /// `Io` if the file cannot be read, `InvalidInput` if it is no archive.
    pub(super) fn open(path: &Path) -> Result<NumpyArchive> {
        let file = Input::open(path, InputKind::Arrays)?;
        let length = file.length().map_err(Error::io(path))?;
        let zip = ZipArchive::new(BufReader::new(file)).map_err(|e| {
            let path = path.display();
            Error::InvalidInput(format!("{path}: expected an npz archive ({e})"))
        })?;
        let path = path.to_owned();
        Ok(NumpyArchive { path, zip, length })
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
    /// `InvalidInput` if it is missing, damaged, not numbers, has another number of dimensions or
    /// is larger than the file's size justifies; `OutOfMemory` if memory cannot hold it.
    pub(super) fn array<D: Dimension>(&mut self, name: &str) -> Result<Array<f32, D>> {
        self.read(name, |stored| {
            let shape = stored.header.shape.clone();
            let dimensions = D::NDIM.unwrap_or_default();
            if shape.len() != dimensions {
                return Err(refusal(&format!(
                    "expected {dimensions} dimensions, got {shape:?}"
                )));
            }
            let is_fortran = stored.header.is_fortran;
            let values = stored.numbers(|x| x as f32)?;
            let shape = IxDyn(&shape).set_f(is_fortran);
            let array = Array::from_shape_vec(shape, values).map_err(|e| refusal(&e))?;
            array.into_dimensionality::<D>().map_err(|e| refusal(&e))
        })
    }

    /// One number, f32, f64 or an integer, alone or in an array of one.
    ///
    /// # Errors
    /// Those of [`NumpyArchive::array`].
    pub(super) fn number(&mut self, name: &str) -> Result<f64> {
        self.read(name, |stored| {
            let shape = stored.header.shape.clone();
            let is_one = stored.header.count == 1;
            let value = is_one.then(|| stored.numbers(|x| x)).transpose()?;
            let value = value.and_then(|values| values.first().copied());
            value.ok_or_else(|| refusal(&format!("expected one number, got {shape:?}")))
        })
    }

    /// Texts of numpy's own Unicode type `<U…`: UTF-32, padded with zeros.
    ///
    /// # Errors
    /// Those of [`NumpyArchive::array`].
    pub(super) fn texts(&mut self, name: &str) -> Result<Vec<String>> {
        self.read(name, |stored| stored.texts())
    }

    /// Reads an array by `convert`. Its errors get the names of the file and of the array.
    fn read<T>(&mut self, name: &str, convert: impl FnOnce(Stored<'_>) -> Result<T>) -> Result<T> {
        if !self.has(name) {
            let (path, got) = (self.path.display(), self.names().join(", "));
            return Err(Error::InvalidInput(format!(
                "{path}: expected an array {name}, got {got}"
            )));
        }
        let entry = self.zip.by_name(&format!("{name}.npy"));
        let entry = entry.map_err(|e| refusal(&e));
        let value = entry.and_then(|entry| convert(Stored::begin(entry, self.length)?));
        value.map_err(|e| match e {
            Error::InvalidInput(what) => {
                Error::InvalidInput(format!("{}: {name}: {what}", self.path.display()))
            }
            Error::OutOfMemory(what) => {
                Error::OutOfMemory(format!("{}: {name}: {what}", self.path.display()))
            }
            other => other,
        })
    }
}

/// An error of an array's contents, which is not named yet.
fn refusal(what: &dyn Display) -> Error {
    Error::InvalidInput(what.to_string())
}

impl<'a> Stored<'a> {
    /// Reads the header of an entry. `file_bytes`: the size of the archive, because the sizes that an
    /// archive states of its entries are claims.
    fn begin(mut entry: ZipFile<'a, BufReader<Input>>, file_bytes: u64) -> Result<Stored<'a>> {
        let (header, header_bytes) = read_header(&mut entry)?;
        let expected = header.bytes();
        let got = entry.size().checked_sub(header_bytes as u64);
        if expected.is_none() || expected != got {
            let got = got.unwrap_or_default();
            let shape = &header.shape;
            return Err(refusal(&format!(
                "expected values of {shape:?}, got {got} bytes"
            )));
        }
        let stored = entry.compressed_size().min(file_bytes);
        Ok(Stored {
            header,
            values: entry,
            most_memory: stored.saturating_mul(INFLATED).saturating_add(ANY_ARRAY),
        })
    }

    /// Reads all values as numbers.
    fn numbers<T>(mut self, convert: fn(f64) -> T) -> Result<Vec<T>> {
        macro_rules! read {
            ($kind:ty) => {{
                let is_big = self.header.kind.starts_with('>');
                let number = |item: &[u8; size_of::<$kind>()]| {
                    if is_big {
                        <$kind>::from_be_bytes(*item)
                    } else {
                        <$kind>::from_le_bytes(*item)
                    }
                };
                self.items(|item| convert(number(item) as f64))
            }};
        }
        match self.header.kind.get(1..).unwrap_or_default() {
            "f4" => read!(f32),
            "f8" => read!(f64),
            "i1" => read!(i8),
            "i2" => read!(i16),
            "i4" => read!(i32),
            "i8" => read!(i64),
            "u1" => read!(u8),
            "u2" => read!(u16),
            "u4" => read!(u32),
            "u8" => read!(u64),
            _ => Err(refusal(&format!(
                "expected numbers, got type {:?}",
                self.header.kind
            ))),
        }
    }

    /// Reads all values, each of `N` bytes, and checks that nothing follows them.
    fn items<const N: usize, T>(&mut self, convert: impl Fn(&[u8; N]) -> T) -> Result<Vec<T>> {
        let mut values = self.room(self.header.count)?;
        let mut chunk = vec![0; CHUNK];
        let mut left = self.header.count * N;
        while left > 0 {
            let part = &mut chunk[..left.min(CHUNK)];
            self.values.read_exact(part).map_err(|e| refusal(&e))?;
            left -= part.len();
            let (items, _) = part.as_chunks::<N>();
            values.extend(items.iter().map(&convert));
        }
        self.end()?;
        Ok(values)
    }

    /// An empty list with room for `count` values, if the file's size justifies as many.
    fn room<T>(&self, count: usize) -> Result<Vec<T>> {
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
        if bytes > self.most_memory {
            return Err(refusal(&format!(
                "expected at most {} MiB for an array of which {} bytes are stored, got {} MiB; save it without compression",
                self.most_memory >> 20,
                self.values.compressed_size(),
                bytes >> 20
            )));
        }
        let mut values = Vec::new();
        let reserved = values.try_reserve_exact(count);
        reserved.map_err(|_| Error::OutOfMemory(format!("{} MiB", bytes >> 20)))?;
        Ok(values)
    }

    /// Checks that the entry ends here, and with it its checksum.
    fn end(&mut self) -> Result<()> {
        match self.values.read(&mut [0]).map_err(|e| refusal(&e))? {
            0 => Ok(()),
            _ => Err(refusal(&"expected the end of the array, got more bytes")),
        }
    }

    fn texts(mut self) -> Result<Vec<String>> {
        let expected = || refusal(&"expected an array of text");
        let letters = self.header.kind.strip_prefix("<U");
        let letters = letters.and_then(|letters| letters.parse::<usize>().ok());
        let size = 4 * letters.ok_or_else(expected)?;
        let length = self.header.count.saturating_mul(size);
        if length as u64 > MAX_TEXT {
            let most = MAX_TEXT >> 20;
            let message = format!("expected at most {most} MiB of text, got {length} bytes");
            return Err(refusal(&message));
        }
        let mut bytes = vec![0; length];
        self.values
            .read_exact(&mut bytes)
            .map_err(|e| refusal(&e))?;
        self.end()?;
        let text = |item: &[u8]| {
            let (codes, _) = item.as_chunks::<4>();
            let codes = codes.iter().map(|code| u32::from_le_bytes(*code));
            codes
                .take_while(|code| *code != 0)
                .map(char::from_u32)
                .collect()
        };
        let texts: Option<Vec<String>> = bytes.chunks_exact(size).map(text).collect();
        texts.ok_or_else(expected)
    }
}

impl Header {
    /// Bytes of all values. `None` for more than can be counted.
    fn bytes(&self) -> Option<u64> {
        (self.count as u64).checked_mul(item_bytes(&self.kind)? as u64)
    }
}

/// Reads the header of an .npy file. Returns it and the number of bytes that were read.
fn read_header(from: &mut impl Read) -> Result<(Header, usize)> {
    let damaged = || refusal(&"expected an array of numpy's format, got something else");
    let mut start = [0; 10];
    from.read_exact(&mut start).map_err(|_| damaged())?;
    let two = usize::from(u16::from_le_bytes([start[8], start[9]]));
    let (begins, length) = match (start.starts_with(b"\x93NUMPY"), start[6]) {
        (true, 1) => (10, two),
        (true, 2 | 3) => {
            let mut high = [0; 2];
            from.read_exact(&mut high).map_err(|_| damaged())?;
            (12, two | usize::from(u16::from_le_bytes(high)) << 16)
        }
        _ => return Err(damaged()),
    };
    if length > LONGEST_HEADER {
        return Err(damaged());
    }
    let mut text = vec![0; length];
    from.read_exact(&mut text).map_err(|_| damaged())?;
    let text = std::str::from_utf8(&text).map_err(|_| damaged())?;
    Ok((parse_header(text)?, begins + length))
}

fn parse_header(text: &str) -> Result<Header> {
    let damaged = || refusal(&"expected an array of numpy's format, got something else");
    let after = |key: &str| {
        let rest = text.split_once(&format!("'{key}'"))?.1;
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
        .collect::<Result<Vec<usize>>>()?;
    if item_bytes(&kind).is_none() {
        let message = format!("expected numbers or text, got values of type {kind:?}");
        return Err(refusal(&message));
    }
    let count = shape
        .iter()
        .try_fold(1usize, |product, size| product.checked_mul(*size));
    let count = count.ok_or_else(|| refusal(&format!("expected an array, got {shape:?}")))?;
    Ok(Header {
        kind,
        is_fortran,
        shape,
        count,
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

#[cfg(test)]
mod tests {
    use std::{fs::File, io::Write};

    use super::*;
    use ndarray::{Array2, Ix1, Ix2, array};
    use zip::CompressionMethod;

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

    /// An archive with one array `a`.
    fn archive_of(npy: &[u8], method: CompressionMethod) -> (tempfile::TempDir, NumpyArchive) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        let mut writer = zip::ZipWriter::new(File::create(&path).unwrap());
        writer.start_file("a.npy", options).unwrap();
        writer.write_all(npy).unwrap();
        writer.finish().unwrap();
        let archive = NumpyArchive::open(&path).unwrap();
        (folder, archive)
    }

    fn read<D: Dimension>(npy: &[u8]) -> Result<Array<f32, D>> {
        archive_of(npy, CompressionMethod::Stored).1.array("a")
    }

    #[test]
    fn values_are_held_against_the_shape() {
        let six = bytes([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert!(read::<Ix2>(&npy(&dict("<f4", "False", "(2, 3)"), &six)).is_ok());
        for shape in [
            "(2, 4)",
            "(2, 2)",
            "(1000000000000000000,)",
            "(4294967296, 4294967296, 3)",
            "(0, 1000000000000)",
            "(-2, -3)",
            "(2, 3",
            "2, 3",
        ] {
            assert!(
                read::<Ix2>(&npy(&dict("<f4", "False", shape), &six)).is_err(),
                "{shape}"
            );
        }
        for kind in ["|O", "<f3", "<c8", "f", "", "<U0", "<U99999999999999999999"] {
            assert!(
                read::<Ix2>(&npy(&dict(kind, "False", "(2, 3)"), &six)).is_err(),
                "{kind}"
            );
        }
        let deep = format!("{{'descr': '<f4', 'shape': {}", "(".repeat(60_000));
        assert!(read::<Ix2>(&npy(&deep, &six)).is_err());
        let mut long = npy("", &[]);
        long[6] = 2;
        long.extend([255; 64]);
        assert!(
            read::<Ix2>(&long).is_err()
                && read::<Ix2>(b"").is_err()
                && read::<Ix2>(&long[..9]).is_err()
        );
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
        let six = bytes([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let file = npy(&dict("<f4", "False", "(2, 3)"), &six);
        let (folder, mut archive) = archive_of(&file, CompressionMethod::Deflated);
        assert_eq!(archive.array::<Ix2>("a").unwrap()[[1, 2]], 6.0);
        // The directory at the end now claims four gigabytes.
        let path = folder.path().join("a.npz");
        let mut bytes = std::fs::read(&path).unwrap();
        let size = (file.len() as u32).to_le_bytes();
        let at = bytes.windows(4).rposition(|four| four == size).unwrap();
        bytes[at..at + 4].copy_from_slice(&0xf000_0000u32.to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        let mut archive = NumpyArchive::open(&path).unwrap();
        let message = archive.array::<Ix2>("a").unwrap_err().to_string();
        assert!(message.contains("values of [2, 3], got 40265"), "{message}");
    }

    #[test]
    fn an_array_that_grows_far_beyond_its_bytes_is_refused() {
        let zeros = npy(&dict("|u1", "False", "(20000000,)"), &vec![0; 20_000_000]);
        let (_folder, mut archive) = archive_of(&zeros, CompressionMethod::Deflated);
        let error = archive.array::<Ix1>("a").unwrap_err();
        assert!(matches!(error, Error::InvalidInput(_)), "{error}");
        let message = error.to_string();
        assert!(message.contains("got 76 MiB; save it without"), "{message}");
        // The same array passes where the file has its bytes.
        assert_eq!(read::<Ix1>(&zeros).unwrap().len(), 20_000_000);
        let names = npy(&dict("<U1", "False", "(5000000,)"), &vec![0; 20_000_000]);
        let (_folder, mut archive) = archive_of(&names, CompressionMethod::Deflated);
        let message = archive.texts("a").unwrap_err().to_string();
        assert!(message.contains("at most 16 MiB of text"), "{message}");
    }

    #[test]
    fn an_array_that_memory_cannot_hold_is_told_as_such() {
        let npy = npy(&dict("<f4", "False", "(2,)"), &[0; 8]);
        let (_folder, mut archive) = archive_of(&npy, CompressionMethod::Stored);
        let entry = archive.zip.by_name("a.npy").unwrap();
        let mut stored = Stored::begin(entry, 1000).unwrap();
        stored.most_memory = u64::MAX;
        let error = stored.room::<f64>(usize::MAX / 16).unwrap_err();
        assert!(matches!(error, Error::OutOfMemory(_)), "{error}");
    }

    #[test]
    fn big_endian_numbers_are_turned() {
        let values: Vec<u8> = [1.5f32, -2.0]
            .iter()
            .flat_map(|x| x.to_be_bytes())
            .collect();
        let array = read::<Ix1>(&npy(&dict(">f4", "False", "(2,)"), &values));
        assert_eq!(array.unwrap().to_vec(), [1.5, -2.0]);
    }
}
