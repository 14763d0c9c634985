//! Reads expressions and events whose units are given as text.

use std::{
    path::{Path, PathBuf},
    sync::OnceLock,
};

use serde::{Deserialize, Serialize};

use super::{TextUnits, check_length};
use crate::{
    Error, Result,
    conditions::{ACTION_UNITS, Event, Expression, MAX_EVENT_STRENGTH},
    job::{InputKind, check_json, read_text},
};

/// Reads expressions and events. It loads the text model for the first text that needs it.
#[derive(Debug, Default)]
pub struct Reader {
    models: Option<PathBuf>,
    texts: OnceLock<TextUnits>,
}

impl Reader {
    /// Uses the built-in text model, or that of the folder `text_units` in `models`.
    pub fn new(models: Option<&Path>) -> Reader {
        Reader {
            models: models.map(Path::to_owned),
            texts: OnceLock::new(),
        }
    }

    /// The folder of the user's models, if there is one.
    pub fn models(&self) -> Option<&Path> {
        self.models.as_deref()
    }

    fn texts(&self) -> Result<&TextUnits> {
        if self.texts.get().is_none() {
            let texts = TextUnits::open(self.models())?;
            return Ok(self.texts.get_or_init(|| texts));
        }
        Ok(self.texts.get().expect("it was loaded before"))
    }

    /// Reads units, words of the menu, or a text; see [`Expression::parse`].
    ///
    /// The amounts in a text multiply the strength. An expression has only one strength, so the
    /// strongest unit of the text sets it.
    ///
    /// # Errors
    /// Those of [`Expression::parse`]; `InvalidInput`, with the nearest known expression, for a
    /// text that names no unit, and for a text of more than 1,000 letters; those of
    /// [`TextUnits::open`].
    pub fn expression(&self, text: &str) -> Result<Expression> {
        check_length(text)?;
        let mut expression = Expression::parse(text)?;
        if expression.units.is_empty() {
            let understood = self.texts()?.understood_or_error(&expression.said)?.units;
            expression.units = understood.iter().map(|(u, side, ..)| (*u, *side)).collect();
            let strongest = understood.iter().map(|unit| unit.2).fold(0.0, f32::max);
            expression.strength = (expression.strength * strongest).min(MAX_EVENT_STRENGTH);
        }
        Ok(expression)
    }

    /// Reads `1.2-2.0:smile:0.8`: seconds, then an expression for [`Reader::expression`].
    ///
    /// # Errors
    /// Those of [`Event::slot_and_expression`], [`Reader::expression`] and [`Event::check`].
    pub fn event(&self, text: &str) -> Result<Event> {
        check_length(text)?;
        let (slot_s, said) = Event::slot_and_expression(text)?;
        Event::of(slot_s, self.expression(said)?)
    }

    /// Reads events from JSON, see [`Reader::events_of_json`], or from lines, see [`Reader::event`].
    /// Empty lines are skipped.
    ///
    /// # Errors
    /// Those of either, with the number of the event, counted from 1.
    pub fn events(&self, text: &str) -> Result<Vec<Event>> {
        if text.trim_start().starts_with(['[', '{']) {
            return self.events_of_json(text);
        }
        let lines = text.lines().filter(|line| !line.trim().is_empty());
        let read = |(row, line)| self.event(line).map_err(of_row(row));
        lines.enumerate().map(read).collect()
    }

    /// Reads a text as [`Reader::expression`] does and writes what was read as JSON: `said`, the text
    /// without strength and `!`; `units` such as `45L`; `strength`; `over_speech`; `hint`, which says
    /// why there are no units, or is empty.
    ///
    /// # Errors
    /// Those of [`Reader::expression`], except that a text without a known expression is none.
    pub fn expression_to_json(&self, text: &str) -> Result<String> {
        check_length(text)?;
        let (expression, hint) = match self.expression(text) {
            Ok(expression) => (expression, String::new()),
            Err(Error::InvalidInput(why)) => {
                let said = text.trim().to_owned();
                let nothing = Expression {
                    said,
                    units: Vec::new(),
                    strength: 0.0,
                    over_speech: false,
                };
                (nothing, why)
            }
            Err(error) => return Err(error),
        };
        Ok(json_of(&ReadText {
            units: expression
                .units
                .iter()
                .map(|(unit, side)| side.written(ACTION_UNITS[*unit].name))
                .collect(),
            said: expression.said,
            strength: expression.strength,
            over_speech: expression.over_speech,
            hint,
        }))
    }

