//! Words about faces: their places in a text space, and the action units that a text asks for.
//!
//! The space is made from WordNet (`training/text/space.py`): synonyms lie together, opposites apart. The tower is
//! that of Cafe-Talk (Chen et al. 2025, §3.3 and appendix E) on it, or on CLIP from a folder of the user's.
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
/// Words that a folder may bring.
#[cfg(not(feature = "cafe-talk"))]
pub static MODEL: BuiltIn = BuiltIn::absent("text_units", None);
/// Letters of the longest text: a face is described in a line, and each clause costs a run of the tower.
const LONGEST_TEXT: usize = 1_000;
/// Confidence from which a unit counts as asked for.
const THRESHOLD: f32 = 0.5;
/// Cosine from which an expression is near enough to a text to be named as a hint.
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
    /// Strength that the tower's largest answer stands for.
    full: f32,
    strength: [f32; 2],
}

/// What a text asks of a face.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Understood {
    /// Number in [`ACTION_UNITS`], side, strength (1 is the model's own) and confidence from 0.5 to 1; in rising
    /// order of the number, each unit once.
    pub units: Vec<(usize, Side, f32, f32)>,
    /// The nearest expression that would be understood, where no unit was and one is near at all.
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
    /// CLIP's folder, seen from the model's, where the tower was trained on it.
    #[serde(default)]
    clip: Option<PathBuf>,
    menu: Vec<String>,
    words: String,
}

impl TextUnits {
    /// The built-in model, or that of the folder `text_units` in `folder`.
    ///
    /// # Errors
    /// Those of [`BuiltIn::open`] and [`TextUnits::load`].
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let (files, place) = (MODEL.open(folder)?, MODEL.place(folder)?);
        let weights = Weights::from_bytes(&files.weights)?;
        TextUnits::load(&weights, &files.config, &place.unwrap_or_default())
    }

    /// From arrays and the text of `config.json`; `place` is the model's folder, from which a path in it is seen.
    ///
    /// # Errors
    /// `Weights` if either is damaged or they do not fit each other; `Io` and `Weights` of CLIP's folder where the
    /// config names one.
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

    /// Place `[D]` of a word, or the mean of the words of a text; `None` where none means anything.
    pub fn place(&self, text: &str) -> Option<Array1<f32>> {
        let clauses = self.rules.clauses(text);
        let words: Vec<&String> = clauses.iter().flat_map(Clause::all_words).collect();
        let sum = words
            .iter()
            .map(|word| self.space.of(word))
            .reduce(|sum, place| sum + place)?;
        Some(sum / words.len() as f32)
    }

    /// The units that a text asks for.
    ///
    /// # Errors
    /// `InvalidInput` for a text of more than 1,000 letters.
    pub fn understand(&self, text: &str) -> Result<Understood> {
        check_length(text)?;
        let mut units: Vec<(usize, Side, f32, f32)> = Vec::new();
        let mut latest = Vec::new();
        for clause in self.rules.clauses(text) {
            let found = self.units_of(&clause);
            match (found.is_empty(), side_of(clause.side)) {
                // "Winks, the right eye": the side belongs to what was said before.
                (true, Some(side)) => set_side(&mut latest, side),
                (true, None) => (),
                (false, _) => {
                    units.append(&mut latest);
                    latest = found;
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

    /// [`TextUnits::understand`], for callers who need a unit.
    ///
    /// # Errors
    /// Those of [`TextUnits::understand`]; `InvalidInput` where none was understood: names the text, what was expected,
    /// the nearest thing.
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
        let known = known
            .into_iter()
            .map(|unit| match ACTION_UNITS[unit].has_sides() {
                true => (unit, side, strength, 1.0),
                false => (unit, Side::Both, strength, 1.0),
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
                let own = if one_sided { Side::Left } else { Side::Both };
                let side = match ACTION_UNITS[unit].has_sides() {
                    true => side_of(clause.side).unwrap_or(own),
                    false => Side::Both,
                };
                let strength = (self.full * shares[[2, unit]] * clause.amount).clamp(low, high);
                (unit, side, strength, shares[[0, unit]])
            })
            .collect()
    }

    /// The expression of the menu that is nearest to the text, by the word of it that is farthest: of "the blue car"
    /// a colour lies near to sorrow, and a car near to nothing.
    fn hint(&self, text: &str) -> Option<String> {
        let clauses = self.rules.clauses(text);
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

/// Refuses what is no description of a face by its length alone.
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

/// The subject's left where a text says "one" and not which.
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

/// Each unit once, as strong and as sure as it was said anywhere; one that is said of two sides is on both.
fn merged(mut units: Vec<(usize, Side, f32, f32)>) -> Vec<(usize, Side, f32, f32)> {
    units.sort_by_key(|unit| unit.0);
    units.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        if same {
            kept.1 = if kept.1 == next.1 { kept.1 } else { Side::Both };
            kept.2 = kept.2.max(next.2);
            kept.3 = kept.3.max(next.3);
        }
        same
    });
    units
}

/// Of the angle between two places; 0 where one is the origin.
fn cosine(a: &Array1<f32>, b: &Array1<f32>) -> f32 {
    let size = (a.dot(a) * b.dot(b)).sqrt();
    a.dot(b) / size.max(f32::MIN_POSITIVE)
}
