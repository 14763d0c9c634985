//! grid_s1: 909 clips of one man, tracked frame by frame by MediaPipe Face Landmarker at 25 fps.
//!
//! GRID corpus, CC BY 4.0 (Cooke, Barker, Cunningham & Shao 2006). It is cleaned as in
//! `training/corpus/grid.py`. The track comes without the pose of the head. Lost frames are filled
//! in but not scored, and the track is smoothed lightly. Then it is rotated, without scaling, so
//! that the speaker's neutral face fits ICT's. The eyes blink and look down at the text, which has
//! nothing to do with speech, so their landmarks are not scored.

use std::{ops::Range, path::Path};

use ndarray::{Array2, Array3, ArrayView2, Axis, Slice};

use super::clip::{Clip, Corpus};
use crate::metrics::quantile;
use crate::{face_model::IctLandmarks, tensors::TensorFile};
use anyface::{
    Result,
    audio::Waveform,
    mesh::{Similarity, ibug::LANDMARKS},
};

/// Path of the track in the data folder.
pub(crate) const TRACK: &str = "motion/grid_s1/face_track.safetensors";
/// Frame rate of the video.
pub(super) const FPS: f64 = 25.0;
const UNITS_PER_CM: f64 = 2000.0;
const METRES_PER_CM: f64 = 0.01;
const SMOOTHING_FRAMES: f64 = 0.6;
const REST_SHARE: f64 = 0.05;
/// Silent frames at either end of a clip.
const EDGE_FRAMES: usize = 6;
const EVERY: usize = 10;
/// The baselines are fitted to the clip with this index in every ten.
const FOR_BASELINES: usize = 5;
/// Eyes, nose and mouth.
const INNER: Range<usize> = 27..LANDMARKS;
const EYES: Range<usize> = 36..48;

/// The track of one clip.
struct Track {
    /// `[T, 68, 3]` centimetres, with lost frames filled in and smoothed.
    landmarks: Array3<f64>,
    /// `[T]`, whether the tracker saw the face.
    tracked: Vec<bool>,
}

/// Reads the corpus. Every tenth clip in the order of names is held out; `limit` bounds the
/// held-out clips and the training clips alike.
pub(super) fn read(data: &Path, ict: &IctLandmarks, limit: Option<usize>) -> Result<Corpus> {
    let file = TensorFile::read(&data.join(TRACK))?;
    let names = file.words("clips")?;
    let tracks = read_tracks(&file, names.len())?;
    let neutral = rest_template(&tracks);
    let turn = turn_to_ict(&neutral, ict)?;
    let place = |landmarks: ArrayView2<'_, f64>| landmarks.dot(&turn.t()) * METRES_PER_CM;
    let chosen = |remainder: usize| {
        let clips = every_tenth(&names, remainder);
        clips.into_iter().take(limit.unwrap_or(usize::MAX))
    };
    let load = |c: usize| -> Result<Clip> {
        let sound = format!("motion/grid_s1/audio/{}.ogg", names[c]);
        let track = &tracks[c];
        let mut motion = Array3::zeros(track.landmarks.dim());
        for (from, mut to) in track.landmarks.outer_iter().zip(motion.outer_iter_mut()) {
            to.assign(&place((&from - &neutral).view()));
        }
        Ok(Clip {
            name: names[c].clone(),
            waveform: Waveform::from_file(&data.join(sound))?,
            start_s: 0.0,
            motion,
            speaker: place(neutral.view()),
            neutral: ict.neutral.clone(),
            fps: FPS,
            observed: (0..LANDMARKS).filter(|n| !EYES.contains(n)).collect(),
            judged: longest_run(&track.tracked),
            phones: None,
        })
    };
    Ok(Corpus {
        source: "grid_s1".into(),
        recorded: true,
        held_out: chosen(0).map(load).collect::<Result<_>>()?,
        training: chosen(FOR_BASELINES).map(load).collect::<Result<_>>()?,
    })
}

/// Every tenth clip in the order of names, starting at index `remainder`. A remainder of 0 gives
/// the held-out clips.
pub(crate) fn every_tenth(names: &[String], remainder: usize) -> Vec<usize> {
    let mut sorted: Vec<usize> = (0..names.len()).collect();
    sorted.sort_by_key(|c| &names[*c]);
    let chosen = sorted.iter().skip(remainder).step_by(EVERY);
    chosen.copied().collect()
}

