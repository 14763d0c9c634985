//! What the seed changes: a little of the face, not the sync.

use ndarray::Array3;
use serde::Serialize;

use super::{
    bootstrap::{Estimate, estimate},
    clip::{Clip, Corpus},
    scores::{lips, upper},
    speaker::{Speaker, Wish},
};
use anyface::{
    Result,
    ibug::LANDMARKS,
    metrics::{pearson, seed_deviation},
};

/// Performances of each clip.
pub(super) const SEEDS: usize = 5;
const CLIPS: usize = 8;
const MM: f64 = 1000.0;

/// One source.
#[derive(Debug, Clone, Serialize)]
pub(super) struct SeedScores {
    pub source: String,
    pub clips: usize,
    /// Standard deviation of a landmark's place between seeds, mm.
    pub lips_mm: Option<Estimate>,
    pub upper_mm: Option<Estimate>,
    /// Pearson r of the lip gap between seeds, mean over pairs.
    pub gap_r: Option<Estimate>,
}

struct Record {
    lips_mm: f64,
    upper_mm: f64,
    gap_r: f64,
}

pub(super) fn measure(speaker: &Speaker, wish: &Wish, corpus: &Corpus) -> Result<SeedScores> {
    let clips = corpus.held_out.iter().take(CLIPS);
    let records: Vec<Record> = clips
        .map(|clip| record(speaker, wish, clip))
        .collect::<Result<_>>()?;
    let mean = |of: fn(&Record) -> f64| {
        estimate(&records, move |records| {
            let sum: f64 = records.iter().map(|r| of(r)).sum();
            (!records.is_empty()).then(|| sum / records.len() as f64)
        })
    };
    Ok(SeedScores {
        source: corpus.source.clone(),
        clips: records.len(),
        lips_mm: mean(|r| r.lips_mm),
        upper_mm: mean(|r| r.upper_mm),
        gap_r: mean(|r| r.gap_r),
    })
}

fn record(speaker: &Speaker, wish: &Wish, clip: &Clip) -> Result<Record> {
    let motions: Vec<Array3<f64>> = (0..SEEDS as u64)
        .map(|seed| {
            let wish = Wish {
                seed: wish.seed + seed,
                ..wish.clone()
            };
            speaker.speak(clip, &wish)
        })
        .collect::<Result<_>>()?;
    let views: Vec<_> = motions.iter().map(|motion| motion.view()).collect();
    let region = |of: fn(usize) -> bool| (0..LANDMARKS).filter(|n| of(*n)).collect::<Vec<_>>();
    let gaps: Vec<Vec<f64>> = views
        .iter()
        .map(|motion| clip.gap_mm(*motion))
        .collect::<Result<_>>()?;
    let pairs = (0..gaps.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let r: Vec<f64> = pairs.map(|(a, b)| pearson(&gaps[a], &gaps[b])).collect();
    Ok(Record {
        lips_mm: MM * seed_deviation(&views, &region(lips))?,
        upper_mm: MM * seed_deviation(&views, &region(upper))?,
        gap_r: r.iter().sum::<f64>() / r.len() as f64,
    })
}
