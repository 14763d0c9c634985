//! Lip closure on p, b and m, where phone times are known.

use serde::Serialize;

use super::{
    bootstrap::{estimate, median},
    clip::{Clip, gap_mm, rest_gap_mm},
    phone::Phone,
    predictors::Performed,
    row::Row,
};
use crate::metrics::{self, Closure, closures};
use anyface::Result;

/// The lips count as closed if their gap exceeds the gap at rest by at most this, millimetres.
pub(super) const CLOSED_MM: f64 = 0.5;
/// The lips count as shut if their gap is below this share of the clip's 95 % quantile.
pub(super) const SHUT: f64 = 0.15;
/// The lips begin to close halfway through the phone or pause before. Least and greatest lead,
/// seconds.
const LEAD_S: (f64, f64) = (0.04, 0.12);
const MS: f64 = 1000.0;
const PER_CENT: f64 = 100.0;

/// All predictors on one source.
#[derive(Debug, Clone, Serialize)]
pub(super) struct SourceClosures {
    pub source: String,
    pub rows: Vec<Row>,
}

/// The measurements of one clip.
struct Record {
    closures: Vec<Closure>,
    /// Lip gap of the neutral face, mm.
    rest_mm: f64,
    frames: f64,
    frames_closed: f64,
}

impl Record {
    /// The smallest gap of each closure minus the gap at rest, mm.
    fn gaps_mm(&self) -> impl Iterator<Item = f64> {
        self.closures.iter().map(|c| c.gap - self.rest_mm)
    }
}

/// Start and end of each closure that the phones of a clip require, seconds.
///
/// A window starts before the phone by half of the preceding phone or pause, but at least 40 and at
/// most 120 ms. It ends with the phone.
pub(super) fn windows(phones: &[Phone]) -> Vec<(f64, f64)> {
    let mut spans = Vec::new();
    for (k, phone) in phones.iter().enumerate() {
        if phone.closes_the_lips() {
            let before_s = match k.checked_sub(1) {
                // A gap between two phones is a pause.
                Some(j) if phones[j].to_s < phone.from_s - 1e-3 => phone.from_s - phones[j].to_s,
                Some(j) => phone.from_s - phones[j].from_s,
                None => 0.0,
            };
            let lead_s = (0.5 * before_s).clamp(LEAD_S.0, LEAD_S.1);
            spans.push((phone.from_s - lead_s, phone.to_s));
        }
    }
    spans
}

/// Measures one table for every source that has phone times.
pub(super) fn measure(performed: &[Performed]) -> Result<Vec<SourceClosures>> {
    let mut out = Vec::new();
    for source in performed {
        if !source.corpus.held_out.iter().any(|c| c.phones.is_some()) {
            continue;
        }
        let mut rows = Vec::new();
        for (name, motions) in source.with_recording() {
            let pairs = motions.iter().map(|(clip, motion)| (*clip, motion.view()));
            rows.push(score(name, pairs)?.of_group("source", &source.corpus.source));
        }
        out.push(SourceClosures {
            source: source.corpus.source.clone(),
            rows,
        });
    }
    Ok(out)
}

