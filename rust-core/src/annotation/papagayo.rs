//! Papagayo's project and Moho's switch data, which count in frames.

use std::fmt::Write;

use super::{
    Annotation, Interval, Symbols, Tier,
    tiers::{finished, interval, wrong},
};

const SWITCH: &str = "MohoSwitch1";
const PROJECT: &str = "lipsync version 1";

/// Hands out the lines of a project one by one, empty lines too.
struct Lines<'a>(std::iter::Enumerate<std::str::Lines<'a>>);

impl<'a> Lines<'a> {
    fn next(&mut self, expected: &str) -> Result<(usize, &'a str), String> {
        let line = self.0.next().map(|(number, row)| (number + 1, row.trim()));
        line.ok_or_else(|| format!("1: expected {expected}, got the end of the file"))
    }

    fn number(&mut self, expected: &str) -> Result<usize, String> {
        let (line, row) = self.next(expected)?;
        row.parse().map_err(|_| wrong(line, expected, row))
    }
}

/// Reads the phones and words of the first voice.
pub(super) fn read_project(text: &str) -> Result<Annotation, String> {
    let mut lines = Lines(text.lines().enumerate());
    let (line, header) = lines.next(PROJECT)?;
    if header != PROJECT {
        return Err(wrong(line, PROJECT, header));
    }
    lines.next("the path of the sound")?;
    let (line, row) = lines.next("frames per second")?;
    let fps = match row.parse::<f64>() {
        Ok(fps) if fps.is_finite() && fps > 0.0 => fps,
        _ => return Err(wrong(line, "frames per second", row)),
    };
    let duration_s = lines.number("the length in frames")? as f64 / fps;
    let mut tiers = [Symbols::Papagayo, Symbols::Words].map(|symbols| Tier {
        symbols,
        intervals: Vec::new(),
    });
    if lines.number("the number of voices")? > 0 {
        lines.next("the name of a voice")?;
        lines.next("the text of a voice")?;
        for _ in 0..lines.number("the number of phrases")? {
            lines.next("the text of a phrase")?;
            lines.number("the first frame of a phrase")?;
            lines.number("the last frame of a phrase")?;
            for _ in 0..lines.number("the number of words")? {
                word(&mut lines, fps, &mut tiers)?;
            }
        }
    }
    Ok(finished(tiers.into(), duration_s))
}

/// Reads a word with its first and last frame, and its phones with their first frames.
fn word(lines: &mut Lines<'_>, fps: f64, tiers: &mut [Tier; 2]) -> Result<(), String> {
    const EXPECTED: &str = "a word, its first and last frame and its number of phonemes";
    let (line, row) = lines.next(EXPECTED)?;
    let mut parts = row.rsplitn(4, char::is_whitespace);
    let mut number = || parts.next().and_then(|part| part.parse::<usize>().ok());
    let (Some(count), Some(last), Some(first)) = (number(), number(), number()) else {
        return Err(wrong(line, EXPECTED, row));
    };
    let seconds = |frame: usize| frame as f64 / fps;
    let [phones, words] = tiers;
    let label = parts.next().unwrap_or("").trim();
    let after_s = words.intervals.last().map_or(0.0, |last| last.end_s);
    let times = [seconds(first).max(after_s), seconds(last + 1)];
    words.intervals.push(interval(line, times, label, after_s)?);
    let begun = phones.intervals.len();
    for _ in 0..count {
        const EXPECTED: &str = "the frame of a phoneme and its name";
        let (line, row) = lines.next(EXPECTED)?;
        let parts = row.split_once(char::is_whitespace);
        let parts = parts.and_then(|(frame, name)| Some((frame.parse().ok()?, name.trim())));
        let (frame, name) = parts.ok_or_else(|| wrong(line, EXPECTED, row))?;
        let start_s = seconds(frame);
        let after_s = phones.intervals.last().map_or(0.0, |last| last.start_s);
        let next = interval(
            line,
            [start_s, seconds(last + 1).max(start_s)],
            name,
            after_s,
        )?;
        if phones.intervals.len() > begun {
            phones.intervals.last_mut().expect("one of this word").end_s = start_s;
        }
        phones.intervals.push(next);
    }
    Ok(())
}

