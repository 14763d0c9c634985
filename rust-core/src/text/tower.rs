//! The text tower of Cafe-Talk (Chen et al. 2025, appendix E), on the text space or, as in the
//! paper, on CLIP.
//!
//! Has the same layers as `training/text/tower.py`.

use ndarray::{Array1, Array2, Axis};

use super::{clip::ClipText, sentence::Clause, space::Space};
use crate::{
    Result,
    conditions::LEARNED_UNITS,
    models::Weights,
    nn::{elementwise::sigmoid, linear::Linear},
};

/// Rows of the head's output: whether a unit shows, whether on one side only, and how strongly.
const ASKED: usize = 3;

/// How the tower reads a clause.
#[derive(Debug, Clone)]
enum Reading {
    /// The mean of its words and the mean of its denied words, both weighted by a learned score.
    /// The number is the weight of the origin in both means.
    Words(Linear, f32),
    /// CLIP's feature of the clause as text.
    Clip(Box<ClipText>),
}

/// Turns clauses into logits.
#[derive(Debug, Clone)]
pub(super) struct Tower {
    reading: Reading,
    down: Linear,
    up: Linear,
    head: Linear,
}

impl Tower {
    /// Reads a text space `[W, width]`. `no_word`: the weight of the origin in a clause's means.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape.
    pub(super) fn on_words(
        weights: &Weights,
        width: usize,
        hidden: usize,
        no_word: f32,
    ) -> Result<Self> {
        let score = Linear::load(&weights.pp("score"), width, 1)?;
        Tower::load(weights, Reading::Words(score, no_word), 2 * width, hidden)
    }

    /// Reads CLIP's features.
    ///
    /// # Errors
    /// As [`Tower::on_words`].
    pub(super) fn on_clip(weights: &Weights, clip: ClipText, hidden: usize) -> Result<Self> {
        let width = clip.width();
        Tower::load(weights, Reading::Clip(Box::new(clip)), width, hidden)
    }

    fn load(weights: &Weights, reading: Reading, width: usize, hidden: usize) -> Result<Self> {
        Ok(Tower {
            reading,
            down: Linear::load(&weights.pp("down"), width, hidden)?,
            up: Linear::load(&weights.pp("up"), hidden, width)?,
            head: Linear::load(&weights.pp("head"), width, ASKED * LEARNED_UNITS)?,
        })
    }

    /// Logits `[3, 16]`: whether each unit shows, whether on one side only, and its strength.
    pub(super) fn forward(&self, clause: &Clause, space: &Space) -> Array2<f32> {
        let features: Array1<f32> = match &self.reading {
            Reading::Words(score, no_word) => {
                let said = mean(&clause.words, space, score, *no_word);
                let denied = mean(&clause.denied, space, score, *no_word);
                said.into_iter().chain(denied).collect()
            }
            Reading::Clip(clip) => clip.of(&clause.said),
        };
        let features = features.insert_axis(Axis(0));
        let hidden = self.down.forward(&features).mapv_into(|x| x.max(0.0));
        let adapted = features + self.up.forward(&hidden);
        let logits = self.head.forward(&adapted);
        let shape = (ASKED, LEARNED_UNITS);
        logits
            .into_shape_with_order(shape)
            .expect("three rows of units")
    }
}

/// Mean `[D]` of words, weighted by their scores. `no_word`: the weight of the origin.
fn mean(words: &[String], space: &Space, score: &Linear, no_word: f32) -> Array1<f32> {
    let mut sum = Array1::zeros(space.width());
    let mut total = no_word;
    for place in words.iter().map(|word| space.of(word)) {
        if place.iter().any(|x| *x != 0.0) {
            let score = score.forward(&place.view().insert_axis(Axis(0)));
            let weight = sigmoid(score[[0, 0]]);
            sum.scaled_add(weight, &place);
            total += weight;
        }
    }
    sum / total
}
