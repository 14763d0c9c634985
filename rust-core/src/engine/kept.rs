//! What is kept of a mesh between runs: its landmarks, parts and weights, whole.
//!
//! Entries are named by everything they depend on: the mesh, the options, the models, and the code
//! itself. A mesh that was seen before costs reading its file and these two entries.

use ndarray::Array2;

use super::{Engine, STM_MODEL};
use crate::{
    Result,
    deform::{Corrected, LandmarkWeights, PartList},
    mesh::{self, FaceOptions, Landmarks, Mesh, Similarity},
    motion::LANDMARKS,
    operators::{Arrays, CacheKey},
    progress::ProgressFn,
    systems::freetalk::stm,
    weights::ModelFiles,
};

const FINDER_MODEL: &str = "landmarks";
const COORDINATES: usize = 3 * LANDMARKS;

/// The part of every name that a mesh and an engine contribute.
pub(super) fn key_of(mesh: &Mesh, models: &CacheKey) -> CacheKey {
    models
        .clone()
        .f32s(mesh.positions.as_flattened())
        .u32s(mesh.triangles.as_flattened())
}

/// Names the code and the models that per-mesh work depends on.
///
/// # Errors
/// Those of [`ModelFiles::open`].
pub(super) fn key_of_models(folder: Option<&std::path::Path>) -> Result<CacheKey> {
    let mut key = CacheKey::new("prepared", 1).text(env!("ANYFACE_SOURCES"));
    if folder.is_some() {
        for model in [STM_MODEL, FINDER_MODEL] {
            let files = ModelFiles::open(model, folder)?;
            key = key.bytes(&files.weights).text(&files.config);
        }
    }
    Ok(key)
}

impl Engine {
    /// The landmarks that `options` give or leave to be found, and the parts of the mesh.
    pub(super) fn kept_landmarks(
        &self,
        key: &CacheKey,
        mesh: &Mesh,
        options: &FaceOptions,
        progress: ProgressFn<'_>,
    ) -> Result<(Landmarks, PartList)> {
        let find = || {
            let landmarks = mesh::locate_landmarks_with(&self.finder, mesh, options, progress)?;
            let to_canonical = mesh::align_to_canonical(&landmarks)?;
            let parts = PartList::find(mesh, &landmarks, &to_canonical, &options.parts)?;
            Ok((landmarks, parts))
        };
        let encode = |(landmarks, parts): &(Landmarks, PartList)| {
            let mut arrays = landmarks_to_arrays(landmarks);
            arrays.insert_json("parts", parts);
            arrays
        };
        let decode = |mut arrays: Arrays| {
            let landmarks = landmarks_from_arrays(&mut arrays)?;
            Some((landmarks, arrays.take_json("parts")?))
        };
        let key = key.clone().text("landmarks").text(&format!("{options:?}"));
        self.cache.get_or_make(&key, decode, encode, find)
    }

    /// The `static` decoder with its corrections.
    pub(super) fn kept_weights(
        &self,
        key: &CacheKey,
        mesh: &Mesh,
        (landmarks, to_canonical, parts): (&Landmarks, &Similarity, &PartList),
        options: &FaceOptions,
        progress: ProgressFn<'_>,
    ) -> Result<Corrected<LandmarkWeights>> {
        let solve = || {
            stm::prepare_static(
                &self.stm,
                mesh,
                landmarks,
                to_canonical,
                parts,
                &self.cache,
                options.learned,
                options.proxy,
                progress,
            )
        };
        let key = key
            .clone()
            .text("weights")
            .text(&format!("{options:?}"))
            .f32s(landmarks.positions.as_flattened())
            .u32s(&landmarks.vertices);
        let encode = |face: &Corrected<LandmarkWeights>| {
            let mut arrays = weights_to_arrays(&face.decoder);
            arrays.insert_json("corrections", &face.corrections);
            arrays
        };
        let decode = |mut arrays: Arrays| {
            Some(Corrected {
                decoder: weights_from_arrays(&mut arrays, mesh.positions.len())?,
                corrections: arrays.take_json("corrections")?,
            })
        };
        self.cache.get_or_make(&key, decode, encode, solve)
    }
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

fn weights_to_arrays(weights: &LandmarkWeights) -> Arrays {
    let mut arrays = Arrays::default();
    for (name, matrix) in [
        ("mix", &weights.mix),
        ("cross", &weights.cross),
        ("motion", &weights.motion),
    ] {
        arrays.insert_f32(name, matrix.shape(), matrix.iter().copied().collect());
    }
    arrays
}

fn weights_from_arrays(arrays: &mut Arrays, vertices: usize) -> Option<LandmarkWeights> {
    let mut take = |name: &str| {
        let (shape, values) = arrays.take_f32(name)?;
        let shape: [usize; 2] = shape.try_into().ok()?;
        Array2::from_shape_vec(shape, values).ok()
    };
    let (mix, cross, motion) = (take("mix")?, take("cross")?, take("motion")?);
    let fits = mix.dim() == (vertices, LANDMARKS)
        && cross.dim() == (vertices, 3 * motion.nrows())
        && motion.ncols() == COORDINATES;
    fits.then_some(LandmarkWeights { mix, cross, motion })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_comes_back() {
        let landmarks = Landmarks {
            positions: std::array::from_fn(|n| [n as f32, 0.5, -1.0]),
            vertices: std::array::from_fn(|n| 3 * n as u32),
            confidence: [0.25; LANDMARKS],
        };
        let mut arrays = landmarks_to_arrays(&landmarks);
        assert_eq!(landmarks_from_arrays(&mut arrays), Some(landmarks));
        let weights = LandmarkWeights {
            mix: Array2::from_elem((5, LANDMARKS), 0.5),
            cross: Array2::from_elem((5, 6), -1.0),
            motion: Array2::from_elem((2, COORDINATES), 2.0),
        };
        let mut arrays = weights_to_arrays(&weights);
        assert_eq!(weights_from_arrays(&mut arrays.clone(), 4), None);
        assert_eq!(weights_from_arrays(&mut arrays, 5), Some(weights));
    }
}
