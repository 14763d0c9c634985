//! The 256 cases of marching cubes.
//!
//! The table is computed. On each face of a cell, a segment cuts off every run of inside corners,
//! and the segments join to loops. Two cells cut their common face in the same way, even if the
//! choice is ambiguous, so surfaces have no holes.

use std::{collections::HashMap, sync::LazyLock};

/// Corners of each face of a cell, counter-clockwise seen from outside. In the number of a corner,
/// bit 0 is x, bit 1 y, bit 2 z.
const FACES: [[usize; 4]; 6] = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
];

/// The triangles of each case, counter-clockwise seen from outside. A case has a bit for each
/// corner that is inside.
pub(super) static TABLE: LazyLock<Vec<Vec<[Edge; 3]>>> =
    LazyLock::new(|| (0..256).map(triangles_of).collect());

/// An edge of a cell as its two corners, the lower one first. They differ in one bit.
pub(super) type Edge = [usize; 2];

/// Finds the loops of one case and triangulates each as a fan.
fn triangles_of(case: usize) -> Vec<[Edge; 3]> {
    let inside = |corner: usize| case >> corner & 1 == 1;
    let mut next: HashMap<Edge, Edge> = HashMap::new();
    for face in FACES {
        let ends = |n: usize| [face[n % 4], face[(n + 1) % 4]];
        for enter in (0..4).filter(|n| !inside(ends(*n)[0]) && inside(ends(*n)[1])) {
            let leave = (enter + 1..enter + 4).find(|n| !inside(ends(*n)[1]));
            let leave = leave.expect("a run of inside corners ends");
            next.insert(edge(ends(enter)), edge(ends(leave)));
        }
    }
    let mut starts: Vec<Edge> = next.keys().copied().collect();
    starts.sort_unstable();
    let mut triangles = Vec::new();
    for start in starts {
        let mut around = Vec::new();
        let mut at = start;
        while let Some(to) = next.remove(&at) {
            around.push(at);
            at = to;
        }
        triangles.extend(fan(&around));
    }
    triangles
}

fn edge([a, b]: [usize; 2]) -> Edge {
    [a.min(b), a.max(b)]
}

/// Triangulates a loop as a fan from the vertex with the fewest diagonals in a face of the cell,
/// since in a face the neighbouring cell has its own edges.
fn fan(around: &[Edge]) -> Vec<[Edge; 3]> {
    let count = around.len();
    let fan_from = |first: usize| -> Vec<[Edge; 3]> {
        (1..count.saturating_sub(1))
            .map(|n| [first, first + n, first + n + 1].map(|k| around[k % count]))
            .collect()
    };
    let in_faces = |first: usize| {
        (2..count.saturating_sub(1))
            .filter(|n| share_a_face(around[first], around[(first + n) % count]))
            .count()
    };
    match (0..count).min_by_key(|first| in_faces(*first)) {
        Some(first) => fan_from(first),
        None => Vec::new(),
    }
}

