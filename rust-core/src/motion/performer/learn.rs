//! Learns a performer from sounds and the motion of the face that spoke them.
//!
//! The strength of the ridge is chosen on parts of the takes that are left out in turn.

use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis, concatenate};

use super::{
    AspectScore, LearnedTake, Performer, PerformerCard, VERSION, add_row, aim,
    read_out::{ReadOut, mean_row},
};
use crate::{
    Error, Result,
    mesh::ibug::speaking,
    motion::{
        LandmarkClip, at_rate,
        contacts::{gap, width},
    },
};

/// Ridges to choose from, per second of sound.
const RIDGES: [f64; 6] = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0];
/// Into how many sets the parts of all takes are dealt.
const FOLDS: usize = 5;
/// Length of a part that is left out, seconds. Shorter ones would have neighbours in the fit.
const PART_S: f64 = 2.0;
/// The least speech that is enough, seconds.
const LEAST_SPEECH_S: f64 = 3.0;
/// The least time in which nobody speaks that says what a face at rest looks like, seconds.
const LEAST_QUIET_S: f64 = 0.3;
/// The largest lag of a motion behind its sound that is looked for, seconds.
const LARGEST_LAG_S: f64 = 0.4;
/// A lag counts if it raises the correlation of the lips by as much as this.
const LAG_GAIN: f64 = 0.05;
/// Two halves of a take whose lags differ by more than this drift apart, seconds.
const DRIFT_S: f64 = 0.2;
/// The least length of such a half, seconds: the lag of a shorter one says little.
const LEAST_HALF_S: f64 = 5.0;
/// A face whose lips part by less than this, root mean square, does not speak. Metres.
const STILL_M: f64 = 2e-4;
/// A face whose lips follow the model's speaker less than this says something else.
const UNLIKE: f64 = 0.15;
/// The share of the squared difference that has to stay unexplained at most, on parts left out.
const MOST_LEFT: f64 = 0.97;
/// Takes that differ from the model by less than this teach nothing, root mean square. Metres.
const EQUAL_M: f64 = 1e-6;

/// A take to learn from: 25 or so frames a second of one sound.
#[derive(Debug, Clone)]
pub struct Lesson {
    /// A name for messages and the card.
    pub name: String,
    /// Features of the sound `[T, C]`, at the rate of the motion of the model's speaker.
    pub features: Array2<f32>,
    /// What the model's own speaker does with the sound, without noise and contacts.
    pub model: LandmarkClip,
    /// What the person's face did, from the start of the sound on. Its rest is taken from the frames in which
    /// nobody speaks.
    pub captured: LandmarkClip,
    /// What had been generated before somebody corrected it into `captured`. Then only the corrections are
    /// learned, and the rest pose stays.
    pub generated: Option<LandmarkClip>,
    /// `[T]`, how much each frame of `captured` counts, above 0. `None` counts all alike.
    pub frame_weights: Option<Array1<f32>>,
    /// `[T]`, whether somebody speaks.
    pub speaks: Vec<bool>,
}

