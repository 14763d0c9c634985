//! Seeded choices that are the same on every platform.

use rand_chacha::{ChaCha8Rng, rand_core::RngCore};

/// A whole number below `count`. All are equally likely to within one part in 2^64.
pub(super) fn below(random: &mut ChaCha8Rng, count: usize) -> usize {
    ((u128::from(random.next_u64()) * count as u128) >> 64) as usize
}

/// A number between `low` and `high`, uniformly distributed.
pub(super) fn between(random: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * f64::from(random.next_u32()) / f64::from(u32::MAX)
}

/// A nearly normal number of mean 0 and variance 1: the sum of twelve uniform ones, minus 6.
pub(super) fn normal(random: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| between(random, [0.0, 1.0])).sum::<f64>() - 6.0
}
