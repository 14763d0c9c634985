//! The landmarks of a mesh: the caller's, checked and put on the surface, or those that the library
//! finds.

use std::collections::HashSet;

use glam::Vec3;

use super::FaceOptions;
use crate::{
    Error, Result,
    job::{ProgressFn, SILENT},
    mesh::{
        KnownLandmark, LandmarkFinder, LandmarkPlace, LandmarkSource, Landmarks, Mesh,
        ibug::{INNER_LIPS, LANDMARKS},
        lips::{lip_of_landmark, lip_of_vertices},
        snap::{eye_distance, snap_to_surface},
    },
};

/// A landmark may lie this far from the surface, as a share of the distance between the outer eye
/// corners (9 cm on a human head). Hand-placed points float by a centimetre or so.
const FAR_IN_EYE_DISTANCES: f32 = 0.25;
/// A point this near to its vertex counts as the vertex, because files round to nine digits. A
/// share of the same distance.
const AT_VERTEX_IN_EYE_DISTANCES: f32 = 1e-6;

/// The 68 landmarks of a mesh: the caller's, put on the surface, or found by the library.
///
/// The stated axes only help the finder: the caller's own landmarks say where the face is. Fixed
/// landmarks stay where they are, and the others follow them.
///
/// # Errors
/// `ShapeMismatch` or `InvalidInput` for unusable landmarks, `FaceNotFound` if none are given and
/// none are found, `Mesh` for a mesh without triangles.
pub fn locate_landmarks(mesh: &Mesh, options: &FaceOptions) -> Result<Landmarks> {
    locate_landmarks_with(LandmarkFinder::embedded()?, mesh, options, SILENT)
}

/// [`locate_landmarks`] with a finder whose weights come from elsewhere.
///
/// # Errors
/// As [`locate_landmarks`], and `Cancelled`.
pub fn locate_landmarks_with(
    finder: &LandmarkFinder,
    mesh: &Mesh,
    options: &FaceOptions,
    progress: ProgressFn<'_>,
) -> Result<Landmarks> {
    if mesh.triangles.is_empty() {
        let got = mesh.positions.len();
        let message = format!("expected triangles, got none ({got} vertices)");
        return Err(Error::Mesh(message));
    }
    let fixed = &options.fixed;
    let landmarks = match &options.landmarks {
        Some(landmarks) => caller_landmarks(mesh, landmarks)?,
        None => {
            let axes = (options.forward, options.up);
            return match &options.head {
                None => finder.find(mesh, axes.0, axes.1, fixed, progress),
                Some(name) => on_object(finder, (mesh, options), name, progress),
            };
        }
    };
    if fixed.is_empty() {
        Ok(landmarks)
    } else {
        finder.follow(mesh, &landmarks, fixed)
    }
}

/// The landmarks on an object of the mesh.
fn on_object(
    finder: &LandmarkFinder,
    (mesh, options): (&Mesh, &FaceOptions),
    name: &str,
    progress: ProgressFn<'_>,
) -> Result<Landmarks> {
    let (object, vertices) = options.parts.names.object(mesh, name)?;
    let mut fixed = options.fixed.clone();
    for landmark in &mut fixed {
        if let LandmarkPlace::Vertex(v) = landmark.place
            && let Some(place) = mesh.positions.get(v as usize)
        {
            landmark.place = LandmarkPlace::Position(*place);
        }
    }
    let (forward, up) = (options.forward, options.up);
    let mut landmarks = finder.find(&object, forward, up, &fixed, progress)?;
    landmarks.vertices = landmarks.vertices.map(|v| vertices[v as usize]);
    Ok(landmarks)
}

/// Whether landmarks can be those of a mesh: its vertices exist, and all points lie near its
/// surface.
///
/// # Errors
/// `ShapeMismatch` or `InvalidInput` that says which landmark does not fit.
pub fn check_landmarks(mesh: &Mesh, landmarks: &LandmarkSource) -> Result<()> {
    caller_landmarks(mesh, landmarks).map(drop)
}

fn caller_landmarks(mesh: &Mesh, landmarks: &LandmarkSource) -> Result<Landmarks> {
    match landmarks {
        LandmarkSource::Positions(positions) => from_positions(mesh, positions),
        LandmarkSource::Vertices(vertices) => from_vertices(mesh, vertices),
        LandmarkSource::Known(known) => from_known(mesh, known),
    }
}

