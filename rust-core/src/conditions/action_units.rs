//! Action units of the face and what shows them on ARKit's shapes; events that ask for them.
//!
//! Cafe-Talk (Chen et al. 2025), eq. 1: `F = {(F_d, F_s, F_e)}`; units are those of the Facial Action Coding
//! System (Ekman & Friesen 1978). Side, strength and seconds are ours.

use std::path::Path;

use ndarray::Array2;

use crate::{Error, Result};

/// Left and right.
pub const SIDES: usize = 2;
/// Largest strength of an event; 1 is the model's own.
pub const MAX_EVENT_STRENGTH: f32 = 2.0;

/// Time in which the strength of an event rises before its slot and falls behind it, seconds.
const EDGE_S: f64 = 0.12;

/// A unit and the ARKit shapes that show it, without `Left` and `Right`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ActionUnit {
    /// Its number.
    pub name: &'static str,
    /// What it does.
    pub label: &'static str,
    /// Stems of ARKit's names.
    pub shapes: &'static [&'static str],
    /// Whether it moves the mouth, where speech has the first say.
    pub is_lower: bool,
}

const fn upper(
    name: &'static str,
    label: &'static str,
    shapes: &'static [&'static str],
) -> ActionUnit {
    ActionUnit {
        name,
        label,
        shapes,
        is_lower: false,
    }
}

const fn lower(
    name: &'static str,
    label: &'static str,
    shapes: &'static [&'static str],
) -> ActionUnit {
    ActionUnit {
        is_lower: true,
        ..upper(name, label, shapes)
    }
}

/// The sixteen units of Cafe-Talk, in the order of the weights.
pub const ACTION_UNITS: [ActionUnit; 16] = [
    upper("1", "inner brow raiser", &["browInnerUp"]),
    upper("2", "outer brow raiser", &["browOuterUp"]),
    upper("4", "brow lowerer", &["browDown"]),
    upper("5", "upper lid raiser", &["eyeWide"]),
    upper("6", "cheek raiser", &["cheekSquint"]),
    upper("7", "lid tightener", &["eyeSquint"]),
    lower("9", "nose wrinkler", &["noseSneer"]),
    lower("10", "upper lip raiser", &["mouthUpperUp"]),
    lower("12", "lip corner puller", &["mouthSmile"]),
    lower("14", "dimpler", &["mouthDimple"]),
    lower("15", "lip corner depressor", &["mouthFrown"]),
    lower("17", "chin raiser", &["mouthShrugLower"]),
    lower("20", "lip stretcher", &["mouthStretch"]),
    lower("26", "jaw drop", &["jawOpen"]),
    lower("28", "lip suck", &["mouthRollLower", "mouthRollUpper"]),
    upper("45", "blink", &["eyeBlink"]),
];

/// On which side of the face, the subject's own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Side {
    /// Both.
    #[default]
    Both,
    /// The subject's left.
    Left,
    /// The subject's right.
    Right,
}

impl Side {
    /// A unit on this side: `12`, `45L`.
    pub fn written(self, unit: &str) -> String {
        let ending = match self {
            Side::Both => "",
            Side::Left => "L",
            Side::Right => "R",
        };
        format!("{unit}{ending}")
    }
}

/// Units that are active for a while.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// First and last second.
    pub slot_s: [f64; 2],
    /// Numbers in [`ACTION_UNITS`], each with its side.
    pub units: Vec<(usize, Side)>,
    /// 0 to [`MAX_EVENT_STRENGTH`].
    pub strength: f32,
    /// Whether lips that the speech brings together may stay apart under it.
    pub over_speech: bool,
}

impl ActionUnit {
    /// Whether its shapes have sides; one that has none is on both.
    pub fn has_sides(&self) -> bool {
        !matches!(self.name, "1" | "17" | "26" | "28")
    }

    /// The number in [`ACTION_UNITS`] of `12`, `AU12` or `au 12`.
    pub fn find(name: &str) -> Option<usize> {
        let name = name.trim().to_ascii_lowercase();
        let digits = name.strip_prefix("au").unwrap_or(&name).trim();
        let digits = digits.trim_start_matches('0');
        ACTION_UNITS.iter().position(|unit| unit.name == digits)
    }

