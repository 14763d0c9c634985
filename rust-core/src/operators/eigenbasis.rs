//! The smoothest functions on a surface: eigenvectors of its Laplacian.

use faer::{Mat, Side};
use rayon::prelude::*;

use super::{
    Operators, SparseCholesky,
    lanczos::{BLOCK, SymmetricOperator, largest},
};
use crate::{
    Error, Result,
    cache::{Arrays, Cache, CacheKey},
    job::ProgressFn,
};

/// Raise this when the computation changes its results.
const VERSION: u32 = 1;

/// The first eigenpairs of `L φ = λ M φ`.
///
/// The sign of each vector makes its largest entry positive, or the first of several equally large.
/// The vectors of a multiple eigenvalue are any orthonormal basis of their space. The vectors of
/// eigenvalue zero are the constants of each connected part, in order of parts.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenbasis {
    /// `[K]`, ascending from zero, one over mesh units squared.
    pub values: Vec<f64>,
    /// `[R, K]`, row-major, orthonormal under the mass.
    pub vectors: Vec<f64>,
}

impl Operators {
    /// The `count` smallest eigenpairs, or all if there are fewer rows.
    ///
    /// Shift-invert block Lanczos with one sparse Cholesky factorisation; small meshes use a dense
    /// solver. The constants of connected parts are known, so the iteration leaves them out.
    /// Otherwise it would have to find an eigenvalue of multiplicity 56 for a head of 56 parts.
    ///
    /// # Errors
    /// `InvalidInput` if `count` is 0; `Numerics` if the iteration does not converge; `Cancelled`.
    pub fn eigenbasis(&self, count: usize, progress: ProgressFn<'_>) -> Result<Eigenbasis> {
        if count == 0 {
            return Err(Error::InvalidInput(
                "eigenpairs: expected at least 1, got 0".into(),
            ));
        }
        let count = count.min(self.rows());
        let constants = self.parts.count.min(count);
        let varying = count - constants;
        let dimension = (2 * varying)
            .max(varying + 4 * BLOCK)
            .next_multiple_of(BLOCK);
        let (values, columns) = if varying == 0 {
            (Vec::new(), Vec::new())
        } else if self.rows() <= 2 * dimension + self.parts.count {
            self.dense_pairs(varying)?
        } else {
            self.lanczos_pairs(varying, dimension, progress)?
        };
        Ok(self.assemble(constants, &values, &columns))
    }

    /// [`Operators::eigenbasis`] through the cache.
    ///
    /// # Errors
    /// Those of [`Operators::eigenbasis`].
    pub fn eigenbasis_cached(
        &self,
        count: usize,
        cache: &Cache,
        progress: ProgressFn<'_>,
    ) -> Result<Eigenbasis> {
        let key = CacheKey::new("eigenbasis", VERSION)
            .u32s(&[count as u32])
            .u32s(&self.laplacian.indices)
            .f64s(&self.laplacian.values)
            .f64s(&self.mass);
        let encode = |basis: &Eigenbasis| {
            let pairs = basis.values.len();
            let mut arrays = Arrays::default();
            arrays.insert_f64("values", &[pairs], basis.values.clone());
            arrays.insert_f64("vectors", &[self.rows(), pairs], basis.vectors.clone());
            arrays
        };
        let decode = |mut arrays: Arrays| {
            let (_, values) = arrays.take_f64("values")?;
            let (_, vectors) = arrays.take_f64("vectors")?;
            Some(Eigenbasis { values, vectors })
        };
        cache.get_or_make(&key, decode, encode, || self.eigenbasis(count, progress))
    }

    fn root_mass(&self) -> Vec<f64> {
        self.mass.iter().map(|m| m.sqrt()).collect()
    }

    /// Non-constant pairs of `M^-½ L M^-½`, column-major, by faer's dense solver.
    fn dense_pairs(&self, pairs: usize) -> Result<(Vec<f64>, Vec<f64>)> {
        let (n, root) = (self.rows(), self.root_mass());
        let mut matrix = Mat::zeros(n, n);
        for i in 0..n {
            for (j, value) in self.laplacian.row(i) {
                matrix[(i, j)] = value / (root[i] * root[j]);
            }
        }
        // Move the constants to the far end of the spectrum.
        let top = 2.0 * (0..n).map(|i| matrix[(i, i)]).fold(0.0, f64::max) + 1.0 / self.area();
        for vector in self.constants(&root).chunks(n) {
            for i in (0..n).filter(|&i| vector[i] != 0.0) {
                for j in (0..n).filter(|&j| vector[j] != 0.0) {
                    matrix[(i, j)] += top * vector[i] * vector[j];
                }
            }
        }
        let eigen = matrix
            .self_adjoint_eigen(Side::Lower)
            .map_err(|e| Error::Numerics(format!("dense eigenvectors of size {n}: {e:?}")))?;
        let values = (0..pairs)
            .map(|k| eigen.S().column_vector()[k].max(0.0))
            .collect();
        let columns = (0..pairs).flat_map(|k| (0..n).map(move |i| (i, k)));
        Ok((values, columns.map(|at| eigen.U()[at]).collect()))
    }

