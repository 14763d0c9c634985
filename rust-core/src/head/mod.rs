//! The parametric head of FaceTalk, `F(x, z_id, z_ex) = I(x + E(x; z_id, z_ex); z_id)` (Aneja et al. 2023,
//! eq. 1 and §5), and heads made with it.
//!
//! Twin of `training/systems/facetalk/head.py`. In the canonical pose the jaw is open by
//! [`HeadConfig::open_jaw`], so that the lips do not coincide. Its expression code is 0. Points and
//! distances are canonical metres.

mod code;
mod config;
mod fit;
mod identity;
mod led_codes;
mod make;
mod maker;
mod network;
mod on_mesh;
#[cfg(test)]
mod tests;
mod topology;
mod volume;

use std::path::Path;

use ndarray::{Array1, Array2};
use rayon::prelude::*;

pub use config::{COEFFICIENTS, Direction, HeadConfig};
pub use fit::{ScanFit, ScanOptions};
use identity::{Identity, IdentityField};
pub use make::MadeHead;
pub use maker::HeadMaker;
use network::{Network, Prepared, Shape, encode, encoded};
pub use on_mesh::{HeadOnMesh, Reach, fit_face};
pub use topology::{TOPOLOGY_MODEL, Topology};
pub use volume::{HeadSurface, SURFACE_CELLS, check_surface_cells};

use crate::{
    Error, Result,
    models::{BuiltIn, Weights},
    nn::linear::Linear,
};

/// The built-in weights.
#[cfg(feature = "facetalk")]
pub static MODEL: BuiltIn = BuiltIn::sized(&anyface_weights_facetalk::FACETALK_COMPACT, "facetalk");
/// Not in this build: a folder may provide the weights.
#[cfg(not(feature = "facetalk"))]
pub static MODEL: BuiltIn = BuiltIn::absent("facetalk_compact", Some("facetalk"));

/// Points in one block of parallel work.
const BLOCK: usize = 1024;

/// The weights of the field, its deformations and the maps to codes.
pub struct Head {
    config: HeadConfig,
    identity: Identity,
    backward: Deformation,
    forward: Deformation,
    identity_code: Linear,
    /// `[X, M]`.
    expression_code: Array2<f32>,
    /// `[D, 100]`, orthonormal.
    directions: Array2<f32>,
}

/// Maps posed points to canonical ones, or back.
struct Deformation {
    press: Linear,
    network: Network,
}

/// One head, with a fixed identity.
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

/// Points of one head, ready to be moved to many poses.
pub struct Mover<'a> {
    head: &'a Head,
    trunks: Trunks,
}

/// Precomputed values that moving points of one head needs in addition to the weights.
struct Trunks {
    points: Vec<[f32; 3]>,
    /// The identity, compressed for the forward field.
    pressed: Vec<f32>,
    /// For each block of points, the output of the layers before the code joins.
    blocks: Vec<Vec<f32>>,
}

