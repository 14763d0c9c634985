//! The log-mel of the ear: Whisper's bands, at one loudness.
//!
//! Twin of `ear_mel` in `training/speech/ear.py`.

use ndarray::Array2;

use crate::speech::{
    quantile::quantile,
    whisper_mel::{decades, on_scale},
};

/// Every sound is brought to this level: the 95 % quantile over frames of the loudest band, decades
/// of power.
const LOUD: f32 = 1.0;
const LOUD_QUANTILE: f64 = 0.95;
/// Decades by which a quiet sound is raised at most. Near-silence stays silent.
const MAX_RAISED: f32 = 3.0;
/// Bands below this many decades of power, after the sound has its level, are raised to it.
const QUIETEST: f32 = -6.5;

/// The log-mel that the ear gives to Whisper, `[S]` → `[S / 160, 80]` at 100 Hz.
///
/// Whisper's own limit, 8 decades under the loudest band of the whole sound, moves with a single
/// click. This one is fixed once a sound has its level, so loud and quiet copies of a sound have the
/// same features. `samples`: at 16 kHz, at least 400.
pub(crate) fn ear_mel(samples: &[f32]) -> Array2<f32> {
    let mel = decades(samples);
    let loudest = |row: &[f32]| row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let rows = mel.rows().into_iter();
    let loudest: Vec<f32> = rows
        .map(|row| loudest(row.to_slice().expect("a row is contiguous")))
        .collect();
    let raise = (LOUD - quantile(&loudest, LOUD_QUANTILE)).min(MAX_RAISED);
    mel.mapv_into(|x| on_scale((x + raise).max(QUIETEST)))
}