    /// The same with `L` or `R` behind for one side: `45L`.
    ///
    /// # Errors
    /// `InvalidInput` with what was expected and what came.
    pub fn find_with_side(text: &str) -> Result<(usize, Side)> {
        sided(text).ok_or_else(|| {
            let message = format!("unit: expected one such as 12, 45L or AU1, got {text:?}");
            Error::InvalidInput(message)
        })
    }
}

impl Event {
    /// Reads `1.2-2.0:12,6:0.8` or `0.5-0.9:45L`: seconds, units with `L` or `R` for one side, strength. A `!`
    /// at the end puts it over the speech.
    ///
    /// # Errors
    /// `InvalidInput` for seconds that do not rise, an unknown unit or a strength out of range.
    pub fn parse(text: &str) -> Result<Event> {
        let wrong = |what: &str| {
            Error::InvalidInput(format!(
                "event: expected seconds, units and strength as in 1.2-2.0:12,6L:0.8, got {what:?} in {text:?}"
            ))
        };
        let (asked, over_speech) = match text.trim_end().strip_suffix('!') {
            Some(rest) => (rest, true),
            None => (text, false),
        };
        let mut parts = asked.split(':');
        let (slot, units) = (
            parts.next().unwrap_or(""),
            parts.next().ok_or_else(|| wrong(text))?,
        );
        let (start, end) = slot.split_once('-').ok_or_else(|| wrong(slot))?;
        let second = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong(text));
        let strength = match parts.next() {
            Some(number) => number.trim().parse().map_err(|_| wrong(number))?,
            None => 1.0,
        };
        let units = units
            .split(',')
            .map(|unit| sided(unit).ok_or_else(|| wrong(unit)));
        let event = Event {
            slot_s: [second(start)?, second(end)?],
            units: units.collect::<Result<_>>()?,
            strength,
            over_speech,
        };
        event.check()?;
        Ok(event)
    }

    /// Reads events from JSON: a list, or an object with a list `events`, of `{"start_s": 1.2, "end_s": 2.0,
    /// "units": ["12", "45L"], "strength": 0.8, "over_speech": false}`; the last two may be left out.
    ///
    /// # Errors
    /// `InvalidInput` that names the row, what was expected and what it holds.
    pub fn from_json(text: &str) -> Result<Vec<Event>> {
        #[derive(serde::Deserialize)]
        #[serde(untagged)]
        enum Document {
            List(Vec<serde_json::Value>),
            Object { events: Vec<serde_json::Value> },
        }
        let wrong = |row: usize, why: &dyn std::fmt::Display| {
            Error::InvalidInput(format!("event {}: {why}", row + 1))
        };
        let document: Document = serde_json::from_str(text).map_err(|error| {
            let message = format!(
                "events: expected a JSON list of objects with start_s, end_s and units ({error})"
            );
            Error::InvalidInput(message)
        })?;
        let (Document::List(rows) | Document::Object { events: rows }) = document;
        let read = |(row, value): (usize, serde_json::Value)| {
            let found: Row = serde_json::from_value(value).map_err(|error| wrong(row, &error))?;
            found.event().map_err(|error| wrong(row, &error))
        };
        rows.into_iter().enumerate().map(read).collect()
    }

    /// Events of a JSON file; see [`Event::from_json`].
    ///
    /// # Errors
    /// `Io`, and those of [`Event::from_json`].
    pub fn read(path: &Path) -> Result<Vec<Event>> {
        let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
        Event::from_json(&text)
    }

    /// Whether one of its units moves a shape of ARKit's.
    pub fn shows(&self, shape: &str) -> bool {
        self.units.iter().any(|&(unit, side)| {
            let unit = &ACTION_UNITS[unit];
            let on_side = match (unit.has_sides(), side) {
                (true, Side::Left) => shape.ends_with("Left"),
                (true, Side::Right) => shape.ends_with("Right"),
                _ => true,
            };
            on_side && unit.shapes.iter().any(|stem| shape.starts_with(stem))
        })
    }

    /// Its units as [`Event::parse`] reads them: `12,6L`.
    pub fn written_units(&self) -> String {
        let units = self
            .units
            .iter()
            .map(|(unit, side)| side.written(ACTION_UNITS[*unit].name));
        units.collect::<Vec<_>>().join(",")
    }

    /// Whether its numbers are in range.
    ///
    /// # Errors
    /// `InvalidInput` that names the one that is not.
    pub fn check(&self) -> Result<()> {
        let [start, end] = self.slot_s;
        let complaint = if !(start >= 0.0 && start < end && end.is_finite()) {
            format!("slot: expected two rising times from 0 s, got {start} to {end} s")
        } else if self.units.is_empty() {
            "units: expected one at least, got none".to_owned()
        } else if let Some((unit, _)) = self
            .units
            .iter()
            .find(|(unit, _)| *unit >= ACTION_UNITS.len())
        {
            format!(
                "unit: expected a number below {}, got {unit}",
                ACTION_UNITS.len()
            )
        } else if !(0.0..=MAX_EVENT_STRENGTH).contains(&self.strength) {
            format!(
                "strength: expected 0 to {MAX_EVENT_STRENGTH}, got {}",
                self.strength
            )
        } else {
            return Ok(());
        };
        Err(Error::InvalidInput(format!("event {complaint}")))
    }
}

