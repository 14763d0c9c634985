//! Regularised linear discriminant analysis (Fisher 1936; shrinkage after Friedman 1989).

use faer::{Mat, Side, prelude::Solve};

use anyface::{Error, Result};

/// Share of the pooled covariance to replace by its mean variance on the diagonal.
const SHRINKAGE: f64 = 0.1;

/// One linear score for each class.
pub(super) struct Classifier {
    /// `[classes][features]`.
    weights: Vec<Vec<f64>>,
    /// `[classes]`.
    offsets: Vec<f64>,
}

impl Classifier {
    /// Learns to tell `classes` classes apart from rows of features, each with its class.
    ///
    /// All classes count as equally likely. Features are first divided by their standard deviation
    /// within classes, so that units do not matter.
    pub(super) fn fit(rows: &[(Vec<f64>, usize)], classes: usize) -> Result<Self> {
        let features = rows.first().map_or(0, |(row, _)| row.len());
        let means = class_means(rows, classes, features)?;
        let residual = |row: &(Vec<f64>, usize), f: usize| row.0[f] - means[row.1][f];
        let scale: Vec<f64> = (0..features)
            .map(|f| {
                let power: f64 = rows.iter().map(|row| residual(row, f).powi(2)).sum();
                (power / rows.len() as f64).sqrt().max(1e-9)
            })
            .collect();
        let white = Mat::from_fn(rows.len(), features, |k, f| {
            residual(&rows[k], f) / scale[f]
        });
        let scatter = white.transpose() * &white;
        // Scaled features have unit variance, so the mean variance is 1.
        let covariance = Mat::from_fn(features, features, |a, b| {
            let ridge = if a == b { SHRINKAGE } else { 0.0 };
            (1.0 - SHRINKAGE) * scatter[(a, b)] / rows.len() as f64 + ridge
        });
        let right = Mat::from_fn(features, classes, |f, c| means[c][f] / scale[f]);
        let solved = covariance
            .llt(Side::Lower)
            .map_err(|e| Error::Numerics(format!("the classifier's covariance: {e:?}")))?
            .solve(&right);
        let weight = |c: usize, f: usize| solved[(f, c)] / scale[f];
        let weights: Vec<Vec<f64>> = (0..classes)
            .map(|c| (0..features).map(|f| weight(c, f)).collect())
            .collect();
        let offsets = weights.iter().zip(&means);
        Ok(Classifier {
            offsets: offsets.map(|(w, mean)| -0.5 * dot(w, mean)).collect(),
            weights,
        })
    }

    /// The class with the largest score.
    pub(super) fn classify(&self, row: &[f64]) -> usize {
        let score = |c: &usize| dot(&self.weights[*c], row) + self.offsets[*c];
        (0..self.weights.len())
            .max_by(|a, b| score(a).total_cmp(&score(b)))
            .unwrap_or(0)
    }
}

fn class_means(
    rows: &[(Vec<f64>, usize)],
    classes: usize,
    features: usize,
) -> Result<Vec<Vec<f64>>> {
    let mut sums = vec![vec![0.0; features]; classes];
    let mut counts = vec![0.0; classes];
    for (row, class) in rows {
        counts[*class] += 1.0;
        for (sum, value) in sums[*class].iter_mut().zip(row) {
            *sum += value;
        }
    }
    if let Some(empty) = counts.iter().position(|count| *count == 0.0) {
        return Err(Error::InvalidInput(format!(
            "expected examples of all {classes} classes, got none of class {empty}"
        )));
    }
    for (sum, count) in sums.iter_mut().zip(counts) {
        sum.iter_mut().for_each(|value| *value /= count);
    }
    Ok(sums)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::{
        ChaCha8Rng,
        rand_core::{RngCore, SeedableRng},
    };

    /// Three classes spaced by `apart` along one direction, with strong noise along another.
    fn examples(seed: u64, apart: f64) -> Vec<(Vec<f64>, usize)> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut unit = || (random.next_u32() as f64 / 2f64.powi(32)) - 0.5;
        (0..150)
            .map(|k| {
                let class = k % 3;
                let (noise, along) = (40.0 * unit(), apart * class as f64 + unit());
                (vec![noise + along, noise - along, unit()], class)
            })
            .collect()
    }

    fn accuracy(apart: f64) -> f64 {
        let classifier = Classifier::fit(&examples(1, apart), 3).unwrap();
        let test = examples(2, apart);
        let right = test
            .iter()
            .filter(|(row, c)| classifier.classify(row) == *c);
        right.count() as f64 / test.len() as f64
    }

    #[test]
    fn classes_apart_are_told_apart_across_the_noise() {
        assert!(accuracy(40.0) > 0.99);
    }

    #[test]
    fn classes_that_are_one_are_guessed() {
        assert!(accuracy(0.0) < 0.5);
    }

    #[test]
    fn every_class_needs_an_example() {
        assert!(Classifier::fit(&examples(1, 1.0), 4).is_err());
        assert!(Classifier::fit(&[], 1).is_err());
    }
}
