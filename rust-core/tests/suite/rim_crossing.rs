//! How far two rims that face each other, lips or lids, pass through each other.

use anyface::{Error, Result};
use ndarray::ArrayView3;

/// The crossing of two rims, over all frames and all vertices of the upper rim.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RimCrossing {
    /// Share of the vertices that lies below the lower rim.
    pub share: f64,
    /// Mean depth of the vertices below, in the clip's unit; 0 if there are none.
    pub mean_depth: f64,
    /// Largest depth.
    pub depth: f64,
    /// Mean height of the upper over the lower rim where it lies above.
    pub gap: f64,
}

/// Compares two rims in every frame of `clip` `[T, V, 3]`, which holds positions, not
/// displacements.
///
/// `upper`, `lower`: vertices from one corner to the other. `across`: unit vector from that corner to
/// the other; `up`: unit vector from the lower to the upper rim. The height of the lower rim under a
/// vertex of the upper one is interpolated between the lower rim's vertices on either side.
/// Vertices of the upper rim beyond the ends of the lower one are left out.
///
/// # Errors
/// `InvalidInput` if a rim has fewer than two vertices or names one that does not exist.
pub fn rim_crossing(
    clip: ArrayView3<'_, f64>,
    upper: &[usize],
    lower: &[usize],
    across: [f64; 3],
    up: [f64; 3],
) -> Result<RimCrossing> {
    let vertices = clip.dim().1;
    if upper.len() < 2 || lower.len() < 2 {
        return Err(Error::InvalidInput(format!(
            "rims: expected two vertices or more, got {} and {}",
            upper.len(),
            lower.len()
        )));
    }
    if let Some(v) = upper.iter().chain(lower).find(|v| **v >= vertices) {
        return Err(Error::InvalidInput(format!(
            "rims: expected vertices below {vertices}, got {v}"
        )));
    }
    let (mut depths, mut gaps) = (Vec::new(), Vec::new());
    for frame in clip.outer_iter() {
        let along =
            |v: usize, axis: [f64; 3]| -> f64 { (0..3).map(|i| frame[[v, i]] * axis[i]).sum() };
        let rim: Vec<(f64, f64)> = lower
            .iter()
            .map(|&v| (along(v, across), along(v, up)))
            .collect();
        for &v in upper {
            if let Some(below) = height_at(&rim, along(v, across)) {
                let gap = along(v, up) - below;
                if gap < 0.0 {
                    depths.push(-gap)
                } else {
                    gaps.push(gap)
                }
            }
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    Ok(RimCrossing {
        share: depths.len() as f64 / (depths.len() + gaps.len()).max(1) as f64,
        mean_depth: mean(&depths),
        depth: depths.iter().copied().fold(0.0, f64::max),
        gap: mean(&gaps),
    })
}

/// Height at a place of a line of (place, height). Where the line doubles back, its largest height
/// there. `None` beyond its ends.
fn height_at(rim: &[(f64, f64)], place: f64) -> Option<f64> {
    let pieces = rim.windows(2).filter_map(|ends| {
        let [(a, low), (b, high)] = [ends[0], ends[1]];
        let inside = place >= a.min(b) && place <= a.max(b);
        let share = if a == b { 0.0 } else { (place - a) / (b - a) };
        inside.then_some(low + share * (high - low))
    });
    pieces.reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    const X: [f64; 3] = [1.0, 0.0, 0.0];
    const Y: [f64; 3] = [0.0, 1.0, 0.0];

    #[test]
    fn depth_is_measured_under_the_upper_rims_own_vertices() {
        // The upper rim (0, 1) is at height 0.5. The lower rim (2, 3, 4) is a roof whose middle is
        // at height 1.
        let points = [[0.5, 0.5], [1.0, 0.5], [0.0, 0.0], [1.0, 1.0], [2.0, 0.0]];
        let clip = Array3::from_shape_fn((1, 5, 3), |(_, v, i)| match i {
            2 => 7.0,
            i => points[v][i],
        });
        let crossing = rim_crossing(clip.view(), &[0, 1], &[2, 3, 4], X, Y).unwrap();
        assert_eq!(
            (crossing.share, crossing.depth, crossing.mean_depth),
            (0.5, 0.5, 0.5)
        );
        assert_eq!(crossing.gap, 0.0);
    }

    #[test]
    fn vertices_beside_the_lower_rim_do_not_count() {
        let clip = Array3::from_shape_fn((2, 4, 3), |(t, v, i)| {
            [[0.0, 1.0], [9.0, -5.0], [0.0, 0.0], [1.0, 0.0]][v][i.min(1)]
                + t as f64 * (i == 1) as u8 as f64
        });
        let crossing = rim_crossing(clip.view(), &[0, 1], &[2, 3], X, Y).unwrap();
        assert_eq!((crossing.share, crossing.gap), (0.0, 1.0));
        assert!(rim_crossing(clip.view(), &[0], &[2, 3], X, Y).is_err());
        assert!(rim_crossing(clip.view(), &[0, 1], &[2, 4], X, Y).is_err());
    }
}