/// Learns how a person's mouth differs from that of the model's speaker. `system` is the name of the system of
/// that speaker, `encoder` that of the speech encoder of the features.
///
/// # Errors
/// `InvalidInput` for takes that are too short, whose face is still, says something else or drifts against the
/// sound, that equal what the model does, of which some were corrected and others not, and if the result would follow
/// the person no better than the model's speaker does.
pub fn learn(system: &str, encoder: &str, lessons: Vec<Lesson>) -> Result<Performer> {
    let corrects = check_kind(&lessons)?;
    let prepared = lessons
        .iter()
        .map(Prepared::new)
        .collect::<Result<Vec<_>>>()?;
    check_length(&prepared)?;
    let all = Rows::of(&prepared);
    let folds = Folds::of(&prepared);
    let tried = RIDGES.iter().map(|&ridge| {
        let predicted = folds.predicted(&all, ridge);
        let left = all.sum_of_squares(&(&all.difference - &predicted));
        (left, ridge, predicted)
    });
    let best = tried.min_by(|a, b| a.0.total_cmp(&b.0));
    let (left, ridge, predicted) = best.expect("there are ridges to choose from");
    check_gain(&all, left, corrects)?;
    // A correction stays as large as it is.
    let (all, predicted) = if corrects {
        (all, predicted)
    } else {
        let all = aimed(all, &prepared, &folds, ridge);
        let predicted = folds.predicted(&all, ridge);
        (all, predicted)
    };
    let read_out = all.fit(ridge);
    Ok(Performer {
        card: PerformerCard {
            version: VERSION,
            system: system.to_owned(),
            encoder: encoder.to_owned(),
            corrects,
            takes: prepared.iter().map(|take| take.card.clone()).collect(),
            ridge,
            scores: scores(&prepared, &predicted),
            live_scores: Vec::new(),
            live_refusal: "its system has no such stream".into(),
        },
        read_out,
        live: None,
    })
}

/// The rows with a difference by which the fit moves as far as the person.
fn aimed(mut all: Rows, takes: &[Prepared], folds: &Folds, ridge: f64) -> Rows {
    let stack = |of: fn(&Prepared) -> &LandmarkClip| {
        let parts: Vec<_> = takes.iter().map(|take| spoken(of(take))).collect();
        let parts: Vec<_> = parts.iter().map(|part| part.view()).collect();
        concatenate(Axis(0), &parts).expect("takes have the same landmarks")
    };
    let (model, person) = (stack(|take| &take.model), stack(|take| &take.captured));
    let lengths: Vec<usize> = takes.iter().map(|take| take.features.nrows()).collect();
    let added = aim::beyond(&person, &lengths, |added| {
        let further = Rows {
            difference: &all.difference + added,
            features: all.features.clone(),
            frame_weights: all.frame_weights.clone(),
            seconds: all.seconds,
        };
        &model + &folds.predicted(&further, ridge)
    });
    all.difference += &added;
    all
}

/// Whether the takes were corrected, all or none.
fn check_kind(lessons: &[Lesson]) -> Result<bool> {
    let corrected = lessons.iter().filter(|lesson| lesson.generated.is_some());
    match corrected.count() {
        0 => Ok(false),
        count if count == lessons.len() => Ok(true),
        count => Err(Error::InvalidInput(format!(
            "performer: expected takes that were all corrected or all captured, got {count} of {} with \
             generated_displacements: learn two performers",
            lessons.len()
        ))),
    }
}

/// Refuses a fit that leaves `left` of the squared difference unexplained, if this is nearly all.
fn check_gain(all: &Rows, left: f64, is_correction: bool) -> Result<()> {
    let refuse = |why: String| {
        Err(Error::InvalidInput(format!(
            "performer: expected takes {why}"
        )))
    };
    let without = all.sum_of_squares(&(&all.difference - &all.mean_difference()));
    if without < EQUAL_M.powi(2) * all.difference.len() as f64 {
        return refuse(
            "that differ from what the model does, got equal ones: correct one of them by hand, or give those of \
             another speaker"
                .into(),
        );
    }
    if left < MOST_LEFT * without {
        return Ok(());
    }
    let next = if is_correction {
        "correct the same sound in more words"
    } else {
        "give more takes, or check that sound and motion belong together"
    };
    refuse(format!(
        "whose left out parts it follows better than the model does, got {:.0} % of the difference unexplained: {next}",
        100.0 * left / without
    ))
}

/// A take whose lag and rest are taken off.
struct Prepared {
    card: LearnedTake,
    fps: f64,
    features: Array2<f32>,
    /// The model's speaker, or what was generated before the correction, and the person, with the same number of
    /// frames.
    model: LandmarkClip,
    captured: LandmarkClip,
    /// Person less model, `[T, 3 L]`, less what it is at rest.
    difference: Array2<f32>,
    /// `[T]`.
    frame_weights: Array1<f32>,
    spoken: usize,
}

