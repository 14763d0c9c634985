//! Activation functions as plain loops that the compiler vectorises.
//!
//! `pulp` picks the widest instruction set at run time. The approximations use only `+ − × ÷`,
//! clamping and bit operations. Their errors against double precision are measured in the tests
//! below.

/// Runs a loop compiled for the widest instructions that the CPU has.
#[inline(always)]
pub(crate) fn vectorised<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}

/// `tanh x` as a rational function of degree 13 over 6; absolute error below 1e-6.
#[inline(always)]
pub fn tanh(x: f32) -> f32 {
    // Beyond this the result rounds to ±1.
    let x = x.clamp(-7.905_311, 7.905_311);
    let s = x * x;
    let p = -2.760_768_5e-16;
    let p = p * s + 2.000_188e-13;
    let p = p * s - 8.604_672e-11;
    let p = p * s + 5.122_297e-8;
    let p = p * s + 1.485_722_4e-5;
    let p = p * s + 6.372_619e-4;
    let p = p * s + 4.893_524_6e-3;
    let q = 1.198_258_4e-6;
    let q = q * s + 1.185_347_1e-4;
    let q = q * s + 2.268_434_6e-3;
    let q = q * s + 4.893_525e-3;
    x * p / q
}

/// The error function as a rational function of degree 13 over 8; absolute error below 1e-6.
#[inline(always)]
pub fn erf(x: f32) -> f32 {
    let x = x.clamp(-4.0, 4.0);
    let s = x * x;
    let p = -2.726_142_3e-10;
    let p = p * s + 2.770_681_4e-8;
    let p = p * s - 2.101_024e-6;
    let p = p * s - 5.692_506_4e-5;
    let p = p * s - 7.349_906_3e-4;
    let p = p * s - 2.954_6e-3;
    let p = p * s - 1.609_603_3e-2;
    let q = -1.456_607_2e-5;
    let q = q * s - 2.133_740_6e-4;
    let q = q * s - 1.682_827e-3;
    let q = q * s - 7.373_329e-3;
    let q = q * s - 1.426_473_9e-2;
    x * p / q
}

/// `eˣ` with a relative error below 1e-6; `x` is clamped to −87 to 88.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    let x = x.clamp(-87.0, 88.0);
    // Adding and subtracting 1.5 · 2²³ gives the integer n nearest to x / ln 2: the sum's last bits
    // are n. This avoids a conversion, which would keep a loop from being vectorised.
    let magic = 12_582_912.0f32;
    let sum = x * std::f32::consts::LOG2_E + magic;
    let n = sum - magic;
    let r = x - n * 0.693_359_4 + n * 2.121_944_4e-4;
    let p = 1.987_569_1e-4;
    let p = p * r + 1.398_199_9e-3;
    let p = p * r + 8.333_452e-3;
    let p = p * r + 4.166_579_6e-2;
    let p = p * r + 1.666_666_5e-1;
    let p = p * r + 0.5;
    let p = p * r * r + r + 1.0;
    let exponent = sum.to_bits().wrapping_sub(magic.to_bits() - 127);
    p * f32::from_bits(exponent << 23)
}

/// Exact GELU, `x/2 · (1 + erf(x/√2))`, Hendrycks & Gimpel 2016.
#[inline(always)]
pub fn gelu(x: f32) -> f32 {
    0.5 * x * (1.0 + erf(x * std::f32::consts::FRAC_1_SQRT_2))
}

/// `1 / (1 + e⁻ˣ)`: the probability of a logit, with the standard library's exponential.
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// `x / (1 + e⁻ˣ)`, also called swish.
#[inline(always)]
pub fn silu(x: f32) -> f32 {
    x / (1.0 + exp(-x))
}

/// GELU of every value, in place.
pub fn gelu_all(values: &mut [f32]) {
    vectorised(
        #[inline(always)]
        || values.iter_mut().for_each(|x| *x = gelu(*x)),
    );
}

/// SiLU of every value, in place.
pub fn silu_all(values: &mut [f32]) {
    vectorised(
        #[inline(always)]
        || values.iter_mut().for_each(|x| *x = silu(*x)),
    );
}

/// Multiplies `slopes` by the slopes of SiLU at `x`, of equal length.
pub fn silu_slopes(slopes: &mut [f32], x: &[f32]) {
    assert_eq!(slopes.len(), x.len());
    vectorised(
        #[inline(always)]
        || {
            for (slope, x) in slopes.iter_mut().zip(x) {
                let share = 1.0 / (1.0 + exp(-x));
                *slope *= share * (1.0 + x * (1.0 - share));
            }
        },
    );
}

/// `max(x, 0)` of every value, in place.
pub fn relu_all(values: &mut [f32]) {
    vectorised(
        #[inline(always)]
        || values.iter_mut().for_each(|x| *x = x.max(0.0)),
    );
}

