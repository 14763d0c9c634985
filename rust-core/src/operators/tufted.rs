//! The tufted cover: turns any triangle soup into a closed surface with two faces at every edge.
//!
//! Sharp and Crane 2020, "A Laplacian for nonmanifold triangle meshes". Every face becomes two
//! sheets, a front and a back. Around each edge, neighbouring faces are glued by the two sheets
//! that look at each other. At a boundary edge, a face is glued to its own back.
//! The conventions (edge-length mollification relative to the mean edge, angular order around an
//! edge) are those of geometry-central and the Python package `robust_laplacian`.

use glam::DVec3;

use super::intrinsic::{Intrinsic, NONE};
use crate::mesh::direction::{perpendicular, unit};

/// A face beside an edge.
#[derive(Clone, Copy)]
struct Wing {
    /// Edge as (smaller vertex, larger vertex).
    edge: (u32, u32),
    /// Side `3 f + s` of the input.
    side: u32,
}

/// Builds the tufted cover of `triangles` (no repeated corners) with mollified edge lengths.
/// `mollify`: share of the mean edge length by which the triangle inequalities become strict.
pub(crate) fn cover(positions: &[DVec3], triangles: &[[u32; 3]], mollify: f64) -> Intrinsic {
    let wings = sorted_wings(triangles);
    let mut cover = sheets(triangles);
    let mut begin = 0;
    while begin < wings.len() {
        let edge = wings[begin].edge;
        let count = wings[begin..].iter().take_while(|w| w.edge == edge).count();
        let mut around = wings[begin..begin + count].to_vec();
        if count > 2 {
            sort_by_angle(&mut around, positions, triangles);
        }
        let length = positions[edge.0 as usize].distance(positions[edge.1 as usize]);
        glue(&mut cover, &around, length);
        begin += count;
    }
    let edges = 1 + wings.windows(2).filter(|w| w[0].edge != w[1].edge).count();
    mollify_lengths(&mut cover, &wings, edges, mollify);
    cover
}

fn sorted_wings(triangles: &[[u32; 3]]) -> Vec<Wing> {
    let mut wings = Vec::with_capacity(3 * triangles.len());
    for (f, t) in triangles.iter().enumerate() {
        for s in 0..3 {
            let (a, b) = (t[s], t[(s + 1) % 3]);
            let edge = (a.min(b), a.max(b));
            wings.push(Wing {
                edge,
                side: (3 * f + s) as u32,
            });
        }
    }
    wings.sort_unstable_by_key(|w| (w.edge, w.side));
    wings
}

/// The sheets of all faces, not glued yet: the front of face `f` at `2 f`, its back at `2 f + 1`.
fn sheets(triangles: &[[u32; 3]]) -> Intrinsic {
    let tail: Vec<u32> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [a, b, c, a, c, b])
        .collect();
    Intrinsic {
        length: vec![0.0; tail.len()],
        twin: vec![NONE; tail.len()],
        tail,
    }
}

/// The sides of the front sheet and of the back sheet that come from input side `side`.
fn sheet_sides(side: u32) -> (u32, u32) {
    let (f, s) = (side / 3, side % 3);
    (6 * f + s, 6 * f + 3 + (2 - s))
}

/// Glues the sheets around one edge, given in angular order.
fn glue(cover: &mut Intrinsic, around: &[Wing], length: f64) {
    // If a sheet's side runs in the direction of the edge, the sheet looks towards growing angles.
    let (mut up, mut down) = (Vec::new(), Vec::new());
    for wing in around {
        let (front, back) = sheet_sides(wing.side);
        let forward = cover.tail[front as usize] == wing.edge.0;
        up.push(if forward { front } else { back });
        down.push(if forward { back } else { front });
    }
    for i in 0..around.len() {
        let (a, b) = (up[i], down[(i + 1) % around.len()]);
        (cover.twin[a as usize], cover.twin[b as usize]) = (b, a);
        (cover.length[a as usize], cover.length[b as usize]) = (length, length);
    }
}

fn sort_by_angle(around: &mut [Wing], positions: &[DVec3], triangles: &[[u32; 3]]) {
    let (a, b) = around[0].edge;
    let origin = positions[a as usize];
    let axis = unit(positions[b as usize] - origin);
    let (x, y) = perpendicular(axis);
    let angle = |wing: &Wing| {
        let opposite = triangles[wing.side as usize / 3][(wing.side as usize + 2) % 3];
        let d = positions[opposite as usize] - origin;
        d.dot(y).atan2(d.dot(x))
    };
    around.sort_by(|p, q| angle(p).total_cmp(&angle(q)));
}

/// Adds the same length to every edge: the least that makes all triangle inequalities strict by
/// `mollify` times the mean edge length.
fn mollify_lengths(cover: &mut Intrinsic, wings: &[Wing], edges: usize, mollify: f64) {
    let length = |w: &Wing| cover.length[sheet_sides(w.side).0 as usize];
    let mut sum = 0.0;
    for (i, wing) in wings.iter().enumerate() {
        if i == 0 || wings[i - 1].edge != wing.edge {
            sum += length(wing);
        }
    }
    let slack = mollify * sum / edges.max(1) as f64;
    let mut grow = 0f64;
    for f in 0..cover.triangle_count() / 2 {
        let [a, b, c] = cover.lengths(2 * f);
        for (long, p, q) in [(a, b, c), (b, c, a), (c, a, b)] {
            grow = grow.max(long - p - q + slack);
        }
    }
    for length in &mut cover.length {
        *length += grow;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_side_of_a_nonmanifold_fan_is_glued_both_ways() {
        // Three triangles share an edge, one of them turned over. A fourth only touches two vertices.
        let positions = [
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0],
            [1.0, 0.0, 0.5],
            [-1.0, 1.0, 0.5],
            [-1.0, -1.0, 0.5],
            [5.0, 5.0, 5.0],
        ]
        .map(DVec3::from);
        let triangles = [[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 3, 5]];
        let cover = cover(&positions, &triangles, 0.0);
        for side in 0..cover.tail.len() {
            let twin = cover.twin[side] as usize;
            assert_eq!(cover.twin[twin] as usize, side);
            assert_ne!(twin, side);
            assert_eq!(cover.length[twin], cover.length[side]);
            let head = |s: usize| cover.tail[super::super::intrinsic::next(s)];
            assert_eq!(
                (cover.tail[side], head(side)),
                (head(twin), cover.tail[twin])
            );
        }
    }

    #[test]
    fn mollification_makes_a_collapsed_triangle_proper() {
        let positions = [0.0, 1.0, 0.5].map(|x| DVec3::X * x);
        let cover = cover(&positions, &[[0, 1, 2]], 1e-5);
        let [a, b, c] = cover.lengths(0);
        let mean = 2.0 / 3.0;
        assert!((b + c - a - 1e-5 * mean).abs() < 1e-15, "{a} {b} {c}");
    }
}
