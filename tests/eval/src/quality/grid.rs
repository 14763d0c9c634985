//! grid_s1: 909 clips of one man, landmarks estimated from video at 25 fps.
//!
//! GRID corpus, CC BY 4.0 (Cooke, Barker, Cunningham & Shao 2006). Cleaned as in
//! `training/corpus/grid.py`: frame 0 has another crop and is dropped, lost frames are filled, the
//! rest is smoothed lightly and freed of each clip's residual pose; then the speaker's neutral is
//! scaled and turned to fit ICT's.

use std::path::Path;

use ndarray::{Array2, Array3, ArrayView2, Axis, Slice};

use super::clip::{Clip, Corpus, cut};
use crate::{ict::IctLandmarks, tensors::TensorFile};
use anyface::{
    Error, Result, audio::Waveform, ibug::LANDMARKS, mesh::Similarity, metrics::quantile,
};

const FPS: f64 = 25.0;
const UNITS_PER_CM: f64 = 2000.0;
const METRES_PER_CM: f64 = 0.01;
const STABLE: [usize; 10] = [0, 16, 27, 28, 29, 30, 36, 39, 42, 45];
const SMOOTHING_FRAMES: f64 = 0.6;
const LOST_CM: f64 = 4.0;
const REST_SHARE: f64 = 0.05;
/// Silent frames at either end of a clip.
const EDGE_FRAMES: usize = 6;
const EVERY: usize = 10;
/// Clips of this index within every ten fit the baselines.
const FOR_BASELINES: usize = 5;
/// Eyes, nose and mouth.
const INNER: std::ops::Range<usize> = 27..LANDMARKS;

/// Every tenth clip by name is held out; the first `limit` of them are read.
pub(super) fn read(data: &Path, ict: &IctLandmarks, limit: Option<usize>) -> Result<Corpus> {
    let folder = data.join("motion/grid_s1");
    let file = TensorFile::read(&folder.join("landmarks68.safetensors"))?;
    let names = file.words("clips")?;
    let tracks = clean(&read_tracks(&file, names.len())?)?;
    let neutral = rest_template(&tracks);
    let (scale, turn) = fit_to_ict(&neutral, ict)?;
    let place = |landmarks: ArrayView2<'_, f64>| landmarks.dot(&turn.t()) * (scale * METRES_PER_CM);
    let mut sorted: Vec<usize> = (0..names.len()).collect();
    sorted.sort_by_key(|c| &names[*c]);
    let chosen = |remainder: usize| {
        let clips = sorted.iter().skip(remainder).step_by(EVERY).copied();
        clips.take(limit.unwrap_or(usize::MAX)).collect::<Vec<_>>()
    };
    let load = |c: usize| -> Result<Clip> {
        let sound = folder.join("audio").join(format!("{}.ogg", names[c]));
        let mut motion = Array3::zeros(tracks[c].dim());
        for (from, mut to) in tracks[c].outer_iter().zip(motion.outer_iter_mut()) {
            to.assign(&place((&from - &neutral).view()));
        }
        Ok(Clip {
            name: names[c].clone(),
            waveform: cut(
                &Waveform::from_file(&sound)?,
                1.0 / FPS,
                f64::from(u16::MAX),
            ),
            start_s: 1.0 / FPS,
            motion,
            neutral: place(neutral.view()),
            fps: FPS,
            observed: (0..LANDMARKS).collect(),
            jaw: None,
            pucker: None,
            phones: None,
        })
    };
    Ok(Corpus {
        source: "grid_s1".into(),
        recorded: true,
        held_out: chosen(0).into_iter().map(load).collect::<Result<_>>()?,
        training: chosen(FOR_BASELINES)
            .into_iter()
            .map(load)
            .collect::<Result<_>>()?,
    })
}

/// Every clip without its first frame, `[T, 68, 3]` centimetres.
fn read_tracks(file: &TensorFile, clips: usize) -> Result<Vec<Array3<f64>>> {
    let (values, shape) = file.floats("landmarks")?;
    let (offsets, _) = file.floats("clip_offsets")?;
    if shape.len() != 3 || shape[1..] != [LANDMARKS, 3] || offsets.len() != clips + 1 {
        return Err(file.bad("expected landmarks [frames, 68, 3] and one offset per clip and end"));
    }
    let values = values
        .into_iter()
        .map(|x| f64::from(x) / UNITS_PER_CM)
        .collect();
    let all = Array3::from_shape_vec((shape[0], LANDMARKS, 3), values)
        .map_err(|e| file.bad(&e.to_string()))?;
    let spans = offsets
        .windows(2)
        .map(|w| (w[0] as usize + 1, w[1] as usize));
    spans
        .map(|(from, to)| match from < to && to <= shape[0] {
            true => Ok(all.slice_axis(Axis(0), Slice::from(from..to)).to_owned()),
            false => Err(file.bad("expected offsets in rising order")),
        })
        .collect()
}

fn clean(tracks: &[Array3<f64>]) -> Result<Vec<Array3<f64>>> {
    let median = median_face(tracks);
    tracks
        .iter()
        .map(|track| {
            let smooth = smoothed(&filled(track, &median));
            let middle = median_face(std::slice::from_ref(&smooth));
            let pick = |face: &Array2<f64>| points(face, STABLE.into_iter());
            let pose = Similarity::fit(&pick(&middle), &pick(&median), None)?.similarity;
            Ok(moved(&smooth, &pose, &middle, &median))
        })
        .collect()
}

