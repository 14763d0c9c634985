//! Depth pictures of a mesh, the input of the networks. Twin of
//! `training/landmarks/render.py`; a golden test compares the two.
//!
//! An orthographic z-buffer of 256² pixels holds the nearest surface. Four features of each pixel
//! are averaged down to 128². They all come from depth, so the mesh's triangulation, winding and
//! smoothing groups do not matter. Columns grow with view x (the subject's left), rows grow with
//! −y, z grows towards the viewer.

use std::ops::Range;

use crate::nn::conv2d::Picture;

/// Side of the depth buffer, pixels.
pub(super) const BUFFER: usize = 256;
const BACKGROUND_DEPTH: f32 = -1.0;
const NOTHING: f32 = f32::NEG_INFINITY;
/// A pixel is still tested where its centre lies this far outside a triangle's bounds, pixels.
const EDGE: f32 = 0.01;
/// In a triangle wider than this many columns, only the columns that it may cover in a row are
/// tested. Otherwise a long thin triangle would cost as much as its bounding box.
const WIDE: usize = 8;
/// The uncertainty of a triangle's edges in single precision, as a share of the triangle's extent.
const SLACK: f32 = 1e-4;

/// The most pixels that one picture tests, enough for five hundred surfaces behind each other. The
/// remaining triangles are not drawn.
pub(super) const MAX_PLACES: u64 = 1 << 25;

/// The square part of the view plane that a picture shows: `centre ± half_size`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Window {
    pub centre: [f32; 2],
    pub half_size: f32,
}

impl Window {
    /// Converts a place in the window, (column, row) from 0 to 1, to view x and y.
    pub fn to_view(self, place: [f32; 2]) -> [f32; 2] {
        [
            self.centre[0] + (2.0 * place[0] - 1.0) * self.half_size,
            self.centre[1] - (2.0 * place[1] - 1.0) * self.half_size,
        ]
    }
}

/// The largest z of each pixel, row-major; −∞ where nothing is drawn.
pub(super) struct DepthBuffer {
    z: Vec<f32>,
    half_size: f32,
    /// Number of tested pixels. A pixel counts once for each triangle that may cover it.
    pub places: u64,
}

impl DepthBuffer {
    /// Draws `triangles` with corners in `points` (view space).
    pub fn draw(points: &[[f32; 3]], triangles: &[[u32; 3]], window: Window) -> Self {
        let mut buffer = DepthBuffer {
            z: vec![NOTHING; BUFFER * BUFFER],
            half_size: window.half_size,
            places: 0,
        };
        let size = BUFFER as f32;
        let scale = (0.5 * f64::from(size) / f64::from(window.half_size)) as f32;
        let pixel = |p: [f32; 3]| {
            [
                (p[0] - window.centre[0]) * scale + 0.5 * size,
                (window.centre[1] - p[1]) * scale + 0.5 * size,
                p[2],
            ]
        };
        let points: Vec<[f32; 3]> = points.iter().map(|p| pixel(*p)).collect();
        let between: Vec<u32> = points.iter().map(|p| between_middles(*p)).collect();
        for t in triangles {
            if buffer.places > MAX_PLACES {
                break;
            }
            if !misses_middles(t.map(|v| between[v as usize])) {
                buffer.draw_triangle(t.map(|v| points[v as usize]));
            }
        }
        buffer
    }

