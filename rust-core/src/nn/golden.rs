//! Reads golden files for the tests of the networks.

use std::{
    ops::Range,
    path::{Path, PathBuf},
};

use ndarray::{Array2, Array3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use super::surface::Surface;
use crate::models::Weights;

/// A file of `tests/goldens`.
pub(crate) fn path_of(file: &str) -> PathBuf {
    let goldens = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/goldens");
    goldens.join(file)
}

/// An array's name, shape and row-major values.
pub(crate) type Named = (String, Vec<usize>, Vec<f32>);

/// A file of inputs, weights and reference outputs.
pub(crate) struct Golden {
    bytes: Vec<u8>,
    arrays: Weights,
}

impl Golden {
    /// From `tests/goldens` of the workspace.
    pub fn open(name: &str) -> Self {
        Self::read(path_of(""), name)
    }

    /// From the parity files in the shared folder, `$ANYFACE_SHARED` or beside the workspace.
    pub fn open_shared(name: &str) -> Self {
        let shared = match std::env::var_os("ANYFACE_SHARED") {
            Some(folder) => PathBuf::from(folder),
            None => PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared"),
        };
        Self::read(shared.join("parity"), name)
    }

    fn read(folder: PathBuf, name: &str) -> Self {
        let path = folder.join(format!("{name}.safetensors"));
        let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let arrays = Weights::from_bytes(&bytes).unwrap();
        Golden { bytes, arrays }
    }

    /// The arrays whose names start with `weights.`.
    pub fn weights(&self) -> Weights {
        self.arrays.pp("weights")
    }

    /// Writes the arrays whose names start with `prefix` to a file of their own and strips the
    /// prefix. `edit` may change name, shape and values of each.
    pub fn write_arrays(&self, prefix: &str, path: &Path, edit: impl Fn(Named) -> Named) {
        let arrays: Vec<_> = self
            .names()
            .into_iter()
            .filter_map(|full| {
                let name = full.strip_prefix(prefix)?.to_owned();
                let (name, shape, values) = edit((name, self.shape(&full), self.values(&full)));
                let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                Some((name, shape, bytes))
            })
            .collect();
        let views = arrays.iter().map(|(name, shape, bytes)| {
            let view = TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap();
            (name, view)
        });
        std::fs::write(path, safetensors::serialize(views, None).unwrap()).unwrap();
    }

    pub fn metadata(&self, key: &str) -> String {
        let (_, metadata) = SafeTensors::read_metadata(&self.bytes).unwrap();
        metadata.metadata().as_ref().unwrap()[key].clone()
    }

    pub fn names(&self) -> Vec<String> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        file.names().into_iter().map(str::to_owned).collect()
    }

    pub fn shape(&self, name: &str) -> Vec<usize> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        file.tensor(name).unwrap().shape().to_vec()
    }

    pub fn values(&self, name: &str) -> Vec<f32> {
        self.arrays.values(name, &self.shape(name)).unwrap()
    }

    pub fn matrix(&self, name: &str) -> Array2<f32> {
        let shape = self.shape(name);
        Array2::from_shape_vec((shape[0], shape[1]), self.values(name)).unwrap()
    }

    pub fn cube(&self, name: &str) -> Array3<f32> {
        let shape = self.shape(name);
        Array3::from_shape_vec((shape[0], shape[1], shape[2]), self.values(name)).unwrap()
    }

    pub fn integers(&self, name: &str) -> Vec<usize> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let view = file.tensor(name).unwrap();
        let size = match view.dtype() {
            Dtype::I32 => 4,
            Dtype::I64 => 8,
            other => panic!("{name}: {other:?}"),
        };
        let low = |bytes: &[u8]| u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        view.data().chunks_exact(size).map(low).collect()
    }

    /// The operators of a DiffusionNet golden.
    pub fn surface(&self) -> Surface {
        let gradient = |name: &str| {
            let indices = self.integers(&format!("{name}.indices"));
            let values = self.values(&format!("{name}.values"));
            let (rows, columns) = indices.split_at(values.len());
            let pairs = rows.iter().zip(columns).zip(&values);
            let entries: Vec<_> = pairs.map(|((r, c), v)| (*r, *c, *v)).collect();
            entries
        };
        Surface::new(
            self.values("mass").into(),
            self.values("evals").into(),
            self.matrix("evecs"),
            gradient("gradX"),
            gradient("gradY"),
        )
        .unwrap()
    }
}

/// Largest absolute difference.
pub(crate) fn distance<'a>(
    got: impl IntoIterator<Item = &'a f32>,
    expected: impl IntoIterator<Item = &'a f32>,
) -> f32 {
    let (mut got, mut expected) = (got.into_iter(), expected.into_iter());
    let mut largest = 0.0f32;
    loop {
        match (got.next(), expected.next()) {
            (Some(a), Some(b)) => {
                let difference = (a - b).abs();
                assert!(difference.is_finite(), "{a} and {b}");
                largest = largest.max(difference);
            }
            (None, None) => return largest,
            _ => panic!("lengths differ"),
        }
    }
}

/// Numbers that make no sense in a config.
const ABSURD: [&str; 6] = [
    "0",
    "-1",
    "1000000000",
    "1152921504606846976",
    "1e300",
    "0.5",
];

/// Seeds of [`damage`] for the tests of damaged models: `ANYFACE_MUTATIONS` seeds (12 by default),
/// starting at `ANYFACE_MUTATIONS_FROM` (0 by default).
pub(crate) fn seeds() -> Range<u64> {
    let number = |name: &str, usual: u64| {
        let set = std::env::var(name).ok();
        set.map_or(usual, |text| text.parse().expect(name))
    };
    let from = number("ANYFACE_MUTATIONS_FROM", 0);
    from..from + number("ANYFACE_MUTATIONS", 12)
}

/// Damages a file in one to four places that `seed` chooses: replaces a byte or, in a text file, a
/// whole number.
pub(crate) fn damage(path: &Path, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut bytes = std::fs::read(path).unwrap();
    let is_text = path
        .extension()
        .is_some_and(|ending| ending != "safetensors");
    for _ in 0..random.random_range(1..=4) {
        let at = random.random_range(0..bytes.len());
        let digit = bytes[at..].iter().position(u8::is_ascii_digit);
        match digit.filter(|_| is_text && random.random()) {
            Some(first) => {
                let digits = bytes[at + first..]
                    .iter()
                    .take_while(|b| b.is_ascii_digit());
                let number = at + first..at + first + digits.count();
                bytes.splice(number, ABSURD[random.random_range(0..ABSURD.len())].bytes());
            }
            None => bytes[at] = random.random(),
        }
    }
    std::fs::write(path, bytes).unwrap();
}
