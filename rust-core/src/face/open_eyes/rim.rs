//! The line at which lids and eye meet: the crease between them, seen from the front.
//!
//! In each column from corner to corner, a place counts as a crease where it lies behind the mean
//! of the places above and below it, and the deeper it lies, the more it counts. The cheapest path
//! through the columns (dynamic programming) follows the crease, stays near the curve of the
//! landmarks and does not jump. Where no crease is carved, the path stays on that curve.

use glam::{Vec2, Vec3};

use crate::{
    face::{
        eyes::{Opening, SAMPLES},
        nearest::nearest_between,
    },
    mesh::FrontView,
};

/// Height of a row, in widths of the eye (0.1 mm).
const ROW: f32 = 0.004;
/// The crease may lie this many rows above or below the landmarks (3.4 mm).
const RANGE: i32 = 30;
/// Distances to the places above and below that a place is compared with, in widths of the eye.
const FLANKS: [f32; 3] = [0.03, 0.06, 0.1];
/// A crease of this depth, in widths, outweighs one standard deviation from the landmarks.
const DEEP: f32 = 0.01;
/// A crease deeper than this many times `DEEP` weighs no more.
const DEEPEST: f32 = 6.0;
/// Standard deviation of the crease from the landmarks, in rows.
const TRUST: f32 = 12.0;
/// Standard deviation of a step from one column to the next, in rows.
const STEP: f32 = 2.0;
/// Passes of a binomial filter over the path.
const SMOOTHING: usize = 3;
/// The lids stay at least this far apart, in widths, except at the corners.
const APART: f32 = 0.06;

/// A closed line around an eye, seen from the front.
pub(super) struct Rim {
    /// From the first corner along the upper lid and back along the lower one.
    polygon: Vec<Vec2>,
}

impl Rim {
    /// Finds the line. `view`: the skin around the eye, in the eye's frame.
    pub fn of(opening: &Opening, view: &FrontView) -> Rim {
        let [upper, lower] = opening
            .edges
            .each_ref()
            .map(|edge| crease(edge, view, opening.width));
        let x = |k: usize| opening.edges[0][k][0];
        let apart = |k: usize| {
            let inward = k.min(SAMPLES - 1 - k).min(3) as f32 / 3.0;
            0.5 * APART * inward * opening.width
        };
        let middle = |k: usize| 0.5 * (upper[k] + lower[k]);
        let above = (0..SAMPLES).map(|k| Vec2::new(x(k), upper[k].max(middle(k) + apart(k))));
        let below = (1..SAMPLES - 1).rev();
        let below = below.map(|k| Vec2::new(x(k), lower[k].min(middle(k) - apart(k))));
        Rim {
            polygon: above.chain(below).collect(),
        }
    }

    /// Distance of a point from the line, centimetres, negative inside.
    pub fn distance(&self, p: Vec2) -> f32 {
        let next = self.polygon.iter().cycle().skip(1);
        let sides = self.polygon.iter().zip(next);
        let (mut away, mut is_inside) = (f32::INFINITY, false);
        for (&a, &b) in sides {
            let nearest = nearest_between(p.extend(0.0), a.extend(0.0), b.extend(0.0));
            away = away.min(nearest.distance(p.extend(0.0)));
            let crosses = (a.y > p.y) != (b.y > p.y);
            if crosses && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x) {
                is_inside = !is_inside;
            }
        }
        if is_inside { -away } else { away }
    }

    /// A point inside the line, in the middle of the eye.
    pub fn middle(&self) -> Vec2 {
        let half = SAMPLES / 2;
        self.polygon[half].midpoint(self.polygon[self.polygon.len() - half])
    }
}

/// Heights of a lid's edge after it is drawn to the crease near it.
fn crease(edge: &[[f32; 3]; SAMPLES], view: &FrontView, width: f32) -> [f32; SAMPLES] {
    let row = ROW * width;
    let rows = (2 * RANGE + 1) as usize;
    let cost_of = |k: usize, number: usize| {
        let offset = (number as i32 - RANGE) as f32;
        let is_corner = k == 0 || k == SAMPLES - 1;
        if is_corner {
            return if offset == 0.0 { 0.0 } else { f32::INFINITY };
        }
        let depth = valley(
            view,
            Vec2::new(edge[k][0], edge[k][1] + row * offset),
            width,
        );
        (offset / TRUST).powi(2) - (depth / (DEEP * width)).min(DEEPEST)
    };
    let mut costs: Vec<f32> = (0..rows).map(|number| cost_of(0, number)).collect();
    let mut came_from = Vec::new();
    for k in 1..SAMPLES {
        let best = |number: usize| {
            let through = |from: usize| {
                let step = (number as f32 - from as f32) / STEP;
                (costs[from] + step * step, from)
            };
            let ways = (number.saturating_sub(8)..=(number + 8).min(rows - 1)).map(through);
            ways.min_by(|a, b| a.0.total_cmp(&b.0))
                .expect("a row beside each")
        };
        let cheapest: Vec<(f32, usize)> = (0..rows).map(best).collect();
        costs = (0..rows)
            .map(|number| cheapest[number].0 + cost_of(k, number))
            .collect();
        came_from.push(
            cheapest
                .into_iter()
                .map(|(_, from)| from)
                .collect::<Vec<usize>>(),
        );
    }
    let mut number = RANGE as usize;
    let mut heights = [0.0; SAMPLES];
    for k in (0..SAMPLES).rev() {
        heights[k] = edge[k][1] + row * (number as i32 - RANGE) as f32;
        if k > 0 {
            number = came_from[k - 1][number];
        }
    }
    for _ in 0..SMOOTHING {
        let old = heights;
        for k in 1..SAMPLES - 1 {
            heights[k] = 0.25 * old[k - 1] + 0.5 * old[k] + 0.25 * old[k + 1];
        }
    }
    heights
}

