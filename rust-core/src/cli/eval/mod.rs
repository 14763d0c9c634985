//! `anyface eval`: the model beside two baselines on recorded performances it never saw.
//!
//! Which stretches are held out is the rule of `training/corpus/split.py`: every tenth clip of
//! grid_s1 by name, the last 15 % of every take of facegood_zh.

mod baselines;
mod clip;
mod facegood;
mod grid;
mod ict;
mod scores;
mod tensors;

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::{arguments::SharedArgs, console::Console};
use crate::{
    Engine, Error, MotionRequest, Result,
    progress::{Progress, SILENT, report},
};
use baselines::Baselines;
use clip::{Clip, Corpus};
use scores::{Scores, Tally};

/// Measure the model on recorded motion that training never saw, beside two baselines
#[derive(Args)]
pub(super) struct Eval {
    /// Data folder: motion/grid_s1, motion/facegood_zh and faces/ict_facekit.safetensors
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Use the first N held-out clips of each source only
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
    /// Speaking style for all sources [default: each source's own]
    #[arg(long, value_name = "NAME")]
    style: Option<String>,
    /// Same seed, same motion
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Denoising steps [default: the model's own]
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
}

/// All numbers of one source.
#[derive(Serialize)]
struct SourceScores {
    source: &'static str,
    clips: usize,
    frames: usize,
    model: Scores,
    constant: Scores,
    loudness: Scores,
}

impl Eval {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let engine = shared.engine()?;
        let ict = ict::IctLandmarks::read(&self.data)?;
        let mut results = Vec::new();
        for corpus in [
            grid::read(&self.data, &ict, self.limit)?,
            facegood::read(&self.data, &ict, self.limit)?,
        ] {
            results.push(self.score(&engine, &corpus, &ict, console)?);
        }
        let table: String = results.iter().map(table).collect();
        console.value(&results, &table);
        Ok(())
    }

    fn score(
        &self,
        engine: &Engine,
        corpus: &Corpus,
        ict: &ict::IctLandmarks,
        console: &Console,
    ) -> Result<SourceScores> {
        let baselines = Baselines::fit(&corpus.training)?;
        let mut tallies: [Tally; 3] = Default::default();
        for (n, clip) in corpus.held_out.iter().enumerate() {
            let fraction = n as f32 / corpus.held_out.len() as f32;
            report(&|p: Progress| console.progress(p), corpus.source, fraction)?;
            let predictions = [
                self.speak(engine, corpus.source, clip)?,
                baselines.constant(clip),
                baselines.loudness(clip),
            ];
            for (tally, prediction) in tallies.iter_mut().zip(&predictions) {
                tally.add(clip, prediction.view(), ict)?;
            }
        }
        let [model, constant, loudness] = tallies.map(Tally::finish);
        Ok(SourceScores {
            source: corpus.source,
            clips: corpus.held_out.len(),
            frames: corpus.held_out.iter().map(Clip::frames).sum(),
            model,
            constant,
            loudness,
        })
    }

    /// The model's motion for a clip's sound, `[T, 68, 3]` metres, as long as the recording.
    fn speak(&self, engine: &Engine, source: &str, clip: &Clip) -> Result<ndarray::Array3<f64>> {
        let request = MotionRequest {
            fps: clip.fps,
            seed: self.seed,
            steps: self.steps,
            style: Some(self.style.clone().unwrap_or_else(|| source.into())),
            ..MotionRequest::default()
        };
        let motion = engine
            .motion(&clip.waveform, &request, SILENT)?
            .displacements;
        let made = motion.dim().0;
        if made == 0 {
            return Err(Error::InvalidInput(format!(
                "{}: no frame was made",
                clip.name
            )));
        }
        Ok(ndarray::Array3::from_shape_fn(
            clip.motion.dim(),
            |(t, n, i)| f64::from(motion[[t.min(made - 1), n, i]]),
        ))
    }
}

/// One source as an aligned table.
fn table(result: &SourceScores) -> String {
    let mut text = format!(
        "{}: {} held-out clips, {} frames\n{:<10}",
        result.source, result.clips, result.frames, ""
    );
    for (name, _) in result.model.columns() {
        text += &format!("{name:>12}");
    }
    for (row, scores) in [
        ("model", &result.model),
        ("constant", &result.constant),
        ("loudness", &result.loudness),
    ] {
        text += &format!("\n{row:<10}");
        for (_, value) in scores.columns() {
            text += &match value {
                Some(value) => format!("{value:>12.3}"),
                None => format!("{:>12}", "-"),
            };
        }
    }
    text + "\n\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    /// r of the lip gap that loudness alone reaches.
    fn loudness_r(corpus: &Corpus, ict: &ict::IctLandmarks) -> f64 {
        let baselines = Baselines::fit(&corpus.training).unwrap();
        let mut tally = Tally::default();
        for clip in &corpus.held_out {
            let made = baselines.loudness(clip);
            tally.add(clip, made.view(), ict).unwrap();
        }
        let scores = tally.finish();
        assert!(
            scores.lve_root_mm > 0.5 && scores.lve_root_mm < 10.0,
            "{scores:?}"
        );
        scores.lip_gap_r
    }

    #[test]
    #[ignore = "needs ../shared"]
    fn loudness_alone_reaches_what_is_known_of_it() {
        let shared = std::env::var("ANYFACE_SHARED")
            .unwrap_or_else(|_| format!("{}/../../shared", env!("CARGO_MANIFEST_DIR")));
        let data = PathBuf::from(shared).join("data");
        let ict = ict::IctLandmarks::read(&data).unwrap();
        let grid = grid::read(&data, &ict, None).unwrap();
        assert_eq!(grid.held_out.len(), 91);
        let r = loudness_r(&grid, &ict);
        assert!((0.55..0.75).contains(&r), "grid_s1: {r}");
        let facegood = facegood::read(&data, &ict, None).unwrap();
        assert_eq!(facegood.held_out.len(), 5);
        let r = loudness_r(&facegood, &ict);
        assert!((0.7..0.9).contains(&r), "facegood_zh: {r}");
    }
}