/// The frames of each clip within the track.
pub(crate) fn spans(file: &TensorFile, clips: usize) -> Result<Vec<Range<usize>>> {
    let (offsets, _) = file.floats("clip_offsets")?;
    let spans: Vec<_> = offsets
        .windows(2)
        .map(|w| w[0] as usize..w[1] as usize)
        .collect();
    if spans.len() == clips && spans.iter().all(|span| !span.is_empty()) {
        Ok(spans)
    } else {
        Err(file.bad(&format!(
            "clip_offsets: expected {} rising frame numbers, got {}",
            clips + 1,
            offsets.len()
        )))
    }
}

fn read_tracks(file: &TensorFile, clips: usize) -> Result<Vec<Track>> {
    let (values, shape) = file.floats("landmarks")?;
    let (tracked, _) = file.floats("found")?;
    let spans = spans(file, clips)?;
    let frames = spans.last().map_or(0, |span| span.end);
    if shape != [frames, LANDMARKS, 3] || tracked.len() != frames {
        return Err(file.bad(&format!(
            "expected landmarks [{frames}, 68, 3] and found [{frames}], got {shape:?} and [{}]",
            tracked.len()
        )));
    }
    let values = values.into_iter().map(|x| f64::from(x) / UNITS_PER_CM);
    let all = Array3::from_shape_vec((frames, LANDMARKS, 3), values.collect())
        .map_err(|e| file.bad(&e.to_string()))?;
    let track = |span: Range<usize>| {
        let tracked: Vec<bool> = tracked[span.clone()].iter().map(|x| *x > 0.0).collect();
        let raw = all.slice_axis(Axis(0), Slice::from(span)).to_owned();
        Track {
            landmarks: smoothed(&filled(&raw, &tracked)),
            tracked,
        }
    };
    Ok(spans.into_iter().map(track).collect())
}

/// The longest run of tracked frames.
fn longest_run(tracked: &[bool]) -> Range<usize> {
    let mut best = 0..0;
    let mut start = 0;
    for end in 1..=tracked.len() {
        if !tracked[end - 1] {
            start = end;
        } else if end - start > best.len() {
            best = start..end;
        }
    }
    best
}

/// Interpolates lost frames linearly. Lost frames at either end repeat the nearest tracked frame.
fn filled(track: &Array3<f64>, tracked: &[bool]) -> Array3<f64> {
    let good: Vec<usize> = (0..tracked.len()).filter(|t| tracked[*t]).collect();
    let (Some(first), Some(last)) = (good.first(), good.last()) else {
        return track.clone();
    };
    let mut out = track.clone();
    for t in (0..tracked.len()).filter(|t| !tracked[*t]) {
        let next = good.partition_point(|g| *g < t);
        let after = good.get(next).unwrap_or(last);
        let before = next.checked_sub(1).map_or(first, |k| &good[k]);
        let share = if after > before {
            (t - before) as f64 / (after - before) as f64
        } else {
            0.0
        };
        let [a, b] = [before, after].map(|g| track.index_axis(Axis(0), *g));
        out.index_axis_mut(Axis(0), t)
            .assign(&(&a * (1.0 - share) + &b * share));
    }
    out
}

/// Smooths over time with a Gaussian, cut off at four standard deviations. The first and last frame
/// continue beyond the ends.
fn smoothed(track: &Array3<f64>) -> Array3<f64> {
    let reach = (4.0 * SMOOTHING_FRAMES + 0.5) as isize;
    let weight = |k: isize| (-0.5 * (k as f64 / SMOOTHING_FRAMES).powi(2)).exp();
    let total: f64 = (-reach..=reach).map(weight).sum();
    let last = track.dim().0 as isize - 1;
    let mut out = Array3::zeros(track.dim());
    for t in 0..=last {
        for k in -reach..=reach {
            let from = track.index_axis(Axis(0), (t + k).clamp(0, last) as usize);
            out.index_axis_mut(Axis(0), t as usize)
                .scaled_add(weight(k) / total, &from);
        }
    }
    out
}