impl Head {
    /// Opens the built-in head, or the one in `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, truncated or does not fit its config.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = MODEL.open(folder)?;
        let config = HeadConfig::from_json(&files.config)?;
        Head::new(config, &Weights::from_bytes(&files.weights)?)
    }

    /// Builds a head from the parts of a model.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape.
    pub fn new(config: HeadConfig, weights: &Weights) -> Result<Self> {
        let (codes, channels) = (config.expression_code, config.channels.len());
        let (middle, last) = (config.expression_layers / 2, config.expression_layers - 1);
        let deformation = |name: &str, code_layers: &[usize]| {
            Deformation::load(&weights.pp(name), &config, code_layers)
        };
        let map = weights.pp("identity_code");
        let principal = weights.pp("principal");
        Ok(Head {
            identity: Identity::load(&weights.pp("identity"), &config)?,
            backward: deformation("backward_field", &[0, middle])?,
            forward: deformation("forward_field", &[last])?,
            identity_code: Linear::load(&map, COEFFICIENTS, config.identity_code())?,
            expression_code: weights
                .pp("expression_code")
                .matrix("weight", codes, channels)?,
            directions: principal.matrix("directions", config.directions.len(), COEFFICIENTS)?,
            config,
        })
    }

    /// Sizes and names of the model.
    pub fn config(&self) -> &HeadConfig {
        &self.config
    }

    /// z_ex `[X]` of ARKit weights `[M]` in the order of [`HeadConfig::channels`]; all 0 is the face at rest.
    ///
    /// # Errors
    /// `InvalidInput` for a wrong count or a number that is not finite.
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

    /// z_ex `[X]` of the face at rest.
    pub fn rest_code(&self) -> Vec<f32> {
        self.expression_code(&vec![0.0; self.config.channels.len()])
            .expect("as many weights as there are channels")
    }

    fn prepared<'a>(
        &self,
        field: &'a Deformation,
        expression: &[f32],
        pressed: &[f32],
    ) -> Result<Prepared<'a>> {
        check("z_ex", expression, self.config.expression_code)?;
        let code: Array1<f32> = expression.iter().chain(pressed).copied().collect();
        Ok(field.network.prepare(code.view()))
    }

    /// Moves each of the points by its own displacement, given in units of the field.
    fn moved(&self, points: &[[f32; 3]], by: &[f32]) -> Vec<[f32; 3]> {
        let metres = self.config.scale_m;
        let rows = points.iter().zip(by.as_chunks::<3>().0);
        rows.map(|(p, by)| std::array::from_fn(|axis| p[axis] + metres * by[axis]))
            .collect()
    }

    /// The landmarks of the mean head, ready for many poses, and their rest positions, `[68]`
    /// canonical metres.
    ///
    /// # Errors
    /// Never fails for a head that could be opened.
    pub fn mean_landmarks(&self) -> Result<(Mover<'_>, Vec<[f32; 3]>)> {
        let mean = self.one(self.identity_code(&[0.0; COEFFICIENTS])?)?;
        let landmarks = mean.mover(mean.landmarks());
        let rest = landmarks.at(&self.rest_code())?;
        Ok((landmarks, rest))
    }

    /// The head with the identity code `z`, `[Z]`.
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

/// Runs `work` on the points block by block, on all cores.
fn in_blocks<T: Send>(
    points: &[[f32; 3]],
    work: impl Fn(&[[f32; 3]]) -> Vec<T> + Sync + Send,
) -> Vec<T> {
    let blocks: Vec<Vec<T>> = points.par_chunks(BLOCK).map(work).collect();
    blocks.into_iter().flatten().collect()
}

/// Gradient of a distance at points `[Q]`, by central differences over a millimetre.
fn slopes(points: &[[f32; 3]], distance: impl Fn(&[[f32; 3]]) -> Vec<f32>) -> Vec<[f32; 3]> {
    const STEP: f32 = 5e-4;
    let sides: Vec<[f32; 3]> = points
        .iter()
        .flat_map(|p| {
            (0..6).map(|n| {
                let mut p = *p;
                p[n / 2] += if n % 2 == 0 { STEP } else { -STEP };
                p
            })
        })
        .collect();
    let distance = distance(&sides);
    let slopes = distance.as_chunks::<6>().0.iter();
    slopes
        .map(|s| [s[0] - s[1], s[2] - s[3], s[4] - s[5]].map(|x| x / (2.0 * STEP)))
        .collect()
}

impl<'a> OneHead<'a> {
    fn metres(&self) -> f32 {
        self.head.config.scale_m
    }

    fn inside(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        points
            .iter()
            .map(|p| p.map(|x| x / self.metres()))
            .collect()
    }

    /// z_id, `[Z]`.
    pub fn code(&self) -> &[f32] {
        &self.z
    }

    /// The 68 landmarks in the canonical pose.
    pub fn landmarks(&self) -> Vec<[f32; 3]> {
        let places = self.field.landmarks.iter();
        places.map(|at| at.map(|x| x * self.metres())).collect()
    }

    /// Positions of the anchors, `[A]`: the pairs one after another, then the anchors in the
    /// middle.
    pub fn anchors(&self) -> Vec<[f32; 3]> {
        let places = self.field.anchors.iter();
        places.map(|at| at.map(|x| x * self.metres())).collect()
    }

    /// Signed distance, negative inside, at canonical points `[Q]`.
    pub fn distance(&self, points: &[[f32; 3]]) -> Vec<f32> {
        in_blocks(points, |points| {
            let mut distance = self.field.at(&self.inside(points));
            distance.iter_mut().for_each(|s| *s *= self.metres());
            distance
        })
    }

    /// Gradient of the distance at canonical points `[Q]`.
    pub fn gradient(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        slopes(points, |points| self.distance(points))
    }

