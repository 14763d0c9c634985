//! Tiers of intervals, and helpers that make them from lines of files.

use super::symbols::Symbols;
use crate::{Error, Result};

/// Label of an interval in which the lips are heard to be closed, for p, b or m.
pub const CLOSED: &str = "MBP";

/// What is said, and when.
///
/// ```
/// use anyface::annotation::{Annotation, AnnotationFormat};
///
/// let heard = Annotation::of_closures(&[[0.25, 0.5]], 1.0);
/// let text = heard.to_text(AnnotationFormat::TextGrid, 24.0);
/// let back = Annotation::from_text(&text, AnnotationFormat::TextGrid, 24.0)?;
/// assert_eq!(back.closures()?, [[0.25, 0.5]]);
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Annotation {
    /// In the order of the file.
    pub tiers: Vec<Tier>,
    /// Length of the sound in seconds if it is known, or else the end of the last interval.
    pub duration_s: f64,
}

/// Intervals of one kind.
#[derive(Debug, Clone, PartialEq)]
pub struct Tier {
    /// The kind of its labels.
    pub symbols: Symbols,
    /// In rising order; each has a label.
    pub intervals: Vec<Interval>,
}

/// A label and its time.
#[derive(Debug, Clone, PartialEq)]
pub struct Interval {
    /// Where it begins, seconds.
    pub start_s: f64,
    /// Where it ends, seconds, not before `start_s`.
    pub end_s: f64,
    /// A phone, a word or a mouth shape.
    pub label: String,
}

impl Annotation {
    /// Makes one tier from the times when the lips are closed: `[start_s, end_s]` in rising order.
    pub fn of_closures(closures: &[[f64; 2]], duration_s: f64) -> Annotation {
        let interval = |&[start_s, end_s]: &[f64; 2]| Interval {
            start_s,
            end_s,
            label: CLOSED.into(),
        };
        Annotation {
            tiers: vec![Tier {
                symbols: Symbols::Phones,
                intervals: closures.iter().map(interval).collect(),
            }],
            duration_s,
        }
    }

    /// When the lips are closed: the intervals `[start_s, end_s]` of p, b, m and similar phones.
    /// They come from the tier of closures, or else from the first tier that is not one of words.
    ///
    /// # Errors
    /// `InvalidInput` if there are only words, or no tiers at all.
    pub fn closures(&self) -> Result<Vec<[f64; 2]>> {
        let tier = self.tier(Symbols::Closures).or_else(|| self.first_shown());
        let tier = tier.ok_or_else(|| {
            Error::InvalidInput(
                "sounds: expected phones or mouth shapes, got words alone, which do not tell when \
                 lips close"
                    .into(),
            )
        })?;
        let closed = tier.intervals.iter();
        let closed = closed.filter(|interval| tier.symbols.closes_lips(&interval.label));
        Ok(closed.map(|i| [i.start_s, i.end_s]).collect())
    }

    /// Whether there is a tier of phones or mouth shapes.
    pub fn shows_mouths(&self) -> bool {
        self.tier(Symbols::Closures)
            .or_else(|| self.first_shown())
            .is_some()
    }

    /// The intervals of the first tier with these symbols; empty if there is no such tier.
    pub fn intervals(&self, symbols: Symbols) -> &[Interval] {
        self.tier(symbols).map_or(&[], |tier| &tier.intervals)
    }

    fn tier(&self, symbols: Symbols) -> Option<&Tier> {
        self.tiers.iter().find(|tier| tier.symbols == symbols)
    }

    /// The first tier that a mouth can show, which is any but words.
    fn first_shown(&self) -> Option<&Tier> {
        let shown = |tier: &&Tier| tier.symbols != Symbols::Words;
        self.tiers.iter().find(shown)
    }

