//! Emotion: can the categories be told apart, and does intensity make more of each?

use ndarray::{Array2, Array3, Axis};
use serde::Serialize;

use super::{
    bootstrap::{Estimate, estimate},
    classifier::Classifier,
    clip::Clip,
    speaker::{Speaker, Wish},
};
use anyface::{
    Result,
    conditions::{EMOTIONS, Emotion},
    ibug::LANDMARKS,
};

/// Clips of each half of the separability test.
const CLIPS: usize = 12;
/// Clips on which intensity is measured, and as many others that choose the landmarks.
const INTENSITY_CLIPS: usize = 4;
/// Intensities beside 0.
pub(super) const INTENSITIES: [f32; 6] = [0.25, 0.5, 0.75, 1.0, 1.25, 1.5];
/// Landmarks that an emotion's face moves most.
pub(super) const OWN_LANDMARKS: usize = 12;
/// Neutral and the six of Ekman.
pub(super) const BASIC: [&str; 7] = [
    "neutral",
    "happy",
    "sad",
    "angry",
    "afraid",
    "surprised",
    "disgusted",
];
const MM: f64 = 1000.0;
const PER_CENT: f64 = 100.0;

/// How well a linear classifier tells a set of categories apart.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Separability {
    pub categories: Vec<&'static str>,
    pub train_clips: usize,
    pub test_clips: usize,
    pub accuracy_percent: Option<Estimate>,
    /// `[asked][recognised]`, numbers of test performances.
    pub confusion: Vec<Vec<usize>>,
}

/// One category at rising intensity.
#[derive(Debug, Clone, Serialize)]
pub(super) struct IntensityCurve {
    pub emotion: &'static str,
    /// The landmarks that it moves most.
    pub landmarks: Vec<usize>,
    /// Mean displacement of these from the performance at intensity 0, mm, at 0 and
    /// [`INTENSITIES`].
    pub mm: Vec<f64>,
    /// Whether it grows at every step.
    pub grows: bool,
}

/// Separability for all fifteen categories and for the basic seven; none with too few clips.
pub(super) fn separability(
    speaker: &Speaker,
    wish: &Wish,
    clips: &[Clip],
) -> Result<Vec<Separability>> {
    let train: Vec<&Clip> = clips.iter().step_by(2).take(CLIPS).collect();
    let test: Vec<&Clip> = clips.iter().skip(1).step_by(2).take(CLIPS).collect();
    if train.len() < 2 || test.is_empty() {
        return Ok(Vec::new());
    }
    let train = performances(speaker, wish, &train)?;
    let test = performances(speaker, wish, &test)?;
    let sets = [EMOTIONS.to_vec(), BASIC.to_vec()];
    let sets = sets.into_iter();
    sets.map(|categories| compare(categories, &train, &test))
        .collect()
}

/// `[clips][15]` rows of features.
fn performances(speaker: &Speaker, wish: &Wish, clips: &[&Clip]) -> Result<Vec<Vec<Vec<f64>>>> {
    let each = clips.iter().map(|clip| {
        let moods = (0..EMOTIONS.len()).map(|e| {
            let wish = with_emotion(wish, e, 1.0);
            Ok(features(&speaker.speak(clip, &wish)?))
        });
        moods.collect::<Result<_>>()
    });
    each.collect()
}

/// Mean and standard deviation over time of every coordinate, `[408]` millimetres.
fn features(motion: &Array3<f64>) -> Vec<f64> {
    let mean = motion.mean_axis(Axis(0)).unwrap_or_default();
    let deviation = motion.std_axis(Axis(0), 0.0);
    mean.iter().chain(&deviation).map(|x| x * MM).collect()
}

fn compare(
    categories: Vec<&'static str>,
    train: &[Vec<Vec<f64>>],
    test: &[Vec<Vec<f64>>],
) -> Result<Separability> {
    let number = |name: &&str| EMOTIONS.iter().position(|e| e == name).unwrap_or(0);
    let chosen: Vec<usize> = categories.iter().map(number).collect();
    let rows = train.iter().flat_map(|clip| {
        let each = chosen.iter().enumerate();
        each.map(|(class, e)| (clip[*e].clone(), class))
    });
    let classifier = Classifier::fit(&rows.collect::<Vec<_>>(), chosen.len())?;
    let answers: Vec<Vec<usize>> = test
        .iter()
        .map(|clip| {
            chosen
                .iter()
                .map(|e| classifier.classify(&clip[*e]))
                .collect()
        })
        .collect();
    let mut confusion = vec![vec![0; chosen.len()]; chosen.len()];
    for clip in &answers {
        for (asked, recognised) in clip.iter().enumerate() {
            confusion[asked][*recognised] += 1;
        }
    }
    let accuracy = |clips: &[&Vec<usize>]| {
        let right = |clip: &&Vec<usize>| clip.iter().enumerate().filter(|(a, r)| a == *r).count();
        let right: usize = clips.iter().map(right).sum();
        (!clips.is_empty()).then(|| PER_CENT * right as f64 / (clips.len() * chosen.len()) as f64)
    };
    Ok(Separability {
        train_clips: train.len(),
        test_clips: test.len(),
        accuracy_percent: estimate(&answers, accuracy),
        confusion,
        categories,
    })
}

