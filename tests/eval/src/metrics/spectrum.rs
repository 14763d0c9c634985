//! How fast a curve moves: its power at each frequency.

use std::f64::consts::{PI, TAU};

/// One-sided power density, averaged over segments (Welch 1967).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Spectrum {
    /// Distance between neighbouring bins, Hz.
    pub step_hz: f64,
    /// `[bins]`, the curve's unit squared per Hz, summed over segments.
    sums: Vec<f64>,
    segments: f64,
}

impl Spectrum {
    /// The spectrum of a curve at `fps`, in segments of `length` values that overlap by half.
    ///
    /// Each segment loses its mean and gets a Hann window. A curve shorter than `length` is one
    /// segment, padded with zeros.
    pub fn of(curve: &[f64], fps: f64, length: usize) -> Self {
        let mut out = Spectrum {
            step_hz: fps / length as f64,
            sums: vec![0.0; length / 2 + 1],
            segments: 0.0,
        };
        let mut start = 0;
        while start == 0 || start + length <= curve.len() {
            out.add_segment(&curve[start..curve.len().min(start + length)], fps, length);
            start += length / 2;
        }
        out
    }

    fn add_segment(&mut self, values: &[f64], fps: f64, length: usize) {
        let count = values.len();
        if count == 0 {
            return;
        }
        let mean = values.iter().sum::<f64>() / count as f64;
        let window = |t: usize| (PI * (t as f64 + 0.5) / count as f64).sin().powi(2);
        let power: f64 = (0..count).map(|t| window(t).powi(2)).sum();
        for (bin, sum) in self.sums.iter_mut().enumerate() {
            let (mut re, mut im) = (0.0, 0.0);
            for (t, value) in values.iter().enumerate() {
                let angle = TAU * (bin * t % length) as f64 / length as f64;
                let x = (value - mean) * window(t);
                re += x * angle.cos();
                im += x * angle.sin();
            }
            let sides = if bin == 0 || 2 * bin == length {
                1.0
            } else {
                2.0
            };
            *sum += sides * (re * re + im * im) / (fps * power);
        }
        self.segments += 1.0;
    }

    /// Adds another curve's spectrum, which must have the same bins.
    pub fn add(&mut self, other: &Spectrum) {
        self.step_hz = other.step_hz;
        self.sums.resize(other.sums.len(), 0.0);
        for (sum, more) in self.sums.iter_mut().zip(&other.sums) {
            *sum += more;
        }
        self.segments += other.segments;
    }

    /// Power density at every bin, the curve's unit squared per Hz.
    pub fn density(&self) -> Vec<f64> {
        let mean = |sum: &f64| sum / self.segments.max(1.0);
        self.sums.iter().map(mean).collect()
    }

    /// Power from `low` up to but not including `high` Hz, the curve's unit squared.
    pub fn band(&self, low: f64, high: f64) -> f64 {
        let bins = self.density().into_iter().enumerate();
        let inside = bins.filter(|(bin, _)| (low..high).contains(&(*bin as f64 * self.step_hz)));
        inside.map(|(_, density)| density * self.step_hz).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(hertz: f64, fps: f64, count: usize) -> Vec<f64> {
        (0..count)
            .map(|t| 5.0 + 2.0 * (TAU * hertz * t as f64 / fps).sin())
            .collect()
    }

    #[test]
    fn a_wave_lies_in_its_band_with_the_power_of_its_amplitude() {
        let spectrum = Spectrum::of(&wave(4.2, 25.0, 500), 25.0, 64);
        assert!((spectrum.band(3.0, 6.0) - 2.0).abs() < 0.05);
        assert!(spectrum.band(6.0, 13.0) < 0.01 && spectrum.band(0.0, 2.5) < 0.01);
    }

    #[test]
    fn the_frame_rate_does_not_matter_to_the_power() {
        let at = |fps: f64| Spectrum::of(&wave(4.2, fps, 500), fps, 64).band(3.0, 6.0);
        assert!((at(25.0) - at(30.0)).abs() < 0.05);
    }

    #[test]
    fn curves_are_averaged_and_constants_have_none() {
        let mut both = Spectrum::of(&wave(4.2, 25.0, 64), 25.0, 64);
        let alone = both.band(3.0, 6.0);
        both.add(&Spectrum::of(&[3.0; 64], 25.0, 64));
        assert!((both.band(3.0, 6.0) - 0.5 * alone).abs() < 1e-9);
        assert_eq!(Spectrum::of(&[], 25.0, 64).band(0.0, 12.0), 0.0);
    }
}
