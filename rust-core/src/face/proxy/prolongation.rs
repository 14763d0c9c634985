//! Carries values smoothly from the proxy's vertices to the vertices of the skin.
//!
//! A vertex `x` beside a triangle with corners `p_i` and weights `b_i` gets
//!
//! `f(x) = Σ b_i (f_i + ½ g_i · (x − p_i))`
//!
//! with `g_i` the gradient of the values around `p_i`. Linear interpolation alone errs by half the
//! second derivative. A first-order expansion errs by the same amount the other way. The factor ½
//! lies between the two, so quadratic fields are exact where the gradients are, and no crease shows
//! along the proxy's edges. `g_i` is linear in the values around `p_i`, so the whole map is one
//! sparse matrix.

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    mesh::{
        direction::{perpendicular, unit},
        simplify::{Rings, Simplified},
        tree::{blend, closest_weights},
    },
    nn::elementwise::vectorised,
};

/// The most steps along the proxy in search of the closest triangle.
const MAX_STEPS: usize = 16;
/// A triangle that faces away counts as this much further off, so that a fold of the lips does not
/// attach to its other side.
const FOLD_CM: f64 = 0.1;
/// Rows of this many vertices are computed at once before they are added to the matrix.
const ROWS_AT_ONCE: usize = 1 << 16;
/// Keeps the fit of a gradient defined where neighbours lie on a line.
const RIDGE: f64 = 1e-3;

/// A sparse matrix `[V, V]` from the values at the proxy's vertices (columns, numbered as in the
/// whole mesh) to those of the skin. Rows sum to one; rows outside the skin are empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Prolongation {
    start: Vec<u32>,
    columns: Vec<u32>,
    weights: Vec<f32>,
}

impl Prolongation {
    /// Builds the matrix from the entries of each row.
    pub(crate) fn from_rows(rows: impl Iterator<Item = Vec<(u32, f32)>>) -> Prolongation {
        let mut out = Prolongation {
            start: vec![0],
            columns: Vec::new(),
            weights: Vec::new(),
        };
        for row in rows {
            for (column, weight) in row {
                out.columns.push(column);
                out.weights.push(weight);
            }
            out.start.push(out.columns.len() as u32);
        }
        out
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.start.len() - 1
    }

    /// Fills `block` `[_, columns]` with the products of the rows from `first` on and `values`
    /// `[_, columns]`.
    pub(crate) fn take_up(&self, first: usize, values: &[f32], columns: usize, block: &mut [f32]) {
        vectorised(|| {
            for (at, row) in block.chunks_exact_mut(columns).enumerate() {
                let entries = self.entries(first + at);
                let rest = take_up_by::<32>(entries, values, columns, row);
                let rest = take_up_by::<8>(entries, values, columns, rest);
                let rest = take_up_by::<4>(entries, values, columns, rest);
                take_up_by::<1>(entries, values, columns, rest);
            }
        });
    }

    /// The starts of the rows `[V + 1]`, and the columns and weights of all entries.
    pub(crate) fn parts(&self) -> (&[u32], &[u32], &[f32]) {
        (&self.start, &self.columns, &self.weights)
    }

    /// Builds a matrix from its parts. `None` where they contradict each other or a column is not
    /// below `limit`.
    pub(crate) fn of_parts(
        (start, columns, weights): (Vec<u32>, Vec<u32>, Vec<f32>),
        limit: usize,
    ) -> Option<Prolongation> {
        let ends = start.first() == Some(&0)
            && start.last() == u32::try_from(columns.len()).ok().as_ref()
            && start.is_sorted()
            && columns.len() == weights.len();
        let reach = columns.iter().all(|&column| (column as usize) < limit);
        (ends && reach).then_some(Prolongation {
            start,
            columns,
            weights,
        })
    }

