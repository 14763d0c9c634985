//! Recognises phones over time, and finds the words of a text in the sound.
//!
//! Twin of `training/speech/phones.py`. The model reads the features of one encoder and gives
//! four rows of posteriors for each of its frames. Row `r` belongs to second `(r − 2) / 100`. The
//! model is loaded to find phones or words, and by systems that take lip contacts from it.

use std::{
    collections::HashSet,
    path::{Path, PathBuf},
};

use ndarray::{Array1, Array2, ArrayView2, ArrayViewMut1, Axis};

use super::{
    FeatureTrack, LipShapes, Script,
    alignment::{State, best_path, states_of},
    clock::Clock,
    letters::Word,
    pronunciations::{PRONUNCIATIONS, Pronunciations, spelled},
    script::{rows_of, tell},
};
use crate::{
    Error, Result,
    annotation::Interval,
    audio::{PROSODY_FPS, Prosody},
    models::{BuiltIn, Weights},
    nn::{conv::Conv1d, elementwise::gelu_all, linear::Linear},
};

/// Rows of posteriors for each frame of the encoder.
const PARTS: usize = 4;
/// Each posterior is divided by the frequency of its class, raised to this power.
const PRIOR_POWER: f32 = 0.8;
/// Cost of changing from one phone to another, nepers.
const CHANGE_COST: f64 = 4.0;
/// Words end and begin at the edges of silence, which the features, 40 ms apart, show less sharply than the
/// level of the sound. A row counts for a pause by so many nepers at most, and as many against it.
const SILENCE_POWER: f32 = 4.0;
/// The level at which it counts neither way lies this far above the quietest rows, and this far below the
/// loudest, dB.
const ABOVE_QUIETEST_DB: f32 = 18.0;
const BELOW_LOUD_DB: f32 = 18.0;
/// In noise that level is at least this far above the quietest rows, dB.
const LEAST_ABOVE_DB: f32 = 6.0;
/// It counts fully from this distance on, dB.
const SURE_DB: f32 = 10.0;
/// Share of the rows that are the quietest.
const QUIET_SHARE: f64 = 0.05;
/// Weight of the text's evidence for phones. The sound's evidence has weight 1.
const TEXT_POWER: f32 = 1.0;

/// Built-in weights of [`PhoneModel`] for the ear's features.
pub static PHONE_MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::PHONES);

/// Sizes of the read-out, its classes and the units of its table, as `config.json` states them.
#[derive(Debug, Clone, PartialEq, serde::Deserialize)]
pub struct PhoneConfig {
    /// Name of the model.
    pub model: String,
    /// Name of the encoder whose features the model reads.
    pub encoder: String,
    /// Channels `C` of the features that the model reads.
    pub channels: usize,
    /// Channels between its two layers.
    pub hidden: usize,
    /// The IPA sign of each class `K`. The first is a pause.
    pub phones: Vec<String>,
    /// Units `U` of words: letters, groups of letters and, after a slash, phones of the dictionary.
    pub units: Vec<String>,
}

/// Recognises phones, and finds the words of a text.
pub struct PhoneModel {
    config: PhoneConfig,
    conv: Conv1d,
    out: Linear,
    /// `[K]`, log frequency of each class.
    log_prior: Array1<f32>,
    /// `[U, K]`, probability of each class for a unit.
    table: Array2<f32>,
    /// Folder of models, which may hold a dictionary.
    folder: Option<PathBuf>,
}

/// Phones with closed lips.
const BILABIALS: &[&str] = &["p", "b", "m"];
/// Phones with the lower lip at the upper teeth.
const LABIODENTALS: &[&str] = &["f", "v"];
const VOWELS: &[&str] = &[
    "i", "ɪ", "y", "u", "ʊ", "e", "ɛ", "ø", "ə", "ɝ", "o", "ɔ", "ʌ", "a", "ɑ", "æ",
];
/// An f or v counts only near a vowel, because hiss has no vowels. It does not count if the vowel's
/// probability is below the first value, and counts fully above the second.
const VOWEL_HEARD: [f32; 2] = [0.5, 0.9];
/// The vowel must lie within this many frames of the f or v: further away, breath and the noise of a
/// pause sound like one.
const VOWEL_FRAMES: usize = 2;

