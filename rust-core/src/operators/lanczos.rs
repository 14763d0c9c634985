//! Thick-restart block Lanczos: the largest eigenpairs of a symmetric operator.
//!
//! A block version of Wu and Simon 2000. It reorthogonalises fully (classical Gram–Schmidt, twice),
//! so it need not track lost orthogonality. It fills the projected matrix with the inner products
//! themselves, so a restart needs no special form.
//!
//! In exact arithmetic, a block of `b` vectors finds at most `b` copies of an eigenvalue. The caller
//! therefore passes the known eigenvectors of high multiplicity (`locked`), and all work stays
//! orthogonal to them.

use faer::{Accum, Mat, MatMut, MatRef, Side, linalg::matmul::matmul};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::threads::threads;
use crate::{
    Error, Result,
    job::{ProgressFn, report},
};

/// The stage that the progress names.
const STAGE: &str = "operators";
/// Vectors that each step adds to the basis.
pub(crate) const BLOCK: usize = 8;
/// The method fails after this many restarts. Meshes take two or three.
const MAX_RESTARTS: usize = 40;
/// Largest accepted residual of an eigenpair, relative to its eigenvalue. The relative error of the
/// eigenvalue is then about the square of this.
const TOLERANCE: f64 = 1e-9;
/// A vector counts as linearly dependent if orthogonalisation shrinks it below this share of its
/// length.
const DEPENDENT: f64 = 1e-12;

/// A symmetric operator on vectors of `size` numbers.
pub(crate) trait SymmetricOperator {
    fn size(&self) -> usize;
    /// Applies the operator in place to each column of `block`, which is column-major.
    fn apply(&self, block: &mut [f64]);
}

/// The `count` largest eigenvalues, descending, and their orthonormal vectors, column-major.
///
/// `locked`: known orthonormal eigenvectors, column-major, which the result leaves out. `dimension`:
/// the most vectors in the basis, at least `count + 2 BLOCK`. The operator's size must exceed it by
/// more than a block and the locked vectors together.
///
/// # Errors
/// `Numerics` if the iteration does not converge; `Cancelled`.
pub(crate) fn largest(
    operator: &impl SymmetricOperator,
    locked: Vec<f64>,
    count: usize,
    dimension: usize,
    progress: ProgressFn<'_>,
) -> Result<(Vec<f64>, Vec<f64>)> {
    let mut space = Krylov::new(operator.size(), locked, dimension);
    for _ in 0..MAX_RESTARTS {
        while space.used + BLOCK <= dimension {
            report(progress, STAGE, 0.0)?;
            space.extend(operator);
        }
        let ritz = space.ritz()?;
        let converged = ritz.residuals.iter().zip(&ritz.values).take(count);
        if converged
            .clone()
            .all(|(residual, value)| *residual <= TOLERANCE * value.abs())
        {
            return Ok((ritz.values[..count].to_vec(), space.combine(&ritz, count)));
        }
        let keep = count + (dimension - count) / 3;
        space.restart(&ritz, keep);
    }
    Err(Error::Numerics(format!(
        "eigenvectors: expected {count} to converge within {MAX_RESTARTS} restarts"
    )))
}

/// An orthonormal basis, the block that comes next, and the operator projected onto the basis.
struct Krylov {
    size: usize,
    locked: Vec<f64>,
    /// `[size, dimension + BLOCK]`, column-major: `used` vectors, then the next block.
    basis: Vec<f64>,
    used: usize,
    /// `[dimension, dimension]`; the upper triangle is filled for the first `used` vectors.
    projected: Mat<f64>,
    /// `[BLOCK, BLOCK]`, couples the next block to the last one.
    tie: Mat<f64>,
    noise: ChaCha8Rng,
}

/// Eigenpairs of the projected matrix, descending.
struct Ritz {
    values: Vec<f64>,
    vectors: Mat<f64>,
    residuals: Vec<f64>,
}

