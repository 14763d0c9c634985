//! Seeded random numbers that are the same on every platform.

use rand_chacha::{
    ChaCha8Rng,
    rand_core::{RngCore, SeedableRng},
};

/// A stream of uniform random numbers.
pub(super) struct Chance(ChaCha8Rng);

impl Chance {
    /// Streams with different numbers are independent of one another.
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream);
        Chance(generator)
    }

    /// Uniform in 0 (included) to 1 (excluded).
    pub(super) fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform between two numbers.
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// The median of five uniform numbers, Beta(3, 3): a bell in 0 to 1 with mean 1/2.
    pub(super) fn bell(&mut self) -> f64 {
        let mut five: [f64; 5] = std::array::from_fn(|_| self.unit());
        five.sort_by(f64::total_cmp);
        five[2]
    }
}
