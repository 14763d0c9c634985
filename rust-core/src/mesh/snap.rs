//! Puts landmarks on the surface: on the skin rather than an eyeball or a tooth, and inner-lip
//! landmarks on their own lip.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    Landmarks, Mesh, Parts, SurfaceTree,
    ibug::LANDMARKS,
    lips::{lip_of_landmark, lip_of_vertices},
    parts::weld_seams,
    tree::SurfacePoint,
};
use crate::{Error, Result};

/// How much further from a landmark than the nearest surface the skin, or the landmark's own lip,
/// may be, as a share of the distance between the outer eye corners (7 mm on a human head). If it
/// is further, the mesh has no skin or lip there.
const DETOUR_IN_EYE_DISTANCES: f32 = 0.08;

/// Moves every point to the nearest skin. If the mesh has a mouth that opens, inner-lip points stay
/// on their own lip. All confidences are 1.
///
/// # Errors
/// `InvalidInput` for a mesh without triangles, and for a point so far from them that no number
/// holds the square of the distance.
pub(crate) fn snap_to_surface(mesh: &Mesh, positions: &[[f32; 3]; LANDMARKS]) -> Result<Landmarks> {
    let detour = DETOUR_IN_EYE_DISTANCES * eye_distance(positions);
    let surface = SurfaceTree::new(mesh);
    let nearest = nearest_where(&surface, positions, |_, _| true).into_iter();
    let nearest = nearest.enumerate().map(|(i, point)| {
        point.ok_or_else(|| {
            Error::InvalidInput(format!(
                "landmark {i}: expected a place near the mesh, got {:?}; are the landmarks in the \
                 mesh's own units and axes?",
                positions[i]
            ))
        })
    });
    let mut snapped: Vec<SurfacePoint> = nearest.collect::<Result<_>>()?;
    if let Some(skin) = skin_of(mesh, &snapped) {
        let on_skin = nearest_where(&surface, positions, |_, t| {
            skin[mesh.triangles[t][0] as usize]
        });
        prefer(&mut snapped, on_skin, detour);
    }
    let vertices = |range: std::ops::Range<usize>| -> Vec<u32> {
        snapped[range]
            .iter()
            .map(|s| nearest_corner(mesh, s))
            .collect()
    };
    let reach = eye_distance(positions);
    let lips = lip_of_vertices(mesh, &vertices(49..54), &vertices(55..60), reach);
    // All corners of a triangle must lie on the lip: a triangle that spans both lips belongs to
    // neither.
    let on_own_lip = nearest_where(&surface, positions, |i, t| {
        lip_of_landmark(i).is_some_and(|lip| {
            let mut corners = mesh.triangles[t].iter();
            corners.all(|&v| lips[v as usize] == Some(lip))
        })
    });
    prefer(&mut snapped, on_own_lip, detour);
    Ok(Landmarks {
        positions: std::array::from_fn(|i| snapped[i].position),
        vertices: std::array::from_fn(|i| nearest_corner(mesh, &snapped[i])),
        confidence: [1.0; LANDMARKS],
    })
}

/// The nearest point to every landmark among the triangles that `allowed` (landmark, triangle)
/// accepts.
fn nearest_where(
    surface: &SurfaceTree,
    positions: &[[f32; 3]; LANDMARKS],
    allowed: impl Fn(usize, usize) -> bool + Sync,
) -> Vec<Option<SurfacePoint>> {
    positions
        .par_iter()
        .enumerate()
        .map(|(i, p)| surface.closest_where(*p, |triangle| allowed(i, triangle)))
        .collect()
}

/// Takes each better place that is less than `detour` further away.
fn prefer(snapped: &mut [SurfacePoint], better: Vec<Option<SurfacePoint>>, detour: f32) {
    for (place, better) in snapped.iter_mut().zip(better) {
        if let Some(point) = better.filter(|b| b.distance < place.distance + detour) {
            *place = point;
        }
    }
}

