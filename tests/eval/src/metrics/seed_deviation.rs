//! Diversity: how much a region differs between performances of the same speech.

use super::{Clip, check};
use anyface::Result;

/// `mean_{t, v ∈ region} √(Σ_i var_seeds)`: how much a vertex's position differs between `clips`,
/// as a standard deviation in their unit. Uses the sample variance; 0 for fewer than two clips.
///
/// # Errors
/// `ShapeMismatch` unless all are the same `[T, V, 3]`; `InvalidInput` for a vertex beyond `V`.
pub fn seed_deviation(clips: &[Clip<'_>], region: &[usize]) -> Result<f64> {
    let [first, .., _] = clips else {
        return Ok(0.0);
    };
    for clip in clips {
        check(*clip, *first, region, 1)?;
    }
    let frames = first.dim().0;
    let variance = |t: usize, v: usize, i: usize| {
        let values = || clips.iter().map(|clip| clip[[t, v, i]]);
        let mean = values().sum::<f64>() / clips.len() as f64;
        values().map(|x| (x - mean).powi(2)).sum::<f64>() / (clips.len() - 1) as f64
    };
    let mut sum = 0.0;
    for t in 0..frames {
        for v in region {
            sum += (0..3).map(|i| variance(t, *v, i)).sum::<f64>().sqrt();
        }
    }
    Ok(sum / (frames * region.len().max(1)) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn two_clips_apart_by_a_known_distance() {
        let still = Array3::<f64>::zeros((3, 2, 3));
        let mut moved = still.clone();
        for t in 0..3 {
            moved[[t, 1, 0]] = 3.0;
            moved[[t, 1, 2]] = 4.0;
        }
        let pair = [still.view(), moved.view()];
        // The standard deviation of two values is their distance divided by √2.
        let expected = 5.0 / 2f64.sqrt();
        assert!((seed_deviation(&pair, &[1]).unwrap() - expected).abs() < 1e-12);
        assert_eq!(seed_deviation(&pair, &[0]).unwrap(), 0.0);
        assert_eq!(seed_deviation(&pair[..1], &[1]).unwrap(), 0.0);
    }

    #[test]
    fn lengths_must_agree() {
        let (a, b) = (Array3::zeros((3, 2, 3)), Array3::zeros((4, 2, 3)));
        assert!(seed_deviation(&[a.view(), b.view()], &[0]).is_err());
    }
}
