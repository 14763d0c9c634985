//! CLIP's tokenizer: byte pairs (Sennrich et al. 2016) over the bytes of words in small letters.
//!
//! We do not use the crate `tokenizers`: it brings models, trainers and a regular-expression
//! engine, while one table and one loop, a hundred lines, are enough here.

use std::{collections::HashMap, path::Path};

use crate::{
    Error, Result,
    job::{InputKind, read_text},
};

/// The end of a word's last symbol.
const END_OF_WORD: &str = "</w>";
const START: &str = "<|startoftext|>";
const END: &str = "<|endoftext|>";
/// English endings that start with an apostrophe. Each is separate from the word before it.
const SHORTENED: [&str; 7] = ["'s", "'t", "'re", "'ve", "'m", "'ll", "'d"];

/// The number of each symbol, and the rank of each pair. The pair with the lowest rank is joined
/// first.
#[derive(Debug, Clone)]
pub(super) struct BytePairs {
    numbers: HashMap<String, usize>,
    ranks: HashMap<(String, String), usize>,
    start: usize,
    end: usize,
}

impl BytePairs {
    /// Reads `vocab.json` and `merges.txt`. `size`: how many rows the network has for symbols.
    ///
    /// # Errors
    /// `Io` if a file cannot be read, `Weights` if one is damaged or gives a symbol a number of
    /// `size` or more.
    pub(super) fn load_folder(folder: &Path, size: usize) -> Result<Self> {
        let read = |name: &str| read_text(&folder.join(name), InputKind::Text);
        let bad = |file: &str, what: String| {
            Error::Weights(format!("{}: {what}", folder.join(file).display()))
        };
        let numbers: HashMap<String, usize> = serde_json::from_str(&read("vocab.json")?)
            .map_err(|e| bad("vocab.json", e.to_string()))?;
        if let Some((symbol, number)) = numbers.iter().find(|(_, number)| **number >= size) {
            let message = format!("expected numbers below {size}, got {number} for {symbol:?}");
            return Err(bad("vocab.json", message));
        }
        let of = |symbol: &str| {
            let missing = || bad("vocab.json", format!("expected the symbol {symbol}"));
            numbers.get(symbol).copied().ok_or_else(missing)
        };
        let (start, end) = (of(START)?, of(END)?);
        let mut ranks = HashMap::new();
        let merges = read("merges.txt")?;
        let lines = merges.lines().filter(|line| !line.starts_with("#version"));
        for line in lines.filter(|line| !line.trim().is_empty()) {
            let Some((left, right)) = line.trim().split_once(' ') else {
                let message = format!("expected two symbols in each line, got {line:?}");
                return Err(bad("merges.txt", message));
            };
            let rank = ranks.len();
            ranks.insert((left.to_owned(), right.to_owned()), rank);
        }
        Ok(BytePairs {
            numbers,
            ranks,
            start,
            end,
        })
    }

    /// The number of the start, the numbers of a text's symbols, and the number of the end: `most`
    /// numbers at most. The rest of the text is not read.
    pub(super) fn of(&self, text: &str, most: usize) -> Vec<usize> {
        let small = text.to_lowercase();
        let symbols = words(&small).flat_map(|word| self.joined(word));
        let numbers = symbols.map(|symbol| self.numbers.get(&symbol).copied().unwrap_or(self.end));
        let inner = numbers.take(most.saturating_sub(2));
        [self.start]
            .into_iter()
            .chain(inner)
            .chain([self.end])
            .collect()
    }

    /// The symbols of a word. Starts with its bytes and joins neighbouring pairs, in the order in
    /// which the pairs were learned.
    fn joined(&self, word: &str) -> Vec<String> {
        let mut symbols: Vec<String> = word.bytes().map(|byte| letter(byte).into()).collect();
        symbols
            .last_mut()
            .expect("a word has a byte")
            .push_str(END_OF_WORD);
        let rank = |pair: &[String]| self.ranks.get(&(pair[0].clone(), pair[1].clone()));
        while let Some(first) = symbols.windows(2).filter_map(rank).min().copied() {
            let mut joined: Vec<String> = Vec::new();
            let mut rest = &symbols[..];
            while let Some((symbol, after)) = rest.split_first() {
                if rest.len() > 1 && rank(&rest[..2]) == Some(&first) {
                    joined.push(format!("{symbol}{}", after[0]));
                    rest = &after[1..];
                } else {
                    joined.push(symbol.clone());
                    rest = after;
                }
            }
            symbols = joined;
        }
        symbols
    }
}

/// Splits a text into runs of letters, single digits, runs of other signs, and [`SHORTENED`].
fn words(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = text;
    std::iter::from_fn(move || {
        rest = rest.trim_start();
        let first = rest.chars().next()?;
        let short = SHORTENED.iter().find(|short| rest.starts_with(**short));
        let length = match short {
            Some(short) => short.len(),
            None if first.is_numeric() => first.len_utf8(),
            None => {
                let others = |c: char| {
                    c.is_whitespace()
                        || c.is_numeric()
                        || c.is_alphabetic() != first.is_alphabetic()
                };
                rest.find(others).unwrap_or(rest.len())
            }
        };
        let (word, after) = rest.split_at(length);
        rest = after;
        Some(word)
    })
}

/// The letter that stands for a byte: the byte's own if it is visible in Latin-1, else one beyond
/// Latin-1.
fn letter(byte: u8) -> char {
    let is_visible = |byte: u8| matches!(byte, b'!'..=b'~' | 0xa1..=0xac | 0xae..=0xff);
    if is_visible(byte) {
        char::from(byte)
    } else {
        let before = (0..byte).filter(|byte| !is_visible(*byte)).count();
        char::from_u32(256 + before as u32).expect("a letter of Latin Extended-A")
    }
}