    /// `a`, `b`, `c`: column, row and z.
    fn draw_triangle(&mut self, [a, b, c]: [[f32; 3]; 3]) {
        let size = BUFFER as f32;
        let low = |i: usize| a[i].min(b[i]).min(c[i]);
        let high = |i: usize| a[i].max(b[i]).max(c[i]);
        if high(0) < 0.0 || high(1) < 0.0 || low(0) > size || low(1) > size {
            return;
        }
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area.abs() < 1e-12 {
            return;
        }
        // Pixels whose centre may lie inside. A small triangle of a dense mesh mostly has none.
        let first = |i: usize| up(low(i) - 0.5 - EDGE);
        let last = |i: usize| ((high(i) + 0.5 + EDGE) as usize).min(BUFFER);
        let (rows, columns) = (first(1)..last(1), first(0)..last(0));
        let part = 1.0 / area;
        let is_wide = columns.len() > WIDE;
        let margin = 0.5 + EDGE + SLACK * (high(0) - low(0)).max(high(1) - low(1));
        for row in rows {
            let y = row as f32 + 0.5;
            let columns = if is_wide {
                within(
                    &columns,
                    across([a, b, c], [y - margin, y + margin]),
                    margin,
                )
            } else {
                columns.clone()
            };
            self.places += columns.len() as u64;
            for column in columns {
                let x = column as f32 + 0.5;
                let wa = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) * part;
                let wb = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) * part;
                let wc = 1.0 - wa - wb;
                if wa < -1e-5 || wb < -1e-5 || wc < -1e-5 {
                    continue;
                }
                let z = wa * a[2] + wb * b[2] + wc * c[2];
                let here = &mut self.z[row * BUFFER + column];
                *here = here.max(z);
            }
        }
    }

    /// Softens the surface. Every drawn pixel becomes the mean of the drawn pixels around it,
    /// weighted by a Gaussian of `deviation` pixels.
    pub fn softened(&self, deviation: f32) -> Self {
        let drawn: Vec<f32> = self.z.iter().map(|z| f32::from(*z > NOTHING)).collect();
        let depth: Vec<f32> = self
            .z
            .iter()
            .map(|z| if *z > NOTHING { *z } else { 0.0 })
            .collect();
        let (weight, total) = (blurred(&drawn, deviation), blurred(&depth, deviation));
        let pixels = self.z.iter().zip(weight.iter().zip(&total));
        DepthBuffer {
            z: pixels
                .map(|(z, (weight, total))| {
                    if *z > NOTHING {
                        total / weight
                    } else {
                        NOTHING
                    }
                })
                .collect(),
            half_size: self.half_size,
            places: self.places,
        }
    }

    /// View z at a place in the window, (column, row) from 0 to 1; `None` where nothing is drawn.
    pub fn depth_at(&self, place: [f32; 2]) -> Option<f32> {
        let at = place.map(|x| (x * BUFFER as f32) as isize);
        let inside = at.iter().all(|x| (0..BUFFER as isize).contains(x));
        let z = inside.then(|| self.z[at[1] as usize * BUFFER + at[0] as usize])?;
        (z > NOTHING).then_some(z)
    }

    /// The network's input, `[128, 128, 4]`: depth, normal x, normal y and coverage.
    ///
    /// Depth is relative to the mean depth, in half-sizes of the window, and clamped to ±1.5. Every
    /// value is the mean of 2×2 pixels. An empty pixel has depth −1 and zero for the others.
    pub fn features(&self) -> Picture {
        let mean = self.mean_depth() as f32;
        let mut out = Picture::zeros(BUFFER / 2, BUFFER / 2, 4);
        for row in 0..BUFFER {
            for column in 0..BUFFER {
                let feature = self.feature(row, column, mean);
                let at = 4 * (row / 2 * (BUFFER / 2) + column / 2);
                for (to, value) in out.values[at..at + 4].iter_mut().zip(feature) {
                    *to += 0.25 * value;
                }
            }
        }
        out
    }

    fn mean_depth(&self) -> f64 {
        let covered = self.z.iter().filter(|z| **z > NOTHING);
        let (sum, count) = covered.fold((0.0, 0), |(s, n), z| (s + f64::from(*z), n + 1));
        sum / f64::from(count.max(1))
    }

    fn feature(&self, row: usize, column: usize, mean: f32) -> [f32; 4] {
        let here = self.at(row, column);
        if here == NOTHING {
            return [BACKGROUND_DEPTH, 0.0, 0.0, 0.0];
        }
        let per_pixel = 0.5 * BUFFER as f32 / self.half_size;
        let left = self.at(row, column.wrapping_sub(1));
        let above = self.at(row.wrapping_sub(1), column);
        let dx = per_pixel * slope(left, here, self.at(row, column + 1));
        let dy = -per_pixel * slope(above, here, self.at(row + 1, column));
        let length = (dx * dx + dy * dy + 1.0).sqrt();
        let depth = (here - mean) / self.half_size;
        [depth.clamp(-1.5, 1.5), -dx / length, -dy / length, 1.0]
    }

    fn at(&self, row: usize, column: usize) -> f32 {
        if row < BUFFER && column < BUFFER {
            self.z[row * BUFFER + column]
        } else {
            NOTHING
        }
    }
}

