//! Where the lips meet: the valley between them, seen from the front.
//!
//! The patch is drawn into a grid of depths over the mouth's frame, with columns from corner to
//! corner. The further a place lies behind the mean of the places above and below it, the deeper a
//! valley it is. The cheapest path through the grid from one corner to the other (dynamic
//! programming) follows the valley, stays near the line of the inner-lip landmarks and does not
//! jump.

use glam::DVec3;

use super::patch::Patch;
use crate::{Error, Result};

/// Columns from corner to corner, both corners included.
const COLUMNS: usize = 49;
/// Height of a row, in widths of the mouth (0.2 mm).
const ROW: f64 = 0.004;
/// The valley lies no further than this from the landmarks' line, in rows (5 mm).
const RANGE: i64 = 24;
/// Distances of the places above and below, in rows (1.2, 2.4 and 4 mm).
const FLANKS: [i64; 3] = [6, 12, 20];
/// A valley this deep, in widths, outweighs one standard deviation from the landmarks' line.
const DEEP: f64 = 0.015;
/// A valley more than this many times deeper is a hole, not a gap between lips: more depth counts
/// no more.
const DEEPEST: f64 = 8.0;
/// Standard deviation of the seam from the landmarks' line, in rows: in the middle, and at the
/// corners.
const TRUST: [f64; 2] = [20.0, 2.0];
/// Standard deviation of a step between two columns, relative to the landmarks' line, in rows.
const STEP: f64 = 3.0;
/// In a pit the surface lies at least this far behind the lip, in widths of the mouth (8 mm).
/// Suzanne's pit lies 0.33 widths back. Lips that meet fall by 0.05 over the same number of rows.
const PIT: f64 = 0.15;
/// The floor of a pit begins this many rows beyond the lip (2 mm).
const CLIFF: i64 = 10;
/// The floor of a pit is this many rows high (3 mm).
const FLOOR: i64 = 15;
/// Triangles this near to the seam show its shape, in widths (4 mm).
const BESIDE: f64 = 0.08;
/// Edges up to the first length show how the halves of a seam differ. Edges longer than the second
/// length do not. In widths (3 and 8 mm).
const COARSE: [f64; 2] = [0.06, 0.16];
/// Passes of a binomial filter that smooths the line.
const SMOOTHING: usize = 12;

/// Height of the seam at each place from corner to corner.
pub(super) struct SeamLine {
    heights: Vec<f64>,
}

impl SeamLine {
    /// `inner`: landmarks 60 to 67 in the mouth's frame.
    ///
    /// # Errors
    /// `InvalidInput` where the lips are already apart, with a pit behind them.
    pub fn find(patch: &Patch, inner: &[DVec3; 8]) -> Result<SeamLine> {
        let expected: Vec<f64> = (0..COLUMNS).map(|c| drawn(inner, place(c))).collect();
        let depths = Depths::of(patch, &expected);
        if depths.are_a_pit() {
            return Err(Error::InvalidInput(
                "open mouth: expected lips that meet, got a pit whose lips are apart already: it opens as \
                 it is, and a cut would part its floor"
                    .into(),
            ));
        }
        let offsets = cheapest_way(&depths);
        let heights = expected.iter().zip(offsets);
        let mut heights: Vec<f64> = heights.map(|(h, rows)| h + ROW * rows as f64).collect();
        for _ in 0..SMOOTHING {
            let old = heights.clone();
            for c in 1..COLUMNS - 1 {
                heights[c] = 0.25 * old[c - 1] + 0.5 * old[c] + 0.25 * old[c + 1];
            }
        }
        let line = SeamLine { heights };
        let coarseness = line.coarseness(patch);
        Ok(line.evened(coarseness))
    }