    fn lanczos_pairs(
        &self,
        pairs: usize,
        dimension: usize,
        progress: ProgressFn<'_>,
    ) -> Result<(Vec<f64>, Vec<f64>)> {
        // By Weyl's law the largest of these eigenvalues is near 4π pairs / area.
        let shift = 0.03 * 4.0 * std::f64::consts::PI * pairs as f64 / self.area();
        let shifted = self.laplacian.add_diagonal(shift, &self.mass)?;
        let operator = ShiftInvert {
            factor: SparseCholesky::factor(&shifted)?,
            root_mass: self.root_mass(),
        };
        let constants = self.constants(&operator.root_mass);
        let (inverse, columns) = largest(&operator, constants, pairs, dimension, progress)?;
        let values = inverse
            .iter()
            .map(|theta| (1.0 / theta - shift).max(0.0))
            .collect();
        Ok((values, columns))
    }

    /// Unit vectors `M^½ 1` of every connected part, column-major.
    fn constants(&self, root_mass: &[f64]) -> Vec<f64> {
        let mut area = vec![0.0; self.parts.count];
        let mut vectors = vec![0.0; self.parts.count * self.rows()];
        for (row, &part) in self.parts.of_vertex.iter().enumerate() {
            area[part as usize] += self.mass[row];
            vectors[part as usize * self.rows() + row] = root_mass[row];
        }
        for (vector, area) in vectors.chunks_mut(self.rows()).zip(area) {
            vector.iter_mut().for_each(|x| *x /= area.sqrt());
        }
        vectors
    }

    /// Puts the constants before the pairs, turns `M^½ φ` into `φ` and stores the vectors by rows.
    fn assemble(&self, constants: usize, values: &[f64], columns: &[f64]) -> Eigenbasis {
        let (rows, root) = (self.rows(), self.root_mass());
        let mut all = self.constants(&root);
        all.truncate(constants * rows);
        all.extend_from_slice(columns);
        all.par_chunks_mut(rows).for_each(|column| {
            column.iter_mut().zip(&root).for_each(|(x, m)| *x /= m);
            make_largest_positive(column);
        });
        let count = constants + values.len();
        let mut vectors = vec![0.0; rows * count];
        vectors
            .par_chunks_mut(count)
            .enumerate()
            .for_each(|(row, out)| {
                for (k, value) in out.iter_mut().enumerate() {
                    *value = all[k * rows + row];
                }
            });
        let mut ascending = vec![0.0; constants];
        ascending.extend_from_slice(values);
        Eigenbasis {
            values: ascending,
            vectors,
        }
    }
}

fn make_largest_positive(column: &mut [f64]) {
    let largest = column
        .iter()
        .fold(0f64, |best, &x| if x.abs() > best.abs() { x } else { best });
    if largest < 0.0 {
        column.iter_mut().for_each(|x| *x = -*x);
    }
}

/// `M^½ (L + σ M)⁻¹ M^½`: eigenvalues `1 / (λ + σ)`.
struct ShiftInvert {
    factor: SparseCholesky,
    root_mass: Vec<f64>,
}

impl SymmetricOperator for ShiftInvert {
    fn size(&self) -> usize {
        self.root_mass.len()
    }