    /// The proxy's vertices that a vertex depends on, and by how much.
    pub fn row(&self, v: u32) -> impl Iterator<Item = (u32, f32)> + '_ {
        let (columns, weights) = self.entries(v as usize);
        columns.iter().copied().zip(weights.iter().copied())
    }

    #[inline(always)]
    fn entries(&self, v: usize) -> (&[u32], &[f32]) {
        let range = self.start[v] as usize..self.start[v + 1] as usize;
        (&self.columns[range.clone()], &self.weights[range])
    }
}

/// Fills `unfilled`, the last columns of a vertex, `W` at a time. Returns the columns that are
/// left. The sums stay in registers until all entries are added.
#[inline(always)]
fn take_up_by<'a, const W: usize>(
    (rows, weights): (&[u32], &[f32]),
    values: &[f32],
    columns: usize,
    unfilled: &'a mut [f32],
) -> &'a mut [f32] {
    let mut first = columns - unfilled.len();
    let (tiles, rest) = unfilled.as_chunks_mut::<W>();
    for tile in tiles {
        let mut sum = [0.0; W];
        for i in 0..rows.len() {
            let from = &values[rows[i] as usize * columns + first..][..W];
            for j in 0..W {
                sum[j] += weights[i] * from[j];
            }
        }
        *tile = sum;
        first += W;
    }
    rest
}

/// Finds every vertex's place on the proxy. Also returns the largest distance from it.
pub(super) fn place_vertices(
    positions: &[DVec3],
    skin: &[[u32; 3]],
    simple: &Simplified,
) -> (Prolongation, f64) {
    let mut is_skin = vec![false; positions.len()];
    skin.iter()
        .flatten()
        .for_each(|&v| is_skin[v as usize] = true);
    let coarse = Coarse::new(positions, &simple.triangles);
    let around = Rings::of(positions.len(), skin);
    let place = |v: usize| match (is_skin[v], simple.stands_for[v]) {
        (false, _) => (Vec::new(), 0.0),
        (true, root) if root == v as u32 => (vec![(root, 1.0)], 0.0),
        (true, root) => {
            let normal = normal(positions, skin, &around, v as u32);
            coarse.row(positions[v], normal, root)
        }
    };
    let mut error = 0.0f64;
    let blocks = (0..positions.len())
        .step_by(ROWS_AT_ONCE)
        .flat_map(|first| {
            let last = (first + ROWS_AT_ONCE).min(positions.len());
            let rows: Vec<_> = (first..last).into_par_iter().map(place).collect();
            rows
        });
    let rows = blocks.map(|(row, distance)| {
        error = error.max(distance);
        row
    });
    (Prolongation::from_rows(rows), error)
}

/// The proxy and the neighbours of its vertices.
struct Coarse<'a> {
    positions: &'a [DVec3],
    triangles: &'a [[u32; 3]],
    rings: Rings,
    /// `[V]`: for each vertex of the proxy its neighbours, each with its coefficient `c` in the
    /// gradient `g = Σ c (f_neighbour − f)`.
    gradients: Vec<Vec<(u32, DVec3)>>,
}

impl<'a> Coarse<'a> {
    fn new(positions: &'a [DVec3], triangles: &'a [[u32; 3]]) -> Self {
        let rings = Rings::of(positions.len(), triangles);
        let gradients = (0..positions.len() as u32)
            .into_par_iter()
            .map(|v| gradient(positions, triangles, &rings, v))
            .collect();
        Coarse {
            positions,
            triangles,
            rings,
            gradients,
        }
    }

