//! The default decoder: per-vertex weights over the 68 landmarks, fixed for a mesh.
//!
//! Twin of `training/deform/static_weights.py`.
//!
//! `ΔV = W ΔL + α f (A ΔL + B C ΔL)`
//!
//! `W` are the training-free weights of [`PlateWeights`], and `α` is the strength of the learned
//! part. `A` mixes landmarks as `W` does. `B` and `C` let the axes mix: for example, an opening jaw
//! pushes the lip back. `f` is the familiarity. The network learned from two kinds of faces and
//! does harm on other kinds. So `f` falls with the distance of the neutral landmarks from those of
//! the learned faces. `A` and `B` come from a pointwise network on features that relate each vertex
//! to the landmarks. The network runs on the mesh and on its mirror image, so that the mean of both
//! moves a symmetric face symmetrically.
//!
//! Lengths are decimetres in the canonical frame.

use std::path::Path;

use ndarray::{Array1, Array2, ArrayViewMut1, Axis, concatenate, s};
use serde::Deserialize;

use super::PlateWeights;
use crate::{
    Error, Result,
    mesh::ibug::{LANDMARKS, MIRROR},
    models::{BuiltIn, Weights},
    nn::{elementwise::silu_all, linear::Linear},
};

/// The built-in weights of the network.
pub static MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::STATIC_WEIGHTS);

/// Outputs of the network are multiplied by this, so that training starts near zero.
const CORRECTION_SCALE: f32 = 0.1;
/// Remoteness at which the correction has faded to nothing. It is full up to a remoteness of 1
/// less.
const FADED_AT: f32 = 3.0;
/// A face within this distance of the learned faces is fully familiar. 95 % of unseen identities
/// and warps lie under 0.75.
const KNOWN: f32 = 0.9;
/// From this distance on, only the floor is left. Faces of another kind lie at 1.45 and more.
const UNKNOWN: f32 = 1.3;
/// Standard deviation of a landmark's error, decimetres.
const SHAPE_NOISE_DM: f32 = 0.007;
/// Position, offset from and distance to each landmark, plate weights, nearness to the landmarks.
const FEATURES: usize = 3 + 3 * LANDMARKS + LANDMARKS + LANDMARKS + 1;
const COORDINATES: usize = 3 * LANDMARKS;

/// Sizes of the network, as `config.json` states them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct StaticConfig {
    /// Hidden channels.
    pub width: usize,
    /// `R`, the rank of the part in which the axes mix.
    pub rank: usize,
    /// Number of kinds of faces that the network learned.
    pub kinds: usize,
    /// Number of principal axes of the landmarks of each kind.
    pub shape_modes: usize,
    /// Share of the correction that is left on a face of another kind.
    pub floor: f32,
}

/// The network behind `A`, `B` and `C`.
pub struct StaticWeights {
    config: StaticConfig,
    layers: [Linear; 3],
    mix: Linear,
    cross: Linear,
    /// `[R, 204]`.
    motion: Array2<f32>,
    feature_mean: Vec<f32>,
    feature_scale: Vec<f32>,
    /// `[kinds, 204]`, mean landmarks of each kind.
    shape_mean: Array2<f32>,
    /// For each kind `[shape_modes, 204]`: principal axes, shortened to allow for the noise.
    shape_basis: Vec<Array2<f32>>,
}

/// The network's input for the vertices, which are `R'` rows of a surface.
pub struct VertexGeometry<'a> {
    /// `[R']`, decimetres.
    pub positions: &'a [[f32; 3]],
    /// The landmarks of the neutral face, decimetres.
    pub landmarks: &'a [[f32; 3]; LANDMARKS],
    /// The training-free weights of the same rows.
    pub plate: &'a PlateWeights,
}

/// The learned part of the weights, at full strength.
pub struct Correction {
    /// `A`: `[R', 68]`.
    pub mix: Array2<f32>,
    /// `B`: `[R', 3 · 2R]`, axis by axis. The combinations of the face come first, then those of
    /// its mirror image, then those that [`Self::beside`] added.
    pub cross: Array2<f32>,
    /// `C`: `[2R, 204]`, plus the rows that [`Self::beside`] added.
    pub motion: Array2<f32>,
}

