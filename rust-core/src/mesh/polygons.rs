//! Turns polygons into triangles.

use glam::{DVec3, Vec3};

use super::direction::{perpendicular, unit};

/// The most corners of a concave polygon whose ears are clipped. Clipping has quadratic cost, so
/// larger polygons become fans. This limits the cost per corner of a mesh.
const MAX_CLIPPED: usize = 1024;

/// Appends the triangles of one polygon: a fan if it is convex, clipped ears if it is not.
/// A polygon of three corners is appended as it is. From all others, repeated corners in a row are
/// dropped; fewer than three corners give nothing.
pub(crate) fn triangulate(positions: &[[f32; 3]], polygon: &[u32], out: &mut Vec<[u32; 3]>) {
    if let [a, b, c] = *polygon {
        out.push([a, b, c]);
        return;
    }
    let mut corners: Vec<u32> = polygon.to_vec();
    corners.dedup();
    while corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    if corners.len() < 3 {
        return;
    }
    let flat = flatten(positions, &corners);
    let n = corners.len();
    let convex = (0..n).all(|i| turn(flat[i], flat[(i + 1) % n], flat[(i + 2) % n]) >= 0.0);
    if convex || n > MAX_CLIPPED || !flat.iter().flatten().all(|x| x.is_finite()) {
        out.extend((1..n - 1).map(|i| [corners[0], corners[i], corners[i + 1]]));
    } else {
        clip_ears(&corners, &flat, out);
    }
}

/// Corners in the plane of the polygon's mean normal (Newell), counter-clockwise.
fn flatten(positions: &[[f32; 3]], corners: &[u32]) -> Vec<[f64; 2]> {
    let point = |v: u32| Vec3::from(positions[v as usize]).as_dvec3();
    let origin = point(corners[0]);
    let places: Vec<_> = corners.iter().map(|&v| point(v) - origin).collect();
    let mut normal = DVec3::ZERO;
    for (i, &p) in places.iter().enumerate() {
        normal += p.cross(places[(i + 1) % places.len()]);
    }
    let (x, y) = perpendicular(unit(normal));
    places.iter().map(|&p| [p.dot(x), p.dot(y)]).collect()
}

/// Twice the signed area of a triangle in the plane.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn clip_ears(corners: &[u32], flat: &[[f64; 2]], out: &mut Vec<[u32; 3]>) {
    let mut left: Vec<usize> = (0..corners.len()).collect();
    let mut clipped = vec![false; corners.len()];
    // For each corner, the number of the polygon's corner up to which none lies in its ear. Corners
    // are only ever removed, so the search resumes where it stopped until the ear itself changes.
    let mut searched = vec![0; corners.len()];
    while left.len() > 3 {
        let n = left.len();
        let around = |i: usize| [left[(i + n - 1) % n], left[i], left[(i + 1) % n]];
        let is_ear = |&i: &usize| {
            let ear = around(i);
            let from = &mut searched[ear[1]];
            is_free(ear, from, &clipped, flat)
        };
        // A polygon that crosses itself may have no ear: then cut any corner.
        let ear = (0..n).find(is_ear).unwrap_or(1);
        let [before, tip, after] = around(ear);
        out.push([before, tip, after].map(|i| corners[i]));
        (searched[before], searched[after], clipped[tip]) = (0, 0, true);
        left.remove(ear);
    }
    out.push([0, 1, 2].map(|i| corners[left[i]]));
}

