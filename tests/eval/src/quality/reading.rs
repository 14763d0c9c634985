//! Blind reading: which emotion does an observer see who never saw our expressions?
//!
//! The reader is a linear discriminant. It learned only from ICT's own expression modes, mixed at
//! about full strength as the Facial Action Coding System describes each emotion (Ekman & Friesen
//! 1978), over speaking mouths and on heads of several sizes and shapes. Then it is shown stills of
//! heads on which the engine performs an emotion at intensity 1, as motion of the mesh at the
//! landmarks.

use ndarray::{Array2, Array3, ArrayView2, Axis};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use serde::Serialize;

use super::{
    bootstrap::{Estimate, estimate},
    classifier::Classifier,
    clip::{Clip, spaced},
    emotions::with_emotion,
    heads::{Head, stacked},
    random::{below, between, normal},
    speaker::{Speaker, Wish},
};
use crate::face_model::IctLandmarks;
use anyface::{Result, conditions::EMOTIONS};

/// The reader's possible answers, and the modes of each emotion: action units by their ARKit names.
const FACES: [(&str, &[&str]); 7] = [
    ("neutral", &[]),
    ("happy", &["cheekSquint", "mouthSmile"]),
    ("sad", &["browInnerUp", "browDown", "mouthFrown"]),
    ("angry", &["browDown", "eyeWide", "eyeSquint", "mouthPress"]),
    (
        "afraid",
        &[
            "browInnerUp",
            "browOuterUp",
            "browDown",
            "eyeWide",
            "eyeSquint",
            "mouthStretch",
            "jawOpen",
        ],
    ),
    (
        "surprised",
        &["browInnerUp", "browOuterUp", "eyeWide", "jawOpen"],
    ),
    ("disgusted", &["noseSneer", "mouthFrown", "mouthLowerDown"]),
];
/// Strength of the jaw's mode, whose full strength would be a yawn: most of the jaw's motion in a
/// still is speech.
const JAW_STRENGTH: f64 = 0.3;
/// Examples of each answer.
const EXAMPLES: usize = 300;
/// Range of the strength of a whole expression.
const WHOLE: [f64; 2] = [0.75, 1.25];
/// Range of the further factor on each mode in it.
const EACH: [f64; 2] = [0.6, 1.4];
/// Range of the strength of the speech under it.
const SPEECH: [f64; 2] = [0.0, 1.3];
/// Range of the factor on the size of the head.
const SIZE: [f64; 2] = [0.9, 1.1];
/// Standard deviation of the noise on each coordinate, millimetres: heads of other shapes move each
/// landmark a little differently. Without it the reader would rely on what is exact only on ICT.
const OTHERWISE_MM: f64 = 1.0;
const SEED: u64 = 0;
const CLIPS: usize = 10;
/// Stills of each clip, at equal intervals.
const STILLS: usize = 3;
const MM: f64 = 1000.0;
const PER_CENT: f64 = 100.0;

/// The reader's answers on one head.
#[derive(Debug, Clone, Serialize)]
pub(super) struct HeadReading {
    pub head: &'static str,
    pub stills: usize,
    /// `[emotion][answer]`: numbers of stills; six emotions, seven answers.
    pub confusion: Vec<Vec<usize>>,
}

/// The reader's answers on all heads.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Reading {
    pub answers: Vec<&'static str>,
    pub accuracy_percent: Option<Estimate>,
    /// Accuracy on fresh examples, made in the same way as those that the reader learned from.
    pub own_percent: f64,
    pub heads: Vec<HeadReading>,
}

impl Reading {
    /// Number of heads on which the right answer to an emotion is the most frequent one.
    pub(super) fn heads_read(&self, emotion: &str) -> usize {
        let place = self.answers.iter().position(|answer| *answer == emotion);
        let right = |head: &&HeadReading| {
            place.is_some_and(|answer| {
                let row = &head.confusion[answer - 1];
                row.iter()
                    .enumerate()
                    .all(|(k, count)| k == answer || *count < row[answer])
            })
        };
        self.heads.iter().filter(right).count()
    }
}