/// `[V]`: whether a vertex belongs to the part with the most landmarks; `None` if no part has half
/// of them. Parts that are split along texture seams count as one.
fn skin_of(mesh: &Mesh, snapped: &[SurfacePoint]) -> Option<Vec<bool>> {
    let weld = weld_seams(&mesh.positions, &mesh.triangles, &[]);
    let welded: Vec<[u32; 3]> = mesh
        .triangles
        .iter()
        .map(|t| t.map(|v| weld[v as usize]))
        .collect();
    let parts = Parts::of(mesh.positions.len(), &welded);
    let part_of = |v: u32| parts.of_vertex[weld[v as usize] as usize];
    let mut counts = vec![0; parts.count];
    for place in snapped {
        counts[part_of(mesh.triangles[place.triangle][0]) as usize] += 1;
    }
    let most = (0..parts.count).max_by_key(|part| counts[*part])?;
    let is_skin = |v| part_of(v) == most as u32;
    (counts[most] >= LANDMARKS / 2).then(|| (0..mesh.positions.len() as u32).map(is_skin).collect())
}

fn nearest_corner(mesh: &Mesh, place: &SurfacePoint) -> u32 {
    let distance =
        |v: &u32| Vec3::from(mesh.positions[*v as usize]).distance(place.position.into());
    let corners = mesh.triangles[place.triangle];
    corners
        .into_iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .unwrap_or(corners[0])
}

/// Distance between the outer eye corners.
pub(crate) fn eye_distance(positions: &[[f32; 3]; LANDMARKS]) -> f32 {
    Vec3::from(positions[36]).distance(positions[45].into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::canonical_landmarks;

    /// A bent sheet under the mean landmarks, and one triangle of an eyeball in front of it.
    fn sheet_with_eyeball(eye: [f32; 3]) -> Mesh {
        let mut mesh = Mesh::default();
        for (row, column) in (0..60).flat_map(|r| (0..60).map(move |c| (r, c))) {
            let (x, y) = (column as f32 * 0.003 - 0.09, row as f32 * 0.003 - 0.12);
            mesh.positions.push([x, y, depth(x)]);
        }
        for a in (0..59u32).flat_map(|r| (0..59).map(move |c| 60 * r + c)) {
            let sides = [[a, a + 1, a + 60], [a + 1, a + 61, a + 60]];
            mesh.triangles.extend(sides);
        }
        for [dx, dy] in [[0.01, -0.01], [-0.01, -0.01], [0.0, 0.01]] {
            mesh.positions.push([eye[0] + dx, eye[1] + dy, eye[2]]);
        }
        mesh.triangles.push([3600, 3601, 3602]);
        mesh
    }

    fn depth(x: f32) -> f32 {
        0.08 - 6.0 * x * x
    }

    #[test]
    fn landmarks_prefer_the_skin_to_an_eyeball() {
        let positions = canonical_landmarks().map(|[x, y, _]| [x, y, depth(x) + 0.003]);
        let mesh = sheet_with_eyeball(positions[37]);
        let snapped = snap_to_surface(&mesh, &positions).unwrap();
        assert!(snapped.vertices[37] < 3600);
        assert!(Vec3::from(snapped.positions[37]).distance(positions[37].into()) < 0.004);
    }

    #[test]
    fn a_far_skin_is_no_reason_to_leave_the_nearest_surface() {
        let mut positions = canonical_landmarks().map(|[x, y, _]| [x, y, depth(x)]);
        positions[37][2] += 0.03;
        let snapped = snap_to_surface(&sheet_with_eyeball(positions[37]), &positions).unwrap();
        assert!(snapped.vertices[37] >= 3600);
    }

    #[test]
    fn points_beyond_all_numbers_are_refused() {
        let mut positions = *canonical_landmarks();
        let mesh = sheet_with_eyeball(positions[37]);
        positions[9] = [1e30, 0.0, 0.0];
        let refused = snap_to_surface(&mesh, &positions).map(|_| ());
        assert!(refused.unwrap_err().to_string().contains("landmark 9"));
    }
}
