//! Creases: folds of the skin between the landmarks, transferred from a reference face by correspondence.
//!
//! Twin of `training/deform/creases.py`.
//!
//! `ΔV = … + s(v) B(v) C ΔL`
//!
//! 68 landmarks cannot tell how the skin folds between the brows, beside the nose and over the
//! cheeks, and a network over them smooths the folds away. On a reference face the residual of
//! every point is a linear function of the landmarks' motion. `C` holds combinations of that
//! motion, and `B` their effect at points of that face's surface. [`ReferencePoints`] transfers
//! them to another face. There is one reference for each kind of face that the static weights know.
//! A face follows the reference of the kind nearest to it, because every artist folds skin in other
//! places.
//!
//! Lengths are decimetres in the canonical frame.

use std::path::Path;

use ndarray::Array2;
use serde::Deserialize;

use super::correspondence::{FollowingFace, ReferencePoints};
use crate::{
    Error, Result,
    mesh::ibug::LANDMARKS,
    models::{BuiltIn, Weights},
};

/// The built-in weights of the creases.
pub static MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::CREASES);

const COORDINATES: usize = 3 * LANDMARKS;

#[derive(Deserialize)]
struct Config {
    faces: Vec<FaceConfig>,
}

#[derive(Deserialize)]
struct FaceConfig {
    name: String,
    points: usize,
    rank: usize,
}

/// The creases of every reference face.
#[derive(Debug, Clone)]
pub struct Creases {
    /// In the order of the static weights' kinds; at least one.
    faces: Vec<ReferenceFace>,
}

/// The creases of one reference face.
#[derive(Debug, Clone)]
pub struct ReferenceFace {
    reference: ReferencePoints,
    /// `B`: `[P, 3 K]`, axis by axis.
    cross: Array2<f32>,
    /// `C`: `[K, 204]`.
    motion: Array2<f32>,
}

impl Creases {
    /// The built-in creases, or those of `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, damaged, or does not fit the other.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = MODEL.open(folder)?;
        Self::load(&Weights::from_bytes(&files.weights)?, &files.config)
    }

    fn load(weights: &Weights, config: &str) -> Result<Self> {
        let wrong =
            |message: String| Error::Weights(format!("{}/config.json: {message}", MODEL.name));
        let config: Config = serde_json::from_str(config).map_err(|e| wrong(e.to_string()))?;
        if config.faces.is_empty() {
            return Err(wrong("expected one face at least, got none".to_owned()));
        }
        let face = |face: &FaceConfig| {
            ReferenceFace::load(&weights.pp(&face.name), face.points, face.rank)
        };
        Ok(Creases {
            faces: config.faces.iter().map(face).collect::<Result<_>>()?,
        })
    }

    /// The reference for a kind of face in the static weights; the last one if the kind has none of
    /// its own.
    pub fn of_kind(&self, kind: usize) -> &ReferenceFace {
        &self.faces[kind.min(self.faces.len() - 1)]
    }
}

impl ReferenceFace {
    fn load(weights: &Weights, points: usize, rank: usize) -> Result<Self> {
        let places = |name: &str, count| -> Result<Vec<[f32; 3]>> {
            let values = weights.values(name, &[count, 3])?;
            Ok(values.as_chunks::<3>().0.to_vec())
        };
        let landmarks = places("landmarks", LANDMARKS)?;
        let reference = ReferencePoints {
            points: places("points", points)?,
            normals: places("normals", points)?,
            landmarks: std::array::from_fn(|n| landmarks[n]),
        };
        if let Some([one, other]) = reference.coinciding() {
            let message = format!("{}: expected 68 places, {one} is {other}", MODEL.name);
            return Err(Error::Weights(message));
        }
        let cross = weights.values("cross", &[points, 3, rank])?;
        Ok(ReferenceFace {
            reference,
            cross: Array2::from_shape_vec((points, 3 * rank), cross)
                .expect("checked by the reader"),
            motion: weights.matrix("motion", rank, COORDINATES)?,
        })
    }

    /// `C`: `[K, 204]`, over landmark coordinates x0, y0, z0, x1, …
    pub fn motion(&self) -> &Array2<f32> {
        &self.motion
    }

