//! Lip closure on p, b and m, where phone times are known.

use ndarray::Array3;
use serde::Serialize;

use super::{
    aligned::Phone,
    bootstrap::{Estimate, estimate},
    clip::Clip,
    predictors::Performed,
};
use anyface::{
    Result,
    ibug::LANDMARKS,
    metrics::{self, Closure, closures, quantile},
};

/// A gap below this share of the clip's 95 % quantile is shut.
pub(super) const SHUT: f64 = 0.15;
/// The lips begin to close before the phone by half of what comes before it, within these limits,
/// seconds.
const LEAD_S: (f64, f64) = (0.04, 0.12);
const MS: f64 = 1000.0;
const PER_CENT: f64 = 100.0;

/// One predictor on one source.
#[derive(Debug, Clone, Serialize)]
pub(super) struct ClosureScores {
    pub predictor: String,
    pub clips: usize,
    pub closures: usize,
    /// Closures that happen, %.
    pub shut_percent: Option<Estimate>,
    /// The same with the neutral face's own gap taken off first, %.
    pub shut_from_rest_percent: Option<Estimate>,
    /// Median distance of the gap's minimum from the middle of its window, ms.
    pub timing_ms: Option<Estimate>,
    /// Frames of all clips with the lips shut from rest, %: what chance would reach.
    pub time_shut_percent: Option<Estimate>,
}

/// All predictors on one source.
#[derive(Debug, Clone, Serialize)]
pub(super) struct SourceClosures {
    pub source: String,
    pub rows: Vec<ClosureScores>,
}

/// What one clip holds.
struct Record {
    closures: Vec<Closure>,
    from_rest: Vec<Closure>,
    frames: f64,
    frames_shut: f64,
}

/// From and to of the closures that the phones of a clip ask for, seconds: from half of the phone
/// or pause before, 40 to 120 ms, to the phone's end.
pub(super) fn windows(phones: &[Phone]) -> Vec<(f64, f64)> {
    let mut found = Vec::new();
    for (k, phone) in phones.iter().enumerate() {
        if phone.closes_the_lips() {
            let before_s = match k.checked_sub(1) {
                // A gap between phones is a pause of its own.
                Some(j) if phones[j].to_s < phone.from_s - 1e-3 => phone.from_s - phones[j].to_s,
                Some(j) => phone.from_s - phones[j].from_s,
                None => 0.0,
            };
            let lead_s = (0.5 * before_s).clamp(LEAD_S.0, LEAD_S.1);
            found.push((phone.from_s - lead_s, phone.to_s));
        }
    }
    found
}

/// One table for every source that has phone times.
pub(super) fn measure(performed: &[Performed]) -> Result<Vec<SourceClosures>> {
    let mut out = Vec::new();
    for source in performed {
        if !source.corpus.held_out.iter().any(|c| c.phones.is_some()) {
            continue;
        }
        let mut rows = Vec::new();
        for (name, motions) in source.with_recording() {
            let pairs = motions.iter().map(|(clip, motion)| (*clip, motion.view()));
            rows.push(score(name, pairs)?);
        }
        out.push(SourceClosures {
            source: source.corpus.source.clone(),
            rows,
        });
    }
    Ok(out)
}

/// The closures of one predictor over clips; clips without phones are passed over.
pub(super) fn score<'a>(
    name: &str,
    pairs: impl Iterator<Item = (&'a Clip, metrics::Clip<'a>)>,
) -> Result<ClosureScores> {
    let mut records = Vec::new();
    for (clip, motion) in pairs {
        if let Some(phones) = &clip.phones {
            let gap = clip.gap_mm(motion)?;
            let rest = clip.gap_mm(Array3::zeros((1, LANDMARKS, 3)).view())?[0];
            records.push(record(&gap, rest, clip.fps, &windows(phones)));
        }
    }
    let share = |of: &[&Record], list: fn(&Record) -> &Vec<Closure>| {
        let found = || of.iter().flat_map(|r| list(r));
        let shut = found().filter(|c| c.gap_share < SHUT).count() as f64;
        (found().count() > 0).then(|| PER_CENT * shut / found().count() as f64)
    };
    let timing = |of: &[&Record]| {
        let found = of.iter().flat_map(|r| &r.closures);
        let errors: Vec<f64> = found.map(|c| c.offset_s.abs() * MS).collect();
        (!errors.is_empty()).then(|| quantile(&errors, 0.5))
    };
    let time_shut = |of: &[&Record]| {
        let sum = |f: fn(&Record) -> f64| of.iter().map(|r| f(r)).sum::<f64>();
        (!of.is_empty()).then(|| PER_CENT * sum(|r| r.frames_shut) / sum(|r| r.frames))
    };
    Ok(ClosureScores {
        predictor: name.into(),
        clips: records.len(),
        closures: records.iter().map(|r| r.closures.len()).sum(),
        shut_percent: estimate(&records, |of| share(of, |r| &r.closures)),
        shut_from_rest_percent: estimate(&records, |of| share(of, |r| &r.from_rest)),
        timing_ms: estimate(&records, timing),
        time_shut_percent: estimate(&records, time_shut),
    })
}

fn record(gap: &[f64], rest: f64, fps: f64, windows: &[(f64, f64)]) -> Record {
    let opened: Vec<f64> = gap.iter().map(|g| g - rest).collect();
    let limit = SHUT * quantile(&opened, 0.95);
    Record {
        closures: closures(gap, fps, windows),
        from_rest: closures(&opened, fps, windows),
        frames: gap.len() as f64,
        frames_shut: opened.iter().filter(|g| **g < limit).count() as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let found = windows(&phones);
        let wanted = [(0.01, 0.15), (0.25, 0.45), (1.33, 1.5)];
        assert_eq!(found.len(), wanted.len());
        for (found, wanted) in found.iter().zip(wanted) {
            assert!((found.0 - wanted.0).abs() < 1e-9 && (found.1 - wanted.1).abs() < 1e-9);
        }
    }

    #[test]
    fn shut_frames_and_closures_are_counted() {
        let mut gap = vec![10.0; 100];
        gap[25..30].fill(1.0);
        let found = record(&gap, 0.0, 25.0, &[(1.0, 1.16), (2.0, 2.2)]);
        assert_eq!(found.frames_shut, 5.0);
        let shares: Vec<f64> = found.closures.iter().map(|c| c.gap_share).collect();
        assert_eq!(shares, [0.1, 1.0]);
    }

    #[test]
    fn lips_that_rest_apart_are_shut_at_rest() {
        let mut gap = vec![6.0; 100];
        gap[25..30].fill(2.0);
        let found = record(&gap, 2.0, 25.0, &[(1.0, 1.16)]);
        assert_eq!(found.from_rest[0].gap_share, 0.0);
        assert!(found.closures[0].gap_share > SHUT);
        assert_eq!(found.frames_shut, 5.0);
    }
}
