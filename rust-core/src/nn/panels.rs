//! Products with a matrix that is packed once and used for many rows.
//!
//! A library's product packs both of its operands at every call, which for 256 rows and 128 channels
//! costs as much as the arithmetic (67 against 150 GFLOP/s on one core with AVX-512). Here the right
//! operand is cut into panels of 32 columns that fit the first cache, the left one is read as it lies.
//!
//! Each sum runs over the depth in ascending order whatever the cut into rows, so that a row's
//! result does not depend on the rows around it.

use std::{array, ops::Range};

use faer::MatRef;
use pulp::{Arch, Simd, WithSimd};

/// Columns of a panel: two registers of AVX-512, four of AVX2.
const PANEL: usize = 32;

/// A matrix `[depth, columns]` in panels of [`PANEL`] columns, the last one filled up with zeros.
#[derive(Debug, Clone)]
pub struct Panels {
    depth: usize,
    columns: usize,
    /// `[panels, depth]` rows of a panel.
    rows: Vec<[f32; PANEL]>,
}

/// What a product is added to.
#[derive(Debug, Clone, Copy)]
pub enum Start<'a> {
    /// Nothing: the output is overwritten.
    Zero,
    /// The same row everywhere, `[columns]`: a layer's bias.
    Row(&'a [f32]),
    /// What the output holds.
    Output,
}

impl Panels {
    /// Packs a matrix.
    pub fn new(matrix: MatRef<'_, f32>) -> Self {
        let (depth, columns) = (matrix.nrows(), matrix.ncols());
        let mut packed = Panels::zeros(depth, columns);
        for (index, panel) in packed.rows.chunks_exact_mut(depth.max(1)).enumerate() {
            let columns = panel_columns(index, columns);
            for (k, row) in panel.iter_mut().enumerate() {
                for (value, column) in row.iter_mut().zip(columns.clone()) {
                    *value = matrix[(k, column)];
                }
            }
        }
        packed
    }

    /// Room for up to `depth` rows.
    pub fn zeros(depth: usize, columns: usize) -> Self {
        Panels {
            depth,
            columns,
            rows: vec![[0.0; PANEL]; depth * columns.div_ceil(PANEL)],
        }
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Replaces the rows by those of row-major `matrix`, each times its factor.
    pub fn fill_scaled(&mut self, matrix: &[f32], factors: &[f32]) {
        assert_eq!(matrix.len(), factors.len() * self.columns, "rows");
        self.depth = factors.len();
        let count = self.columns.div_ceil(PANEL);
        self.rows.resize(self.depth * count, [0.0; PANEL]);
        let panels = self.rows.chunks_exact_mut(self.depth.max(1));
        for (index, panel) in panels.enumerate() {
            let columns = panel_columns(index, self.columns);
            let rows = matrix.chunks_exact(self.columns).zip(factors);
            for (out, (row, factor)) in panel.iter_mut().zip(rows) {
                for (out, value) in out.iter_mut().zip(&row[columns.clone()]) {
                    *out = value * factor;
                }
            }
        }
    }

    /// `out = start + lhs · self`; `lhs`: `[rows, depth]`, `out`: `[rows, columns]`.
    ///
    /// # Panics
    /// If the sizes disagree.
    pub fn multiply(&self, lhs: &[f32], start: Start<'_>, out: &mut [f32]) {
        let rows = out.len() / self.columns.max(1);
        assert_eq!(lhs.len(), rows * self.depth, "left operand");
        let lhs = ByRows {
            values: lhs,
            depth: self.depth,
        };
        self.dispatch(lhs, start, out);
    }

    /// `out += lhsᵀ · self`; `lhs`: `[depth, rows]`, `out`: `[rows, columns]`.
    ///
    /// # Panics
    /// If the sizes disagree.
    pub fn add_transposed(&self, lhs: &[f32], out: &mut [f32]) {
        let rows = out.len() / self.columns.max(1);
        assert_eq!(lhs.len(), rows * self.depth, "left operand");
        self.dispatch(ByColumns { values: lhs, rows }, Start::Output, out);
    }

    fn dispatch(&self, lhs: impl Lhs, start: Start<'_>, out: &mut [f32]) {
        assert!(out.len().is_multiple_of(self.columns.max(1)), "output");
        if self.columns > 0 && self.depth > 0 {
            Arch::new().dispatch(Product {
                lhs,
                rhs: self,
                start,
                out,
            });
        }
    }
}

/// The columns of a matrix that a panel holds.
fn panel_columns(panel: usize, columns: usize) -> Range<usize> {
    panel * PANEL..((panel + 1) * PANEL).min(columns)
}

/// A left operand in whichever order it lies.
trait Lhs: Copy {
    /// Of `ROWS` rows from `first` on, the values at one depth.
    fn rows<const ROWS: usize>(self, first: usize) -> impl Fn(usize) -> [f32; ROWS];
}

/// `[rows, depth]`.
#[derive(Clone, Copy)]
struct ByRows<'a> {
    values: &'a [f32],
    depth: usize,
}

