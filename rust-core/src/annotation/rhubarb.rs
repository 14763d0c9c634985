//! Rhubarb Lip Sync's mouth cues, as tab-separated lines or JSON.

use std::fmt::Write;

use super::{
    Annotation, Interval, Symbols, Tier,
    tiers::{finished, interval, time, wrong},
};

const SHAPES: [&str; 9] = ["A", "B", "C", "D", "E", "F", "G", "H", "X"];
const EXPECTED: &str = "a mouth shape A to H or X";

#[derive(serde::Deserialize, serde::Serialize)]
struct File {
    metadata: Metadata,
    #[serde(rename = "mouthCues")]
    cues: Vec<Cue>,
}

#[derive(serde::Deserialize, serde::Serialize, Default)]
struct Metadata {
    #[serde(default)]
    duration: f64,
}

#[derive(serde::Deserialize, serde::Serialize)]
struct Cue {
    start: f64,
    end: f64,
    value: String,
}

fn annotation(intervals: Vec<Interval>, duration_s: f64) -> Annotation {
    let symbols = Symbols::Rhubarb;
    finished(vec![Tier { symbols, intervals }], duration_s)
}

/// Each line holds a start and a shape. The shape lasts until the next line.
pub(super) fn read_tsv(text: &str) -> Result<Annotation, String> {
    let mut intervals: Vec<Interval> = Vec::new();
    for (number, row) in super::plain::rows(text) {
        let words: Vec<&str> = row.split_whitespace().collect();
        let [start, shape] = words[..] else {
            return Err(wrong(number, "a time and a mouth shape", row));
        };
        if !SHAPES.contains(&shape) {
            return Err(wrong(number, EXPECTED, shape));
        }
        let start_s = time(number, start)?;
        let after_s = intervals.last().map_or(0.0, |last| last.start_s);
        let next = interval(number, [start_s, start_s], shape, after_s)?;
        if let Some(last) = intervals.last_mut() {
            last.end_s = start_s;
        }
        intervals.push(next);
    }
    Ok(annotation(intervals, 0.0))
}

pub(super) fn read_json(text: &str) -> Result<Annotation, String> {
    let file: File = serde_json::from_str(text)
        .map_err(|error| format!("{}: expected Rhubarb's JSON: {error}", error.line()))?;
    let (mut intervals, mut after_s): (Vec<Interval>, f64) = (Vec::new(), 0.0);
    let mut lines = text
        .lines()
        .enumerate()
        .filter(|(_, row)| row.contains("\"value\""));
    for cue in file.cues {
        // This assumes one cue a line. Where cues share a line, the number may be wrong.
        let line = lines.next().map_or(1, |(number, _)| number + 1);
        if !SHAPES.contains(&cue.value.as_str()) {
            return Err(wrong(line, EXPECTED, &cue.value));
        }
        let start_s = time(line, &cue.start.to_string())?;
        intervals.push(interval(line, [start_s, cue.end], &cue.value, after_s)?);
        after_s = cue.end;
    }
    Ok(annotation(intervals, file.metadata.duration))
}

pub(super) fn write_tsv(annotation: &Annotation) -> String {
    let mut out = String::new();
    for cue in annotation.filled(Symbols::Rhubarb) {
        let _ = writeln!(out, "{:.3}\t{}", cue.start_s, cue.label);
    }
    out + &format!("{:.3}\tX\n", annotation.duration_s)
}

pub(super) fn write_json(annotation: &Annotation) -> String {
    let cue = |interval: Interval| Cue {
        start: interval.start_s,
        end: interval.end_s,
        value: interval.label,
    };
    let filled = annotation.filled(Symbols::Rhubarb);
    let file = File {
        metadata: Metadata {
            duration: annotation.duration_s,
        },
        cues: filled.into_iter().map(cue).collect(),
    };
    serde_json::to_string_pretty(&file).expect("numbers and texts") + "\n"
}
