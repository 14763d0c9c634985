//! A pointwise network over the skin, for the part of a shape that landmarks do not contain.
//!
//! Twin of `training/rig/network.py`.
//!
//! `shape_s(v) = Σ_n W_vn ΔL_sn + fade(v) R_s(features of v)`
//!
//! `W` are the training-free weights with which the skin follows the landmarks, `ΔL_s` is the
//! landmark motion of shape `s` on a mean face, and `R` is the network. The network's result is the
//! mean over the head and its mirror image. So a symmetric head gets symmetric shapes, and left and
//! right shapes mirror each other.
//!
//! Lengths are decimetres in the canonical frame.

use ndarray::{Array2, Array3, ArrayView2};
use serde::Deserialize;

use super::mirrored_name;
use crate::{
    Error, Result,
    mesh::ibug::{LANDMARKS, MIRROR},
    models::Weights,
    nn::{elementwise::silu_all, linear::Linear},
};

/// The position, the offsets from the landmarks, the distances to them, and their weights.
const FEATURES: usize = 3 + 5 * LANDMARKS;
/// Outputs of the network are multiplied by this, so that training starts near zero.
const OUTPUT_SCALE: f32 = 0.1;
/// The network acts fully up to the first distance from the nearest landmark, and not at all beyond
/// the second.
const FADE_DM: (f32, f32) = (0.6, 1.0);

/// Sizes of the network and the names of its shapes, as `config.json` states them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct RigConfig {
    /// Hidden channels.
    pub width: usize,
    /// Names of the `S` shapes.
    pub shapes: Vec<String>,
}

/// The network `R` and the landmark motion of each shape.
pub struct RigNetwork {
    shapes: Vec<String>,
    mirror: Vec<usize>,
    layers: [Linear; 3],
    out: Linear,
    feature_mean: Vec<f32>,
    feature_scale: Vec<f32>,
    templates: Array3<f32>,
}

/// The skin of a head, `P` vertices.
#[derive(Clone, Copy)]
pub struct SkinGeometry<'a> {
    /// `[P]`, decimetres.
    pub positions: &'a [[f32; 3]],
    /// Landmarks of the neutral face, decimetres.
    pub landmarks: &'a [[f32; 3]; LANDMARKS],
    /// `W`: `[P, 68]`.
    pub base: ArrayView2<'a, f32>,
}

impl RigNetwork {
    /// Makes the network from weights that were already read.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has other dimensions, or if a face shape has no mirror
    /// image.
    pub fn new(config: &RigConfig, weights: &Weights) -> Result<Self> {
        let (width, count) = (config.width, config.shapes.len());
        let layer = |name: &str, inputs| Linear::load(&weights.pp(name), inputs, width);
        let templates = weights.values("templates", &[count, LANDMARKS, 3])?;
        Ok(RigNetwork {
            mirror: mirror_of(&config.shapes)?,
            shapes: config.shapes.clone(),
            layers: [
                layer("layer_0", FEATURES)?,
                layer("layer_1", width)?,
                layer("layer_2", width)?,
            ],
            out: Linear::load(&weights.pp("out"), width, 3 * count)?,
            feature_mean: weights.values("feature_mean", &[FEATURES])?,
            feature_scale: weights.values("feature_scale", &[FEATURES])?,
            templates: Array3::from_shape_vec((count, LANDMARKS, 3), templates)
                .expect("the shape was checked by the reader"),
        })
    }

    /// Names of the `S` shapes.
    pub fn shapes(&self) -> &[String] {
        &self.shapes
    }

    /// Landmark motion of each shape on a mean face, `[S, 68, 3]` dm.
    pub fn templates(&self) -> &Array3<f32> {
        &self.templates
    }

    /// All shapes of the skin, `[P, 3 S]` dm, shape by shape.
    pub fn forward(&self, skin: SkinGeometry<'_>) -> Array2<f32> {
        let direct = self.one_sided(skin, false);
        let reflected = self.one_sided(skin, true);
        let flat = self
            .templates
            .view()
            .into_shape_with_order((self.shapes.len(), 3 * LANDMARKS));
        let flat = flat.expect("row-major array");
        let mut out = Array2::zeros(direct.dim());
        for (v, mut row) in out.rows_mut().into_iter().enumerate() {
            let weights = skin.base.row(v);
            for s in 0..self.shapes.len() {
                let (column, other) = (3 * s, 3 * self.mirror[s]);
                for axis in 0..3 {
                    let motion = flat.row(s);
                    let spread: f32 = (0..LANDMARKS)
                        .map(|n| weights[n] * motion[3 * n + axis])
                        .sum();
                    let side = if axis == 0 { -1.0 } else { 1.0 };
                    let learned = direct[[v, column + axis]] + side * reflected[[v, other + axis]];
                    row[column + axis] = spread + 0.5 * learned;
                }
            }
        }
        out
    }

