//! Matrix products over row-major arrays, cut into row blocks of a fixed size.

use std::ops::Range;

use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};
use ndarray::{Array2, ArrayRef2};
use rayon::prelude::*;

/// A faer view of a row-major array.
///
/// # Panics
/// If the array is not in standard layout.
pub fn view(array: &ArrayRef2<f32>) -> MatRef<'_, f32> {
    let (rows, columns) = array.dim();
    MatRef::from_row_major_slice(values(array), rows, columns)
}

/// The values of a row-major array.
///
/// # Panics
/// If the array is not in standard layout.
pub fn values(array: &ArrayRef2<f32>) -> &[f32] {
    array.as_slice().expect("row-major array")
}

/// A view of row-major values with `columns` columns.
pub fn rows_of(values: &[f32], columns: usize) -> MatRef<'_, f32> {
    MatRef::from_row_major_slice(values, values.len() / columns.max(1), columns)
}

/// A mutable view of row-major values with `columns` columns.
pub fn view_mut(values: &mut [f32], columns: usize) -> MatMut<'_, f32> {
    let rows = values.len() / columns.max(1);
    MatMut::from_row_major_slice_mut(values, rows, columns)
}

/// `out = lhs · rhs` on the calling thread.
pub fn product(out: MatMut<'_, f32>, lhs: MatRef<'_, f32>, rhs: MatRef<'_, f32>) {
    matmul(out, Accum::Replace, lhs, rhs, 1.0, Par::Seq);
}

/// `out = scale · lhs · rhs` on the calling thread.
pub fn scaled_product(
    out: MatMut<'_, f32>,
    scale: f32,
    lhs: MatRef<'_, f32>,
    rhs: MatRef<'_, f32>,
) {
    matmul(out, Accum::Replace, lhs, rhs, scale, Par::Seq);
}

/// `out += lhs · rhs` on the calling thread.
pub fn product_add(out: MatMut<'_, f32>, lhs: MatRef<'_, f32>, rhs: MatRef<'_, f32>) {
    matmul(out, Accum::Add, lhs, rhs, 1.0, Par::Seq);
}

/// Rows of one piece of parallel work: an eighth of `rows`, at least 16 and at most 512.
///
/// It depends on `rows` alone, so results do not depend on the number of threads.
pub fn rows_per_block(rows: usize) -> usize {
    rows.div_ceil(8).clamp(16, 512)
}

/// Fills `[rows, columns]` block by block in parallel; `fill` gets a block's rows and its values.
pub fn by_row_blocks(
    rows: usize,
    columns: usize,
    fill: impl Fn(Range<usize>, &mut [f32]) + Sync,
) -> Array2<f32> {
    let mut out = Array2::zeros((rows, columns));
    let block = rows_per_block(rows);
    let values = out.as_slice_mut().expect("a new array is row-major");
    if rows > 0 && columns > 0 {
        values
            .par_chunks_mut(block * columns)
            .enumerate()
            .for_each(|(index, values)| {
                let start = index * block;
                fill(start..start + values.len() / columns, values);
            });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn product_equals_the_plain_triple_loop() {
        let lhs = Array2::from_shape_fn((37, 19), |(i, j)| ((i * 7 + j * 3) % 11) as f32 - 5.0);
        let rhs = Array2::from_shape_fn((19, 23), |(i, j)| ((i * 5 + j * 2) % 13) as f32 - 6.0);
        let fast = by_row_blocks(37, 23, |rows, out| {
            let lhs = view(&lhs).subrows(rows.start, rows.len());
            product(view_mut(out, 23), lhs, view(&rhs));
        });
        assert_eq!(fast, lhs.dot(&rhs));
    }

    #[test]
    fn every_row_is_in_one_block() {
        for rows in [0, 1, 15, 16, 17, 127, 150, 5000] {
            let filled = by_row_blocks(rows, 2, |range, out| {
                for (row, values) in range.zip(out.chunks_mut(2)) {
                    values.fill(row as f32 + 1.0);
                }
            });
            let expected = Array2::from_shape_fn((rows, 2), |(row, _)| row as f32 + 1.0);
            assert_eq!(filled, expected);
        }
    }
}
