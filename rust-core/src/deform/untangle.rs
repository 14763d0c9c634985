//! Keeps the skin around the eyes from turning inside out.
//!
//! Lids, brows and cheeks each follow their own landmarks. Where two of them squeeze a few
//! triangles, these turn over and the skin shows folds. This module looks for such triangles in
//! every frame and evens out the displacements of their corners.
//!
//! Once: all skin triangles near the lids' landmarks provide vertices and neighbours. Of these
//! triangles, the module watches only those that are visible from the front and face forward. Rims
//! of lids roll, and the linings behind them fold, as they should.
//!
//! In each frame, up to [`ROUNDS`] times ([`Untangle::apply`]):
//! 1. For each watched triangle, the cosine between its normal and its normal at rest tells how far
//!    it has turned. Its corners give way by a share that grows from 0 to 1 between the two cosines
//!    of [`TURN`].
//! 2. Every vertex that gives way moves towards the mean displacement of its neighbours, by
//!    [`RATE`] times its share. All vertices use the displacements from before the round, so that
//!    their order does not matter.
//! 3. The rounds end as soon as no triangle has turned past the first of these cosines.
//!
//! Nearly all frames have no folds. Such a frame costs one pass over the watched triangles, without
//! roots or divisions. A frame with folds costs up to [`ROUNDS`] passes.
//!
//! Not obvious: the module evens out displacements and not positions, so that the sculpted shape of
//! the lids stays. Each triangle is compared with itself at rest, so the order of its corners does
//! not matter. The share begins at 0, so a correction never begins with a jump in time. The edges
//! of the lids never give way, because `eyelids` has just put them where they meet.
//!
//! What can go wrong: a fold may remain after the last round, for example between two edges that
//! never give way. The frame then keeps it. A triangle that collapses to a line has no normal. It
//! counts as turned by a right angle and gives way by half.
//!
//! Lengths are canonical centimetres.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::{
    face::FaceSurface,
    mesh::{FrontView, ibug::LIDS},
};

/// Triangles count as near if their centres lie within this distance of a landmark of a lid, in
/// widths of the eyes.
const NEAR: f32 = 1.2;
/// Triangles whose normals face forward by less than this belong to the rims of the lids, which may
/// roll.
const LEAST_FRONT: f32 = 0.25;
/// A triangle this far behind another one, seen from the front, is an inner lining.
const BEFORE_CM: f32 = 0.05;
/// Columns of the depth image that finds linings.
const CELLS: f32 = 700.0;
/// Cosines of the turn at which a triangle begins to give way, and at which it gives way fully.
const TURN: (f32, f32) = (0.1, -0.1);
/// The most rounds in a frame.
const ROUNDS: usize = 16;
/// Share of the way to the mean of its neighbours that a vertex goes at most in one round.
const RATE: f32 = 0.7;

/// The watched skin of one mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Untangle {
    /// Vertices of the mesh, and the neighbours of each among them.
    vertices: Vec<u32>,
    neighbours: Vec<Vec<u32>>,
    /// Whether a vertex lies on the edge of a lid.
    is_edge: Vec<bool>,
    /// Rest positions, mesh units.
    places: Vec<[f32; 3]>,
    /// Corners as indices into `vertices`, and twice the area at rest as a vector.
    triangles: Vec<([u32; 3], [f32; 3])>,
    /// Vertices of the mesh that share a position with one of these, and the index of that one.
    copies: Vec<(u32, u32)>,
}

