//! What the number of denoising steps buys.

use ndarray::Array3;
use serde::Serialize;

use super::{
    bootstrap::Estimate,
    clip::{Clip, Corpus},
    closures,
    measures::scores,
    scores::ClipScores,
    speaker::{Speaker, Wish},
};
use crate::stopwatch::Stopwatch;
use anyface::Result;

/// Numbers of DDIM steps.
const STEPS: [usize; 4] = [1, 2, 4, 20];
const CLIPS: usize = 20;

/// One source at one number of steps.
#[derive(Debug, Clone, Serialize)]
pub(super) struct StepScores {
    pub source: String,
    pub steps: usize,
    pub clips: usize,
    pub gap_r_by_clip: Option<Estimate>,
    pub gap_slope: Option<Estimate>,
    pub gap_amplitude: Option<Estimate>,
    /// Where phone times are known.
    pub closed_percent: Option<Estimate>,
    /// Seconds of processor time to a second of sound.
    pub work_per_second: f64,
}

pub(super) fn measure(speaker: &Speaker, wish: &Wish, corpus: &Corpus) -> Result<Vec<StepScores>> {
    let every = corpus.held_out.len().div_ceil(CLIPS).max(1);
    let clips: Vec<&Clip> = corpus.held_out.iter().step_by(every).collect();
    STEPS
        .into_iter()
        .map(|steps| {
            let wish = Wish {
                steps: Some(steps),
                ..wish.clone()
            };
            let mut found = at_steps(speaker, &wish, &clips)?;
            found.source = corpus.source.clone();
            found.steps = steps;
            Ok(found)
        })
        .collect()
}

fn at_steps(speaker: &Speaker, wish: &Wish, clips: &[&Clip]) -> Result<StepScores> {
    let stopwatch = Stopwatch::start();
    let motions: Vec<Array3<f64>> = clips
        .iter()
        .map(|clip| speaker.speak(clip, wish))
        .collect::<Result<_>>()?;
    let work_s = stopwatch.work_s();
    let pairs = || clips.iter().zip(&motions).map(|(c, m)| (*c, m.view()));
    let records: Vec<ClipScores> = pairs()
        .map(|(clip, motion)| ClipScores::new(clip, motion))
        .collect::<Result<_>>()?;
    let found = scores(&records);
    let closed = closures::score("", pairs())?;
    let sound_s: f64 = clips.iter().map(|c| c.waveform.duration_s()).sum();
    Ok(StepScores {
        source: String::new(),
        steps: 0,
        clips: clips.len(),
        gap_r_by_clip: found.get("gap_r_by_clip").copied(),
        gap_slope: found.get("gap_slope").copied(),
        gap_amplitude: found.get("gap_amplitude").copied(),
        closed_percent: closed.closed_percent,
        work_per_second: work_s / sound_s.max(f64::MIN_POSITIVE),
    })
}