/// How far a place lies behind the mean of the places above and below it, the most over all flanks.
/// 0 where it does not lie behind them or nothing is drawn there.
fn valley(view: &FrontView, at: Vec2, width: f32) -> f32 {
    let depth = |y: f32| depth(view, Vec2::new(at.x, at.y + y));
    let here = depth(0.0);
    let behind = FLANKS.map(|away| 0.5 * (depth(away * width) + depth(-away * width)) - here);
    let known = behind.into_iter().filter(|x| x.is_finite());
    known.fold(0.0, f32::max)
}

/// Depth of the visible surface at a place, not finite where there is none.
pub(super) fn depth(view: &FrontView, at: Vec2) -> f32 {
    let [column, row] = view.cell_at(at.into());
    view.depth(column, row)
}

/// Draws the skin around an eye of this width, seen from the front.
pub(super) fn skin_view(triangles: impl Iterator<Item = [Vec3; 3]>, width: f32) -> FrontView {
    let reach = 1.2 * width;
    let mut view = FrontView::new([-reach; 2], [reach; 2], width / 150.0);
    triangles.for_each(|t| view.draw(t.map(Into::into), 1));
    view
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::face::eyes::{EyeFrame, Eyeball, Lids};

    fn opening(height: f32) -> Opening {
        let edge = |side: f32| {
            std::array::from_fn(|k| {
                let x = -1.4 + 2.8 * k as f32 / (SAMPLES - 1) as f32;
                [x, side * height * (1.0 - (x / 1.4).powi(2)), 1.0]
            })
        };
        Opening {
            frame: EyeFrame {
                origin: [0.0; 3],
                axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            },
            ball: Eyeball::new(1.2, &[]),
            width: 2.8,
            edges: [edge(1.0), edge(-1.0)],
            heights: [2.0 * height; 2],
            lids: Lids::Joined,
        }
    }

    /// A plain skin with a groove of this depth around an opening of this height.
    fn grooved(height: f32, depth: f32) -> FrontView {
        let rim = opening(height);
        let at = |x: f32, y: f32| {
            let edge = height * (1.0 - (x / 1.4).powi(2)).max(0.0);
            let away = ((y.abs() - edge) / 0.06).powi(2);
            Vec3::new(x, y, -depth * (-away).exp())
        };
        let step = 0.04;
        let cells =
            (-75..75).flat_map(|i| (-75..75).map(move |j| (step * i as f32, step * j as f32)));
        let triangles = cells.flat_map(|(x, y)| {
            let [a, b, c, d] =
                [(x, y), (x + step, y), (x + step, y + step), (x, y + step)].map(|(x, y)| at(x, y));
            [[a, b, c], [a, c, d]]
        });
        skin_view(triangles, rim.width)
    }

    #[test]
    fn the_rim_follows_a_crease_beside_the_landmarks_and_else_the_landmarks() {
        let (marks, carved) = (0.5, 0.62);
        let height = |view: &FrontView| -Rim::of(&opening(marks), view).distance(Vec2::ZERO);
        let measured = height(&grooved(carved, 0.15));
        assert!((measured - carved).abs() < 0.04, "{measured}");
        let plain = height(&grooved(carved, 0.0));
        assert!((plain - marks).abs() < 0.04, "{plain}");
    }

    #[test]
    fn inside_is_below_zero_and_the_middle_lies_there() {
        let rim = Rim::of(&opening(0.5), &grooved(0.5, 0.1));
        assert!(rim.distance(rim.middle()) < -0.3);
        assert!(rim.distance(Vec2::new(0.0, 1.5)) > 0.8);
        assert!((rim.distance(Vec2::new(2.4, 0.0)) - 1.0).abs() < 0.05);
    }
}
