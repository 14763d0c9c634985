use super::*;
use crate::mesh::parts::boundary_edges;

/// A bumpy sheet of `n × n` cells over the unit square.
fn sheet(n: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let point = |i: u32, j: u32| {
        let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
        DVec3::new(x, y, 0.05 * (5.0 * x).sin() * (4.0 * y).cos())
    };
    let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| point(i, j)));
    let cell = |a: u32| [[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]];
    let corners = (0..n).flat_map(|j| (0..n).map(move |i| j * (n + 1) + i));
    (positions.collect(), corners.flat_map(cell).collect())
}

fn coarse(n: u32, vertices: usize, locked: &[bool]) -> (Vec<DVec3>, Simplified) {
    let (positions, triangles) = sheet(n);
    let edge_lengths = vec![0.1; positions.len()];
    let options = SimplifyOptions {
        vertices,
        error: 0.02,
    };
    let simple = simplify(&positions, &triangles, &edge_lengths, locked, &options);
    (positions, simple)
}

#[test]
fn a_sheet_comes_down_to_what_is_asked_and_keeps_its_rim() {
    let (positions, simple) = coarse(40, 300, &vec![false; 41 * 41]);
    let mut used: Vec<u32> = simple.triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    assert_eq!(used.len(), 300);
    let roots: Vec<u32> = (0..41 * 41)
        .filter(|&v| simple.stands_for[v as usize] == v)
        .collect();
    assert_eq!(used, roots);
    for (a, b) in boundary_edges(&simple.triangles) {
        for v in [a, b] {
            let DVec3 { x, y, .. } = positions[v as usize];
            assert!(x == 0.0 || x == 1.0 || y == 0.0 || y == 1.0, "{x} {y}");
        }
    }
    // One sheet without holes: V − E + F = 1.
    let (faces, rim) = (
        simple.triangles.len(),
        boundary_edges(&simple.triangles).len(),
    );
    let edges = (3 * faces + rim) / 2;
    assert_eq!(used.len() + faces, edges + 1);
}

#[test]
fn locked_vertices_stay_and_nothing_goes_far() {
    let mut locked = vec![false; 41 * 41];
    (0..41 * 41).step_by(97).for_each(|v| locked[v] = true);
    let (positions, simple) = coarse(40, 200, &locked);
    for v in (0..41 * 41).filter(|&v| locked[v]) {
        assert_eq!(simple.stands_for[v], v as u32);
    }
    for (v, &root) in simple.stands_for.iter().enumerate() {
        let gone = positions[v].distance(positions[root as usize]);
        assert!(gone < 0.4, "{v} went {gone}");
    }
}

#[test]
fn edges_of_three_faces_stay_as_they_are() {
    let (mut positions, mut triangles) = sheet(10);
    let first = positions.len() as u32;
    // A fin stands on the sheet along its middle row.
    for i in 0..=10 {
        positions.push(DVec3::new(f64::from(i) / 10.0, 0.5, 0.3));
    }
    for i in 0..10 {
        triangles.push([5 * 11 + i, 5 * 11 + i + 1, first + i]);
    }
    let edge_lengths = vec![1.0; positions.len()];
    let locked = vec![false; positions.len()];
    let options = SimplifyOptions {
        vertices: 10,
        error: 1.0,
    };
    let simple = simplify(&positions, &triangles, &edge_lengths, &locked, &options);
    for v in 5 * 11..6 * 11 {
        assert_eq!(simple.stands_for[v], v as u32);
    }
}
