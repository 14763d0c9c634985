//! The plane in which a mesh mirrors itself. Heads, bodies and animals have one, and it divides the
//! face into left and right.
//!
//! The fit starts from each principal plane of the surface and repeats three steps: reflect points,
//! match each to the nearest point of the surface, take the plane that mirrors these pairs best
//! (after Ecins, Fermüller, Aloimonos 2017, "Detecting Reflectional Symmetries in 3D Data Through
//! Symmetrical Fitting", with robust weights in place of their normals).

use faer::{Mat, Side};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::view::Frame;
use crate::mesh::{
    Similarity,
    direction::{perpendicular, unit},
};

/// Number of points that are reflected.
const REFLECTED: usize = 400;
/// Number of points on the surface that a reflected point may meet.
const SURFACE: usize = 2500;
const ROUNDS: usize = 15;

/// A point that misses the surface by this share of the mesh's radius of gyration counts half.
const ROBUST: f64 = 0.05;

/// Share of the reflected points that must meet the surface.
const SHARE: f64 = 0.9;
/// How close they must come to it, in the unit of `ROBUST`. Heads with shoulders and standing
/// animals reach 0.04 to 0.06, the second best plane of the same meshes 0.2 and more.
const WORST: f64 = 0.13;

/// The plane `normal · x = offset`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    pub normal: DVec3,
    pub offset: f64,
}

impl Plane {
    pub fn reflect(&self, p: DVec3) -> DVec3 {
        p - 2.0 * (p.dot(self.normal) - self.offset) * self.normal
    }

    /// Two axes in the plane that form a right-handed frame with the normal.
    pub fn axes(&self) -> (DVec3, DVec3) {
        perpendicular(self.normal)
    }

    /// Turns and moves `pose` just enough that its x axis is normal to the plane and that it maps
    /// the plane through `centre`. Adds no turn about the x axis. `None` if the x axis would turn
    /// by over 60°.
    pub fn align(&self, pose: &Similarity, centre: [f32; 3]) -> Option<Similarity> {
        let across = self.normal.dot(pose.rotation[0].into());
        if across.abs() < 0.5 {
            return None;
        }
        let x = self.normal * across.signum();
        let z = DVec3::from(pose.rotation[2]);
        let z = unit(z - z.dot(x) * x);
        let here = Vec3::from(pose.inverse().apply(centre)).as_dvec3();
        let beside = here.dot(self.normal) - self.offset;
        let on_plane = (here - beside * self.normal).as_vec3();
        let turned = Similarity {
            rotation: [x, z.cross(x), z].map(Into::into),
            translation: [0.0; 3],
            ..*pose
        };
        let at = turned.apply(on_plane.into());
        Some(Similarity {
            translation: std::array::from_fn(|i| f64::from(centre[i] - at[i])),
            ..turned
        })
    }
}

/// The best plane, if the mesh mirrors itself well in one.
pub(super) fn symmetry(frame: &Frame) -> Option<Plane> {
    let surface = spread(&frame.points, &frame.triangles, SURFACE);
    let points = spread(&frame.points, &frame.triangles, REFLECTED);
    let count = points.len() as f64;
    let centre = points.iter().sum::<DVec3>() / count;
    let spread = scatter(points.iter().map(|p| (1.0, *p - centre)));
    let radius = ((spread[0][0] + spread[1][1] + spread[2][2]) / count).sqrt();
    let best = principal(&spread)?
        .into_par_iter()
        .map(|normal| {
            let plane = Plane {
                normal,
                offset: normal.dot(centre),
            };
            let near = |p| nearest(p, &surface);
            let plane = (0..ROUNDS).fold(plane, |p, _| better(&p, &points, near, ROBUST * radius));
            (miss(&plane, &points, &surface) / radius, plane)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    (best.0 < WORST).then_some(best.1)
}

/// `count` points spread evenly over the surface's area, the same every time.
pub(super) fn spread(points: &[[f32; 3]], triangles: &[[u32; 3]], count: usize) -> Vec<DVec3> {
    let corners = |t: &[u32; 3]| t.map(|v| Vec3::from(points[v as usize]).as_dvec3());
    let area = |t: &[u32; 3]| {
        let [a, b, c] = corners(t);
        (b - a).cross(c - a).length()
    };
    let total: f64 = triangles.iter().map(area).sum();
    let mut places = Vec::with_capacity(count);
    let mut passed = 0.0;
    for t in triangles {
        passed += area(t);
        while (places.len() as f64 + 0.5) * total < passed * count as f64 && places.len() < count {
            // Low-discrepancy places in the triangle (the plastic number's sequence).
            let k = places.len() as f64;
            let (mut u, mut v) = ((k * 0.754_877_666).fract(), (k * 0.569_840_291).fract());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let [a, b, c] = corners(t);
            places.push(a + u * (b - a) + v * (c - a));
        }
    }
    places
}

/// Σ w v vᵀ.
fn scatter(weighted: impl Iterator<Item = (f64, DVec3)>) -> [[f64; 3]; 3] {
    let mut sum = [[0.0; 3]; 3];
    for (w, v) in weighted {
        for (i, row) in sum.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                *value += w * v[i] * v[j];
            }
        }
    }
    sum
}