/// Blurs a square picture with a Gaussian that is cut off at three deviations. `deviation` is in
/// pixels. Pixels outside the picture count as zero. The weights do not sum to one.
fn blurred(picture: &[f32], deviation: f32) -> Vec<f32> {
    let reach = (3.0 * deviation).ceil() as isize;
    let weights: Vec<f32> = (-reach..=reach)
        .map(|step| (-0.5 * (step as f32 / deviation).powi(2)).exp())
        .collect();
    let along = |from: &[f32], stride: usize| -> Vec<f32> {
        let pixel = |i: usize| {
            let place = (i / stride % BUFFER) as isize;
            let steps = (-reach).max(-place)..=reach.min(BUFFER as isize - 1 - place);
            steps
                .map(|s| {
                    weights[(s + reach) as usize]
                        * from[(i as isize + s * stride as isize) as usize]
                })
                .sum()
        };
        (0..from.len()).map(pixel).collect()
    };
    along(&along(picture, 1), BUFFER)
}

/// Smallest and largest column of a triangle between two rows; an empty range (∞ to −∞) where the
/// triangle does not reach them.
fn across(corners: [[f32; 3]; 3], [top, bottom]: [f32; 2]) -> [f32; 2] {
    let mut extent = [f32::INFINITY, f32::NEG_INFINITY];
    let mut note = |x: f32| extent = [extent[0].min(x), extent[1].max(x)];
    for (i, from) in corners.iter().enumerate() {
        let to = corners[(i + 1) % 3];
        if (top..=bottom).contains(&from[1]) {
            note(from[0]);
        }
        for y in [top, bottom] {
            if (from[1] < y) != (to[1] < y) {
                note(from[0] + (to[0] - from[0]) * (y - from[1]) / (to[1] - from[1]));
            }
        }
    }
    extent
}

/// The part of `columns` whose pixel centres may lie between `low` and `high`.
fn within(columns: &Range<usize>, [low, high]: [f32; 2], margin: f32) -> Range<usize> {
    let first = up(low - margin).max(columns.start);
    let last = ((high + 1.0 + margin) as usize).min(columns.end);
    first..last
}

/// Marks a point outside the picture, or close to a row or column of pixel centres.
const ANYWHERE: u32 = u32::MAX;

/// The gap between pixel centres that a point lies in, column and row in 16 bits each.
///
/// Most triangles of a dense mesh lie between pixel centres. These gaps are enough to recognise
/// them, and take a third of the memory of the points.
fn between_middles([column, row, _]: [f32; 3]) -> u32 {
    let of = |x: f32| {
        let place = (x + 0.5).clamp(0.0, BUFFER as f32 + 1.0);
        let whole = place as u32;
        let part = place - whole as f32;
        (part > 2.0 * EDGE && part < 1.0 - 2.0 * EDGE).then_some(whole)
    };
    match (of(column), of(row)) {
        (Some(column), Some(row)) => column << 16 | row,
        _ => ANYWHERE,
    }
}

/// Whether a triangle certainly covers no pixel centre.
fn misses_middles([a, b, c]: [u32; 3]) -> bool {
    let differs = (a ^ b) | (a ^ c);
    let apart = differs & 0xffff_0000 != 0 && differs & 0xffff != 0;
    !apart && a != ANYWHERE && b != ANYWHERE && c != ANYWHERE
}

/// Rounds up to a whole number, at least 0. `f32::ceil` is a function call on older processors.
fn up(x: f32) -> usize {
    let whole = x as usize;
    whole + usize::from((whole as f32) < x)
}

