//! Causal self-attention, one row at a time, that favours near rows in steps of one period.
//!
//! FaceFormer (Fan et al. 2022, eq. 4 and 5): row `i` sees the rows `j ≤ i`. Each score is biased
//! by `−slope_h · ⌊(i − j) / p⌋`, where each head has its own slope as in ALiBi (Press et al.
//! 2022). The keys and values of the latest `look_back` rows are stored, the current row included.
//! Twin of `training/nn/biased_attention.py`.

use std::collections::VecDeque;

use super::{elementwise::softmax, linear::Linear};
use crate::{Error, Result, models::Weights};

/// The weights, named as in PyTorch's `nn.MultiheadAttention`.
#[derive(Debug, Clone)]
pub struct BiasedSelfAttention {
    heads: usize,
    period: usize,
    look_back: usize,
    in_proj: Linear,
    out_proj: Linear,
}

/// Keys and values of the latest rows, oldest first.
#[derive(Debug, Clone, Default)]
pub struct PastRows {
    /// `[2 C]` each: keys, then values.
    rows: VecDeque<Vec<f32>>,
}

impl BiasedSelfAttention {
    /// Reads the weights for rows of `channels`; `period` and `look_back` count rows.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape, if `heads`, `period` or `look_back`
    /// is 0, or if `heads` does not divide `channels`.
    pub fn load(
        weights: &Weights,
        channels: usize,
        heads: usize,
        period: usize,
        look_back: usize,
    ) -> Result<Self> {
        if heads == 0 || !channels.is_multiple_of(heads) || period == 0 || look_back == 0 {
            return Err(Error::Weights(format!(
                "biased attention: expected heads that divide {channels} channels and a period and a \
                 look-back of at least 1, got {heads} heads, {period}, {look_back}"
            )));
        }
        let weight = weights.matrix("in_proj_weight", 3 * channels, channels)?;
        let bias = weights.vector("in_proj_bias", 3 * channels)?;
        Ok(BiasedSelfAttention {
            heads,
            period,
            look_back,
            in_proj: Linear::from_parts(&weight, bias),
            out_proj: Linear::load(&weights.pp("out_proj"), channels, channels)?,
        })
    }

    /// Attends from the next row `x`, `[C]`, and writes `out`, `[C]`.
    pub fn step(&self, x: &[f32], past: &mut PastRows, out: &mut [f32]) {
        let channels = self.out_proj.inputs();
        let mut joint = vec![0.0; 3 * channels];
        self.in_proj.forward_row(x, &mut joint);
        if past.rows.len() == self.look_back {
            past.rows.pop_front();
        }
        past.rows.push_back(joint.split_off(channels));
        let (query, size) = (joint, channels / self.heads);
        let mut mixed = vec![0.0; channels];
        let mut scores = vec![0.0; past.rows.len()];
        for head in 0..self.heads {
            let slope = (-8.0 * (head + 1) as f32 / self.heads as f32).exp2();
            let columns = head * size..(head + 1) * size;
            for (j, (score, row)) in scores.iter_mut().zip(&past.rows).enumerate() {
                let behind = (past.rows.len() - 1 - j) / self.period;
                *score = dot(&query[columns.clone()], &row[columns.clone()]) / (size as f32).sqrt()
                    - slope * behind as f32;
            }
            softmax(&mut scores);
            for (score, row) in scores.iter().zip(&past.rows) {
                let values = &row[channels..][columns.clone()];
                for (sum, value) in mixed[columns.clone()].iter_mut().zip(values) {
                    *sum += score * value;
                }
            }
        }
        self.out_proj.forward_row(&mixed, out);
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Adds the sinusoids of row number `row` modulo the period to `x`, `[C]`; ibid. eq. 4.
pub fn add_periodic_position(x: &mut [f32], row: usize, period: usize) {
    let (at, width) = ((row % period) as f32, x.len() as f32);
    for (pair, x) in x.chunks_mut(2).enumerate() {
        let angle = at * 10_000f32.powf(-2.0 * pair as f32 / width);
        for (x, value) in x.iter_mut().zip([angle.sin(), angle.cos()]) {
            *x += value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attention(look_back: usize) -> BiasedSelfAttention {
        let value = |i: usize| ((i * 31 + 7) % 23) as f32 * 0.05 - 0.5;
        let arrays = [
            ("in_proj_weight", vec![12, 4], (0..48).map(value).collect()),
            ("in_proj_bias", vec![12], (0..12).map(value).collect()),
            ("out_proj.weight", vec![4, 4], (5..21).map(value).collect()),
            ("out_proj.bias", vec![4], (3..7).map(value).collect()),
        ];
        let named = |(name, shape, values): (&str, _, _)| (name.to_owned(), (shape, values));
        let weights = Weights::from_arrays(arrays.map(named));
        BiasedSelfAttention::load(&weights, 4, 2, 3, look_back).unwrap()
    }

    fn row(t: usize) -> Vec<f32> {
        (0..4)
            .map(|c| ((t * 13 + c * 5) % 11) as f32 * 0.2 - 1.0)
            .collect()
    }

    #[test]
    fn two_thousand_kept_rows_equal_recomputing_everything() {
        let attention = attention(600);
        let (mut past, mut out) = (PastRows::default(), vec![0.0; 4]);
        for t in 0..2_000 {
            attention.step(&row(t), &mut past, &mut out);
        }
        assert_eq!(past.rows.len(), 600);
        let (mut again, mut expected) = (PastRows::default(), vec![0.0; 4]);
        for t in 1_400..2_000 {
            attention.step(&row(t), &mut again, &mut expected);
        }
        assert!(crate::nn::golden::distance(&out, &expected) < 1e-6);
    }

    #[test]
    fn positions_come_again_after_a_period() {
        let at = |row: usize| {
            let mut x = vec![0.0; 6];
            add_periodic_position(&mut x, row, 5);
            x
        };
        assert_eq!(at(3), at(8));
        assert_ne!(at(3), at(4));
    }
}
