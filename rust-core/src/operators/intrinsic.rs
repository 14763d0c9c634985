//! A surface given by its edge lengths alone, and its intrinsic Delaunay triangulation by flips.
//!
//! Sharp, Soliman and Crane 2019, "Navigating intrinsic triangulations"; the glued triangle lists
//! follow N. Sharp's tutorial on non-manifold Laplacians. A triangle may be glued to itself, and two
//! triangles may share several edges (a Δ-complex), because the tufted cover needs that.

use std::collections::VecDeque;

/// The twin of a side that is not glued.
pub(crate) const NONE: u32 = u32::MAX;

/// An edge is flipped if the mean of the two opposite cotangents is below minus this.
const DELAUNAY_SLACK: f64 = 1e-6;

/// Flipping stops after this many flips per side, because rounding could make it go round in
/// circles. The mesh is valid at any time, so stopping early costs quality and nothing else.
const MAX_FLIPS_PER_SIDE: usize = 20;

/// A triangulated surface without boundary, given by its edge lengths. Side `3 f + s` runs from
/// corner `s` of triangle `f` to its next corner.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Intrinsic {
    /// `[3 F]`, the vertex at which each side starts.
    pub tail: Vec<u32>,
    /// `[3 F]`, length of each side, mesh units.
    pub length: Vec<f64>,
    /// `[3 F]`, the side that each side is glued to, which runs the other way.
    pub twin: Vec<u32>,
}

/// The side after `side` in its triangle.
pub(crate) fn next(side: usize) -> usize {
    if side % 3 == 2 { side - 2 } else { side + 1 }
}

/// Area of a triangle with these sides, by Kahan's stable form of Heron's formula; zero if no such
/// triangle exists.
pub(crate) fn area(mut l: [f64; 3]) -> f64 {
    l.sort_unstable_by(|x, y| y.total_cmp(x));
    let [a, b, c] = l;
    let squared = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
    0.25 * squared.max(0.0).sqrt()
}

impl Intrinsic {
    pub fn triangle_count(&self) -> usize {
        self.tail.len() / 3
    }

    /// Lengths of the three sides of triangle `f`.
    pub fn lengths(&self, f: usize) -> [f64; 3] {
        [
            self.length[3 * f],
            self.length[3 * f + 1],
            self.length[3 * f + 2],
        ]
    }

    /// Vertices of triangle `f`.
    pub fn corners(&self, f: usize) -> [u32; 3] {
        [self.tail[3 * f], self.tail[3 * f + 1], self.tail[3 * f + 2]]
    }

    /// Cotangent of the angle opposite each side of triangle `f`. They are huge but finite for a
    /// triangle without area.
    pub fn cotangents(&self, f: usize) -> [f64; 3] {
        let l = self.lengths(f);
        let squared = l.map(|x| x * x);
        let sum: f64 = squared.iter().sum();
        let area = area(l).max(1e-12 * sum).max(f64::MIN_POSITIVE);
        [0, 1, 2].map(|s| (sum - 2.0 * squared[s]) / (4.0 * area))
    }

    fn cotangent(&self, side: usize) -> f64 {
        self.cotangents(side / 3)[side % 3]
    }

    /// Flips edges until every pair of triangles is Delaunay. Returns the number of flips.
    pub fn flip_to_delaunay(&mut self) -> usize {
        let sides = self.tail.len();
        let mut queue: VecDeque<u32> = (0..sides as u32).collect();
        let mut waiting = vec![true; sides];
        let mut flips = 0;
        while let Some(side) = queue.pop_front() {
            let side = side as usize;
            waiting[side] = false;
            if self.is_delaunay(side) || !self.flip(side) {
                continue;
            }
            flips += 1;
            if flips > MAX_FLIPS_PER_SIDE * sides {
                tracing::warn!(flips, "intrinsic Delaunay flips stopped early");
                break;
            }
            for s in [side / 3, self.twin_triangle(side)]
                .iter()
                .flat_map(|f| [3 * f, 3 * f + 1, 3 * f + 2])
            {
                if !waiting[s] {
                    waiting[s] = true;
                    queue.push_back(s as u32);
                }
            }
        }
        flips
    }

    /// The other triangle at the diagonal that a flip of `side` made. The new diagonal is side 1 of
    /// both triangles.
    fn twin_triangle(&self, side: usize) -> usize {
        self.twin[3 * (side / 3) + 1] as usize / 3
    }

