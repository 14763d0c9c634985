//! Slow, smooth noise for whatever drifts in a living face.

use std::f64::consts::TAU;

use super::chance::Chance;

const WAVES: usize = 6;

/// A sum of sines with seeded frequencies and phases. Over a long time its mean is 0 and its
/// standard deviation about 1.
#[derive(Debug, Clone)]
pub(super) struct SlowNoise {
    /// Frequency in Hz and phase in turns.
    waves: [(f64, f64); WAVES],
}

impl SlowNoise {
    /// Frequencies lie between `low_hz` and `high_hz`, evenly on a logarithmic scale.
    pub(super) fn new(chance: &mut Chance, low_hz: f64, high_hz: f64) -> Self {
        let octaves = (high_hz / low_hz).ln() / WAVES as f64;
        let waves = std::array::from_fn(|k| {
            let place = k as f64 + chance.unit();
            (low_hz * (octaves * place).exp(), chance.unit())
        });
        SlowNoise { waves }
    }

    /// The value at `time_s`, between −2 and 2.
    pub(super) fn at(&self, time_s: f64) -> f64 {
        let wave = |(hz, phase): &(f64, f64)| (TAU * (hz * time_s + phase)).sin();
        let sum: f64 = self.waves.iter().map(wave).sum();
        let plain = (2.0 / WAVES as f64).sqrt() * sum;
        2.0 * (plain / 2.0).tanh()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_bounded_slow_and_of_deviation_one() {
        let noise = SlowNoise::new(&mut Chance::new(3, 9), 0.2, 1.0);
        let track: Vec<f64> = (0..60_000).map(|t| noise.at(t as f64 / 100.0)).collect();
        let mean = track.iter().sum::<f64>() / track.len() as f64;
        let power = track.iter().map(|x| x * x).sum::<f64>() / track.len() as f64;
        assert!(
            mean.abs() < 0.05 && (0.6..1.1).contains(&power),
            "{mean} {power}"
        );
        assert!(track.iter().all(|x| x.abs() < 2.0));
        let steepest = track
            .windows(2)
            .map(|w| (w[1] - w[0]).abs())
            .fold(0.0, f64::max);
        assert!(steepest < 0.15, "{steepest} in 10 ms");
    }
}
