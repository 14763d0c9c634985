//! Multi-head attention, Vaswani et al. 2017, with an optional band mask.

use std::ops::Range;

use faer::MatRef;
use ndarray::{Array1, Array2, ArrayRef2, Axis, concatenate};

use super::{elementwise::softmax, linear::Linear, matrix};
use crate::{Result, models::Weights};

/// Attention of a sequence to itself.
#[derive(Debug, Clone)]
pub struct SelfAttention {
    heads: usize,
    /// `[C] → [3 C]`: queries, keys and values in one product.
    in_proj: Linear,
    out_proj: Linear,
}

impl SelfAttention {
    /// Reads `in_proj_weight` `[3 C, C]`, `in_proj_bias` and `out_proj`, as PyTorch's
    /// `nn.MultiheadAttention` names them.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape, or `heads` does not divide `channels`.
    pub fn load(weights: &Weights, channels: usize, heads: usize) -> Result<Self> {
        check_heads(channels, heads)?;
        Ok(SelfAttention {
            heads,
            in_proj: in_proj(weights, channels)?,
            out_proj: Linear::load(&weights.pp("out_proj"), channels, channels)?,
        })
    }

    /// Reads `q_proj`, `k_proj`, `v_proj` and `out_proj`, as Hugging Face names them.
    ///
    /// # Errors
    /// Those of [`SelfAttention::load`].
    pub fn load_separate(weights: &Weights, channels: usize, heads: usize) -> Result<Self> {
        Self::load_parts(
            weights,
            channels,
            heads,
            [("q_proj", true), ("k_proj", true), ("v_proj", true)],
        )
    }

    /// Like `load_separate`, but `k_proj` has no bias, as in Whisper.
    ///
    /// # Errors
    /// Those of [`SelfAttention::load`].
    pub fn load_without_key_bias(weights: &Weights, channels: usize, heads: usize) -> Result<Self> {
        Self::load_parts(
            weights,
            channels,
            heads,
            [("q_proj", true), ("k_proj", false), ("v_proj", true)],
        )
    }

    /// Reads `query_key_value` `[3 C, C]` and `mix`, as training/speech/whisper.py names them.
    ///
    /// # Errors
    /// Those of [`SelfAttention::load`].
    pub fn load_joint(weights: &Weights, channels: usize, heads: usize) -> Result<Self> {
        check_heads(channels, heads)?;
        Ok(SelfAttention {
            heads,
            in_proj: Linear::load(&weights.pp("query_key_value"), channels, 3 * channels)?,
            out_proj: Linear::load(&weights.pp("mix"), channels, channels)?,
        })
    }

    /// `names`: the name of each part and whether it has a bias.
    fn load_parts(
        weights: &Weights,
        channels: usize,
        heads: usize,
        names: [(&str, bool); 3],
    ) -> Result<Self> {
        check_heads(channels, heads)?;
        let parts = names
            .iter()
            .map(|(name, biased)| {
                let part = weights.pp(name);
                let weight = part.matrix("weight", channels, channels)?;
                let bias = if *biased {
                    part.vector("bias", channels)?
                } else {
                    Array1::zeros(channels)
                };
                Ok((weight, bias))
            })
            .collect::<Result<Vec<(Array2<f32>, Array1<f32>)>>>()?;
        let weight: Vec<_> = parts.iter().map(|part| part.0.view()).collect();
        let bias: Vec<_> = parts.iter().map(|part| part.1.view()).collect();
        let weight = concatenate(Axis(0), &weight).expect("equal widths");
        let bias = concatenate(Axis(0), &bias).expect("vectors");
        Ok(SelfAttention {
            heads,
            in_proj: Linear::from_parts(&weight, bias),
            out_proj: Linear::load(&weights.pp("out_proj"), channels, channels)?,
        })
    }

    /// `x`: `[T, C]`. Returns `[T, C]`.
    pub fn forward(&self, x: &ArrayRef2<f32>) -> Array2<f32> {
        self.forward_within(x, None)
    }

