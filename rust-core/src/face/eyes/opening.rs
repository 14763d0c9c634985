//! Measures how far one eye of a head is open, and finds the ball that its lids slide over.
//!
//! Where a head has eyeballs, the opening is the part of the ball that is visible from the front,
//! however far the landmarks are from it. The ball of a shallow eye is a piece of a large sphere
//! along its front. Where a head has no eyeballs, the opening lies between curves
//! through the landmarks. The ball is then a sphere fitted to the skin between the curves, or a
//! sphere of usual size. The lids then count as sculpted shut where the upper lid stands out over
//! the lower one at the lower landmarks, and the upper landmarks have no edge. Lengths are canonical
//! centimetres.

use glam::Vec3;

use super::{
    Eyeball, Mix,
    ball::{fit_eyeball, fit_shallow, radius_of},
    balls::Ball,
    joined::are_joined,
};
use crate::{
    face::lids::LidEdge,
    mesh::{
        FrontView,
        ibug::{Eye, LANDMARKS},
    },
};

/// Number of samples from corner to corner at which an opening is measured.
pub(crate) const SAMPLES: usize = 24;
/// Cells across the width of an eye in its picture.
const CELLS: f32 = 150.0;
/// Kinds of cells.
const SKIN: u8 = 1;
const BALL: u8 = 2;
/// The picture reaches this far beyond the corners, and above and below them, in widths of the eye.
const PICTURE: (f32, f32) = (0.3, 0.9);
/// An eye looks sideways where its corners differ in depth by more than this share of its width.
/// The landmarks belong to faces that look ahead and do not lie on such lids. Human eyes have 0.15
/// to 0.25.
const SIDEWAYS: f32 = 0.55;
/// Only triangles this near to the middle of an eye can belong to it, in widths of the eye.
const NEAR: f32 = 1.5;
/// An eye is sculpted shut where the visible part of its ball has a smaller mean height than this,
/// in widths of the eye.
const LEAST_OPEN: f32 = 0.03;
/// How far above and below the landmarks to look for a step between two lids, in widths of the eye.
const STEP_BESIDE: f32 = 0.1;
/// Height over which the step is measured, in widths of the eye.
const STEP_HEIGHT: f32 = 0.06;
/// An eye is sculpted shut where the step is smaller than the first value at the upper landmarks
/// and larger than the second at the lower ones, in widths of the eye. A scan with shut eyes has
/// 0.02 and 0.11. The open eyes of eight heads have 0.07 and more at the upper landmarks.
const SHUT_STEPS: (f32, f32) = (0.045, 0.06);
/// A corner of an eye lies at least this far outside the visible part of its eyeball, in widths of
/// the eye.
const CORNER: f32 = 0.02;
/// Passes of smoothing over the edges of the visible eyeball, so that the cells of its picture do
/// not show.
const SMOOTHINGS: usize = 3;
/// Points this far inside the edges of the lids lie on the eye itself, in widths of the eye.
const INSIDE: f32 = 0.03;

/// The neutral head whose eyes are to be found, in canonical centimetres.
pub(crate) struct Head<'a> {
    /// `[V]`.
    pub positions: &'a [[f32; 3]],
    pub landmarks: &'a [[f32; 3]; LANDMARKS],
    /// Triangles of the skin.
    pub skin: &'a [[u32; 3]],
}

impl Head<'_> {
    /// Triangles near the middle of an eye of this `width`, in the eye's axes with the origin at
    /// `centre`.
    fn near(
        &self,
        triangles: &[[u32; 3]],
        (middle, width): (&EyeFrame, f32),
        centre: [f32; 3],
    ) -> Vec<[[f32; 3]; 3]> {
        let is_near = |p: &[f32; 3]| Vec3::from(*p).length_squared() < (NEAR * width).powi(2);
        let shift = middle.local(centre);
        let corners = triangles.iter();
        let corners = corners.map(|t| t.map(|v| middle.local(self.positions[v as usize])));
        let near = corners.filter(|t| t.iter().all(is_near));
        near.map(|t| t.map(|p| std::array::from_fn(|i| p[i] - shift[i])))
            .collect()
    }
}

/// Axes of one eye: across from corner to corner, up, and out of the face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EyeFrame {
    pub origin: [f32; 3],
    pub axes: [[f32; 3]; 3],
}

/// The opening of one eye.
pub(crate) struct Opening {
    /// Its origin is the centre of the ball.
    pub frame: EyeFrame,
    pub ball: Eyeball,
    /// From corner to corner.
    pub width: f32,
    /// Edges of the upper and of the lower lid from corner to corner, in the eye's frame.
    pub edges: Edges,
    /// Height of the opening at the two pairs of lid landmarks. An eye without landmarks is
    /// measured at 1/3 and 2/3 of its width.
    pub heights: [f32; 2],
    /// What the lids can do.
    pub lids: Lids,
}

