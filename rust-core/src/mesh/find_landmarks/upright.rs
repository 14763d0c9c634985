//! Checks that the plane in which the mesh around a face mirrors itself lies between its eyes.
//!
//! On a round toy, two eyes and a mouth lie like the corners of a triangle, so the networks may
//! confuse the mouth with an eye. The mesh decides. Its left and right mirror each other in one
//! plane, and a wrongly turned face has another plane between its eyes. All points here are in the
//! face's own frame, in canonical metres.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{
    symmetry::{Plane, better, spread},
    view::{Frame, middle, turned},
};
use crate::mesh::{Mesh, Similarity, SurfaceTree, direction::unit};

/// Triangles within this distance of the face's centre count: as far as brows, chin and cheeks.
const REACH_M: f64 = 0.14;
/// Triangles whose normals face forward by less than this, as a cosine, do not count.
const LEAST_FRONT: f64 = 0.1;
/// Number of points that are reflected.
const REFLECTED: usize = 600;
/// Number of planes that are tried, at equal angles about the face's forward axis.
const ANGLES: usize = 12;
/// Rounds of fitting for each plane.
const ROUNDS: usize = 10;
/// While a plane is fitted, a point that misses the surface by this counts half, metres.
const ROBUST_M: f64 = 0.004;
/// The most that a single point adds to the mean miss of a plane, metres.
const MAX_MISS_M: f64 = 0.011;
/// A plane within this angle of the plane between the eyes counts as the face's own.
const OWN_DEG: f64 = 25.0;
/// A plane beyond this angle counts as another plane.
const OTHER_DEG: f64 = 35.0;
/// A plane whose normal tilts forward by more than this, as a sine, separates front and back
/// instead of left and right.
const MAX_FORWARD: f64 = 0.5;
/// The face is turned if its own plane misses by more than this share of another plane's miss.
const SHARE: f64 = 0.8;

/// The mean distance by which reflected points miss the surface, metres, and the plane.
type Mirror = (f64, Plane);

/// The plane in which the mesh around a face mirrors itself, if it does not lie between the face's
/// eyes.
pub(super) fn turned_away(frame: &Frame<'_>, to_canonical: &Similarity) -> Option<Plane> {
    let mirrors = mirrors(frame, to_canonical)?;
    let best = |holds: &dyn Fn(&Plane) -> bool| -> Option<Mirror> {
        let matching = mirrors.iter().filter(|(_, plane)| holds(plane));
        matching.copied().min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let across = |plane: &Plane| plane.normal.x.abs();
    let between_eyes = best(&|plane| across(plane) > OWN_DEG.to_radians().cos());
    let (other, plane) = best(&|plane| {
        across(plane) < OTHER_DEG.to_radians().cos() && plane.normal.z.abs() < MAX_FORWARD
    })?;
    let between_eyes = between_eyes.map_or(f64::INFINITY, |mirror| mirror.0);
    (between_eyes > SHARE * other).then_some(plane)
}

/// The two poses, one upside down, of a face with the plane between its eyes. `to_canonical` is the
/// pose in whose frame the plane was found.
pub(super) fn poses_across(plane: &Plane, to_canonical: &Similarity) -> [Similarity; 2] {
    let middle = Vec3::from(middle()).as_dvec3();
    let on_plane = middle - (middle.dot(plane.normal) - plane.offset) * plane.normal;
    [1.0, -1.0].map(|side| {
        let x = side * plane.normal;
        let z = unit(DVec3::Z - x.z * x);
        let turn = Similarity {
            rotation: [x, z.cross(x), z].map(Into::into),
            ..Similarity::IDENTITY
        };
        let moved = Vec3::from(turn.apply(on_plane.as_vec3().into())).as_dvec3();
        let turn = Similarity {
            translation: (middle - moved).into(),
            ..turn
        };
        turn.compose(to_canonical)
    })
}

/// The planes to which the [`ANGLES`] first ones converge; `None` where nothing faces forward.
fn mirrors(frame: &Frame<'_>, to_canonical: &Similarity) -> Option<Vec<Mirror>> {
    let mesh = Mesh {
        positions: turned(frame, to_canonical),
        triangles: frame.triangles.to_vec(),
    };
    let middle = Vec3::from(middle()).as_dvec3();
    let in_face = |t: &&[u32; 3]| {
        let [a, b, c] = t.map(|v| Vec3::from(mesh.positions[v as usize]).as_dvec3());
        let normal = (b - a).cross(c - a);
        (a + b + c).distance(3.0 * middle) < 3.0 * REACH_M
            && normal.z > LEAST_FRONT * normal.length()
    };
    let face: Vec<[u32; 3]> = mesh.triangles.iter().filter(in_face).copied().collect();
    if face.is_empty() {
        return None;
    }
    let points = spread(&mesh.positions, &face, REFLECTED);
    let tree = SurfaceTree::new(&mesh);
    let nearest = |p: DVec3| {
        let place = tree.closest(p.as_vec3().into());
        place.map_or((p, f64::INFINITY), |place| {
            let corners = mesh.triangles[place.face as usize];
            let corners = corners.map(|v| Vec3::from(mesh.positions[v as usize]).as_dvec3());
            let shares = corners.iter().zip(place.barycentric);
            let q: DVec3 = shares.map(|(corner, share)| share * *corner).sum();
            (q, place.distance.powi(2))
        })
    };
    let fitted = |k: usize| {
        let (sin, cos) = (std::f64::consts::PI * k as f64 / ANGLES as f64).sin_cos();
        let normal = DVec3::new(cos, sin, 0.0);
        let offset = normal.dot(middle);
        let start = Plane { normal, offset };
        let plane = (0..ROUNDS).fold(start, |p, _| better(&p, &points, nearest, ROBUST_M));
        let misses = points
            .iter()
            .map(|p| nearest(plane.reflect(*p)).1.sqrt().min(MAX_MISS_M));
        (misses.sum::<f64>() / points.len() as f64, plane)
    };
    Some((0..ANGLES).into_par_iter().map(fitted).collect())
}

#[cfg(test)]
mod tests {
    use super::{super::view::stated_frame, *};
    use crate::mesh::Axis;

    #[test]
    fn a_turned_face_is_noticed_and_turned_back() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let head = Mesh::read(folder.join("../weights/shared/default_head/head.obj")).unwrap();
        let frame = stated_frame(&head, Axis::PosZ, Axis::PosY).unwrap();
        let upright = frame.from_mesh.inverse();
        assert!(turned_away(&frame, &upright).is_none());
        let (sin, cos) = 100f64.to_radians().sin_cos();
        let [x, y, _] = middle().map(f64::from);
        let roll = Similarity {
            rotation: [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]],
            translation: [x - cos * x + sin * y, y - sin * x - cos * y, 0.0],
            ..Similarity::IDENTITY
        };
        let turned = roll.compose(&upright);
        let plane = turned_away(&frame, &turned).unwrap();
        let poses = poses_across(&plane, &turned);
        let ups = poses.map(|pose| pose.compose(&upright.inverse()).rotation[1][1]);
        assert!(ups.iter().any(|up| *up > 0.97), "{ups:?}");
        assert!(ups.iter().any(|up| *up < -0.97), "{ups:?}");
    }
}
