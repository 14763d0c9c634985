//! Displacements of the landmarks under ARKit's blendshapes.
//!
//! Twin of `training/corpus/ict.py`, written by `training/export.py`.

use std::path::Path;

use ndarray::{Array3, ArrayView2, Axis};
use serde::Deserialize;

use crate::{
    Error, Result,
    mesh::ibug::{EYES, LANDMARKS},
    models::{BuiltIn, Weights},
};

/// The built-in weights of the face modes.
pub static MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::FACE_MODES);

/// Expression modes of the mean ICT face.
#[derive(Debug, Clone)]
pub struct FaceModes {
    names: Vec<String>,
    /// `[M, 68, 3]`, canonical metres.
    modes: Array3<f32>,
}

#[derive(Deserialize)]
struct Config {
    modes: Vec<String>,
}

impl FaceModes {
    /// The built-in modes, or those of `folder/face_modes`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, does not fit the other or lacks the modes of the lids.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = MODEL.open(folder)?;
        let config: Config = serde_json::from_str(&files.config)
            .map_err(|error| Error::Weights(format!("{}/config.json: {error}", MODEL.name)))?;
        let shape = [config.modes.len(), LANDMARKS, 3];
        let values = Weights::from_bytes(&files.weights)?.values("modes", &shape)?;
        let modes = Array3::from_shape_vec((shape[0], LANDMARKS, 3), values)
            .expect("the shape was checked by the reader");
        let this = FaceModes {
            names: config.modes,
            modes,
        };
        for eye in &EYES {
            this.mode(eye.mode)?;
        }
        Ok(this)
    }

    /// One mode by its name, such as `jawOpen` or `eyeBlink_L`: `[68, 3]`, canonical metres.
    ///
    /// # Errors
    /// `Weights` for an unknown name.
    pub fn mode(&self, name: &str) -> Result<ArrayView2<'_, f32>> {
        let known = self.names.iter().position(|known| known == name);
        let index = known.ok_or_else(|| {
            Error::Weights(format!("{}: expected a mode {name}, got none", MODEL.name))
        })?;
        Ok(self.modes.index_axis(Axis(0), index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_jaw_opens_downwards_and_the_blink_closes_the_left_eye() {
        let modes = FaceModes::open(None).unwrap();
        assert!(modes.mode("jawOpen").unwrap()[[8, 1]] < -0.02);
        let blink = modes.mode("eyeBlink_L").unwrap();
        assert!(blink[[43, 1]] < -0.005 && blink[[37, 1]].abs() < 1e-4);
        assert!(modes.mode("earWiggle").is_err());
    }
}