impl Prepared {
    fn new(lesson: &Lesson) -> Result<Prepared> {
        let fps = lesson.model.fps;
        let refuse = |why: String| Error::InvalidInput(format!("{}: {why}", lesson.name));
        let count = (lesson.captured.displacements.len_of(Axis(0)) as f64 / lesson.captured.fps
            * fps) as usize;
        let captured = lesson.captured.at_rate(fps, count);
        let frame_weights = match &lesson.frame_weights {
            Some(counts) => at_rate(counts.view(), lesson.captured.fps / fps, count),
            None => Array1::ones(count),
        };
        let frames = lesson.model.displacements.len_of(Axis(0));
        let generated = lesson.generated.as_ref();
        let model =
            generated.map_or_else(|| lesson.model.clone(), |clip| clip.at_rate(fps, frames));
        let (heard, seen) = (gaps(&model), gaps(&captured));
        if deviation(&seen) < STILL_M {
            return Err(refuse(format!(
                "expected a face that speaks, got lips that part by {:.2} mm",
                1e3 * deviation(&seen)
            )));
        }
        let (lag, r) = lag_of(&heard, &seen, fps);
        if r < UNLIKE {
            return Err(refuse(format!(
                "expected a face that says what is heard, got lips that follow the sound with a correlation of {r:.2}: \
                 check that sound and motion belong together and begin together"
            )));
        }
        check_drift(&heard, &seen, fps).map_err(refuse)?;
        // Frame t of the sound is seen in frame t + lag.
        let (from, to) = (lag.max(0) as usize, (-lag).max(0) as usize);
        let frames = (seen.len() - from.min(seen.len())).min(heard.len() - to.min(heard.len()));
        let part = |clip: &LandmarkClip, first: usize| LandmarkClip {
            displacements: clip
                .displacements
                .slice(ndarray::s![first..first + frames, .., ..])
                .to_owned(),
            fps,
        };
        let (model, captured) = (part(&model, to), part(&captured, from));
        let speaks = &lesson.speaks[to..to + frames];
        let mut difference = spoken(&captured) - spoken(&model);
        if generated.is_none() {
            difference -= &at_rest(&difference, speaks, fps);
        }
        Ok(Prepared {
            card: LearnedTake {
                name: lesson.name.clone(),
                seconds: frames as f64 / fps,
                lag_s: lag as f64 / fps,
            },
            fps,
            features: lesson
                .features
                .slice(ndarray::s![to..to + frames, ..])
                .to_owned(),
            difference,
            frame_weights: frame_weights
                .slice(ndarray::s![from..from + frames])
                .to_owned(),
            model,
            captured,
            spoken: speaks.iter().filter(|speaks| **speaks).count(),
        })
    }
}

fn check_length(takes: &[Prepared]) -> Result<()> {
    let spoken_s: f64 = takes.iter().map(|take| take.spoken as f64 / take.fps).sum();
    if spoken_s < LEAST_SPEECH_S {
        return Err(Error::InvalidInput(format!(
            "performer: expected takes with {LEAST_SPEECH_S} s of speech or more, best 15 s, got {spoken_s:.1} s"
        )));
    }
    Ok(())
}

/// The mean of rows `[T, 3 L]` over frames in which nobody speaks, or over all if these are too few: captures rest in
/// other poses than meshes.
fn at_rest(difference: &Array2<f32>, speaks: &[bool], fps: f64) -> Array1<f32> {
    let quiet: Vec<usize> = (0..speaks.len()).filter(|t| !speaks[*t]).collect();
    let mean = if quiet.len() as f64 >= LEAST_QUIET_S * fps {
        difference.select(Axis(0), &quiet).mean_axis(Axis(0))
    } else {
        difference.mean_axis(Axis(0))
    };
    mean.unwrap_or_else(|| Array1::zeros(difference.ncols()))
}