    /// Where canonical points `[Q]` lie on the mean head.
    pub fn on_mean(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        in_blocks(points, |points| {
            let places = self.field.on_mean(&self.inside(points));
            places
                .into_iter()
                .map(|p| p.map(|x| x * self.metres()))
                .collect()
        })
    }

    /// This head in the pose of `expression` `[X]`.
    ///
    /// # Errors
    /// `InvalidInput` for a code of another length or one that is not finite.
    pub fn posed(&self, expression: &[f32]) -> Result<PosedHead<'_>> {
        Ok(PosedHead {
            one: self,
            backward: self.prepared(&self.head.backward, expression)?,
            forward: self.prepared(&self.head.forward, expression)?,
        })
    }

    fn prepared(&self, field: &'a Deformation, expression: &[f32]) -> Result<Prepared<'a>> {
        self.head.prepared(field, expression, &self.pressed(field))
    }

    /// The identity, compressed for a deformation.
    fn pressed(&self, field: &Deformation) -> Vec<f32> {
        let anchors = self.field.anchors.iter().flatten();
        let inputs: Vec<f32> = self.z.iter().chain(anchors).copied().collect();
        let mut pressed = vec![0.0; self.head.config.pressed];
        field.press.forward_row(&inputs, &mut pressed);
        pressed
    }

    fn encoded_on_mean(&self, points: &[[f32; 3]]) -> Vec<f32> {
        encode(
            &self.field.on_mean(&self.inside(points)),
            self.head.config.expression_octaves,
        )
    }

    /// Prepares canonical points `[V]` for many poses.
    pub fn mover(&self, points: Vec<[f32; 3]>) -> Mover<'a> {
        Mover {
            head: self.head,
            trunks: self.trunks(points),
        }
    }

    fn trunks(&self, points: Vec<[f32; 3]>) -> Trunks {
        let field = &self.head.forward;
        let pressed = self.pressed(field);
        let any = vec![0.0; self.head.config.expression_code];
        let any = self.head.prepared(field, &any, &pressed);
        let any = any.expect("a code of the head's own length");
        let blocks = points
            .par_chunks(BLOCK)
            .map(|points| any.trunk(&self.encoded_on_mean(points), points.len()))
            .collect();
        Trunks {
            points,
            pressed,
            blocks,
        }
    }
}

impl Mover<'_> {
    /// The points `[V]` in the pose of `expression` `[X]`.
    ///
    /// # Errors
    /// `InvalidInput` for a code of another length or one that is not finite.
    pub fn at(&self, expression: &[f32]) -> Result<Vec<[f32; 3]>> {
        self.trunks.at(self.head, expression)
    }
}

impl Trunks {
    fn at(&self, head: &Head, expression: &[f32]) -> Result<Vec<[f32; 3]>> {
        let prepared = head.prepared(&head.forward, expression, &self.pressed)?;
        let blocks = self.points.par_chunks(BLOCK).zip(&self.blocks);
        let moved: Vec<Vec<[f32; 3]>> = blocks
            .map(|(points, trunk)| {
                let by = prepared.finish(trunk.clone(), points.len());
                head.moved(points, &by)
            })
            .collect();
        Ok(moved.concat())
    }
}

impl PosedHead<'_> {
    /// Moves canonical points `[Q]` to this pose.
    pub fn forward(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        self.through(&self.forward, points)
    }

    /// Moves points `[Q]` of this pose to the canonical pose.
    pub fn backward(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        self.through(&self.backward, points)
    }

    fn through(&self, field: &Prepared<'_>, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        in_blocks(points, |points| {
            let by = field.forward(&self.one.encoded_on_mean(points), points.len());
            self.one.head.moved(points, &by)
        })
    }

    /// Signed distance, negative inside, at points `[Q]` of this pose, eq. 1.
    pub fn distance(&self, points: &[[f32; 3]]) -> Vec<f32> {
        self.one.distance(&self.backward(points))
    }
}

impl Deformation {
    fn load(weights: &Weights, config: &HeadConfig, code_layers: &[usize]) -> Result<Self> {
        let press_inputs = config.identity_code() + 3 * config.anchors();
        let shape = Shape {
            inputs: encoded(config.expression_octaves),
            code: config.expression_code + config.pressed,
            width: config.expression_width,
            layers: config.expression_layers,
            outputs: 3,
            code_layers,
        };
        Ok(Deformation {
            press: Linear::load(&weights.pp("press"), press_inputs, config.pressed)?,
            network: Network::load(weights, shape)?,
        })
    }
}
