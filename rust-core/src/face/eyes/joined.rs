//! Decides whether lids and eye are one surface. If so, there is no slit between them, and a lid
//! that moved would drag the eye along.
//!
//! On a movable lid, the skin runs from the edge back along the lining and meets the eye only deep
//! in the socket. If lids and eye are one, the surface continues from triangle to triangle at the
//! edge, in plain sight.

use std::collections::{HashMap, HashSet};

use glam::Vec3;

use crate::{face::nearest::nearest_between, mesh::depth_at};

/// The surface is followed this far above the edge of the upper lid and at most this far below it,
/// in widths of the eye.
const BESIDE: f32 = 0.15;
/// Number of steps in which the surface is followed.
const STEPS: usize = 40;
/// The surface connects two neighbouring places if triangles between them share edges nearer than
/// this to the line from one to the other, in widths of the eye.
const TUBE: f32 = 0.04;
/// Each step is divided into this many parts. The distance from an edge is measured at their ends.
const PLACES: usize = 4;
/// Lids count as joined if the surface continues at this share of the places in the middle half of
/// their edge.
const SHARE: f32 = 0.5;

/// Triangles of the skin in the frame of an eye.
struct Surface<'a> {
    triangles: &'a [[[f32; 3]; 3]],
    /// The triangles at each edge.
    beside: HashMap<Edge, Vec<u32>>,
}

/// Both ends of an edge, by the bits of their coordinates. In scans each triangle may have its own
/// copies of its corners.
type Edge = [[u32; 3]; 2];

/// Whether the skin continues without a break from the upper lid to the eye. `skin`: triangles in
/// the frame of an eye of this `width`. `upper`, `lower`: edges of the lids from corner to corner.
pub(super) fn are_joined(
    skin: &[[[f32; 3]; 3]],
    upper: &[[f32; 3]],
    lower: &[[f32; 3]],
    width: f32,
) -> bool {
    let surface = Surface::of(skin);
    let inner = upper.len() / 4..upper.len() - upper.len() / 4;
    let joined = inner.clone().filter(|&k| {
        let [x, y, _] = upper[k];
        let below = (BESIDE * width).min(0.5 * (y - lower[k][1]));
        surface.goes_on([x, y + BESIDE * width], [x, y - below], TUBE * width)
    });
    joined.count() as f32 >= SHARE * inner.len() as f32
}

impl Surface<'_> {
    fn of(triangles: &[[[f32; 3]; 3]]) -> Surface<'_> {
        let mut beside: HashMap<Edge, Vec<u32>> = HashMap::new();
        for (number, corners) in triangles.iter().enumerate() {
            for edge in edges(corners) {
                let key = edge_key(edge);
                beside.entry(key).or_default().push(number as u32);
            }
        }
        Surface { triangles, beside }
    }

    /// Whether the surface visible at `above` continues to the surface visible at `below`.
    fn goes_on(&self, above: [f32; 2], below: [f32; 2], tube: f32) -> bool {
        let column: Vec<u32> = (0..self.triangles.len() as u32)
            .filter(|&t| {
                let x = self.triangles[t as usize].map(|p| p[0]);
                let low = x.into_iter().fold(f32::INFINITY, f32::min);
                let high = x.into_iter().fold(f32::NEG_INFINITY, f32::max);
                (low..=high).contains(&above[0])
            })
            .collect();
        let at = |step: usize| {
            let share = step as f32 / STEPS as f32;
            self.foremost(
                &column,
                [above[0], above[1] + share * (below[1] - above[1])],
            )
        };
        let places: Option<Vec<_>> = (0..=STEPS).map(at).collect();
        places.is_some_and(|places| {
            places
                .windows(2)
                .all(|ends| self.meet(ends[0], ends[1], tube))
        })
    }

    /// The foremost of the triangles `among` at `[x, y]`, and its point there.
    fn foremost(&self, among: &[u32], [x, y]: [f32; 2]) -> Option<(u32, Vec3)> {
        let depths = among.iter().filter_map(|&t| {
            let depth = depth_at(&self.triangles[t as usize], [x, y])?;
            Some((t, depth))
        });
        let (t, z) = depths.max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some((t, Vec3::new(x, y, z)))
    }

    /// Whether a chain of triangles connects `from` and `to` across edges near the line from `p` to
    /// `q`.
    fn meet(&self, (from, p): (u32, Vec3), (to, q): (u32, Vec3), tube: f32) -> bool {
        let is_near = |[a, b]: [[f32; 3]; 2]| {
            (0..=PLACES).any(|k| {
                let place = p.lerp(q, k as f32 / PLACES as f32);
                nearest_between(place, a.into(), b.into()).distance(place) < tube
            })
        };
        let (mut known, mut open) = (HashSet::from([from]), vec![from]);
        while let Some(triangle) = open.pop() {
            if triangle == to {
                return true;
            }
            for edge in edges(&self.triangles[triangle as usize]) {
                if is_near(edge) {
                    let beside = self.beside[&edge_key(edge)].iter();
                    open.extend(beside.filter(|&&next| known.insert(next)));
                }
            }
        }
        false
    }
}

