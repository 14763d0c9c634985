//! How a speaker sounds while he feels nothing, so that a low or rough voice is taken for no emotion.

use ndarray::Array1;

use crate::{Error, Result};

/// Windows with a voice of which a speaker's own voice is believed by half.
///
/// The mean of few windows says what was said rather than who said it.
const HALF_BELIEVED: f64 = 12.0;
/// Mean weight of the windows that count from which somebody speaks. That of hiss is 0.1, that of speech 0.5 and more.
const LEAST_VOICE: f64 = 0.25;

/// A speaker's neutral voice, as an ear hears it.
#[derive(Debug, Clone, PartialEq)]
pub struct NeutralVoice {
    /// What every row of the speaker gets added, `[told + 118]`.
    pub(super) offset: Array1<f64>,
}

impl NeutralVoice {
    /// The way from the mean of rows with their weights to that of `readers`; less of it where there is little of a voice.
    ///
    /// # Errors
    /// `Audio` if nobody speaks.
    pub(super) fn of_rows(
        rows: impl Iterator<Item = (f64, Array1<f64>)>,
        readers: &Array1<f64>,
    ) -> Result<NeutralVoice> {
        let (mut sum, mut total, mut count) = (Array1::zeros(readers.len()), 0.0, 0.0);
        for (weight, row) in rows {
            sum.scaled_add(weight, &row);
            total += weight;
            count += 1.0;
        }
        if total <= LEAST_VOICE * count {
            return Err(Error::Audio(
                "neutral voice: expected somebody who speaks, got a recording without a voice"
                    .into(),
            ));
        }
        let share = total / (total + HALF_BELIEVED);
        Ok(NeutralVoice {
            offset: (readers - sum / total) * share,
        })
    }
}
