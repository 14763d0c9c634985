//! Splits a sentence into clauses, and each clause into meaningful and denied words, a side and an
//! amount.
//!
//! Does the same as `training/text/sentences.py`, whose lists are in the model's `config.json`.

use std::collections::{BTreeMap, HashMap, HashSet};

use serde::Deserialize;

/// The lists in `config.json`. Each holds words with spaces between them.
#[derive(Deserialize)]
pub(super) struct Lists {
    breaks: String,
    denials: String,
    left: String,
    right: String,
    one_sided: String,
    unheard: String,
    parts: String,
    /// The words of each factor of strength. The key is the factor as text.
    amounts: BTreeMap<String, String>,
}

/// The role of a word beside its own meaning.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Role {
    Break,
    Denial,
    Side(SaidSide),
    Amount(f32),
    Unheard,
}

/// A side as a text names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SaidSide {
    Left,
    Right,
    /// "One", without saying which.
    One,
}

/// The roles of words.
#[derive(Debug, Clone)]
pub(super) struct Rules {
    roles: HashMap<String, Role>,
    /// Parts of a face. "No raised eyebrows" denies a movement and does not ask for another one.
    parts: HashSet<String>,
}

/// A part of a sentence.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Clause {
    /// The clause without sides and amounts, with a space between its words.
    pub said: String,
    pub words: Vec<String>,
    /// Words after a denial. Empty if one of them is a part of a face.
    pub denied: Vec<String>,
    pub side: Option<SaidSide>,
    /// Factor of strength.
    pub amount: f32,
}

impl Rules {
    /// Returns `Err` for an amount that is not a number, and names it.
    pub(super) fn new(lists: &Lists) -> Result<Self, String> {
        let mut roles = HashMap::new();
        for (words, role) in [
            (&lists.unheard, Role::Unheard),
            (&lists.breaks, Role::Break),
            (&lists.denials, Role::Denial),
        ] {
            roles.extend(words.split_whitespace().map(|word| (word.to_owned(), role)));
        }
        for (factor, words) in &lists.amounts {
            let wrong = |_| format!("amounts: expected a factor, got {factor:?}");
            let role = Role::Amount(factor.parse().map_err(wrong)?);
            roles.extend(words.split_whitespace().map(|word| (word.to_owned(), role)));
        }
        for (words, side) in [
            (&lists.left, SaidSide::Left),
            (&lists.right, SaidSide::Right),
            (&lists.one_sided, SaidSide::One),
        ] {
            let role = Role::Side(side);
            roles.extend(words.split_whitespace().map(|word| (word.to_owned(), role)));
        }
        let parts = lists.parts.split_whitespace().map(str::to_owned).collect();
        Ok(Rules { roles, parts })
    }

    /// Splits a text into clauses. There is at least one, which may be empty.
    pub(super) fn clauses(&self, text: &str) -> Vec<Clause> {
        let mut parsed = vec![Clause::new()];
        let mut denies = false;
        for token in tokens(text) {
            let role = if token.starts_with(is_letter) {
                self.roles.get(&token).copied()
            } else {
                Some(Role::Break)
            };
            match role {
                Some(Role::Break) => {
                    parsed.push(Clause::new());
                    denies = false;
                }
                Some(Role::Denial) => {
                    denies = true;
                    parsed.last_mut().expect("one at least").say(&token);
                }
                _ => hear(
                    parsed.last_mut().expect("one at least"),
                    token,
                    role,
                    denies,
                ),
            }
        }
        for clause in &mut parsed {
            if clause.denied.iter().any(|word| self.parts.contains(word)) {
                clause.denied.clear();
            }
        }
        parsed
    }
}

impl Clause {
    fn new() -> Self {
        Clause {
            said: String::new(),
            words: Vec::new(),
            denied: Vec::new(),
            side: None,
            amount: 1.0,
        }
    }

    fn say(&mut self, token: &str) {
        if !self.said.is_empty() {
            self.said.push(' ');
        }
        self.said.push_str(token);
    }

    /// Meaningful words, then denied ones.
    pub fn all_words(&self) -> impl Iterator<Item = &String> {
        self.words.iter().chain(&self.denied)
    }
}

fn hear(clause: &mut Clause, token: String, role: Option<Role>, denies: bool) {
    if !matches!(role, Some(Role::Side(_) | Role::Amount(_))) {
        clause.say(&token);
    }
    match (role, denies) {
        (Some(Role::Side(side)), _) => clause.side = Some(side),
        (Some(Role::Amount(factor)), false) => clause.amount *= factor,
        (Some(_), _) => (),
        (None, false) => clause.words.push(token),
        (None, true) => clause.denied.push(token),
    }
}

/// Splits a text into words in small letters and punctuation that ends clauses. `n't` becomes
/// `not`.
fn tokens(text: &str) -> Vec<String> {
    let plain = text.to_lowercase().replace('\u{2019}', "'");
    let plain = plain.replace("n't", " not").replace('\'', " ");
    let mut pieces = Vec::new();
    let mut word = String::new();
    for letter in plain.chars().chain([' ']) {
        if is_letter(letter) {
            word.push(letter);
            continue;
        }
        if !word.is_empty() {
            pieces.push(std::mem::take(&mut word));
        }
        if ",;.:!?".contains(letter) {
            pieces.push(letter.to_string());
        }
    }
    pieces
}

/// Accepts a to z, and everything from À (U+00C0) on except general and ideographic punctuation.
fn is_letter(c: char) -> bool {
    let mark = ('\u{2000}'..='\u{206f}').contains(&c) || ('\u{3000}'..='\u{303f}').contains(&c);
    c.is_ascii_lowercase() || (c >= '\u{c0}' && !mark)
}
