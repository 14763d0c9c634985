//! Products with a matrix that is packed once and used for many rows.
//!
//! The right operand is stored in panels of 16 columns. With AVX-512 up to four panels are
//! multiplied at once; 128 rows of these 64 columns fill two thirds of a first-level cache of
//! 48 KB. The left operand is read in place. Six rows of four registers are summed at once, so with
//! AVX-512 each step loads 10 values for 24 multiply-adds. Biases and ReLU are applied while the
//! sums are in the registers.
//!
//! Each sum runs over the depth in ascending order, however the rows are cut. So a row's result
//! does not depend on the rows around it.

use std::array;

use faer::MatRef;
use pulp::{Arch, Simd, WithSimd};

/// Columns of a panel: one register of AVX-512, two of AVX2.
const PANEL: usize = 16;
/// Rows that are summed at once.
const ROWS: usize = 6;

/// A packed matrix `[depth, columns]`: `[panels, depth]` rows of 16 columns. Zeros fill up the last
/// panel.
#[derive(Debug, Clone)]
pub struct Panels {
    depth: usize,
    columns: usize,
    rows: Vec<PanelRow>,
}

/// One row of a panel, as large as a cache line.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct PanelRow([f32; PANEL]);

/// The values to which a product is added.
#[derive(Debug, Clone, Copy)]
pub enum Start<'a> {
    /// Zero: the output is overwritten.
    Zero,
    /// The same row everywhere, `[columns]`: a layer's bias.
    Row(&'a [f32]),
    /// The present values of the output.
    Output,
    /// The present values of the output plus the same row everywhere.
    OutputAndRow(&'a [f32]),
}

/// The function applied to a sum before it is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Finish {
    /// No function.
    Plain,
    /// `max(x, 0)`.
    Relu,
}

impl Panels {
    /// Packs a matrix.
    pub fn new(matrix: MatRef<'_, f32>) -> Self {
        let (depth, columns) = (matrix.nrows(), matrix.ncols());
        let row = |index: usize| {
            let (panel, k) = (index / depth, index % depth);
            PanelRow(array::from_fn(|column| match panel * PANEL + column {
                column if column < columns => matrix[(k, column)],
                _ => 0.0,
            }))
        };
        Panels {
            depth,
            columns,
            rows: (0..columns.div_ceil(PANEL) * depth).map(row).collect(),
        }
    }

    /// The transposed matrix `[columns, depth]`, packed.
    pub fn transposed(&self) -> Self {
        let mut rows: Vec<f32> = vec![0.0; self.columns * self.depth];
        for (column, row) in rows.chunks_exact_mut(self.depth.max(1)).enumerate() {
            let (panel, place) = (column / PANEL, column % PANEL);
            let packed = &self.rows[panel * self.depth..][..self.depth];
            row.iter_mut()
                .zip(packed)
                .for_each(|(to, row)| *to = row.0[place]);
        }
        Panels::new(MatRef::from_row_major_slice(
            &rows,
            self.columns,
            self.depth,
        ))
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// `out = finish(start + lhs · self)`; `lhs`: `[rows, depth]`, `out`: `[rows, columns]`.
    ///
    /// # Panics
    /// If the sizes disagree.
    pub fn multiply(&self, lhs: &[f32], start: Start<'_>, finish: Finish, out: &mut [f32]) {
        let rows = out.len() / self.columns.max(1);
        assert_eq!(out.len(), rows * self.columns, "output");
        assert_eq!(lhs.len(), rows * self.depth, "left operand");
        if let Start::Row(row) | Start::OutputAndRow(row) = start {
            assert_eq!(row.len(), self.columns, "row to start from");
        }
        Arch::new().dispatch(Product {
            lhs,
            rhs: self,
            start,
            finish,
            out,
        });
    }
}

struct Product<'a> {
    lhs: &'a [f32],
    rhs: &'a Panels,
    start: Start<'a>,
    finish: Finish,
    out: &'a mut [f32],
}

impl WithSimd for Product<'_> {
    type Output = ();

    /// Takes as many columns at once as keep the sums of the rows in registers.
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let panels = self.rhs.columns.div_ceil(PANEL);
        let mut panel = 0;
        while panel < panels {
            panel += match (S::F32_LANES, panels - panel) {
                (16, 4..) => self.columns::<S, 4, 1>(simd, panel),
                (16, 3) => self.columns::<S, 3, 1>(simd, panel),
                (16, 2) => self.columns::<S, 2, 1>(simd, panel),
                (16, _) => self.columns::<S, 1, 1>(simd, panel),
                (8, _) => self.columns::<S, 1, 2>(simd, panel),
                (4, _) => self.columns::<S, 1, 4>(simd, panel),
                _ => self.columns::<S, 1, PANEL>(simd, panel),
            };
        }
    }
}

