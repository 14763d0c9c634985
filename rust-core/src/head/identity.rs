//! The canonical field `I(x; z) = T(x + D(x; z))`: `T` is the mean head, and `D` is the offset from
//! a point to the same point of the mean head. `D` is a blend of small networks at anchors.
//!
//! The anchors, frames, mirrored pairs and the blend are those of NPHM (Giebenhain et al. 2023,
//! §3.2). Twin of `training/systems/facetalk/identity.py`. At a point only the networks whose blend
//! weight is not zero are evaluated.

pub(super) mod slopes;

use faer::MatRef;
use ndarray::Array1;

use super::{
    HeadConfig,
    network::{Network, Prepared, Shape, Template, encode},
};
use crate::{
    Result,
    mesh::ibug::LANDMARKS,
    models::Weights,
    nn::{elementwise::softmax, linear::Linear},
};

/// The weights of the field and of the landmarks.
pub(super) struct Identity {
    landmarks: Linear,
    mirror: Vec<f32>,
    locals: Vec<Network>,
    template: Template,
}

/// The canonical field of one head, in units of the field.
pub(super) struct IdentityField<'a> {
    config: &'a HeadConfig,
    identity: &'a Identity,
    /// `[68]`, in the canonical pose.
    pub landmarks: Vec<[f32; 3]>,
    /// `[A]`.
    pub anchors: Vec<[f32; 3]>,
    locals: Vec<Prepared<'a>>,
}

impl Identity {
    pub fn load(weights: &Weights, config: &HeadConfig) -> Result<Self> {
        let networks = config.pairs.len() + config.middle.len() + 1;
        let shape = Shape {
            inputs: 3,
            code: config.global_code + config.local_code,
            width: config.width,
            layers: config.layers,
            outputs: 3,
            code_layers: &[0, config.layers / 2],
        };
        let locals = (0..networks)
            .map(|n| Network::load(&weights.pp("locals").pp(n), shape))
            .collect::<Result<_>>()?;
        let HeadConfig {
            octaves,
            template_width,
            template_layers,
            global_code,
            ..
        } = *config;
        let template = weights.pp("template");
        let places = weights.pp("landmarks");
        Ok(Identity {
            landmarks: Linear::load(&places, global_code, 3 * LANDMARKS)?,
            mirror: weights.values("mirror", &[global_code])?,
            locals,
            template: Template::load(&template, octaves, template_width, template_layers)?,
        })
    }

    /// How landmarks follow the global part of the code, units of the field, `[G, 68 · 3]`.
    pub fn landmarks(&self) -> MatRef<'_, f32> {
        self.landmarks.weight()
    }

    /// The field of the head with the code `z` `[Z]`.
    pub fn of<'a>(&'a self, config: &'a HeadConfig, z: &[f32]) -> IdentityField<'a> {
        let (global, local) = z.split_at(config.global_code);
        let mut places = vec![0.0; 3 * LANDMARKS];
        self.landmarks.forward_row(global, &mut places);
        let landmarks = places.as_chunks::<3>().0.to_vec();
        let mirrored: Vec<f32> = global
            .iter()
            .zip(&self.mirror)
            .map(|(x, sign)| x * sign)
            .collect();
        let local_codes = local.chunks_exact(config.local_code).enumerate();
        let locals = local_codes.map(|(number, local)| {
            let global = if is_mirrored(config, number) {
                &mirrored[..]
            } else {
                global
            };
            let code: Array1<f32> = global.iter().chain(local).copied().collect();
            self.locals[network_of(config, number)].prepare(code.view())
        });
        IdentityField {
            config,
            identity: self,
            anchors: config
                .landmark_numbers()
                .iter()
                .map(|n| landmarks[*n])
                .collect(),
            locals: locals.collect(),
            landmarks,
        }
    }
}

/// The network of an anchor. Both anchors of a pair share one, and the background has the last.
fn network_of(config: &HeadConfig, anchor: usize) -> usize {
    let pairs = config.pairs.len();
    if anchor < 2 * pairs {
        anchor / 2
    } else {
        anchor - pairs
    }
}

/// Whether an anchor is the left one of a pair.
fn is_mirrored(config: &HeadConfig, anchor: usize) -> bool {
    anchor < 2 * config.pairs.len() && anchor % 2 == 1
}

impl IdentityField<'_> {
    /// Where points `[Q]` lie on the mean head, `[Q]`.
    pub fn on_mean(&self, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut places = points.to_vec();
        let weights = self.blend(points);
        let columns = self.locals.len();
        for (number, local) in self.locals.iter().enumerate() {
            let rows: Vec<usize> = (0..points.len())
                .filter(|row| weights[row * columns + number] > 0.0)
                .collect();
            if rows.is_empty() {
                continue;
            }
            let side = if is_mirrored(self.config, number) {
                -1.0
            } else {
                1.0
            };
            let offsets = local.forward(&self.framed(number, points, &rows, side), rows.len());
            for (row, [x, y, z]) in rows.into_iter().zip(offsets.as_chunks::<3>().0) {
                let weight = weights[row * columns + number];
                for (to, x) in places[row].iter_mut().zip([side * x, *y, *z]) {
                    *to += weight * x;
                }
            }
        }
        places
    }

    /// Signed distance, negative inside, at points `[Q]`.
    pub fn at(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let encoded = encode(&self.on_mean(points), self.config.octaves);
        self.identity.template.forward(&encoded, points.len())
    }

    /// Some points in the frame of an anchor's network.
    fn framed(&self, anchor: usize, points: &[[f32; 3]], rows: &[usize], side: f32) -> Vec<f32> {
        let mut frame = Vec::with_capacity(3 * rows.len());
        for row in rows {
            let [x, y, z] = self.in_frame(anchor, points[*row]);
            frame.extend([side * x, y, z]);
        }
        frame
    }

    fn in_frame(&self, anchor: usize, x: [f32; 3]) -> [f32; 3] {
        match self.anchors.get(anchor) {
            Some(at) => std::array::from_fn(|axis| (x[axis] - at[axis]) / self.config.sigma),
            None => x.map(|x| x / self.config.background.sqrt()),
        }
    }

    /// How near points are to the anchors and the background, `[Q, A + 1]`, before a softmax turns
    /// each row into shares.
    fn closeness(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let sharpness = -0.5 / (self.config.sigma * self.config.sigma);
        let mut out = Vec::with_capacity(points.len() * self.locals.len());
        for x in points {
            out.extend(self.anchors.iter().map(|anchor| {
                let squares: f32 = (0..3).map(|axis| (x[axis] - anchor[axis]).powi(2)).sum();
                sharpness * squares
            }));
            out.push(sharpness * self.config.background);
        }
        out
    }

    /// Weights of anchors and background, `[Q, A + 1]`; each row sums to 1.
    fn blend(&self, points: &[[f32; 3]]) -> Vec<f32> {
        let mut weights = self.closeness(points);
        for row in weights.chunks_exact_mut(self.locals.len()) {
            softmax(row);
            let mut sum = 0.0;
            for weight in row.iter_mut() {
                *weight = (*weight - self.config.least_weight).max(0.0);
                sum += *weight;
            }
            row.iter_mut().for_each(|weight| *weight /= sum);
        }
        weights
    }
}
