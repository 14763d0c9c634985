use glam::Vec3;

use super::*;
use crate::mesh::{canonical_landmarks, parts::boundary_edges};

/// A bent sheet of `n × n` cells under the landmarks, canonical centimetres.
fn sheet(n: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let point = |i: u32, j: u32| {
        let (x, y) = (
            18.0 * (i as f32 / n as f32 - 0.5),
            18.0 * (j as f32 / n as f32 - 0.6),
        );
        [x, y, 8.0 - 0.05 * x * x]
    };
    let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| point(i, j)));
    let cell = |a: u32| [[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]];
    let corners = (0..n).flat_map(|j| (0..n).map(move |i| j * (n + 1) + i));
    (positions.collect(), corners.flat_map(cell).collect())
}

/// Landmarks on the sheet and the nearest vertices.
fn marks(positions: &[[f32; 3]]) -> ([[f32; 3]; LANDMARKS], [u32; LANDMARKS]) {
    let bend = |x: f32| 8.0 - 0.05 * x * x;
    let landmarks = canonical_landmarks().map(|p| {
        let (x, y) = (100.0 * p[0], 100.0 * p[1]);
        [x, y, bend(x)]
    });
    let grid = crate::face::nearest::PointGrid::new(positions, 0.5);
    let anchors = landmarks.map(|p| grid.nearest(p, 5.0).expect("on the sheet").0);
    (landmarks, anchors)
}

#[test]
fn smooth_fields_come_back_and_rows_sum_to_one() {
    let (positions, triangles) = sheet(200);
    let (landmarks, mut anchors) = marks(&positions);
    let proxy = Proxy::build(&positions, &triangles, &landmarks, &mut anchors, 4000);
    assert!(proxy.error_cm < 0.1, "{}", proxy.error_cm);
    let field = |p: [f32; 3]| (0.5 * p[0]).sin() * (0.4 * p[1]).cos();
    let mut errors = Vec::new();
    for (v, &p) in positions.iter().enumerate() {
        let row = proxy.prolongation.row(v as u32);
        let (sum, value) = row.fold((0.0, 0.0), |(sum, value), (column, weight)| {
            (
                sum + weight,
                value + weight * field(proxy.mesh.positions[column as usize]),
            )
        });
        assert!((sum - 1.0f32).abs() < 1e-4, "row {v} sums to {sum}");
        errors.push((value - field(p)).abs());
    }
    errors.sort_unstable_by(f32::total_cmp);
    let (most, worst) = (errors[errors.len() * 19 / 20], errors[errors.len() - 1]);
    assert!(most < 0.006 && worst < 0.04, "95 %: {most}, all: {worst}");
}

#[test]
fn lips_that_touch_do_not_mix() {
    // Two sheets a hundredth of a millimetre apart.
    let (mut positions, mut triangles) = sheet(100);
    let count = positions.len() as u32;
    let lower: Vec<[f32; 3]> = positions
        .iter()
        .map(|p| [p[0], p[1], p[2] - 1e-3])
        .collect();
    positions.extend(lower);
    let second: Vec<_> = triangles.iter().map(|t| t.map(|v| v + count)).collect();
    triangles.extend(second);
    let (landmarks, mut anchors) = marks(&positions[..count as usize]);
    let proxy = Proxy::build(&positions, &triangles, &landmarks, &mut anchors, 3000);
    // Added vertices belong to landmarks on the first sheet.
    for v in 0..2 * count {
        for (column, _) in proxy.prolongation.row(v) {
            let first = column < count || column >= 2 * count;
            assert_eq!(v < count, first, "{v} follows {column}");
        }
    }
}

#[test]
fn a_coarse_skin_gets_its_landmarks_and_keeps_its_vertices() {
    let (positions, triangles) = sheet(12);
    let (landmarks, mut anchors) = marks(&positions);
    let proxy = Proxy::build(&positions, &triangles, &landmarks, &mut anchors, 3000);
    for (landmark, &anchor) in landmarks.iter().zip(&anchors) {
        let there = proxy.mesh.positions[anchor as usize];
        let missed = Vec3::from(*landmark).distance(there.into());
        // The flat facets cut across the sheet's bend.
        assert!(missed < 0.15, "{landmark:?} has {there:?}");
    }
    for v in 0..positions.len() as u32 {
        assert_eq!(proxy.prolongation.row(v).collect::<Vec<_>>(), [(v, 1.0)]);
    }
    assert!(proxy.mesh.triangles.len() > 4 * triangles.len());
    assert_eq!(boundary_edges(&proxy.mesh.triangles).len(), {
        let rim = boundary_edges(&proxy.mesh.triangles);
        let is_rim = |p: [f32; 3]| p[0].abs() > 8.99 || (p[1] + 1.8).abs() > 8.99;
        rim.iter()
            .filter(|(a, b)| {
                [a, b]
                    .iter()
                    .all(|v| is_rim(proxy.mesh.positions[**v as usize]))
            })
            .count()
    });
}
