//! Understands words about faces: their places in a text space, and the action units in a text.
//!
//! The space comes from WordNet (`training/text/space.py`). Synonyms lie together in it, opposites
//! apart. The tower is that of Cafe-Talk (Chen et al. 2025, §3.3 and appendix E). It reads places
//! in this space or the output of CLIP from a user's folder.
//!
//! ```
//! use anyface::{conditions::Side, text::TextUnits};
//!
//! let words = TextUnits::open(None)?;
//! let wink = words.understand("winks with the right eye")?;
//! let (unit, side, ..) = wink.units[0];
//! assert_eq!((anyface::conditions::ACTION_UNITS[unit].name, side), ("45", Side::Right));
//! # Ok::<(), anyface::Error>(())
//! ```

mod byte_pairs;
mod clip;
mod emotion;
mod event;
mod lexicon;
mod sentence;
mod space;
#[cfg(test)]
mod tests;
mod tower;

use std::path::{Path, PathBuf};

use ndarray::{Array1, Array2};
use serde::Deserialize;

use crate::{
    Error, Result,
    conditions::{ACTION_UNITS, EMOTIONS, LEARNED_UNITS, Side},
    models::{BuiltIn, Weights},
    nn::elementwise::sigmoid,
};
use clip::ClipText;
use sentence::{Clause, Lists, Rules, SaidSide};
use space::Space;
use tower::Tower;

pub use event::{Reader, events_to_json};

/// The built-in text space and tower.
#[cfg(feature = "cafe-talk")]
pub static MODEL: BuiltIn = BuiltIn::new(&anyface_weights_cafe_talk::TEXT_UNITS);
/// The text space and tower, which only a models folder may hold in this build.
#[cfg(not(feature = "cafe-talk"))]
pub static MODEL: BuiltIn = BuiltIn::absent("text_units", None);
/// The most letters of a text. One line describes a face, and each clause costs a run of the tower.
const LONGEST_TEXT: usize = 1_000;
/// A unit shows if its confidence is above this.
const THRESHOLD: f32 = 0.5;
/// An expression may serve as a hint if its cosine to every word of the text is at least this.
const HINTED_FROM: f32 = 0.25;

/// Reads texts as action units.
#[derive(Debug, Clone)]
pub struct TextUnits {
    space: Space,
    rules: Rules,
    tower: Tower,
    /// `[15, D]`.
    emotions: Array2<f32>,
    menu: Vec<String>,
    /// The strength of a unit for the tower's largest output.
    full: f32,
    strength: [f32; 2],
}

/// The units in a text.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Understood {
    /// Number in [`ACTION_UNITS`], side, strength (1 is the model's own) and confidence (0.5 to 1),
    /// in ascending order of the number, each unit once.
    pub units: Vec<(usize, Side, f32, f32)>,
    /// The nearest known expression, if the text has no unit and an expression is near enough.
    pub hint: Option<String>,
}

#[derive(Deserialize)]
struct Config {
    width: usize,
    hidden: usize,
    ngrams: usize,
    units: Vec<String>,
    no_word: f32,
    full: f32,
    strength: [f32; 2],
    rules: Lists,
    /// Path of CLIP's folder, relative to the model's folder, if the tower was trained on CLIP.
    #[serde(default)]
    clip: Option<PathBuf>,
    menu: Vec<String>,
    words: String,
}

