//! How a speaker sounds without emotion, so that a low or rough voice counts as no emotion.

use ndarray::Array1;

use crate::{Error, Result};

/// Number of windows at which a speaker's own voice gets half of the weight.
///
/// The mean of a few windows depends on the words more than on the speaker.
const HALF_BELIEVED: f64 = 12.0;
/// A recording has a voice if the mean weight of its windows is above this. Hiss has 0.1, speech 0.5
/// and more.
const LEAST_VOICE: f64 = 0.25;

/// A speaker's neutral voice, as an ear hears it.
#[derive(Debug, Clone, PartialEq)]
pub struct NeutralVoice {
    /// The offset that is added to every row of the speaker, `[R]`.
    pub(super) offset: Array1<f64>,
}

impl NeutralVoice {
    /// From rows with their weights. The offset is `readers` minus the weighted mean of the rows,
    /// reduced if there is little voice.
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
                "neutral voice: expected a recording of speech, got one without a voice".into(),
            ));
        }
        let share = total / (total + HALF_BELIEVED);
        Ok(NeutralVoice {
            offset: (readers - sum / total) * share,
        })
    }
}
