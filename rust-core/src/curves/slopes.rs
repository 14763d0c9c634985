//! Finds the slopes of the handles. Both handles of a key share one slope, so that the curve has no
//! corner there when the key is moved.

use std::borrow::Cow;

use super::segment::Table;

/// Weight of the values' own slopes against the fit.
const NATURAL: f64 = 1e-3;

/// A key of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// The frame. The curve keeps its value exactly.
    pub row: usize,
    /// Slope of both its handles, per frame.
    pub slope: f64,
}

/// Keys in the order of their frames; the first and the last frame have one.
pub type Curve = Vec<Key>;

/// The slope at each frame: half the difference between the frames after and before it. At an end
/// it is the difference to the only neighbour.
pub fn natural(values: &[f64]) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    let slope = |at: usize| {
        let (a, b) = (at.saturating_sub(1), (at + 1).min(last));
        (values[b] - values[a]) / (b - a).max(1) as f64
    };
    (0..values.len()).map(slope).collect()
}

/// The curve with keys at `rows`. It gets more keys where one slope per key leaves a frame beyond
/// its limit.
pub fn through(values: &[f64], limits: &[f64], rows: &[usize]) -> Curve {
    let natural_slopes = natural(values);
    let mut rows = rows.to_vec();
    loop {
        let tables: Vec<_> = rows.windows(2).map(|p| Table::of(p[1] - p[0])).collect();
        let slopes = shared(values, limits, &rows, &tables, &natural_slopes);
        let more = worst(&rows, &excess(values, limits, &rows, &tables, &slopes));
        if more.is_empty() {
            let key = |(&row, &slope): (&usize, &f64)| Key { row, slope };
            return rows.iter().zip(&slopes).map(key).collect();
        }
        rows.extend(more);
        rows.sort_unstable();
    }
}

/// How far each frame is off, as a share of its limit.
fn excess(
    values: &[f64],
    limits: &[f64],
    rows: &[usize],
    tables: &[Cow<'_, Table>],
    slopes: &[f64],
) -> Vec<f64> {
    let mut off = vec![0.0; values.len()];
    for (number, table) in tables.iter().enumerate() {
        let (from, to) = (rows[number], rows[number + 1]);
        for at in 1..table.length {
            let ends = table.ends(at, values[from], values[to]);
            let moved = table.slopes(at, slopes[number], slopes[number + 1]);
            off[from + at] = (values[from + at] - ends - moved).abs() / limits[from + at];
        }
    }
    off
}

/// The frame with the largest error in each segment that exceeds a limit. Segments beside a worse
/// one are left out.
fn worst(rows: &[usize], excess: &[f64]) -> Vec<usize> {
    let by_excess = |a: &usize, b: &usize| excess[*a].total_cmp(&excess[*b]);
    let peak = |pair: &[usize]| (pair[0] + 1..pair[1]).max_by(by_excess);
    let peaks: Vec<Option<usize>> = rows.windows(2).map(peak).collect();
    let of = |number: Option<usize>| {
        let peak = number.and_then(|number| peaks.get(number).copied().flatten());
        peak.map_or(0.0, |at| excess[at])
    };
    let chosen = |(number, peak): (usize, &Option<usize>)| {
        let here = excess[(*peak)?];
        let most = here >= of(number.checked_sub(1)) && here >= of(Some(number + 1));
        (here > 1.0 && most).then_some((*peak)?)
    };
    peaks.iter().enumerate().filter_map(chosen).collect()
}

/// Fits one slope per key by least squares over all segments, which is a tridiagonal system.
fn shared(
    values: &[f64],
    limits: &[f64],
    rows: &[usize],
    tables: &[Cow<'_, Table>],
    natural_slopes: &[f64],
) -> Vec<f64> {
    let count = rows.len();
    let (mut diagonal, mut beside) = (vec![0.0; count], vec![0.0; count]);
    let mut right = vec![0.0; count];
    for (number, table) in tables.iter().enumerate() {
        let first = rows[number];
        let (from, to) = (values[first], values[first + table.length]);
        for at in 1..table.length {
            let [u, v] = table.of_slopes(at);
            let weight = limits[first + at].powi(-2);
            let rest = values[first + at] - table.ends(at, from, to);
            diagonal[number] += weight * u * u;
            diagonal[number + 1] += weight * v * v;
            beside[number] += weight * u * v;
            right[number] += weight * u * rest;
            right[number + 1] += weight * v * rest;
        }
    }
    let mean = diagonal.iter().sum::<f64>() / count.max(1) as f64;
    let pull = NATURAL * mean.max(f64::MIN_POSITIVE);
    for number in 0..count {
        diagonal[number] += pull;
        right[number] += pull * natural_slopes[rows[number]];
    }
    for number in 1..count {
        let share = beside[number - 1] / diagonal[number - 1];
        diagonal[number] -= share * beside[number - 1];
        right[number] -= share * right[number - 1];
    }
    let mut slopes = vec![0.0; count];
    for number in (0..count).rev() {
        let behind = slopes
            .get(number + 1)
            .map_or(0.0, |next| beside[number] * next);
        slopes[number] = (right[number] - behind) / diagonal[number];
    }
    slopes
}
