//! Gaussian noise that is the same on every platform and for every number of threads.

use ndarray::{Array2, s};
use rand_chacha::{
    ChaCha8Rng,
    rand_core::{RngCore, SeedableRng},
};

/// Standard normal noise `[T, C]` for the frames `first_frame..first_frame + frames`.
///
/// Each frame has its own ChaCha stream, so its noise depends only on `seed` and its number:
/// windows that overlap start from the same noise in the overlap. Box–Muller uses `+ − × ÷ √` only,
/// which IEEE 754 rounds alike everywhere. The system's `ln` and `cos` are not so exact.
pub fn frame_noise(seed: u64, first_frame: usize, frames: usize, channels: usize) -> Array2<f32> {
    let mut noise = Array2::zeros((frames, channels));
    for (index, mut row) in noise.rows_mut().into_iter().enumerate() {
        let mut stream = ChaCha8Rng::seed_from_u64(seed);
        stream.set_stream((first_frame + index) as u64);
        let row = row.as_slice_mut().expect("rows of a new array");
        for pair in row.chunks_mut(2) {
            let both = normal_pair(stream.next_u64(), stream.next_u64());
            pair.copy_from_slice(&both[..pair.len()]);
        }
    }
    noise
}

/// Standard normal noise `[T, C]` whose frames resemble their neighbours: [`frame_noise`] smoothed
/// over `sigma_frames` (standard deviation) and scaled back to its variance. Like [`frame_noise`],
/// it depends only on the seed and the number of the frame. A `sigma_frames` of 0 smooths nothing.
///
/// White noise makes a network tremble: takes with different seeds then differ from frame to frame,
/// but not in how something is said.
pub fn slow_noise(
    seed: u64,
    first_frame: usize,
    frames: usize,
    channels: usize,
    sigma_frames: f64,
) -> Array2<f32> {
    // (1 − x²)³ on [−R, R] has the standard deviation R / 3 and needs no exponential, which systems round differently.
    let reach = (3.0 * sigma_frames) as usize;
    if reach == 0 {
        return frame_noise(seed, first_frame, frames, channels);
    }
    let weight = |i: usize| {
        let x = (i as f64 - reach as f64) / (reach + 1) as f64;
        (1.0 - x * x).powi(3)
    };
    let weights: Vec<f64> = (0..=2 * reach).map(weight).collect();
    let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
    let white = frame_noise(seed, first_frame, frames + 2 * reach, channels);
    Array2::from_shape_fn((frames, channels), |(t, c)| {
        let near = weights.iter().zip(white.slice(s![t.., c]));
        (near.map(|(w, x)| w * f64::from(*x)).sum::<f64>() / norm) as f32
    })
}

/// Two independent standard normal numbers from 128 random bits, Box & Muller 1958.
fn normal_pair(a: u64, b: u64) -> [f32; 2] {
    let unit = |bits: u64| ((bits >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
    let radius = (-2.0 * ln(unit(a))).sqrt();
    let (sin, cos) = sin_cos_turns(unit(b));
    [(radius * cos) as f32, (radius * sin) as f32]
}

/// `ln x` for normal positive `x`: `x = m 2^e`, `ln m = 2 atanh((m−1)/(m+1))` as a series.
fn ln(x: f64) -> f64 {
    let bits = x.to_bits();
    let mut exponent = (bits >> 52) as i64 - 1023;
    let mut mantissa = f64::from_bits(bits & 0x000f_ffff_ffff_ffff | 0x3ff0_0000_0000_0000);
    if mantissa > std::f64::consts::SQRT_2 {
        mantissa *= 0.5;
        exponent += 1;
    }
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let square = s * s;
    let mut series = 0.0;
    for k in (0..12).rev() {
        series = series * square + 1.0 / f64::from(2 * k + 1);
    }
    2.0 * s * series + exponent as f64 * std::f64::consts::LN_2
}

/// Sine and cosine of `turns` whole turns, `turns` in [0, 1).
fn sin_cos_turns(turns: f64) -> (f64, f64) {
    let quarter = (turns * 4.0 + 0.5) as u32;
    let angle = (turns - f64::from(quarter) * 0.25) * std::f64::consts::TAU;
    let square = angle * angle;
    let (mut sin, mut cos) = (0.0, 0.0);
    for k in (0..9).rev() {
        let k = f64::from(k);
        sin = 1.0 - square / ((2.0 * k + 2.0) * (2.0 * k + 3.0)) * sin;
        cos = 1.0 - square / ((2.0 * k + 1.0) * (2.0 * k + 2.0)) * cos;
    }
    sin *= angle;
    match quarter % 4 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elementary_functions_match_the_system() {
        for i in 1..2000 {
            let x = f64::from(i) / 2000.0;
            assert!((ln(x) - x.ln()).abs() < 1e-13);
            assert!((ln(x * 1e-15) - (x * 1e-15).ln()).abs() < 1e-13);
            let (sin, cos) = sin_cos_turns(x);
            let angle = x * std::f64::consts::TAU;
            assert!((sin - angle.sin()).abs() < 1e-13 && (cos - angle.cos()).abs() < 1e-13);
        }
    }

    #[test]
    fn noise_is_standard_normal() {
        let noise = frame_noise(1, 0, 2000, 204);
        let count = noise.len() as f64;
        let moment =
            |power: i32| noise.iter().map(|x| f64::from(*x).powi(power)).sum::<f64>() / count;
        assert!(moment(1).abs() < 0.005);
        assert!((moment(2) - 1.0).abs() < 0.01);
        assert!(moment(3).abs() < 0.02);
        assert!((moment(4) - 3.0).abs() < 0.05);
    }

    #[test]
    fn slow_noise_has_unit_variance_and_neighbours_that_resemble() {
        let noise = slow_noise(1, 0, 4000, 60, 6.0);
        let mean = |of: &dyn Fn(usize, usize) -> f32| {
            let all = (0..3900).flat_map(|t| (0..60).map(move |c| (t, c)));
            all.map(|(t, c)| f64::from(of(t, c))).sum::<f64>() / (3900.0 * 60.0)
        };
        assert!((mean(&|t, c| noise[[t, c]].powi(2)) - 1.0).abs() < 0.03);
        assert!(mean(&|t, c| noise[[t, c]] * noise[[t + 1, c]]) > 0.95);
        assert!(mean(&|t, c| noise[[t, c]] * noise[[t + 40, c]]).abs() < 0.03);
        let part = slow_noise(1, 12, 3, 60, 6.0);
        assert_eq!(noise.slice(s![12..15, ..]), part);
        assert_eq!(slow_noise(1, 5, 2, 3, 0.0), frame_noise(1, 5, 2, 3));
    }

    #[test]
    fn a_frame_depends_on_seed_and_number_alone() {
        let whole = frame_noise(7, 0, 20, 9);
        let part = frame_noise(7, 12, 3, 9);
        assert_eq!(whole.slice(s![12..15, ..]), part);
        assert_ne!(frame_noise(8, 0, 20, 9), whole);
        assert_ne!(whole.row(0), whole.row(1));
    }

    #[test]
    fn known_numbers_hold_on_every_platform() {
        let noise = frame_noise(0, 0, 1, 4);
        let bits: Vec<u32> = noise.iter().map(|x| x.to_bits()).collect();
        assert_eq!(bits, KNOWN, "{noise}");
    }

    /// Output of this code on x86-64. Another platform must agree.
    const KNOWN: [u32; 4] = [3209653765, 1043623141, 1061767946, 1050666351];
}
