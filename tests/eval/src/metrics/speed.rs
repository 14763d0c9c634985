//! How fast a region moves and how abruptly.

use super::Clip;

/// Root mean square speed of `region` from each frame to the next, `[T − 1]`, in the clip's unit
/// per second.
pub fn rms_speeds(clip: Clip<'_>, region: &[usize], fps: f64) -> Vec<f64> {
    derivative(clip, region, &[-fps, fps])
}

/// Root mean square acceleration of `region` around every inner frame, `[T − 2]`, in the clip's
/// unit per second squared. Value `t` belongs to frame `t + 1`.
pub fn rms_accelerations(clip: Clip<'_>, region: &[usize], fps: f64) -> Vec<f64> {
    let square = fps * fps;
    derivative(clip, region, &[square, -2.0 * square, square])
}

/// Root mean square of a list; 0 without values.
pub fn root_mean_square(values: &[f64]) -> f64 {
    let sum: f64 = values.iter().map(|x| x * x).sum();
    (sum / values.len().max(1) as f64).sqrt()
}

fn derivative(clip: Clip<'_>, region: &[usize], stencil: &[f64]) -> Vec<f64> {
    let steps = (clip.dim().0 + 1).saturating_sub(stencil.len());
    let squared = |t: usize| -> f64 {
        let all = region.iter().flat_map(|v| (0..3).map(move |i| (*v, i)));
        all.map(|(v, i)| {
            let terms = stencil.iter().enumerate();
            let change: f64 = terms.map(|(k, weight)| weight * clip[[t + k, v, i]]).sum();
            change * change
        })
        .sum()
    };
    let count = region.len().max(1) as f64;
    (0..steps).map(|t| (squared(t) / count).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn a_steady_slide_has_speed_and_no_acceleration() {
        let clip = Array3::from_shape_fn((5, 4, 3), |(t, v, i)| {
            if v == 2 {
                t as f64 * [3.0, 0.0, 4.0][i]
            } else {
                0.0
            }
        });
        assert_eq!(rms_speeds(clip.view(), &[2], 10.0), [50.0; 4]);
        assert_eq!(rms_speeds(clip.view(), &[0, 1], 10.0), [0.0; 4]);
        let half = rms_speeds(clip.view(), &[2, 3], 10.0);
        assert!((half[0] - 50.0 * 0.5f64.sqrt()).abs() < 1e-9);
        assert_eq!(rms_accelerations(clip.view(), &[2], 10.0), [0.0; 3]);
    }

    #[test]
    fn a_kick_is_an_acceleration_at_its_frame() {
        let mut clip = Array3::zeros((5, 1, 3));
        clip[[2, 0, 1]] = 1.0;
        assert_eq!(rms_accelerations(clip.view(), &[0], 1.0), [1.0, 2.0, 1.0]);
        assert!(rms_speeds(clip.view().split_at(ndarray::Axis(0), 1).0, &[0], 1.0).is_empty());
    }

    #[test]
    fn the_root_mean_square_of_three_and_four() {
        assert_eq!(root_mean_square(&[3.0, -4.0]), 12.5f64.sqrt());
        assert_eq!(root_mean_square(&[]), 0.0);
    }
}
