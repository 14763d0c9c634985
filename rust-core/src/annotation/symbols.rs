//! The kinds of labels, and which of them close the lips.

/// The kind of a tier's labels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Symbols {
    /// Phones: IPA, ARPABET with or without stress, or [`super::CLOSED`].
    Phones,
    /// Only the phones that close the lips. Where an annotation has such a tier, it alone says when
    /// the lips close.
    Closures,
    /// Words.
    Words,
    /// Rhubarb's mouth shapes A to H and X, after Hanna-Barbera.
    Rhubarb,
    /// Papagayo's ten mouths, after Preston Blair (Cartoon Animation, 1994): AI, E, O, U, L, WQ,
    /// MBP, FV, etc, rest.
    Papagayo,
}

/// Phones, their mouth in Papagayo and their mouth in Rhubarb.
const MOUTHS: [(&[&str], &str, &str); 9] = [
    (&["p", "b", "m", "em", "mbp"], "MBP", "A"),
    (&["f", "v", "fv"], "FV", "G"),
    (&["l", "el", "ɫ"], "L", "H"),
    (&["w", "wq", "ʍ"], "WQ", "F"),
    (&["uw", "uh", "u", "uː", "ʊ", "y", "ø"], "U", "F"),
    (&["ow", "ao", "aw", "oy", "o", "oː", "ɔ", "ɒ"], "O", "E"),
    (
        &["aa", "ae", "ah", "ay", "ai", "a", "ɑ", "æ", "ʌ", "ɐ"],
        "AI",
        "D",
    ),
    (
        &["eh", "ey", "iy", "ih", "er", "e", "i", "ɛ", "ɪ", "ə", "ɝ"],
        "E",
        "C",
    ),
    (&["rest", "sil", "sp", "spn", "<eps>", "_"], "rest", "X"),
];
/// Consonants that barely move lips and jaw. Together with [`MOUTHS`], all of CMU's ARPABET.
const OTHERS: [&str; 29] = [
    "ch", "d", "dh", "dx", "en", "g", "hh", "jh", "k", "n", "ng", "r", "s", "sh", "t", "th", "z",
    "zh", "etc", "θ", "ð", "ʃ", "ʒ", "ɹ", "ʁ", "j", "ɡ", "ŋ", "x",
];
/// Phones that are also words in many languages.
const VOWELS: [&str; 6] = ["a", "e", "i", "o", "u", "y"];

/// ARPABET's phones whose IPA is not what their small letters say.
const ARPABET: [(&str, &str); 31] = [
    ("aa", "ɑ"),
    ("ae", "æ"),
    ("ah", "ʌ"),
    ("ao", "ɔ"),
    ("aw", "aʊ"),
    ("ay", "aɪ"),
    ("ch", "tʃ"),
    ("dh", "ð"),
    ("dx", "d"),
    ("eh", "ɛ"),
    ("el", "əl"),
    ("em", "əm"),
    ("en", "ən"),
    ("er", "ɝ"),
    ("ey", "eɪ"),
    ("g", "ɡ"),
    ("hh", "h"),
    ("ih", "ɪ"),
    ("iy", "i"),
    ("jh", "dʒ"),
    ("ng", "ŋ"),
    ("ow", "oʊ"),
    ("oy", "ɔɪ"),
    ("r", "ɹ"),
    ("sh", "ʃ"),
    ("th", "θ"),
    ("uh", "ʊ"),
    ("uw", "u"),
    ("y", "j"),
    ("zh", "ʒ"),
    ("axr", "ɝ"),
];
/// The sign of each phone that the recogniser knows, and the signs of IPA that it stands for.
///
/// Twin of `CLASSES` in `training/speech/phones.py`.
const CLASSES: [(&str, &str); 41] = [
    ("i", "iɨ"),
    ("ɪ", "ɪᵻ"),
    ("y", "yʏʉɥ"),
    ("u", "uɯ"),
    ("ʊ", "ʊ"),
    ("e", "eɘ"),
    ("ɛ", "ɛ"),
    ("ø", "øœɵɞ"),
    ("ə", "əɤ"),
    ("ɝ", "ɜɚɝ"),
    ("o", "o"),
    ("ɔ", "ɔɒ"),
    ("ʌ", "ʌɐ"),
    ("a", "a"),
    ("ɑ", "ɑ"),
    ("æ", "æ"),
    ("p", "p"),
    ("b", "bʙ"),
    ("m", "mɱ"),
    ("f", "fɸ"),
    ("v", "vβʋ"),
    ("w", "wʍ"),
    ("t", "tʈcʔ"),
    ("d", "dɖɟ"),
    ("n", "nɳɲ"),
    ("θ", "θ"),
    ("ð", "ð"),
    ("s", "sɬ"),
    ("z", "z"),
    ("ʃ", "ʃʂɕ"),
    ("ʒ", "ʒʐʑ"),
    ("l", "lɫɭʎ"),
    ("r", "rɾɽ"),
    ("ɹ", "ɹɻ"),
    ("j", "jʝ"),
    ("k", "kq"),
    ("ɡ", "ɡɢg"),
    ("ŋ", "ŋ"),
    ("x", "xχçħ"),
    ("ʁ", "ʁʀɣʕ"),
    ("h", "hɦ"),
];
/// Two sounds that one sign stands for.
const LIGATURES: [(char, &str); 4] = [('ʦ', "ts"), ('ʣ', "dz"), ('ʧ', "tʃ"), ('ʤ', "dʒ")];
const PAUSES: [&str; 9] = ["", "_", "sil", "sp", "spn", "pau", "<sil>", "<eps>", "h#"];