/// `values += other`, of equal length.
pub fn add_all(values: &mut [f32], other: &[f32]) {
    assert_eq!(values.len(), other.len());
    vectorised(
        #[inline(always)]
        || {
            for (x, y) in values.iter_mut().zip(other) {
                *x += y;
            }
        },
    );
}

/// Adds `row` to every row of row-major `values`.
pub fn add_to_rows(values: &mut [f32], row: &[f32]) {
    vectorised(
        #[inline(always)]
        || {
            for chunk in values.chunks_exact_mut(row.len()) {
                for (x, y) in chunk.iter_mut().zip(row) {
                    *x += y;
                }
            }
        },
    );
}

/// Softmax of one row, in place; `−∞` gets the weight 0.
///
/// A row of only `−∞` would become NaN, so callers give every row at least one finite value.
pub fn softmax(row: &mut [f32]) {
    vectorised(
        #[inline(always)]
        || {
            let largest = largest_of(row);
            for x in row.iter_mut() {
                let weight = if *x == f32::NEG_INFINITY { 0.0 } else { 1.0 };
                *x = exp(*x - largest) * weight;
            }
            let scale = 1.0 / sum_of(row, |x| x);
            row.iter_mut().for_each(|x| *x *= scale);
        },
    );
}

/// `Σ f(x)` in 16 independent lanes: the loop vectorises and always sums in the same order.
#[inline(always)]
pub(crate) fn sum_of(row: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let mut sums = [0.0f32; 16];
    let chunks = row.chunks_exact(16);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (sum, x) in sums.iter_mut().zip(chunk) {
            *sum += f(*x);
        }
    }
    sums.iter().sum::<f32>() + rest.iter().map(|x| f(*x)).sum::<f32>()
}

#[inline(always)]
fn largest_of(row: &[f32]) -> f32 {
    let mut largest = [f32::NEG_INFINITY; 16];
    let chunks = row.chunks_exact(16);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (lane, x) in largest.iter_mut().zip(chunk) {
            *lane = if *x > *lane { *x } else { *lane };
        }
    }
    let all = largest.iter().chain(rest);
    all.fold(f32::NEG_INFINITY, |a, b| a.max(*b))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> impl Iterator<Item = f32> {
        (-200_000..=200_000).map(|i| i as f32 * 1e-4)
    }

    /// The Maclaurin series for small arguments, the continued fraction for large ones.
    fn erf_f64(x: f64) -> f64 {
        if x.abs() > 3.0 {
            let mut fraction = 0.0;
            for k in (1..60).rev() {
                fraction = f64::from(k) / 2.0 / (x.abs() + fraction);
            }
            let tail = (-x * x).exp() / ((x.abs() + fraction) * std::f64::consts::PI.sqrt());
            return x.signum() * (1.0 - tail);
        }
        let (mut term, mut sum) = (x, x);
        for n in 1..80 {
            term *= -x * x / f64::from(n);
            sum += term / f64::from(2 * n + 1);
        }
        sum * std::f64::consts::FRAC_2_SQRT_PI
    }

    #[test]
    fn tanh_is_within_one_millionth() {
        let worst = grid().map(|x| (f64::from(tanh(x)) - f64::from(x).tanh()).abs());
        assert!(worst.fold(0.0, f64::max) < 1e-6);
    }

    #[test]
    fn erf_and_gelu_are_within_one_millionth() {
        let worst = grid().map(|x| (f64::from(erf(x)) - erf_f64(f64::from(x))).abs());
        assert!(worst.fold(0.0, f64::max) < 1e-6);
        let worst = grid().map(|x| {
            let x64 = f64::from(x);
            let exact = 0.5 * x64 * (1.0 + erf_f64(x64 * std::f64::consts::FRAC_1_SQRT_2));
            (f64::from(gelu(x)) - exact).abs() / (1.0 + x64.abs())
        });
        assert!(worst.fold(0.0, f64::max) < 1e-6);
    }

    #[test]
    fn exp_is_within_one_millionth_relative() {
        let worst = grid().map(|x| (f64::from(exp(x)) / f64::from(x).exp() - 1.0).abs());
        assert!(worst.fold(0.0, f64::max) < 1e-6);
        assert!(exp(-1000.0) < 1e-37);
    }

    #[test]
    fn softmax_sums_to_one_and_ignores_minus_infinity() {
        let mut row: Vec<f32> = (0..37).map(|i| (i as f32 * 0.7).sin() * 20.0).collect();
        row[5] = f32::NEG_INFINITY;
        softmax(&mut row);
        assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert_eq!(row[5], 0.0);
    }

    #[test]
    fn silu_matches_its_formula() {
        for x in [-90.0f32, -20.0, -1.0, 0.0, 0.5, 30.0, 90.0] {
            let exact = f64::from(x) / (1.0 + (-f64::from(x)).exp());
            assert!((f64::from(silu(x)) - exact).abs() < 1e-5, "{x}");
        }
    }
}