    /// Like `forward`, but with a reach each row sees only the keys within it.
    pub fn forward_within(&self, x: &ArrayRef2<f32>, reach: Option<Reach>) -> Array2<f32> {
        let channels = self.out_proj.inputs();
        let joint = self.in_proj.forward(x);
        let joint = matrix::view(&joint);
        let [q, k, v] = [0, 1, 2].map(|part| joint.subcols(part * channels, channels));
        self.out_proj.forward(&attend(q, k, v, self.heads, reach))
    }
}

/// Keys and values of a memory sequence. They are computed once and used at every denoising step.
#[derive(Debug, Clone)]
pub struct KeysValues {
    /// `[T, 2 C]`: keys, then values.
    joint: Array2<f32>,
}

/// Attention of one sequence to another.
#[derive(Debug, Clone)]
pub struct CrossAttention {
    heads: usize,
    query: Linear,
    key_value: Linear,
    out_proj: Linear,
}

impl CrossAttention {
    /// Reads the same names as [`SelfAttention::load`].
    ///
    /// # Errors
    /// Those of [`SelfAttention::load`].
    pub fn load(weights: &Weights, channels: usize, heads: usize) -> Result<Self> {
        check_heads(channels, heads)?;
        let joint = in_proj(weights, channels)?;
        Ok(CrossAttention {
            heads,
            query: joint.columns(0, channels),
            key_value: joint.columns(channels, 2 * channels),
            out_proj: Linear::load(&weights.pp("out_proj"), channels, channels)?,
        })
    }

    /// Keys and values of `memory`, `[T, C]`.
    pub fn keys_values(&self, memory: &ArrayRef2<f32>) -> KeysValues {
        KeysValues {
            joint: self.key_value.forward(memory),
        }
    }

    /// `x`: `[T, C]`. Returns `[T, C]`.
    ///
    /// With `band`, row `i` sees only the memory rows `j` with `|i − j| ≤ band`. This is FreeTalk
    /// eq. 9 and 10, but with −∞ outside the radius where the paper's text has +1.
    ///
    /// # Panics
    /// If there is a band and the memory is shorter than `x`.
    pub fn forward(
        &self,
        x: &ArrayRef2<f32>,
        memory: &KeysValues,
        band: Option<usize>,
    ) -> Array2<f32> {
        let channels = self.out_proj.inputs();
        let query = self.query.forward(x);
        let joint = matrix::view(&memory.joint);
        let (k, v) = (
            joint.subcols(0, channels),
            joint.subcols(channels, channels),
        );
        let reach = band.map(Reach::band);
        let mixed = attend(matrix::view(&query), k, v, self.heads, reach);
        self.out_proj.forward(&mixed)
    }
}

fn check_heads(channels: usize, heads: usize) -> Result<()> {
    if heads > 0 && channels.is_multiple_of(heads) {
        Ok(())
    } else {
        Err(crate::Error::Weights(format!(
            "attention: expected a number of heads that divides {channels} channels, got {heads}"
        )))
    }
}

fn in_proj(weights: &Weights, channels: usize) -> Result<Linear> {
    let weight = weights.matrix("in_proj_weight", 3 * channels, channels)?;
    let bias = weights.vector("in_proj_bias", 3 * channels)?;
    Ok(Linear::from_parts(&weight, bias))
}

/// Row `i` sees the keys `j` with `i − behind ≤ j ≤ i + ahead`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reach {
    /// Number of keys before the row's own.
    pub behind: usize,
    /// Number of keys after it.
    pub ahead: usize,
}

impl Reach {
    /// The row's own key and all before it.
    pub const PAST: Reach = Reach {
        behind: usize::MAX,
        ahead: 0,
    };

    /// A reach of `radius` keys to both sides.
    pub fn band(radius: usize) -> Self {
        Reach {
            behind: radius,
            ahead: radius,
        }
    }
}

