//! Confidence intervals: the percentile bootstrap over clips (Efron 1979).

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use serde::Serialize;

use super::random::below;
use crate::metrics::quantile;

/// Number of resamples behind every interval.
pub(super) const RESAMPLES: usize = 1000;
const SEED: u64 = 0;
const TAILS: [f64; 2] = [0.025, 0.975];

/// A measured number and the 95 % interval of its sampling error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Estimate {
    pub value: f64,
    /// None where there is only one record.
    pub interval: Option<[f64; 2]>,
}

impl Estimate {
    /// The value and its interval as text: `0.87 (0.85 to 0.89)`.
    pub(super) fn text(&self, digits: usize) -> String {
        match self.interval {
            Some([low, high]) => format!(
                "{} ({} to {})",
                number(self.value, digits),
                number(low, digits),
                number(high, digits)
            ),
            None => number(self.value, digits),
        }
    }
}

/// Median of the values; none if there are none.
pub(super) fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    (!values.is_empty()).then(|| quantile(&values, 0.5))
}

/// Mean of the values; none if there are none.
pub(super) fn mean(values: impl ExactSizeIterator<Item = f64>) -> Option<f64> {
    let count = values.len();
    (count > 0).then(|| values.sum::<f64>() / count as f64)
}

/// Formats a number with a true minus sign, and without one if it rounds to zero.
pub(super) fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

/// `statistic` of all records, and its interval over resamples drawn with replacement.
///
/// None where the statistic is none or not finite: without records, or for a quantity that the
/// records do not have. The draws depend only on the number of records, so all predictors are
/// compared on the same resamples.
pub(super) fn estimate<T>(
    records: &[T],
    statistic: impl Fn(&[&T]) -> Option<f64>,
) -> Option<Estimate> {
    let all: Vec<&T> = records.iter().collect();
    let value = statistic(&all).filter(|value| value.is_finite())?;
    if records.len() < 2 {
        return Some(Estimate {
            value,
            interval: None,
        });
    }
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut draw = || &records[below(&mut random, records.len())];
    let drawn: Vec<f64> = (0..RESAMPLES)
        .filter_map(|_| {
            let sample: Vec<&T> = (0..records.len()).map(|_| draw()).collect();
            statistic(&sample).filter(|value| value.is_finite())
        })
        .collect();
    Some(Estimate {
        value,
        interval: Some(TAILS.map(|q| quantile(&drawn, q))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(records: &[&f64]) -> Option<f64> {
        super::mean(records.iter().map(|x| **x))
    }

    #[test]
    fn the_interval_of_a_mean_is_two_standard_errors_wide_on_either_side() {
        let values: Vec<f64> = (0..400).map(|k| f64::from(k % 20)).collect();
        let result = estimate(&values, mean).unwrap();
        assert!((result.value - 9.5).abs() < 1e-12);
        // The numbers 0 to 19 have a standard deviation of √((20² − 1) / 12) = 5.766. The standard
        // error divides it by √400.
        let [low, high] = result.interval.unwrap();
        let error = 1.96 * 5.766 / 20.0;
        assert!((low - (9.5 - error)).abs() < 0.1, "{low}");
        assert!((high - (9.5 + error)).abs() < 0.1, "{high}");
    }

    #[test]
    fn the_same_records_give_the_same_interval() {
        let values = [1.0, 5.0, 2.0, 8.0];
        assert_eq!(estimate(&values, mean), estimate(&values, mean));
    }

    #[test]
    fn one_record_has_no_interval_and_none_no_value() {
        assert_eq!(estimate(&[3.0], mean).unwrap().interval, None);
        assert_eq!(estimate(&[], mean), None);
        assert_eq!(estimate(&[f64::NAN, 1.0], mean), None);
    }

    #[test]
    fn numbers_are_written_with_their_sign() {
        assert_eq!(number(-0.25, 1), "−0.2");
        assert_eq!(number(-0.001, 2), "0.00");
        let result = Estimate {
            value: 1.0,
            interval: Some([0.5, 1.5]),
        };
        assert_eq!(result.text(1), "1.0 (0.5 to 1.5)");
    }
}
