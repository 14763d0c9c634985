//! Correlation of two curves.

/// Pearson's r of two curves of the same length, −1 to 1; 0 where either is constant.
///
/// Of curves of different lengths, only the frames up to the shorter length count.
pub fn pearson(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len().min(b.len());
    if count == 0 {
        return 0.0;
    }
    let (a, b) = (&a[..count], &b[..count]);
    let mean = |x: &[f64]| x.iter().sum::<f64>() / count as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        let (x, y) = (x - mean_a, y - mean_b);
        aa += x * x;
        bb += y * y;
        ab += x * y;
    }
    // Arithmetic leaves rounding errors in a constant curve: ignore them.
    let moves = |power: f64, mean: f64| power > count as f64 * (1e-9 * mean).powi(2);
    if moves(aa, mean_a) && moves(bb, mean_b) {
        ab / (aa * bb).sqrt()
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(shift: usize) -> Vec<f64> {
        (0..100)
            .map(|t| ((t + 50 - shift) as f64 * 0.37).sin() + (t as f64 * 0.0011))
            .collect()
    }

    #[test]
    fn scale_and_offset_do_not_matter_and_constants_give_zero() {
        let a = wave(0);
        let b: Vec<f64> = a.iter().map(|x| 3.0 * x - 7.0).collect();
        assert!((pearson(&a, &b) - 1.0).abs() < 1e-12);
        let b: Vec<f64> = a.iter().map(|x| -x).collect();
        assert!((pearson(&a, &b) + 1.0).abs() < 1e-12);
        assert_eq!(pearson(&a, &[2.0; 100]), 0.0);
        let nearly: Vec<f64> = (0..100).map(|t| 0.1 + 1e-16 * f64::from(t % 3)).collect();
        assert_eq!(pearson(&a, &nearly), 0.0);
        assert_eq!(pearson(&[], &[]), 0.0);
    }
}
