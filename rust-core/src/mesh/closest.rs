//! The point of a surface that is closest to a given point.

use super::{
    Mesh,
    tree::{blend, closest_weights},
};

/// A place on the surface of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SurfacePoint {
    pub position: [f32; 3],
    pub triangle: usize,
    /// From the point that was asked about, mesh units.
    pub distance: f32,
}

/// Searches every triangle that `allowed` lets through; plain and exact. A triangle is skipped
/// when its first corner is further away than the best found so far plus the triangle's reach.
/// 68 landmarks on 50,000 triangles take some tens of milliseconds: no tree is worth it.
///
/// Returns `None` if no triangle is allowed.
pub(crate) fn closest_point(
    mesh: &Mesh,
    point: [f32; 3],
    allowed: impl Fn(usize) -> bool,
) -> Option<SurfacePoint> {
    let mut best: Option<SurfacePoint> = None;
    for (number, triangle) in mesh.triangles.iter().enumerate() {
        let corners = triangle.map(|v| mesh.positions[v as usize]);
        if let Some(found) = best {
            let reach = norm(sub(corners[1], corners[0])).max(norm(sub(corners[2], corners[0])));
            if norm(sub(point, corners[0])) - reach > found.distance {
                continue;
            }
        }
        if !allowed(number) {
            continue;
        }
        let position = closest_on_triangle(point, corners);
        let distance = norm(sub(point, position));
        if best.is_none_or(|b| distance < b.distance) {
            best = Some(SurfacePoint {
                position,
                triangle: number,
                distance,
            });
        }
    }
    best
}

/// In double precision, so that faces without area or with coincident corners have an answer too.
fn closest_on_triangle(p: [f32; 3], corners: [[f32; 3]; 3]) -> [f32; 3] {
    let corners = corners.map(|c| c.map(f64::from));
    blend(corners, closest_weights(p.map(f64::from), corners)).map(|x| x as f32)
}

pub(crate) fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn norm(a: [f32; 3]) -> f32 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn triangle() -> Mesh {
        Mesh {
            positions: vec![[0.0, 0.0, 0.0], [2.0, 0.1, -0.3], [0.4, 1.5, 0.6]],
            triangles: vec![[0, 1, 2]],
        }
    }

    proptest! {
        /// Against a slow twin: the best of a fine barycentric grid.
        #[test]
        fn closest_point_beats_every_sample(p in prop::array::uniform3(-3.0f32..3.0)) {
            let mesh = triangle();
            let found = closest_point(&mesh, p, |_| true).unwrap();
            let mut best = f32::MAX;
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let (u, v) = (i as f32 / 40.0, j as f32 / 40.0);
                    let q: [f32; 3] = std::array::from_fn(|k| {
                        (1.0 - u - v) * mesh.positions[0][k]
                            + u * mesh.positions[1][k]
                            + v * mesh.positions[2][k]
                    });
                    best = best.min(norm(sub(p, q)));
                }
            }
            prop_assert!(found.distance <= best + 1e-4);
            prop_assert!(best - found.distance < 0.06);
        }
    }

    #[test]
    fn no_allowed_triangle_gives_none() {
        assert!(closest_point(&triangle(), [0.0; 3], |_| false).is_none());
        assert!(closest_point(&Mesh::default(), [0.0; 3], |_| true).is_none());
    }
}