impl Product<'_> {
    /// Computes all rows of `P` panels of `R` registers each. Returns `P`.
    #[inline(always)]
    fn columns<S: Simd, const P: usize, const R: usize>(&mut self, simd: S, panel: usize) -> usize {
        let rows = self.out.len() / self.rhs.columns;
        let whole = rows - rows % ROWS;
        for row in (0..whole).step_by(ROWS) {
            self.block::<S, ROWS, P, R>(simd, row, panel);
        }
        for row in whole..rows {
            self.block::<S, 1, P, R>(simd, row, panel);
        }
        P
    }

    /// Computes `N` rows of these panels.
    #[inline(always)]
    fn block<S: Simd, const N: usize, const P: usize, const R: usize>(
        &mut self,
        simd: S,
        row: usize,
        panel: usize,
    ) {
        let (depth, columns) = (self.rhs.depth, self.rhs.columns);
        let lhs: [&[f32]; N] = array::from_fn(|n| &self.lhs[(row + n) * depth..][..depth]);
        let rhs: [&[PanelRow]; P] =
            array::from_fn(|p| &self.rhs.rows[(panel + p) * depth..][..depth]);
        let sums = accumulate::<S, N, P, R>(simd, depth, lhs, rhs);
        let first = panel * PANEL;
        for n in 0..N {
            let out = &mut self.out[(row + n) * columns..][..columns];
            if first + P * PANEL <= columns {
                write(simd, self.start, self.finish, sums[n], first, out)
            } else {
                write_narrow(simd, self.start, self.finish, sums[n], first, out)
            }
        }
    }
}

/// Sums of some rows times some panels.
#[inline(always)]
fn accumulate<S: Simd, const N: usize, const P: usize, const R: usize>(
    simd: S,
    depth: usize,
    lhs: [&[f32]; N],
    rhs: [&[PanelRow]; P],
) -> [[[S::f32s; R]; P]; N] {
    let mut sums = [[[simd.splat_f32s(0.0); R]; P]; N];
    for k in 0..depth {
        let values: [[S::f32s; R]; P] = array::from_fn(|p| {
            let (values, _) = S::as_simd_f32s(&rhs[p][k].0);
            array::from_fn(|r| values[r])
        });
        for n in 0..N {
            let factor = simd.splat_f32s(lhs[n][k]);
            for p in 0..P {
                for r in 0..R {
                    sums[n][p][r] = simd.mul_add_e_f32s(factor, values[p][r], sums[n][p][r]);
                }
            }
        }
    }
    sums
}

/// Writes the sums of one row from the column `first` on.
#[inline(always)]
fn write<S: Simd, const P: usize, const R: usize>(
    simd: S,
    start: Start<'_>,
    finish: Finish,
    mut sums: [[S::f32s; R]; P],
    first: usize,
    out: &mut [f32],
) {
    let columns = first..first + P * PANEL;
    let (out, _) = S::as_mut_simd_f32s(&mut out[columns.clone()]);
    let mut add = |values: &[S::f32s]| {
        for p in 0..P {
            for r in 0..R {
                sums[p][r] = simd.add_f32s(sums[p][r], values[p * R + r]);
            }
        }
    };
    if let Start::Output | Start::OutputAndRow(_) = start {
        add(out);
    }
    if let Start::Row(row) | Start::OutputAndRow(row) = start {
        add(S::as_simd_f32s(&row[columns]).0);
    }
    for p in 0..P {
        for r in 0..R {
            out[p * R + r] = finished(simd, finish, sums[p][r]);
        }
    }
}

/// [`write`] for a row that ends within the panels.
#[inline(always)]
fn write_narrow<S: Simd, const P: usize, const R: usize>(
    simd: S,
    start: Start<'_>,
    finish: Finish,
    sums: [[S::f32s; R]; P],
    first: usize,
    out: &mut [f32],
) {
    let sums = sums.as_flattened().iter();
    let firsts = (first..out.len()).step_by(S::F32_LANES);
    for (&sum, first) in sums.zip(firsts) {
        let columns = first..(first + S::F32_LANES).min(out.len());
        let out = &mut out[columns.clone()];
        let mut sum = sum;
        if let Start::Output | Start::OutputAndRow(_) = start {
            sum = simd.add_f32s(sum, simd.partial_load_f32s(out));
        }
        if let Start::Row(row) | Start::OutputAndRow(row) = start {
            sum = simd.add_f32s(sum, simd.partial_load_f32s(&row[columns]));
        }
        simd.partial_store_f32s(out, finished(simd, finish, sum));
    }
}

