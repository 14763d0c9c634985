//! How far one eye of a head is open, and what its lids slide over.
//!
//! Where a head has eyeballs, the opening is what of them is seen from the front, however far the landmarks
//! lie beside it. Where it has none, the opening lies between curves through the landmarks, and the ball is
//! the sphere of the skin between them or one of usual size. Lengths are canonical centimetres.

use super::{
    eyeball::{Eyeball, dot, fit_sphere, radius_of},
    lids::LidEdge,
};
use crate::{ibug::LANDMARKS, mesh::FrontView};

/// Places from corner to corner at which an opening is measured.
pub(super) const SAMPLES: usize = 24;
/// Cells of the picture of an eye over its width.
const CELLS: f32 = 150.0;
/// Kinds of the cells.
const SKIN: u8 = 1;
const BALL: u8 = 2;
/// The picture reaches this far beyond the corners, and above and below them, in widths of the eye.
const PICTURE: (f32, f32) = (0.3, 0.9);
/// Eyeballs lie within this distance of the middle of their eye, in its widths.
const NEAR: f32 = 1.5;
/// Eyes of which less is seen, as mean height to width, are sculpted shut.
const LEAST_OPEN: f32 = 0.03;
/// Skin this far inside the curves through the landmarks is the eye's own surface, in widths of the eye.
const INSIDE: f32 = 0.03;

/// The neutral head that eyes are looked for in, canonical centimetres.
pub(super) struct Head<'a> {
    /// `[V]`.
    pub positions: &'a [[f32; 3]],
    pub landmarks: &'a [[f32; 3]; LANDMARKS],
    /// Triangles of the skin.
    pub skin: &'a [[u32; 3]],
    /// Triangles of the parts that are eyeballs.
    pub eyeballs: &'a [[u32; 3]],
}

/// Axes of one eye: across from corner to corner, up, and out of the face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EyeFrame {
    pub origin: [f32; 3],
    pub axes: [[f32; 3]; 3],
}

/// The opening of one eye.
pub(super) struct Opening {
    /// About the centre of the ball.
    pub frame: EyeFrame,
    pub ball: Eyeball,
    /// From corner to corner.
    pub width: f32,
    /// Edges of the upper and of the lower lid from corner to corner, in the eye's frame.
    pub edges: [[[f32; 3]; SAMPLES]; 2],
    /// Whether the eye is sculpted shut.
    pub is_shut: bool,
}

impl EyeFrame {
    /// About the middle between the corners; `None` where these are no corners of an eye.
    fn between(start: [f32; 3], end: [f32; 3]) -> Option<(EyeFrame, f32)> {
        let way: [f32; 3] = std::array::from_fn(|i| end[i] - start[i]);
        let width = dot(way, way).sqrt();
        if width < 0.1 {
            return None;
        }
        let across = way.map(|x| x / width);
        let up: [f32; 3] = std::array::from_fn(|i| f32::from(i == 1) - across[1] * across[i]);
        let size = dot(up, up).sqrt();
        if size < 0.5 {
            return None;
        }
        let up = up.map(|x| x / size);
        let front = std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            across[j] * up[k] - across[k] * up[j]
        });
        let origin = std::array::from_fn(|i| start[i] + 0.5 * way[i]);
        let axes = [across, up, front];
        Some((EyeFrame { origin, axes }, width))
    }

    /// A point's coordinates in this frame.
    pub(super) fn local(&self, p: [f32; 3]) -> [f32; 3] {
        let offset = std::array::from_fn(|i| p[i] - self.origin[i]);
        self.axes.map(|axis| dot(axis, offset))
    }

    /// The same axes about a point given in this frame.
    fn about(&self, centre: [f32; 3]) -> EyeFrame {
        let origin = std::array::from_fn(|i| {
            let along = self.axes.iter().zip(centre);
            self.origin[i] + along.map(|(axis, x)| x * axis[i]).sum::<f32>()
        });
        EyeFrame { origin, ..*self }
    }
}

