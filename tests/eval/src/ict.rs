//! The ICT face at its 68 landmarks: neutral and expression modes by ARKit name.

use std::{collections::HashMap, path::Path};

use faer::{Mat, Side, prelude::Solve};
use ndarray::Array2;

use super::tensors::TensorFile;
use anyface::{Error, Result, ibug::LANDMARKS};

const METRES_PER_CM: f64 = 0.01;
/// Landmarks of the chin, which the jaw carries.
const CHIN: std::ops::Range<usize> = 6..11;
const MOUTH: std::ops::Range<usize> = 48..LANDMARKS;
/// Modes that share the mouth's motion between them when its pucker is asked for, the pucker first.
const MOUTH_MODES: [&str; 9] = [
    "mouthPucker",
    "mouthFunnel",
    "jawOpen",
    "mouthClose",
    "mouthSmile",
    "mouthStretch",
    "mouthFrown",
    "mouthLowerDown",
    "mouthUpperUp",
];
/// Damping of that fit, as a share of the modes' mean power.
const DAMPING: f64 = 1e-3;

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

    /// The jawOpen weight that comes closest to the chin's motion, at every frame of `[T, 68, 3]`.
    pub(super) fn jaw_open(&self, motion: anyface::metrics::Clip<'_>) -> Result<Vec<f64>> {
        let mode = self.mode("jawOpen")?;
        let chin = || CHIN.flat_map(|n| (0..3).map(move |i| (n, i)));
        let power: f64 = chin().map(|(n, i)| mode[[n, i]].powi(2)).sum();
        let along =
            |t: usize| -> f64 { chin().map(|(n, i)| motion[[t, n, i]] * mode[[n, i]]).sum() };
        Ok((0..motion.dim().0).map(|t| along(t) / power).collect())
    }

    /// The mouthPucker weight of the least-squares fit of [`MOUTH_MODES`] to mouth and chin, at
    /// every frame of `[T, 68, 3]`.
    pub(super) fn pucker(&self, motion: anyface::metrics::Clip<'_>) -> Result<Vec<f64>> {
        let modes: Vec<Array2<f64>> = MOUTH_MODES
            .iter()
            .map(|name| self.mode(name))
            .collect::<Result<_>>()?;
        let place = || MOUTH.chain(CHIN).flat_map(|n| (0..3).map(move |i| (n, i)));
        let dot =
            |a: &Array2<f64>, b: &Array2<f64>| -> f64 { place().map(|at| a[at] * b[at]).sum() };
        let power = modes.iter().map(|m| dot(m, m)).sum::<f64>() / modes.len() as f64;
        let normal = Mat::from_fn(modes.len(), modes.len(), |a, b| {
            dot(&modes[a], &modes[b]) + if a == b { DAMPING * power } else { 0.0 }
        });
        let right = Mat::from_fn(modes.len(), motion.dim().0, |m, t| {
            place()
                .map(|(n, i)| modes[m][[n, i]] * motion[[t, n, i]])
                .sum()
        });
        let solved = normal
            .llt(Side::Lower)
            .map_err(|e| Error::Numerics(format!("the mouth's modes: {e:?}")))?
            .solve(&right);
        Ok((0..motion.dim().0).map(|t| solved[(0, t)]).collect())
    }
}
