//! Events whose units are said in words.

use super::{TextUnits, check_length};
use crate::{
    Error, Result,
    conditions::{Event, MAX_EVENT_STRENGTH},
};

/// Units are written with fewer letters in a row than words.
const LETTERS_OF_A_WORD: usize = 3;

impl Event {
    /// Reads `1.2-2.0:smile:0.8`: seconds, units as in [`Event::parse`] or a text, strength; a `!` at the end
    /// puts it over the speech.
    ///
    /// A text's own amounts multiply the strength; the strongest unit counts, since an event has one strength.
    ///
    /// # Errors
    /// Those of [`Event::parse`]; `InvalidInput` for a text in which no unit was understood, with the nearest
    /// thing that would be, and for one of more than 1,000 letters.
    pub fn from_text(text: &str, words: &TextUnits) -> Result<Event> {
        check_length(text)?;
        let (asked, over_speech) = match text.trim_end().strip_suffix('!') {
            Some(rest) => (rest, true),
            None => (text, false),
        };
        let (slot, rest) = asked.split_once(':').unwrap_or((asked, ""));
        let number = rest
            .rsplit_once(':')
            .filter(|(_, end)| end.trim().parse::<f32>().is_ok());
        let (said, strength) = number.unwrap_or((rest, "1"));
        if !has_word(said) {
            return Event::parse(text);
        }
        // Seconds and strength are checked as those of any event, beside a unit that stands for the text.
        let mut event = Event::parse(&format!("{slot}:1:{strength}"))
            .map_err(|error| Error::InvalidInput(format!("{error} (of {text:?})")))?;
        let understood = words.understood_or_error(said)?;
        event.units = understood
            .units
            .iter()
            .map(|(u, side, ..)| (*u, *side))
            .collect();
        let strongest = understood
            .units
            .iter()
            .map(|unit| unit.2)
            .fold(0.0, f32::max);
        event.strength = (event.strength * strongest).min(MAX_EVENT_STRENGTH);
        event.over_speech = over_speech;
        event.check()?;
        Ok(event)
    }
}

/// Whether a text holds a word rather than numbers of units alone.
fn has_word(text: &str) -> bool {
    text.split(|c: char| !c.is_alphabetic())
        .any(|word| word.chars().count() >= LETTERS_OF_A_WORD || !word.is_ascii())
}