/// An event as a file has it.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    start_s: f64,
    end_s: f64,
    units: Vec<String>,
    #[serde(default = "whole")]
    strength: f32,
    #[serde(default)]
    over_speech: bool,
}

fn whole() -> f32 {
    1.0
}

impl Row {
    fn event(&self) -> Result<Event> {
        let unit = |text: &String| ActionUnit::find_with_side(text);
        let event = Event {
            slot_s: [self.start_s, self.end_s],
            units: self.units.iter().map(unit).collect::<Result<_>>()?,
            strength: self.strength,
            over_speech: self.over_speech,
        };
        event.check()?;
        Ok(event)
    }
}

fn sided(text: &str) -> Option<(usize, Side)> {
    let text = text.trim();
    let (name, side) = match text.chars().last()?.to_ascii_uppercase() {
        'L' => (&text[..text.len() - 1], Side::Left),
        'R' => (&text[..text.len() - 1], Side::Right),
        _ => (text, Side::Both),
    };
    Some((ActionUnit::find(name)?, side))
}

/// Events frame by frame, as the model hears them.
#[derive(Debug, Clone, PartialEq)]
pub struct EventTrack {
    /// `[T, 32]` of 0 and 1: units on the left, then on the right. A unit on one side is active on both: faces
    /// from which the built-in model learned are symmetric, and the mask keeps it to its side.
    pub active: Array2<f32>,
    /// `[T, S]`, Z of eq. 6: the strongest event of each frame and shape; 0 away from all.
    pub mask: Array2<f32>,
    /// `[T]`, where an event is put over the speech.
    pub over_speech: Vec<bool>,
}

impl EventTrack {
    /// `frames` frames at `fps`; frame `t` stands at `t / fps` seconds. An event has one frame at least. Its
    /// strength comes and goes within [`EDGE_S`] before and behind its slot, in which the model lets it rise
    /// and fall.
    ///
    /// `shapes` are the model's, names of ARKit.
    pub fn of(events: &[Event], shapes: &[String], frames: usize, fps: f64) -> EventTrack {
        let mut track = EventTrack {
            active: Array2::zeros((frames, SIDES * ACTION_UNITS.len())),
            mask: Array2::zeros((frames, shapes.len())),
            over_speech: vec![false; frames],
        };
        for event in events {
            track.add(event, shapes, fps);
        }
        track
    }