/// Turns a track and puts the mean of its stable landmarks where the median face has it.
fn moved(
    track: &Array3<f64>,
    pose: &Similarity,
    middle: &Array2<f64>,
    median: &Array2<f64>,
) -> Array3<f64> {
    let turn = Array2::from_shape_fn((3, 3), |(i, j)| pose.rotation[i][j]);
    let centre = |face: &Array2<f64>| {
        let sum = |i: usize| STABLE.iter().map(|n| face[[*n, i]]).sum::<f64>();
        ndarray::arr1(&[sum(0), sum(1), sum(2)]) / STABLE.len() as f64
    };
    let shift = centre(median) - turn.dot(&centre(middle));
    let mut out = Array3::zeros(track.dim());
    for (from, mut to) in track.outer_iter().zip(out.outer_iter_mut()) {
        to.assign(&(from.dot(&turn.t()) + &shift));
    }
    out
}

/// Median over all frames of every coordinate.
fn median_face(tracks: &[Array3<f64>]) -> Array2<f64> {
    Array2::from_shape_fn((LANDMARKS, 3), |(n, i)| {
        let frames = tracks.iter().flat_map(|track| track.outer_iter());
        let values: Vec<f64> = frames.map(|frame| frame[[n, i]]).collect();
        quantile(&values, 0.5)
    })
}

/// Linear interpolation over frames in which some coordinate is far from the median face.
fn filled(track: &Array3<f64>, median: &Array2<f64>) -> Array3<f64> {
    let lost = |frame: ArrayView2<'_, f64>| {
        let mut pairs = frame.iter().zip(median);
        pairs.any(|(x, m)| (x - m).abs() > LOST_CM)
    };
    let good: Vec<usize> = (0..track.dim().0)
        .filter(|t| !lost(track.index_axis(Axis(0), *t)))
        .collect();
    let mut out = track.clone();
    if good.is_empty() || good.len() == track.dim().0 {
        return out;
    }
    for t in 0..track.dim().0 {
        let next = good.partition_point(|g| *g < t);
        let after = good[next.min(good.len() - 1)];
        let before = if after <= t {
            after
        } else {
            good[next.saturating_sub(1)].min(after)
        };
        let share = match after > before && t > before {
            true => (t - before) as f64 / (after - before) as f64,
            false => 0.0,
        };
        let (a, b) = (
            track.index_axis(Axis(0), before),
            track.index_axis(Axis(0), after),
        );
        out.index_axis_mut(Axis(0), t)
            .assign(&(&a * (1.0 - share) + &b * share));
    }
    out
}

/// Gaussian over time, cut at four deviations, ends held.
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

/// Neutral face `[68, 3]`: the silent face with its lips together.
///
/// The ends of a clip are silent; there the mouth is at rest, often slightly open. A line through
/// every coordinate over the inner-lip gap of these frames is read at the 5 % quantile of gaps.
fn rest_template(tracks: &[Array3<f64>]) -> Array2<f64> {
    let mut edges = Vec::new();
    for track in tracks {
        let frames = track.dim().0;
        let ends = (0..EDGE_FRAMES.min(frames)).chain(frames.saturating_sub(EDGE_FRAMES)..frames);
        edges.extend(ends.map(|t| track.index_axis(Axis(0), t)));
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

/// Scale and rotation from the speaker's neutral to ICT's, by eyes, nose and mouth.
fn fit_to_ict(neutral: &Array2<f64>, ict: &IctLandmarks) -> Result<(f64, Array2<f64>)> {
    let target = &ict.neutral / METRES_PER_CM;
    let fit = Similarity::fit(&points(neutral, INNER), &points(&target, INNER), None)?;
    let rotation = fit.similarity.rotation;
    let ratio = spread(&target) / spread(neutral);
    match ratio.is_finite() {
        true => Ok((
            ratio,
            Array2::from_shape_fn((3, 3), |(i, j)| rotation[i][j]),
        )),
        false => Err(Error::InvalidInput(
            "grid_s1: the neutral face is a point".into(),
        )),
    }
}

/// Root of the summed squared distances of the inner landmarks from their mean.
fn spread(face: &Array2<f64>) -> f64 {
    let inner = face.slice_axis(Axis(0), Slice::from(INNER));
    match inner.mean_axis(Axis(0)) {
        Some(mean) => (&inner - &mean).mapv(|x| x * x).sum().sqrt(),
        None => 0.0,
    }
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
        let median = median_face(std::slice::from_ref(&clean));
        let mut broken = clean.clone();
        for t in [0, 3, 4, 8] {
            broken[[t, 5, 1]] += 10.0;
        }
        let out = filled(&broken, &median);
        assert!((out[[3, 5, 1]] - clean[[3, 5, 1]]).abs() < 1e-12);
        assert!((out[[4, 7, 2]] - clean[[4, 7, 2]]).abs() < 1e-12);
        assert_eq!(out[[0, 5, 1]], clean[[1, 5, 1]]);
        assert_eq!(out[[8, 5, 1]], clean[[7, 5, 1]]);
        assert_eq!(out[[6, 5, 1]], clean[[6, 5, 1]]);
    }

    #[test]
    fn smoothing_keeps_constants_and_lines() {
        let track = track(12);
        let smooth = smoothed(&track);
        assert!((smooth[[6, 3, 1]] - track[[6, 3, 1]]).abs() < 1e-12);
    }
}