/// Edges of the upper and of the lower lid from corner to corner.
type Edges = [[[f32; 3]; SAMPLES]; 2];

/// What the lids of an eye can do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lids {
    /// They close.
    Close,
    /// They are sculpted shut and do not move.
    Shut,
    /// They form one surface with the eye, without a slit between, and do not move.
    Joined,
}

impl EyeFrame {
    /// The frame about the middle between two corners, and the width of the eye. `None` where the
    /// two points cannot be the corners of an eye.
    fn between(start: [f32; 3], end: [f32; 3]) -> Option<(EyeFrame, f32)> {
        let (start, end) = (Vec3::from(start), Vec3::from(end));
        let way = end - start;
        let width = way.length();
        if width < 0.1 || way.z.abs() > SIDEWAYS * width {
            return None;
        }
        let across = way / width;
        let up = Vec3::Y - across.y * across;
        let size = up.length();
        if size < 0.5 {
            return None;
        }
        let up = up / size;
        let origin = (start + 0.5 * way).into();
        let axes = [across, up, across.cross(up)].map(Into::into);
        Some((EyeFrame { origin, axes }, width))
    }

    /// A point's coordinates in this frame.
    pub(crate) fn local(&self, p: [f32; 3]) -> [f32; 3] {
        let offset = Vec3::from(p) - Vec3::from(self.origin);
        self.axes.map(|axis| Vec3::from(axis).dot(offset))
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
    /// Finds the eye at some landmarks. `eyeball`: the triangles of its ball, empty where it has
    /// none.
    pub(super) fn find(head: &Head<'_>, eye: &Eye, eyeball: &[[u32; 3]]) -> Option<Opening> {
        let mut opening = Opening::open(head, &head.landmarks[eye.lids.clone()], eyeball)?;
        opening.heights = eye
            .pairs
            .map(|pair| opening.height_at(head.landmarks, pair));
        Some(opening)
    }

    /// Finds an eye by its ball, without landmarks. `None` where the visible part of the ball has
    /// no skin above and below it.
    pub(super) fn about(head: &Head<'_>, ball: &Ball) -> Option<Opening> {
        let canonical = EyeFrame {
            origin: [0.0; 3],
            axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        };
        let points = ball.triangles.as_flattened().iter();
        let points: Vec<[f32; 3]> = points.map(|&v| head.positions[v as usize]).collect();
        let across = 2.0 * ball.radius;
        let (centre, radius) = fit_eyeball(&points, across)?;
        let frame = canonical.about(centre);
        let skin = head.near(head.skin, (&frame, across), frame.origin);
        let eyeball = head.near(&ball.triangles, (&frame, across), frame.origin);
        let view = picture(&skin, &eyeball, [0.0; 3], across);
        let edges = visible_edges(&view, [[0.0; 3]; 2], across)?;
        let width = edges[0][SAMPLES - 1][0] - edges[0][0][0];
        let mut inner = SAMPLES / 4..SAMPLES - SAMPLES / 4;
        let has_lids = inner.all(|k| {
            let x = edges[0][k][0];
            let column = view.cell_at([x, 0.0])[0];
            let is_skin = |row: usize| view.kind(column, row) == SKIN;
            ball_rows(&view, column)
                .is_some_and(|run| lid_rows(&view, run).into_iter().all(is_skin))
        });
        if !has_lids || mean_height(&edges) < LEAST_OPEN * width {
            return None;
        }
        let height = |share: f32| {
            let k = (share * (SAMPLES - 1) as f32).round() as usize;
            edges[0][k][1] - edges[1][k][1]
        };
        Some(Opening {
            frame,
            ball: Eyeball::new(radius, eyeball.as_flattened()),
            width,
            edges,
            heights: [1.0 / 3.0, 2.0 / 3.0].map(height),
            lids: Lids::Close,
        })
    }

    /// As [`Opening::find`], without the heights. `marks`: `[6]`, the eye's landmarks.
    fn open(head: &Head<'_>, marks: &[[f32; 3]], eyeball: &[[u32; 3]]) -> Option<Opening> {
        let (middle, width) = EyeFrame::between(marks[0], marks[3])?;
        let size = (&middle, width);
        let eyeball_of = |frame: &EyeFrame| head.near(eyeball, size, frame.origin);
        let pieces = eyeball_of(&middle);
        let shape = fit_eyeball(pieces.as_flattened(), width)
            .or_else(|| fit_shallow(&front_of(&pieces, width), width));
        if let Some((centre, radius)) = shape {
            let frame = middle.about(centre);
            let (skin, eyeball) = (head.near(head.skin, size, frame.origin), eyeball_of(&frame));
            let view = picture(&skin, &eyeball, frame.local(middle.origin), width);
            let corners = [marks[0], marks[3]].map(|p| frame.local(p));
            // Shut lids hide the eyeball.
            let visible = visible_edges(&view, corners, width);
            let edges = visible.unwrap_or_else(|| curves(&frame, marks));
            return Some(Opening {
                frame,
                ball: Eyeball::new(radius, eyeball.as_flattened()),
                width,
                edges,
                heights: [0.0; 2],
                lids: if visible.is_none() || mean_height(&edges) < LEAST_OPEN * width {
                    Lids::Shut
                } else {
                    Lids::Close
                },
            });
        }
        let (skin, edges) = (
            head.near(head.skin, size, middle.origin),
            curves(&middle, marks),
        );
        let view = picture(&skin, &[], [0.0; 3], width);
        let mut opening = without_eyeball(head, &middle, marks, width);
        if is_shut(&view, &edges, width) {
            opening.lids = Lids::Shut;
        } else if are_joined(&skin, &edges[0], &edges[1], width) {
            opening.lids = Lids::Joined;
        }
        Some(opening)
    }

    /// Height of the opening at a pair of landmarks, one on the upper and one on the lower lid.
    fn height_at(&self, marks: &[[f32; 3]; LANDMARKS], pair: (usize, usize)) -> f32 {
        let across = |n: usize| self.frame.local(marks[n])[0];
        let k = self.sample_at(0.5 * (across(pair.0) + across(pair.1)));
        let k = k.round() as usize;
        self.edges[0][k][1] - self.edges[1][k][1]
    }

    /// Index of the sample at a position across the eye, with a fraction, clamped to the opening.
    pub(crate) fn sample_at(&self, across: f32) -> f32 {
        let (first, last) = (self.edges[0][0][0], self.edges[0][SAMPLES - 1][0]);
        let place = (across - first) / (last - first).max(1e-6);
        (place * (SAMPLES - 1) as f32).clamp(0.0, (SAMPLES - 1) as f32)
    }

    /// Whether a point lies between the lids: on the eye itself, not on a lid.
    pub(crate) fn is_between(&self, p: [f32; 3]) -> bool {
        let (first, last) = (self.edges[0][0][0], self.edges[0][SAMPLES - 1][0]);
        let k = self.sample_at(p[0]).round() as usize;
        let inside = INSIDE * self.width;
        let height = self.edges[1][k][1] + inside..self.edges[0][k][1] - inside;
        (first..last).contains(&p[0]) && height.contains(&p[1])
    }
}

/// The opening of an eye without an eyeball: the eye is part of the skin, or the socket is empty.
fn without_eyeball(head: &Head<'_>, middle: &EyeFrame, marks: &[[f32; 3]], width: f32) -> Opening {
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
        heights: [0.0; 2],
        lids: Lids::Close,
    };
    opening.edges = curves(&opening.frame, marks);
    let points = head.positions.iter().map(|p| opening.frame.local(*p));
    let points = points.filter(|p| opening.is_between(*p) && p[2] > 0.0);
    let points: Vec<[f32; 3]> = points.collect();
    if let Some((centre, radius)) = fit_eyeball(&points, width)
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
            let x = start + (end - start) * k as f32 / (SAMPLES - 1) as f32;
            let after = edge
                .iter()
                .position(|p| p[0] >= x)
                .unwrap_or(edge.len() - 1)
                .max(1);
            let (a, b) = (edge[after - 1], edge[after]);
            let along = ((x - a[0]) / (b[0] - a[0]).max(1e-6)).clamp(0.0, 1.0);
            std::array::from_fn(|i| a[i] + along * (b[i] - a[i]))
        })
    })
}

