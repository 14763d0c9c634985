//! Sparse Cholesky by faer: a matrix is factored once and solved many times.
//!
//! faer chooses between the simplicial and the supernodal method; the ordering is AMD.
//! Triangular solves run one thread per block of columns: faer's own parallel solve was measured
//! five times slower than the sequential one on meshes. Blocks have a fixed width, so the result
//! does not depend on the number of threads.

use faer::{
    Conj, MatMut, Par, Side,
    dyn_stack::{MemBuffer, MemStack},
    sparse::{
        SparseColMatRef, SymbolicSparseColMatRef,
        linalg::cholesky::{
            CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
            factorize_symbolic_cholesky,
        },
    },
};
use rayon::prelude::*;

use super::{sparse::Csr, threads::threads};
use crate::{Error, Result};

/// Columns solved together by one thread.
const COLUMNS_PER_TASK: usize = 16;

/// Shares of the diagonal to add to it, tried in this order until the matrix can be factored.
const GROWTH: [f64; 4] = [1e-12, 1e-10, 1e-8, 1e-6];

/// `A = P L Lᵀ Pᵀ` of a symmetric positive definite matrix.
pub struct SparseCholesky {
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
    size: usize,
}

impl std::fmt::Debug for SparseCholesky {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let nnz = self.values.len();
        write!(f, "SparseCholesky {{ size: {}, nnz: {nnz} }}", self.size)
    }
}

impl SparseCholesky {
    /// Factors `matrix`; only its upper triangle is read.
    ///
    /// # Errors
    /// `ShapeMismatch` if it is not square; `Numerics` if it is not positive definite, or not
    /// finite, or too large for the memory at hand.
    pub fn factor(matrix: &Csr) -> Result<SparseCholesky> {
        let size = matrix.nrows();
        if matrix.ncols != size {
            return Err(Error::ShapeMismatch {
                what: "matrix to factor",
                expected: format!("[{size}, {size}]"),
                got: format!("[{size}, {}]", matrix.ncols),
            });
        }
        // The upper triangle stored by rows is the lower triangle stored by columns.
        let (indptr, indices, values) = upper_triangle(matrix);
        let lower = SparseColMatRef::new(
            SymbolicSparseColMatRef::new_checked(size, size, &indptr, None, &indices),
            &values,
        );
        factor_lower(lower, size)
    }

    /// [`SparseCholesky::factor`] of a matrix that is positive definite except for rounding, as on
    /// meshes of slivers and needles. If that fails with `Numerics`, the diagonal grows by 1e-12 of
    /// itself, then by a hundred times more at each further try, up to 1e-6.
    ///
    /// # Errors
    /// Those of [`SparseCholesky::factor`] with the largest growth.
    pub fn factor_rounded(matrix: &Csr) -> Result<SparseCholesky> {
        let mut factored = SparseCholesky::factor(matrix);
        for share in GROWTH {
            if !matches!(factored, Err(Error::Numerics(_))) {
                break;
            }
            let rows = 0..matrix.nrows();
            let diagonal: Vec<f64> = rows.map(|row| matrix.get(row, row)).collect();
            factored = SparseCholesky::factor(&matrix.add_diagonal(share, &diagonal)?);
        }
        factored
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.size
    }

    /// `X = A⁻¹ B`. `rhs`: `[size, columns]`, column-major; holds `B` before and `X` after.
    ///
    /// # Panics
    /// If the length of `rhs` is not `size · columns`.
    pub fn solve_in_place(&self, rhs: &mut [f64], columns: usize) {
        assert_eq!(rhs.len(), self.size * columns, "size of rhs");
        if self.size == 0 {
            return;
        }
        rhs.par_chunks_mut(self.size * COLUMNS_PER_TASK)
            .for_each(|block| self.solve_block(block));
    }

    fn solve_block(&self, block: &mut [f64]) {
        let columns = block.len() / self.size;
        let llt = LltRef::<usize, f64>::new(&self.symbolic, &self.values);
        let scratch = self
            .symbolic
            .solve_in_place_scratch::<f64>(columns, Par::Seq);
        let mut memory = MemBuffer::new(scratch);
        llt.solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(block, self.size, columns),
            Par::Seq,
            MemStack::new(&mut memory),
        );
    }
}

