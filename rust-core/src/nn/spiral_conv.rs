//! SpiralConv3D: a convolution over a surface and the latest frames, one frame at a time.
//!
//! EmoFace (Lin et al. 2025, eq. 1 to 3): `W f(cnt_δ(k-disk(v))) + b`, where `f` gathers the
//! vertices of a spiral in the last δ frames; frames before the first are zero. The input is the
//! sum of a row for the frame and a row for the vertex, so the convolution splits into two parts.
//! The surface part is computed once. The time part is one row per frame. So memory grows only with
//! the number of vertices. Twin of `training/nn/spiral_conv.py`.

use std::collections::VecDeque;

use ndarray::{Array2, Array3, ArrayView2, Axis, s};

use crate::{Error, Result, models::Weights};

/// The convolution of `in_time[t] + on_surface[v]`.
#[derive(Debug, Clone)]
pub struct SpiralConv {
    /// `[δ, out, in]`, oldest frame first, with the taps of each frame summed.
    in_time: Array3<f32>,
    /// `[δ + 1, V, out]`: the surface part plus the bias after 0 to δ frames.
    on_surface: Array3<f32>,
}

/// Rows of the latest frames, oldest first.
pub type PastFrames = VecDeque<Vec<f32>>;

impl SpiralConv {
    /// Reads `weight` `[δ, kernel, in, out]` and `bias` `[out]`.
    ///
    /// `on_surface`: `[V, in]`. `spirals`: `[V, kernel]` numbers of vertices.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape, or a spiral names a vertex that does
    /// not exist.
    pub fn load(
        weights: &Weights,
        spirals: &Array2<usize>,
        on_surface: ArrayView2<'_, f32>,
        outputs: usize,
        delta: usize,
    ) -> Result<Self> {
        let (vertices, inputs) = on_surface.dim();
        let kernel = spirals.ncols();
        if let Some(strange) = spirals.iter().find(|vertex| **vertex >= vertices) {
            return Err(Error::Weights(format!(
                "spirals: expected vertices below {vertices}, got {strange}"
            )));
        }
        let shape = [delta, kernel, inputs, outputs];
        let weight = weights.values("weight", &shape)?;
        let weight = ndarray::Array4::from_shape_vec(shape, weight).expect("the shape was checked");
        let bias = weights.vector("bias", outputs)?;
        let in_time = weight
            .sum_axis(Axis(1))
            .permuted_axes([0, 2, 1])
            .as_standard_layout()
            .into_owned();
        let mut table = Array3::zeros((delta + 1, vertices, outputs));
        table.slice_mut(s![0, .., ..]).assign(&bias);
        for frames in 1..=delta {
            let mut rows = table.index_axis(Axis(0), frames - 1).to_owned();
            for k in 0..kernel {
                let gathered = on_surface.select(Axis(0), &spirals.column(k).to_vec());
                rows += &gathered.dot(&weight.slice(s![delta - frames, k, .., ..]));
            }
            table.index_axis_mut(Axis(0), frames).assign(&rows);
        }
        Ok(SpiralConv {
            in_time,
            on_surface: table,
        })
    }

    /// The time part of the next frame, `[out]`, the same for every vertex. `row`: `[in]`.
    pub fn step_in_time(&self, row: &[f32], past: &mut PastFrames) -> Vec<f32> {
        let delta = self.in_time.len_of(Axis(0));
        if past.len() == delta {
            past.pop_front();
        }
        past.push_back(row.to_vec());
        let newest = self.in_time.outer_iter().rev();
        let mut moved = vec![0.0f32; self.in_time.len_of(Axis(1))];
        for (weight, row) in newest.zip(past.iter().rev()) {
            for (sum, weight) in moved.iter_mut().zip(weight.outer_iter()) {
                *sum += weight.iter().zip(row).map(|(w, x)| w * x).sum::<f32>();
            }
        }
        moved
    }

    /// A frame `[V, out]` from its time part. `frames`: number of frames so far, at most δ.
    pub fn over_surface(&self, in_time: &[f32], frames: usize) -> Array2<f32> {
        let mut out = self.on_surface.index_axis(Axis(0), frames).to_owned();
        for mut vertex in out.rows_mut() {
            for (value, moved) in vertex.iter_mut().zip(in_time) {
                *value += moved;
            }
        }
        out
    }

    /// Number of output channels.
    pub fn outputs(&self) -> usize {
        self.on_surface.len_of(Axis(2))
    }

    /// δ, the number of frames that the convolution covers.
    pub fn delta(&self) -> usize {
        self.in_time.len_of(Axis(0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_equals_four_loops() {
        let (delta, kernel, inputs, outputs, vertices) = (3, 4, 2, 3, 5);
        let value = |i: usize| ((i * 37 + 11) % 29) as f32 * 0.07 - 1.0;
        let count = delta * kernel * inputs * outputs;
        let weight: Vec<f32> = (0..count).map(value).collect();
        let bias: Vec<f32> = (0..outputs).map(|i| value(i + 91)).collect();
        let arrays = [
            (
                "weight",
                vec![delta, kernel, inputs, outputs],
                weight.clone(),
            ),
            ("bias", vec![outputs], bias.clone()),
        ];
        let places = Array2::from_shape_fn((vertices, inputs), |(v, i)| value(7 * v + i));
        let spirals = Array2::from_shape_fn((vertices, kernel), |(v, k)| (v + 2 * k) % vertices);
        let named = |(name, shape, values): (&str, _, _)| (name.to_owned(), (shape, values));
        let weights = Weights::from_arrays(arrays.map(named));
        let conv = SpiralConv::load(&weights, &spirals, places.view(), outputs, delta).unwrap();
        let time = |t: usize, i: usize| value(5 * t + i + 40);
        let mut past_rows = PastFrames::new();
        for t in 0..6 {
            let row: Vec<f32> = (0..inputs).map(|i| time(t, i)).collect();
            let frame = conv.step_in_time(&row, &mut past_rows);
            let frame = conv.over_surface(&frame, past_rows.len());
            for v in 0..vertices {
                for o in 0..outputs {
                    let mut expected = bias[o];
                    for d in 0..delta {
                        let Some(past) = (t + d + 1).checked_sub(delta) else {
                            continue;
                        };
                        for k in 0..kernel {
                            for i in 0..inputs {
                                let x = time(past, i) + places[[spirals[[v, k]], i]];
                                let at = ((d * kernel + k) * inputs + i) * outputs + o;
                                expected += x * weight[at];
                            }
                        }
                    }
                    assert!((frame[[v, o]] - expected).abs() < 1e-4, "{t} {v} {o}");
                }
            }
        }
        let strange = Array2::from_elem((vertices, kernel), vertices);
        let refused = SpiralConv::load(&weights, &strange, places.view(), outputs, delta);
        assert!(refused.unwrap_err().to_string().contains("below 5, got 5"));
    }
}
