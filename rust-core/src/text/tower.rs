//! The text tower of Cafe-Talk (Chen et al. 2025, appendix E) on the text space.
//!
//! Twin of `training/text/tower.py`, layer by layer.

use ndarray::{Array1, Array2};

use super::{sentence::Clause, space::Space};
use crate::{
    Result,
    conditions::ACTION_UNITS,
    nn::{Weights, linear::Linear},
};

/// Rows of the head's output: it shows, on one side alone, how strong.
const ASKED: usize = 3;

/// Clauses to logits.
#[derive(Debug, Clone)]
pub(super) struct Tower {
    score: Linear,
    down: Linear,
    up: Linear,
    head: Linear,
    /// Weight of the origin in a clause's mean.
    no_word: f32,
}

impl Tower {
    /// # Errors
    /// `Weights` if an array is missing or has another shape.
    pub(super) fn load(
        weights: &Weights,
        width: usize,
        hidden: usize,
        no_word: f32,
    ) -> Result<Self> {
        Ok(Tower {
            score: Linear::load(&weights.pp("score"), width, 1)?,
            down: Linear::load(&weights.pp("down"), 2 * width, hidden)?,
            up: Linear::load(&weights.pp("up"), hidden, 2 * width)?,
            head: Linear::load(&weights.pp("head"), 2 * width, ASKED * ACTION_UNITS.len())?,
            no_word,
        })
    }

    /// Logits `[3, 16]`: the unit shows; it does on one side alone; its strength.
    pub(super) fn forward(&self, clause: &Clause, space: &Space) -> Array2<f32> {
        let said = self.mean(&clause.words, space);
        let denied = self.mean(&clause.denied, space);
        let features = said.iter().chain(&denied).copied().collect();
        let features = Array2::from_shape_vec((1, 2 * space.width()), features).expect("one row");
        let hidden = self.down.forward(&features).mapv_into(|x| x.max(0.0));
        let adapted = features + self.up.forward(&hidden);
        let logits = self.head.forward(&adapted);
        let shape = (ASKED, ACTION_UNITS.len());
        logits
            .into_shape_with_order(shape)
            .expect("three rows of units")
    }

    /// Mean `[D]` of words, weighed by their scores.
    fn mean(&self, words: &[String], space: &Space) -> Array1<f32> {
        let mut sum = Array1::zeros(space.width());
        let mut total = self.no_word;
        for place in words.iter().map(|word| space.of(word)) {
            if place.iter().any(|x| *x != 0.0) {
                let score = self
                    .score
                    .forward(&place.view().insert_axis(ndarray::Axis(0)));
                let weight = sigmoid(score[[0, 0]]);
                sum.scaled_add(weight, &place);
                total += weight;
            }
        }
        sum / total
    }
}

/// `1 / (1 + e⁻ˣ)`.
pub(super) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}