/// The plain sounds of a phone, by the recogniser's signs: `ˈaɪ` and `AY1` are `a`, `ɪ`. A pause is
/// `_`; of a label that is no phone nothing remains.
pub fn ipa(label: &str) -> Vec<&'static str> {
    let plain = plain(label);
    if PAUSES.contains(&plain.as_str()) {
        return vec!["_"];
    }
    let is_ascii = label
        .trim()
        .chars()
        .next()
        .is_some_and(|c| c.is_ascii_uppercase());
    let spelt = ARPABET.iter().find(|(name, _)| *name == plain);
    // `r` and `y` in small letters are IPA.
    let spelt = spelt
        .filter(|_| is_ascii || plain.len() > 1)
        .map(|(_, signs)| *signs);
    let signs = spelt.unwrap_or(&plain).chars();
    let signs = signs.flat_map(|sign| {
        let two = LIGATURES.iter().find(|(ligature, _)| *ligature == sign);
        two.map_or_else(|| sign.to_string(), |(_, two)| (*two).to_owned())
            .chars()
            .collect::<Vec<_>>()
    });
    let class = |sign: char| {
        CLASSES
            .iter()
            .find(|(_, signs)| signs.contains(sign))
            .map(|(name, _)| *name)
    };
    signs.filter_map(class).collect()
}

impl Symbols {
    /// The name of a tier with such labels.
    pub fn name(self) -> &'static str {
        match self {
            Symbols::Phones => "phones",
            Symbols::Closures => "closures",
            Symbols::Words => "words",
            Symbols::Rhubarb => "rhubarb",
            Symbols::Papagayo => "papagayo",
        }
    }

    /// Guesses from the name of a tier, such as `Anna - phones`, or else from its labels.
    pub(super) fn guess<'a>(name: &str, labels: impl Iterator<Item = &'a str>) -> Symbols {
        let name = name.to_lowercase();
        let says = [
            ("word", Symbols::Words),
            ("phon", Symbols::Phones),
            ("closure", Symbols::Closures),
            ("rhubarb", Symbols::Rhubarb),
            ("papagayo", Symbols::Papagayo),
        ];
        if let Some((_, symbols)) = says.into_iter().find(|(word, _)| name.contains(word)) {
            return symbols;
        }
        let labels: Vec<String> = labels.map(plain).collect();
        let is_vowel = |label: &String| VOWELS.contains(&label.as_str());
        let is_any = |label: &String| is_vowel(label) || is_phone(label);
        if labels.iter().all(is_any) && (labels.is_empty() || !labels.iter().all(is_vowel)) {
            Symbols::Phones
        } else {
            Symbols::Words
        }
    }

    /// Whether the lips close for a label.
    pub fn closes_lips(self, label: &str) -> bool {
        match self {
            Symbols::Words => false,
            Symbols::Rhubarb => label == "A",
            Symbols::Papagayo => label.eq_ignore_ascii_case("mbp"),
            Symbols::Phones | Symbols::Closures => is_bilabial(&plain(label)),
        }
    }

    /// Turns a label into the matching mouth shape of `to`.
    pub(crate) fn as_shape(self, label: &str, to: Symbols) -> String {
        if self == to || to == Symbols::Phones {
            return label.to_owned();
        }
        let phone = plain(label);
        let mouth = MOUTHS
            .iter()
            .find(|(phones, papagayo, rhubarb)| match self {
                Symbols::Rhubarb => *rhubarb == label,
                Symbols::Papagayo => papagayo.eq_ignore_ascii_case(label),
                _ => phones.contains(&phone.as_str()) || phones[0] == "p" && is_bilabial(&phone),
            });
        match (mouth, to) {
            (Some((_, _, rhubarb)), Symbols::Rhubarb) => (*rhubarb).to_owned(),
            (Some((_, papagayo, _)), _) => (*papagayo).to_owned(),
            (None, _) => to.between().to_owned(),
        }
    }

    /// The shape of a mouth that is neither closed nor wide; empty if labels are not mouth shapes.
    pub(super) fn between(self) -> &'static str {
        match self {
            Symbols::Rhubarb => "B",
            Symbols::Papagayo => "etc",
            Symbols::Phones | Symbols::Closures | Symbols::Words => "",
        }
    }
}

/// A phone in lower case, without ARPABET's stress.
fn plain(label: &str) -> String {
    let label = label.trim().to_lowercase();
    label.trim_end_matches(['0', '1', '2']).to_owned()
}

/// Whether a phone is p, b or m, or one of these with marks: `pʰ`, `mʲ`, `b̥`, `pf`, `p_h`.
fn is_bilabial(phone: &str) -> bool {
    if MOUTHS[0].0.contains(&phone) {
        return true;
    }
    let mut letters = phone.chars();
    let first = letters.next().is_some_and(|c| "pbmɓʙ".contains(c));
    let rest = letters.as_str();
    first && (rest == "f" || rest.starts_with('_') || rest.chars().all(|c| !c.is_ascii()))
}

/// Whether a plain label is a phone of ARPABET, Papagayo or the recogniser. Words seldom are.
fn is_phone(phone: &String) -> bool {
    let mut shown = MOUTHS.iter().flat_map(|(phones, ..)| phones.iter());
    shown.any(|known| known == phone) || OTHERS.contains(&phone.as_str()) || is_bilabial(phone)
}
