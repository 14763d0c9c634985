//! One phone of speech, and what a mouth has to do for it.

/// Names that aligners give to silence.
const SILENCES: [&str; 8] = ["", "sil", "sp", "spn", "pau", "<eps>", "_", "h#"];

/// One phone; times in seconds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Phone {
    pub from_s: f64,
    pub to_s: f64,
    pub name: String,
}

impl Phone {
    pub(super) fn is_silence(&self) -> bool {
        SILENCES.contains(&self.name.to_lowercase().as_str())
    }

    /// Whether it is f, v or a similar sound, in IPA or ARPABET.
    pub(super) fn is_labiodental(&self) -> bool {
        let letters = self.name.trim_start_matches(['ˈ', 'ˌ']);
        letters.starts_with(['f', 'v', 'ʋ', 'ɱ', 'F', 'V'])
    }

    /// `a`, `i` or `u` without marks of stress and length; ɑ counts as `a`. `None` for diphthongs
    /// and everything else.
    pub(super) fn plain_vowel(&self) -> Option<char> {
        let letters = self.name.trim_start_matches(['ˈ', 'ˌ']);
        let mut letters = letters.trim_end_matches(['ː', 'ˑ']).chars();
        match (letters.next(), letters.next()) {
            (Some('ɑ'), None) => Some('a'),
            (Some(letter @ ('a' | 'i' | 'u')), None) => Some(letter),
            _ => None,
        }
    }

    /// Whether it is p, b, m or ɓ, in IPA or ARPABET. Stress marks before the letter and anything
    /// after it are ignored.
    pub(super) fn closes_the_lips(&self) -> bool {
        let letters = self.name.trim_start_matches(['ˈ', 'ˌ']);
        !self.is_silence() && letters.starts_with(['p', 'b', 'm', 'P', 'B', 'M', 'ɓ'])
    }
}
