//! The parametric head `F(x, z_id, z_ex) = I(x + E(x; z_id, z_ex); z_id)`, eq. 1 and §5.
//!
//! Twin of `training/systems/facetalk/head.py`. The canonical pose has the jaw open by
//! [`HeadConfig::open_jaw`], where no two lips lie in one place; its expression has the code 0.

mod config;
mod identity;
mod network;

use ndarray::{Array1, Array2, ArrayView2};

pub use config::HeadConfig;
use identity::{Identity, IdentityField};
use network::{Network, Prepared, Shape};

use crate::{
    Error, Result,
    nn::{Weights, linear::Linear},
};

/// Coefficients of a head; they come from N(0, 1).
pub const COEFFICIENTS: usize = 100;

/// The weights of the field, its deformations and the maps to codes.
pub struct Head {
    config: HeadConfig,
    identity: Identity,
    backward: Deformation,
    forward: Deformation,
    identity_code: Linear,
    /// `[X, M]`.
    expression_code: Array2<f32>,
}

/// Posed points to canonical ones, or back.
struct Deformation {
    press: Linear,
    network: Network,
}

/// One head: its identity is chosen.
pub struct OneHead<'a> {
    head: &'a Head,
    z: Vec<f32>,
    field: IdentityField<'a>,
}

/// One head in one pose.
pub struct PosedHead<'a> {
    one: &'a OneHead<'a>,
    backward: Prepared<'a>,
    forward: Prepared<'a>,
}

impl Head {
    /// From the parts of a model.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape.
    pub fn new(config: HeadConfig, weights: &Weights) -> Result<Self> {
        let (codes, channels) = (config.expression_code, config.channels.len());
        Ok(Head {
            identity: Identity::load(&weights.pp("identity"), &config)?,
            backward: Deformation::load(&weights.pp("backward_field"), &config)?,
            forward: Deformation::load(&weights.pp("forward_field"), &config)?,
            identity_code: Linear::load(
                &weights.pp("identity_code"),
                COEFFICIENTS,
                config.identity_code(),
            )?,
            expression_code: weights
                .pp("expression_code")
                .matrix("weight", codes, channels)?,
            config,
        })
    }

    /// Sizes and names.
    pub fn config(&self) -> &HeadConfig {
        &self.config
    }

    /// z_id `[Z]` of coefficients `[100]`.
    ///
    /// # Errors
    /// `InvalidInput` for another number of them or one that is not finite.
    pub fn identity_code(&self, coefficients: &[f32]) -> Result<Vec<f32>> {
        check("coefficients", coefficients, COEFFICIENTS)?;
        let mut z = vec![0.0; self.config.identity_code()];
        self.identity_code.forward_row(coefficients, &mut z);
        Ok(z)
    }

    /// z_ex `[X]` of ARKit weights `[M]` in the order of [`HeadConfig::channels`]; all 0 is the face at rest.
    ///
    /// # Errors
    /// `InvalidInput` for another number of them or one that is not finite.
    pub fn expression_code(&self, weights: &[f32]) -> Result<Vec<f32>> {
        check("expression weights", weights, self.config.channels.len())?;
        let from_open = weights.iter().zip(&self.config.channels).map(|(w, name)| {
            let open = if name == "jawOpen" {
                self.config.open_jaw
            } else {
                0.0
            };
            w - open
        });
        Ok(self
            .expression_code
            .dot(&Array1::from_iter(from_open))
            .to_vec())
    }

    /// The head of `z` `[Z]`.
    ///
    /// # Errors
    /// `InvalidInput` for a code of another length or one that is not finite.
    pub fn one(&self, z: Vec<f32>) -> Result<OneHead<'_>> {
        check("z_id", &z, self.config.identity_code())?;
        let field = self.identity.of(&self.config, &z);
        Ok(OneHead {
            head: self,
            z,
            field,
        })
    }
}

fn check(what: &str, values: &[f32], expected: usize) -> Result<()> {
    if values.len() != expected {
        let got = values.len();
        return Err(Error::InvalidInput(format!(
            "{what}: expected {expected} numbers, got {got}"
        )));
    }
    match values.iter().find(|x| !x.is_finite()) {
        Some(x) => Err(Error::InvalidInput(format!(
            "{what}: expected finite numbers, got {x}"
        ))),
        None => Ok(()),
    }
}

