//! A ridge regression with an offset of its own.

use faer::{Mat, Side, linalg::solvers::Solve};
use ndarray::{Array1, Array2, ArrayView2, Axis};

/// From rows of features to rows of values.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ReadOut {
    /// `[C]`, the features at which the value is `offset`.
    pub mean: Array1<f32>,
    /// `[C, N]`, values per unit of a feature.
    pub weights: Array2<f32>,
    /// `[N]`.
    pub offset: Array1<f32>,
}

impl ReadOut {
    /// Fits `values` `[T, N]` to `features` `[T, C]`. Each row counts as much as its number in `frame_weights` `[T]`
    /// says, above 0. `ridge`, above 0, is the weight of the squared weights.
    pub fn fit(
        features: &Array2<f32>,
        values: &Array2<f32>,
        frame_weights: &Array1<f32>,
        ridge: f64,
    ) -> ReadOut {
        let mean = mean_row(features, frame_weights);
        let offset = mean_row(values, frame_weights);
        let (x, y) = (features - &mean, values - &offset);
        let weighted = &x * &frame_weights.view().insert_axis(Axis(1));
        let (gram, aim) = (weighted.t().dot(&x), weighted.t().dot(&y));
        let shrunk =
            |i: usize, j: usize| f64::from(gram[[i, j]]) + if i == j { ridge } else { 0.0 };
        let size = (x.ncols(), y.ncols());
        let gram = Mat::from_fn(size.0, size.0, shrunk);
        let aim = Mat::from_fn(size.0, size.1, |i, j| f64::from(aim[[i, j]]));
        // The ridge makes the matrix positive definite. Features that are not finite leave no fit.
        let weights = gram.llt(Side::Lower).map(|factors| {
            let solved = factors.solve(&aim);
            Array2::from_shape_fn(size, |(i, j)| solved[(i, j)] as f32)
        });
        ReadOut {
            mean,
            weights: weights.unwrap_or_else(|_| Array2::zeros(size)),
            offset,
        }
    }

    /// Values `[T, N]` for features `[T, C]`.
    pub fn at(&self, features: ArrayView2<'_, f32>) -> Array2<f32> {
        (&features - &self.mean).dot(&self.weights) + &self.offset
    }
}

/// The mean of rows `[T, N]`, each as often as `frame_weights` `[T]` says; zeros for none.
pub(super) fn mean_row(rows: &Array2<f32>, frame_weights: &Array1<f32>) -> Array1<f32> {
    let total = frame_weights.sum();
    if total > 0.0 {
        (rows * &frame_weights.view().insert_axis(Axis(1))).sum_axis(Axis(0)) / total
    } else {
        Array1::zeros(rows.ncols())
    }
}
