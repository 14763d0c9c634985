//! Polygons to triangles.

use super::vec3::{cross, dot, perpendicular, sub, unit};

/// Ears are clipped at quadratic cost; larger concave polygons become fans.
const MAX_CLIPPED: usize = 1024;

/// Appends the triangles of one polygon: a fan where it is convex, clipped ears where it is not.
/// Repeated corners in a row are dropped; fewer than three corners give nothing.
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
    let point = |v: u32| positions[v as usize].map(f64::from);
    let origin = point(corners[0]);
    let places: Vec<_> = corners.iter().map(|&v| sub(point(v), origin)).collect();
    let mut normal = [0.0; 3];
    for (i, &p) in places.iter().enumerate() {
        let n = cross(p, places[(i + 1) % places.len()]);
        normal = [0, 1, 2].map(|axis| normal[axis] + n[axis]);
    }
    let (x, y) = perpendicular(unit(normal));
    places.iter().map(|&p| [dot(p, x), dot(p, y)]).collect()
}

/// Twice the signed area of a triangle in the plane.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn clip_ears(corners: &[u32], flat: &[[f64; 2]], out: &mut Vec<[u32; 3]>) {
    let mut left: Vec<usize> = (0..corners.len()).collect();
    while left.len() > 3 {
        let n = left.len();
        let around = |i: usize| [left[(i + n - 1) % n], left[i], left[(i + 1) % n]];
        // A polygon that crosses itself may have no ear: cut any corner then.
        let ear = (0..n)
            .find(|&i| is_ear(around(i), &left, flat))
            .unwrap_or(1);
        out.push(around(ear).map(|i| corners[i]));
        left.remove(ear);
    }
    out.push([0, 1, 2].map(|i| corners[left[i]]));
}

fn is_ear([a, b, c]: [usize; 3], left: &[usize], flat: &[[f64; 2]]) -> bool {
    let (pa, pb, pc) = (flat[a], flat[b], flat[c]);
    turn(pa, pb, pc) > 0.0
        && left.iter().filter(|i| ![a, b, c].contains(i)).all(|&i| {
            let p = flat[i];
            turn(pa, pb, p) < 0.0 || turn(pb, pc, p) < 0.0 || turn(pc, pa, p) < 0.0
        })
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

    proptest! {
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
