//! Correlation of two curves, added up piece by piece.

/// Sums over pairs of values. The sums of several clips add up to the sums of all clips together.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moments {
    /// Number of pairs.
    pub count: f64,
    sum: [f64; 2],
    square: [f64; 2],
    product: f64,
}

impl Moments {
    /// Sums over two curves, up to the length of the shorter one.
    pub fn of(a: &[f64], b: &[f64]) -> Self {
        let mut out = Self::default();
        for (x, y) in a.iter().zip(b) {
            out.count += 1.0;
            out.sum[0] += x;
            out.sum[1] += y;
            out.square[0] += x * x;
            out.square[1] += y * y;
            out.product += x * y;
        }
        out
    }

    /// Adds the sums of another piece.
    pub fn add(&mut self, other: &Moments) {
        self.count += other.count;
        self.product += other.product;
        for k in 0..2 {
            self.sum[k] += other.sum[k];
            self.square[k] += other.square[k];
        }
    }

    /// Sum of squared differences from the mean for each of the two curves.
    pub fn scatter(&self) -> [f64; 2] {
        [0, 1].map(|k| {
            let mean = self.sum[k] / self.count.max(1.0);
            let scatter = self.square[k] - self.sum[k] * mean;
            // Arithmetic leaves rounding errors in a constant curve: ignore them.
            if scatter > 1e-11 * self.square[k] {
                scatter
            } else {
                0.0
            }
        })
    }

    /// Sum of products of both curves' differences from their means; 0 where either is constant.
    ///
    /// Divided by the second curve's scatter, it is the least-squares slope of the first curve over
    /// the second.
    pub fn joint_scatter(&self) -> f64 {
        let [a, b] = self.scatter();
        if a > 0.0 && b > 0.0 {
            self.product - self.sum[0] * self.sum[1] / self.count
        } else {
            0.0
        }
    }

    /// Pearson's r, −1 to 1; 0 where either curve is constant.
    pub fn r(&self) -> f64 {
        let [a, b] = self.scatter();
        if a > 0.0 && b > 0.0 {
            self.joint_scatter() / (a * b).sqrt()
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::pearson;

    fn curves() -> (Vec<f64>, Vec<f64>) {
        let a: Vec<f64> = (0..60).map(|t| 8.0 + (f64::from(t) * 0.4).sin()).collect();
        let b = (0..60).map(|t| 5.0 - (f64::from(t) * 0.43).sin()).collect();
        (a, b)
    }

    #[test]
    fn pieces_add_up_to_the_whole() {
        let (a, b) = curves();
        let mut parts = Moments::of(&a[..17], &b[..17]);
        parts.add(&Moments::of(&a[17..], &b[17..]));
        assert!((parts.r() - pearson(&a, &b)).abs() < 1e-12);
        assert_eq!(parts.count, 60.0);
    }

    #[test]
    fn a_constant_correlates_with_nothing() {
        let (a, _) = curves();
        assert_eq!(Moments::of(&a, &[7.1; 60]).r(), 0.0);
        assert_eq!(Moments::default().r(), 0.0);
    }

    #[test]
    fn joint_scatter_gives_the_slope_of_a_line() {
        let (a, _) = curves();
        let line: Vec<f64> = a.iter().map(|x| 0.3 * x - 2.0).collect();
        let moments = Moments::of(&line, &a);
        assert!((moments.joint_scatter() / moments.scatter()[1] - 0.3).abs() < 1e-9);
    }

    #[test]
    fn scatter_is_the_variance_times_the_count() {
        let moments = Moments::of(&[1.0, 2.0, 3.0], &[0.0, 0.0, 3.0]);
        assert!((moments.scatter()[0] - 2.0).abs() < 1e-12);
        assert!((moments.scatter()[1] - 6.0).abs() < 1e-12);
    }
}
