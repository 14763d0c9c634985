//! What the seed changes: it should vary the manner of a performance, not whether the lips close.

use ndarray::Array3;

use super::{
    bootstrap::{estimate, mean},
    clip::{Clip, Corpus, gap_mm},
    closures::windows,
    row::Row,
    scores::{lips, upper},
    speaker::{Speaker, Wish},
};
use crate::metrics::{closures, pearson, seed_deviation};
use anyface::{Result, mesh::ibug::LANDMARKS};

/// Performances of each clip.
pub(super) const SEEDS: usize = 5;
const CLIPS: usize = 8;
const MM: f64 = 1000.0;

/// One clip.
struct Record {
    /// Standard deviation of a landmark's place between seeds, mm.
    lips_mm: f64,
    upper_mm: f64,
    /// Pearson r of the lip gap between seeds, mean over pairs.
    gap_r: f64,
    /// Largest difference between seeds in the smallest gap of one closure, mm. `None` without
    /// phone times.
    closure_mm: Option<f64>,
}

/// Measures with the default controls, as a user gets them.
pub(super) fn measure(speaker: &Speaker, wish: &Wish, corpus: &Corpus) -> Result<Row> {
    let wish = &Wish {
        default_controls: true,
        ..wish.clone()
    };
    let clips = corpus.held_out.iter().take(CLIPS);
    let records: Vec<Record> = clips
        .map(|clip| record(speaker, wish, clip))
        .collect::<Result<_>>()?;
    let of_clips =
        |of: fn(&Record) -> f64| estimate(&records, move |all| mean(all.iter().map(|r| of(r))));
    let closure_mm = records.iter().filter_map(|r| r.closure_mm);
    Ok(Row::default()
        .with("source", "source", 0, corpus.source.clone())
        .with("clips", "clips", 0, records.len())
        .with("lips_mm", "lips, mm", 3, of_clips(|r| r.lips_mm))
        .with(
            "upper_mm",
            "brows and eyes, mm",
            3,
            of_clips(|r| r.upper_mm),
        )
        .with("gap_r", "lip-gap r", 4, of_clips(|r| r.gap_r))
        .with("closure_mm", "closures, mm", 2, closure_mm.reduce(f64::max)))
}

/// Largest difference between the gap curves in their smallest value within one window, mm.
fn closure_difference(gaps: &[Vec<f64>], fps: f64, windows: &[(f64, f64)]) -> Option<f64> {
    let closures_of_seeds: Vec<_> = gaps.iter().map(|gap| closures(gap, fps, windows)).collect();
    let each = (0..closures_of_seeds.first()?.len()).map(|k| {
        let of_seeds = || closures_of_seeds.iter().map(|closures| closures[k].gap);
        of_seeds().fold(f64::MIN, f64::max) - of_seeds().fold(f64::MAX, f64::min)
    });
    each.reduce(f64::max)
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
        .map(|motion| gap_mm(&clip.neutral, *motion))
        .collect::<Result<_>>()?;
    let pairs = (0..gaps.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let r: Vec<f64> = pairs.map(|(a, b)| pearson(&gaps[a], &gaps[b])).collect();
    let windows = clip.phones.as_deref().map(windows).unwrap_or_default();
    Ok(Record {
        closure_mm: closure_difference(&gaps, clip.fps, &windows),
        lips_mm: MM * seed_deviation(&views, &region(lips))?,
        upper_mm: MM * seed_deviation(&views, &region(upper))?,
        gap_r: r.iter().sum::<f64>() / r.len() as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closure_that_differs_most_counts() {
        let mut gaps = vec![vec![5.0; 50]; 3];
        for (gap, least) in gaps.iter_mut().zip([0.1, 0.4, 0.2]) {
            gap[10] = least;
            gap[30] = 1.0;
        }
        let difference = closure_difference(&gaps, 25.0, &[(0.36, 0.44), (1.16, 1.24)]);
        assert!((difference.unwrap() - 0.3).abs() < 1e-9);
        assert_eq!(closure_difference(&gaps, 25.0, &[]), None);
    }
}