/// Frames count from 1. Each mouth lasts until the next frame in the list.
pub(super) fn read_switch(text: &str, fps: f64) -> Result<Annotation, String> {
    let mut rows = super::plain::rows(text);
    match rows.next() {
        Some((_, SWITCH)) => {}
        Some((line, got)) => return Err(wrong(line, SWITCH, got)),
        None => return Err(format!("1: expected {SWITCH}, got an empty file")),
    }
    let mut intervals: Vec<Interval> = Vec::new();
    for (line, row) in rows {
        let parts = row.split_once(char::is_whitespace);
        let parts = parts.and_then(|(frame, name)| Some((frame.parse::<u32>().ok()?, name.trim())));
        let frame_and_name = parts.filter(|(frame, _)| *frame > 0);
        let (frame, name) =
            frame_and_name.ok_or_else(|| wrong(line, "a frame and a mouth", row))?;
        let start_s = f64::from(frame - 1) / fps;
        let after_s = intervals.last().map_or(0.0, |last| last.start_s);
        let next = interval(line, [start_s, start_s], name, after_s)?;
        if let Some(last) = intervals.last_mut() {
            last.end_s = start_s;
        }
        intervals.push(next);
    }
    // Rhubarb exports its own letters in this format too.
    let is_letter = |i: &Interval| i.label.len() == 1 && "ABCDEFGHX".contains(&i.label);
    let symbols = if !intervals.is_empty() && intervals.iter().all(is_letter) {
        Symbols::Rhubarb
    } else {
        Symbols::Papagayo
    };
    Ok(finished(vec![Tier { symbols, intervals }], 0.0))
}

pub(super) fn write_switch(annotation: &Annotation, fps: f64) -> String {
    let mut out = format!("{SWITCH}\n");
    let frame = |time_s: f64| (time_s * fps).round() as u64 + 1;
    for shape in annotation.filled(Symbols::Papagayo) {
        let _ = writeln!(out, "{} {}", frame(shape.start_s), shape.label);
    }
    out + &format!("{} rest\n", frame(annotation.duration_s))
}

/// Writes one voice and phrase. A word of the annotation gets the phones inside it. A phone outside
/// all words becomes a word of its own.
pub(super) fn write_project(annotation: &Annotation, fps: f64) -> String {
    let fps = fps.round().max(1.0);
    let frame = |time_s: f64| (time_s * fps).round() as u64;
    let end = frame(annotation.duration_s);
    let phones = annotation.filled(Symbols::Papagayo);
    let words = annotation.intervals(Symbols::Words);
    let inside = |word: &Interval, phone: &Interval| {
        (word.start_s..word.end_s).contains(&((phone.start_s + phone.end_s) / 2.0))
    };
    let mut rows: Vec<(Interval, Vec<Interval>)> = words
        .iter()
        .map(|word| {
            let phones_of_word = phones.iter().filter(|phone| inside(word, phone));
            (word.clone(), phones_of_word.cloned().collect())
        })
        .collect();
    let alone = |phone: &&Interval| !words.iter().any(|word| inside(word, phone));
    let alone = phones.iter().filter(alone);
    rows.extend(alone.map(|phone| (phone.clone(), vec![phone.clone()])));
    rows.sort_by(|a, b| a.0.start_s.total_cmp(&b.0.start_s));
    let text: Vec<&str> = rows.iter().map(|(word, _)| word.label.as_str()).collect();
    let text = text.join(" ");
    let mut out = format!(
        "{PROJECT}\n\n{fps}\n{end}\n1\n\tVoice 1\n\t{text}\n\t1\n\t\t{text}\n\t\t0\n\t\t{}\n\t\t{}\n",
        end.saturating_sub(1),
        rows.len()
    );
    for (word, phones_of_word) in rows {
        let (first, last) = (frame(word.start_s), frame(word.end_s));
        let last = last.saturating_sub(1).max(first);
        let label = word.label.replace(char::is_whitespace, "_");
        let _ = writeln!(out, "\t\t\t{label} {first} {last} {}", phones_of_word.len());
        for phone in phones_of_word {
            let _ = writeln!(out, "\t\t\t\t{} {}", frame(phone.start_s), phone.label);
        }
    }
    out
}