    /// The network's faded correction for the head or its mirror image, `[P, 3 S]` dm.
    fn one_sided(&self, skin: SkinGeometry<'_>, reflected: bool) -> Array2<f32> {
        let (mut x, fade) = self.features(skin, reflected);
        for layer in &self.layers {
            x = layer.forward_then(&x, silu_all);
        }
        let mut out = self.out.forward(&x);
        for (mut row, fade) in out.rows_mut().into_iter().zip(fade) {
            row.mapv_inplace(|x| OUTPUT_SCALE * fade * x);
        }
        out
    }

    /// Normalised features `[P, 343]`, and the fade of the network, `[P]`.
    fn features(&self, skin: SkinGeometry<'_>, reflected: bool) -> (Array2<f32>, Vec<f32>) {
        let side = if reflected { -1.0 } else { 1.0 };
        let turn = |p: [f32; 3]| [side * p[0], p[1], p[2]];
        let order: [usize; LANDMARKS] =
            std::array::from_fn(|n| if reflected { MIRROR[n] } else { n });
        let landmarks = order.map(|n| turn(skin.landmarks[n]));
        let mut out = Array2::zeros((skin.positions.len(), FEATURES));
        let mut fade = Vec::with_capacity(skin.positions.len());
        for (v, mut row) in out.rows_mut().into_iter().enumerate() {
            let row = row.as_slice_mut().expect("row-major array");
            let nearest = relate(row, turn(skin.positions[v]), &landmarks);
            fade.push(((FADE_DM.1 - nearest) / (FADE_DM.1 - FADE_DM.0)).clamp(0.0, 1.0));
            for n in 0..LANDMARKS {
                row[3 + 4 * LANDMARKS + n] = skin.base[[v, order[n]]];
            }
            for (i, x) in row.iter_mut().enumerate() {
                *x = (*x - self.feature_mean[i]) / self.feature_scale[i];
            }
        }
        (out, fade)
    }
}

/// Writes position, offsets and distances into `row`. Returns the least distance.
fn relate(row: &mut [f32], position: [f32; 3], landmarks: &[[f32; 3]; LANDMARKS]) -> f32 {
    row[..3].copy_from_slice(&position);
    let mut nearest = f32::INFINITY;
    for (n, landmark) in landmarks.iter().enumerate() {
        let offset: [f32; 3] = std::array::from_fn(|i| position[i] - landmark[i]);
        row[3 + 3 * n..6 + 3 * n].copy_from_slice(&offset);
        let distance = offset.iter().map(|x| x * x).sum::<f32>().sqrt();
        row[3 + 3 * LANDMARKS + n] = distance;
        nearest = nearest.min(distance);
    }
    nearest
}

fn mirror_of(shapes: &[String]) -> Result<Vec<usize>> {
    let place = |name: &String| {
        let mirror = mirrored_name(name);
        let row = shapes.iter().position(|shape| *shape == mirror);
        row.ok_or_else(|| {
            Error::Weights(format!(
                "rig: config.json: expected a shape {mirror}, got none"
            ))
        })
    };
    shapes.iter().map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::Golden;

    fn three(values: &[f32]) -> Vec<[f32; 3]> {
        values.chunks(3).map(|p| [p[0], p[1], p[2]]).collect()
    }

    #[test]
    fn shapes_match_the_python_twin() {
        let golden = Golden::open("rig_debug");
        let config: RigConfig = serde_json::from_str(&golden.metadata("config")).unwrap();
        let network = RigNetwork::new(&config, &golden.weights()).unwrap();
        let positions = three(&golden.values("positions"));
        let landmarks: [[f32; 3]; LANDMARKS] =
            three(&golden.values("landmarks")).try_into().unwrap();
        let base = golden.matrix("base");
        let got = network.forward(SkinGeometry {
            positions: &positions,
            landmarks: &landmarks,
            base: base.view(),
        });
        let expected = golden.cube("output");
        for ((s, v, axis), want) in expected.indexed_iter() {
            let got = got[[v, 3 * s + axis]];
            assert!(
                (got - want).abs() < 1e-5,
                "{s} {v}: expected {want}, got {got}"
            );
        }
    }

    #[test]
    fn a_shape_without_its_mirror_image_is_refused() {
        let alone = vec!["eyeBlinkLeft".to_owned(), "jawOpen".to_owned()];
        assert!(
            mirror_of(&alone)
                .unwrap_err()
                .to_string()
                .contains("eyeBlinkRight")
        );
    }
}