/// Whether a corner points outwards and none of the remaining corners lies in its ear. Moves `from`
/// on to the first corner that does.
fn is_free(ear: [usize; 3], from: &mut usize, clipped: &[bool], flat: &[[f64; 2]]) -> bool {
    let [a, b, c] = ear.map(|i| flat[i]);
    let outside = |p: [f64; 2]| turn(a, b, p) < 0.0 || turn(b, c, p) < 0.0 || turn(c, a, p) < 0.0;
    if turn(a, b, c) <= 0.0 {
        return false;
    }
    while *from < flat.len() && (clipped[*from] || ear.contains(from) || outside(flat[*from])) {
        *from += 1;
    }
    *from == flat.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use proptest::prelude::*;

    fn mesh_of(points: &[[f32; 3]]) -> Mesh {
        let mut mesh = Mesh {
            positions: points.to_vec(),
            triangles: Vec::new(),
        };
        let polygon: Vec<u32> = (0..points.len() as u32).collect();
        triangulate(&mesh.positions, &polygon, &mut mesh.triangles);
        mesh
    }

    #[test]
    fn a_concave_arrow_is_not_covered_twice() {
        // The reflex corner is the fan's worst case.
        let arrow = [
            [0.0, 0.0, 3.0],
            [2.0, -1.0, 3.0],
            [0.5, 0.0, 3.0],
            [2.0, 1.0, 3.0],
        ];
        let mesh = mesh_of(&arrow);
        assert_eq!(mesh.triangles.len(), 2);
        assert!(mesh.face_area_vectors().iter().all(|n| n[2] > 0.0));
        assert!((mesh.face_areas().iter().sum::<f64>() - 0.5).abs() < 1e-9);
    }

    #[test]
    fn repeated_corners_are_dropped() {
        let mut out = Vec::new();
        let positions = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        triangulate(&positions, &[0, 1, 1, 2, 0], &mut out);
        assert_eq!(out, [[0, 1, 2]]);
        triangulate(&positions, &[0, 1, 0, 1], &mut out);
        triangulate(&positions, &[0, 1], &mut out);
        triangulate(&positions, &[], &mut out);
        assert!(out[1..].iter().all(|t| t.iter().all(|&v| v < 3)));
    }

    /// The rule in its plainest form: clips the first corner that is an ear, again and again, at
    /// cubic cost.
    fn clip_plainly(corners: &[u32], flat: &[[f64; 2]]) -> Vec<[u32; 3]> {
        let mut left: Vec<usize> = (0..corners.len()).collect();
        let mut out = Vec::new();
        while left.len() > 3 {
            let n = left.len();
            let around = |i: usize| [left[(i + n - 1) % n], left[i], left[(i + 1) % n]];
            let is_ear = |&i: &usize| {
                let ear = around(i);
                let [a, b, c] = ear.map(|i| flat[i]);
                let mut others = left.iter().filter(|i| !ear.contains(i)).map(|&i| flat[i]);
                turn(a, b, c) > 0.0
                    && others
                        .all(|p| turn(a, b, p) < 0.0 || turn(b, c, p) < 0.0 || turn(c, a, p) < 0.0)
            };
            let ear = (0..n).find(is_ear).unwrap_or(1);
            out.push(around(ear).map(|i| corners[i]));
            left.remove(ear);
        }
        out.push([0, 1, 2].map(|i| corners[left[i]]));
        out
    }

    /// A polygon through random points crosses itself, so that most of its corners are blocked.
    #[test]
    fn a_thousand_corners_that_cross_are_clipped_soon() {
        let n = MAX_CLIPPED as u32;
        let mut seed = 1u32;
        let points: Vec<[f32; 3]> = (0..n)
            .map(|_| {
                let mut next = || {
                    seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (seed >> 16) as f32
                };
                [next(), next(), 0.0]
            })
            .collect();
        let mut mesh = Mesh {
            positions: points,
            triangles: Vec::new(),
        };
        let polygon: Vec<u32> = (0..n).collect();
        // At cubic cost these would take minutes.
        for _ in 0..40 {
            triangulate(&mesh.positions, &polygon, &mut mesh.triangles);
        }
        assert_eq!(mesh.triangles.len(), 40 * (MAX_CLIPPED - 2));
    }

    proptest! {
        #[test]
        fn ears_are_those_of_the_plain_rule(
            points in proptest::collection::vec(proptest::array::uniform2(-9i8..10), 4..40),
        ) {
            let flat: Vec<[f64; 2]> = points.iter().map(|p| p.map(f64::from)).collect();
            let corners: Vec<u32> = (0..flat.len() as u32).collect();
            let mut out = Vec::new();
            clip_ears(&corners, &flat, &mut out);
            prop_assert_eq!(out, clip_plainly(&corners, &flat));
        }

        #[test]
        fn star_shaped_polygons_keep_their_area(radii in proptest::collection::vec(0.2f32..2.0, 4..20)) {
            let n = radii.len();
            let points: Vec<_> = radii.iter().enumerate().map(|(i, r)| {
                let angle = i as f32 / n as f32 * std::f32::consts::TAU;
                [0.0, r * angle.cos(), r * angle.sin()]
            }).collect();
            let exact: f64 = (0..n).map(|i| {
                let [p, q] = [points[i], points[(i + 1) % n]].map(|p| p.map(f64::from));
                0.5 * (p[1] * q[2] - p[2] * q[1])
            }).sum();
            let mesh = mesh_of(&points);
            prop_assert_eq!(mesh.triangles.len(), n - 2);
            prop_assert!((mesh.face_areas().iter().sum::<f64>() - exact).abs() < 1e-5 * exact);
        }

        #[test]
        fn any_polygon_gives_all_but_two_triangles(
            points in proptest::collection::vec(proptest::array::uniform3(-2i8..3), 3..9),
        ) {
            let points: Vec<_> = points.iter().map(|p| p.map(f32::from)).collect();
            prop_assert_eq!(mesh_of(&points).triangles.len(), points.len() - 2);
        }
    }
}