/// Eigenvectors of a symmetric matrix, starting with that of the smallest eigenvalue.
fn principal(matrix: &[[f64; 3]; 3]) -> Option<Vec<DVec3>> {
    let eigen = Mat::from_fn(3, 3, |i, j| matrix[i][j])
        .self_adjoint_eigen(Side::Lower)
        .ok()?;
    let vectors = eigen.U();
    Some(
        (0..3)
            .map(|k| [0, 1, 2].map(|i| vectors[(i, k)]).into())
            .collect(),
    )
}

fn nearest(p: DVec3, surface: &[DVec3]) -> (DVec3, f64) {
    let start = (DVec3::ZERO, f64::INFINITY);
    surface
        .iter()
        .fold(start, |best, q| match q.distance_squared(p) {
            d if d < best.1 => (*q, d),
            _ => best,
        })
}

/// Pairs each point with the surface point nearest to its reflection. Returns the plane that
/// mirrors these pairs best: perpendicular to their differences, through their midpoints.
///
/// `nearest`: returns the surface point nearest to a point, and the square of their distance.
/// `robust`: a reflection this far from the surface counts half.
pub(super) fn better(
    plane: &Plane,
    points: &[DVec3],
    nearest: impl Fn(DVec3) -> (DVec3, f64),
    robust: f64,
) -> Plane {
    let pairs: Vec<(f64, DVec3, DVec3)> = points
        .iter()
        .map(|p| {
            let (q, d2) = nearest(plane.reflect(*p));
            let weight = 1.0 / (1.0 + d2 / robust.powi(2));
            (weight, 0.5 * (p + q), q - p)
        })
        .collect();
    let total: f64 = pairs.iter().map(|p| p.0).sum();
    let through = pairs.iter().map(|p| p.0 * p.1).sum::<DVec3>() / total;
    let middles = scatter(pairs.iter().map(|p| (4.0 * p.0, p.1 - through)));
    let differences = scatter(pairs.iter().map(|p| (p.0, p.2)));
    let matrix =
        std::array::from_fn(|i| std::array::from_fn(|j| middles[i][j] - differences[i][j]));
    match principal(&matrix) {
        Some(axes) => Plane {
            normal: axes[0],
            offset: axes[0].dot(through),
        },
        None => *plane,
    }
}

/// Distance within which the share `SHARE` of the reflected points meets the surface.
fn miss(plane: &Plane, points: &[DVec3], surface: &[DVec3]) -> f64 {
    let mut distances: Vec<f64> = points
        .iter()
        .map(|p| nearest(plane.reflect(*p), surface).1.sqrt())
        .collect();
    distances.sort_by(f64::total_cmp);
    distances[(SHARE * distances.len() as f64) as usize]
}

#[cfg(test)]
mod tests {
    use super::super::view::stated_frame;
    use super::*;
    use crate::mesh::{Axis, Mesh};

    fn head() -> Mesh {
        let folder =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
        Mesh::read(folder.join("head.obj")).unwrap()
    }

    #[test]
    fn a_turned_head_mirrors_in_its_own_middle() {
        let turn = Similarity {
            rotation: [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]],
            ..Similarity::IDENTITY
        };
        let mut mesh = head();
        mesh.positions.iter_mut().for_each(|p| *p = turn.apply(*p));
        let frame = stated_frame(&mesh, Axis::PosZ, Axis::PosY).unwrap();
        let plane = symmetry(&frame).unwrap();
        let x = DVec3::from(turn.rotation.map(|row| row[0]));
        assert!(x.dot(plane.normal).abs() > 0.995, "{plane:?}");
        let pose = turn.inverse().compose(&frame.from_mesh.inverse());
        let centre = [0.0, -0.03, 0.08];
        let aligned = plane.align(&pose, centre).unwrap();
        let step = aligned.compose(&pose.inverse());
        let moved = step.apply(centre);
        assert!(
            (0..3).all(|i| (moved[i] - centre[i]).abs() < 0.008),
            "{moved:?}"
        );
        assert!((0..3).all(|i| step.rotation[i][i] > 0.99));
    }

    #[test]
    fn a_head_with_a_beam_at_its_side_mirrors_in_nothing() {
        let mut mesh = head();
        let first = mesh.positions.len() as u32;
        for [x, y, z] in [
            [0.1, 0.0, 0.0],
            [0.9, 0.6, 0.0],
            [0.1, 0.1, 0.4],
            [0.5, 0.0, 0.5],
        ] {
            mesh.positions.push([x, y, z]);
        }
        let sides = [[0, 1, 2], [1, 2, 3], [0, 1, 3]];
        mesh.triangles
            .extend(sides.map(|t: [u32; 3]| t.map(|v| v + first)));
        let frame = stated_frame(&mesh, Axis::PosZ, Axis::PosY).unwrap();
        assert!(symmetry(&frame).is_none());
    }
}