/// Jaw and mouth of a clip, `[T, 3 L]`.
fn spoken(clip: &LandmarkClip) -> Array2<f32> {
    let landmarks: Vec<usize> = speaking().collect();
    let size = (clip.displacements.dim().0, 3 * landmarks.len());
    let value = |(t, i): (usize, usize)| clip.displacements[[t, landmarks[i / 3], i % 3]];
    Array2::from_shape_fn(size, value)
}

/// The frames of all takes, one below the other.
struct Rows {
    features: Array2<f32>,
    difference: Array2<f32>,
    frame_weights: Array1<f32>,
    seconds: f64,
}

impl Rows {
    fn of(takes: &[Prepared]) -> Rows {
        let counts: Vec<ArrayView1<'_, f32>> =
            takes.iter().map(|take| take.frame_weights.view()).collect();
        let stack = |of: fn(&Prepared) -> ArrayView2<'_, f32>| {
            let parts: Vec<_> = takes.iter().map(of).collect();
            concatenate(Axis(0), &parts).expect("takes have the same features")
        };
        Rows {
            features: stack(|take| take.features.view()),
            difference: stack(|take| take.difference.view()),
            frame_weights: concatenate(Axis(0), &counts).expect("rows of one number"),
            seconds: takes.iter().map(|take| take.card.seconds).sum(),
        }
    }

    fn select(&self, rows: &[usize]) -> Rows {
        Rows {
            features: self.features.select(Axis(0), rows),
            difference: self.difference.select(Axis(0), rows),
            frame_weights: self.frame_weights.select(Axis(0), rows),
            seconds: self.seconds * rows.len() as f64 / self.features.nrows() as f64,
        }
    }

    fn fit(&self, ridge: f64) -> ReadOut {
        let ridge = ridge * self.seconds;
        ReadOut::fit(&self.features, &self.difference, &self.frame_weights, ridge)
    }

    fn mean_difference(&self) -> Array1<f32> {
        mean_row(&self.difference, &self.frame_weights)
    }

    /// The sum of the squares of `values` `[T, N]`, each row as often as its frame counts.
    fn sum_of_squares(&self, values: &Array2<f32>) -> f64 {
        let square = |(row, count): (ArrayView1<'_, f32>, &f32)| {
            f64::from(*count) * row.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>()
        };
        values
            .outer_iter()
            .zip(&self.frame_weights)
            .map(square)
            .sum()
    }
}

/// The number of the set of each row. The rows of a set are left out together.
struct Folds(Vec<usize>);

impl Folds {
    fn of(takes: &[Prepared]) -> Folds {
        let (mut folds, mut part) = (Vec::new(), 0);
        for take in takes {
            let length = ((PART_S * take.fps) as usize).max(1);
            let rows = take.features.nrows();
            folds.extend((0..rows).map(|row| (part + row / length) % FOLDS));
            part += rows.div_ceil(length);
        }
        Folds(folds)
    }

    /// The difference `[T, 3 L]` of each set by a fit on the others.
    fn predicted(&self, all: &Rows, ridge: f64) -> Array2<f32> {
        let mut out = Array2::zeros(all.difference.dim());
        for number in 0..FOLDS {
            let (fold, others): (Vec<usize>, Vec<usize>) =
                (0..self.0.len()).partition(|row| self.0[*row] == number);
            if fold.is_empty() {
                continue;
            }
            let fit = all.select(&others).fit(ridge);
            let predicted = fit.at(all.features.select(Axis(0), &fold).view());
            for (row, values) in fold.iter().zip(predicted.outer_iter()) {
                out.row_mut(*row).assign(&values);
            }
        }
        out
    }
}

fn gaps(clip: &LandmarkClip) -> Vec<f64> {
    clip.displacements
        .outer_iter()
        .map(|face| f64::from(gap(face)))
        .collect()
}

