//! Measures this machine's peak speed with the matrix product of faer, which the library uses.

use std::time::Instant;

use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};
use rayon::prelude::*;

/// Rows and columns of a matrix. Three such matrices fit in a cache of 1 MB.
const SIZE: usize = 256;
/// Products that each thread computes in one run.
const PRODUCTS: usize = 64;
/// Number of runs. The best one counts.
const RUNS: usize = 8;

/// Billions of single-precision operations a second on all threads.
pub(super) fn gflops() -> f64 {
    let threads = rayon::current_num_threads();
    let values: Vec<f32> = (0..SIZE * SIZE).map(|i| (i % 7) as f32 - 3.0).collect();
    let mut out = vec![vec![0.0f32; SIZE * SIZE]; threads];
    let mut best = 0f64;
    for _ in 0..RUNS {
        let start = Instant::now();
        out.par_iter_mut().for_each(|out| {
            for _ in 0..PRODUCTS {
                let factor = MatRef::from_row_major_slice(&values, SIZE, SIZE);
                let out = MatMut::from_row_major_slice_mut(out, SIZE, SIZE);
                matmul(out, Accum::Replace, factor, factor, 1.0, Par::Seq);
            }
        });
        let flop = 2.0 * (threads * PRODUCTS) as f64 * (SIZE as f64).powi(3);
        best = best.max(1e-9 * flop / start.elapsed().as_secs_f64());
    }
    best
}
