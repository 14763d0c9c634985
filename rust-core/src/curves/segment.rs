//! A Bézier segment between two keys, evaluated as in animation tools: the frame determines the
//! parameter, and the parameter determines the value.

use std::{borrow::Cow, sync::LazyLock};

/// How far handles reach, as a share of the way to the next key. Automatic handles in animation
/// tools reach about as far. At a third, the equation for the parameter would lose its cubic term,
/// and solvers in single precision would fail.
pub const REACH: f64 = 0.39;
/// The longest segment that is fitted, frames.
pub const LONGEST: usize = 64;
/// Weight of the values' own slopes against the fit.
const NATURAL: f64 = 1e-3;

/// How much keys and slopes contribute to each frame of a segment of `length` frames.
#[derive(Clone)]
pub struct Table {
    pub length: usize,
    /// By frame: the weights of the first key's value, of its slope and of the second key's slope.
    shares: Vec<[f64; 3]>,
}

/// Tables of all lengths that are fitted, because a take needs each of them thousands of times.
static TABLES: LazyLock<Vec<Table>> = LazyLock::new(|| (0..=LONGEST).map(Table::new).collect());

impl Table {
    /// The table of a length.
    pub fn of(length: usize) -> Cow<'static, Table> {
        match TABLES.get(length) {
            Some(table) => Cow::Borrowed(table),
            None => Cow::Owned(Table::new(length)),
        }
    }

    fn new(length: usize) -> Self {
        let reach = REACH * length as f64;
        let share = |at: usize| {
            let t = parameter(at as f64 / length.max(1) as f64);
            let u = 1.0 - t;
            let (first, second) = (3.0 * u * u * t, 3.0 * u * t * t);
            [u * u * u + first, reach * first, -reach * second]
        };
        let shares = (0..=length).map(share).collect();
        Table { length, shares }
    }

    /// The part of the value at a frame that comes from the values of the keys.
    pub fn ends(&self, at: usize, from: f64, to: f64) -> f64 {
        to + self.shares[at][0] * (from - to)
    }

    /// The part that comes from the slopes.
    pub fn slopes(&self, at: usize, from: f64, to: f64) -> f64 {
        self.shares[at][1] * from + self.shares[at][2] * to
    }

    /// The weights of both slopes at a frame.
    pub fn of_slopes(&self, at: usize) -> [f64; 2] {
        [self.shares[at][1], self.shares[at][2]]
    }

    /// Fits both slopes to `values` `[length + 1]` and returns the largest error, as a share of
    /// `limits`. Slopes that the values leave open stay near `natural`. The length is at most
    /// [`LONGEST`].
    pub fn excess(&self, values: &[f64], limits: &[f64], natural: [f64; 2]) -> f64 {
        let (first, last) = (values[0], values[self.length]);
        let (mut gram, mut right) = ([0.0; 3], [0.0; 2]);
        // Errors are in units of the limits, so that frames with tighter limits count more.
        let mut rows = [[0.0; 3]; LONGEST];
        let inner = 1..self.length;
        let frames = self.shares[inner.clone()]
            .iter()
            .zip(&values[inner.clone()]);
        let frames = frames.zip(&limits[inner]);
        for (row, ((share, value), limit)) in rows.iter_mut().zip(frames) {
            let unit = 1.0 / limit;
            let rest = value - (last + share[0] * (first - last));
            let [u, v, rest] = [unit * share[1], unit * share[2], unit * rest];
            gram[0] += u * u;
            gram[1] += u * v;
            gram[2] += v * v;
            right[0] += u * rest;
            right[1] += v * rest;
            *row = [u, v, rest];
        }
        let [from, to] = solve(gram, right, natural);
        let error = |&[u, v, rest]: &[f64; 3]| (rest - u * from - v * to).abs();
        let rows = &rows[..self.length.saturating_sub(1)];
        rows.iter().map(error).fold(0.0, f64::max)
    }
}

/// Solves for both slopes, and pulls them a little towards the `natural` ones.
fn solve(gram: [f64; 3], right: [f64; 2], natural: [f64; 2]) -> [f64; 2] {
    let pull = NATURAL * (gram[0] + gram[2]);
    if pull <= 0.0 {
        return natural;
    }
    let (a, b, c) = (gram[0] + pull, gram[1], gram[2] + pull);
    let (p, q) = (right[0] + pull * natural[0], right[1] + pull * natural[1]);
    let determinant = a * c - b * b;
    [(c * p - b * q) / determinant, (a * q - b * p) / determinant]
}

/// The parameter at which a segment has passed this share of its frames, by Newton's method.
fn parameter(share: f64) -> f64 {
    let mut t = share;
    for _ in 0..20 {
        let u = 1.0 - t;
        let x = 3.0 * u * u * t * REACH + 3.0 * u * t * t * (1.0 - REACH) + t * t * t;
        let speed = 3.0 * u * u * REACH + 6.0 * u * t * (1.0 - 2.0 * REACH) + 3.0 * t * t * REACH;
        t = (t - (x - share) / speed).clamp(0.0, 1.0);
    }
    t
}
