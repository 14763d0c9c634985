//! Places of words. A known word has its own, an inflected one that of its stem, and any other word
//! gets one from its letters.
//!
//! Does the same as `training/text/words.py`.

use std::collections::HashMap;

use ndarray::{Array1, Array2};

use crate::{Result, models::Weights};

/// Lengths of the n-grams.
const NGRAMS: [usize; 3] = [3, 4, 5];
/// English endings and the letters that replace them in the stem, in the order in which they are
/// tried.
const ENDINGS: [(&str, &str); 11] = [
    ("ies", "y"),
    ("es", ""),
    ("s", ""),
    ("ing", ""),
    ("ing", "e"),
    ("ed", ""),
    ("ed", "e"),
    ("ly", ""),
    ("ily", "y"),
    ("er", ""),
    ("est", ""),
];
/// The least number of letters before an ending.
const LEAST_STEM: usize = 3;

/// Words of a text space and their places, `D` numbers each.
#[derive(Debug, Clone)]
pub(super) struct Space {
    rows: HashMap<String, usize>,
    /// `[W, D]`.
    vectors: Array2<f32>,
    /// `[G, D]`. All n-grams whose hash has the same remainder modulo `G` share a row.
    ngrams: Array2<f32>,
}

impl Space {
    /// Reads `vectors` and `ngrams`. `words`: in the order of the rows.
    ///
    /// # Errors
    /// `Weights` if an array is missing or has another shape.
    pub(super) fn load(
        weights: &Weights,
        words: &str,
        buckets: usize,
        width: usize,
    ) -> Result<Self> {
        let named = words.split_whitespace().enumerate();
        let rows: HashMap<String, usize> =
            named.map(|(row, word)| (word.to_owned(), row)).collect();
        Ok(Space {
            vectors: weights.matrix("vectors", rows.len(), width)?,
            ngrams: weights.matrix("ngrams", buckets, width)?,
            rows,
        })
    }

    /// `D`.
    pub(super) fn width(&self) -> usize {
        self.vectors.ncols()
    }

    /// Place `[D]` of a word in small letters, at least one: the word's own, that of its stem, or
    /// the mean of its n-grams.
    pub(super) fn of(&self, word: &str) -> Array1<f32> {
        match self.known_form(word) {
            Some(row) => self.vectors.row(row).to_owned(),
            None => self.spelt(word),
        }
    }

    /// Whether the space has the word or its stem, so that its place does not come from its
    /// letters.
    pub(super) fn knows(&self, word: &str) -> bool {
        self.known_form(word).is_some()
    }

    /// The row of the word, or of its stem without an English ending.
    fn known_form(&self, word: &str) -> Option<usize> {
        if let Some(row) = self.rows.get(word) {
            return Some(*row);
        }
        ENDINGS.iter().find_map(|(ending, instead)| {
            let start = word.strip_suffix(ending)?;
            if start.chars().count() < LEAST_STEM {
                return None;
            }
            let stem = format!("{start}{instead}");
            let row = self.rows.get(&stem).or_else(|| {
                let single = undoubled(start).filter(|_| instead.is_empty())?;
                self.rows.get(single)
            });
            row.copied()
        })
    }

    fn spelt(&self, word: &str) -> Array1<f32> {
        let marked: Vec<char> = format!("<{word}>").chars().collect();
        let mut sum = Array1::zeros(self.width());
        let mut count = 0.0;
        for gram in NGRAMS.iter().flat_map(|n| marked.windows(*n)) {
            let text: String = gram.iter().collect();
            sum += &self
                .ngrams
                .row(crc32(text.as_bytes()) as usize % self.ngrams.nrows());
            count += 1.0;
        }
        sum / f32::max(count, 1.0)
    }
}

/// Takes the last letter from a stem such as `hopp`, if it is doubled and the stem has more than
/// three.
fn undoubled(stem: &str) -> Option<&str> {
    let mut last = stem.char_indices().rev();
    let ((at, a), (_, b)) = (last.next()?, last.next()?);
    (a == b && stem.chars().count() > LEAST_STEM).then_some(&stem[..at])
}

/// CRC-32 as in zlib.
fn crc32(bytes: &[u8]) -> u32 {
    const REVERSED_POLYNOMIAL: u32 = 0xedb8_8320;
    let bit = |crc: u32, _| (crc >> 1) ^ (REVERSED_POLYNOMIAL & (crc & 1).wrapping_neg());
    let add = |crc: u32, byte: &u8| (0..8).fold(crc ^ u32::from(*byte), bit);
    !bytes.iter().fold(u32::MAX, add)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_zlib() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        assert_eq!(crc32(b""), 0);
    }

    #[test]
    fn doubled_letters_are_taken_back() {
        assert_eq!(undoubled("hopp"), Some("hop"));
        assert_eq!(undoubled("fly"), None);
        assert_eq!(undoubled("add"), None);
    }
}