    fn add(&mut self, event: &Event, shapes: &[String], fps: f64) {
        let frames = self.mask.nrows();
        let shown: Vec<usize> = (0..shapes.len())
            .filter(|&s| event.shows(&shapes[s]))
            .collect();
        let [first, last] = event.slot_s.map(|second| (second * fps).round() as usize);
        let end = last.max(first.saturating_add(1));
        let edge = (EDGE_S * fps).round() as usize;
        for t in first.saturating_sub(edge)..end.saturating_add(edge).min(frames) {
            let beyond = first.saturating_sub(t).max((t + 1).saturating_sub(end));
            let share = 1.0 - beyond as f32 / (edge + 1) as f32;
            for &s in &shown {
                self.mask[[t, s]] = self.mask[[t, s]].max(share * event.strength);
            }
        }
        for t in first..end.min(frames) {
            self.over_speech[t] |= event.over_speech;
            for &(unit, _) in &event.units {
                for side in 0..SIDES {
                    self.active[[t, side * ACTION_UNITS.len() + unit]] = 1.0;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::ARKIT;

    #[test]
    fn every_unit_shows_on_shapes_of_arkit() {
        for unit in ACTION_UNITS {
            for stem in unit.shapes {
                let name = match unit.has_sides() {
                    true => format!("{stem}Left"),
                    false => (*stem).to_owned(),
                };
                assert!(ARKIT.contains(&name.as_str()), "{name}");
            }
        }
    }

    #[test]
    fn events_are_read_with_sides_and_strength() {
        let event = Event::parse("1.2-2.0:12,AU06L:0.8").unwrap();
        assert_eq!(event.slot_s, [1.2, 2.0]);
        assert_eq!(event.units, [(8, Side::Both), (4, Side::Left)]);
        assert_eq!((event.strength, event.over_speech), (0.8, false));
        assert!(Event::parse("1.2-2.0:26!").unwrap().over_speech);
        for wrong in [
            "2-1:12",
            "1-2",
            "1-2:99",
            "1-2:12:3",
            "x-2:12",
            "1-2::1",
            "-1-2:12",
            "1-2:12:nan",
        ] {
            assert!(Event::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn files_hold_the_same_events_as_text() {
        let json = r#"{"events": [{"start_s": 1.2, "end_s": 2, "units": ["12", "AU06L"], "strength": 0.8}]}"#;
        assert_eq!(
            Event::from_json(json).unwrap(),
            [Event::parse("1.2-2:12,6L:0.8").unwrap()]
        );
        for (wrong, told) in [
            (
                r#"[{"start_s": 2, "end_s": 1, "units": ["12"]}]"#,
                "event 1",
            ),
            (r#"[{"start_s": 2, "end_s": 3, "units": ["99"]}]"#, "99"),
            (r#"[{"start_s": 2, "units": ["1"]}]"#, "end_s"),
            (r#"{"start": 2}"#, "expected a JSON list"),
            (
                r#"[{"start_s": 0, "end_s": 1, "units": ["1"], "strength": "much"}]"#,
                "much",
            ),
        ] {
            let error = Event::from_json(wrong).unwrap_err().to_string();
            assert!(error.contains(told), "{error}");
        }
    }

    #[test]
    fn a_track_has_units_in_their_slots_and_nowhere_else() {
        let events = [
            Event::parse("0.4-0.8:45L:0.5").unwrap(),
            Event::parse("0.6-9:1").unwrap(),
        ];
        let shapes = ARKIT.map(str::to_owned);
        let track = EventTrack::of(&events, &shapes, 25, 25.0);
        let at = |name: &str| ARKIT.iter().position(|known| *known == name).unwrap();
        let wink = track.mask.column(at("eyeBlinkLeft")).to_vec();
        assert_eq!(wink[6..11], [0.0, 0.125, 0.25, 0.375, 0.5]);
        assert_eq!(track.mask.column(at("eyeBlinkRight")).sum(), 0.0);
        assert_eq!(track.mask[[24, at("browInnerUp")]], 1.0);
        assert_eq!((track.active[[20, 0]], track.active[[20, 16]]), (1.0, 1.0));
        assert_eq!(track.active.sum(), 2.0 * 10.0 + 2.0 * 10.0);
        for never in ["1e300-2e300:1", "1.2-2:1"] {
            let never = [Event::parse(never).unwrap()];
            let track = EventTrack::of(&never, &shapes, 25, 25.0);
            assert_eq!((track.active.sum(), track.mask.sum()), (0.0, 0.0));
        }
        let soon = [Event::parse("1.04-2:1").unwrap()];
        let mask = EventTrack::of(&soon, &shapes, 25, 25.0).mask;
        let brow = mask.column(at("browInnerUp"));
        assert_eq!([brow[22], brow[23], brow[24]], [0.0, 0.25, 0.5]);
    }
}
