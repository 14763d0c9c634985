//! A plain compressed-row matrix: three vectors that anyone can read.

use rayon::prelude::*;

use crate::{Error, Result};

/// A sparse matrix in compressed-row form.
///
/// Row `r` holds `indices[indptr[r]..indptr[r + 1]]`, ascending and without repeats, and the values
/// at the same places. The constructors guarantee this. Code that fills the fields itself must
/// guarantee it too.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Csr {
    /// Number of columns.
    pub ncols: usize,
    /// `[nrows + 1]`, where each row starts.
    pub indptr: Vec<usize>,
    /// `[nnz]`, column of each entry.
    pub indices: Vec<u32>,
    /// `[nnz]`, value of each entry.
    pub values: Vec<f64>,
}

/// Rows per parallel task of a product. Smaller matrices stay on one thread.
const ROWS_PER_TASK: usize = 2048;

impl Csr {
    /// Sums entries `(row, column, value)` in the order given, so that the result does not depend
    /// on threads.
    ///
    /// # Panics
    /// If an entry lies outside `nrows` × `ncols`.
    pub fn from_triplets(nrows: usize, ncols: usize, entries: &[(u32, u32, f64)]) -> Csr {
        let mut start = vec![0usize; nrows + 1];
        for &(row, column, _) in entries {
            assert!((column as usize) < ncols, "column {column} of {ncols}");
            start[row as usize + 1] += 1;
        }
        for row in 0..nrows {
            start[row + 1] += start[row];
        }
        let mut sorted = vec![(0u32, 0f64); entries.len()];
        let mut next = start.clone();
        for &(row, column, value) in entries {
            sorted[next[row as usize]] = (column, value);
            next[row as usize] += 1;
        }
        let mut csr = Csr {
            ncols,
            indptr: vec![0],
            indices: Vec::with_capacity(entries.len()),
            values: Vec::with_capacity(entries.len()),
        };
        for row in 0..nrows {
            let entries = &mut sorted[start[row]..start[row + 1]];
            entries.sort_by_key(|&(column, _)| column);
            csr.push_row(entries);
        }
        csr
    }

    /// Appends a row of sorted entries, summing repeats.
    fn push_row(&mut self, entries: &[(u32, f64)]) {
        let begin = self.indices.len();
        for &(column, value) in entries {
            if self.indices.len() > begin && self.indices.last() == Some(&column) {
                let last = self.values.len() - 1;
                self.values[last] += value;
            } else {
                self.indices.push(column);
                self.values.push(value);
            }
        }
        self.indptr.push(self.indices.len());
    }

    /// A square matrix with `diagonal` on its diagonal.
    pub fn from_diagonal(diagonal: &[f64]) -> Csr {
        Csr {
            ncols: diagonal.len(),
            indptr: (0..=diagonal.len()).collect(),
            indices: (0..diagonal.len() as u32).collect(),
            values: diagonal.to_vec(),
        }
    }

    /// Number of rows.
    pub fn nrows(&self) -> usize {
        self.indptr.len().saturating_sub(1)
    }

    /// Number of stored entries.
    pub fn nnz(&self) -> usize {
        self.values.len()
    }