    /// 0 where triangles along the seam are fine enough to show how its halves differ, 1 where they
    /// are too coarse.
    fn coarseness(&self, patch: &Patch) -> f64 {
        let corners = patch
            .triangles
            .iter()
            .map(|t| t.map(|v| patch.points[v as usize]));
        let along = corners.filter(|corners| corners.iter().any(|p| self.distance(*p) < BESIDE));
        let longest = |[a, b, c]: [DVec3; 3]| a.distance(b).max(b.distance(c)).max(c.distance(a));
        let mut edges: Vec<f64> = along.map(longest).collect();
        edges.sort_by(f64::total_cmp);
        let middle = edges.get(edges.len() / 2).copied().unwrap_or(COARSE[1]);
        ((middle - COARSE[0]) / (COARSE[1] - COARSE[0])).clamp(0.0, 1.0)
    }

    /// The line after this share of the difference between its halves is removed.
    fn evened(&self, share: f64) -> SeamLine {
        let mirrored = self.heights.iter().rev();
        let even = |(height, other): (&f64, &f64)| height + 0.5 * share * (other - height);
        SeamLine {
            heights: self.heights.iter().zip(mirrored).map(even).collect(),
        }
    }

    /// Height at a place: 0 is the right corner, 1 the left one. The line is level beyond them.
    pub fn height(&self, place: f64) -> f64 {
        let at = (place.clamp(0.0, 1.0) * (COLUMNS - 1) as f64).min((COLUMNS - 1) as f64 - 1e-9);
        let (first, rest) = (at as usize, at.fract());
        self.heights[first] * (1.0 - rest) + self.heights[first + 1] * rest
    }

    /// How far a point lies from the seam, seen from the front.
    pub fn distance(&self, point: DVec3) -> f64 {
        let beyond = (-point.x).max(point.x - 1.0).max(0.0);
        beyond.hypot(point.y - self.height(point.x))
    }
}

fn place(column: usize) -> f64 {
    column as f64 / (COLUMNS - 1) as f64
}

/// Height of the line through the corners and the middles of the inner pairs of landmarks.
fn drawn(inner: &[DVec3; 8], place: f64) -> f64 {
    let middle = |a: usize, b: usize| [0, 1].map(|i| 0.5 * (inner[a][i] + inner[b][i]));
    let mut knots = vec![[0.0, inner[0][1]]];
    for knot in [middle(1, 7), middle(2, 6), middle(3, 5)] {
        if knot[0] > knots[knots.len() - 1][0] + 0.05 && knot[0] < 0.95 {
            knots.push(knot);
        }
    }
    knots.push([1.0, inner[4][1]]);
    let after = knots.partition_point(|knot| knot[0] < place);
    let after = after.clamp(1, knots.len() - 1);
    let ([x0, y0], [x1, y1]) = (knots[after - 1], knots[after]);
    y0 + (y1 - y0) * ((place - x0) / (x1 - x0)).clamp(0.0, 1.0)
}

/// Depth of the foremost surface. Rows count from the expected line of each column.
struct Depths {
    /// `[COLUMNS, ROWS]`, positive out of the face; minus infinity where there is no surface.
    values: Vec<f64>,
}

/// Rows that a column holds on either side of the expected line.
const HALF: i64 = RANGE + FLANKS[2];
const ROWS: usize = 2 * HALF as usize + 1;

impl Depths {
    fn of(patch: &Patch, expected: &[f64]) -> Depths {
        let mut depths = Depths {
            values: vec![f64::NEG_INFINITY; COLUMNS * ROWS],
        };
        for t in &patch.triangles {
            depths.draw(t.map(|v| patch.points[v as usize]), expected);
        }
        depths
    }