impl Correction {
    /// The same correction with further combinations: `cross` `[R', 3 K]`, `motion` `[K, 204]`.
    pub fn beside(self, cross: &Array2<f32>, motion: &Array2<f32>) -> Correction {
        let (learned_rank, added_rank) = (self.motion.nrows(), motion.nrows());
        let mut both = Array2::zeros((cross.nrows(), 3 * (learned_rank + added_rank)));
        for axis in 0..3 {
            let first = axis * (learned_rank + added_rank);
            let parts = [
                (&self.cross, learned_rank, first),
                (cross, added_rank, first + learned_rank),
            ];
            for (from, rank, first) in parts {
                let columns = from.slice(s![.., axis * rank..(axis + 1) * rank]);
                both.slice_mut(s![.., first..first + rank]).assign(&columns);
            }
        }
        let motions = [self.motion.view(), motion.view()];
        Correction {
            mix: self.mix,
            cross: both,
            motion: concatenate(Axis(0), &motions).expect("204 columns each"),
        }
    }
}

impl StaticWeights {
    /// Loads the bytes of `model.safetensors` and the text of `config.json`.
    ///
    /// # Errors
    /// `Weights` if either is damaged or they do not fit each other.
    pub fn load(weights: &[u8], config: &str) -> Result<Self> {
        let config = serde_json::from_str(config)
            .map_err(|e| Error::Weights(format!("{}/config.json: {e}", MODEL.name)))?;
        Self::new(config, &Weights::from_bytes(weights)?)
    }