/// Scores the closures of one predictor over clips. Skips clips without phones.
pub(super) fn score<'a>(
    name: &str,
    pairs: impl Iterator<Item = (&'a Clip, metrics::Clip<'a>)>,
) -> Result<Row> {
    let mut records = Vec::new();
    for (clip, motion) in pairs {
        if let Some(phones) = &clip.phones {
            let face = clip.face(name);
            let (gap, rest_mm) = (gap_mm(face, motion)?, rest_gap_mm(face)?);
            records.push(record(&gap, rest_mm, clip.fps, &windows(phones)));
        }
    }
    let share = |of: &[&Record], is: fn(&Record, &Closure) -> bool| {
        let are_shut = || {
            of.iter()
                .flat_map(|r| r.closures.iter().map(move |c| is(r, c)))
        };
        let shut = are_shut().filter(|is| *is).count() as f64;
        (are_shut().count() > 0).then(|| PER_CENT * shut / are_shut().count() as f64)
    };
    let timing = |of: &[&Record]| {
        let are_shut = of.iter().flat_map(|r| &r.closures);
        median(are_shut.map(|c| c.offset_s.abs() * MS))
    };
    let gap = |of: &[&Record]| median(of.iter().flat_map(|r| r.gaps_mm()));
    let time_closed = |of: &[&Record]| {
        let sum = |f: fn(&Record) -> f64| of.iter().map(|r| f(r)).sum::<f64>();
        (!of.is_empty()).then(|| PER_CENT * sum(|r| r.frames_closed) / sum(|r| r.frames))
    };
    let closed = |of: &[&Record]| share(of, |r, c| c.gap - r.rest_mm <= CLOSED_MM);
    let shut = |of: &[&Record]| share(of, |_, c| c.gap_share < SHUT);
    let count: usize = records.iter().map(|r| r.closures.len()).sum();
    let at_any_time = estimate(&records, time_closed);
    Ok(Row::default()
        .with("predictor", "predictor", 0, name)
        .with("clips", "clips", 0, records.len())
        .with("closures", "p b m", 0, count)
        .with("closed_percent", "closed, %", 1, estimate(&records, closed))
        .with("shut_percent", "by share, %", 1, estimate(&records, shut))
        .with("gap_mm", "gap, mm", 2, estimate(&records, gap))
        .with("timing_ms", "timing, ms", 0, estimate(&records, timing))
        .with(
            "time_closed_percent",
            "closed at any time, %",
            1,
            at_any_time,
        ))
}

fn record(gap: &[f64], rest_mm: f64, fps: f64, windows: &[(f64, f64)]) -> Record {
    let closed = gap.iter().filter(|g| **g - rest_mm <= CLOSED_MM);
    Record {
        closures: closures(gap, fps, windows),
        rest_mm,
        frames: gap.len() as f64,
        frames_closed: closed.count() as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::mesh::ibug::LANDMARKS;
    use ndarray::{Array2, Array3};

    fn phone(from_s: f64, to_s: f64, name: &str) -> Phone {
        Phone {
            from_s,
            to_s,
            name: name.into(),
        }
    }

    #[test]
    fn the_window_begins_half_a_phone_early_within_limits() {
        let phones = [
            phone(0.0, 0.05, "a"),
            phone(0.05, 0.15, "p"),
            phone(0.15, 0.35, "o"),
            phone(0.35, 0.45, "m"),
            phone(1.45, 1.5, "b"),
        ];
        let result = windows(&phones);
        let expected = [(0.01, 0.15), (0.25, 0.45), (1.33, 1.5)];
        assert_eq!(result.len(), expected.len());
        for (result, expected) in result.iter().zip(expected) {
            assert!((result.0 - expected.0).abs() < 1e-9 && (result.1 - expected.1).abs() < 1e-9);
        }
    }

    #[test]
    fn closed_frames_and_closures_are_counted_from_rest() {
        let mut gap = vec![10.0; 100];
        gap[25..30].fill(2.4);
        let result = record(&gap, 2.0, 25.0, &[(1.0, 1.16), (2.0, 2.2)]);
        assert_eq!(result.frames_closed, 5.0);
        let gaps: Vec<f64> = result.gaps_mm().collect();
        assert!((gaps[0] - 0.4).abs() < 1e-9 && (gaps[1] - 8.0).abs() < 1e-9);
    }

    #[test]
    fn a_gap_of_half_a_millimetre_is_closed_and_a_wider_one_is_not() {
        let clip = |least_m: f64| {
            let mut motion = Array3::zeros((50, LANDMARKS, 3));
            for t in 0..50 {
                motion[[t, 66, 1]] = if t == 25 { -least_m } else { -0.010 };
            }
            Clip {
                name: "test".into(),
                waveform: anyface::audio::Waveform {
                    samples: Vec::new(),
                },
                start_s: 0.0,
                motion,
                speaker: Array2::zeros((LANDMARKS, 3)),
                neutral: Array2::zeros((LANDMARKS, 3)),
                fps: 25.0,
                observed: Vec::new(),
                judged: 0..50,
                phones: Some(vec![phone(0.95, 1.05, "p")]),
            }
        };
        for (least_m, percent) in [(0.0004, 100.0), (0.0008, 0.0)] {
            let clip = clip(least_m);
            let result = score("", [(&clip, clip.motion.view())].into_iter()).unwrap();
            assert_eq!(result.estimate("closed_percent").unwrap().value, percent);
            assert_eq!(result.estimate("shut_percent").unwrap().value, 100.0);
        }
    }
}
