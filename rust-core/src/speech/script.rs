//! What is said in a sound, as far as it is known beside the sound itself.

use std::ops::Range;

use ndarray::Array2;

use super::clock::Clock;
use crate::annotation::{Annotation, Interval, Symbols, ipa};

/// Probability that a phone with a time is the one that is said then.
const TOLD: f32 = 0.97;
/// A diphthong's first vowel takes this share of its time.
const FIRST_HALF: f64 = 0.6;
/// Words may begin and end this much outside the times that are given for them, seconds.
const AROUND_S: f64 = 0.12;

/// What is said in a sound, as far as it is known.
///
/// ```
/// use std::sync::Arc;
/// use anyface::{MotionRequest, speech::Script};
///
/// let mut request = MotionRequest::default();
/// request.script = Some(Arc::new(Script::Text("Bob made a map.".into())));
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Script {
    /// The words, in their order.
    Text(String),
    /// Words or lines of several words, with times.
    Words(Vec<Interval>),
    /// Phones with times: IPA or ARPABET.
    Phones(Vec<Interval>),
}

impl Script {
    /// The phones of an annotation, or else its words. `None` if it has neither, or only phones
    /// that close the lips.
    pub fn of_annotation(annotation: &Annotation) -> Option<Script> {
        let phones = annotation.intervals(Symbols::Phones);
        let opens = |phone: &Interval| !Symbols::Phones.closes_lips(&phone.label);
        if phones.iter().any(opens) {
            return Some(Script::Phones(phones.to_vec()));
        }
        let words = annotation.intervals(Symbols::Words);
        (!words.is_empty()).then(|| Script::Words(words.to_vec()))
    }

    /// The same script for the sound from `start_s` on, of `duration_s` seconds at most. Words and phones
    /// outside are dropped; a text without times stays whole.
    pub(crate) fn between(&self, start_s: f64, duration_s: f64) -> Script {
        let cut = |said: &[Interval]| {
            let later = said.iter().map(|interval| Interval {
                start_s: (interval.start_s - start_s).max(0.0),
                end_s: interval.end_s - start_s,
                label: interval.label.clone(),
            });
            let is_inside = |i: &Interval| i.end_s > 0.0 && i.start_s < duration_s;
            later.filter(is_inside).collect()
        };
        match self {
            Script::Text(_) => self.clone(),
            Script::Words(words) => Script::Words(cut(words)),
            Script::Phones(phones) => Script::Phones(cut(phones)),
        }
    }

    /// The words in their order, each with the seconds in which it is said if they are known.
    pub(super) fn words(&self) -> Vec<(&str, Option<[f64; 2]>)> {
        match self {
            Script::Text(text) => text.split_whitespace().map(|word| (word, None)).collect(),
            Script::Words(lines) => {
                let of =
                    |line: &'_ Interval| Some([line.start_s - AROUND_S, line.end_s + AROUND_S]);
                let words = lines.iter().flat_map(|line| {
                    let words = line.label.split_whitespace();
                    words.map(move |word| (word, of(line)))
                });
                words.collect()
            }
            Script::Phones(_) => Vec::new(),
        }
    }
}

/// Replaces the log-posteriors `[R, K]` of all rows that lie in a phone with a time.
pub(super) fn tell(rows: &mut Array2<f32>, said: &[Interval], clock: Clock, classes: &[String]) {
    let other = ((1.0 - TOLD) / (classes.len() - 1).max(1) as f32).ln();
    for (span_s, sign) in said.iter().flat_map(parts) {
        let Some(class) = classes.iter().position(|known| known == sign) else {
            continue;
        };
        for row in clock.rows(span_s, rows.nrows()) {
            rows.row_mut(row).fill(other);
            rows[[row, class]] = TOLD.ln();
        }
    }
}

/// The plain sounds of a phone, one after the other, with their share of its time.
fn parts(phone: &Interval) -> Vec<([f64; 2], &'static str)> {
    let signs = ipa(&phone.label);
    let (start_s, length_s) = (phone.start_s, phone.end_s - phone.start_s);
    let ends: Vec<f64> = match signs.len() {
        2 => vec![FIRST_HALF, 1.0],
        count => (1..=count).map(|k| k as f64 / count as f64).collect(),
    };
    let mut at_s = start_s;
    let spans = signs.into_iter().zip(ends).map(|(sign, end)| {
        let span_s = [at_s, start_s + end * length_s];
        at_s = span_s[1];
        (span_s, sign)
    });
    spans.collect()
}

/// The rows in which a word may be said: all, or those near its time.
pub(super) fn rows_of(span_s: Option<[f64; 2]>, clock: Clock, count: usize) -> Range<usize> {
    span_s.map_or(0..count, |span_s| clock.rows(span_s, count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::speech::PhoneModel;

    fn interval(start_s: f64, end_s: f64, label: &str) -> Interval {
        Interval {
            start_s,
            end_s,
            label: label.into(),
        }
    }

    #[test]
    fn labels_of_any_alphabet_become_plain_sounds() {
        let signs = |label: &str| {
            parts(&interval(0.0, 1.0, label))
                .into_iter()
                .map(|(_, s)| s)
                .collect::<Vec<_>>()
        };
        assert_eq!(signs("AY1"), ["a", "ɪ"]);
        assert_eq!(signs("ˈaɪ"), ["a", "ɪ"]);
        assert_eq!(signs("tʃ"), ["t", "ʃ"]);
        assert_eq!(signs("iː"), ["i"]);
        assert_eq!(signs("sil"), ["_"]);
        assert_eq!(signs("?"), Vec::<&str>::new());
        let spans = parts(&interval(1.0, 2.0, "OW"));
        assert_eq!(spans, [([1.0, 1.6], "o"), ([1.6, 2.0], "ʊ")]);
    }

    #[test]
    fn phones_with_times_stand_where_they_are_said() {
        let model = PhoneModel::open(None).unwrap();
        let clock = Clock {
            rate_hz: 100.0,
            duration_s: 1.0,
        };
        let mut rows = Array2::from_elem((100, model.classes().len()), -3.7);
        let untold = rows.clone();
        tell(
            &mut rows,
            &[interval(0.2, 0.3, "m"), interval(0.3, 0.4, "AA")],
            clock,
            model.classes(),
        );
        let class = |sign: &str| model.classes().iter().position(|c| c == sign).unwrap();
        let likeliest = |row: usize| {
            (0..model.classes().len()).max_by(|a, b| rows[[row, *a]].total_cmp(&rows[[row, *b]]))
        };
        let row_at = |time_s: f64| clock.rows([time_s, time_s + 0.011], 100).start;
        assert_eq!(likeliest(row_at(0.25)), Some(class("m")));
        assert_eq!(likeliest(row_at(0.35)), Some(class("ɑ")));
        assert_eq!(rows.row(row_at(0.6)), untold.row(row_at(0.6)));
    }

    #[test]
    fn an_annotation_says_phones_before_words_and_closures_alone_say_nothing() {
        let tier = |symbols, label: &str| crate::annotation::Tier {
            symbols,
            intervals: vec![interval(0.0, 1.0, label)],
        };
        let of = |tiers| {
            Script::of_annotation(&Annotation {
                tiers,
                duration_s: 1.0,
            })
        };
        assert_eq!(of(vec![tier(Symbols::Phones, "MBP")]), None);
        let both = of(vec![
            tier(Symbols::Words, "ah"),
            tier(Symbols::Phones, "AA"),
        ]);
        assert!(matches!(both, Some(Script::Phones(_))));
        assert!(matches!(
            of(vec![tier(Symbols::Words, "ah")]),
            Some(Script::Words(_))
        ));
    }
}
