//! Times of words, phones and visemes as text-to-speech and subtitles give them.
//!
//! Tables have the columns start, duration or end, and phone or word, separated by tabs. JSON may be
//! ElevenLabs' characters, Azure's events (ticks of 100 ns), or any list of objects with a start, an
//! end and a label, as Whisper and Gentle write it, also inside one object. JSON lines are Amazon
//! Polly's speech marks. Subtitles are SubRip's and WebVTT's.

use serde_json::Value;

use super::{
    Annotation, Interval, Symbols, Tier,
    plain::rows,
    tiers::{finished, interval, time, wrong},
};
use crate::job::check_json;

/// Azure's ticks in a second.
const TICKS_S: f64 = 1e7;
/// A phone with the mouth of each of Azure's visemes.
const AZURE: [&str; 22] = [
    "_", "ə", "ɑ", "ɔ", "ɛ", "ɝ", "i", "w", "o", "aʊ", "ɔɪ", "aɪ", "h", "ɹ", "l", "s", "ʃ", "ð",
    "f", "t", "k", "p",
];
/// A phone with the mouth of each of Polly's visemes.
const POLLY: [(&str, &str); 15] = [
    ("sil", "_"),
    ("p", "p"),
    ("t", "t"),
    ("S", "ʃ"),
    ("T", "θ"),
    ("f", "f"),
    ("k", "k"),
    ("i", "i"),
    ("r", "ɹ"),
    ("s", "s"),
    ("u", "u"),
    ("@", "ə"),
    ("a", "ɑ"),
    ("e", "e"),
    ("E", "ɛ"),
];
/// Longest time that the last viseme lasts, seconds.
const LAST_S: f64 = 0.2;
const STARTS: [&str; 3] = ["start_s", "start", "begin"];
const ENDS: [&str; 2] = ["end_s", "end"];
const PHONES: [&str; 2] = ["phone", "phoneme"];
const WORDS: [&str; 3] = ["word", "text", "alignedWord"];
/// Names of the lists of words and phones inside other objects.
const LISTS: [&str; 6] = [
    "words",
    "segments",
    "phones",
    "phonemes",
    "alignment",
    "items",
];

/// Whether the first line of a table is a header of this module's columns.
pub(super) fn is_table(text: &str) -> bool {
    header(text).is_some()
}

/// The place of the start, of the duration or end, and of the label, and the kind of label.
fn header(text: &str) -> Option<(usize, usize, bool, usize, Symbols)> {
    let (_, first) = rows(text).next()?;
    let names: Vec<String> = first
        .split('\t')
        .map(|name| name.trim().to_lowercase())
        .collect();
    let place = |known: &[&str]| names.iter().position(|name| known.contains(&name.as_str()));
    let start = place(&STARTS)?;
    let end = place(&ENDS).map(|at| (at, false));
    let (end, lasts) = end.or_else(|| place(&["duration_s", "duration"]).map(|at| (at, true)))?;
    let phone = place(&PHONES).map(|at| (at, Symbols::Phones));
    let (label, symbols) = phone.or_else(|| place(&WORDS).map(|at| (at, Symbols::Words)))?;
    Some((start, end, lasts, label, symbols))
}

/// Reads a table with a header.
pub(super) fn read_table(text: &str) -> Result<Annotation, String> {
    let (start, end, lasts, label, symbols) =
        header(text).ok_or("1: expected the columns start_s, duration_s and phone or word")?;
    let mut all: Vec<Interval> = Vec::new();
    for (number, row) in rows(text).skip(1) {
        let cells: Vec<&str> = row.split('\t').map(str::trim).collect();
        let [Some(from), Some(to)] = [start, end].map(|at| cells.get(at)) else {
            return Err(wrong(
                number,
                "a start, an end or duration and a label",
                row,
            ));
        };
        let start_s = time(number, from)?;
        let end_s = time(number, to)? + if lasts { start_s } else { 0.0 };
        let label = cells.get(label).copied().unwrap_or("");
        let after_s = all.last().map_or(0.0, |last| last.end_s.min(start_s));
        all.push(interval(number, [start_s, end_s], label, after_s)?);
    }
    Ok(finished(
        vec![Tier {
            symbols,
            intervals: kept(all),
        }],
        0.0,
    ))
}

/// Intervals with a label, each at most until the next begins.
fn kept(all: Vec<Interval>) -> Vec<Interval> {
    let mut out: Vec<Interval> = Vec::new();
    for interval in all
        .into_iter()
        .filter(|interval| !interval.label.is_empty())
    {
        if let Some(last) = out.last_mut() {
            last.end_s = last.end_s.min(interval.start_s).max(last.start_s);
        }
        out.push(interval);
    }
    out
}

