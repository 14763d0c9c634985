//! How a speaker sounds without emotion, so that a low or rough voice counts as no emotion.

use ndarray::Array1;

use crate::{Error, Result};

/// Number of windows at which a speaker's own voice counts by half.
///
/// The mean of few windows depends on the words rather than on the speaker.
const HALF_BELIEVED: f64 = 12.0;
/// Least mean weight of the windows for a voice. Hiss has 0.1, speech 0.5 and more.
const LEAST_VOICE: f64 = 0.25;

/// A speaker's neutral voice, as an ear hears it.
#[derive(Debug, Clone, PartialEq)]
pub struct NeutralVoice {
    /// The offset of every row of the speaker, `[outputs + 118]`.
    pub(super) offset: Array1<f64>,
}

impl NeutralVoice {
    /// The difference between the weighted mean of rows and that of `readers`, reduced where there
    /// is little voice.
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