/// `softmax(q kᵀ / √d) v` for each head, ibid. eq. 1.
///
/// `q`: `[T, C]`; `k`, `v`: `[S, C]`. Returns `[T, C]`. Only the keys within reach are read, so
/// a limited reach makes the cost linear in `T`.
pub fn attend(
    q: MatRef<'_, f32>,
    k: MatRef<'_, f32>,
    v: MatRef<'_, f32>,
    heads: usize,
    reach: Option<Reach>,
) -> Array2<f32> {
    let (channels, keys) = (q.ncols(), k.nrows());
    assert!(
        reach.is_none() || keys >= q.nrows(),
        "memory within its reach"
    );
    let width = channels / heads;
    let scale = 1.0 / (width as f32).sqrt();
    matrix::by_row_blocks(q.nrows(), channels, |rows, out| {
        let visible = visible_keys(rows.clone(), keys, reach);
        let mut scores = vec![0.0; rows.len() * visible.len()];
        let mut out = matrix::view_mut(out, channels);
        for head in 0..heads {
            let first = head * width;
            let q = q.submatrix(rows.start, first, rows.len(), width);
            let [k, v] = [k, v].map(|x| x.submatrix(visible.start, first, visible.len(), width));
            let target = matrix::view_mut(&mut scores, visible.len());
            matrix::scaled_product(target, scale, q, k.transpose());
            normalise(&mut scores, rows.start, &visible, reach);
            let scores = matrix::rows_of(&scores, visible.len());
            let target = out.as_mut().subcols_mut(head * width, width);
            matrix::product(target, scores, v);
        }
    })
}

/// The keys that any of these query rows may see.
fn visible_keys(rows: Range<usize>, keys: usize, reach: Option<Reach>) -> Range<usize> {
    match reach {
        None => 0..keys,
        Some(Reach { behind, ahead }) => {
            rows.start.saturating_sub(behind)..(rows.end + ahead).min(keys)
        }
    }
}

/// Softmax of each row over the keys within its reach; weights outside become 0.
fn normalise(scores: &mut [f32], first_row: usize, visible: &Range<usize>, reach: Option<Reach>) {
    for (index, row) in scores.chunks_exact_mut(visible.len()).enumerate() {
        let i = first_row + index;
        let row_keys = visible_keys(i..i + 1, visible.end, reach);
        let (start, end) = (row_keys.start - visible.start, row_keys.end - visible.start);
        row[..start].fill(0.0);
        row[end..].fill(0.0);
        softmax(&mut row[start..end]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(rows: usize, columns: usize, seed: f32) -> Array2<f32> {
        Array2::from_shape_fn((rows, columns), |(i, j)| {
            ((i * columns + j) as f32 * 0.731 + seed).sin() * 2.0
        })
    }

    #[test]
    fn attention_equals_its_formula() {
        let (q, k, v) = (random(40, 8, 0.1), random(50, 8, 1.7), random(50, 8, 2.9));
        let fast = attend(
            matrix::view(&q),
            matrix::view(&k),
            matrix::view(&v),
            2,
            Some(Reach::band(4)),
        );
        for i in 0..40usize {
            for c in 0..8 {
                let head = c / 4 * 4;
                let near = i.saturating_sub(4)..(i + 5).min(50);
                let weight = |j: usize| {
                    let dot: f32 = (0..4).map(|d| q[[i, head + d]] * k[[j, head + d]]).sum();
                    f64::from(dot / 2.0).exp()
                };
                let total: f64 = near.clone().map(weight).sum();
                let mixed: f64 = near.map(|j| weight(j) * f64::from(v[[j, c]])).sum();
                assert!((f64::from(fast[[i, c]]) - mixed / total).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn nothing_outside_the_band_has_influence() {
        let (q, k, v) = (random(90, 4, 0.0), random(90, 4, 1.0), random(90, 4, 2.0));
        let run = |k: &Array2<f32>, v: &Array2<f32>| {
            attend(
                matrix::view(&q),
                matrix::view(k),
                matrix::view(v),
                1,
                Some(Reach::band(3)),
            )
        };
        let before = run(&k, &v);
        let (mut k, mut v) = (k.clone(), v.clone());
        k.row_mut(50).fill(9.0);
        v.row_mut(50).fill(1e6);
        let after = run(&k, &v);
        for i in 0..90 {
            let changed = before.row(i) != after.row(i);
            assert_eq!(changed, (47..=53).contains(&i), "row {i}");
        }
    }
}
