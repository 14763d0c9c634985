//! Whether vowels look different: width, protrusion and opening of i, u and a at their middles.

use super::{
    bootstrap::estimate,
    clip::Clip,
    features::{self, GAP, PROTRUSION, WIDTH},
    predictors::Performed,
    row::Row,
};
use crate::metrics;
use anyface::Result;

const VOWELS: [char; 3] = ['i', 'u', 'a'];
/// Vowels shorter than this are skipped, seconds: they hardly have a middle.
const SHORTEST_S: f64 = 0.04;
/// A source with fewer of any one vowel is left out.
const LEAST: usize = 5;

/// Count and summed features of each vowel in one clip.
#[derive(Default)]
struct Record {
    counts: [usize; 3],
    sums: [[f64; features::COUNT]; 3],
}

/// Measures every source without recorded motion that has enough vowels, then all languages of
/// espeak-ng together.
pub(super) fn measure(performed: &[Performed]) -> Result<Vec<Row>> {
    let mut out = Vec::new();
    let mut all_records = Vec::new();
    for source in performed.iter().filter(|p| !p.corpus.recorded) {
        let pairs = source.model();
        let pairs = pairs
            .iter()
            .map(|(clip, motion)| record(clip, motion.view()));
        let records: Vec<Record> = pairs.collect::<Result<_>>()?;
        if counts(&records).iter().all(|count| *count >= LEAST) {
            out.push(score(&source.corpus.source, &records));
        }
        if source.corpus.is_synthetic() {
            all_records.extend(records);
        }
    }
    if !all_records.is_empty() {
        out.push(score("all of espeak-ng", &all_records));
    }
    Ok(out)
}

fn record(clip: &Clip, motion: metrics::Clip<'_>) -> Result<Record> {
    let curves = features::of(&clip.neutral, motion)?;
    let mut out = Record::default();
    for phone in clip.phones.iter().flatten() {
        let vowel = phone
            .plain_vowel()
            .filter(|_| phone.to_s - phone.from_s >= SHORTEST_S);
        let place = vowel.and_then(|letter| VOWELS.iter().position(|v| *v == letter));
        if let Some(vowel) = place {
            let middle = 0.5 * (phone.from_s + phone.to_s) * clip.fps;
            out.counts[vowel] += 1;
            for (sum, curve) in out.sums[vowel].iter_mut().zip(&curves) {
                *sum += between_frames(curve, middle);
            }
        }
    }
    Ok(out)
}

/// The value of a curve at a frame number that need not be whole. Beyond its ends, the end values
/// hold.
fn between_frames(curve: &[f64], frame: f64) -> f64 {
    let last = curve.len().saturating_sub(1);
    let frame = frame.clamp(0.0, last as f64);
    let before = frame as usize;
    let share = frame - before as f64;
    curve[before] * (1.0 - share) + curve[(before + 1).min(last)] * share
}

/// How often i, u and a occur.
fn counts(records: &[Record]) -> [usize; 3] {
    [0, 1, 2].map(|v| records.iter().map(|r| r.counts[v]).sum())
}

fn score(source: &str, records: &[Record]) -> Row {
    let difference = |more: char, less: char, feature: usize| {
        let mean = move |of: &[&Record], letter: char| {
            let vowel = VOWELS.iter().position(|v| *v == letter)?;
            let count: usize = of.iter().map(|r| r.counts[vowel]).sum();
            let sum: f64 = of.iter().map(|r| r.sums[vowel][feature]).sum();
            (count > 0).then(|| sum / count as f64)
        };
        estimate(records, move |of| Some(mean(of, more)? - mean(of, less)?))
    };
    let forward = difference('u', 'i', PROTRUSION);
    Row::default()
        .with("source", "source", 0, source)
        .with("counts", "i, u, a", 0, counts(records))
        .with(
            "width_i_u_mm",
            "width i − u",
            1,
            difference('i', 'u', WIDTH),
        )
        .with("protrusion_u_i_mm", "protrusion u − i", 1, forward)
        .with("gap_a_i_mm", "gap a − i", 1, difference('a', 'i', GAP))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_between_means_of_all_vowels() {
        let record = |counts, gaps: [f64; 3]| Record {
            counts,
            sums: gaps.map(|gap| [gap, 0.0, 0.0, 0.0]),
        };
        let records = [
            record([1, 0, 2], [2.0, 0.0, 16.0]),
            record([1, 1, 0], [4.0, 1.0, 0.0]),
        ];
        let result = score("", &records);
        assert_eq!(counts(&records), [2, 1, 2]);
        assert!((result.estimate("gap_a_i_mm").unwrap().value - 5.0).abs() < 1e-12);
    }

    #[test]
    fn curves_are_read_between_frames() {
        let curve = [0.0, 2.0, 6.0];
        let values = [-1.0, 0.5, 1.25, 9.0].map(|frame| between_frames(&curve, frame));
        assert_eq!(values, [0.0, 1.0, 3.0, 6.0]);
    }
}
