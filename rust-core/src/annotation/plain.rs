//! Lines of start and end in seconds and a label, as in Audacity's label files.

use std::fmt::Write;

use super::{
    Annotation, Interval, Symbols, Tier,
    tiers::{finished, interval, time, wrong},
};

/// The numbered lines that are neither empty nor a remark, which begins with `#`.
pub(super) fn rows(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate();
    let numbered = numbered.map(|(number, row)| (number + 1, row.trim()));
    numbered.filter(|(_, row)| !row.is_empty() && !row.starts_with('#'))
}

pub(super) fn read(text: &str) -> Result<Annotation, String> {
    let mut intervals: Vec<Interval> = Vec::new();
    for (number, row) in rows(text) {
        let expected = || wrong(number, "start, end and label, as in 0.32 0.40 p", row);
        let (start, rest) = row.split_once(char::is_whitespace).ok_or_else(expected)?;
        let rest = rest.trim_start();
        let (end, label) = rest.split_once(char::is_whitespace).ok_or_else(expected)?;
        let times = [time(number, start)?, time(number, end)?];
        let after_s = intervals.last().map_or(0.0, |last| last.end_s);
        intervals.push(interval(number, times, label.trim(), after_s)?);
    }
    let symbols = Symbols::guess("", intervals.iter().map(|i| i.label.as_str()));
    Ok(finished(vec![Tier { symbols, intervals }], 0.0))
}

/// Writes what a mouth shows, or else the first tier. Lines have no place for a second tier.
pub(super) fn write(annotation: &Annotation) -> String {
    let mut out = String::new();
    let (_, mut intervals) = annotation.shown();
    if intervals.is_empty() {
        intervals = annotation
            .tiers
            .first()
            .map_or(Vec::new(), |t| t.intervals.clone());
    }
    for interval in &intervals {
        let Interval {
            start_s,
            end_s,
            label,
        } = interval;
        let _ = writeln!(out, "{start_s:.6}\t{end_s:.6}\t{label}");
    }
    out
}