    fn apply(&self, block: &mut [f64]) {
        let scale = |block: &mut [f64]| {
            for column in block.chunks_mut(self.size()) {
                column
                    .iter_mut()
                    .zip(&self.root_mass)
                    .for_each(|(x, m)| *x *= m);
            }
        };
        scale(block);
        self.factor.solve_in_place(block, block.len() / self.size());
        scale(block);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{
        OperatorOptions,
        fixtures::{Golden, dense_eigenvalues, icosphere, joined, square},
    };
    use super::*;
    use crate::{CachePolicy, job::SILENT, mesh::Mesh};

    fn operators(mesh: &Mesh) -> Operators {
        Operators::new(mesh, &OperatorOptions::default()).unwrap()
    }

    /// Checks orthonormality under the mass, `L φ = λ M φ`, and the signs.
    fn check(ops: &Operators, basis: &Eigenbasis) {
        let (rows, k) = (ops.rows(), basis.values.len());
        let column =
            |j: usize| -> Vec<f64> { (0..rows).map(|i| basis.vectors[i * k + j]).collect() };
        let columns: Vec<_> = (0..k).map(column).collect();
        for a in 0..k {
            for b in 0..=a {
                let product: f64 = (0..rows)
                    .map(|i| ops.mass[i] * columns[a][i] * columns[b][i])
                    .sum();
                assert!(
                    (product - f64::from(u8::from(a == b))).abs() < 1e-9,
                    "{a} {b}: {product}"
                );
            }
            let image = ops.laplacian.mul(&columns[a]);
            let scale = basis.values[k - 1];
            for i in 0..rows {
                let residual =
                    (image[i] - basis.values[a] * ops.mass[i] * columns[a][i]) / ops.mass[i].sqrt();
                assert!(residual.abs() < 1e-6 * scale, "{a}: {residual}");
            }
            let top = columns[a]
                .iter()
                .fold(0f64, |t, &x| if x.abs() > t.abs() { x } else { t });
            assert!(top > 0.0);
        }
    }

    fn check_values(got: &[f64], expected: &[f64], relative: f64) {
        for (i, (g, e)) in got.iter().zip(expected).enumerate() {
            let close = if *e > 1e-6 {
                (g - e).abs() < relative * e
            } else {
                g.abs() < 1e-6
            };
            assert!(close, "eigenvalue {i}: expected {e}, got {g}");
        }
    }

    #[test]
    fn both_solvers_match_the_reference() {
        let golden = Golden::open("robust_laplacian.safetensors");
        for name in [
            "sphere",
            "slivers",
            "torn_sphere",
            "two_components",
            "duplicate_faces",
        ] {
            let ops =
                operators(&golden.mesh(&format!("{name}.vertices"), &format!("{name}.faces")));
            let expected = golden.numbers(&format!("{name}.evals"));
            let basis = ops.eigenbasis(24, SILENT).unwrap();
            check_values(&basis.values, &expected, 1e-3);
            check(&ops, &basis);
        }
    }

    #[test]
    fn lanczos_equals_the_dense_twin() {
        for mesh in [icosphere(3), joined(&square(15), &icosphere(3), [4.0; 3])] {
            let ops = operators(&mesh);
            let basis = ops.eigenbasis(60, SILENT).unwrap();
            assert!(ops.rows() > 4 * 60);
            check_values(&basis.values, &dense_eigenvalues(&ops), 1e-9);
            check(&ops, &basis);
        }
    }

    #[test]
    fn fifty_six_parts_have_fifty_six_constants() {
        let mut mesh = icosphere(3);
        for i in 1..56 {
            mesh = joined(&mesh, &square(2), [3.0 * i as f32, 0.0, 0.0]);
        }
        let ops = operators(&mesh);
        let basis = ops.eigenbasis(70, SILENT).unwrap();
        assert!(basis.values[..56].iter().all(|&v| v == 0.0));
        check_values(&basis.values, &dense_eigenvalues(&ops), 1e-8);
        check(&ops, &basis);
        assert!(
            ops.eigenbasis(10, SILENT)
                .unwrap()
                .values
                .iter()
                .all(|&v| v == 0.0)
        );
    }

    #[test]
    fn more_pairs_than_rows_are_cut_and_none_is_an_error() {
        let ops = operators(&icosphere(0));
        let basis = ops.eigenbasis(128, SILENT).unwrap();
        assert_eq!(basis.values.len(), 12);
        check(&ops, &basis);
        assert!(matches!(
            ops.eigenbasis(0, SILENT),
            Err(Error::InvalidInput(_))
        ));
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        let ops = operators(&icosphere(4));
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| ops.eigenbasis(30, SILENT).unwrap())
        };
        assert_eq!(with(1), with(3));
    }

    #[test]
    fn the_cache_gives_the_same_basis() {
        let ops = operators(&icosphere(2));
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(&CachePolicy::Folder(folder.path().into()));
        let fresh = ops.eigenbasis_cached(20, &cache, SILENT).unwrap();
        assert_eq!(fresh, ops.eigenbasis_cached(20, &cache, SILENT).unwrap());
        // The folder also holds its mark.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
        ops.eigenbasis_cached(21, &cache, SILENT).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
    }
}