/// Measures how often the reader recognises the model's emotions.
///
/// `speech`: clips whose recorded motion lies under the reader's examples. `clips`: the clips that
/// the model performs.
pub(super) fn measure(
    speaker: &Speaker,
    wish: &Wish,
    heads: &[Head],
    ict: &IctLandmarks,
    (speech, clips): (&[Clip], &[Clip]),
) -> Result<Reading> {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let reader = Classifier::fit(&examples(ict, speech, &mut random)?, FACES.len())?;
    let examples_of_ict = examples(ict, speech, &mut random)?;
    let right = examples_of_ict
        .iter()
        .filter(|(row, answer)| reader.classify(row) == *answer);
    let own_percent = PER_CENT * right.count() as f64 / examples_of_ict.len() as f64;
    let clips: Vec<&Clip> = spaced(clips, CLIPS).collect();
    let mut readings = Vec::new();
    let mut verdicts = Vec::new();
    for head in heads {
        let mut confusion = vec![vec![0; FACES.len()]; FACES.len() - 1];
        for (row, answer) in confusion.iter_mut().zip(1..) {
            for clip in &clips {
                let stills = stills(speaker, &with_emotion(wish, number(answer), 1.0), clip)?;
                let landmarks = head.landmarks(&speaker.engine, &stills)?;
                let read = landmarks
                    .outer_iter()
                    .map(|face| reader.classify(&features(face)));
                let read: Vec<usize> = read.collect();
                read.iter().for_each(|k| row[*k] += 1);
                let right = read.iter().filter(|k| **k == answer).count();
                verdicts.push(right as f64 / read.len() as f64);
            }
        }
        readings.push(HeadReading {
            head: head.title,
            stills: clips.len() * STILLS,
            confusion,
        });
    }
    let share = |of: &[&f64]| {
        let sum: f64 = of.iter().copied().sum();
        (!of.is_empty()).then(|| PER_CENT * sum / of.len() as f64)
    };
    Ok(Reading {
        answers: FACES.iter().map(|(name, _)| *name).collect(),
        accuracy_percent: estimate(&verdicts, share),
        own_percent,
        heads: readings,
    })
}

/// Number of an answer among the engine's categories.
fn number(answer: usize) -> usize {
    EMOTIONS
        .iter()
        .position(|e| *e == FACES[answer].0)
        .unwrap_or(0)
}

/// Evenly spaced frames of one performance, `[stills, 68, 3]` metres.
fn stills(speaker: &Speaker, wish: &Wish, clip: &Clip) -> Result<Array3<f64>> {
    let motion = speaker.speak(clip, wish)?;
    let at = |k: usize| (k + 1) * motion.dim().0 / (STILLS + 1);
    let frames: Vec<_> = (0..STILLS)
        .map(|k| motion.index_axis(Axis(0), at(k)))
        .collect();
    Ok(stacked(&frames))
}

/// All coordinates `[204]` of a face, millimetres.
fn features(face: ArrayView2<'_, f64>) -> Vec<f64> {
    face.iter().copied().collect()
}

/// Example faces with their answers, millimetres.
fn examples(
    ict: &IctLandmarks,
    speech: &[Clip],
    random: &mut ChaCha8Rng,
) -> Result<Vec<(Vec<f64>, usize)>> {
    let mut out = Vec::new();
    for (answer, (_, names)) in FACES.iter().enumerate() {
        let modes = names.iter().map(|name| Ok((*name, ict.mode(name)?)));
        let modes: Vec<(&str, Array2<f64>)> = modes.collect::<Result<_>>()?;
        for _ in 0..EXAMPLES {
            let clip = &speech[below(random, speech.len())];
            let spoken = clip
                .motion
                .index_axis(Axis(0), below(random, clip.frames()));
            let mut face = &spoken * between(random, SPEECH);
            let whole = between(random, WHOLE);
            for (name, mode) in &modes {
                let full = if *name == "jawOpen" {
                    JAW_STRENGTH
                } else {
                    1.0
                };
                face.scaled_add(full * whole * between(random, EACH), mode);
            }
            face *= MM * between(random, SIZE);
            face.mapv_inplace(|x| x + OTHERWISE_MM * normal(random));
            out.push((features(face.view()), answer));
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_answer_is_a_category_of_the_engine() {
        assert!(FACES.iter().all(|(name, _)| EMOTIONS.contains(name)));
        assert_eq!(EMOTIONS[number(3)], "angry");
    }

    #[test]
    fn a_head_counts_where_the_right_answer_is_the_most_frequent() {
        let head = |right: usize| HeadReading {
            head: "",
            stills: 10,
            confusion: (1..FACES.len())
                .map(|emotion| {
                    let mut row = vec![0; FACES.len()];
                    row[0] = 10 - right;
                    row[emotion] = right;
                    row
                })
                .collect(),
        };
        let reading = Reading {
            answers: FACES.iter().map(|(name, _)| *name).collect(),
            accuracy_percent: None,
            own_percent: 0.0,
            heads: vec![head(9), head(3), head(6)],
        };
        assert_eq!(reading.heads_read("angry"), 2);
        assert_eq!(reading.heads_read("bored"), 0);
    }
}