impl Lhs for ByRows<'_> {
    #[inline(always)]
    fn rows<const ROWS: usize>(self, first: usize) -> impl Fn(usize) -> [f32; ROWS] {
        let ByRows { values, depth } = self;
        let rows: [&[f32]; ROWS] =
            array::from_fn(|r| &values[(first + r) * depth..(first + r + 1) * depth]);
        move |k| array::from_fn(|r| rows[r][k])
    }
}

/// `[depth, rows]`.
#[derive(Clone, Copy)]
struct ByColumns<'a> {
    values: &'a [f32],
    rows: usize,
}

impl Lhs for ByColumns<'_> {
    #[inline(always)]
    fn rows<const ROWS: usize>(self, first: usize) -> impl Fn(usize) -> [f32; ROWS] {
        let ByColumns { values, rows } = self;
        move |k| {
            let values = values[k * rows + first..].first_chunk();
            *values.expect("rows of the operand")
        }
    }
}

struct Product<'a, L> {
    lhs: L,
    rhs: &'a Panels,
    start: Start<'a>,
    out: &'a mut [f32],
}

impl<L: Lhs> WithSimd for Product<'_, L> {
    type Output = ();

    /// As many rows at once as leave their sums and one row of the panel in the registers.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F32_LANES {
            16 => self.run::<S, 8, 2>(simd),
            8 => self.run::<S, 3, 4>(simd),
            4 => self.run::<S, 2, 8>(simd),
            _ => self.run::<S, 1, PANEL>(simd),
        }
    }
}

impl<L: Lhs> Product<'_, L> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const REGISTERS: usize>(mut self, simd: S) {
        let rows = self.out.len() / self.rhs.columns;
        let whole = rows - rows % ROWS;
        for index in 0..self.rhs.columns.div_ceil(PANEL) {
            for first in (0..whole).step_by(ROWS) {
                self.block::<S, ROWS, REGISTERS>(simd, index, first);
            }
            for first in whole..rows {
                self.block::<S, 1, REGISTERS>(simd, index, first);
            }
        }
    }

    /// `ROWS` rows of one panel.
    #[inline(always)]
    fn block<S: Simd, const ROWS: usize, const REGISTERS: usize>(
        &mut self,
        simd: S,
        index: usize,
        first: usize,
    ) {
        let Panels {
            depth,
            columns,
            ref rows,
        } = *self.rhs;
        let range = panel_columns(index, columns);
        let out = &mut self.out[first * columns..(first + ROWS) * columns];
        let mut sums = [[0.0; PANEL]; ROWS];
        for (sums, out) in sums.iter_mut().zip(out.chunks_exact(columns)) {
            let sums = &mut sums[..range.len()];
            match self.start {
                Start::Zero => {}
                Start::Row(row) => sums.copy_from_slice(&row[range.clone()]),
                Start::Output => sums.copy_from_slice(&out[range.clone()]),
            }
        }
        let panel = &rows[index * depth..(index + 1) * depth];
        accumulate::<S, ROWS, REGISTERS>(simd, panel, self.lhs.rows(first), &mut sums);
        for (out, sums) in out.chunks_exact_mut(columns).zip(&sums) {
            out[range.clone()].copy_from_slice(&sums[..range.len()]);
        }
    }
}