/// The slope per pixel: the central difference where both neighbours exist, the one-sided
/// difference where one exists, else zero.
fn slope(before: f32, here: f32, after: f32) -> f32 {
    match (before.is_finite(), after.is_finite()) {
        (true, true) => 0.5 * (after - before),
        (false, true) => after - here,
        (true, false) => here - before,
        (false, false) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Window = Window {
        centre: [1.0, 2.0],
        half_size: 0.5,
    };

    /// A square that fills the left half of the window and leans away to the left.
    fn half() -> DepthBuffer {
        let points = [
            [0.5, 1.5, 0.0],
            [1.0, 1.5, 0.5],
            [1.0, 2.5, 0.5],
            [0.5, 2.5, 0.0],
        ];
        DepthBuffer::draw(&points, &[[0, 2, 1], [0, 2, 3]], WINDOW)
    }

    #[test]
    fn a_leaning_square_has_its_depth_and_normal_whatever_the_winding() {
        let buffer = half();
        assert!((buffer.depth_at([0.25, 0.9]).unwrap() - 0.25).abs() < 2e-3);
        assert_eq!(buffer.depth_at([0.75, 0.5]), None);
        assert_eq!(buffer.depth_at([-0.1, 0.5]), None);
        let features = buffer.features();
        let at = |row: usize, column: usize| &features.values[4 * (row * 128 + column)..][..4];
        let lean = -(0.5f32.sqrt());
        assert!((at(60, 20)[1] - lean).abs() < 1e-4 && at(60, 20)[2].abs() < 1e-4);
        assert_eq!(at(60, 20)[3], 1.0);
        assert_eq!(at(60, 100), [-1.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn the_nearest_surface_wins() {
        let mut points = Vec::new();
        for z in [-1.0, 3.0, 1.0] {
            points.extend([[0.0, 1.0, z], [4.0, 1.0, z], [0.0, 5.0, z]]);
        }
        let buffer = DepthBuffer::draw(&points, &[[0, 1, 2], [3, 4, 5], [6, 7, 8]], WINDOW);
        assert_eq!(buffer.depth_at([0.5, 0.5]), Some(3.0));
    }

    #[test]
    fn what_lies_between_middles_is_left_out_and_nothing_else() {
        let mut state = 9u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut left_out = 0;
        for _ in 0..20_000 {
            let (x, y) = (260.0 * next() - 2.0, 260.0 * next() - 2.0);
            let corners = [(); 3].map(|()| [x + 2.0 * next(), y + 2.0 * next(), next()]);
            if misses_middles(corners.map(between_middles)) {
                let mut buffer = DepthBuffer {
                    z: vec![NOTHING; BUFFER * BUFFER],
                    half_size: 1.0,
                    places: 0,
                };
                buffer.draw_triangle(corners);
                assert!(buffer.z.iter().all(|z| *z == NOTHING), "{corners:?}");
                left_out += 1;
                if left_out == 300 {
                    break;
                }
            }
        }
        assert_eq!(left_out, 300);
    }

    #[test]
    fn every_middle_that_a_triangle_covers_is_within_its_columns() {
        let mut state = 5u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        for n in 0..400 {
            let reach = [300.0, 3_000.0][n % 2];
            let mut corners = [(); 3].map(|()| {
                [
                    reach * (next() - 0.5) + 128.0,
                    reach * (next() - 0.5) + 128.0,
                    0.0,
                ]
            });
            if n % 3 == 0 {
                corners[2] =
                    std::array::from_fn(|i| 0.5 * (corners[0][i] + corners[1][i]) + 0.3 * next());
            }
            let mut buffer = DepthBuffer {
                z: vec![NOTHING; BUFFER * BUFFER],
                half_size: 1.0,
                places: 0,
            };
            buffer.draw_triangle(corners);
            let [a, b, c] = corners;
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            for (at, z) in buffer.z.iter().enumerate() {
                let (x, y) = ((at % BUFFER) as f32 + 0.5, (at / BUFFER) as f32 + 0.5);
                let wa = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area;
                let wb = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area;
                let is_covered = wa > 1e-4 && wb > 1e-4 && 1.0 - wa - wb > 1e-4;
                assert!(!is_covered || *z > NOTHING, "{corners:?} {x} {y}");
            }
        }
    }

    #[test]
    fn softening_takes_steps_away_and_leaves_slopes_and_edges() {
        let slope = half();
        let soft = slope.softened(3.0);
        for place in [[0.1, 0.5], [0.25, 0.9], [0.4, 0.3]] {
            let (a, b) = (
                slope.depth_at(place).unwrap(),
                soft.depth_at(place).unwrap(),
            );
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        assert_eq!(soft.depth_at([0.75, 0.5]), None);
        let steps = |z: f32| (z * 16.0).round() / 16.0;
        let stairs = DepthBuffer {
            z: slope.z.iter().map(|z| steps(*z)).collect(),
            half_size: slope.half_size,
            places: 0,
        };
        let rough = |b: &DepthBuffer| (b.at(128, 64) - 2.0 * b.at(128, 56) + b.at(128, 48)).abs();
        assert!(rough(&stairs) > 0.06 && rough(&stairs.softened(6.0)) < 0.02);
    }

    #[test]
    fn places_and_view_agree() {
        assert_eq!(WINDOW.to_view([0.0, 0.0]), [0.5, 2.5]);
        assert_eq!(WINDOW.to_view([1.0, 0.75]), [1.5, 1.75]);
    }
}