/// The curve of every category but neutral; none with too few clips.
pub(super) fn intensity(
    speaker: &Speaker,
    wish: &Wish,
    clips: &[Clip],
) -> Result<Vec<IntensityCurve>> {
    let count = INTENSITY_CLIPS.min(clips.len() / 2);
    if count == 0 {
        return Ok(Vec::new());
    }
    let (choosing, measuring) = clips.split_at(count);
    let measuring = &measuring[..count];
    let still = |clips: &[Clip]| -> Result<Vec<Array3<f64>>> {
        clips.iter().map(|clip| speaker.speak(clip, wish)).collect()
    };
    let (choosing_still, measuring_still) = (still(choosing)?, still(measuring)?);
    let curves = (1..EMOTIONS.len()).map(|e| {
        let shift = |clips, still, intensity| {
            mean_shift(speaker, &with_emotion(wish, e, intensity), clips, still)
        };
        let landmarks = most_moved(&shift(choosing, &choosing_still, 1.0)?);
        let mut mm = vec![0.0];
        for intensity in INTENSITIES {
            let moved = shift(measuring, &measuring_still, intensity)?;
            let sum: f64 = landmarks.iter().map(|n| length(&moved, *n)).sum();
            mm.push(MM * sum / landmarks.len() as f64);
        }
        Ok(IntensityCurve {
            emotion: EMOTIONS[e],
            landmarks,
            grows: mm.windows(2).all(|pair| pair[1] > pair[0]),
            mm,
        })
    });
    curves.collect()
}

/// The same wish with one category of [`EMOTIONS`].
pub(super) fn with_emotion(wish: &Wish, category: usize, intensity: f32) -> Wish {
    let mut mixture = [0.0; 15];
    mixture[category] = 1.0;
    Wish {
        emotion: Emotion { mixture, intensity },
        ..wish.clone()
    }
}

/// Mean over clips and frames of the difference to the performances at intensity 0, `[68, 3]`.
fn mean_shift(
    speaker: &Speaker,
    wish: &Wish,
    clips: &[Clip],
    still: &[Array3<f64>],
) -> Result<Array2<f64>> {
    let mut sum = Array2::zeros((LANDMARKS, 3));
    for (clip, still) in clips.iter().zip(still) {
        let shift = speaker.speak(clip, wish)? - still;
        sum += &shift.mean_axis(Axis(0)).unwrap_or_default();
    }
    Ok(sum / clips.len().max(1) as f64)
}

fn most_moved(shift: &Array2<f64>) -> Vec<usize> {
    let mut all: Vec<usize> = (0..LANDMARKS).collect();
    all.sort_by(|a, b| length(shift, *b).total_cmp(&length(shift, *a)));
    all.truncate(OWN_LANDMARKS);
    all.sort_unstable();
    all
}

fn length(shift: &Array2<f64>, n: usize) -> f64 {
    shift.row(n).iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_basic_emotion_is_a_category() {
        assert!(BASIC.iter().all(|name| EMOTIONS.contains(name)));
    }

    #[test]
    fn features_are_means_then_deviations() {
        let mut motion = Array3::zeros((2, LANDMARKS, 3));
        motion[[0, 0, 0]] = 0.001;
        motion[[1, 0, 0]] = 0.003;
        let found = features(&motion);
        assert_eq!(found.len(), 408);
        assert!((found[0] - 2.0).abs() < 1e-12 && (found[204] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_most_moved_landmarks_are_found() {
        let mut shift = Array2::zeros((LANDMARKS, 3));
        for n in 40..52 {
            shift[[n, 1]] = -1.0;
        }
        assert_eq!(most_moved(&shift), (40..52).collect::<Vec<_>>());
    }

    #[test]
    fn answers_fill_the_confusion() {
        let row = |e: usize, clip: usize| -> Vec<f64> {
            (0..15)
                .map(|f| f64::from(u8::from(f == e)) + 0.01 * clip as f64)
                .collect()
        };
        let clips: Vec<Vec<Vec<f64>>> = (0..3)
            .map(|clip| (0..15).map(|e| row(e, clip)).collect())
            .collect();
        let found = compare(BASIC.to_vec(), &clips, &clips).unwrap();
        assert_eq!(found.accuracy_percent.unwrap().value, 100.0);
        assert_eq!(found.confusion[2][2], 3);
    }
}