fn deviation(curve: &[f64]) -> f64 {
    let mean = curve.iter().sum::<f64>() / curve.len().max(1) as f64;
    (curve.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / curve.len().max(1) as f64).sqrt()
}

/// By how many frames `seen` lags behind `heard`, and the correlation at that lag.
fn lag_of(heard: &[f64], seen: &[f64], fps: f64) -> (isize, f64) {
    let most = (LARGEST_LAG_S * fps).round() as isize;
    let at = |lag: isize| {
        let from = &seen[(lag.max(0) as usize).min(seen.len())..];
        let to = &heard[((-lag).max(0) as usize).min(heard.len())..];
        correlation(to, from)
    };
    let plain = at(0);
    let best = (-most..=most)
        .max_by(|a, b| at(*a).total_cmp(&at(*b)))
        .unwrap_or(0);
    if at(best) > plain + LAG_GAIN {
        (best, at(best))
    } else {
        (0, plain)
    }
}

fn check_drift(heard: &[f64], seen: &[f64], fps: f64) -> Result<(), String> {
    let frames = heard.len().min(seen.len());
    let half = frames / 2;
    let lag = |range: std::ops::Range<usize>| lag_of(&heard[range.clone()], &seen[range], fps);
    let (first, second) = (lag(0..half), lag(half..frames));
    let apart_s = (first.0 - second.0).abs() as f64 / fps;
    if half as f64 >= LEAST_HALF_S * fps
        && apart_s > DRIFT_S
        && first.1.min(second.1) > 2.0 * UNLIKE
    {
        return Err(format!(
            "expected motion that keeps to its sound, got one that lags by {:.2} s in the first half and by {:.2} s in the \
             second: check its frame rate",
            first.0 as f64 / fps,
            second.0 as f64 / fps
        ));
    }
    Ok(())
}

/// Pearson's correlation of the first values that both have; 0 where one of them is constant.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len().min(b.len());
    let (a, b) = (&a[..count], &b[..count]);
    let mean = |x: &[f64]| x.iter().sum::<f64>() / count.max(1) as f64;
    let (at, bt) = (mean(a), mean(b));
    let product: f64 = a.iter().zip(b).map(|(x, y)| (x - at) * (y - bt)).sum();
    let size = deviation(a) * deviation(b) * count as f64;
    if size > 0.0 { product / size } else { 0.0 }
}

/// The slope of `of` over `over`.
fn slope(of: &[f64], over: &[f64]) -> f64 {
    correlation(of, over) * deviation(of) / deviation(over).max(1e-12)
}

/// A name, and what it measures of a face `[68, 3]`.
type Aspect = (&'static str, fn(ArrayView2<'_, f32>) -> f32);