impl TextUnits {
    /// Loads the built-in model, or that of the folder `text_units` in `folder`.
    ///
    /// # Errors
    /// Those of [`BuiltIn::open`] and [`TextUnits::load`].
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let (files, place) = (MODEL.open(folder)?, MODEL.place(folder)?);
        let weights = Weights::from_bytes(&files.weights)?;
        TextUnits::load(&weights, &files.config, &place.unwrap_or_default())
    }

    /// Loads the model from its arrays and the text of `config.json`. `place`: the model's folder,
    /// to which the path in the config is relative.
    ///
    /// # Errors
    /// `Weights` if either is damaged or they do not fit each other. `Io` and `Weights` for CLIP's
    /// folder if the config names one.
    pub fn load(weights: &Weights, config: &str, place: &Path) -> Result<Self> {
        let bad = |what: String| Error::Weights(format!("{}/config.json: {what}", MODEL.name));
        let config: Config = serde_json::from_str(config).map_err(|e| bad(e.to_string()))?;
        let learned = ACTION_UNITS[..LEARNED_UNITS].iter();
        let expected: Vec<&str> = learned.map(|unit| unit.name).collect();
        if config.units != expected {
            return Err(bad(format!(
                "units: expected {expected:?}, got {:?}",
                config.units
            )));
        }
        let (width, buckets) = (config.width, config.ngrams);
        Ok(TextUnits {
            space: Space::load(weights, &config.words, buckets, width)?,
            rules: Rules::new(&config.rules).map_err(bad)?,
            tower: match &config.clip {
                None => Tower::on_words(weights, width, config.hidden, config.no_word)?,
                Some(clip) => {
                    let clip = ClipText::load_folder(&place.join(clip))?;
                    Tower::on_clip(weights, clip, config.hidden)?
                }
            },
            emotions: weights.matrix("emotions", EMOTIONS.len(), width)?,
            menu: config.menu,
            full: config.full,
            strength: config.strength,
        })
    }

    /// The clauses of a text, with words for emotions that the text space knows.
    fn clauses(&self, text: &str) -> Vec<Clause> {
        let mut clauses = self.rules.clauses(text);
        clauses.iter_mut().for_each(lexicon::put_known_feelings);
        clauses
    }

    /// Place `[D]` of a word, or the mean over the words of a text. `None` for a text without words
    /// that have a meaning of their own.
    pub fn place(&self, text: &str) -> Option<Array1<f32>> {
        let clauses = self.clauses(text);
        let words: Vec<&String> = clauses.iter().flat_map(Clause::all_words).collect();
        let sum = words
            .iter()
            .map(|word| self.space.of(word))
            .reduce(|sum, place| sum + place)?;
        Some(sum / words.len() as f32)
    }

    /// Finds the units in a text.
    ///
    /// # Errors
    /// `InvalidInput` for a text of more than 1,000 letters.
    pub fn understand(&self, text: &str) -> Result<Understood> {
        check_length(text)?;
        let mut units: Vec<(usize, Side, f32, f32)> = Vec::new();
        let mut latest = Vec::new();
        for clause in self.clauses(text) {
            let clause_units = self.units_of(&clause);
            match (clause_units.is_empty(), side_of(clause.side)) {
                // "Winks, the right eye": the side belongs to the clause before it.
                (true, Some(side)) => set_side(&mut latest, side),
                (true, None) => (),
                (false, _) => {
                    units.append(&mut latest);
                    latest = clause_units;
                }
            }
        }
        units.append(&mut latest);
        let hint = if units.is_empty() {
            self.hint(text)
        } else {
            None
        };
        Ok(Understood {
            units: merged(units),
            hint,
        })
    }

    /// Like [`TextUnits::understand`], for callers that need at least one unit.
    ///
    /// # Errors
    /// Those of [`TextUnits::understand`]; `InvalidInput` for a text without a unit, which names
    /// the text, what was expected and the nearest expression.
    pub fn understood_or_error(&self, text: &str) -> Result<Understood> {
        let understood = self.understand(text)?;
        if !understood.units.is_empty() {
            return Ok(understood);
        }
        let nearest = match &understood.hint {
            Some(hint) => format!("; the nearest that is understood: {hint:?}"),
            None => String::new(),
        };
        Err(Error::InvalidInput(format!(
            "the expression is not understood: expected units such as 12,6L, or English words such as \"smile\" or \
             \"raised eyebrows\", got {text:?}{nearest}"
        )))
    }

    fn units_of(&self, clause: &Clause) -> Vec<(usize, Side, f32, f32)> {
        let mut rest = clause.clone();
        let known = lexicon::take_units(&mut rest);
        let side = side_of(rest.side).unwrap_or_default();
        let [low, high] = self.strength;
        let strength = clause.amount.clamp(low, high);
        let known = known.into_iter().map(|unit| {
            if ACTION_UNITS[unit].has_sides() {
                (unit, side, strength, 1.0)
            } else {
                (unit, Side::Both, strength, 1.0)
            }
        });
        let mut units = self.learned_units_of(&rest);
        units.retain(|unit| known.clone().all(|known| known.0 != unit.0));
        units.extend(known);
        units
    }

    fn learned_units_of(&self, clause: &Clause) -> Vec<(usize, Side, f32, f32)> {
        if clause.all_words().next().is_none() {
            return Vec::new();
        }
        let logits = self.tower.forward(clause, &self.space);
        let [low, high] = self.strength;
        let shares = logits.mapv(sigmoid);
        let shown = (0..LEARNED_UNITS).filter(|unit| shares[[0, *unit]] > THRESHOLD);
        shown
            .map(|unit| {
                let one_sided = shares[[1, unit]] > THRESHOLD;
                let learned_side = if one_sided { Side::Left } else { Side::Both };
                let side = if ACTION_UNITS[unit].has_sides() {
                    side_of(clause.side).unwrap_or(learned_side)
                } else {
                    Side::Both
                };
                let strength = (self.full * shares[[2, unit]] * clause.amount).clamp(low, high);
                (unit, side, strength, shares[[0, unit]])
            })
            .collect()
    }

    /// The expression of the menu that is nearest to the text. The word that lies farthest from the
    /// expression counts: in "the blue car", blue is near to sorrow, but car is near to nothing.
    fn hint(&self, text: &str) -> Option<String> {
        let clauses = self.clauses(text);
        let words: Vec<Array1<f32>> = clauses
            .iter()
            .flat_map(Clause::all_words)
            .map(|word| self.space.of(word))
            .collect();
        let mut nearest: Option<(f32, &String)> = None;
        for entry in &self.menu {
            let Some(place) = self.place(entry) else {
                continue;
            };
            let near = words.iter().map(|word| cosine(word, &place));
            let near = near.reduce(f32::min)?;
            if near >= HINTED_FROM && nearest.is_none_or(|(best, _)| near > best) {
                nearest = Some((near, entry));
            }
        }
        nearest.map(|(_, entry)| entry.clone())
    }
}