    fn is_delaunay(&self, side: usize) -> bool {
        let twin = self.twin[side];
        if twin == NONE || twin as usize == side {
            return true;
        }
        let sum = self.cotangent(side) + self.cotangent(twin as usize);
        0.5 * sum >= -DELAUNAY_SLACK
    }

    /// Swaps the diagonal of the two triangles beside `side`. Returns `false` if that is impossible.
    fn flip(&mut self, side: usize) -> bool {
        let other = self.twin[side] as usize;
        let (f, g) = (side / 3, other / 3);
        if f == g {
            return false;
        }
        let Some(diagonal) = self.other_diagonal(side, other) else {
            return false;
        };
        // f was (a, b, p) and g was (b, a, q). They become (a, q, p) and (b, p, q).
        let outer = [next(other), next(next(side)), next(side), next(next(other))];
        let places = [3 * f, 3 * f + 2, 3 * g, 3 * g + 2];
        let [aq, pa, bp, qb] = outer.map(|s| (self.tail[s], self.length[s], self.twin[s]));
        let diagonals = [(qb.0, diagonal, 3 * g + 1), (pa.0, diagonal, 3 * f + 1)];
        for (place, old) in places.into_iter().zip([aq, pa, bp, qb]) {
            let moved = outer.iter().position(|&s| s as u32 == old.2);
            let twin = moved.map_or(old.2, |at| places[at] as u32);
            (self.tail[place], self.length[place], self.twin[place]) = (old.0, old.1, twin);
        }
        for place in places {
            let twin = self.twin[place];
            if twin != NONE {
                self.twin[twin as usize] = place as u32;
            }
        }
        for (place, (tail, length, twin)) in [3 * f + 1, 3 * g + 1].into_iter().zip(diagonals) {
            (self.tail[place], self.length[place], self.twin[place]) = (tail, length, twin as u32);
        }
        true
    }

    /// Length of the other diagonal when both triangles lie flat; `None` unless it is finite and
    /// positive.
    fn other_diagonal(&self, side: usize, other: usize) -> Option<f64> {
        let l = |s: usize| self.length[s];
        let base = l(side);
        let p = apex(base, l(next(side)), l(next(next(side))));
        let q = apex(base, l(next(next(other))), l(next(other)));
        let diagonal = (p[0] - q[0]).hypot(p[1] + q[1]);
        (diagonal.is_finite() && diagonal > 0.0).then_some(diagonal)
    }
}

/// Third corner of a triangle with corners (0, 0) and (`base`, 0). It lies above the axis, at
/// distance `far` from the first corner and `near` from the second.
pub(crate) fn apex(base: f64, near: f64, far: f64) -> [f64; 2] {
    let x = (base * base + (far - near) * (far + near)) / (2.0 * base);
    let y = 2.0 * area([base, near, far]) / base;
    [x, y]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn area_survives_needles() {
        assert!((area([3.0, 4.0, 5.0]) - 6.0).abs() < 1e-15);
        // Heron's plain formula returns 0 here.
        let needle = area([1.0, 1.0, 1e-12]);
        assert!((needle - 5e-13).abs() < 1e-18, "{needle}");
        assert_eq!(area([1.0, 0.2, 0.3]), 0.0);
    }

    #[test]
    fn flip_of_a_flat_kite_takes_the_short_diagonal() {
        // a (0,0), b (4,0), p (2,1), q (2,-1): the diagonal ab is not Delaunay, pq is.
        let s = 5f64.sqrt();
        let mut kite = Intrinsic {
            tail: vec![0, 1, 2, 1, 0, 3],
            length: vec![4.0, s, s, 4.0, s, s],
            twin: vec![3, NONE, NONE, 0, NONE, NONE],
        };
        assert_eq!(kite.flip_to_delaunay(), 1);
        assert_eq!(kite.corners(0), [0, 3, 2]);
        assert_eq!(kite.corners(1), [1, 2, 3]);
        assert_eq!(kite.twin, [NONE, 4, NONE, NONE, 1, NONE]);
        assert!((kite.length[1] - 2.0).abs() < 1e-12);
        let total: f64 = (0..2).map(|f| area(kite.lengths(f))).sum();
        assert!((total - 4.0).abs() < 1e-12);
    }
}