/// `sums += lhs · panel` in the registers; `lhs` yields its values at one depth.
#[inline(always)]
fn accumulate<S: Simd, const ROWS: usize, const REGISTERS: usize>(
    simd: S,
    panel: &[[f32; PANEL]],
    lhs: impl Fn(usize) -> [f32; ROWS],
    sums: &mut [[f32; PANEL]; ROWS],
) {
    let mut held: [[S::f32s; REGISTERS]; ROWS] = array::from_fn(|r| {
        let (sums, _) = S::as_simd_f32s(&sums[r]);
        array::from_fn(|i| sums[i])
    });
    for (k, row) in panel.iter().enumerate() {
        let (row, _) = S::as_simd_f32s(row);
        let row: [S::f32s; REGISTERS] = array::from_fn(|i| row[i]);
        let factors = lhs(k);
        for (held, factor) in held.iter_mut().zip(factors) {
            let factor = simd.splat_f32s(factor);
            for (sum, value) in held.iter_mut().zip(row) {
                *sum = simd.mul_add_e_f32s(factor, value, *sum);
            }
        }
    }
    for (sums, held) in sums.iter_mut().zip(held) {
        let (sums, _) = S::as_mut_simd_f32s(sums);
        sums.copy_from_slice(&held);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Small whole numbers, so that every order of summing is exact.
    fn numbers(count: usize, step: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * step) % 13) as f32 - 6.0).collect()
    }

    fn expected(lhs: impl Fn(usize, usize) -> f32, rhs: &[f32], size: [usize; 3]) -> Vec<f32> {
        let [rows, depth, columns] = size;
        (0..rows * columns)
            .map(|at| {
                let (row, column) = (at / columns, at % columns);
                (0..depth)
                    .map(|k| lhs(row, k) * rhs[k * columns + column])
                    .sum()
            })
            .collect()
    }

    const SIZES: [[usize; 3]; 6] = [
        [1, 1, 1],
        [8, 4, 32],
        [37, 19, 23],
        [5, 7, 33],
        [9, 128, 68],
        [0, 3, 4],
    ];

    #[test]
    fn a_product_equals_the_plain_triple_loop() {
        for size @ [rows, depth, columns] in SIZES {
            let (lhs, rhs) = (numbers(rows * depth, 7), numbers(depth * columns, 5));
            let panels = Panels::new(MatRef::from_row_major_slice(&rhs, depth, columns));
            let product = expected(|row, k| lhs[row * depth + k], &rhs, size);
            let bias = numbers(columns, 3);
            let mut out = numbers(rows * columns, 2);
            panels.multiply(&lhs, Start::Zero, &mut out);
            assert_eq!(out, product, "{size:?}");
            panels.multiply(&lhs, Start::Output, &mut out);
            assert!(out.iter().zip(&product).all(|(x, y)| *x == 2.0 * y));
            panels.multiply(&lhs, Start::Row(&bias), &mut out);
            let biased = out.iter().zip(&product).enumerate();
            for (at, (got, product)) in biased {
                assert_eq!(*got, product + bias[at % columns], "{size:?}");
            }
        }
    }

    #[test]
    fn a_transposed_product_equals_the_plain_triple_loop() {
        for size @ [rows, depth, columns] in SIZES {
            let (lhs, rhs) = (numbers(rows * depth, 7), numbers(depth * columns, 5));
            let factors = numbers(depth, 4);
            let scaled: Vec<f32> = rhs
                .chunks_exact(columns)
                .zip(&factors)
                .flat_map(|(row, factor)| row.iter().map(move |x| x * factor))
                .collect();
            let mut panels = Panels::zeros(2 * depth, columns);
            panels.fill_scaled(&rhs, &factors);
            let mut out = vec![0.0; rows * columns];
            panels.add_transposed(&lhs, &mut out);
            let product = expected(|row, k| lhs[k * rows + row], &scaled, size);
            assert_eq!(out, product, "{size:?}");
        }
    }

    #[test]
    fn a_rows_result_does_not_depend_on_its_neighbours() {
        let (rows, depth, columns) = (29, 50, 40);
        let value = |i: usize| (i as f32 * 0.731).sin();
        let lhs: Vec<f32> = (0..rows * depth).map(value).collect();
        let rhs: Vec<f32> = (0..depth * columns).map(value).collect();
        let panels = Panels::new(MatRef::from_row_major_slice(&rhs, depth, columns));
        let mut all = vec![0.0; rows * columns];
        panels.multiply(&lhs, Start::Zero, &mut all);
        for (row, lhs) in lhs.chunks_exact(depth).enumerate() {
            let mut alone = vec![0.0; columns];
            panels.multiply(lhs, Start::Zero, &mut alone);
            assert_eq!(alone, all[row * columns..(row + 1) * columns]);
        }
    }
}