/// Reads JSON, or JSON lines, of text-to-speech.
pub(super) fn read_json(text: &str) -> Result<Annotation, String> {
    let expected = "times of words or phones: ElevenLabs' characters, Azure's or Polly's events, a list of objects \
                    with start, end and word or phone, or Rhubarb's JSON";
    check_json(text.as_bytes())?;
    let value: Value = match serde_json::from_str(text) {
        Ok(value) => value,
        Err(error) => {
            let lines = rows(text).map(|(number, row)| {
                serde_json::from_str(row)
                    .map_err(|_| format!("{number}: expected {expected}: {error}"))
            });
            Value::Array(lines.collect::<Result<_, String>>()?)
        }
    };
    let mut tiers = [(Symbols::Phones, Vec::new()), (Symbols::Words, Vec::new())];
    collect(&value, &mut tiers);
    let tiers = tiers
        .into_iter()
        .filter(|(_, all)| !all.is_empty())
        .map(|(symbols, mut all)| {
            all.sort_by(|a: &Interval, b| a.start_s.total_cmp(&b.start_s));
            Tier {
                symbols,
                intervals: kept(all),
            }
        });
    let tiers: Vec<Tier> = tiers.collect();
    if tiers.iter().all(|tier| tier.intervals.is_empty()) {
        Err(format!("1: expected {expected}, got neither"))
    } else {
        Ok(finished(tiers, 0.0))
    }
}

type Tiers = [(Symbols, Vec<Interval>); 2];

fn collect(value: &Value, tiers: &mut Tiers) {
    match value {
        Value::Array(all) => {
            let events: Vec<(f64, &'static str)> = all.iter().filter_map(viseme).collect();
            tiers[0].1.extend(until_the_next(&events));
            all.iter().for_each(|one| collect(one, tiers));
        }
        Value::Object(fields) => {
            if let Some(words) = characters(value) {
                tiers[1].1.extend(words);
            } else if let Some((place, interval)) = labelled(value) {
                tiers[place].1.push(interval);
                // The phones of a word stand beside it in Gentle's result.
                let phones = fields
                    .iter()
                    .filter(|(name, _)| PHONES.iter().any(|p| name.starts_with(p)));
                phones.for_each(|(_, phones)| collect(phones, tiers));
                return;
            }
            let lists = fields
                .iter()
                .filter(|(name, _)| LISTS.contains(&name.as_str()) || *name == "Metadata");
            lists.for_each(|(_, list)| collect(list, tiers));
        }
        _ => {}
    }
}

fn number(value: &Value, names: &[&str]) -> Option<f64> {
    let found = names.iter().find_map(|name| value.get(*name)?.as_f64());
    found.filter(|x| x.is_finite() && *x >= 0.0)
}

fn text<'a>(value: &'a Value, names: &[&str]) -> Option<&'a str> {
    names.iter().find_map(|name| value.get(*name)?.as_str())
}

/// An object with a start, an end and a phone (0) or word (1).
fn labelled(value: &Value) -> Option<(usize, Interval)> {
    let ticks = || number(value, &["AudioOffset", "audio_offset", "Offset"]).map(|x| x / TICKS_S);
    let (start_s, end_s) = match number(value, &STARTS) {
        Some(start_s) => {
            let lasts = || number(value, &["duration", "duration_s"]).map(|x| start_s + x);
            (start_s, number(value, &ENDS).or_else(lasts)?)
        }
        None => {
            let start_s = ticks()?;
            (
                start_s,
                start_s + number(value, &["Duration", "duration"])? / TICKS_S,
            )
        }
    };
    let label =
        |place: usize, names: &[&str]| text(value, names).map(|label| (place, label.trim()));
    let (place, label) = label(0, &PHONES)
        .or_else(|| label(1, &WORDS))
        .or_else(|| label(1, &["Text", "value"]))?;
    // Whisper's words begin with a space, and Kaldi's phones end with their place in the word.
    let label = if place == 0 {
        label.split('_').next().unwrap_or("")
    } else {
        label
    };
    let interval = Interval {
        start_s,
        end_s: end_s.max(start_s),
        label: label.to_owned(),
    };
    (!interval.label.is_empty()).then_some((place, interval))
}