    /// Reads events from JSON: a list, or an object with a list `events`, of `{"start_s": 1.2,
    /// "end_s": 2.0, "units": ["12", "45L"], "strength": 0.8, "over_speech": false}`. The last two
    /// may be missing. `units` may be one expression, such as "left wink".
    ///
    /// # Errors
    /// `InvalidInput`, which names the row and says what it should hold and what it holds.
    pub fn events_of_json(&self, text: &str) -> Result<Vec<Event>> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Document {
            List(Vec<serde_json::Value>),
            Object { events: Vec<serde_json::Value> },
        }
        check_json(text.as_bytes()).map_err(|e| Error::InvalidInput(format!("events: {e}")))?;
        let document: Document = serde_json::from_str(text).map_err(|error| {
            let message = format!(
                "events: expected a JSON list of objects with start_s, end_s and units ({error})"
            );
            Error::InvalidInput(message)
        })?;
        let (Document::List(rows) | Document::Object { events: rows }) = document;
        let read = |(row, value): (usize, serde_json::Value)| {
            let fields: Row = serde_json::from_value(value).map_err(|error| wrong(row, &error))?;
            self.event_of_row(fields).map_err(of_row(row))
        };
        rows.into_iter().enumerate().map(read).collect()
    }

    fn event_of_row(&self, row: Row) -> Result<Event> {
        let said = match row.units {
            Units::Expression(said) => said,
            Units::List(units) => units.join(","),
        };
        let expression = self.expression(&said)?;
        let mut event = Event::of([row.start_s, row.end_s], expression)?;
        event.over_speech |= row.over_speech;
        let strength = std::mem::replace(&mut event.strength, row.strength);
        event.check()?;
        event.strength = (strength * row.strength).min(MAX_EVENT_STRENGTH);
        Ok(event)
    }

    /// Reads events from a JSON file; see [`Reader::events_of_json`].
    ///
    /// # Errors
    /// `Io`, and those of [`Reader::events_of_json`].
    pub fn events_of_file(&self, path: &Path) -> Result<Vec<Event>> {
        let text = read_text(path, InputKind::Text)?;
        self.events_of_json(&text)
    }
}

/// Writes events as JSON that [`Reader::events_of_json`] reads. Every row has all fields and lists
/// its units.
pub fn events_to_json(events: &[Event]) -> String {
    let row = |event: &Event| Row {
        start_s: event.slot_s[0],
        end_s: event.slot_s[1],
        units: Units::List(event.written_units()),
        strength: event.strength,
        over_speech: event.over_speech,
    };
    json_of(&events.iter().map(row).collect::<Vec<Row>>())
}

fn json_of(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("numbers and texts can be written")
}

fn wrong(row: usize, why: &dyn std::fmt::Display) -> Error {
    Error::InvalidInput(format!("event {}: {why}", row + 1))
}

/// Adds the number of the event to an error, if it is about an invalid value.
fn of_row(row: usize) -> impl Fn(Error) -> Error {
    move |error| match error {
        Error::InvalidInput(_) => wrong(row, &error),
        other => other,
    }
}

/// What [`Reader::expression_to_json`] writes.
#[derive(Serialize)]
struct ReadText {
    said: String,
    units: Vec<String>,
    strength: f32,
    over_speech: bool,
    hint: String,
}

/// An event as a row of a file.
#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Row {
    start_s: f64,
    end_s: f64,
    units: Units,
    #[serde(default = "whole")]
    strength: f32,
    #[serde(default)]
    over_speech: bool,
}

#[derive(Deserialize, Serialize)]
#[serde(untagged)]
enum Units {
    Expression(String),
    List(Vec<String>),
}

fn whole() -> f32 {
    1.0
}
