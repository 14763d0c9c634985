//! How quality and work depend on the number of denoising steps.

use ndarray::Array3;

use super::{
    clip::{Clip, Corpus, spaced},
    closures,
    measures::scores,
    row::Row,
    scores::ClipScores,
    speaker::{Speaker, Wish},
};
use crate::stopwatch::Stopwatch;
use anyface::Result;

/// Numbers of DDIM steps.
const STEPS: [usize; 4] = [1, 2, 4, 20];
const CLIPS: usize = 20;

pub(super) fn measure(speaker: &Speaker, wish: &Wish, corpus: &Corpus) -> Result<Vec<Row>> {
    let clips: Vec<&Clip> = spaced(&corpus.held_out, CLIPS).collect();
    STEPS
        .into_iter()
        .map(|steps| {
            let wish = Wish {
                steps: Some(steps),
                ..wish.clone()
            };
            at_steps(speaker, &wish, &clips, (&corpus.source, steps))
        })
        .collect()
}

fn at_steps(
    speaker: &Speaker,
    wish: &Wish,
    clips: &[&Clip],
    (source, steps): (&str, usize),
) -> Result<Row> {
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
    let all_scores = scores(&records);
    let score = |key| all_scores.get(key).copied();
    let closed = closures::score("", pairs())?.estimate("closed_percent");
    let sound_s: f64 = clips.iter().map(|c| c.waveform.duration_s()).sum();
    let work = work_s / sound_s.max(f64::MIN_POSITIVE);
    Ok(Row::default()
        .with("source", "source", 0, source)
        .with("steps", "steps", 0, steps)
        .with("clips", "clips", 0, clips.len())
        .with("gap_r_by_clip", "gap r, by clip", 3, score("gap_r_by_clip"))
        .with("gap_slope", "gap slope", 2, score("gap_slope"))
        .with("gap_amplitude", "gap amplitude", 2, score("gap_amplitude"))
        .with("closed_percent", "closed, %", 1, closed)
        .with("work_per_second", "s of work to 1 s of sound", 3, work))
}
