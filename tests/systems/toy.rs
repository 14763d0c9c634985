//! A system of less than a hundred lines: the jaw drops with the loudness of the voice.

use std::path::Path;

use ndarray::Array3;

use crate::{
    Result,
    audio::PROSODY_FPS,
    conditions::{Control, ControlStage, ControlValues},
    deform::LEARNED,
    job::{ProgressFn, report},
    mesh::ibug::LANDMARKS,
    motion::{LandmarkClip, Motion, MotionKind, MotionRequest},
    speech::SpeechFeatures,
    systems::{Registration, Sampled, System},
};

/// How far the chin drops at the loudest moment.
static DROP: Control = Control {
    name: "drop_mm",
    label: "Drop",
    help: "How far the chin drops at the loudest moment, in millimetres.",
    unit: "mm",
    values: ControlValues::Real,
    low: 0.0,
    high: 30.0,
    default: 15.0,
    neutral: 0.0,
    stage: ControlStage::Motion,
    is_animatable: false,
};

static CONTROLS: &[Control] = &[DROP, LEARNED];

pub static REGISTRATION: Registration = Registration {
    name: "toy",
    label: "Toy",
    help: "The jaw drops with the loudness of the voice.",
    models: &[],
    controls: &[CONTROLS],
    motion: MotionKind::Landmarks,
    abilities: &[],
    emotion: None,
    sliders: &[],
    second_bytes: 200_000,
    open: |_folder: Option<&Path>| Ok(Box::new(Toy)),
};

struct Toy;

impl System for Toy {
    fn sample(
        &self,
        heard: &SpeechFeatures,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Sampled> {
        let drop_m = 1e-3 * DROP.value(&request.controls);
        let levels = &heard.prosody.level_db;
        let quiet = heard.prosody.loud_db - 30.0;
        let mut displacements = Array3::zeros((heard.frames(request.fps), LANDMARKS, 3));
        for (t, mut frame) in displacements.outer_iter_mut().enumerate() {
            let heard_at = (t as f64 / request.fps * PROSODY_FPS) as usize;
            let level = levels[heard_at.min(levels.len() - 1)];
            let open = ((level - quiet) / 30.0).clamp(0.0, 1.0);
            let chin = (4..13usize).map(|n| (n, 1.0 - n.abs_diff(8) as f32 / 8.0));
            for (n, share) in chin.chain((55..60).chain(64..68).map(|n| (n, 0.8))) {
                frame[[n, 1]] = -drop_m * share * open;
            }
        }
        report(progress, "motion", 1.0)?;
        let fps = request.fps;
        Ok(Motion::Landmarks(LandmarkClip { displacements, fps }).into())
    }
}