impl OneHead<'_> {
    /// Places of the anchors, `[A]` metres, pairs one after another and then the middle.
    pub fn anchors(&self) -> Vec<[f32; 3]> {
        let metres = self.head.config.scale_m;
        let anchors = self.field.anchors.iter();
        anchors.map(|at| at.map(|x| x * metres)).collect()
    }

    /// Signed distance in metres, negative inside, at canonical points `[Q, 3]` metres.
    pub fn distance(&self, points: ArrayView2<'_, f32>) -> Vec<f32> {
        let metres = self.head.config.scale_m;
        let inside = points.mapv(|x| x / metres);
        let mut distance = self.field.at(inside.view());
        distance.iter_mut().for_each(|s| *s *= metres);
        distance
    }

    /// This head in the pose of `expression` `[X]`.
    ///
    /// # Errors
    /// `InvalidInput` for a code of another length or one that is not finite.
    pub fn posed(&self, expression: &[f32]) -> Result<PosedHead<'_>> {
        let head = self.head;
        check("z_ex", expression, head.config.expression_code)?;
        let prepare = |field: &'_ Deformation| -> Vec<f32> {
            let anchors = self.field.anchors.iter().flatten();
            let seen: Vec<f32> = self.z.iter().chain(anchors).copied().collect();
            let mut pressed = vec![0.0; head.config.pressed];
            field.press.forward_row(&seen, &mut pressed);
            expression.iter().copied().chain(pressed).collect()
        };
        let (back, ahead) = (prepare(&head.backward), prepare(&head.forward));
        Ok(PosedHead {
            one: self,
            backward: head.backward.network.prepare(back.as_slice().into()),
            forward: head.forward.network.prepare(ahead.as_slice().into()),
        })
    }
}

impl PosedHead<'_> {
    /// Canonical points `[Q, 3]` metres in the pose.
    pub fn forward(&self, points: ArrayView2<'_, f32>) -> Array2<f32> {
        self.moved(&self.forward, points)
    }

    /// Posed points `[Q, 3]` metres in the canonical pose.
    pub fn backward(&self, points: ArrayView2<'_, f32>) -> Array2<f32> {
        self.moved(&self.backward, points)
    }

    /// Signed distance in metres at posed points `[Q, 3]` metres, eq. 1.
    pub fn distance(&self, points: ArrayView2<'_, f32>) -> Vec<f32> {
        self.one.distance(self.backward(points).view())
    }

    fn moved(&self, by: &Prepared<'_>, points: ArrayView2<'_, f32>) -> Array2<f32> {
        let metres = self.one.head.config.scale_m;
        let inside = points.mapv(|x| x / metres);
        let moved = by.forward(inside.view(), |x| x.max(0.0));
        (moved + &inside) * metres
    }
}

impl Deformation {
    fn load(weights: &Weights, config: &HeadConfig) -> Result<Self> {
        let shape = Shape {
            code: config.expression_code + config.pressed,
            width: config.expression_width,
            layers: config.expression_layers,
            outputs: 3,
        };
        let seen = config.identity_code() + 3 * config.anchors();
        Ok(Deformation {
            press: Linear::load(&weights.pp("press"), seen, config.pressed)?,
            network: Network::load(weights, shape)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::{Golden, distance};

    fn golden() -> (Golden, Head) {
        let golden = Golden::open("facetalk_head_debug");
        let config = HeadConfig::from_json(&golden.metadata("config")).unwrap();
        let head = Head::new(config, &golden.weights()).unwrap();
        (golden, head)
    }

    #[test]
    fn agrees_with_pytorch() {
        let (golden, head) = golden();
        let metres = head.config().scale_m;
        let z = head.identity_code(&golden.values("coefficients")).unwrap();
        assert!(distance(&z, &golden.values("z")) < 1e-5);
        let expression = head.expression_code(&golden.values("channels")).unwrap();
        assert!(distance(&expression, &golden.values("expression")) < 1e-5);
        let one = head.one(z).unwrap();
        let in_units =
            |values: Vec<f32>| -> Vec<f32> { values.iter().map(|x| x / metres).collect() };
        let anchors = in_units(one.anchors().as_flattened().to_vec());
        assert!(distance(&anchors, &golden.values("anchors")) < 1e-4);
        let points = golden.matrix("points") * metres;
        let identity = in_units(one.distance(points.view()));
        assert!(distance(&identity, &golden.values("identity")) < 1e-4);
        let posed = one.posed(&expression).unwrap();
        let made = in_units(posed.forward(points.view()).into_raw_vec_and_offset().0);
        assert!(distance(&made, &golden.values("posed")) < 1e-4);
        let made = in_units(posed.backward(points.view()).into_raw_vec_and_offset().0);
        assert!(distance(&made, &golden.values("canonical")) < 1e-4);
        let made = in_units(posed.distance(points.view()));
        assert!(distance(&made, &golden.values("field")) < 1e-4);
    }

    #[test]
    fn codes_of_another_length_are_told() {
        let (_, head) = golden();
        let error = head.one(vec![0.0; 5]).err().unwrap().to_string();
        assert!(error.contains("expected 27 numbers, got 5"), "{error}");
        let error = head.identity_code(&[f32::NAN; COEFFICIENTS]).unwrap_err();
        assert!(error.to_string().contains("finite"), "{error}");
    }
}