fn view(data: &[f64], rows: usize) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(data, rows, data.len() / rows)
}

impl Krylov {
    fn new(size: usize, locked: Vec<f64>, dimension: usize) -> Krylov {
        let mut space = Krylov {
            size,
            locked,
            basis: vec![0.0; size * (dimension + BLOCK)],
            used: 0,
            projected: Mat::zeros(dimension, dimension),
            tie: Mat::zeros(BLOCK, BLOCK),
            noise: ChaCha8Rng::seed_from_u64(0x1ab5),
        };
        let mut start = vec![0.0; size * BLOCK];
        start.fill_with(|| space.noise.random_range(-1.0..1.0));
        space.reorthogonalise(&mut start);
        space.tie = space.orthonormalise(&mut start);
        space.basis[..size * BLOCK].copy_from_slice(&start);
        space
    }

    /// One step: adds the waiting block to the basis and computes the next one.
    fn extend(&mut self, operator: &impl SymmetricOperator) {
        let begin = self.size * self.used;
        let mut block = self.basis[begin..begin + self.size * BLOCK].to_vec();
        operator.apply(&mut block);
        self.used += BLOCK;
        let inner = self.reorthogonalise(&mut block);
        let column = self.used - BLOCK;
        for j in 0..BLOCK {
            for i in 0..=column + j {
                self.projected[(i, column + j)] = inner[(i, j)];
            }
        }
        self.tie = self.orthonormalise(&mut block);
        let begin = self.size * self.used;
        self.basis[begin..begin + block.len()].copy_from_slice(&block);
    }

    /// Makes `block` orthogonal to the basis and the locked vectors. Returns its inner products with
    /// the basis, `[used, BLOCK]`.
    fn reorthogonalise(&self, block: &mut [f64]) -> Mat<f64> {
        let columns = block.len() / self.size;
        let mut inner = Mat::zeros(self.used, columns);
        let basis = &self.basis[..self.size * self.used];
        for _ in 0..2 {
            if !self.locked.is_empty() {
                remove(&self.locked, block, self.size);
            }
            if self.used > 0 {
                inner += remove(basis, block, self.size);
            }
        }
        inner
    }

    /// Orthonormalises the columns of `block` and replaces dependent ones with random ones. Returns
    /// `R` of its QR decomposition, whose diagonal is zero where a column was replaced.
    fn orthonormalise(&mut self, block: &mut [f64]) -> Mat<f64> {
        let size = self.size;
        let mut r = Mat::zeros(BLOCK, BLOCK);
        for j in 0..BLOCK {
            let (done, rest) = block.split_at_mut(j * size);
            let column = &mut rest[..size];
            let before = norm(column);
            for _ in 0..2 {
                for (i, other) in done.chunks(size).enumerate() {
                    r[(i, j)] += subtract(other, column);
                }
            }
            let mut length = norm(column);
            if length > DEPENDENT * before {
                r[(j, j)] = length;
            } else {
                column.fill_with(|| self.noise.random_range(-1.0..1.0));
                for _ in 0..2 {
                    self.reorthogonalise(column);
                    done.chunks(size)
                        .for_each(|other| _ = subtract(other, column));
                }
                length = norm(column);
            }
            column.iter_mut().for_each(|x| *x /= length);
        }
        r
    }

    fn ritz(&self) -> Result<Ritz> {
        let n = self.used;
        let projected = self.projected.submatrix(0, 0, n, n);
        let eigen = projected
            .self_adjoint_eigen(Side::Upper)
            .map_err(|e| Error::Numerics(format!("eigenvectors of the projection: {e:?}")))?;
        let vectors = Mat::from_fn(n, n, |i, j| eigen.U()[(i, n - 1 - j)]);
        let values = (0..n)
            .map(|j| eigen.S().column_vector()[n - 1 - j])
            .collect();
        let tail = &self.tie * vectors.subrows(n - BLOCK, BLOCK);
        let residuals = (0..n).map(|j| tail.col(j).norm_l2()).collect();
        Ok(Ritz {
            values,
            vectors,
            residuals,
        })
    }