impl Untangle {
    /// Prepares the skin around the eyes. `positions`: of the mesh, `[V]`. `edges`: vertices that
    /// stay where the lids put them.
    pub(super) fn new(surface: &FaceSurface, positions: &[[f32; 3]], edges: &[u32]) -> Untangle {
        let (at, marks) = (&surface.positions, &surface.landmarks);
        let apart = |a: usize, b: usize| Vec3::from(marks[a]).distance(marks[b].into());
        let reach = NEAR * 0.5 * (apart(36, 39) + apart(42, 45));
        let skin = &surface.skin;
        let near = |t: &&[u32; 3]| {
            let centre = t.iter().map(|&v| Vec3::from(at[v as usize])).sum::<Vec3>() / 3.0;
            LIDS.clone()
                .any(|n| centre.distance(marks[n].into()) < reach)
        };
        let near: Vec<[u32; 3]> = skin
            .surface
            .triangles
            .iter()
            .filter(near)
            .copied()
            .collect();
        let mut vertices: Vec<u32> = near.iter().flatten().copied().collect();
        vertices.sort_unstable();
        vertices.dedup();
        let number = |v: u32| vertices.binary_search(&v).ok().map(|k| k as u32);
        let numbered = |t: &[u32; 3]| Some([number(t[0])?, number(t[1])?, number(t[2])?]);
        let view = front_view(&near, surface, reach);
        let is_outer = |t: &&[u32; 3]| {
            let corners = t.map(|v| Vec3::from(at[v as usize]));
            let (normal, centre) = (area(corners), corners.into_iter().sum::<Vec3>() / 3.0);
            let [column, row] = view.cell_at([centre.x, centre.y]);
            let is_seen = centre.z > view.depth(column, row) - BEFORE_CM;
            is_seen && normal.z.abs() > LEAST_FRONT * normal.length()
        };
        let triangles = near.iter().filter(is_outer).filter_map(|t| {
            let rest = area(t.map(|v| positions[v as usize].into()));
            Some((numbered(t)?, rest.into()))
        });
        let triangles = triangles.collect();
        let copies = skin.sewn.iter().enumerate();
        let copies = copies.filter(|(v, of)| **of != *v as u32 && skin.is_skin[*v]);
        Untangle {
            copies: copies
                .filter_map(|(v, of)| Some((v as u32, number(*of)?)))
                .collect(),
            places: vertices.iter().map(|&v| positions[v as usize]).collect(),
            is_edge: vertices.iter().map(|v| edges.contains(v)).collect(),
            neighbours: neighbours(near.iter().filter_map(numbered), vertices.len()),
            triangles,
            vertices,
        }
    }

    /// Vertices of the mesh that this skin reads or moves.
    pub(super) fn vertices(&self) -> impl Iterator<Item = u32> {
        let copies = self.copies.iter().map(|(vertex, _)| *vertex);
        self.vertices.iter().copied().chain(copies)
    }

    /// The same skin on a reduced mesh. `new` gives the new number of a vertex that is left; every
    /// vertex of this skin must have one.
    pub(super) fn renumbered(&self, new: impl Fn(u32) -> Option<u32>) -> Untangle {
        let mut skin = self.clone();
        let copies = skin.copies.iter_mut().map(|(vertex, _)| vertex);
        for v in skin.vertices.iter_mut().chain(copies) {
            *v = new(*v).expect("the skin about the eyes is left");
        }
        skin
    }

    /// Corrects the displacements of a frame, `[V * 3]`, mesh units.
    pub(super) fn apply(&self, frame: &mut [f32]) {
        let of = |v: &u32| Vec3::from_slice(&frame[3 * *v as usize..][..3]);
        let mut moved: Vec<Vec3> = self.vertices.iter().map(of).collect();
        let mut gives = vec![0.0f32; moved.len()];
        let mut touched = false;
        for _ in 0..ROUNDS {
            if !self.look(&moved, &mut gives) {
                break;
            }
            touched = true;
            let before = moved.clone();
            for (v, &share) in gives.iter().enumerate().filter(|(_, share)| **share > 0.0) {
                let beside = self.neighbours[v].iter().map(|&n| before[n as usize]);
                let mean = beside.sum::<Vec3>() / self.neighbours[v].len().max(1) as f32;
                moved[v] = before[v].lerp(mean, RATE * share);
            }
        }
        if !touched {
            return;
        }
        let originals = self
            .vertices
            .iter()
            .zip(&moved)
            .map(|(v, moved)| (*v, *moved));
        let copies = self.copies.iter().map(|(v, of)| (*v, moved[*of as usize]));
        for (v, moved) in originals.chain(copies) {
            frame[3 * v as usize..][..3].copy_from_slice(&moved.to_array());
        }
    }

