//! Everything that a report holds.

use serde::Serialize;

use super::{
    closures, effort, emotions, events, labiodentals, life, reading, scores::Scores, seams, seeds,
    silence, steps, timing, vowels,
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
    pub silence: Vec<silence::SilenceScores>,
    pub digital_silence: Option<silence::DigitalSilence>,
    pub vowels: Vec<vowels::VowelScores>,
    pub labiodentals: Vec<labiodentals::LabiodentalScores>,
    pub effort: Vec<effort::EffortScores>,
    pub life: Vec<life::LifeScores>,
    pub reading: Option<reading::Reading>,
    pub intensity: Vec<emotions::IntensityCurve>,
    pub seeds: Vec<seeds::SeedScores>,
    pub events: Option<events::EventScores>,
    pub seams: Option<seams::SeamScores>,
    pub steps: Vec<steps::StepScores>,
    pub timing: timing::Timing,
}
