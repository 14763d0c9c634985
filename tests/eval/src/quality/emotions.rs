//! Emotion: whether the face performs each category as the table of expressions says, and whether a
//! higher intensity moves it further.

use std::path::Path;

use ndarray::{Array2, Array3, Axis};
use serde::Serialize;

use super::{
    clip::Clip,
    speaker::{Speaker, Wish},
};
use anyface::{
    Result,
    conditions::{EMOTIONS, Emotion},
    mesh::ibug::LANDMARKS,
    motion::Expressions,
};

/// Clips to measure intensity on. As many other clips serve to choose the landmarks.
const INTENSITY_CLIPS: usize = 4;
/// Intensities to measure, other than 0.
pub(super) const INTENSITIES: [f32; 6] = [0.25, 0.5, 0.75, 1.0, 1.25, 1.5];
/// How many landmarks to measure: those that the emotion moves most.
pub(super) const OWN_LANDMARKS: usize = 12;
const MM: f64 = 1000.0;
const PER_CENT: f64 = 100.0;

/// One category at rising intensity.
#[derive(Debug, Clone, Serialize)]
pub(super) struct IntensityCurve {
    pub emotion: &'static str,
    /// The landmarks that the emotion moves most.
    pub landmarks: Vec<usize>,
    /// Mean displacement of `landmarks` from their motion at intensity 0, mm, at 0 and
    /// [`INTENSITIES`].
    pub mm: Vec<f64>,
    /// Whether `mm` grows at every step.
    pub grows: bool,
    /// Projection of the expression at intensity 1 onto the table's prototype, % of the prototype.
    pub projection_percent: f64,
}

/// Measures the curve of every category except neutral. Empty for fewer than two clips.
pub(super) fn intensity(
    speaker: &Speaker,
    wish: &Wish,
    weights: Option<&Path>,
    clips: &[Clip],
) -> Result<Vec<IntensityCurve>> {
    let table = Expressions::open(weights)?;
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
        let mut projection = 0.0;
        for intensity in INTENSITIES {
            let moved = shift(measuring, &measuring_still, intensity)?;
            if intensity == 1.0 {
                projection = projection_percent(&moved, &prototype(&table, e));
            }
            let sum: f64 = landmarks.iter().map(|n| length(&moved, *n)).sum();
            mm.push(MM * sum / landmarks.len() as f64);
        }
        Ok(IntensityCurve {
            emotion: EMOTIONS[e],
            landmarks,
            grows: mm.windows(2).all(|pair| pair[1] > pair[0]),
            mm,
            projection_percent: projection,
        })
    });
    curves.collect()
}

/// The expression of a category at intensity 1 in the table of expressions, `[68, 3]` metres.
fn prototype(table: &Expressions, category: usize) -> Array2<f64> {
    let mut affect = Array2::zeros((1, EMOTIONS.len() + 1));
    affect[[0, category]] = 1.0;
    affect[[0, EMOTIONS.len()]] = 1.0;
    let settled = table.alone(affect.view(), 25.0, 1.0);
    settled.index_axis(Axis(0), 0).mapv(f64::from)
}

fn projection_percent(shift: &Array2<f64>, prototype: &Array2<f64>) -> f64 {
    let power: f64 = prototype.iter().map(|x| x * x).sum();
    PER_CENT * (shift * prototype).sum() / power.max(f64::MIN_POSITIVE)
}

/// The same wish, but with one category of [`EMOTIONS`] at `intensity`.
pub(super) fn with_emotion(wish: &Wish, category: usize, intensity: f32) -> Wish {
    let mut mixture = [0.0; 15];
    mixture[category] = 1.0;
    Wish {
        emotion: Emotion { mixture, intensity },
        ..wish.clone()
    }
}

/// Mean difference from the motion at intensity 0, over clips and frames, `[68, 3]`.
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
    fn the_most_moved_landmarks_are_found() {
        let mut shift = Array2::zeros((LANDMARKS, 3));
        for n in 40..52 {
            shift[[n, 1]] = -1.0;
        }
        assert_eq!(most_moved(&shift), (40..52).collect::<Vec<_>>());
    }

    #[test]
    fn the_projection_is_the_share_along_the_prototype() {
        let mut prototype = Array2::zeros((LANDMARKS, 3));
        prototype[[19, 1]] = -2.0;
        let mut shift = &prototype * 0.6;
        shift[[20, 0]] = 5.0;
        assert!((projection_percent(&shift, &prototype) - 60.0).abs() < 1e-9);
    }
}