    /// Writes into `gives` the share by which each vertex gives way. Returns whether any triangle
    /// has turned too far.
    fn look(&self, moved: &[Vec3], gives: &mut [f32]) -> bool {
        gives.fill(0.0);
        let places: Vec<Vec3> = self
            .places
            .iter()
            .zip(moved)
            .map(|(place, moved)| Vec3::from(*place) + *moved)
            .collect();
        let (begins, full) = TURN;
        let mut any = false;
        for (t, rest) in &self.triangles {
            let rest = Vec3::from(*rest);
            let [a, b, c] = *t;
            let now = area([places[a as usize], places[b as usize], places[c as usize]]);
            let along = now.dot(rest);
            // Nearly all triangles have turned by less and need neither root nor division. Fourth
            // powers of lengths would leave single precision on meshes in tiny or huge units.
            let squares = f64::from(now.length_squared()) * f64::from(rest.length_squared());
            if along > 0.0 && f64::from(along).powi(2) > f64::from(begins).powi(2) * squares {
                continue;
            }
            let sizes = now.length() * rest.length();
            let turned = along / sizes.max(f32::MIN_POSITIVE);
            let share = ((turned - begins) / (full - begins)).clamp(0.0, 1.0);
            any |= share > 0.0;
            for &v in t.iter().filter(|v| !self.is_edge[**v as usize]) {
                gives[v as usize] = gives[v as usize].max(share);
            }
        }
        any
    }
}

/// For each of `count` vertices, the vertices that share a triangle with it, in rising order.
fn neighbours(triangles: impl Iterator<Item = [u32; 3]>, count: usize) -> Vec<Vec<u32>> {
    let mut neighbours = vec![Vec::new(); count];
    for t in triangles {
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            neighbours[t[a] as usize].push(t[b]);
            neighbours[t[b] as usize].push(t[a]);
        }
    }
    for list in &mut neighbours {
        list.sort_unstable();
        list.dedup();
    }
    neighbours
}

/// Depth image of the triangles at rest, seen from the front. It covers only `reach` around the
/// lids, because a single triangle may be as large as a house.
fn front_view(triangles: &[[u32; 3]], surface: &FaceSurface, reach: f32) -> FrontView {
    let mut bounds = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for mark in &surface.landmarks[LIDS] {
        for i in 0..2 {
            bounds.0[i] = bounds.0[i].min(mark[i] - reach);
            bounds.1[i] = bounds.1[i].max(mark[i] + reach);
        }
    }
    let width = bounds.1[0] - bounds.0[0];
    let mut view = FrontView::new(bounds.0, bounds.1, width / CELLS);
    for t in triangles {
        view.draw(t.map(|v| surface.positions[v as usize]), 1);
    }
    view
}

/// The normal, as long as twice the area.
#[inline]
fn area([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_gives_way_by_its_turn_in_any_unit() {
        for side in [1e-6f32, 1.0, 1e6] {
            let places = [[0.0, 0.0, 0.0], [side, 0.0, 0.0], [0.0, side, 0.0]];
            let skin = Untangle {
                vertices: vec![0, 1, 2],
                neighbours: vec![Vec::new(); 3],
                is_edge: vec![false; 3],
                places: places.to_vec(),
                triangles: vec![([0, 1, 2], area(places.map(Vec3::from)).into())],
                copies: Vec::new(),
            };
            // The third corner turns about the edge between the other two.
            for (angle, share) in [(0.0f32, 0.0), (90.0, 0.5), (180.0, 1.0)] {
                let (sine, cosine) = angle.to_radians().sin_cos();
                let corner = Vec3::new(0.0, side * (cosine - 1.0), side * sine);
                let mut gives = [0.0; 3];
                let any = skin.look(&[Vec3::ZERO, Vec3::ZERO, corner], &mut gives);
                assert_eq!(any, share > 0.0, "{side} {angle}");
                assert!((gives[2] - share).abs() < 1e-3, "{side} {angle} {gives:?}");
            }
        }
    }
}