fn edges([a, b, c]: &[[f32; 3]; 3]) -> [[[f32; 3]; 2]; 3] {
    [[*a, *b], [*b, *c], [*c, *a]]
}

fn edge_key(ends: [[f32; 3]; 2]) -> Edge {
    let mut key = ends.map(|p| p.map(f32::to_bits));
    key.sort_unstable();
    key
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet that extends along x and has a folded `profile` in (y, z).
    fn sheet(profile: &[[f32; 2]]) -> Vec<[[f32; 3]; 3]> {
        let strip = |ends: &[[f32; 2]]| {
            let corner = |x: f32, [y, z]: [f32; 2]| [x, y, z];
            let [a, b, c, d] = [
                corner(-2.0, ends[0]),
                corner(2.0, ends[0]),
                corner(2.0, ends[1]),
                corner(-2.0, ends[1]),
            ];
            [[a, b, c], [a, c, d]]
        };
        profile.windows(2).flat_map(strip).collect()
    }

    /// Whether a sheet is joined to an eye that is 3 wide and 1 high.
    fn joins(sheet: &[[[f32; 3]; 3]]) -> bool {
        let edge = |y: f32| -> Vec<[f32; 3]> {
            (0..24).map(|k| [-1.5 + k as f32 / 8.0, y, 0.2]).collect()
        };
        are_joined(sheet, &edge(0.5), &edge(-0.5), 3.0)
    }

    #[test]
    fn a_crease_is_no_slit_and_a_lid_with_a_lining_has_one() {
        let crease = sheet(&[[2.0, 0.3], [0.5, 0.3], [0.45, 0.0], [-2.0, 0.0]]);
        assert!(joins(&crease));
        let lined = [[2.0, 0.3], [0.5, 0.3], [0.45, 0.2], [1.5, 0.1], [1.5, -0.1]];
        let lined = sheet(&[&lined[..], &[[-2.0, 0.0]]].concat());
        assert!(!joins(&lined));
        let mut apart = sheet(&[[2.0, 0.3], [0.5, 0.3]]);
        apart.extend(sheet(&[[1.5, 0.0], [-2.0, 0.0]]));
        assert!(!joins(&apart));
    }

    #[test]
    fn landmarks_a_little_beside_the_edge_find_it_all_the_same() {
        let edge = |off: f32| {
            let lid = [[2.0, 0.3], [0.5 + off, 0.3], [0.45 + off, 0.2], [1.5, 0.1]];
            sheet(&[&lid[..], &[[1.5, -0.1], [-2.0, 0.0]]].concat())
        };
        for off in [-0.3, 0.3] {
            assert!(!joins(&edge(off)), "{off}");
        }
    }
}
