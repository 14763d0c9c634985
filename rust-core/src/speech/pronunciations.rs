//! How English words sound, by the CMU Pronouncing Dictionary.
//!
//! Twin of `training/speech/pronunciations.py`, which writes the table.

use std::{
    collections::{HashMap, HashSet},
    path::Path,
};

use crate::{
    Error, Result,
    models::{BuiltIn, Weights},
};

/// Built-in table of [`Pronunciations`].
pub static PRONUNCIATIONS: BuiltIn = BuiltIn::new(&anyface_weights_shared::PRONUNCIATIONS);

/// The signs of letters, from [`FIRST_LETTER`] on. Codes below that number count shared letters.
const LETTERS: &[u8] = b"abcdefghijklmnopqrstuvwxyz'";
const FIRST_LETTER: u8 = 32;
/// The code of the first class of phones.
const FIRST_PHONE: u8 = 64;

/// Sizes of the table, as `config.json` states them.
#[derive(Debug, Clone, serde::Deserialize)]
struct Config {
    /// Number of codes.
    codes: usize,
    /// The IPA sign of each class of phones.
    phones: Vec<String>,
}

/// A dictionary of words and their phones.
pub struct Pronunciations {
    codes: Vec<u8>,
    phones: Vec<String>,
}

impl Pronunciations {
    /// The built-in dictionary, or that of the folder in `folder`.
    ///
    /// # Errors
    /// Those of [`BuiltIn::open`]; `Weights` for a table that is damaged.
    pub fn open(folder: Option<&Path>) -> Result<Pronunciations> {
        let files = PRONUNCIATIONS.open(folder)?;
        let bad = |e: &dyn std::fmt::Display| Error::Weights(format!("pronunciations: {e}"));
        let config: Config = serde_json::from_str(&files.config).map_err(|e| bad(&e))?;
        let values = Weights::from_bytes(&files.weights)?.values("codes", &[config.codes])?;
        let codes: Vec<u8> = values.iter().map(|code| *code as u8).collect();
        let letters = FIRST_LETTER..FIRST_LETTER + LETTERS.len() as u8;
        let is_known = |code: &u8| {
            *code < FIRST_LETTER
                || letters.contains(code)
                || (*code as usize).wrapping_sub(FIRST_PHONE.into()) < config.phones.len()
        };
        match codes.iter().find(|code| !is_known(code)) {
            None => Ok(Pronunciations {
                codes,
                phones: config.phones,
            }),
            Some(code) => Err(bad(&format!(
                "expected a count, a letter or a phone, got the code {code}"
            ))),
        }
    }

    /// The phones of those of `words` that the dictionary has: small letters a to z and apostrophes.
    pub fn phones_of<'a>(&self, words: &HashSet<&'a str>) -> HashMap<&'a str, Vec<&str>> {
        let mut found = HashMap::new();
        let mut word: Vec<u8> = Vec::new();
        for entry in self.codes.chunk_by(|_, next| *next >= FIRST_LETTER) {
            let (&shared, spelling) = entry.split_first().expect("no chunk is empty");
            let letters = spelling.iter().take_while(|code| **code < FIRST_PHONE);
            word.truncate(shared.into());
            word.extend(letters.map(|code| LETTERS[usize::from(code - FIRST_LETTER)]));
            let spelled = std::str::from_utf8(&word).expect("letters are ASCII");
            if let Some(&word) = words.get(spelled) {
                let phones = spelling.iter().filter(|code| **code >= FIRST_PHONE);
                let sign = |code: &u8| self.phones[usize::from(code - FIRST_PHONE)].as_str();
                found.insert(word, phones.map(sign).collect());
            }
        }
        found
    }
}

/// The parts of a written word as the dictionary spells them: small letters a to z and apostrophes.
/// `None` for a word with other letters or digits.
pub(super) fn spelled(word: &str) -> Option<Vec<String>> {
    let plain = word.to_lowercase().replace('’', "'");
    let parts = plain.split(|sign: char| !sign.is_alphanumeric() && sign != '\'');
    let parts = parts.map(|part| part.trim_matches('\'').to_owned());
    let parts: Vec<String> = parts.filter(|part| !part.is_empty()).collect();
    let is_plain = |part: &String| part.bytes().all(|sign| LETTERS.contains(&sign));
    (!parts.is_empty() && parts.iter().all(is_plain)).then_some(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_sound_as_in_the_dictionary() {
        let dictionary = Pronunciations::open(None).unwrap();
        let words = ["what", "could", "knew", "abbreviate", "zyuganov's", "xyzzy"];
        let found = dictionary.phones_of(&words.into_iter().collect());
        let sounds = |word: &str| found.get(word).map(|phones| phones.concat());
        assert_eq!(sounds("what").unwrap(), "wʌt");
        assert_eq!(sounds("could").unwrap(), "kʊd");
        assert_eq!(sounds("knew").unwrap(), "nu");
        assert_eq!(sounds("abbreviate").unwrap(), "əbɹivieɪt");
        assert_eq!(sounds("zyuganov's").unwrap(), "zjuɡɑnɑvz");
        assert_eq!(sounds("xyzzy"), None);
    }

    #[test]
    fn words_are_spelled_as_in_the_dictionary() {
        let parts = |word: &str| spelled(word).map(|parts| parts.join(" "));
        assert_eq!(parts("“Don’t!”").unwrap(), "don't");
        assert_eq!(parts("well-known,").unwrap(), "well known");
        assert_eq!(parts("'cause").unwrap(), "cause");
        for word in ["Größe", "7", "–", ""] {
            assert_eq!(parts(word), None, "{word}");
        }
    }
}