/// Puts 68 points on the nearest fitting surface: inner-lip points on their own lip.
///
/// # Errors
/// As [`locate_landmarks`].
fn from_positions(mesh: &Mesh, positions: &[[f32; 3]]) -> Result<Landmarks> {
    let positions: [[f32; 3]; LANDMARKS] = sixty_eight(positions, "[68, 3]")?;
    if let Some(i) = positions.iter().flatten().position(|x| !x.is_finite()) {
        let message = format!("landmark {}: position is not finite", i / 3);
        return Err(Error::InvalidInput(message));
    }
    let landmarks = snap_to_surface(mesh, &positions)?;
    let eyes = eye_distance(&positions);
    for (i, (p, q)) in positions.iter().zip(&landmarks.positions).enumerate() {
        let distance = Vec3::from(*p).distance((*q).into());
        if distance > FAR_IN_EYE_DISTANCES * eyes {
            return Err(Error::InvalidInput(format!(
                "landmark {i}: {distance:.3} from the surface, expected at most {:.3} (a quarter \
                 of the distance between landmarks 36 and 45); are the landmarks in the mesh's \
                 own units and axes?",
                FAR_IN_EYE_DISTANCES * eyes
            )));
        }
    }
    Ok(landmarks)
}

fn from_vertices(mesh: &Mesh, vertices: &[u32]) -> Result<Landmarks> {
    let vertices: [u32; LANDMARKS] = sixty_eight(vertices, "[68]")?;
    let mut used = vec![false; mesh.positions.len()];
    for &v in mesh.triangles.iter().flatten() {
        used[v as usize] = true;
    }
    for (i, &v) in vertices.iter().enumerate() {
        let count = mesh.positions.len();
        match used.get(v as usize) {
            None => {
                let message = format!("landmark {i}: vertex {v}, expected below {count}");
                return Err(Error::InvalidInput(message));
            }
            Some(false) => {
                let message = format!("landmark {i}: vertex {v} belongs to no triangle");
                return Err(Error::InvalidInput(message));
            }
            Some(true) => {}
        }
    }
    Ok(Landmarks {
        positions: vertices.map(|v| mesh.positions[v as usize]),
        vertices,
        confidence: [1.0; LANDMARKS],
    })
}

/// [`from_positions`], except that a point at its own vertex stays on that vertex. Where both points
/// of a pair of inner lips lie on the same lip, the one of the other lip goes to its own.
fn from_known(mesh: &Mesh, landmarks: &[KnownLandmark]) -> Result<Landmarks> {
    let positions: Vec<[f32; 3]> = landmarks.iter().map(|landmark| landmark.position).collect();
    let mut known = from_positions(mesh, &positions)?;
    let reach = AT_VERTEX_IN_EYE_DISTANCES * eye_distance(&known.positions);
    let used: HashSet<u32> = mesh.triangles.as_flattened().iter().copied().collect();
    let snapped = known.clone();
    for (i, landmark) in landmarks.iter().enumerate() {
        let (point, vertex) = (landmark.position, landmark.vertex);
        known.confidence[i] = checked_confidence(i, landmark.confidence)?;
        let place = mesh.positions.get(vertex as usize);
        let place = place.filter(|place| {
            Vec3::from(**place).distance(point.into()) <= reach && used.contains(&vertex)
        });
        if let Some(place) = place {
            (known.positions[i], known.vertices[i]) = (*place, vertex);
        }
    }
    for i in on_the_other_lip(mesh, &known) {
        (known.positions[i], known.vertices[i]) = (snapped.positions[i], snapped.vertices[i]);
    }
    Ok(known)
}

/// The inner-lip landmarks whose vertex lies on the other lip, where the landmark that faces them
/// lies too.
fn on_the_other_lip(mesh: &Mesh, landmarks: &Landmarks) -> Vec<usize> {
    let (vertices, reach) = (&landmarks.vertices, eye_distance(&landmarks.positions));
    let lips = lip_of_vertices(mesh, &vertices[49..54], &vertices[55..60], reach);
    let lip_at = |i: usize| lips[vertices[i] as usize];
    let pairs = INNER_LIPS.into_iter();
    let together = pairs.filter(|&(upper, lower)| lip_at(upper) == lip_at(lower));
    together
        .flat_map(|(upper, lower)| [upper, lower])
        .filter(|&i| lip_at(i).is_some() && lip_at(i) != lip_of_landmark(i))
        .collect()
}

fn checked_confidence(i: usize, confidence: f32) -> Result<f32> {
    if (0.0..=1.0).contains(&confidence) {
        Ok(confidence)
    } else {
        Err(Error::InvalidInput(format!(
            "landmark {i}: expected a confidence of 0 to 1, got {confidence}"
        )))
    }
}