/// The neutral face `[68, 3]`: the silent face with its lips together, in centimetres.
///
/// A clip is silent at both ends. There the mouth is at rest, often slightly open. Over these
/// frames, a line is fitted to every coordinate as a function of the inner-lip gap. Its value at the
/// 5 % quantile of the gaps is the neutral face.
fn rest_template(tracks: &[Track]) -> Array2<f64> {
    let mut edges = Vec::new();
    for track in tracks {
        let frames = track.tracked.len();
        let ends = (0..EDGE_FRAMES.min(frames)).chain(frames.saturating_sub(EDGE_FRAMES)..frames);
        let tracked = ends.filter(|t| track.tracked[*t]);
        edges.extend(tracked.map(|t| track.landmarks.index_axis(Axis(0), t)));
    }
    let gap = |face: &ArrayView2<'_, f64>| {
        let squared = (0..3).map(|i| (face[[62, i]] - face[[66, i]]).powi(2));
        squared.sum::<f64>().sqrt()
    };
    let gaps: Vec<f64> = edges.iter().map(gap).collect();
    let count = edges.len() as f64;
    let mean_gap = gaps.iter().sum::<f64>() / count;
    let power: f64 = gaps.iter().map(|g| (g - mean_gap).powi(2)).sum();
    let mut mean = Array2::<f64>::zeros((LANDMARKS, 3));
    let mut slope = Array2::<f64>::zeros((LANDMARKS, 3));
    for (face, gap) in edges.iter().zip(&gaps) {
        mean.scaled_add(1.0 / count, face);
        slope.scaled_add((gap - mean_gap) / power, face);
    }
    mean + slope * (quantile(&gaps, REST_SHARE) - mean_gap)
}

/// Rotation from the speaker's neutral face to ICT's, fitted to the eyes, nose and mouth.
fn turn_to_ict(neutral: &Array2<f64>, ict: &IctLandmarks) -> Result<Array2<f64>> {
    let target = &ict.neutral / METRES_PER_CM;
    let fit = Similarity::fit(&points(neutral, INNER), &points(&target, INNER), None)?;
    let rotation = fit.similarity.rotation;
    Ok(Array2::from_shape_fn((3, 3), |(i, j)| rotation[i][j]))
}

fn points(face: &Array2<f64>, rows: impl Iterator<Item = usize>) -> Vec<[f32; 3]> {
    rows.map(|n| std::array::from_fn(|i| face[[n, i]] as f32))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(frames: usize) -> Array3<f64> {
        Array3::from_shape_fn((frames, LANDMARKS, 3), |(t, n, i)| {
            n as f64 * 0.1 + i as f64 + t as f64 * 0.01
        })
    }

    #[test]
    fn lost_frames_are_bridged_and_ends_held() {
        let clean = track(9);
        let mut broken = clean.clone();
        let tracked: Vec<bool> = (0..9).map(|t| ![0, 3, 4, 8].contains(&t)).collect();
        for t in (0..9).filter(|t| !tracked[*t]) {
            broken[[t, 5, 1]] += 10.0;
        }
        let out = filled(&broken, &tracked);
        assert!((out[[3, 5, 1]] - clean[[3, 5, 1]]).abs() < 1e-12);
        assert!((out[[4, 7, 2]] - clean[[4, 7, 2]]).abs() < 1e-12);
        assert_eq!(out[[0, 5, 1]], clean[[1, 5, 1]]);
        assert_eq!(out[[8, 5, 1]], clean[[7, 5, 1]]);
        assert_eq!(out[[6, 5, 1]], clean[[6, 5, 1]]);
    }

    #[test]
    fn the_longest_stretch_without_a_lost_frame_is_judged() {
        let tracked = [false, true, true, false, true, true, true, false];
        assert_eq!(longest_run(&tracked), 4..7);
        assert_eq!(longest_run(&[true; 3]), 0..3);
        assert!(longest_run(&[false; 3]).is_empty());
    }

    #[test]
    fn smoothing_keeps_constants_and_lines() {
        let track = track(12);
        let smooth = smoothed(&track);
        assert!((smooth[[6, 3, 1]] - track[[6, 3, 1]]).abs() < 1e-12);
    }

    #[test]
    fn lost_frames_leave_the_rest_alone() {
        let mut face = track(40);
        for t in 0..40 {
            face[[t, 66, 1]] -= 0.02 * t as f64;
        }
        let clean = Track {
            landmarks: face.clone(),
            tracked: vec![true; 40],
        };
        face.index_axis_mut(Axis(0), 0).fill(50.0);
        let mut tracked = vec![true; 40];
        tracked[0] = false;
        let broken = Track {
            landmarks: face,
            tracked,
        };
        let difference = rest_template(&[clean]) - rest_template(&[broken]);
        assert!(difference.iter().all(|x| x.abs() < 0.05));
    }
}