    /// What a mouth shows, for formats with a single tier: the first tier that is not one of words.
    /// With both closures and phones, it shows the phones outside the closures. Only the closures
    /// close the lips.
    pub(super) fn shown(&self) -> (Symbols, Vec<Interval>) {
        let (closures, phones) = (self.tier(Symbols::Closures), self.tier(Symbols::Phones));
        let (Some(closures), Some(phones)) = (closures, phones) else {
            let first = self.first_shown();
            return first.map_or((Symbols::Phones, Vec::new()), |tier| {
                (tier.symbols, tier.intervals.clone())
            });
        };
        let closed = &closures.intervals;
        let open = |phone: &&Interval| !Symbols::Phones.closes_lips(&phone.label);
        let open = phones.intervals.iter().filter(open);
        let mut out: Vec<Interval> = open.flat_map(|phone| outside(phone, closed)).collect();
        out.extend(closed.iter().cloned());
        out.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        (Symbols::Phones, out)
    }

    /// What a mouth shows as mouth shapes of `to`: intervals without gaps, from 0 to the end.
    pub(super) fn filled(&self, to: Symbols) -> Vec<Interval> {
        let (from, intervals) = self.shown();
        let (mut out, mut at): (Vec<Interval>, f64) = (Vec::new(), 0.0);
        let gap = |start_s: f64, end_s: f64| Interval {
            start_s,
            end_s,
            label: to.between().into(),
        };
        // In formats whose labels last until the next one, the last label only marks the end.
        for interval in intervals.iter().filter(|i| i.start_s < self.duration_s) {
            if interval.start_s > at {
                out.push(gap(at, interval.start_s));
            }
            out.push(Interval {
                label: from.as_shape(&interval.label, to),
                ..interval.clone()
            });
            at = interval.end_s;
        }
        if self.duration_s > at {
            out.push(gap(at, self.duration_s));
        }
        out
    }
}

/// The parts of an interval that `others` leave uncovered. `others` are in rising order.
fn outside(interval: &Interval, others: &[Interval]) -> Vec<Interval> {
    let (mut out, mut at) = (Vec::new(), interval.start_s);
    let mut add = |start_s: f64, end_s: f64| {
        let label = interval.label.clone();
        if end_s > start_s {
            out.push(Interval {
                start_s,
                end_s,
                label,
            });
        }
    };
    for other in others.iter().filter(|other| other.start_s < interval.end_s) {
        add(at, other.start_s);
        at = at.max(other.end_s);
    }
    add(at, interval.end_s);
    out
}

/// An annotation of `tiers` that ends at `duration_s` or with the last interval, if that is later.
pub(super) fn finished(tiers: Vec<Tier>, duration_s: f64) -> Annotation {
    let ends = tiers.iter().flat_map(|tier| &tier.intervals);
    let last = ends.map(|i| i.end_s).fold(0.0, f64::max);
    Annotation {
        tiers,
        duration_s: duration_s.max(last),
    }
}

/// Says what was expected in a line, and what is there instead.
pub(super) fn wrong(line: usize, expected: &str, got: &str) -> String {
    format!("{line}: expected {expected}, got {got:?}")
}

/// Reads a time in seconds, finite and at least 0.
pub(super) fn time(line: usize, text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds.is_finite() && seconds >= 0.0 => Ok(seconds),
        _ => Err(wrong(line, "a time in seconds of at least 0", text)),
    }
}

/// Makes an interval that does not start before `after_s` or end before it starts.
pub(super) fn interval(
    line: usize,
    times: [f64; 2],
    label: &str,
    after_s: f64,
) -> Result<Interval, String> {
    let [start_s, end_s] = times;
    // Files round their times, so an overlap of up to 5 µs is allowed.
    if end_s < start_s || start_s < after_s - 5e-6 {
        return Err(format!(
            "{line}: expected an interval that begins at {after_s} s or later and does not end \
             before, got {start_s} to {end_s}"
        ));
    }
    Ok(Interval {
        start_s,
        end_s,
        label: label.to_owned(),
    })
}