impl Opening {
    /// The eye whose landmarks begin at `first`.
    pub(super) fn find(head: &Head<'_>, first: usize) -> Option<Opening> {
        let marks = &head.landmarks[first..first + 6];
        let (middle, width) = EyeFrame::between(marks[0], marks[3])?;
        let near = |p: [f32; 3]| dot(p, p) < (NEAR * width).powi(2);
        let locals = |triangles: &[[u32; 3]], frame: &EyeFrame| -> Vec<[[f32; 3]; 3]> {
            let all = triangles.iter();
            let corners = all.map(|t| t.map(|v| middle.local(head.positions[v as usize])));
            let close = corners.filter(|t| t.iter().all(|p| near(*p)));
            let shift = middle.local(frame.origin);
            let moved = close.map(|t| t.map(|p| std::array::from_fn(|i| p[i] - shift[i])));
            moved.collect()
        };
        let eyeball = locals(head.eyeballs, &middle);
        let found = fit_sphere(eyeball.as_flattened(), width);
        if let Some((centre, radius)) = found {
            let frame = middle.about(centre);
            let (skin, eyeball) = (locals(head.skin, &frame), locals(head.eyeballs, &frame));
            let ball = Eyeball::new(radius, eyeball.as_flattened());
            let view = picture(&skin, &eyeball, frame.local(middle.origin), width);
            let seen = seen(&view);
            let is_shut = seen.is_none_or(|edges| mean_height(&edges) < LEAST_OPEN * width);
            let edges = seen.unwrap_or_else(|| curves(&frame, marks));
            return Some(Opening {
                frame,
                ball,
                width,
                edges,
                is_shut,
            });
        }
        Some(without_eyeball(head, &middle, marks, width))
    }

    /// Height of the opening at a place across, in the eye's frame.
    pub(super) fn height_at(&self, across: f32) -> f32 {
        let k = self.sample_at(across).round() as usize;
        self.edges[0][k][1] - self.edges[1][k][1]
    }

    /// Number of the sample at a place across, with its fraction, within the opening.
    pub(super) fn sample_at(&self, across: f32) -> f32 {
        let (first, last) = (self.edges[0][0][0], self.edges[0][SAMPLES - 1][0]);
        let place = (across - first) / (last - first).max(1e-6);
        (place * (SAMPLES - 1) as f32).clamp(0.0, (SAMPLES - 1) as f32)
    }

    /// Whether a point lies between the lids: on the eye itself, not on a lid.
    pub(super) fn is_between(&self, p: [f32; 3]) -> bool {
        let (first, last) = (self.edges[0][0][0], self.edges[0][SAMPLES - 1][0]);
        let k = self.sample_at(p[0]).round() as usize;
        let inside = INSIDE * self.width;
        let height = self.edges[1][k][1] + inside..self.edges[0][k][1] - inside;
        (first..last).contains(&p[0]) && height.contains(&p[1])
    }
}

/// An eye that is part of the skin, or an empty socket.
fn without_eyeball(
    head: &Head<'_>,
    middle: &EyeFrame,
    marks: &[[f32; 3]],
    width: f32,
) -> Opening {
    let lids = [1, 2, 4, 5].map(|n| middle.local(marks[n]));
    let mean = |of: &dyn Fn([f32; 3]) -> f32| lids.iter().map(|p| of(*p)).sum::<f32>() / 4.0;
    let usual = radius_of(width);
    let beside = mean(&|p| p[0] * p[0] + p[1] * p[1]);
    let depth = (usual * usual - beside).max(0.25 * usual * usual).sqrt();
    let mut opening = Opening {
        frame: middle.about([0.0, 0.0, mean(&|p| p[2]) - depth]),
        ball: Eyeball::new(usual, &[]),
        width,
        edges: [[[0.0; 3]; SAMPLES]; 2],
        is_shut: false,
    };
    opening.edges = curves(&opening.frame, marks);
    let own = head.positions.iter().map(|p| opening.frame.local(*p));
    let own = own.filter(|p| opening.is_between(*p) && p[2] > 0.0);
    let own: Vec<[f32; 3]> = own.collect();
    if let Some((centre, radius)) = fit_sphere(&own, width)
        && centre[2] < depth - 0.5 * radius
    {
        opening.frame = opening.frame.about(centre);
        opening.ball = Eyeball::new(radius, &[]);
        opening.edges = curves(&opening.frame, marks);
    }
    opening
}

