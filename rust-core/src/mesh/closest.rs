//! The point of a surface that is closest to a given point.

use rayon::prelude::*;

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

/// Triangles in one ball.
const BALL: usize = 64;

/// A mesh whose triangles are put into balls, a few dozen that follow each other to each: those
/// too far away are passed by. Plain and exact, and made in one pass.
pub(crate) struct Balls<'a> {
    mesh: &'a Mesh,
    /// Centre and radius, slightly too large.
    balls: Vec<([f32; 3], f32)>,
}

impl<'a> Balls<'a> {
    pub fn new(mesh: &'a Mesh) -> Self {
        let balls = mesh.triangles.par_chunks(BALL);
        let balls = balls
            .map(|triangles| ball_around(mesh, triangles))
            .collect();
        Balls { mesh, balls }
    }

    /// The closest of the triangles that `allowed` lets through; `None` if there is none.
    pub fn closest(
        &self,
        point: [f32; 3],
        allowed: impl Fn(usize) -> bool,
    ) -> Option<SurfacePoint> {
        let mut best: Option<SurfacePoint> = None;
        for (ball, &(centre, radius)) in self.balls.iter().enumerate() {
            if best.is_some_and(|best| norm(sub(point, centre)) - radius > best.distance) {
                continue;
            }
            let last = ((ball + 1) * BALL).min(self.mesh.triangles.len());
            for number in ball * BALL..last {
                nearer(self.mesh, point, number, &allowed, &mut best);
            }
        }
        best
    }
}

fn ball_around(mesh: &Mesh, triangles: &[[u32; 3]]) -> ([f32; 3], f32) {
    let corners = || {
        triangles
            .iter()
            .flatten()
            .map(|&v| mesh.positions[v as usize])
    };
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for p in corners() {
        low = std::array::from_fn(|i| low[i].min(p[i]));
        high = std::array::from_fn(|i| high[i].max(p[i]));
    }
    let centre = std::array::from_fn(|i| 0.5 * (low[i] + high[i]));
    let reach = corners().map(|p| norm(sub(p, centre))).fold(0.0, f32::max);
    // Rounding must not cut off the nearest triangle.
    (centre, reach + 1e-5 * (reach + norm(centre)))
}

/// Takes triangle `number` for `best` if it is allowed and closer.
fn nearer(
    mesh: &Mesh,
    point: [f32; 3],
    number: usize,
    allowed: impl Fn(usize) -> bool,
    best: &mut Option<SurfacePoint>,
) {
    let corners = mesh.triangles[number].map(|v| mesh.positions[v as usize]);
    if let Some(found) = best {
        let reach = norm(sub(corners[1], corners[0])).max(norm(sub(corners[2], corners[0])));
        if norm(sub(point, corners[0])) - reach > found.distance {
            return;
        }
    }
    if !allowed(number) {
        return;
    }
    let position = closest_on_triangle(point, corners);
    let distance = norm(sub(point, position));
    if best.is_none_or(|b| distance < b.distance) {
        *best = Some(SurfacePoint {
            position,
            triangle: number,
            distance,
        });
    }
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

pub(crate) fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

pub(crate) fn norm(a: [f32; 3]) -> f32 {
    dot(a, a).sqrt()
}

/// The nearest point to `p` on the straight way between two others.
pub(crate) fn nearest_between(p: [f32; 3], a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    let way = sub(b, a);
    let along = (dot(sub(p, a), way) / dot(way, way).max(1e-12)).clamp(0.0, 1.0);
    std::array::from_fn(|i| a[i] + along * way[i])
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
            let found = Balls::new(&mesh).closest(p, |_| true).unwrap();
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
    fn balls_pass_by_nothing_that_is_nearer() {
        let mut mesh = Mesh::default();
        for i in 0..500u32 {
            let (angle, first) = (0.1 * i as f32, 3 * i);
            let at = [angle.cos(), angle.sin(), 0.01 * i as f32];
            let turned = [at[0] + 0.1, at[1], at[2] + 0.05];
            mesh.positions
                .extend([at, turned, [at[0], at[1] + 0.1, at[2]]]);
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        let balls = Balls::new(&mesh);
        for point in [[0.0; 3], [1.0, 0.2, 3.0], [-4.0, 0.0, 5.1]] {
            let mut plain = None;
            (0..500).for_each(|number| nearer(&mesh, point, number, |_| true, &mut plain));
            assert_eq!(balls.closest(point, |_| true), plain);
        }
    }

    #[test]
    fn no_allowed_triangle_gives_none() {
        assert!(
            Balls::new(&triangle())
                .closest([0.0; 3], |_| false)
                .is_none()
        );
        assert!(
            Balls::new(&Mesh::default())
                .closest([0.0; 3], |_| true)
                .is_none()
        );
    }
}