fn upper_triangle(matrix: &Csr) -> (Vec<usize>, Vec<usize>, Vec<f64>) {
    let (mut indptr, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
    for row in 0..matrix.nrows() {
        for (column, value) in matrix.row(row).filter(|&(column, _)| column >= row) {
            indices.push(column);
            values.push(value);
        }
        indptr.push(indices.len());
    }
    (indptr, indices, values)
}

fn factor_lower(lower: SparseColMatRef<'_, usize, f64>, size: usize) -> Result<SparseCholesky> {
    let symbolic = factorize_symbolic_cholesky(
        lower.symbolic(),
        Side::Lower,
        SymmetricOrdering::Amd,
        CholeskySymbolicParams::default(),
    )
    .map_err(|e| Error::Numerics(format!("sparse Cholesky of size {size}: {e:?}")))?;
    let mut values = vec![0.0; symbolic.len_val()];
    let par = threads();
    let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(par, Default::default());
    let mut memory = MemBuffer::new(scratch);
    symbolic
        .factorize_numeric_llt(
            &mut values,
            lower,
            Side::Lower,
            Default::default(),
            par,
            MemStack::new(&mut memory),
            Default::default(),
        )
        .map_err(|e| {
            Error::Numerics(format!(
                "sparse Cholesky of size {size}: expected a positive definite matrix, got {e:?}"
            ))
        })?;
    if let Some(at) = values.iter().position(|v| !v.is_finite()) {
        return Err(Error::Numerics(format!(
            "sparse Cholesky of size {size}: expected finite values, got {} in the factor",
            values[at]
        )));
    }
    Ok(SparseCholesky {
        symbolic,
        values,
        size,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The tridiagonal matrix with rows −1, 3, −1.
    fn path(n: usize) -> Csr {
        let mut entries = Vec::new();
        for i in 0..n as u32 {
            entries.push((i, i, 3.0));
            if i > 0 {
                entries.extend([(i, i - 1, -1.0), (i - 1, i, -1.0)]);
            }
        }
        Csr::from_triplets(n, n, &entries)
    }

    #[test]
    fn rounding_below_zero_is_lifted_and_what_is_not_positive_is_refused() {
        let of = |corner: f64| {
            let entries = [(0, 0, 1.0), (0, 1, 1.0), (1, 0, 1.0), (1, 1, corner)];
            Csr::from_triplets(2, 2, &entries)
        };
        let rounded = of(1.0 - 1e-11);
        assert!(SparseCholesky::factor(&rounded).is_err());
        let mut solution = [1.0, 1.0];
        let factored = SparseCholesky::factor_rounded(&rounded).unwrap();
        factored.solve_in_place(&mut solution, 1);
        assert!(
            (solution[0] + solution[1] - 1.0).abs() < 1e-2,
            "{solution:?}"
        );
        assert!(SparseCholesky::factor_rounded(&of(0.5)).is_err());
    }

    #[test]
    fn solution_satisfies_the_system_for_one_and_many_columns() {
        for (n, columns) in [(1, 1), (7, 3), (300, 40)] {
            let a = path(n);
            let x: Vec<f64> = (0..n * columns).map(|i| (i as f64).sin()).collect();
            let mut rhs = a.mul_columns(&x, columns);
            let factor = SparseCholesky::factor(&a).unwrap();
            factor.solve_in_place(&mut rhs, columns);
            for (got, expected) in rhs.iter().zip(&x) {
                assert!((got - expected).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn indefinite_and_oblong_matrices_are_errors() {
        let indefinite =
            Csr::from_triplets(2, 2, &[(0, 0, 1.0), (0, 1, 2.0), (1, 0, 2.0), (1, 1, 1.0)]);
        assert!(matches!(
            SparseCholesky::factor(&indefinite),
            Err(Error::Numerics(_))
        ));
        let oblong = Csr::from_triplets(2, 3, &[]);
        assert!(matches!(
            SparseCholesky::factor(&oblong),
            Err(Error::ShapeMismatch { .. })
        ));
        let nan = Csr::from_triplets(1, 1, &[(0, 0, f64::NAN)]);
        assert!(SparseCholesky::factor(&nan).is_err());
    }
}