/// The lids' edges along curves through the landmarks.
fn curves(frame: &EyeFrame, marks: &[[f32; 3]]) -> [[[f32; 3]; SAMPLES]; 2] {
    let corners = std::array::from_fn(|n| marks[n].map(f64::from));
    LidEdge::through(&corners).both().map(|edge| {
        let edge: Vec<[f32; 3]> = edge
            .iter()
            .map(|p| frame.local(p.map(|x| x as f32)))
            .collect();
        let (start, end) = (edge[0][0], edge[edge.len() - 1][0]);
        std::array::from_fn(|k| {
            let x = start + (end - start) * (k as f32 + 0.5) / SAMPLES as f32;
            let after = edge.iter().position(|p| p[0] > x).unwrap_or(1).max(1);
            let (a, b) = (edge[after - 1], edge[after]);
            let along = ((x - a[0]) / (b[0] - a[0]).max(1e-6)).clamp(0.0, 1.0);
            std::array::from_fn(|i| a[i] + along * (b[i] - a[i]))
        })
    })
}

/// What is seen of an eye whose corners have their middle at `middle`.
fn picture(
    skin: &[[[f32; 3]; 3]],
    eyeball: &[[[f32; 3]; 3]],
    middle: [f32; 3],
    width: f32,
) -> FrontView {
    let reach = [0.5 + PICTURE.0, PICTURE.1].map(|x| x * width);
    let low = [middle[0] - reach[0], middle[1] - reach[1]];
    let high = [middle[0] + reach[0], middle[1] + reach[1]];
    let mut view = FrontView::new(low, high, width / CELLS);
    for (triangles, kind) in [(skin, SKIN), (eyeball, BALL)] {
        triangles.iter().for_each(|t| view.draw(*t, kind));
    }
    view
}

/// The edges of the eyeball's part that is seen; `None` where nothing is.
fn seen(view: &FrontView) -> Option<[[[f32; 3]; SAMPLES]; 2]> {
    let runs: Vec<Option<(usize, usize)>> = (0..view.columns())
        .map(|column| longest_run(view.rows(), |row| view.kind(column, row) == BALL))
        .collect();
    let (first, last) = longest_run(runs.len(), |column| runs[column].is_some())?;
    if last - first < SAMPLES {
        return None;
    }
    let mut edges = [[[0.0; 3]; SAMPLES]; 2];
    for k in 0..SAMPLES {
        let column = first + ((last - first) as f32 * (k as f32 + 0.5) / SAMPLES as f32) as usize;
        let (low, high) = runs[column]?;
        for (edge, (row, beside)) in edges
            .iter_mut()
            .zip([(high, high + 1), (low, low.saturating_sub(1))])
        {
            let lid = beside.min(view.rows() - 1);
            let at = if view.kind(column, lid) == SKIN { lid } else { row };
            let [x, y] = view.centre(column, row);
            edge[k] = [x, y, view.depth(column, at)];
        }
    }
    Some(edges)
}

/// First and last number of the longest stretch for which `holds`.
fn longest_run(count: usize, holds: impl Fn(usize) -> bool) -> Option<(usize, usize)> {
    let mut best: Option<(usize, usize)> = None;
    let mut start = None;
    for k in 0..=count {
        match (k < count && holds(k), start) {
            (true, None) => start = Some(k),
            (false, Some(from)) => {
                if best.is_none_or(|(a, b)| k - from > b + 1 - a) {
                    best = Some((from, k - 1));
                }
                start = None;
            }
            _ => {}
        }
    }
    best
}

fn mean_height(edges: &[[[f32; 3]; SAMPLES]; 2]) -> f32 {
    let heights = edges[0].iter().zip(&edges[1]);
    heights.map(|(u, l)| u[1] - l[1]).sum::<f32>() / SAMPLES as f32
}
