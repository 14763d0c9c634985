//! The ICT face at its 68 landmarks: neutral and expression modes by ARKit name.

use std::{collections::HashMap, path::Path};

use ndarray::Array2;

use super::tensors::TensorFile;
use anyface::{Error, Result, ibug::LANDMARKS};

const METRES_PER_CM: f64 = 0.01;
/// `[68, 3]` each, metres, canonical axes.
pub(super) struct IctLandmarks {
    pub neutral: Array2<f64>,
    modes: HashMap<String, Array2<f64>>,
}

impl IctLandmarks {
    pub(super) fn read(data: &Path) -> Result<Self> {
        let file = TensorFile::read(&data.join("faces/ict_facekit.safetensors"))?;
        let (rows, _) = file.floats("landmarks68")?;
        let (neutral, shape) = file.floats("neutral")?;
        let (expression, _) = file.floats("expression")?;
        let vertices = shape[0];
        let names = file.words("expression_names")?;
        if rows.len() != LANDMARKS || expression.len() != names.len() * vertices * 3 {
            return Err(file.bad("expected 68 landmarks and one expression mode per name"));
        }
        let at = |values: &[f32], mode: usize| {
            Array2::from_shape_fn((LANDMARKS, 3), |(n, i)| {
                let row = mode * vertices + rows[n] as usize;
                f64::from(values[row * 3 + i]) * METRES_PER_CM
            })
        };
        let modes = names.into_iter().enumerate();
        Ok(IctLandmarks {
            neutral: at(&neutral, 0),
            modes: modes.map(|(m, name)| (name, at(&expression, m))).collect(),
        })
    }

    /// One mode by ARKit name: `mouthSmileLeft` is `mouthSmile_L`, and a name without a side,
    /// such as `browInnerUp`, is both sides together.
    pub(super) fn mode(&self, name: &str) -> Result<Array2<f64>> {
        let sided = name.replace("Left", "_L").replace("Right", "_R");
        // `mouthLeft` and `jawLeft` are modes of their own.
        for key in [name, sided.as_str()] {
            if let Some(mode) = self.modes.get(key) {
                return Ok(mode.clone());
            }
        }
        let side = |s: &str| self.modes.get(&format!("{name}_{s}"));
        match (side("L"), side("R")) {
            (Some(left), Some(right)) => Ok(left + right),
            _ => Err(Error::InvalidInput(format!(
                "ICT has no expression mode {name}"
            ))),
        }
    }
}
