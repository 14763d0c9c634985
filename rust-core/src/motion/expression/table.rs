//! The table of expressions in the model folder: what each emotion does to the face and to speech.

use std::{collections::BTreeMap, path::Path};

use ndarray::{Array2, Array3, ArrayView2};
use serde::Deserialize;

use super::manner::Manner;
use crate::{
    Error, Result,
    conditions::{EMOTIONS, Strengths},
    mesh::ibug::LANDMARKS,
    models::{BuiltIn, Weights},
};

/// The built-in weights of the table.
pub static MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::EXPRESSIONS);

/// The expression of every emotion at intensity 1 and its manner of speaking.
///
/// Twin of `training/corpus/{emotions,manner}.py`, written by `training/export.py`.
#[derive(Debug, Clone)]
pub struct Expressions {
    /// `[15, 204]`, canonical metres: what lasts through speech.
    pub(super) lasting: Array2<f32>,
    /// `[15, 204]`, canonical metres: what parts or stretches the lips.
    pub(super) opening: Array2<f32>,
    /// `[15]`.
    pub(super) manners: Vec<Manner>,
    /// How many times longer an emotion takes to go than to come.
    pub(super) offset_over_onset: f64,
}

#[derive(Deserialize)]
struct Config {
    emotions: BTreeMap<String, Manner>,
    offset_over_onset: f64,
}

impl Expressions {
    /// The built-in table, or that of `folder/expressions`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, does not fit the other or lacks an emotion.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = MODEL.open(folder)?;
        let wrong = |what: String| Error::Weights(format!("{}/config.json: {what}", MODEL.name));
        let config: Config =
            serde_json::from_str(&files.config).map_err(|error| wrong(error.to_string()))?;
        let manner = |emotion: &&str| {
            let manner = config.emotions.get(*emotion).copied();
            let manner = manner.ok_or_else(|| wrong(format!("expected {emotion}, got none")))?;
            if manner.onset_s > 0.0 && config.offset_over_onset > 0.0 {
                Ok(manner)
            } else {
                Err(wrong(format!(
                    "{emotion}: expected times above 0, got {manner:?}"
                )))
            }
        };
        let weights = Weights::from_bytes(&files.weights)?;
        let part = |name: &str| -> Result<Array2<f32>> {
            let values = weights.values(name, &[EMOTIONS.len(), LANDMARKS, 3])?;
            let shape = (EMOTIONS.len(), LANDMARKS * 3);
            Ok(Array2::from_shape_vec(shape, values).expect("the shape was checked by the reader"))
        };
        Ok(Expressions {
            lasting: part("lasting")?,
            opening: part("opening")?,
            manners: EMOTIONS.iter().map(manner).collect::<Result<_>>()?,
            offset_over_onset: config.offset_over_onset,
        })
    }

    /// The displacements of a face that does not speak, under a constant mixture, `[68, 3]`, canonical
    /// metres.
    ///
    /// `strengths`: one for each emotion; 1 is its full expression.
    pub fn whole(&self, strengths: &[f32; EMOTIONS.len()]) -> Array2<f32> {
        let strengths = ndarray::aview1(strengths);
        let moved = strengths.dot(&self.lasting) + strengths.dot(&self.opening);
        let shape = (LANDMARKS, 3);
        moved
            .into_shape_with_order(shape)
            .expect("three axes a landmark")
    }

    /// The expression over time on a face that does not speak, `[T, 68, 3]`, canonical metres.
    ///
    /// `affect`: `[T, 16]`, mixture and intensity. Where a network learned emotion itself, subtracting this
    /// from its motion leaves the speech. `onset`: factor on the times in which emotions come and go.
    pub fn alone(&self, affect: ArrayView2<'_, f32>, fps: f64, onset: f32) -> Array3<f32> {
        let strengths = self.followed(affect, fps, onset);
        let mut out = Array3::zeros((strengths.len(), LANDMARKS, 3));
        for (mut frame, strengths) in out.outer_iter_mut().zip(&strengths) {
            frame.assign(&self.whole(strengths));
        }
        out
    }
}

impl Expressions {
    /// The manner of speaking of a mixture. Its onset is that of neutral.
    pub(super) fn manner(&self, strengths: &Strengths) -> Manner {
        let mut mixed = Manner {
            opening: 1.0,
            rounding: 1.0,
            slur: 0.0,
            ..self.manners[0]
        };
        for (strength, manner) in strengths.iter().zip(&self.manners) {
            mixed.opening += strength * (manner.opening - 1.0);
            mixed.rounding += strength * (manner.rounding - 1.0);
            mixed.slur += strength * manner.slur;
        }
        mixed
    }
}