/// Scores on the parts that were left out, `predicted` `[T, 3 L]` over all takes: means over takes.
fn scores(takes: &[Prepared], predicted: &Array2<f32>) -> Vec<AspectScore> {
    let aspects: [Aspect; 4] = [
        ("gap", gap),
        ("width", width),
        ("chin", |face| -face[[8, 1]]),
        ("protrusion", |face| {
            face.slice(ndarray::s![48.., 2]).mean().unwrap_or(0.0)
        }),
    ];
    let mut rows = predicted.outer_iter();
    let clips: Vec<LandmarkClip> = takes
        .iter()
        .map(|take| {
            let mut clip = take.model.clone();
            for (mut face, row) in clip.displacements.outer_iter_mut().zip(&mut rows) {
                add_row(&mut face, row, 1.0);
            }
            clip
        })
        .collect();
    let score = |(name, of): Aspect| {
        let curve = |clip: &LandmarkClip| -> Vec<f64> {
            clip.displacements
                .outer_iter()
                .map(|face| f64::from(of(face)))
                .collect()
        };
        let mean = |measure: fn(&[f64], &[f64]) -> f64, with: bool| {
            let each = takes.iter().zip(&clips).map(|(take, clip)| {
                measure(
                    &curve(if with { clip } else { &take.model }),
                    &curve(&take.captured),
                )
            });
            each.sum::<f64>() / takes.len() as f64
        };
        AspectScore {
            name: name.to_owned(),
            r: mean(correlation, true),
            slope: mean(slope, true),
            r_without: mean(correlation, false),
            slope_without: mean(slope, false),
        }
    };
    aspects.into_iter().map(score).collect()
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    /// A take of `frames` frames: the person opens the mouth twice as far as the model, and smiles where the second
    /// feature is high, which the model does not.
    fn lesson(frames: usize, lag: usize) -> Lesson {
        let wave = |t: usize, rate: f32| (t as f32 * rate).sin();
        let features = Array2::from_shape_fn((frames, 3), |(t, c)| wave(t, [0.5, 0.13, 0.029][c]));
        let mut model = Array3::zeros((frames, 68, 3));
        let mut captured = Array3::zeros((frames + lag, 68, 3));
        for t in 0..frames {
            let (open, wide) = (0.003 * features[[t, 0]], 0.004 * features[[t, 1]]);
            model[[t, 66, 1]] = -open;
            captured[[t + lag, 66, 1]] = -2.0 * open + 0.01;
            captured[[t + lag, 54, 0]] = wide;
        }
        let clip = |displacements| LandmarkClip {
            displacements,
            fps: 25.0,
        };
        Lesson {
            name: "take".into(),
            features,
            model: clip(model),
            captured: clip(captured),
            generated: None,
            frame_weights: None,
            speaks: vec![true; frames],
        }
    }

    #[test]
    fn a_person_is_learned_with_lag_and_rest_taken_off() {
        let learned = learn("freetalk", "ear", vec![lesson(300, 3)]).unwrap();
        assert_eq!(learned.card().takes[0].lag_s, 3.0 / 25.0);
        let score = |name: &str| {
            learned
                .card()
                .scores
                .iter()
                .find(|score| score.name == name)
                .unwrap()
        };
        assert!(
            score("gap").r > 0.99 && (score("gap").slope - 1.0).abs() < 0.1,
            "{:?}",
            score("gap")
        );
        assert!(
            score("width").r > 0.98 && score("width").r_without.abs() < 0.1,
            "{:?}",
            score("width")
        );
        let other = lesson(120, 0);
        let mut moved = other.model.displacements.clone();
        learned
            .add_to(moved.view_mut(), (other.features.view(), "ear"), 1.0)
            .unwrap();
        let wide = moved[[60, 54, 0]] - moved[[0, 54, 0]];
        let expected =
            other.captured.displacements[[60, 54, 0]] - other.captured.displacements[[0, 54, 0]];
        assert!((wide - expected).abs() < 4e-4, "{wide} {expected}");
        assert!((moved[[60, 66, 1]] - 2.0 * other.model.displacements[[60, 66, 1]]).abs() < 6e-4);
        assert!(
            learned
                .add_to(moved.view_mut(), (other.features.view(), "hubert"), 1.0)
                .is_err()
        );
    }

    /// A generated take that an artist corrected: the corners come in where the second feature is high, in few
    /// frames.
    fn corrected(frames: usize) -> Lesson {
        let mut corrected = lesson(frames, 0);
        let mut generated = corrected.model.clone();
        // What a generated take has beside the model's own speaker must not be learned.
        generated.displacements.mapv_inplace(|x| 1.2 * x + 0.002);
        corrected.captured = generated.clone();
        for t in (0..frames).filter(|t| corrected.features[[*t, 1]] > 0.9) {
            corrected.captured.displacements[[t, 54, 0]] -= 0.004;
        }
        corrected.generated = Some(generated);
        corrected
    }

    #[test]
    fn of_a_corrected_take_the_corrections_alone_are_learned() {
        let learned = learn("freetalk", "ear", vec![corrected(400)]).unwrap();
        let still = |c: usize| Array2::from_shape_fn((1, 3), |(_, i)| f32::from(i == c));
        let moved = |features: &Array2<f32>| {
            let mut face = Array3::zeros((1, 68, 3));
            learned
                .add_to(face.view_mut(), (features.view(), "ear"), 1.0)
                .unwrap();
            (face[[0, 54, 0]], face[[0, 66, 1]])
        };
        let (corner, lip) = moved(&still(1));
        assert!(corner < -0.001 && lip.abs() < 1e-4, "{corner} {lip}");
        assert!(moved(&still(0)).1.abs() < 1e-4);
    }

    #[test]
    fn frames_count_as_often_as_they_say() {
        let (plain, counted) = (lesson(300, 0), lesson(300, 0));
        let alike = Lesson {
            frame_weights: Some(Array1::ones(300)),
            ..counted
        };
        let learned = learn("freetalk", "ear", vec![plain]).unwrap();
        assert_eq!(learn("freetalk", "ear", vec![alike]).unwrap(), learned);

        // A second part that contradicts the first hardly counts.
        let doubtful = |count: f32| {
            let mut take = lesson(600, 0);
            for t in 300..600 {
                take.captured.displacements[[t, 54, 0]] *= -1.0;
            }
            let counts = (0..600).map(|t| if t < 300 { 1.0 } else { count });
            take.frame_weights = Some(counts.collect());
            learn("freetalk", "ear", vec![take]).map(|learned| {
                let mut face = Array3::zeros((1, 68, 3));
                let features = ndarray::array![[0.0, 1.0, 0.0]];
                learned
                    .add_to(face.view_mut(), (features.view(), "ear"), 1.0)
                    .unwrap();
                face[[0, 54, 0]]
            })
        };
        let (counted, ignored) = (doubtful(1.0).unwrap(), doubtful(0.001).unwrap());
        assert!(
            ignored > 0.003 && counted < 0.5 * ignored,
            "{counted} {ignored}"
        );
    }

    #[test]
    fn a_file_gives_the_same_performer_and_damage_is_told() {
        let learned = learn("freetalk", "ear", vec![lesson(300, 0)]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.performer");
        learned.write(&path).unwrap();
        assert_eq!(Performer::read(&path).unwrap(), learned);
        let bytes = std::fs::read(&path).unwrap();
        for length in (0..bytes.len()).step_by(97) {
            assert!(Performer::from_bytes(&bytes[..length]).is_err(), "{length}");
        }
        std::fs::write(&path, b"performer").unwrap();
        let error = Performer::read(&path).unwrap_err().to_string();
        assert!(error.contains("performer learn"), "{error}");
    }

    #[test]
    fn takes_that_teach_nothing_are_refused_with_the_reason() {
        let mixed = vec![lesson(300, 0), corrected(300)];
        let error = learn("freetalk", "ear", mixed).unwrap_err().to_string();
        assert!(error.contains("1 of 2"), "{error}");
        let refusal = |change: fn(&mut Lesson)| {
            let mut taken = lesson(300, 0);
            change(&mut taken);
            learn("freetalk", "ear", vec![taken])
                .unwrap_err()
                .to_string()
        };
        for (change, reason) in [
            (
                (|take| take.captured.displacements.fill(0.0)) as fn(&mut Lesson),
                "got lips that part by 0.00 mm",
            ),
            (
                |take| {
                    let other = take.features.column(2).to_owned();
                    let mut lip = take
                        .captured
                        .displacements
                        .slice_mut(ndarray::s![.., 66, 1]);
                    lip.assign(&(0.003 * other));
                },
                "says what is heard",
            ),
            (|take| take.speaks.fill(false), "3 s of speech"),
            (|take| take.captured = take.model.clone(), "got equal ones"),
            (
                |take| take.features.fill(0.0),
                "follows better than the model",
            ),
        ] {
            let error = refusal(change);
            assert!(error.contains(reason), "{error}");
        }
    }
}
