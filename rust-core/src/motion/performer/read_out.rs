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
    /// Fits `values` `[T, N]` to `features` `[T, C]`. `ridge`, above 0, is the weight of the squared weights.
    pub fn fit(features: &Array2<f32>, values: &Array2<f32>, ridge: f64) -> ReadOut {
        let (mean, offset) = (mean_row(features), mean_row(values));
        let (x, y) = (features - &mean, values - &offset);
        let (gram, aim) = (x.t().dot(&x), x.t().dot(&y));
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

/// The mean of rows `[T, N]`; zeros for none.
pub(super) fn mean_row(rows: &Array2<f32>) -> Array1<f32> {
    let mean = rows.mean_axis(Axis(0));
    mean.unwrap_or_else(|| Array1::zeros(rows.ncols()))
}