/// Points of the surface of an eyeball that are seen from the front, without the skin before it.
fn front_of(eyeball: &[[[f32; 3]; 3]], width: f32) -> Vec<[f32; 3]> {
    let view = picture(&[], eyeball, [0.0; 3], width);
    let cells =
        (0..view.columns()).flat_map(|column| (0..view.rows()).map(move |row| (column, row)));
    let seen = cells.filter(|&(column, row)| view.kind(column, row) == BALL);
    seen.map(|(column, row)| {
        let [x, y] = view.centre(column, row);
        [x, y, view.depth(column, row)]
    })
    .collect()
}

/// Draws an eye as seen from the front. `middle`: the middle between its corners.
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

/// The edges of the visible part of the eyeball, extended to the corners of the eye. `None` where
/// no part is visible. `marks`: the landmarks of the corners.
fn visible_edges(
    view: &FrontView,
    marks: [[f32; 3]; 2],
    width: f32,
) -> Option<[[[f32; 3]; SAMPLES]; 2]> {
    let rows = |column| ball_rows(view, column);
    let (first, last) = longest_run(view.columns(), |column| rows(column).is_some())?;
    if last - first < SAMPLES {
        return None;
    }
    let at = |column: usize| rows(column).map(|run| lids_beside(view, column, run));
    let ends = [at(first)?, at(last)?];
    let corners = [(0, -1.0), (1, 1.0)].map(|(end, side)| {
        let least = CORNER * width * side;
        corner(marks[end], ends[end], least)
    });
    let mut edges = [[[0.0; 3]; SAMPLES]; 2];
    for k in 0..SAMPLES {
        let along = k as f32 / (SAMPLES - 1) as f32;
        let x = corners[0][0] + along * (corners[1][0] - corners[0][0]);
        let outside = [ends[0][0][0] - x, x - ends[1][0][0]];
        let lids = match outside.iter().position(|away| *away > 0.0) {
            None => at(view.cell_at([x, 0.0])[0])?,
            Some(end) => {
                let whole = (ends[end][0][0] - corners[end][0]).abs().max(1e-6);
                ends[end].map(|edge| edge.mixed(corners[end], outside[end] / whole))
            }
        };
        (0..2).for_each(|lid| edges[lid][k] = [x, lids[lid][1], lids[lid][2]]);
    }
    (0..SMOOTHINGS).for_each(|_| edges = edges.map(|edge| smoothed(&edge)));
    Some(edges)
}

