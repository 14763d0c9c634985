//! Splits texts into units of sound: letters and groups of letters, without a dictionary.
//!
//! Twin of `training/speech/letters.py`.

/// A letter with an unknown sound.
const ANY: &str = "*";
const VOWELS: &str = "aeiouy";
/// The names of units that are phones instead of letters begin with this.
const PHONE: char = '/';

/// Letters that are spelt with other letters from a to z.
const SPECIAL: [(char, &str); 11] = [
    ('ß', "ss"),
    ('ä', "e"),
    ('ö', "oe"),
    ('ø', "oe"),
    ('œ', "oe"),
    ('æ', "e"),
    ('ł', "w"),
    ('ı', "i"),
    ('ð', "th"),
    ('þ', "th"),
    ('đ', "d"),
];
/// Letters with marks, and the same letter without its mark.
const MARKED: [(&str, &str); 18] = [
    ("àáâãåāăąǎ", "a"),
    ("çćĉċč", "c"),
    ("ď", "d"),
    ("èéêëēĕėęěẽ", "e"),
    ("ĝğġģ", "g"),
    ("ĥ", "h"),
    ("ìíîïĩīĭįǐ", "i"),
    ("ĵ", "j"),
    ("ķ", "k"),
    ("ĺļľ", "l"),
    ("ñńņňǹ", "n"),
    ("òóôõōŏőǒ", "o"),
    ("ŕŗř", "r"),
    ("śŝşšș", "s"),
    ("ţťț", "t"),
    ("ùúûüũūŭůűųǔ", "u"),
    ("ýÿŷ", "y"),
    ("źżž", "z"),
];

/// Spells a word in small letters a to z, with `*` for each other letter or digit. Everything else
/// is removed.
pub(super) fn romanised(word: &str) -> String {
    let mut out = String::new();
    for sign in word.chars().flat_map(char::to_lowercase) {
        let special = SPECIAL.iter().find(|(c, _)| *c == sign).map(|(_, s)| *s);
        let marked = || MARKED.iter().find(|(all, _)| all.contains(sign));
        match special.or_else(|| marked().map(|(_, plain)| *plain)) {
            Some(plain) => out += plain,
            None if sign.is_ascii_lowercase() => out.push(sign),
            None if sign.is_alphanumeric() => out += ANY,
            None => {}
        }
    }
    out
}

/// The units of a word.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Word {
    /// Indices into the units of the model.
    pub(super) units: Vec<usize>,
    /// Whether the word is a single consonant. Such a word is read by its name, which has a vowel
    /// before or after the consonant. It has three units; the first and the last stand for any
    /// sound.
    pub(super) is_name: bool,
}

impl Word {
    /// The units of a written word.
    pub(super) fn read(word: &str, units: &[String]) -> Word {
        let numbers = units_of(word, units);
        let any = units.iter().position(|unit| unit == ANY);
        if let (&[only], Some(any)) = (&numbers[..], any) {
            let is_consonant =
                |sign: &str| sign.len() == 1 && sign != ANY && !VOWELS.contains(sign);
            if is_consonant(&units[only]) {
                return Word {
                    units: vec![any, only, any],
                    is_name: true,
                };
            }
        }
        Word {
            units: numbers,
            is_name: false,
        }
    }

    /// A word of the dictionary, by its phones. `None` if the model has no unit for one of them.
    pub(super) fn sound(phones: &[&str], units: &[String]) -> Option<Word> {
        let of = |phone: &&str| {
            units
                .iter()
                .position(|unit| unit.strip_prefix(PHONE) == Some(phone))
        };
        let units = phones.iter().map(of).collect::<Option<Vec<usize>>>()?;
        Some(Word {
            units,
            is_name: false,
        })
    }

    #[cfg(test)]
    pub(super) fn of(units: &[usize]) -> Word {
        Word {
            units: units.to_vec(),
            is_name: false,
        }
    }
}

/// Splits a word into units and returns their indices in `units`. At each letter the longest unit
/// that fits is taken. A doubled consonant counts once.
fn units_of(word: &str, units: &[String]) -> Vec<usize> {
    let letters = romanised(word);
    let (mut out, mut rest): (Vec<usize>, &str) = (Vec::new(), &letters);
    while !rest.is_empty() {
        let fits = |index: &usize| rest.starts_with(units[*index].as_str());
        let longest = (0..units.len())
            .filter(fits)
            .max_by_key(|i| units[*i].len());
        let Some(unit) = longest else {
            // A letter that the model does not know is skipped.
            rest = &rest[1..];
            continue;
        };
        let sign = &units[unit];
        rest = &rest[sign.len()..];
        let may_double = sign == ANY || sign.starts_with(|c| VOWELS.contains(c));
        if may_double || out.last() != Some(&unit) {
            out.push(unit);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn units() -> Vec<String> {
        let letters = ('a'..='z').map(String::from);
        letters
            .chain(["sch", "sh", "ch", "*"].map(String::from))
            .collect()
    }

    fn signs(word: &str) -> Vec<String> {
        let known = units();
        let numbers = units_of(word, &known);
        numbers.into_iter().map(|i| known[i].clone()).collect()
    }

    #[test]
    fn marks_go_and_unknown_letters_are_any() {
        assert_eq!(romanised("Größe,"), "groesse");
        assert_eq!(romanised("l'été"), "lete");
        assert_eq!(romanised("Жя 7"), "***");
        assert_eq!(romanised("–…"), "");
    }

    #[test]
    fn a_consonant_alone_is_called_by_its_name() {
        let known = units();
        let any = known.len() - 1;
        let word = Word::read("F.", &known);
        assert_eq!((word.units, word.is_name), (vec![any, 5, any], true));
        assert!(!Word::read("a", &known).is_name);
        assert!(!Word::read("7", &known).is_name);
    }

    #[test]
    fn groups_are_one_unit_and_doubled_consonants_too() {
        assert_eq!(signs("schuss"), ["sch", "u", "s"]);
        assert_eq!(signs("aal"), ["a", "a", "l"]);
        assert_eq!(signs("42"), ["*", "*"]);
    }
}