fn sixty_eight<T: Copy>(items: &[T], expected: &str) -> Result<[T; LANDMARKS]> {
    items.try_into().map_err(|_| Error::ShapeMismatch {
        what: "landmarks",
        expected: expected.into(),
        got: expected.replace("68", &items.len().to_string()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::canonical_landmarks;

    /// A mesh with one tiny triangle around each mean landmark: enough surface to land on.
    pub(crate) fn confetti() -> Mesh {
        let mut mesh = Mesh::default();
        for p in canonical_landmarks() {
            let first = mesh.positions.len() as u32;
            for d in [[0.0, 0.0], [1e-4, 0.0], [0.0, 1e-4]] {
                mesh.positions.push([p[0] + d[0], p[1] + d[1], p[2]]);
            }
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        mesh
    }

    fn locate(mesh: &Mesh, source: LandmarkSource) -> Result<Landmarks> {
        let options = FaceOptions {
            landmarks: Some(source),
            ..FaceOptions::default()
        };
        locate_landmarks(mesh, &options)
    }

    #[test]
    fn positions_land_on_the_surface() {
        let floating = canonical_landmarks().map(|p| [p[0], p[1], p[2] + 0.0002]);
        let located = locate(&confetti(), LandmarkSource::Positions(floating.into())).unwrap();
        for (i, p) in canonical_landmarks().iter().enumerate() {
            assert!(Vec3::from(located.positions[i]).distance((*p).into()) < 2e-4);
            assert_eq!(located.vertices[i] as usize / 3, i);
        }
    }

    #[test]
    fn wrong_counts_say_what_was_expected() {
        let points = LandmarkSource::Positions(vec![[0.0; 3]; 51]);
        let error = locate(&confetti(), points).unwrap_err().to_string();
        assert_eq!(error, "landmarks: expected [68, 3], got [51, 3]");
        let numbers = LandmarkSource::Vertices(vec![0; 69]);
        let error = locate(&confetti(), numbers).unwrap_err().to_string();
        assert_eq!(error, "landmarks: expected [68], got [69]");
    }

    #[test]
    fn vertices_out_of_range_or_unused_are_named() {
        let mut mesh = confetti();
        mesh.positions.push([0.0; 3]);
        let mut vertices: Vec<u32> = (0..68).map(|i| 3 * i).collect();
        assert!(locate(&mesh, LandmarkSource::Vertices(vertices.clone())).is_ok());
        vertices[7] = 204;
        let error = locate(&mesh, LandmarkSource::Vertices(vertices.clone())).unwrap_err();
        assert!(error.to_string().contains("landmark 7"), "{error}");
        vertices[7] = 900;
        let error = locate(&mesh, LandmarkSource::Vertices(vertices)).unwrap_err();
        assert!(error.to_string().contains("below 205"), "{error}");
    }

    #[test]
    fn far_or_broken_points_are_named() {
        let mut points = canonical_landmarks().to_vec();
        points[30][2] += 0.1;
        let error = locate(&confetti(), LandmarkSource::Positions(points.clone())).unwrap_err();
        assert!(error.to_string().contains("landmark 30"), "{error}");
        points[30][2] = f32::NAN;
        let error = locate(&confetti(), LandmarkSource::Positions(points)).unwrap_err();
        assert!(error.to_string().contains("not finite"), "{error}");
    }

    #[test]
    fn points_at_their_vertices_stay_on_them() {
        let mesh = confetti();
        let located = locate(&mesh, LandmarkSource::Vertices((0..68).collect())).unwrap();
        let known = locate(&mesh, LandmarkSource::from(&located)).unwrap();
        assert_eq!(known, located);
        // A stale vertex number is ignored.
        let mut stale = located.clone();
        stale.vertices = stale.vertices.map(|vertex| 1_000_000 - vertex);
        let stale = locate(&mesh, LandmarkSource::from(&stale)).unwrap();
        let plain = locate(&mesh, LandmarkSource::Positions(located.positions.into())).unwrap();
        assert_eq!(stale, plain);
    }

    #[test]
    fn known_landmarks_stay_as_sure_as_they_were() {
        let mut located = locate(&confetti(), LandmarkSource::Vertices((0..68).collect())).unwrap();
        located.confidence[40] = 0.25;
        let known = locate(&confetti(), LandmarkSource::from(&located)).unwrap();
        assert_eq!(known.confidence, located.confidence);
        located.confidence[40] = 1.5;
        let error = locate(&confetti(), LandmarkSource::from(&located)).unwrap_err();
        assert!(error.to_string().contains("landmark 40"), "{error}");
    }

    #[test]
    fn a_mesh_without_triangles_is_refused() {
        let source = LandmarkSource::Vertices(vec![0; 68]);
        assert!(matches!(
            locate(&Mesh::default(), source),
            Err(Error::Mesh(_))
        ));
    }
}
