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
        match labels.iter().all(is_any) && (labels.is_empty() || !labels.iter().all(is_vowel)) {
            true => Symbols::Phones,
            false => Symbols::Words,
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