/// The start and the phone of a viseme of Azure or Polly.
fn viseme(value: &Value) -> Option<(f64, &'static str)> {
    let azure = value.get("viseme_id").or_else(|| value.get("VisemeId"));
    if let Some(id) = azure.and_then(Value::as_u64) {
        let start = number(value, &["audio_offset", "AudioOffset"])?;
        return Some((start / TICKS_S, AZURE.get(id as usize)?));
    }
    if text(value, &["type"])? != "viseme" {
        return None;
    }
    let name = text(value, &["value"])?;
    let (_, phone) = POLLY
        .iter()
        .find(|(known, _)| *known == name)
        .unwrap_or(&("", "_"));
    Some((number(value, &["time"])? / 1000.0, phone))
}

/// Visemes last until the next one.
fn until_the_next(events: &[(f64, &'static str)]) -> Vec<Interval> {
    let ends = events
        .iter()
        .skip(1)
        .map(|(start_s, _)| *start_s)
        .chain([f64::INFINITY]);
    let last = |(&(start_s, label), end_s): (&(f64, &'static str), f64)| Interval {
        start_s,
        end_s: if end_s.is_finite() {
            end_s.max(start_s)
        } else {
            start_s + LAST_S
        },
        label: label.to_owned(),
    };
    events.iter().zip(ends).map(last).collect()
}

/// The words of ElevenLabs' characters with times.
fn characters(value: &Value) -> Option<Vec<Interval>> {
    let list = |names: [&str; 2]| names.iter().find_map(|name| value.get(*name)?.as_array());
    let signs = list(["characters", "chars"])?;
    let starts = list(["character_start_times_seconds", "charStartTimesSeconds"])?;
    let ends = list(["character_end_times_seconds", "charEndTimesSeconds"])?;
    let mut words: Vec<Interval> = Vec::new();
    let mut is_new = true;
    for ((sign, start), end) in signs.iter().zip(starts).zip(ends) {
        let (sign, start_s, end_s) = (sign.as_str()?, start.as_f64()?, end.as_f64()?);
        match words.last_mut().filter(|_| !is_new) {
            _ if sign.trim().is_empty() => {}
            Some(word) => {
                word.label += sign;
                word.end_s = end_s;
            }
            None => words.push(Interval {
                start_s,
                end_s,
                label: sign.to_owned(),
            }),
        }
        is_new = sign.trim().is_empty();
    }
    Some(words)
}

/// Reads SubRip or WebVTT. A line of text is an interval of words.
pub(super) fn read_subtitles(text: &str) -> Result<Annotation, String> {
    let mut intervals: Vec<Interval> = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        let Some((from, to)) = line.split_once("-->") else {
            continue;
        };
        let to = to.split_whitespace().next().unwrap_or("");
        let [start_s, end_s] = [clock(number + 1, from)?, clock(number + 1, to)?];
        let said: Vec<String> = lines
            .by_ref()
            .map(|(_, line)| spoken(line))
            .take_while(|line| !line.is_empty())
            .collect();
        let after_s = intervals.last().map_or(0.0, |last| last.start_s);
        let next = interval(number + 1, [start_s, end_s], said.join(" ").trim(), after_s)?;
        if let Some(last) = intervals.last_mut() {
            last.end_s = last.end_s.min(next.start_s);
        }
        intervals.push(next);
    }
    if intervals.is_empty() {
        Err(
            "1: expected subtitles with times such as 00:00:01,200 --> 00:00:03,400, got none"
                .into(),
        )
    } else {
        Ok(finished(
            vec![Tier {
                symbols: Symbols::Words,
                intervals,
            }],
            0.0,
        ))
    }
}

/// A line of a subtitle without its marks.
fn spoken(line: &str) -> String {
    let mut out = String::new();
    let mut depth = 0_usize;
    for sign in line.trim().chars() {
        match sign {
            '<' | '{' => depth += 1,
            '>' | '}' => depth = depth.saturating_sub(1),
            _ if depth == 0 => out.push(sign),
            _ => {}
        }
    }
    out
}

/// Hours, minutes and seconds.
fn clock(line: usize, text: &str) -> Result<f64, String> {
    let expected = || wrong(line, "a time such as 00:00:01,200", text.trim());
    let plain = text.trim().replace(',', ".");
    let parts: Vec<&str> = plain.split(':').collect();
    if !(2..=3).contains(&parts.len()) {
        return Err(expected());
    }
    parts.iter().try_fold(0.0, |sum, part| {
        let x: f64 = part.parse().map_err(|_| expected())?;
        (x.is_finite() && x >= 0.0)
            .then_some(60.0 * sum + x)
            .ok_or_else(expected)
    })
}