/// Probability of each contact of the lips in each frame, `[T]`, 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ContactProbability {
    /// The lips touch one another, for p, b or m.
    pub(super) together: Vec<f32>,
    /// The lower lip touches the upper teeth, for f or v.
    pub(super) at_teeth: Vec<f32>,
    /// The shapes of the mouth.
    pub(super) shapes: LipShapes,
}

/// What [`PhoneModel`] reads of a sound.
#[derive(Clone, Copy)]
pub(crate) struct PhoneInput<'a> {
    pub(crate) track: &'a FeatureTrack,
    /// Name of the encoder of the features.
    pub(crate) encoder: &'a str,
    pub(crate) prosody: &'a Prosody,
    pub(crate) duration_s: f64,
}

/// Phones and words of a sound.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Said {
    /// Phones in order of time, labelled in IPA. Pauses are left out.
    pub phones: Vec<Interval>,
    /// Words of the text in its order. Empty if there is no text.
    pub words: Vec<Interval>,
}

impl PhoneModel {
    /// The built-in model, or that of the folder in `folder`.
    ///
    /// # Errors
    /// Those of [`BuiltIn::open`] and [`PhoneModel::load`].
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = PHONE_MODEL.open(folder)?;
        let model = PhoneModel::load(&files.weights, &files.config)?;
        Ok(PhoneModel {
            folder: folder.map(Path::to_owned),
            ..model
        })
    }

    /// From the bytes of `model.safetensors` and the text of `config.json`.
    ///
    /// # Errors
    /// `Weights` if either is damaged or they do not fit each other.
    pub fn load(weights: &[u8], config: &str) -> Result<Self> {
        let bad = |e: &dyn std::fmt::Display| Error::Weights(format!("phones: {e}"));
        let config: PhoneConfig = serde_json::from_str(config).map_err(|e| bad(&e))?;
        if config.phones.is_empty() || config.units.iter().any(String::is_empty) {
            return Err(bad(&"expected phones and units that have a name, got none"));
        }
        let weights = Weights::from_bytes(weights)?;
        let (channels, hidden) = (config.channels, config.hidden);
        let (classes, units) = (config.phones.len(), config.units.len());
        let conv = Conv1d::load(&weights.pp("conv"), [hidden, channels, 3], 1, true)?;
        Ok(PhoneModel {
            conv: conv.padded(1),
            out: Linear::load(&weights.pp("out"), hidden, PARTS * classes)?,
            log_prior: weights.vector("log_prior", classes)?,
            table: weights.matrix("table", units, classes)?,
            folder: None,
            config,
        })
    }

    /// Log-posteriors `[4 T, K]`, nepers, of features `[T, C]`.
    pub fn log_posteriors(&self, features: ArrayView2<'_, f32>) -> Array2<f32> {
        let hidden = self.conv.forward_then(&features, gelu_all);
        let logits = self.out.forward(&hidden);
        let (frames, classes) = (logits.nrows(), self.config.phones.len());
        let mut rows = logits
            .into_shape_with_order((PARTS * frames, classes))
            .expect("rows of a frame lie one after the other");
        rows.rows_mut().into_iter().for_each(normalise);
        rows
    }

    /// The contacts of the lips and the shapes of the mouth, from log-posteriors `[4 T, K]` of frames at
    /// `rate_hz` a second. Contacts are averaged over the rows of a frame.
    pub(super) fn contacts(
        &self,
        posteriors: ArrayView2<'_, f32>,
        rate_hz: f64,
    ) -> ContactProbability {
        let vowels = self.probability(VOWELS, posteriors);
        let mut at_teeth = self.probability(LABIODENTALS, posteriors);
        for (t, probability) in at_teeth.iter_mut().enumerate() {
            let near = t.saturating_sub(VOWEL_FRAMES)..(t + VOWEL_FRAMES + 1).min(vowels.len());
            let vowel = vowels[near].iter().copied().fold(0.0, f32::max);
            let [from, to] = VOWEL_HEARD;
            *probability *= ((vowel - from) / (to - from)).clamp(0.0, 1.0);
        }
        ContactProbability {
            together: self.probability(BILABIALS, posteriors),
            at_teeth,
            shapes: LipShapes::heard(posteriors, &self.config.phones, rate_hz * PARTS as f64),
        }
    }

    fn probability(&self, phones: &[&str], posteriors: ArrayView2<'_, f32>) -> Vec<f32> {
        let named = self.config.phones.iter().enumerate();
        let classes = named.filter(|(_, name)| phones.contains(&name.as_str()));
        let classes: Vec<usize> = classes.map(|(class, _)| class).collect();
        let rows = posteriors.axis_chunks_iter(Axis(0), PARTS);
        let each = rows.map(|rows| {
            let sum: f32 = classes
                .iter()
                .flat_map(|&class| rows.column(class).to_vec())
                .map(f32::exp)
                .sum();
            sum / PARTS as f32
        });
        each.collect()
    }

    /// Whether a sound's features come from the encoder that this model was trained with.
    pub fn hears(&self, track: &FeatureTrack, encoder: &str) -> bool {
        self.check(track, encoder).is_ok()
    }

    /// The IPA sign of each class `[K]`.
    pub(super) fn classes(&self) -> &[String] {
        &self.config.phones
    }

    /// Rows of posteriors per second of features.
    pub(super) fn rows_per_second(&self, track: &FeatureTrack) -> f64 {
        track.rate_hz * PARTS as f64
    }

    /// Finds the phones of a sound. With a text it also finds the words, and chooses phones that fit
    /// them. Returns the log-posteriors `[R, K]` too, which follow the text.
    ///
    /// # Errors
    /// `Weights` if the features come from another encoder; `InvalidInput` for a text without a
    /// letter, or one too long for the sound.
    pub(crate) fn said(
        &self,
        sound: PhoneInput<'_>,
        text: Option<&str>,
    ) -> Result<(Said, Array2<f32>)> {
        let clock = self.clock(sound)?;
        let heard = self.log_posteriors(sound.track.features.view());
        let mut likelihood = &heard - &(PRIOR_POWER * &self.log_prior);
        let words = match text {
            Some(text) => {
                let script = Script::Text(text.to_owned());
                self.align(&mut likelihood, &script.words(), (clock, sound.prosody))?
            }
            None => Vec::new(),
        };
        let path = decode(likelihood.view());
        let phones = intervals(&path, clock, |class| {
            (*class > 0).then(|| self.config.phones[*class].clone())
        });
        let said = Said { phones, words };
        if text.is_none() {
            return Ok((said, heard));
        }
        likelihood.rows_mut().into_iter().for_each(normalise);
        Ok((said, likelihood))
    }

    /// Log-posteriors `[R, K]` of a sound whose words or phones are known. Where the script has phones
    /// with times, they are taken as they are.
    ///
    /// # Errors
    /// Those of [`PhoneModel::said`].
    pub(super) fn told(&self, sound: PhoneInput<'_>, script: &Script) -> Result<Array2<f32>> {
        let clock = self.clock(sound)?;
        let mut rows = self.log_posteriors(sound.track.features.view());
        if let Script::Phones(phones) = script {
            tell(&mut rows, phones, clock, &self.config.phones);
            return Ok(rows);
        }
        let script = script.between(0.0, clock.duration_s);
        let words = script.words();
        if matches!(script, Script::Words(_)) && words.is_empty() {
            return Ok(rows);
        }
        let heard = rows.clone();
        rows -= &(PRIOR_POWER * &self.log_prior);
        self.align(&mut rows, &words, (clock, sound.prosody))?;
        // Subtitles may leave out what is said between them, so there the sound alone counts.
        let count = rows.nrows();
        let mut is_told = vec![false; count];
        for (_, span_s) in &words {
            is_told[rows_of(*span_s, clock, count)].fill(true);
        }
        for ((mut row, heard), is_told) in
            rows.outer_iter_mut().zip(heard.outer_iter()).zip(is_told)
        {
            if is_told {
                normalise(row)
            } else {
                row.assign(&heard)
            }
        }
        Ok(rows)
    }

    /// The times of a sound's rows.
    fn clock(&self, sound: PhoneInput<'_>) -> Result<Clock> {
        self.check(sound.track, sound.encoder)?;
        Ok(Clock {
            rate_hz: self.rows_per_second(sound.track),
            duration_s: sound.duration_s,
        })
    }

    fn check(&self, track: &FeatureTrack, encoder: &str) -> Result<()> {
        let channels = track.features.ncols();
        if (encoder, channels) == (&self.config.encoder, self.config.channels) {
            Ok(())
        } else {
            Err(Error::Weights(format!(
                "phones: expected {} features of {}, got {channels} of {}",
                self.config.channels, self.config.encoder, encoder
            )))
        }
    }

    /// Finds the times of words, which stay near the times that are known of them. Adds the words'
    /// evidence to each row of `likelihood` `[T, K]`.
    ///
    /// Words are read letter by letter, and once more as English where the dictionary has them. The
    /// likelier path counts, so a text needs no language. Silence between words is heard by the level too.
    fn align(
        &self,
        likelihood: &mut Array2<f32>,
        spoken: &[(&str, Option<[f64; 2]>)],
        (clock, prosody): (Clock, &Prosody),
    ) -> Result<Vec<Interval>> {
        let units = &self.config.units;
        let letters = |(word, _): &(&str, _)| Word::read(word, units);
        let letters: Vec<Word> = spoken.iter().map(letters).collect();
        if letters.iter().all(|word| word.units.is_empty()) {
            let message = "text: expected words that are said in the sound, got no letter";
            return Err(Error::InvalidInput(message.into()));
        }
        let mut emissions = self.emissions(likelihood);
        let silences = silences(prosody, clock, likelihood.nrows());
        for (pause, silence) in emissions.column_mut(units.len()).iter_mut().zip(silences) {
            *pause += silence;
        }
        let english = self.english(spoken, &letters)?;
        let paths = [Some(letters), english]
            .into_iter()
            .flatten()
            .filter_map(|words| {
                let mut states = states_of(&words, units.len());
                for state in &mut states {
                    let span_s = state.word.and_then(|word| spoken[word].1);
                    state.rows = rows_of(span_s, clock, likelihood.nrows());
                }
                let (path, likely) = best_path(&emissions, &states)?;
                Some((path, states, likely))
            });
        let likeliest = paths.max_by(|a, b| a.2.total_cmp(&b.2));
        let (path, states, _) = likeliest.ok_or_else(|| {
            Error::InvalidInput(format!(
                "text: expected the words that are said in {:.2} s of sound, got {}, too many for it",
                clock.duration_s,
                spoken.len()
            ))
        })?;
        self.weigh(likelihood, &path, &states);
        let word_of: Vec<Option<usize>> = path.iter().map(|state| states[*state].word).collect();
        Ok(intervals(&word_of, clock, |word| {
            word.map(|word| trimmed(spoken[word].0).to_owned())
        }))
    }

    /// The words of a text by their phones in English, and letter by letter those that the dictionary does
    /// not have. `None` if it has none of them.
    fn english(
        &self,
        spoken: &[(&str, Option<[f64; 2]>)],
        letters: &[Word],
    ) -> Result<Option<Vec<Word>>> {
        if PRONUNCIATIONS.is_awaited(self.folder.as_deref())? {
            return Ok(None);
        }
        let parts: Vec<_> = spoken.iter().map(|(word, _)| spelled(word)).collect();
        let every: HashSet<&str> = parts
            .iter()
            .flatten()
            .flatten()
            .map(String::as_str)
            .collect();
        let dictionary = Pronunciations::open(self.folder.as_deref())?;
        let known = dictionary.phones_of(&every);
        let sound = |parts: &Option<Vec<String>>| {
            let phones = parts.iter().flatten();
            let phones = phones.map(|part| known.get(part.as_str()).map(Vec::as_slice));
            let phones = phones.collect::<Option<Vec<_>>>()?.concat();
            Word::sound(&phones, &self.config.units).filter(|word| !word.units.is_empty())
        };
        let sounds: Vec<Option<Word>> = parts.iter().map(sound).collect();
        if sounds.iter().all(Option::is_none) {
            return Ok(None);
        }
        let words = sounds.into_iter().zip(letters);
        Ok(Some(
            words
                .map(|(sound, letters)| sound.unwrap_or_else(|| letters.clone()))
                .collect(),
        ))
    }

    /// Log-likelihood of each row for each unit and, in the last column, for a pause, `[T, U + 1]`,
    /// nepers.
    fn emissions(&self, likelihood: &Array2<f32>) -> Array2<f32> {
        let units = self.table.nrows();
        let mut out = Array2::zeros((likelihood.nrows(), units + 1));
        for (row, mut to) in likelihood.rows().into_iter().zip(out.rows_mut()) {
            let top = row.iter().fold(f32::NEG_INFINITY, |a, b| a.max(*b));
            let of_units = self.table.dot(&row.mapv(|x| (x - top).exp()));
            let (mut letters, mut pause) = to.view_mut().split_at(Axis(0), units);
            letters.assign(&of_units.mapv(|x| x.ln() + top));
            pause[0] = row[0];
        }
        out
    }

    /// Adds to each row how likely its unit makes each phone.
    fn weigh(&self, likelihood: &mut Array2<f32>, path: &[usize], states: &[State]) {
        // A phone that is not in the text here remains possible if the sound is clear.
        const LEAST: f32 = 1e-3;
        for (mut row, state) in likelihood.rows_mut().into_iter().zip(path) {
            let column = states[*state].column;
            for (class, x) in row.iter_mut().enumerate() {
                let p = if column < self.table.nrows() {
                    self.table[[column, class]]
                } else {
                    f32::from(class == 0)
                };
                *x += TEXT_POWER * p.max(LEAST).ln();
            }
        }
    }
}