    /// Opens the built-in weights, or those of `folder`.
    ///
    /// # Errors
    /// Those of [`BuiltIn::open`] and [`Self::load`].
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = MODEL.open(folder)?;
        Self::load(&files.weights, &files.config)
    }

    /// Builds the network from weights already read.
    ///
    /// # Errors
    /// `Weights` if one is missing or has another shape.
    pub fn new(config: StaticConfig, weights: &Weights) -> Result<Self> {
        let (width, rank) = (config.width, config.rank);
        let layer = |name: &str, inputs| Linear::load(&weights.pp(name), inputs, width);
        let (kinds, modes) = (config.kinds, config.shape_modes);
        let shape_mean = weights.values("shape_mean", &[kinds, COORDINATES])?;
        let shape_basis = weights.values("shape_basis", &[kinds, modes, COORDINATES])?;
        Ok(StaticWeights {
            layers: [
                layer("layer_0", FEATURES)?,
                layer("layer_1", width)?,
                layer("layer_2", width)?,
            ],
            mix: Linear::load(&weights.pp("mix"), width, LANDMARKS)?,
            cross: Linear::load(&weights.pp("cross"), width, 3 * rank)?,
            motion: weights.pp("motion").matrix("weight", rank, COORDINATES)?,
            feature_mean: weights.values("feature_mean", &[FEATURES])?,
            feature_scale: weights.values("feature_scale", &[FEATURES])?,
            shape_mean: rows(shape_mean),
            shape_basis: shape_basis
                .chunks((modes * COORDINATES).max(1))
                .map(|basis| rows(basis.to_vec()))
                .collect(),
            config,
        })
    }

    /// `f`, from the config's floor to 1: the share of the correction that applies.
    ///
    /// `landmarks`: of the neutral face, decimetres.
    pub fn familiarity(&self, landmarks: &[[f32; 3]; LANDMARKS]) -> f32 {
        self.config.floor + (1.0 - self.config.floor) * self.known(landmarks)
    }

    /// How well a face fits one of the learned kinds, 0 to 1.
    ///
    /// `landmarks`: of the neutral face, decimetres.
    pub fn known(&self, landmarks: &[[f32; 3]; LANDMARKS]) -> f32 {
        let (_, strangeness) = self.nearest_kind(landmarks);
        ((UNKNOWN - strangeness) / (UNKNOWN - KNOWN)).clamp(0.0, 1.0)
    }

    /// The learned kind of face that is nearest to this one.
    ///
    /// `landmarks`: of the neutral face, decimetres.
    pub fn kind(&self, landmarks: &[[f32; 3]; LANDMARKS]) -> usize {
        self.nearest_kind(landmarks).0
    }

    /// The nearest kind and the Mahalanobis distance from it, which is about 0.5 for a face of that
    /// kind.
    fn nearest_kind(&self, landmarks: &[[f32; 3]; LANDMARKS]) -> (usize, f32) {
        let kinds = self.shape_mean.rows().into_iter().zip(&self.shape_basis);
        let squared = kinds.map(|(mean, basis)| {
            let offset =
                Array1::from_iter(landmarks.iter().flatten().zip(mean).map(|(x, m)| x - m));
            let explained = basis.dot(&offset).pow2().sum();
            (offset.pow2().sum() - explained).max(0.0) / SHAPE_NOISE_DM.powi(2)
        });
        let nearest = squared.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        let (kind, squared) = nearest.unwrap_or((0, f32::INFINITY));
        (kind, (squared / COORDINATES as f32).sqrt())
    }

    /// `A`, `B` and `C` at full strength, as the mean of the mesh and its mirror image.
    pub fn correction(&self, geometry: &VertexGeometry<'_>) -> Correction {
        let rank = self.config.rank;
        let (plain_mix, plain_cross) = self.one_sided(geometry, false);
        let (reflected_mix, reflected_cross) = self.one_sided(geometry, true);
        let rows = plain_mix.nrows();
        let mix = Array2::from_shape_fn((rows, LANDMARKS), |(v, n)| {
            0.5 * (plain_mix[[v, n]] + reflected_mix[[v, MIRROR[n]]])
        });
        let mut cross = Array2::zeros((rows, 6 * rank));
        for axis in 0..3 {
            let from = s![.., axis * rank..(axis + 1) * rank];
            let sign = if axis == 0 { -0.5 } else { 0.5 };
            let first = 2 * axis * rank;
            cross
                .slice_mut(s![.., first..first + rank])
                .assign(&(&plain_cross.slice(from) * 0.5));
            cross
                .slice_mut(s![.., first + rank..first + 2 * rank])
                .assign(&(&reflected_cross.slice(from) * sign));
        }
        Correction {
            mix,
            cross,
            motion: self.both_motions(),
        }
    }

    /// `C`, and below it the `C` of the reflected motion.
    fn both_motions(&self) -> Array2<f32> {
        let rank = self.config.rank;
        Array2::from_shape_fn((2 * rank, COORDINATES), |(r, c)| {
            if r < rank {
                return self.motion[[r, c]];
            }
            let (landmark, axis) = (c / 3, c % 3);
            let sign = if axis == 0 { -1.0 } else { 1.0 };
            sign * self.motion[[r - rank, 3 * MIRROR[landmark] + axis]]
        })
    }

    /// Runs the network on one side. Returns `A` `[R', 68]` and `B` `[R', 3 R]`.
    fn one_sided(
        &self,
        geometry: &VertexGeometry<'_>,
        reflected: bool,
    ) -> (Array2<f32>, Array2<f32>) {
        let mut x = self.features(geometry, reflected);
        for layer in &self.layers {
            x = layer.forward_then(&x, silu_all);
        }
        let (mut mix, mut cross) = (self.mix.forward(&x), self.cross.forward(&x));
        for (v, remoteness) in geometry.plate.remoteness.iter().enumerate() {
            let scale = CORRECTION_SCALE * (FADED_AT - *remoteness as f32).clamp(0.0, 1.0);
            mix.row_mut(v).mapv_inplace(|x| scale * x);
            cross.row_mut(v).mapv_inplace(|x| scale * x);
        }
        (mix, cross)
    }

    /// Normalised features `[R', 344]`.
    fn features(&self, geometry: &VertexGeometry<'_>, reflected: bool) -> Array2<f32> {
        let side = if reflected { -1.0 } else { 1.0 };
        let turn = |p: [f32; 3]| [side * p[0], p[1], p[2]];
        let order: [usize; LANDMARKS] =
            std::array::from_fn(|n| if reflected { MIRROR[n] } else { n });
        let landmarks = order.map(|n| turn(geometry.landmarks[n]));
        let mut out = Array2::zeros((geometry.positions.len(), FEATURES));
        for (v, mut row) in out.rows_mut().into_iter().enumerate() {
            let plate = &geometry.plate.weights[v * LANDMARKS..(v + 1) * LANDMARKS];
            relate(&mut row, turn(geometry.positions[v]), &landmarks);
            for n in 0..LANDMARKS {
                row[3 + 4 * LANDMARKS + n] = plate[order[n]];
            }
            row[FEATURES - 1] = (-geometry.plate.remoteness[v].min(1e3)).exp() as f32;
            for (i, x) in row.iter_mut().enumerate() {
                *x = (*x - self.feature_mean[i]) / self.feature_scale[i];
            }
        }
        out
    }
}

