//! The grammar of expressions: which units a face shows, how strongly, and whether they override
//! the speech.
//!
//! The command line, C, Python and Blender's strips and markers all parse expressions here.
//! [`crate::text::Reader`] reads texts that are neither units nor words of the menu.

use super::action_units::{ACTION_UNITS, ActionUnit, Side};
use crate::{Error, Result};

/// Animators' names for expressions, and the units of each. No text model is needed for these words.
pub const MENU: [(&str, &str); 32] = [
    ("smile", "6,12"),
    ("smirk", "12L,14L"),
    ("wink", "6L,45L"),
    ("blink", "45"),
    ("surprised blink", "1,2,45"),
    ("surprise", "1,2,5,26"),
    ("brow raise", "1,2"),
    ("worried brows", "1,4"),
    ("frown", "4"),
    ("angry look", "4,5,7"),
    ("squint", "6,7"),
    ("wide eyes", "5"),
    ("sneer", "9,10"),
    ("disgust", "9,10,15"),
    ("sad mouth", "15,17"),
    ("grimace", "10,20"),
    ("sarcastic laugh", "6,12L,14L,26"),
    ("jaw drop", "26"),
    ("pressed lips", "28"),
    ("lip press", "23"),
    ("lips part", "25"),
    ("pucker", "18"),
    ("kiss", "8,18"),
    ("pout", "8,15,17,18"),
    ("puffed cheeks", "8,23,34"),
    ("wince", "4,6,7,10"),
    ("sneeze", "4,6,9,10,45"),
    ("look left", "61"),
    ("look right", "62"),
    ("look up", "63"),
    ("look down", "64"),
    ("roll eyes", "68"),
];

/// Largest strength of an event. 1 is the strength of the model itself.
pub const MAX_EVENT_STRENGTH: f32 = 2.0;

/// Characters that separate two units.
const SEPARATORS: &[char] = &[' ', '\t', '\r', '\n', ',', ';', '+', '&'];

/// The units that a face should show, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Expression {
    /// The expression without strength and `!`.
    pub said: String,
    /// Each unit once: its index in [`ACTION_UNITS`], and its side. Empty if `said` needs a text model.
    pub units: Vec<(usize, Side)>,
    /// 0 to [`MAX_EVENT_STRENGTH`]: the number after the expression, 1 if there is none.
    pub strength: f32,
    /// Whether a `!` lets the expression override the speech.
    pub over_speech: bool,
}

impl Expression {
    /// Reads `12,6L`, `smile`, `left wink`, `right 9,10` or a text.
    ///
    /// A `:0.5` after it sets the strength. A `!` before or after the strength lets the expression
    /// override the speech.
    ///
    /// # Errors
    /// `InvalidInput` if the text says nothing, a unit does not exist, or the strength is out of range.
    pub fn parse(text: &str) -> Result<Expression> {
        let (text, behind) = without_sign(text);
        let number = text.rsplit_once(':');
        let number = number.and_then(|(said, end)| Some((said, end.trim().parse().ok()?)));
        let (said, strength) = number.unwrap_or((text, 1.0));
        let (said, before) = without_sign(said);
        if said.is_empty() {
            let message = "the expression says nothing: expected English words such as \"smile\", or units such as 12,6L";
            return Err(Error::InvalidInput(message.into()));
        }
        if !(0.0..=MAX_EVENT_STRENGTH).contains(&strength) {
            let message = format!("strength: expected 0 to {MAX_EVENT_STRENGTH}, got {strength}");
            return Err(Error::InvalidInput(message));
        }
        let units = match read_units(said)? {
            Some(units) => units,
            None => of_menu(said)?.unwrap_or_default(),
        };
        Ok(Expression {
            said: said.to_owned(),
            units,
            strength,
            over_speech: before || behind,
        })
    }
}

/// A text without the `!` at its end, and whether there was one.
fn without_sign(text: &str) -> (&str, bool) {
    let text = text.trim();
    text.strip_suffix('!')
        .map_or((text, false), |rest| (rest.trim_end(), true))
}

/// Reads units with separators between them: `12,6L`, `AU45 L`, `au01 + AU02`. `None` for any other text.
///
/// A side before the first unit applies to all units. Units that have no sides are on both.
///
/// # Errors
/// `InvalidInput` names the first unit that does not exist.
fn read_units(text: &str) -> Result<Option<Vec<(usize, Side)>>> {
    let text = text.trim().to_lowercase();
    let (word, behind) = split_word(&text);
    let (of_all, mut rest) = match side_of(word) {
        Some(side) => (Some(side), behind.trim_start_matches(SEPARATORS)),
        None => (None, text.as_str()),
    };
    let mut written = Vec::new();
    while !rest.is_empty() {
        let digits = rest.strip_prefix("au").unwrap_or(rest).trim_start();
        let end = digits
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(digits.len());
        let (number, behind) = digits.split_at(end);
        let (word, after) = split_word(behind.trim_start());
        let side = side_of(word);
        let behind = if side.is_some() { after } else { behind };
        if number.is_empty() || !(behind.is_empty() || behind.starts_with(SEPARATORS)) {
            return Ok(None);
        }
        written.push((number, of_all.or(side).unwrap_or_default()));
        rest = behind.trim_start_matches(SEPARATORS);
    }
    let mut units = Vec::new();
    for &(number, side) in &written {
        let unit = ActionUnit::find(number).ok_or_else(|| {
            let known = ACTION_UNITS.map(|unit| unit.name).join(", ");
            let got = side.written(number);
            Error::InvalidInput(format!("unit: expected some of {known}, got {got}"))
        })?;
        let side = if ACTION_UNITS[unit].has_sides() {
            side
        } else {
            Side::Both
        };
        if !units.contains(&(unit, side)) {
            units.push((unit, side));
        }
    }
    Ok((!units.is_empty()).then_some(units))
}