/// Turns runs of equal rows into intervals. Runs without a label are left out.
fn intervals<T: PartialEq>(
    rows: &[T],
    clock: Clock,
    label: impl Fn(&T) -> Option<String>,
) -> Vec<Interval> {
    let mut out = Vec::new();
    let mut at = 0;
    for run in rows.chunk_by(|a, b| a == b) {
        let (start_s, end_s) = (clock.begins(at), clock.begins(at + run.len()));
        at += run.len();
        if let Some(label) = label(&run[0]).filter(|_| end_s > start_s) {
            out.push(Interval {
                start_s,
                end_s,
                label,
            });
        }
    }
    out
}

/// Finds the best path: the class of each row, `[T]`. Every change of class costs the same.
fn decode(likelihood: ArrayView2<'_, f32>) -> Vec<usize> {
    let classes = likelihood.ncols();
    let mut scores = vec![0.0f64; classes];
    let mut from: Vec<Vec<u16>> = Vec::with_capacity(likelihood.nrows());
    for row in likelihood.rows() {
        let best = highest(&scores);
        let changed = scores[best] - CHANGE_COST;
        let mut back: Vec<u16> = (0..classes as u16).collect();
        for class in 0..classes {
            if scores[class] < changed {
                (scores[class], back[class]) = (changed, best as u16);
            }
            scores[class] += f64::from(row[class]);
        }
        from.push(back);
    }
    let mut at = highest(&scores);
    let mut path = vec![0; from.len()];
    for (t, back) in from.iter().enumerate().rev() {
        path[t] = at;
        at = usize::from(back[at]);
    }
    path
}