    /// `s B` on a face, `[V, 3 K]`, axis by axis.
    pub fn carried_to(&self, face: FollowingFace<'_>) -> Array2<f32> {
        self.reference.carried_to(face).of(self.cross.view())
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::{mesh::ibug::MIRROR, nn::golden::Golden};

    fn places(golden: &Golden, name: &str) -> Vec<[f32; 3]> {
        golden.values(name).as_chunks::<3>().0.to_vec()
    }

    fn carried(
        creases: &ReferenceFace,
        positions: &[[f32; 3]],
        triangles: &[[u32; 3]],
        landmarks: &[[f32; 3]; LANDMARKS],
    ) -> Array2<f32> {
        creases.carried_to(FollowingFace {
            positions,
            triangles,
            landmarks,
        })
    }

    fn golden() -> (Golden, ReferenceFace) {
        let golden = Golden::open("creases_debug");
        let creases = Creases::load(&golden.weights(), &golden.metadata("config")).unwrap();
        (golden, creases.of_kind(0).clone())
    }

    #[test]
    fn carried_creases_match_the_python_twin() {
        let (golden, creases) = golden();
        let landmarks = places(&golden, "landmarks");
        let positions = places(&golden, "positions");
        let corners = golden.integers("triangles");
        let mut triangles: Vec<[u32; 3]> = corners
            .chunks(3)
            .map(|t| [t[0] as u32, t[1] as u32, t[2] as u32])
            .collect();
        let landmarks = std::array::from_fn(|n| landmarks[n]);
        let got = carried(&creases, &positions, &triangles, &landmarks);
        let expected = golden.values("carried");
        assert!(expected.iter().any(|x| x.abs() > 0.1));
        assert_eq!(got.len(), expected.len());
        for (a, b) in got.iter().zip(&expected) {
            assert!((a - b).abs() < 1e-3, "expected {b}, got {a}");
        }
        let turned = triangles.iter_mut().step_by(3);
        turned.for_each(|triangle| triangle.swap(0, 2));
        let again = carried(&creases, &positions, &triangles, &landmarks);
        for (a, b) in again.iter().zip(&got) {
            assert!((a - b).abs() < 1e-4, "expected {b}, got {a}");
        }
    }

    #[test]
    fn far_from_the_face_nothing_moves() {
        let (_, creases) = golden();
        let far = [[0.0, 3.0, 0.0], [0.1, 3.0, 0.0], [f32::MAX; 3]];
        let moved = carried(&creases, &far, &[[0, 1, 2]], &creases.reference.landmarks);
        assert!(moved.iter().all(|x| *x == 0.0));
    }

    #[test]
    fn a_kind_without_a_reference_follows_the_last_and_none_at_all_is_an_error() {
        let creases = Creases::open(None).unwrap();
        let rows = |kind| creases.of_kind(kind).reference.points.len();
        assert_ne!(rows(0), rows(1));
        assert_eq!(rows(1), rows(7));
        let (golden, _) = golden();
        let none = Creases::load(&golden.weights(), r#"{"faces": []}"#);
        assert!(
            matches!(none, Err(Error::Weights(message)) if message.contains("one face at least"))
        );
    }

    #[test]
    fn the_shipped_creases_are_the_same_on_both_sides() {
        let creases = Creases::open(None).unwrap();
        (0..2).for_each(|kind| same_on_both_sides(creases.of_kind(kind)));
    }

    fn same_on_both_sides(creases: &ReferenceFace) {
        let flip = |p: [f32; 3]| [-p[0], p[1], p[2]];
        let landmarks = creases.reference.landmarks;
        for n in 0..LANDMARKS {
            assert!(Vec3::from(flip(landmarks[MIRROR[n]])).distance(landmarks[n].into()) < 1e-4);
        }
        // Small triangles on the surface, and their mirror images.
        let around = |(p, n): (&[f32; 3], &[f32; 3])| {
            let along = 0.01 * Vec3::from(*n).cross(Vec3::new(1.0, 0.3, 0.0));
            let beside = Vec3::from(*n).cross(along);
            [
                *p,
                std::array::from_fn(|i| p[i] + along[i]),
                std::array::from_fn(|i| p[i] + beside[i]),
            ]
        };
        let surface = creases.reference.points[..200]
            .iter()
            .zip(&creases.reference.normals);
        let points: Vec<[f32; 3]> = surface.flat_map(around).collect();
        let triangles: Vec<[u32; 3]> = (0..200).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let reflected: Vec<[f32; 3]> = points.iter().map(|&p| flip(p)).collect();
        let here = carried(creases, &points, &triangles, &landmarks);
        let there = carried(creases, &reflected, &triangles, &landmarks);
        // Lowers the brow on one side alone, then the brow on the other.
        let rank = creases.motion.nrows();
        let mut brow = ndarray::Array1::zeros(COORDINATES);
        for n in 22..27 {
            brow[3 * n + 1] = -0.05;
        }
        let mut other = ndarray::Array1::zeros(COORDINATES);
        for n in 0..LANDMARKS {
            other[3 * n + 1] = brow[3 * MIRROR[n] + 1];
        }
        let (one, two) = (creases.motion.dot(&brow), creases.motion.dot(&other));
        let mut largest = 0.0f32;
        for v in 0..points.len() {
            for axis in 0..3 {
                let sum = |b: &Array2<f32>, c: &ndarray::Array1<f32>| -> f32 {
                    (0..rank).map(|k| b[[v, axis * rank + k]] * c[k]).sum()
                };
                let sign = if axis == 0 { -1.0 } else { 1.0 };
                let (a, b) = (sum(&here, &one), sign * sum(&there, &two));
                largest = largest.max(a.abs());
                assert!((a - b).abs() < 1e-3, "{a} here, {b} there (dm)");
            }
        }
        assert!(largest > 5e-3, "{largest}");
    }
}