    /// Draws a triangle where it lies in front of the others.
    fn draw(&mut self, [a, b, c]: [DVec3; 3], expected: &[f64]) {
        let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if twice.abs() < 1e-12 {
            return;
        }
        let (low, high) = range([a[0], b[0], c[0]]);
        let scale = (COLUMNS - 1) as f64;
        let first = (low * scale).ceil().max(0.0) as usize;
        let last = (high * scale).floor().min(scale);
        for column in first..COLUMNS {
            if column as f64 > last {
                break;
            }
            let (low, high) = range([a[1], b[1], c[1]].map(|y| (y - expected[column]) / ROW));
            let rows = (low.ceil() as i64).max(-HALF)..=(high.floor() as i64).min(HALF);
            for row in rows {
                let (x, y) = (place(column), expected[column] + ROW * row as f64);
                let v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / twice;
                let w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / twice;
                if v >= -1e-9 && w >= -1e-9 && v + w <= 1.0 + 1e-9 {
                    let slot = &mut self.values[column * ROWS + (row + HALF) as usize];
                    *slot = slot.max((1.0 - v - w) * a[2] + v * b[2] + w * c[2]);
                }
            }
        }
    }

    fn at(&self, column: usize, row: i64) -> f64 {
        self.values[column * ROWS + (row + HALF) as usize]
    }

    /// How far a place lies behind its neighbours. 0 where it does not, or where they are unknown.
    fn valley(&self, column: usize, row: i64) -> f64 {
        let here = self.at(column, row);
        let behind = |away: i64| {
            let beside = 0.5 * (self.at(column, row + away) + self.at(column, row - away));
            beside - here
        };
        let known = FLANKS.map(behind).into_iter().filter(|v| v.is_finite());
        known.fold(0.0, f64::max)
    }
}

impl Depths {
    /// Whether most columns of the middle half show a floor far behind a lip.
    fn are_a_pit(&self) -> bool {
        let middle = COLUMNS / 4..3 * COLUMNS / 4;
        let (all, pits) = (middle.len(), middle.filter(|c| self.has_floor(*c)).count());
        2 * pits > all
    }

    /// Whether a column shows a floor far behind the lip below or above it.
    fn has_floor(&self, column: usize) -> bool {
        let lies_back = |lip: i64, way: i64| {
            let edge = self.at(column, lip);
            (CLIFF..=CLIFF + FLOOR).all(|away| {
                let row = lip + way * away;
                let here = if row.abs() <= HALF {
                    self.at(column, row)
                } else {
                    f64::NAN
                };
                here.is_finite() && edge - here > PIT
            })
        };
        (-HALF..=HALF).any(|lip| lies_back(lip, 1) || lies_back(lip, -1))
    }
}

fn range(values: [f64; 3]) -> (f64, f64) {
    let low = values.into_iter().fold(f64::INFINITY, f64::min);
    (low, values.into_iter().fold(f64::NEG_INFINITY, f64::max))
}