#[inline(always)]
fn finished<S: Simd>(simd: S, finish: Finish, sum: S::f32s) -> S::f32s {
    match finish {
        Finish::Plain => sum,
        Finish::Relu => simd.max_f32s(sum, simd.splat_f32s(0.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Small whole numbers, so that every order of summing is exact.
    fn numbers(count: usize, step: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * step) % 13) as f32 - 6.0).collect()
    }

    fn expected(lhs: &[f32], rhs: &[f32], [rows, depth, columns]: [usize; 3]) -> Vec<f32> {
        let at = |i: usize, k: usize, j: usize| lhs[i * depth + k] * rhs[k * columns + j];
        (0..rows * columns)
            .map(|index| {
                let (i, j) = (index / columns, index % columns);
                (0..depth).map(|k| at(i, k, j)).sum()
            })
            .collect()
    }

    /// Rows and columns, some of them multiples of the numbers that are summed at once and some
    /// not.
    const SIZES: [[usize; 3]; 9] = [
        [1, 1, 1],
        [7, 9, 23],
        [1, 1, 16],
        [6, 4, 32],
        [37, 19, 48],
        [5, 7, 64],
        [13, 128, 80],
        [9, 3, 192],
        [0, 3, 16],
    ];

    #[test]
    fn a_product_equals_the_plain_triple_loop() {
        for size @ [rows, depth, columns] in SIZES {
            let (lhs, rhs) = (numbers(rows * depth, 7), numbers(depth * columns, 5));
            let panels = Panels::new(MatRef::from_row_major_slice(&rhs, depth, columns));
            let product = expected(&lhs, &rhs, size);
            let bias = numbers(columns, 3);
            let mut out = numbers(rows * columns, 2);
            panels.multiply(&lhs, Start::Zero, Finish::Plain, &mut out);
            assert_eq!(out, product, "{size:?}");
            panels.multiply(&lhs, Start::Output, Finish::Plain, &mut out);
            assert!(out.iter().zip(&product).all(|(x, y)| *x == 2.0 * y));
            panels.multiply(&lhs, Start::OutputAndRow(&bias), Finish::Plain, &mut out);
            let biased = |index: usize| product[index] + bias[index % columns];
            for (index, got) in out.iter().enumerate() {
                assert_eq!(*got, 2.0 * product[index] + biased(index), "{size:?}");
            }
            panels.multiply(&lhs, Start::Row(&bias), Finish::Relu, &mut out);
            for (index, got) in out.iter().enumerate() {
                assert_eq!(*got, biased(index).max(0.0), "{size:?}");
            }
        }
    }

    #[test]
    fn a_transposed_matrix_multiplies_as_one_that_was_packed_so() {
        for [rows, depth, columns] in SIZES {
            let (lhs, rhs) = (numbers(rows * columns, 7), numbers(depth * columns, 5));
            let matrix = MatRef::from_row_major_slice(&rhs, depth, columns);
            let (mut out, mut expected) = (vec![0.0; rows * depth], vec![0.0; rows * depth]);
            let transposed = Panels::new(matrix).transposed();
            transposed.multiply(&lhs, Start::Zero, Finish::Plain, &mut out);
            let packed = Panels::new(matrix.transpose());
            packed.multiply(&lhs, Start::Zero, Finish::Plain, &mut expected);
            assert_eq!(out, expected);
        }
    }

    #[test]
    fn every_instruction_set_gives_the_product() {
        for size @ [rows, depth, columns] in SIZES {
            let (lhs, rhs) = (numbers(rows * depth, 7), numbers(depth * columns, 5));
            let panels = Panels::new(MatRef::from_row_major_slice(&rhs, depth, columns));
            let product = expected(&lhs, &rhs, size);
            let check = |run: &dyn Fn(Product<'_>)| {
                let mut out = product.clone();
                run(Product {
                    lhs: &lhs,
                    rhs: &panels,
                    start: Start::Output,
                    finish: Finish::Relu,
                    out: &mut out,
                });
                let twice = product.iter().map(|x| (2.0 * x).max(0.0));
                assert!(twice.eq(out), "{size:?}");
            };
            check(&|product| Simd::vectorize(pulp::Scalar, product));
            #[cfg(target_arch = "x86_64")]
            if let Some(avx2) = pulp::x86::V3::try_new() {
                check(&|product| Simd::vectorize(avx2, product));
            }
        }
    }

    #[test]
    fn a_rows_result_does_not_depend_on_its_neighbours() {
        let (rows, depth, columns) = (29, 50, 83);
        let value = |i: usize| (i as f32 * 0.731).sin();
        let lhs: Vec<f32> = (0..rows * depth).map(value).collect();
        let rhs: Vec<f32> = (0..depth * columns).map(value).collect();
        let panels = Panels::new(MatRef::from_row_major_slice(&rhs, depth, columns));
        let mut all = vec![0.0; rows * columns];
        panels.multiply(&lhs, Start::Zero, Finish::Plain, &mut all);
        for (row, lhs) in lhs.chunks_exact(depth).enumerate() {
            let mut alone = vec![0.0; columns];
            panels.multiply(lhs, Start::Zero, Finish::Plain, &mut alone);
            assert_eq!(alone, all[row * columns..(row + 1) * columns]);
        }
    }
}
