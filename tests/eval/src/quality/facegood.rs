//! facegood_zh: five takes of Mandarin with ARKit weights at 30 fps (MIT).
//!
//! Only the mouth and jaw were animated, so brows, eyes and the upper contour of the face are not
//! scored.

use std::path::{Path, PathBuf};

use ndarray::{Array2, Array3, Axis, Slice};

use super::clip::{Clip, Corpus, cut};
use crate::face_model::IctLandmarks;
use anyface::{Error, Result, audio::Waveform, mesh::ibug::LANDMARKS};

/// Name of the corpus that holds out whole takes.
pub(super) const WHOLE_TAKES: &str = "facegood_zh_whole";
const FPS: f64 = 30.0;
/// Frame rate at which the split between training and held-out frames is counted.
const SPLIT_FPS: f64 = 25.0;
/// Share of every take that training uses.
const TRAINING_SHARE: f64 = 0.85;

/// Whether this is a landmark that the weights cannot move.
fn unseen(n: usize) -> bool {
    matches!(n, 0..=2 | 14..=26 | 36..=47)
}

/// Reads two corpora from the first `limit` takes.
///
/// The first holds out the end of every take. The second holds out whole takes, for models that
/// never saw them.
pub(super) fn read(data: &Path, ict: &IctLandmarks, limit: Option<usize>) -> Result<[Corpus; 2]> {
    let folder = data.join("motion/facegood_zh");
    let empty = |source: &str| Corpus {
        source: source.into(),
        recorded: true,
        held_out: Vec::new(),
        training: Vec::new(),
    };
    let (mut ends, mut whole) = (empty("facegood_zh"), empty(WHOLE_TAKES));
    let tables = takes(&folder)?.into_iter();
    for table in tables.take(limit.unwrap_or(usize::MAX)) {
        let (names, weights) = read_weights(&table)?;
        let motion = displace(&names, &weights, ict)?;
        let sound = table.to_string_lossy().replace(".arkit.csv", ".ogg");
        let waveform = Waveform::from_file(Path::new(&sound))?;
        let boundary_s = first_held_out_s(motion.dim().0);
        let boundary = (boundary_s * FPS).ceil() as usize;
        let part = |from: usize, to: usize| Clip {
            name: take_name(&table),
            waveform: cut(&waveform, from as f64 / FPS, (to - from) as f64 / FPS),
            start_s: from as f64 / FPS,
            motion: motion.slice_axis(Axis(0), Slice::from(from..to)).to_owned(),
            speaker: ict.neutral.clone(),
            neutral: ict.neutral.clone(),
            fps: FPS,
            observed: (0..LANDMARKS).filter(|n| !unseen(*n)).collect(),
            judged: 0..to - from,
            phones: None,
        };
        let end = motion.dim().0;
        ends.held_out.push(part(boundary, end));
        ends.training.push(part(0, boundary));
        whole.held_out.push(part(0, end));
    }
    Ok([ends, whole])
}

/// The name of a take: `1114_2_01` for `…/1114_2_01.arkit.csv`.
fn take_name(table: &Path) -> String {
    let name = table.file_name().unwrap_or_default().to_string_lossy();
    name.trim_end_matches(".arkit.csv").into()
}

/// Where the held-out end of a take of `frames` frames at 30 fps starts, seconds. Training cuts it
/// at the same place.
fn first_held_out_s(frames: usize) -> f64 {
    let at_split_rate = ((frames - 1) as f64 / FPS * SPLIT_FPS).floor() + 1.0;
    (TRAINING_SHARE * at_split_rate).floor() / SPLIT_FPS
}

fn takes(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut tables: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(Error::io(folder))?
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| path.to_string_lossy().ends_with(".arkit.csv"))
        .collect();
    tables.sort();
    if tables.is_empty() {
        Err(Error::InvalidInput(format!(
            "{}: expected files *.arkit.csv, got none",
            folder.display()
        )))
    } else {
        Ok(tables)
    }
}

/// Names of all columns except the first, which counts frames, and their values `[T, columns]`.
fn read_weights(path: &Path) -> Result<(Vec<String>, Array2<f64>)> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let bad = |what: &str| Error::InvalidInput(format!("{}: {what}", path.display()));
    let mut lines = text.lines();
    let header = lines
        .next()
        .ok_or_else(|| bad("expected a header, got an empty file"))?;
    let names: Vec<String> = header.split(',').skip(1).map(|s| s.trim().into()).collect();
    let mut values = Vec::new();
    for line in lines.filter(|line| !line.trim().is_empty()) {
        for cell in line.split(',').skip(1) {
            let number = cell.trim().parse::<f64>();
            values.push(number.map_err(|_| bad(&format!("expected a number, got {cell:?}")))?);
        }
    }
    let frames = values.len() / names.len().max(1);
    if frames < 2 {
        return Err(bad("expected two frames or more"));
    }
    let table = Array2::from_shape_vec((frames, names.len()), values);
    Ok((
        names,
        table.map_err(|_| bad("expected rows of equal length"))?,
    ))
}

/// Turns the weights into landmark motion `[T, 68, 3]`.
fn displace(names: &[String], weights: &Array2<f64>, ict: &IctLandmarks) -> Result<Array3<f64>> {
    let mut motion = Array3::zeros((weights.nrows(), LANDMARKS, 3));
    for (name, column) in names.iter().zip(weights.columns()) {
        let mode = ict.mode(name)?;
        for (weight, mut frame) in column.iter().zip(motion.outer_iter_mut()) {
            frame.scaled_add(*weight, &mode);
        }
    }
    Ok(motion)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_split_is_that_of_training() {
        // 1,472 frames at 30 fps are 1,226 at 25 fps; 0.85 of them are 1,042.
        assert!((first_held_out_s(1472) - 1042.0 / 25.0).abs() < 1e-9);
    }

    #[test]
    fn what_the_weights_move_is_judged() {
        let judged: Vec<usize> = (0..LANDMARKS).filter(|n| !unseen(*n)).collect();
        assert!(judged.contains(&8) && judged.contains(&30) && judged.contains(&67));
        assert!(!judged.contains(&2) && !judged.contains(&17) && !judged.contains(&40));
        assert_eq!(judged.len(), 68 - 28);
    }
}