/// Reshapes values to `[_, 204]`.
fn rows(values: Vec<f32>) -> Array2<f32> {
    Array2::from_shape_vec((values.len() / COORDINATES, COORDINATES), values)
        .expect("the weights' shape was checked")
}

/// Writes the position, the offsets and the distances into a row of features.
fn relate(row: &mut ArrayViewMut1<'_, f32>, position: [f32; 3], landmarks: &[[f32; 3]; LANDMARKS]) {
    for axis in 0..3 {
        row[axis] = position[axis];
    }
    for (n, landmark) in landmarks.iter().enumerate() {
        let mut squared = 0.0;
        for axis in 0..3 {
            let offset = position[axis] - landmark[axis];
            row[3 + 3 * n + axis] = offset;
            squared += offset * offset;
        }
        row[3 + 3 * LANDMARKS + n] = squared.sqrt();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::Golden;

    fn three(values: &[f32]) -> Vec<[f32; 3]> {
        values.chunks(3).map(|p| [p[0], p[1], p[2]]).collect()
    }

    #[test]
    fn weights_and_correction_match_the_python_twin() {
        let golden = Golden::open("static_weights_debug");
        let config: StaticConfig = serde_json::from_str(&golden.metadata("config")).unwrap();
        let model = StaticWeights::new(config, &golden.weights()).unwrap();
        let positions: Vec<_> = three(&golden.values("vertices"))
            .iter()
            .map(|p| p.map(|x| 10.0 * x))
            .collect();
        let numbers = golden.integers("landmarks");
        let plate = PlateWeights {
            weights: golden.values("base"),
            remoteness: golden
                .values("remoteness")
                .into_iter()
                .map(f64::from)
                .collect(),
        };
        let landmarks = std::array::from_fn(|n| positions[numbers[n]]);
        let geometry = VertexGeometry {
            positions: &positions,
            landmarks: &landmarks,
            plate: &plate,
        };
        let familiarity = model.familiarity(&landmarks);
        assert!(
            familiarity > model.config.floor && familiarity < 1.0,
            "{familiarity}"
        );
        let correction = model.correction(&geometry);
        let motion = golden.cube("landmark_motion");
        let frames = motion.dim().0;
        let motion = motion.into_shape_with_order((frames, COORDINATES)).unwrap();
        let expected = golden.cube("output");
        let rank = correction.motion.nrows();
        for (t, frame) in motion.rows().into_iter().enumerate() {
            let shared = correction.motion.dot(&frame);
            for v in 0..positions.len() {
                for axis in 0..3 {
                    let mixed: f32 = (0..LANDMARKS)
                        .map(|n| {
                            let learned = familiarity * correction.mix[[v, n]];
                            (plate.weights[v * LANDMARKS + n] + learned) * frame[3 * n + axis]
                        })
                        .sum();
                    let crossed: f32 = (0..rank)
                        .map(|r| correction.cross[[v, axis * rank + r]] * shared[r])
                        .sum();
                    let got = mixed + familiarity * crossed;
                    let want = expected[[t, v, axis]];
                    assert!((got - want).abs() < 1e-5, "{v}: expected {want}, got {got}");
                }
            }
        }
    }

    #[test]
    fn embedded_weights_load_and_damaged_ones_do_not() {
        let files = MODEL.open(None).unwrap();
        let (bytes, config) = (&files.weights[..], &files.config);
        assert!(StaticWeights::load(bytes, config).is_ok());
        let half = StaticWeights::load(&bytes[..bytes.len() / 2], config);
        assert!(matches!(half, Err(Error::Weights(_))));
        assert!(StaticWeights::load(bytes, "{}").is_err());
    }
}