/// The cheapest path: for each column its distance from the expected line, in rows.
fn cheapest_way(depths: &Depths) -> Vec<i64> {
    let rows = (2 * RANGE + 1) as usize;
    let cost_of = |column: usize, row: usize| -> f64 {
        let offset = row as i64 - RANGE;
        let inward = 2.0 * place(column).min(1.0 - place(column));
        let trust = TRUST[1] + (TRUST[0] - TRUST[1]) * inward.min(0.5) / 0.5;
        (offset as f64 / trust).powi(2) - (depths.valley(column, offset) / DEEP).min(DEEPEST)
    };
    let mut costs: Vec<f64> = (0..rows).map(|row| cost_of(0, row)).collect();
    let mut came_from: Vec<Vec<usize>> = Vec::new();
    for column in 1..COLUMNS {
        let best = |row: usize| -> (f64, usize) {
            let reach = row.saturating_sub(6)..=(row + 6).min(rows - 1);
            let through = |from: usize| {
                let step = (row as f64 - from as f64) / STEP;
                (costs[from] + step * step, from)
            };
            let ways = reach.map(through);
            ways.min_by(|a, b| a.0.total_cmp(&b.0))
                .expect("its own row is in reach")
        };
        let cheapest: Vec<(f64, usize)> = (0..rows).map(best).collect();
        let next = cheapest.iter().enumerate();
        let next = next
            .map(|(row, (cost, _))| cost + cost_of(column, row))
            .collect();
        came_from.push(cheapest.into_iter().map(|(_, from)| from).collect());
        costs = next;
    }
    let end = (0..rows).min_by(|&a, &b| costs[a].total_cmp(&costs[b]));
    let mut row = end.expect("there are rows");
    let mut way = vec![row as i64 - RANGE];
    for from in came_from.iter().rev() {
        row = from[row];
        way.push(row as i64 - RANGE);
    }
    way.reverse();
    way
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet wider than the mouth with a groove of the given depth at `height(x)`, in widths.
    fn grooved(height: impl Fn(f64) -> f64, depth: f64) -> Patch {
        let (columns, rows) = (81u32, 81u32);
        let mut patch = Patch {
            faces: Vec::new(),
            triangles: Vec::new(),
            points: Vec::new(),
        };
        for (row, column) in (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c))) {
            let x = f64::from(column) / 40.0 - 0.5;
            let y = f64::from(row) * 0.01 - 0.4;
            let away = (y - height(x)) / 0.04;
            let point = DVec3::new(x, y, -depth * (-away * away).exp());
            patch.points.push(point);
        }
        for (row, column) in (0..rows - 1).flat_map(|r| (0..columns - 1).map(move |c| (r, c))) {
            let a = row * columns + column;
            patch.triangles.extend([
                [a, a + 1, a + columns],
                [a + 1, a + columns + 1, a + columns],
            ]);
        }
        patch.faces = (0..patch.triangles.len() as u32).collect();
        patch
    }

    fn level_landmarks() -> [DVec3; 8] {
        let x = [0.0, 0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25];
        x.map(|x| DVec3::X * x)
    }

    #[test]
    fn the_line_follows_a_valley_beside_the_landmarks() {
        let bow = |x: f64| 0.04 * (std::f64::consts::PI * x).sin();
        let line = SeamLine::find(&grooved(bow, 0.06), &level_landmarks()).unwrap();
        for place in [0.2, 0.35, 0.5, 0.65, 0.8] {
            let got = line.height(place);
            assert!(
                (got - bow(place)).abs() < 0.01,
                "{place}: {got}, {}",
                bow(place)
            );
        }
        assert!(line.height(0.0).abs() < 0.01 && line.height(1.0).abs() < 0.01);
    }

    #[test]
    fn without_a_valley_it_is_the_line_of_the_landmarks() {
        let mut inner = level_landmarks();
        inner[2][1] = 0.05;
        inner[6][1] = 0.03;
        let line = SeamLine::find(&grooved(|_| 0.0, 0.0), &inner).unwrap();
        assert!(
            (line.height(0.5) - 0.04).abs() < 0.012,
            "{}",
            line.height(0.5)
        );
        assert!(line.height(0.02).abs() < 0.006);
    }

    #[test]
    fn a_symmetric_groove_gives_a_symmetric_line() {
        let line = SeamLine::find(
            &grooved(|x| 0.03 * (x - 0.5).abs(), 0.05),
            &level_landmarks(),
        )
        .unwrap();
        for place in [0.05, 0.2, 0.4] {
            let [a, b] = [place, 1.0 - place].map(|x| line.height(x));
            assert!((a - b).abs() < 0.5 * ROW, "{a} {b}");
        }
    }

    #[test]
    fn a_pit_is_no_seam_and_a_deep_groove_is() {
        let mut pit = grooved(|_| 0.0, 0.0);
        for p in &mut pit.points {
            p[2] = if (-0.05..0.12).contains(&p[1]) {
                -0.3
            } else {
                0.0
            };
        }
        let error = SeamLine::find(&pit, &level_landmarks()).err().unwrap();
        assert!(error.to_string().contains("got a pit"), "{error}");
        assert!(SeamLine::find(&grooved(|_| 0.0, 0.2), &level_landmarks()).is_ok());
    }
}
