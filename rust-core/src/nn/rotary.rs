//! Attention whose scores depend on how far apart two frames are; twin of `training/nn/rotary.py`.

use ndarray::{Array2, ArrayRef2};
use rayon::prelude::*;

use super::{
    attention::{Reach, attend},
    linear::Linear,
    matrix,
};
use crate::{Error, Result, models::Weights};

const BASE: f64 = 10_000.0;

/// Multi-head attention with rotary positions, Su et al. 2021, eq. 34.
#[derive(Debug, Clone)]
pub struct RotaryAttention {
    heads: usize,
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
}

/// Keys and values of a memory. They are computed once and used at every denoising step.
#[derive(Debug, Clone)]
pub struct RotaryMemory {
    /// `[T, inner]`, each row rotated according to its frame.
    keys: Array2<f32>,
    /// `[T, inner]`.
    values: Array2<f32>,
}

impl RotaryAttention {
    /// Reads `query`, `key`, `value` `[inner, width]` and `out` `[width, inner]`, each with a bias.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape, or `inner` is not a multiple of
    /// `2 · heads`.
    pub fn load(weights: &Weights, width: usize, inner: usize, heads: usize) -> Result<Self> {
        if heads == 0 || !inner.is_multiple_of(2 * heads) {
            return Err(Error::Weights(format!(
                "attention: expected an inner width that is a multiple of {}, got {inner}",
                2 * heads
            )));
        }
        let part = |name: &str| Linear::load(&weights.pp(name), width, inner);
        Ok(RotaryAttention {
            heads,
            query: part("query")?,
            key: part("key")?,
            value: part("value")?,
            out: Linear::load(&weights.pp("out"), inner, width)?,
        })
    }

    /// Keys and values of `memory`, `[T, width]`.
    pub fn memory(&self, memory: &ArrayRef2<f32>) -> RotaryMemory {
        let mut keys = self.key.forward(memory);
        turn(&mut keys, self.heads);
        RotaryMemory {
            keys,
            values: self.value.forward(memory),
        }
    }

    /// `x`: `[T, width]`. Returns `[T, width]`. With `band`, row `i` sees rows `j` with `|i − j| ≤ band`.
    pub fn forward(
        &self,
        x: &ArrayRef2<f32>,
        memory: &RotaryMemory,
        band: Option<usize>,
    ) -> Array2<f32> {
        self.within(x, memory, band.map(Reach::band))
    }

    fn within(
        &self,
        x: &ArrayRef2<f32>,
        memory: &RotaryMemory,
        reach: Option<Reach>,
    ) -> Array2<f32> {
        let mut queries = self.query.forward(x);
        turn(&mut queries, self.heads);
        let [q, k, v] = [&queries, &memory.keys, &memory.values].map(|part| matrix::view(part));
        self.out.forward(&attend(q, k, v, self.heads, reach))
    }

    /// Attention of `x` `[T, width]` to itself.
    pub fn forward_self(&self, x: &ArrayRef2<f32>) -> Array2<f32> {
        self.forward(x, &self.memory(x), None)
    }

    /// Attention of `x` to itself where row `i` sees only itself and the `look_back − 1` rows
    /// before it.
    pub fn forward_behind(&self, x: &ArrayRef2<f32>, look_back: usize) -> Array2<f32> {
        let reach = Reach {
            behind: look_back.saturating_sub(1),
            ahead: 0,
        };
        self.within(x, &self.memory(x), Some(reach))
    }
}

/// Rotates channels `k` and `k + D/2` of each head (`D` channels) in frame `t` by
/// `t · BASE^(−2k/D)`, in place.
fn turn(x: &mut Array2<f32>, heads: usize) {
    let inner = x.ncols();
    let half = inner / heads / 2;
    let frequencies: Vec<f64> = (0..half)
        .map(|k| BASE.powf(-(k as f64) / half as f64))
        .collect();
    let values = x.as_slice_mut().expect("row-major array");
    let rows = values.par_chunks_exact_mut(inner).enumerate();
    rows.for_each(|(t, row)| {
        let angles = frequencies.iter().map(|f| (t as f64 * f).sin_cos());
        let angles: Vec<(f32, f32)> = angles.map(|(s, c)| (s as f32, c as f32)).collect();
        for head in row.chunks_exact_mut(2 * half) {
            let (a, b) = head.split_at_mut(half);
            for ((a, b), (sin, cos)) in a.iter_mut().zip(b).zip(&angles) {
                (*a, *b) = (*a * cos - *b * sin, *a * sin + *b * cos);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_depend_on_the_distance_of_frames_alone() {
        let row = |seed: f32| Array2::from_shape_fn((20, 8), |(_, c)| (c as f32 + seed).sin());
        let (mut q, mut k) = (row(0.3), row(1.9));
        turn(&mut q, 2);
        turn(&mut k, 2);
        let score = |i: usize, j: usize| q.row(i).dot(&k.row(j));
        for distance in 0..10 {
            let first = score(distance, 0);
            for i in distance..20 {
                assert!((score(i, i - distance) - first).abs() < 1e-4);
            }
        }
        assert!((score(5, 0) - score(0, 0)).abs() > 1e-2);
    }
}
