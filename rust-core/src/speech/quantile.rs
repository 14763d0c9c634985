//! Quantiles of levels.

/// Linear interpolation between order statistics, as torch and numpy do by default.
pub(super) fn quantile(values: &[f32], q: f64) -> f32 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    let position = q * (sorted.len() - 1) as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    let share = (position - below as f64) as f32;
    sorted[below] + (sorted[above] - sorted[below]) * share
}