    /// Columns and weights of a vertex at `point` with `normal` that was collapsed into `root`, and
    /// its distance from the proxy.
    fn row(&self, point: DVec3, normal: DVec3, root: u32) -> (Vec<(u32, f32)>, f64) {
        let Some((triangle, barycentric)) = self.closest(point, normal, root) else {
            return (
                vec![(root, 1.0)],
                point.distance(self.positions[root as usize]),
            );
        };
        let corners = self.triangles[triangle].map(|v| self.positions[v as usize]);
        let distance = point.distance(blend(corners, barycentric));
        let mut row: Vec<(u32, f32)> = Vec::with_capacity(16);
        let mut add =
            |column: u32, weight: f64| match row.iter_mut().find(|entry| entry.0 == column) {
                Some(entry) => entry.1 += weight as f32,
                None => row.push((column, weight as f32)),
            };
        for (&corner, b) in self.triangles[triangle].iter().zip(barycentric) {
            let offset = point - self.positions[corner as usize];
            let mut share = b;
            for &(other, part) in &self.gradients[corner as usize] {
                let weight = 0.5 * b * part.dot(offset);
                share -= weight;
                add(other, weight);
            }
            add(corner, share);
        }
        (row, distance)
    }

    /// Walks from `root` to the closest triangle. Returns it with the weights of its corners.
    fn closest(&self, point: DVec3, normal: DVec3, root: u32) -> Option<(usize, [f64; 3])> {
        let mut best: Option<(f64, usize, [f64; 3])> = None;
        let mut at = root;
        for _ in 0..MAX_STEPS {
            let mut improved = false;
            for &f in self.rings.faces(at) {
                let corners = self.triangles[f as usize].map(|v| self.positions[v as usize]);
                let barycentric = closest_weights(point, corners);
                let away = point.distance_squared(blend(corners, barycentric));
                let [a, b, c] = corners;
                let facing = unit((b - a).cross(c - a)).dot(normal);
                let squared = away + FOLD_CM * FOLD_CM * (1.0 - facing);
                if best.is_none_or(|b| squared < b.0) {
                    best = Some((squared, f as usize, barycentric));
                    improved = true;
                }
            }
            let (_, f, weights) = best?;
            let heaviest = (0..3).max_by(|&i, &j| weights[i].total_cmp(&weights[j]))?;
            let next = self.triangles[f][heaviest];
            if !improved || next == at {
                break;
            }
            at = next;
        }
        best.map(|(_, f, weights)| (f, weights))
    }
}

/// Least-squares gradient in the tangent plane. Offsets keep their length when they are projected
/// into it.
fn gradient(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    rings: &Rings,
    v: u32,
) -> Vec<(u32, DVec3)> {
    let (x, y) = perpendicular(normal(positions, triangles, rings, v));
    let flat: Vec<(u32, [f64; 2])> = rings
        .neighbours(v, triangles)
        .into_iter()
        .filter_map(|(other, _)| {
            let offset = positions[other as usize] - positions[v as usize];
            let (u, w) = (offset.dot(x), offset.dot(y));
            let stretch = offset.length() / u.hypot(w);
            stretch
                .is_finite()
                .then_some((other, [stretch * u, stretch * w]))
        })
        .collect();
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (_, [u, w]) in &flat {
        let weight = 1.0 / (u * u + w * w);
        xx += weight * u * u;
        xy += weight * u * w;
        yy += weight * w * w;
    }
    let ridge = RIDGE * (xx + yy) + f64::MIN_POSITIVE;
    let (xx, yy) = (xx + ridge, yy + ridge);
    let determinant = xx * yy - xy * xy;
    flat.into_iter()
        .map(|(other, [u, w])| {
            let weight = 1.0 / (u * u + w * w);
            let gu = weight * (yy * u - xy * w) / determinant;
            let gw = weight * (xx * w - xy * u) / determinant;
            (other, gu * x + gw * y)
        })
        .collect()
}

/// Unit normal of a vertex: the normals around it, weighted by area.
fn normal(positions: &[DVec3], triangles: &[[u32; 3]], rings: &Rings, v: u32) -> DVec3 {
    let mut normal = DVec3::ZERO;
    for &f in rings.faces(v) {
        let [a, b, c] = triangles[f as usize].map(|v| positions[v as usize]);
        normal += (b - a).cross(c - a);
    }
    unit(normal)
}
