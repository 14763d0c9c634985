//! Embedding of a diffusion step.

/// Sines, then cosines, of `step / 10000^(i / half)`, for `i` below `half = channels / 2`.
///
/// Ho et al. 2020, appendix B, after Vaswani et al. 2017. Returns `[channels]`; an odd last channel
/// is 0.
pub fn timestep_embedding(step: usize, channels: usize) -> Vec<f32> {
    let half = channels / 2;
    let angle = |i: usize| {
        let frequency = (-(10_000f64.ln()) * i as f64 / half as f64).exp();
        step as f64 * frequency
    };
    let mut out: Vec<f32> = (0..half).map(|i| angle(i).sin() as f32).collect();
    out.extend((0..half).map(|i| angle(i).cos() as f32));
    out.resize(channels, 0.0);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn step_zero_is_zeros_then_ones() {
        assert_eq!(timestep_embedding(0, 6), [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    }

    #[test]
    fn first_frequency_is_one_and_steps_differ() {
        let a = timestep_embedding(3, 8);
        assert!((a[0] - 3f32.sin()).abs() < 1e-6);
        assert!((a[4] - 3f32.cos()).abs() < 1e-6);
        assert_ne!(a, timestep_embedding(4, 8));
    }
}