    /// The first `count` Ritz vectors, column-major.
    fn combine(&self, ritz: &Ritz, count: usize) -> Vec<f64> {
        let mut out = vec![0.0; self.size * count];
        matmul(
            MatMut::from_column_major_slice_mut(&mut out, self.size, count),
            Accum::Replace,
            view(&self.basis[..self.size * self.used], self.size),
            ritz.vectors.subcols(0, count),
            1.0,
            threads(),
        );
        out
    }

    /// Reduces the basis to the first `keep` Ritz vectors. The waiting block still follows them.
    fn restart(&mut self, ritz: &Ritz, keep: usize) {
        let combined = self.combine(ritz, keep);
        let next = self.size * self.used..self.size * (self.used + BLOCK);
        self.basis[..combined.len()].copy_from_slice(&combined);
        self.basis.copy_within(next, combined.len());
        self.projected.fill(0.0);
        for (i, &value) in ritz.values[..keep].iter().enumerate() {
            self.projected[(i, i)] = value;
        }
        self.used = keep;
    }
}

/// `block -= B Bᵀ block`; returns `Bᵀ block`.
fn remove(basis: &[f64], block: &mut [f64], size: usize) -> Mat<f64> {
    let basis = view(basis, size);
    let columns = block.len() / size;
    let mut inner = Mat::zeros(basis.ncols(), columns);
    let mut block = MatMut::from_column_major_slice_mut(block, size, columns);
    let par = threads();
    matmul(
        &mut inner,
        Accum::Replace,
        basis.transpose(),
        block.as_ref(),
        1.0,
        par,
    );
    matmul(&mut block, Accum::Add, basis, &inner, -1.0, par);
    inner
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn norm(a: &[f64]) -> f64 {
    inner(a, a).sqrt()
}

/// `a -= u (u·a)`; returns `u·a`.
fn subtract(u: &[f64], a: &mut [f64]) -> f64 {
    let share = inner(u, a);
    a.iter_mut().zip(u).for_each(|(x, y)| *x -= share * y);
    share
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::SILENT;

    struct Diagonal(Vec<f64>);

    impl SymmetricOperator for Diagonal {
        fn size(&self) -> usize {
            self.0.len()
        }

        fn apply(&self, block: &mut [f64]) {
            for column in block.chunks_mut(self.0.len()) {
                column.iter_mut().zip(&self.0).for_each(|(x, d)| *x *= d);
            }
        }
    }

    #[test]
    fn the_largest_entries_of_a_diagonal_come_first_without_the_locked_one() {
        let diagonal: Vec<f64> = (0..400).map(|i| 1.0 / (1.0 + i as f64)).collect();
        let mut locked = vec![0.0; 400];
        locked[0] = 1.0;
        let (values, vectors) =
            largest(&Diagonal(diagonal.clone()), locked, 20, 48, SILENT).unwrap();
        for i in 0..20 {
            assert!((values[i] - diagonal[i + 1]).abs() < 1e-13, "{i}");
            assert!((vectors[400 * i + i + 1].abs() - 1.0).abs() < 1e-8, "{i}");
        }
    }

    #[test]
    fn a_space_that_closes_early_goes_on_with_fresh_vectors() {
        // With three different values, the Krylov space of any block closes after three steps.
        let diagonal: Vec<f64> = (0..300)
            .map(|i| [3.0, 2.0, 1.0][usize::from(i >= 6) + usize::from(i >= 12)])
            .collect();
        let (values, _) = largest(&Diagonal(diagonal), Vec::new(), 14, 40, SILENT).unwrap();
        for (i, value) in values.iter().enumerate() {
            let expected = [3.0, 2.0, 1.0][usize::from(i >= 6) + usize::from(i >= 12)];
            assert!((value - expected).abs() < 1e-12, "{i}: {value}");
        }
    }
}