fn share_a_face(a: Edge, b: Edge) -> bool {
    let lies_in = |face: &[usize; 4], edge: Edge| edge.iter().all(|corner| face.contains(corner));
    FACES
        .iter()
        .any(|face| lies_in(face, a) && lies_in(face, b))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use std::collections::{BTreeMap, BTreeSet};

    use super::*;

    /// One case of each of Lorensen and Cline's fifteen classes, and its number of triangles.
    const PRINTED: [(usize, usize); 15] = [
        (0b0000_0000, 0),
        (0b0000_0001, 1),
        (0b0000_0011, 2),
        (0b0000_1001, 2),
        (0b1000_0001, 2),
        (0b0000_0111, 3),
        (0b1000_0011, 3),
        (0b0001_0110, 3),
        (0b0000_1111, 2),
        (0b0001_0111, 4),
        (0b1001_1001, 4),
        (0b1000_1011, 4),
        (0b0001_1110, 4),
        (0b0110_1001, 4),
        (0b1000_1101, 4),
    ];

    /// The 24 turns of a cell. Each gives the place to which every corner moves.
    fn turns() -> Vec<[usize; 8]> {
        let mut turns = Vec::new();
        for axes in [
            [0, 1, 2],
            [1, 2, 0],
            [2, 0, 1],
            [0, 2, 1],
            [2, 1, 0],
            [1, 0, 2],
        ] {
            for flips in 0..8usize {
                let even = axes == [0, 1, 2] || axes == [1, 2, 0] || axes == [2, 0, 1];
                if even == flips.count_ones().is_multiple_of(2) {
                    turns.push(std::array::from_fn(|corner: usize| {
                        (0..3).fold(0, |to, axis| to | (corner >> axes[axis] & 1) << axis) ^ flips
                    }));
                }
            }
        }
        turns
    }

    fn turned(case: usize, turn: &[usize; 8]) -> usize {
        (0..8).fold(0, |to, corner| to | (case >> corner & 1) << turn[corner])
    }

    fn neighbours(a: usize, b: usize) -> bool {
        (a ^ b).is_power_of_two()
    }

    /// Inside corners that are connected along edges of the cell.
    fn pieces(case: usize) -> Vec<BTreeSet<usize>> {
        let mut left: BTreeSet<usize> = (0..8).filter(|c| case >> c & 1 == 1).collect();
        let mut pieces = Vec::new();
        while let Some(first) = left.pop_first() {
            let mut piece = BTreeSet::from([first]);
            while let Some(next) = left
                .iter()
                .copied()
                .find(|c| piece.iter().any(|p| neighbours(*p, *c)))
            {
                left.remove(&next);
                piece.insert(next);
            }
            pieces.push(piece);
        }
        pieces
    }

    #[test]
    fn a_cell_has_fifteen_cases_with_the_printed_triangles() {
        let turns = turns();
        assert_eq!(turns.iter().collect::<BTreeSet<_>>().len(), 24);
        let least = |case: usize| turns.iter().map(|turn| turned(case, turn)).min().unwrap();
        let printed: BTreeMap<usize, usize> = PRINTED
            .iter()
            .map(|(case, count)| (least(*case), *count))
            .collect();
        assert_eq!(printed.len(), 15);
        let mut met = BTreeSet::new();
        for case in 0..256usize {
            let few = if case.count_ones() <= 4 {
                case
            } else {
                255 - case
            };
            let class = [case, 255 - case]
                .map(least)
                .into_iter()
                .find(|c| printed.contains_key(c));
            let class = class.unwrap_or_else(|| panic!("{case:08b} is none of the fifteen"));
            met.insert(class);
            if case == few {
                assert_eq!(TABLE[case].len(), printed[&least(case)], "{case:08b}");
            }
        }
        assert_eq!(met.len(), 15);
    }

    /// The slow twin: if at most four corners are inside, one loop along all edges of a piece cuts
    /// it off.
    #[test]
    fn each_piece_of_a_cell_is_cut_off_along_its_own_edges() {
        for case in (0..256usize).filter(|case| case.count_ones() <= 4) {
            let cut = pieces(case).into_iter().map(|piece| {
                let in_piece = |corner: usize| piece.contains(&corner);
                (0..8)
                    .flat_map(|a| (a + 1..8).map(move |b| [a, b]))
                    .filter(|[a, b]| neighbours(*a, *b) && in_piece(*a) != in_piece(*b))
                    .collect::<BTreeSet<Edge>>()
            });
            for edges in cut {
                let of_piece: Vec<_> = TABLE[case]
                    .iter()
                    .filter(|t| t.iter().any(|e| edges.contains(e)))
                    .collect();
                let used: BTreeSet<Edge> =
                    of_piece.iter().flat_map(|t| t.iter().copied()).collect();
                assert_eq!(used, edges, "{case:08b}");
                assert_eq!(of_piece.len(), edges.len() - 2, "{case:08b}");
            }
        }
    }

    /// Triangles face away from the inside, if one corner is inside and if all but one are.
    #[test]
    fn triangles_face_outwards() {
        let middle =
            |[a, b]: Edge| [0, 1, 2].map(|axis| ((a >> axis & 1) + (b >> axis & 1)) as f64 / 2.0);
        for corner in 0..8usize {
            let place = [0, 1, 2].map(|axis| (corner >> axis & 1) as f64);
            for (case, sign) in [(1 << corner, 1.0), (255 - (1 << corner), -1.0)] {
                let [a, b, c] = TABLE[case][0].map(|edge| DVec3::from(middle(edge)));
                let away = (b - a).cross(c - a).dot(a - DVec3::from(place));
                assert!(sign * away > 0.0, "{case:08b}");
            }
        }
    }
}