fn highest(scores: &[f64]) -> usize {
    let best = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b]));
    best.expect("at least one class")
}

/// How much the level of the sound speaks for a pause in each of `count` rows, `[R]`, nepers. All 0 for
/// a sound without a level.
fn silences(prosody: &Prosody, clock: Clock, count: usize) -> Vec<f32> {
    let mut sorted = prosody.level_db.clone();
    sorted.sort_by(f32::total_cmp);
    let Some(&quietest_db) = sorted.get((QUIET_SHARE * sorted.len() as f64) as usize) else {
        return vec![0.0; count];
    };
    let even_db = (quietest_db + ABOVE_QUIETEST_DB)
        .min(prosody.loud_db - BELOW_LOUD_DB)
        .max(quietest_db + LEAST_ABOVE_DB);
    let level_db = |row: usize| {
        let frame = (clock.begins(row) * PROSODY_FPS) as usize;
        prosody.level_db[frame.min(prosody.level_db.len() - 1)]
    };
    let silence = |row| ((even_db - level_db(row)) / SURE_DB).clamp(-1.0, 1.0);
    (0..count).map(|row| SILENCE_POWER * silence(row)).collect()
}

/// Makes the probabilities of a row of logits sum to 1.
fn normalise(mut row: ArrayViewMut1<'_, f32>) {
    let sum = log_sum_exp(row.iter().copied());
    row -= sum;
}

fn log_sum_exp(values: impl Iterator<Item = f32> + Clone) -> f32 {
    let top = values.clone().fold(f32::NEG_INFINITY, f32::max);
    top + values.map(|x| (x - top).exp()).sum::<f32>().ln()
}

/// A word without the punctuation around it.
fn trimmed(word: &str) -> &str {
    word.trim_matches(|sign: char| !sign.is_alphanumeric())
}

#[cfg(test)]
mod tests;