/// Reads one unit, with `L` or `R` after it for one side: `45L`.
///
/// # Errors
/// `InvalidInput` if the text is anything but one unit.
pub fn read_unit(text: &str) -> Result<(usize, Side)> {
    match read_units(text)?.as_deref() {
        Some([unit]) => Ok(*unit),
        _ => Err(Error::InvalidInput(format!(
            "unit: expected one such as 12, 45L or AU1, got {text:?}"
        ))),
    }
}

/// Splits a text into its leading letters and the rest.
fn split_word(text: &str) -> (&str, &str) {
    text.split_at(
        text.find(|c: char| !c.is_alphabetic())
            .unwrap_or(text.len()),
    )
}

fn side_of(word: &str) -> Option<Side> {
    match word {
        "left" | "l" => Some(Side::Left),
        "right" | "r" => Some(Side::Right),
        _ => None,
    }
}

/// The units of an expression in [`MENU`]; `None` for other text. A side before, within or after
/// the expression applies to all its units.
fn of_menu(text: &str) -> Result<Option<Vec<(usize, Side)>>> {
    let text = text.to_lowercase();
    let words = text
        .split(|c: char| !c.is_alphanumeric())
        .filter(|word| !word.is_empty());
    let all = words.clone().collect::<Vec<_>>().join(" ");
    if let Some((_, units)) = MENU.iter().find(|(known, _)| *known == all) {
        return read_units(units);
    }
    let (sides, names): (Vec<&str>, Vec<&str>) = words.partition(|word| side_of(word).is_some());
    let name = names.join(" ");
    let Some((_, units)) = MENU.iter().find(|(known, _)| *known == name) else {
        return Ok(None);
    };
    let side = sides
        .iter()
        .copied()
        .reduce(|a, b| if side_of(a) == side_of(b) { a } else { "" });
    read_units(&format!("{} {units}", side.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn units(text: &str) -> String {
        let units = Expression::parse(text).unwrap().units;
        let units: Vec<String> = units
            .iter()
            .map(|(unit, side)| side.written(ACTION_UNITS[*unit].name))
            .collect();
        units.join(",")
    }

    #[test]
    fn units_and_words_of_the_menu_are_understood() {
        for (text, expected) in [
            ("12,6L", "12,6L"),
            ("AU45 L", "45L"),
            ("au01 + AU02", "1,2"),
            ("12 6 right", "12,6R"),
            ("12, 12", "12"),
            ("right 9,10", "9R,10R"),
            ("right 26,9L", "26,9R"),
            ("Smile", "6,12"),
            ("left wink", "6L,45L"),
            ("wink RIGHT", "6R,45R"),
            ("surprised  blink", "1,2,45"),
            ("right jaw drop", "26"),
            ("left right smile", "6,12"),
            ("look left", "61"),
            ("Look  up", "63"),
            ("left lip press", "23L"),
            ("61 right", "61"),
            ("winks with the right eye", ""),
            ("12 lips", ""),
            ("left", ""),
            ("улыбка", ""),
        ] {
            assert_eq!(units(text), expected, "{text}");
        }
        for (name, expected) in MENU {
            assert_eq!(units(name), expected);
        }
    }

    #[test]
    fn strength_and_sign_stand_behind_in_any_order() {
        for (text, said, strength, over_speech) in [
            ("smile", "smile", 1.0, false),
            ("12,6L : .25", "12,6L", 0.25, false),
            ("jaw drop!:1.5", "jaw drop", 1.5, true),
            ("jaw drop:1.5 !", "jaw drop", 1.5, true),
            ("smile:broad", "smile:broad", 1.0, false),
        ] {
            let read = Expression::parse(text).unwrap();
            assert_eq!(
                (read.said.as_str(), read.strength, read.over_speech),
                (said, strength, over_speech)
            );
        }
    }

    #[test]
    fn what_is_no_unit_is_named() {
        let error = |text| Expression::parse(text).unwrap_err().to_string();
        assert!(
            error("12,99L").contains("expected some of 1, 2, 4")
                && error("12,99L").contains("got 99L")
        );
        assert!(error("smile:3").contains("expected 0 to 2, got 3"));
        for text in ["", " !", ":0.5"] {
            assert!(error(text).contains("says nothing"), "{text}");
        }
    }
}
