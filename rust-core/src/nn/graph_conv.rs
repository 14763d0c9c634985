//! Graph convolution over a fixed graph.

use ndarray::{Array2, ArrayRef2, ArrayRef3, Axis};

use super::{linear::Linear, matrix};
use crate::{Result, models::Weights};

/// `D^-½ (A + I) D^-½` of an undirected graph, Kipf & Welling 2017, eq. 2. Returns `[N, N]`.
pub fn normalised_adjacency(nodes: usize, edges: &[(usize, usize)]) -> Array2<f32> {
    let mut adjacency = Array2::eye(nodes);
    for &(a, b) in edges {
        adjacency[[a, b]] = 1.0;
        adjacency[[b, a]] = 1.0;
    }
    let scale = adjacency.sum_axis(Axis(1)).mapv(|d: f32| 1.0 / d.sqrt());
    adjacency.indexed_iter_mut().for_each(|((a, b), value)| {
        *value *= scale[a] * scale[b];
    });
    adjacency
}

/// `Â X W + b`, ibid. eq. 2, without the activation.
#[derive(Debug, Clone)]
pub struct GraphConv {
    linear: Linear,
}

impl GraphConv {
    /// Reads `weight` `[out, in]` and `bias` `[out]`.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn load(weights: &Weights, inputs: usize, outputs: usize) -> Result<Self> {
        let linear = Linear::load(weights, inputs, outputs)?;
        Ok(GraphConv { linear })
    }

    /// `x`: `[T, N, in]`; `adjacency`: `[N, N]`. Returns `[T · N, out]`.
    pub fn forward(&self, x: &ArrayRef3<f32>, adjacency: &ArrayRef2<f32>) -> Array2<f32> {
        let (frames, nodes, channels) = x.dim();
        let mut spread = Array2::zeros((frames * nodes, channels));
        for (t, frame) in x.axis_iter(Axis(0)).enumerate() {
            let rows = ndarray::s![t * nodes..(t + 1) * nodes, ..];
            let mut rows = spread.slice_mut(rows);
            let target = rows.as_slice_mut().expect("whole rows are contiguous");
            let frame = frame.as_standard_layout();
            let target = matrix::view_mut(target, channels);
            matrix::product(target, matrix::view(adjacency), matrix::view(&frame));
        }
        self.linear.forward(&spread)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adjacency_is_symmetric_and_regular_graphs_average() {
        let ring: Vec<_> = (0..5).map(|i| (i, (i + 1) % 5)).collect();
        let adjacency = normalised_adjacency(5, &ring);
        assert_eq!(adjacency, adjacency.t());
        for row in adjacency.rows() {
            assert!((row.sum() - 1.0).abs() < 1e-6);
        }
    }
}