    /// Columns and values of one row.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.indptr[row]..self.indptr[row + 1];
        let columns = self.indices[range.clone()].iter().map(|&c| c as usize);
        columns.zip(self.values[range].iter().copied())
    }

    /// The entry at (`row`, `column`), zero where nothing is stored.
    pub fn get(&self, row: usize, column: usize) -> f64 {
        let range = self.indptr[row]..self.indptr[row + 1];
        match self.indices[range.clone()].binary_search(&(column as u32)) {
            Ok(at) => self.values[range.start + at],
            Err(_) => 0.0,
        }
    }

    /// `y = A x`. `x`: `[ncols]`. Returns `[nrows]`.
    pub fn mul(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; self.nrows()];
        self.mul_into(x, &mut y);
        y
    }

    /// `y = A x` without allocating. `x`: `[ncols]`, `y`: `[nrows]`.
    ///
    /// # Panics
    /// If `x` or `y` has another length.
    pub fn mul_into(&self, x: &[f64], y: &mut [f64]) {
        assert_eq!(x.len(), self.ncols, "length of x");
        assert_eq!(y.len(), self.nrows(), "length of y");
        y.par_chunks_mut(ROWS_PER_TASK)
            .enumerate()
            .for_each(|(task, part)| {
                for (i, out) in part.iter_mut().enumerate() {
                    *out = self
                        .row(task * ROWS_PER_TASK + i)
                        .map(|(c, v)| v * x[c])
                        .sum();
                }
            });
    }

    /// `Y = A X` for several columns at once. `x`: `[ncols, columns]`, column-major. Returns
    /// `[nrows, columns]`, also column-major.
    pub fn mul_columns(&self, x: &[f64], columns: usize) -> Vec<f64> {
        assert_eq!(x.len(), self.ncols * columns, "size of x");
        let mut y = vec![0.0; self.nrows() * columns];
        if self.nrows() > 0 && self.ncols > 0 {
            for (x, y) in x.chunks(self.ncols).zip(y.chunks_mut(self.nrows())) {
                self.mul_into(x, y);
            }
        }
        y
    }

    /// `Aᵀ`.
    pub fn transpose(&self) -> Csr {
        let mut indptr = vec![0usize; self.ncols + 1];
        for &column in &self.indices {
            indptr[column as usize + 1] += 1;
        }
        for column in 0..self.ncols {
            indptr[column + 1] += indptr[column];
        }
        let mut next = indptr.clone();
        let mut indices = vec![0u32; self.nnz()];
        let mut values = vec![0f64; self.nnz()];
        for row in 0..self.nrows() {
            for (column, value) in self.row(row) {
                indices[next[column]] = row as u32;
                values[next[column]] = value;
                next[column] += 1;
            }
        }
        Csr {
            ncols: self.nrows(),
            indptr,
            indices,
            values,
        }
    }

    /// `A B`.
    ///
    /// # Errors
    /// `ShapeMismatch` if the columns of `A` are not the rows of `B`.
    pub fn matmul(&self, other: &Csr) -> Result<Csr> {
        if self.ncols != other.nrows() {
            return Err(Error::ShapeMismatch {
                what: "right factor of a sparse product",
                expected: format!("[{}, _]", self.ncols),
                got: format!("[{}, {}]", other.nrows(), other.ncols),
            });
        }
        let mut product = Csr {
            ncols: other.ncols,
            indptr: vec![0],
            ..Csr::default()
        };
        let mut sums = vec![0.0; other.ncols];
        let mut last_row = vec![u32::MAX; other.ncols];
        let mut columns = Vec::new();
        for row in 0..self.nrows() {
            columns.clear();
            for (inner, a) in self.row(row) {
                for (column, b) in other.row(inner) {
                    if last_row[column] != row as u32 {
                        last_row[column] = row as u32;
                        sums[column] = 0.0;
                        columns.push(column as u32);
                    }
                    sums[column] += a * b;
                }
            }
            columns.sort_unstable();
            product.indices.extend_from_slice(&columns);
            product
                .values
                .extend(columns.iter().map(|&c| sums[c as usize]));
            product.indptr.push(product.indices.len());
        }
        Ok(product)
    }

    /// `a A + b B`.
    ///
    /// # Errors
    /// `ShapeMismatch` if the two differ in size.
    pub fn combine(&self, a: f64, b: f64, other: &Csr) -> Result<Csr> {
        if (self.nrows(), self.ncols) != (other.nrows(), other.ncols) {
            return Err(Error::ShapeMismatch {
                what: "second matrix of a sparse sum",
                expected: format!("[{}, {}]", self.nrows(), self.ncols),
                got: format!("[{}, {}]", other.nrows(), other.ncols),
            });
        }
        let mut sum = Csr {
            ncols: self.ncols,
            indptr: vec![0],
            ..Csr::default()
        };
        let mut entries = Vec::new();
        for row in 0..self.nrows() {
            entries.clear();
            entries.extend(self.row(row).map(|(c, v)| (c as u32, a * v)));
            entries.extend(other.row(row).map(|(c, v)| (c as u32, b * v)));
            entries.sort_by_key(|&(column, _)| column);
            sum.push_row(&entries);
        }
        Ok(sum)
    }

    /// `A + s diag(d)`. `d`: `[nrows]`, `A` square.
    ///
    /// # Errors
    /// `ShapeMismatch` if `d` does not fit.
    pub fn add_diagonal(&self, scale: f64, diagonal: &[f64]) -> Result<Csr> {
        self.combine(1.0, scale, &Csr::from_diagonal(diagonal))
    }

    /// Scales row `r` by `factors[r]`: `diag(f) A`.
    ///
    /// # Panics
    /// If `factors` is not `[nrows]`.
    pub fn scale_rows(&mut self, factors: &[f64]) {
        assert_eq!(factors.len(), self.nrows(), "length of factors");
        for row in 0..self.nrows() {
            for value in &mut self.values[self.indptr[row]..self.indptr[row + 1]] {
                *value *= factors[row];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn dense(csr: &Csr) -> Vec<Vec<f64>> {
        let mut out = vec![vec![0.0; csr.ncols]; csr.nrows()];
        for row in 0..csr.nrows() {
            for (column, value) in csr.row(row) {
                out[row][column] += value;
            }
        }
        out
    }

    fn matrix(nrows: usize, ncols: usize) -> impl Strategy<Value = Csr> {
        let entry = (0..nrows as u32, 0..ncols as u32, -4i32..5);
        proptest::collection::vec(entry, 0..40).prop_map(move |entries| {
            let entries: Vec<_> = entries.iter().map(|e| (e.0, e.1, f64::from(e.2))).collect();
            Csr::from_triplets(nrows, ncols, &entries)
        })
    }

    proptest! {
        #[test]
        fn products_and_sums_equal_dense_ones(a in matrix(5, 7), b in matrix(7, 4), c in matrix(5, 7)) {
            let (da, db, dc) = (dense(&a), dense(&b), dense(&c));
            let product = dense(&a.matmul(&b).unwrap());
            let sum = dense(&a.combine(2.0, -1.0, &c).unwrap());
            for i in 0..5 {
                for j in 0..4 {
                    let expected: f64 = (0..7).map(|k| da[i][k] * db[k][j]).sum();
                    prop_assert_eq!(product[i][j], expected);
                }
                for j in 0..7 {
                    prop_assert_eq!(sum[i][j], 2.0 * da[i][j] - dc[i][j]);
                    prop_assert_eq!(a.get(i, j), da[i][j]);
                    prop_assert_eq!(a.transpose().get(j, i), da[i][j]);
                }
            }
            let x: Vec<f64> = (0..7).map(f64::from).collect();
            for (i, y) in a.mul(&x).iter().enumerate() {
                prop_assert_eq!(*y, (0..7).map(|k| da[i][k] * x[k]).sum::<f64>());
            }
        }
    }

    #[test]
    fn wrong_sizes_are_named() {
        let a = Csr::from_triplets(2, 3, &[(0, 1, 1.0)]);
        let error = a.matmul(&a).unwrap_err().to_string();
        assert!(error.contains("expected [3, _], got [2, 3]"), "{error}");
        assert!(a.add_diagonal(1.0, &[1.0, 2.0]).is_err());
    }
}