/// The rows of a column that show the eyeball.
fn ball_rows(view: &FrontView, column: usize) -> Option<(usize, usize)> {
    longest_run(view.rows(), |row| view.kind(column, row) == BALL)
}

/// The rows just above and just below those that show the eyeball.
fn lid_rows(view: &FrontView, (low, high): (usize, usize)) -> [usize; 2] {
    [(high + 1).min(view.rows() - 1), low.saturating_sub(1)]
}

/// The edges of the upper and of the lower lid in a column: the outermost cells that show the
/// eyeball, at the depth of the skin next to them where there is any.
fn lids_beside(view: &FrontView, column: usize, (low, high): (usize, usize)) -> [[f32; 3]; 2] {
    let lids = lid_rows(view, (low, high));
    [(high, lids[0]), (low, lids[1])].map(|(row, lid)| {
        let [x, y] = view.centre(column, row);
        match view.kind(column, lid) {
            SKIN => [x, y, view.depth(column, lid)],
            _ => [x, y, view.depth(column, row)],
        }
    })
}

/// The corner of an eye beyond an end of the visible part of its eyeball: its landmark, or a point
/// `least` outside that end where the landmark lies further in.
fn corner(mark: [f32; 3], [upper, lower]: [[f32; 3]; 2], least: f32) -> [f32; 3] {
    if (mark[0] - upper[0]) * least.signum() > least.abs() {
        return mark;
    }
    let middle = upper.mixed(lower, 0.5);
    [middle[0] + least, middle[1], middle[2]]
}

/// Smooths the heights and depths of an edge once. Its ends stay.
fn smoothed(edge: &[[f32; 3]; SAMPLES]) -> [[f32; 3]; SAMPLES] {
    std::array::from_fn(|k| {
        if k == 0 || k == SAMPLES - 1 {
            return edge[k];
        }
        let between = edge[k - 1].mixed(edge[k + 1], 0.5);
        let [_, y, z] = edge[k].mixed(between, 0.5);
        [edge[k][0], y, z]
    })
}

/// Whether the skin between two curves is a shut lid. `view`: a picture of the skin alone.
fn is_shut(view: &FrontView, edges: &[[[f32; 3]; SAMPLES]; 2], width: f32) -> bool {
    let inner = SAMPLES / 4..SAMPLES - SAMPLES / 4;
    let [above, below] = edges.each_ref().map(|edge| {
        let mut steps: Vec<f32> = edge[inner.clone()]
            .iter()
            .map(|at| step(view, *at, width) / width)
            .collect();
        steps.sort_by(f32::total_cmp);
        steps[steps.len() / 2]
    });
    above < SHUT_STEPS.0 && below > SHUT_STEPS.1
}

/// The largest step at or near a point by which the surface above stands out over the surface
/// below.
fn step(view: &FrontView, at: [f32; 3], width: f32) -> f32 {
    let [column, row] = view.cell_at([at[0], at[1]]);
    let cells = |share: f32| (share * CELLS) as isize;
    let depth = |row: isize| view.depth(column, row.clamp(0, view.rows() as isize - 1) as usize);
    let beside = -cells(STEP_BESIDE)..=cells(STEP_BESIDE);
    let half = cells(0.5 * STEP_HEIGHT);
    let steps = beside.map(|beside| {
        let row = row as isize + beside;
        (depth(row + half) - depth(row - half)).min(width)
    });
    // Where nothing is drawn, the depth is minus infinity, and two such depths differ by NaN.
    steps.filter(|step| !step.is_nan()).fold(0.0, f32::max)
}

/// First and last index of the longest run for which `holds` is true.
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