/// Refuses texts that are too long to describe a face.
///
/// # Errors
/// `InvalidInput` for more than 1,000 letters.
pub fn check_length(text: &str) -> Result<()> {
    match text.chars().count() {
        0..=LONGEST_TEXT => Ok(()),
        got => Err(Error::InvalidInput(format!(
            "text: expected at most {LONGEST_TEXT} letters, got {got}"
        ))),
    }
}

/// "One" without a side means the subject's left.
fn side_of(said: Option<SaidSide>) -> Option<Side> {
    said.map(|said| match said {
        SaidSide::Left | SaidSide::One => Side::Left,
        SaidSide::Right => Side::Right,
    })
}

fn set_side(units: &mut [(usize, Side, f32, f32)], side: Side) {
    for unit in units {
        if ACTION_UNITS[unit.0].has_sides() {
            unit.1 = side;
        }
    }
}

/// Merges units, so that each occurs once, with its largest strength and confidence. A unit that
/// occurs with different sides is on both.
fn merged(mut units: Vec<(usize, Side, f32, f32)>) -> Vec<(usize, Side, f32, f32)> {
    units.sort_by_key(|unit| unit.0);
    units.dedup_by(|next, previous| {
        let same = next.0 == previous.0;
        if same {
            previous.1 = if previous.1 == next.1 {
                previous.1
            } else {
                Side::Both
            };
            previous.2 = previous.2.max(next.2);
            previous.3 = previous.3.max(next.3);
        }
        same
    });
    units
}

/// Cosine of the angle between two places; 0 if one of them is the origin.
fn cosine(a: &Array1<f32>, b: &Array1<f32>) -> f32 {
    let size = (a.dot(a) * b.dot(b)).sqrt();
    a.dot(b) / size.max(f32::MIN_POSITIVE)
}
