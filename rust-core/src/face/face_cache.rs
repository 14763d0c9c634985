//! Keeps the landmarks and the parts of a face between runs.
//!
//! The key of an entry covers everything the entry depends on: the mesh, the options, the models,
//! and the code itself. A mesh that was seen before only costs reading its file and its entry.

use super::{FaceOptions, PartList};
use crate::{
    Result,
    cache::{Arrays, Cache, CacheKey},
    mesh::{Landmarks, Mesh, ibug::LANDMARKS},
};

/// The key of a mesh: that of the `models`, extended by the mesh. Every key of a face extends it.
pub(super) fn key_of(mesh: &Mesh, models: &CacheKey) -> CacheKey {
    models
        .clone()
        .f32s(mesh.positions.as_flattened())
        .u32s(mesh.triangles.as_flattened())
}

/// The key of a face whose landmarks are known. `mesh`: the key of its mesh.
pub(super) fn key_of_face(
    mesh: &CacheKey,
    options: &FaceOptions,
    landmarks: &Landmarks,
) -> CacheKey {
    mesh.clone()
        .text(&format!("{options:?}"))
        .f32s(landmarks.positions.as_flattened())
        .u32s(&landmarks.vertices)
        .f32s(&landmarks.confidence)
}

/// The landmarks and the parts of a mesh, from the cache or else from `find`.
pub(super) fn landmarks(
    cache: &Cache,
    mesh: &CacheKey,
    options: &FaceOptions,
    find: impl FnOnce() -> Result<(Landmarks, PartList)>,
) -> Result<(Landmarks, PartList)> {
    let encode = |(landmarks, parts): &(Landmarks, PartList)| {
        let mut arrays = landmarks_to_arrays(landmarks);
        arrays.insert_json("parts", parts);
        arrays
    };
    let decode = |mut arrays: Arrays| {
        let landmarks = landmarks_from_arrays(&mut arrays)?;
        Some((landmarks, arrays.take_json("parts")?))
    };
    let key = mesh.clone().text("landmarks").text(&format!("{options:?}"));
    cache.get_or_make(&key, decode, encode, find)
}

fn landmarks_to_arrays(landmarks: &Landmarks) -> Arrays {
    let mut arrays = Arrays::default();
    let positions = landmarks.positions.as_flattened().to_vec();
    arrays.insert_f32("positions", &[LANDMARKS, 3], positions);
    arrays.insert_u32("vertices", &[LANDMARKS], landmarks.vertices.to_vec());
    arrays.insert_f32("confidence", &[LANDMARKS], landmarks.confidence.to_vec());
    arrays
}

fn landmarks_from_arrays(arrays: &mut Arrays) -> Option<Landmarks> {
    let (_, positions) = arrays.take_f32("positions")?;
    let (_, vertices) = arrays.take_u32("vertices")?;
    let (_, confidence) = arrays.take_f32("confidence")?;
    let (points, _) = positions.as_chunks::<3>();
    Some(Landmarks {
        positions: points.try_into().ok()?,
        vertices: vertices.try_into().ok()?,
        confidence: confidence.try_into().ok()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_landmarks_come_back() {
        let landmarks = Landmarks {
            positions: std::array::from_fn(|n| [n as f32, 0.5, -1.0]),
            vertices: std::array::from_fn(|n| 3 * n as u32),
            confidence: [0.25; LANDMARKS],
        };
        let mut arrays = landmarks_to_arrays(&landmarks);
        assert_eq!(landmarks_from_arrays(&mut arrays), Some(landmarks));
    }
}
