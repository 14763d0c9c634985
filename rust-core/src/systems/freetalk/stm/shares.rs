//! The shares by which vertices attend to landmarks.

use faer::MatRef;

use crate::nn::{
    elementwise::{exp, vectorised},
    matrix::{scaled_product, view_mut},
};

/// `softmax(q kᵀ / √d)` over the landmarks of every vertex, eq. 13 of one head, as `[N, V]`.
///
/// `query`: `[V, d]`; `key`: `[N, d]`. Neighbouring numbers of a row belong to different vertices,
/// so vector instructions take the largest value, exponential and sum of many vertices at once. The
/// number of landmarks need not be a multiple of the vector width.
pub fn attention_shares(query: MatRef<'_, f32>, key: MatRef<'_, f32>) -> Vec<f32> {
    let vertices = query.nrows();
    let scale = 1.0 / (query.ncols() as f32).sqrt();
    let mut shares = vec![0.0; key.nrows() * vertices];
    let target = view_mut(&mut shares, vertices);
    scaled_product(target, scale, key, query.transpose());
    softmax_of_columns(&mut shares, vertices);
    shares
}

/// Softmax of each column of row-major `values`, in place.
fn softmax_of_columns(values: &mut [f32], columns: usize) {
    let mut largest = vec![f32::NEG_INFINITY; columns];
    let mut sum = vec![0.0; columns];
    vectorised(
        #[inline(always)]
        || {
            for row in values.chunks_exact(columns.max(1)) {
                for (largest, x) in largest.iter_mut().zip(row) {
                    *largest = if *x > *largest { *x } else { *largest };
                }
            }
            for row in values.chunks_exact_mut(columns.max(1)) {
                for ((x, largest), sum) in row.iter_mut().zip(&largest).zip(&mut sum) {
                    *x = exp(*x - largest);
                    *sum += *x;
                }
            }
            sum.iter_mut().for_each(|sum| *sum = 1.0 / *sum);
            for row in values.chunks_exact_mut(columns.max(1)) {
                for (x, scale) in row.iter_mut().zip(&sum) {
                    *x *= scale;
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::matrix::rows_of;

    #[test]
    fn shares_equal_their_formula_however_large_the_scores() {
        let value = |i: usize| (i as f32 * 0.731).sin() * 20.0;
        let query: Vec<f32> = (0..37 * 4).map(value).collect();
        let key: Vec<f32> = (0..5 * 4).map(|i| value(i + 500)).collect();
        let shares = attention_shares(rows_of(&query, 4), rows_of(&key, 4));
        for v in 0..37 {
            let score = |n: usize| {
                let dot: f32 = (0..4).map(|d| query[4 * v + d] * key[4 * n + d]).sum();
                f64::from(dot / 2.0)
            };
            let largest = (0..5).map(score).fold(f64::MIN, f64::max);
            let total: f64 = (0..5).map(|n| (score(n) - largest).exp()).sum();
            for n in 0..5 {
                let expected = (score(n) - largest).exp() / total;
                let error = (f64::from(shares[n * 37 + v]) - expected).abs();
                assert!(error < 1e-4, "vertex {v}, landmark {n}: {error}");
            }
        }
    }
}
