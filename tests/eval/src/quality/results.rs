//! Everything that a report holds.

use serde::Serialize;

use super::{
    closures, emotions, events, reading, row::Row, scores::Scores, seams, silence, timing,
};

/// All numbers of one source.
#[derive(Serialize)]
pub(super) struct SourceScores {
    pub source: String,
    pub clips: usize,
    pub frames: usize,
    pub predictors: Vec<PredictorScores>,
}

/// All numbers of one predictor on one source.
#[derive(Serialize)]
pub(super) struct PredictorScores {
    pub name: String,
    pub scores: Scores,
}

/// Which weights were measured.
#[derive(Serialize)]
pub(super) struct WeightsHash {
    pub name: String,
    pub blake3: String,
}

/// Everything that a report holds.
#[derive(Serialize)]
pub(super) struct Results {
    pub command: String,
    pub weights: Vec<WeightsHash>,
    pub sources: Vec<SourceScores>,
    pub closures: Vec<closures::SourceClosures>,
    pub silence: Vec<Row>,
    pub digital_silence: Option<silence::DigitalSilence>,
    pub vowels: Vec<Row>,
    pub labiodentals: Vec<Row>,
    pub effort: Vec<Row>,
    pub life: Vec<Row>,
    pub reading: Option<reading::Reading>,
    pub intensity: Vec<emotions::IntensityCurve>,
    pub seeds: Vec<Row>,
    pub events: Option<events::EventScores>,
    pub seams: Option<seams::SeamScores>,
    pub steps: Vec<Row>,
    pub timing: timing::Timing,
}
