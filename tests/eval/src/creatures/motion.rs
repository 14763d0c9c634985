//! The test poses of a creature, and measures of what its mesh does in them.

use anyface::Face;
use ndarray::{Array3, ArrayView2};

use crate::vertex_motion::{distance, dot, normal, pose};

/// Triangles that grow beyond this many times their area count as torn.
const MAX_GROWTH: f32 = 4.0;
/// Triangles that turn by more than 100 degrees have turned over. This is the cosine.
const TURNED_OVER: f32 = -0.17;
/// A triangle counts as moving if a corner moves at least this far, canonical metres.
const MOVES_M: f32 = 5e-4;

/// `[1, 68, 3]`, metres: the corners of the mouth move out and up.
pub(super) fn smile() -> Array3<f32> {
    let mut moved = Array3::zeros((1, 68, 3));
    for (n, side, share) in [
        (48, -1.0, 1.0),
        (60, -1.0, 1.0),
        (54, 1.0, 1.0),
        (64, 1.0, 1.0),
        (49, -1.0, 0.5),
        (53, 1.0, 0.5),
        (59, -1.0, 0.5),
        (55, 1.0, 0.5),
    ] {
        moved[[0, n, 0]] = side * share * 0.006;
        moved[[0, n, 1]] = share * 0.006;
    }
    moved
}

/// `[1, 68, 3]`, metres: the upper lids move down by more than the height of an open eye.
pub(super) fn shut_eyes() -> Array3<f32> {
    let mut moved = Array3::zeros((1, 68, 3));
    for n in [37, 38, 43, 44] {
        moved[[0, n, 1]] = -0.012;
    }
    moved
}

/// How far the vertices of the landmarks `some` follow the `requested` motion `[68, 3]`, as a share
/// of it. With landmarks in `less`, it compares the difference between the mean motions of the two
/// groups instead.
pub(super) fn of_landmarks(
    face: &Face,
    frame: ArrayView2<'_, f32>,
    requested: ArrayView2<'_, f32>,
    some: &[usize],
    less: &[usize],
) -> f32 {
    let units = face.metres_per_unit() as f32;
    let mean = |marks: &[usize], motion: &dyn Fn(usize) -> [f32; 3]| -> [f32; 3] {
        let count = marks.len().max(1) as f32;
        std::array::from_fn(|i| marks.iter().map(|n| motion(*n)[i]).sum::<f32>() / count)
    };
    let moved = |n: usize| -> [f32; 3] {
        let row = frame.row(face.landmarks.vertices[n] as usize);
        face.to_canonical
            .rotate([row[0], row[1], row[2]])
            .map(|x| x * units)
    };
    let requested_step = |n: usize| -> [f32; 3] { std::array::from_fn(|i| requested[[n, i]]) };
    let along = |motion: &dyn Fn(usize) -> [f32; 3]| -> [f32; 3] {
        let (some, less) = (mean(some, motion), mean(less, motion));
        std::array::from_fn(|i| some[i] - less[i])
    };
    // Sideways, the two corners of a smile would cancel out in a mean, so each landmark counts by
    // itself.
    let (sum, length) = if less.is_empty() {
        some.iter().fold((0.0, 0.0), |(sum, length), n| {
            (
                sum + dot(moved(*n), requested_step(*n)),
                length + dot(requested_step(*n), requested_step(*n)),
            )
        })
    } else {
        (
            dot(along(&moved), along(&requested_step)),
            dot(along(&requested_step), along(&requested_step)),
        )
    };
    sum / length.max(f32::MIN_POSITIVE)
}

/// The numbers of triangles that move in a frame `[V, 3]`, and of these the numbers that grow and
/// turn over.
pub(super) fn torn(face: &Face, frame: ArrayView2<'_, f32>) -> [usize; 3] {
    let moves = MOVES_M / face.metres_per_unit() as f32;
    let posed = pose(&face.mesh, frame).positions;
    let mut counts = [0; 3];
    for t in &face.mesh.triangles {
        let corners = |p: &[[f32; 3]]| t.map(|v| p[v as usize]);
        let (before, now) = (corners(&face.mesh.positions), corners(&posed));
        if (0..3).all(|k| distance(before[k], now[k]) < moves) {
            continue;
        }
        let (before, now) = (normal(before), normal(now));
        let (a, b) = (dot(before, before).sqrt(), dot(now, now).sqrt());
        counts[0] += 1;
        counts[1] += usize::from(b > MAX_GROWTH * a);
        counts[2] += usize::from(dot(before, now) < TURNED_OVER * a * b);
    }
    counts
}
