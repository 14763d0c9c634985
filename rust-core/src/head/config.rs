//! Sizes of the head model; twin of `training/systems/facetalk/config.py`.

use serde::{Deserialize, Serialize};

use crate::{Error, Result, mesh::ibug::LANDMARKS};

/// Number of coefficients of a head. They are drawn from N(0, 1).
pub const COEFFICIENTS: usize = 100;

/// `config.json` beside the weights. Lengths inside the fields are metres divided by `scale_m`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeadConfig {
    /// "facetalk".
    pub system: String,
    /// "head".
    pub model: String,
    /// "paper", "compact" or "debug".
    pub name: String,
    /// Metres per unit inside the fields.
    pub scale_m: f32,
    /// Landmarks of each pair of mirrored anchors, the subject's right one first.
    pub pairs: Vec<[usize; 2]>,
    /// Landmarks of the anchors in the middle of the face.
    pub middle: Vec<usize>,
    /// Length `G` of the global part of z_id.
    pub global_code: usize,
    /// Length `L` of each local part.
    pub local_code: usize,
    /// Width of a local network.
    pub width: usize,
    /// Hidden layers of a local network.
    pub layers: usize,
    /// Standard deviation of the blend's weights around an anchor, units of the field.
    pub sigma: f32,
    /// Squared distance at which the background counts as lying.
    pub background: f32,
    /// A blend weight below this is zero.
    pub least_weight: f32,
    /// Width of the network of the mean head.
    pub template_width: usize,
    /// Its hidden layers.
    pub template_layers: usize,
    /// Octaves that encode a place on the mean head.
    pub octaves: usize,
    /// Octaves that encode it for the deformations.
    pub expression_octaves: usize,
    /// Length `X` of z_ex.
    pub expression_code: usize,
    /// Number of values, compressed from the identity, that a deformation receives.
    pub pressed: usize,
    /// Width of the network of a deformation.
    pub expression_width: usize,
    /// Its hidden layers.
    pub expression_layers: usize,
    /// ARKit channels for which a code was learned.
    pub channels: Vec<String>,
    /// `jawOpen` of the canonical pose.
    pub open_jaw: f32,
    /// Lowest and highest corner of a box that holds any head, metres.
    pub bounds_m: [[f32; 3]; 2],
    /// Directions in which heads differ, the one that moves the surface furthest first.
    pub directions: Vec<Direction>,
}

/// A direction in which heads differ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Direction {
    /// The measurement, taken with a tape, that it changes most.
    pub name: String,
    /// How far the surface of the face moves at value 1, root mean square, millimetres.
    pub reach_mm: f32,
}

impl HeadConfig {
    /// Reads and checks `config.json`.
    ///
    /// # Errors
    /// `Weights` if `text` is not such a file or its numbers are not valid.
    pub fn from_json(text: &str) -> Result<Self> {
        let wrong =
            |complaint: String| Error::Weights(format!("facetalk head config.json: {complaint}"));
        let config: HeadConfig =
            serde_json::from_str(text).map_err(|error| wrong(error.to_string()))?;
        match config.complaint() {
            Some(complaint) => Err(wrong(complaint)),
            None => Ok(config),
        }
    }

    /// Number of anchors `A`.
    pub fn anchors(&self) -> usize {
        2 * self.pairs.len() + self.middle.len()
    }

    /// Length `Z` of z_id: the global part, one local part for every anchor and one for the
    /// background.
    pub fn identity_code(&self) -> usize {
        self.global_code + (self.anchors() + 1) * self.local_code
    }

    /// The landmark of every anchor: pairs one after another, then the middle.
    pub(super) fn landmark_numbers(&self) -> Vec<usize> {
        let pairs = self.pairs.iter().flatten();
        pairs.chain(&self.middle).copied().collect()
    }

    fn complaint(&self) -> Option<String> {
        let positive = |value: f32| value > 0.0 && value.is_finite();
        let outside = self
            .landmark_numbers()
            .into_iter()
            .find(|landmark| *landmark >= LANDMARKS);
        let lengths = [
            ("scale_m", self.scale_m),
            ("sigma", self.sigma),
            ("background", self.background),
        ];
        let layers = [self.layers, self.expression_layers, self.template_layers];
        let [low, high] = self.bounds_m;
        if let Some((name, value)) = lengths.iter().find(|(_, value)| !positive(*value)) {
            Some(format!("{name}: expected a positive number, got {value}"))
        } else if let Some(landmark) = outside {
            Some(format!(
                "anchors: expected landmarks below {LANDMARKS}, got {landmark}"
            ))
        } else if layers.iter().any(|layers| *layers < 2) {
            Some(format!("layers: expected at least 2, got {layers:?}"))
        } else if self.octaves.max(self.expression_octaves) > 16 {
            let (one, other) = (self.octaves, self.expression_octaves);
            Some(format!(
                "octaves: expected at most 16, got {one} and {other}"
            ))
        } else if !(0..3).all(|axis| positive(high[axis] - low[axis]) && low[axis].is_finite()) {
            Some(format!("bounds_m: expected a box, got {low:?} to {high:?}"))
        } else if !self.channels.iter().any(|name| name == "jawOpen") {
            Some("channels: expected jawOpen among them, got none".to_owned())
        } else {
            None
        }
    }
}
