//! Reads the motion of a captured face, in the files of capture tools and in our own.

use std::path::Path;

use ndarray::{Array1, Array2, Array3};

use super::{
    landmark_motion::{LandmarkMotion, read_landmark_motion, read_weights},
    numpy::NumpyArchive,
};
use crate::{
    Error, Result,
    job::{InputKind, read_text},
    mesh::{Similarity, canonical_landmarks},
    motion::{LandmarkClip, Motion, WeightClip, check_fps},
    rig::ARKIT,
};

/// Frames per second of files that do not tell, as most archives of landmarks have.
const USUAL_FPS: f64 = 30.0;
/// The fewest shapes of ARKit's that make a file a capture of a face.
const FEWEST_SHAPES: usize = 10;
/// How little and how much a frame may count.
const COUNTS: std::ops::RangeInclusive<f32> = 1e-3..=1e3;

/// The motion of a captured face.
#[derive(Debug, Clone, PartialEq)]
pub struct CapturedFace {
    /// What the face did.
    pub motion: Motion,
    /// What Anyface had generated before somebody corrected it into `motion`, in the same frames.
    pub generated: Option<LandmarkClip>,
    /// `[T]`, how much each frame of `motion` counts for those who learn from it, 0.001 to 1000. `None` counts all
    /// alike.
    pub frame_weights: Option<Array1<f32>>,
}

impl From<Motion> for CapturedFace {
    fn from(motion: Motion) -> CapturedFace {
        CapturedFace {
            motion,
            generated: None,
            frame_weights: None,
        }
    }
}

/// Reads a captured face: `.csv` of Live Link Face, whose columns are ARKit's shapes, or `.npz` with
/// `landmark_displacements` or `weights`. An archive may also hold `frame_weights` `[T]`, and beside landmarks
/// `generated_displacements` `[T, 68, 3]` ([`CapturedFace`]).
///
/// Landmarks in the units of a mesh are turned and scaled to canonical metres by the rest pose that lies beside
/// them.
///
/// # Errors
/// `Io` if the file cannot be read; `InvalidInput` for another format, for one of too few shapes, or for numbers
/// that are not finite; `ShapeMismatch` for arrays whose frames are not as many.
pub fn read_captured_face(path: &Path) -> Result<CapturedFace> {
    let ending = path.extension().and_then(|ending| ending.to_str());
    match ending.map(str::to_ascii_lowercase).as_deref() {
        Some("csv") => read_live_link(path).map(|clip| Motion::Weights(clip).into()),
        Some("npz") => read_archive(path),
        _ => Err(Error::InvalidInput(format!(
            "{}: expected the motion of a face: a .csv of Live Link Face, or an .npz of landmarks or weights",
            path.display()
        ))),
    }
}

fn read_archive(path: &Path) -> Result<CapturedFace> {
    if let Ok(Some(weights)) = read_weights(path) {
        let frame_weights = read_frame_weights(path, weights.weights.nrows())?;
        return Ok(CapturedFace {
            frame_weights,
            ..Motion::Weights(weights).into()
        });
    }
    let motion = read_landmark_motion(path)?;
    let frames = motion.displacements.dim().0;
    let generated = match read_generated(path, motion.displacements.dim())? {
        Some(displacements) => Some(canonical(&motion, displacements)?),
        None => None,
    };
    let displacements = motion.displacements.clone();
    Ok(CapturedFace {
        motion: Motion::Landmarks(canonical(&motion, displacements)?),
        generated,
        frame_weights: read_frame_weights(path, frames)?,
    })
}

/// Displacements `[T, 68, 3]` in the units of `motion` as canonical metres.
fn canonical(motion: &LandmarkMotion, displacements: Array3<f32>) -> Result<LandmarkClip> {
    let displacements = match &motion.neutral {
        Some(neutral) => {
            let fit = Similarity::fit(neutral, canonical_landmarks(), None)?;
            fit.similarity
                .displacements_to_canonical(displacements.view())
        }
        None => displacements,
    };
    let fps = motion.fps.unwrap_or(USUAL_FPS);
    Ok(LandmarkClip { displacements, fps })
}

fn read_generated(path: &Path, size: (usize, usize, usize)) -> Result<Option<Array3<f32>>> {
    let mut npz = NumpyArchive::open(path)?;
    if !npz.has("generated_displacements") {
        return Ok(None);
    }
    let generated: Array3<f32> = npz.array("generated_displacements")?;
    if generated.dim() != size {
        return Err(Error::ShapeMismatch {
            what: "generated_displacements",
            expected: format!("{size:?}, as landmark_displacements"),
            got: format!("{:?}", generated.dim()),
        });
    }
    let is_finite = generated.iter().all(|x| x.is_finite());
    if !is_finite {
        return Err(Error::InvalidInput(format!(
            "{}: generated_displacements: expected finite numbers, got NaN or infinity",
            path.display()
        )));
    }
    Ok(Some(generated))
}

fn read_frame_weights(path: &Path, frames: usize) -> Result<Option<Array1<f32>>> {
    let mut npz = NumpyArchive::open(path)?;
    if !npz.has("frame_weights") {
        return Ok(None);
    }
    let counts: Array1<f32> = npz.array("frame_weights")?;
    if counts.len() != frames {
        return Err(Error::ShapeMismatch {
            what: "frame_weights",
            expected: format!("[{frames}], one number a frame"),
            got: format!("[{}]", counts.len()),
        });
    }
    if let Some(count) = counts.iter().find(|count| !COUNTS.contains(count)) {
        return Err(Error::InvalidInput(format!(
            "{}: frame_weights: expected numbers from {} to {}, got {count}",
            path.display(),
            COUNTS.start(),
            COUNTS.end()
        )));
    }
    Ok(Some(counts))
}

/// Reads the CSV that Live Link Face records, or `anyface` writes: a header, then a row for each frame. Columns that
/// are no shapes of ARKit's are left out.
fn read_live_link(path: &Path) -> Result<WeightClip> {
    let text = read_text(path, InputKind::Text)?;
    let bad = |why: String| Error::InvalidInput(format!("{}: {why}", path.display()));
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    let header: Vec<&str> = lines
        .next()
        .unwrap_or_default()
        .split(',')
        .map(str::trim)
        .collect();
    let shapes = header.iter().enumerate().filter_map(|(column, name)| {
        let shape = ARKIT
            .iter()
            .find(|shape| shape.eq_ignore_ascii_case(name))?;
        Some((column, (*shape).to_owned()))
    });
    let (columns, names): (Vec<usize>, Vec<String>) = shapes.unzip();
    if names.len() < FEWEST_SHAPES || header.first() != Some(&"Timecode") {
        return Err(bad(format!(
            "expected a CSV of Live Link Face, with a Timecode and ARKit's shapes as columns, got {} of them",
            names.len()
        )));
    }
    let (mut codes, mut values) = (Vec::new(), Vec::new());
    for (row, line) in lines.enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        // Live Link Face writes a row without values where it lost the face.
        let Some(weights) = row_of(&cells, &columns) else {
            continue;
        };
        let code = Timecode::read(cells[0]);
        codes.push(code.ok_or_else(|| {
            bad(format!(
                "row {}: expected a timecode, got {:?}",
                row + 2,
                cells[0]
            ))
        })?);
        values.push(weights);
    }
    let fps = Timecode::fps(&codes)
        .ok_or_else(|| bad("expected more than one frame with values".into()))?;
    check_fps(fps).map_err(|error| bad(error.to_string()))?;
    let times_s: Vec<f64> = codes.iter().map(|code| code.time_s(fps)).collect();
    Ok(WeightClip {
        names,
        weights: at_even_times(&times_s, &values, fps),
        fps,
        together: Vec::new(),
    })
}

/// The values of a row, from 0 to 1; `None` if one of them is missing or no finite number.
fn row_of(cells: &[&str], columns: &[usize]) -> Option<Vec<f32>> {
    let number = |column: &usize| {
        cells
            .get(*column)?
            .trim()
            .parse::<f32>()
            .ok()
            .filter(|x| x.is_finite())
    };
    let row: Option<Vec<f32>> = columns.iter().map(number).collect();
    row.map(|row| row.into_iter().map(|x| x.clamp(0.0, 1.0)).collect())
}

/// `HH:MM:SS:FF.mmm`: a second of the day, and the frame within it.
struct Timecode {
    second: u64,
    frame: f64,
}

impl Timecode {
    fn read(text: &str) -> Option<Timecode> {
        let mut parts = text.trim().split(':');
        let mut whole = || parts.next()?.parse::<u64>().ok();
        let second = whole()?.checked_mul(3600)? + whole()?.checked_mul(60)? + whole()?;
        let frame = parts.next()?.parse::<f64>().ok()?;
        Some(Timecode { second, frame })
    }

    /// Frames per second: one more than the highest frame of a second. Rows may be missing.
    fn fps(codes: &[Timecode]) -> Option<f64> {
        let highest = codes.iter().map(|code| code.frame).fold(0.0, f64::max);
        (codes.len() > 1).then(|| highest.floor() + 1.0)
    }

    fn time_s(&self, fps: f64) -> f64 {
        self.second as f64 + self.frame / fps
    }
}

/// Rows at even times, linear between those at `times_s`, from the first one on.
fn at_even_times(times_s: &[f64], values: &[Vec<f32>], fps: f64) -> Array2<f32> {
    let (first, last) = (times_s[0], times_s[times_s.len() - 1]);
    let frames = (((last - first) * fps).round().max(0.0) as usize).min(4 * values.len()) + 1;
    let mut before = 0;
    let mut at = |t: usize| {
        let time_s = first + t as f64 / fps;
        while before + 2 < times_s.len() && times_s[before + 1] <= time_s {
            before += 1;
        }
        let after = (before + 1).min(values.len() - 1);
        let length = times_s[after] - times_s[before];
        let share = if length > 0.0 {
            ((time_s - times_s[before]) / length).clamp(0.0, 1.0)
        } else {
            0.0
        };
        (before, after, share as f32)
    };
    let mut out = Array2::zeros((frames, values[0].len()));
    for (t, mut row) in out.outer_iter_mut().enumerate() {
        let (before, after, share) = at(t);
        for (s, value) in row.iter_mut().enumerate() {
            *value = values[before][s] * (1.0 - share) + values[after][s] * share;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        output::{npz::Archive, write_blend_weights},
        rig::SolvedWeights,
    };

    #[test]
    fn what_is_written_for_live_link_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("take.csv");
        for (fps, frames) in [(60.0, 200), (24.0, 30), (30.0, 95)] {
            let names = ARKIT.map(str::to_owned).to_vec();
            let values = |(t, s)| ((t * 7 + s) % 11) as f32 / 10.0;
            let values = Array2::from_shape_fn((frames, ARKIT.len()), values);
            let written = SolvedWeights::exact(names, values);
            write_blend_weights(&path, &written, fps).unwrap();
            let Motion::Weights(read) = read_captured_face(&path).unwrap().motion else {
                panic!("a CSV holds weights");
            };
            assert_eq!((read.fps, read.weights.dim()), (fps, (frames, ARKIT.len())));
            assert!(
                (&read.weights - &written.weights)
                    .iter()
                    .all(|x| x.abs() < 1e-3)
            );
        }
    }

    #[test]
    fn a_corrected_take_has_what_was_generated_and_how_much_frames_count() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("take.npz");
        // Lengths in a mesh ten times as large as a human.
        let neutral = canonical_landmarks().map(|place| place.map(|x| 10.0 * x));
        let write = |generated: usize, counts: &[f32]| {
            let mut npz = Archive::new(std::fs::File::create(&path).unwrap());
            npz.neutral(&neutral).unwrap();
            for (name, frames, x) in [
                ("landmark_displacements", 4, 0.2),
                ("generated_displacements", generated, 0.1),
            ] {
                npz.start(name, "<f4", &[frames, 68, 3]).unwrap();
                let moved = Array3::from_elem((frames, 68, 3), x);
                npz.values(moved.view()).unwrap();
            }
            npz.start("frame_weights", "<f4", &[counts.len()]).unwrap();
            let counts = Array3::from_shape_vec((1, 1, counts.len()), counts.to_vec()).unwrap();
            npz.values(counts.view()).unwrap();
            npz.finish().unwrap();
            read_captured_face(&path)
        };
        let face = write(4, &[1.0, 4.0, 4.0, 1.0]).unwrap();
        let Motion::Landmarks(moved) = &face.motion else {
            panic!("landmarks were written");
        };
        assert!((moved.displacements[[0, 0, 0]] - 0.02).abs() < 1e-5);
        assert!((face.generated.unwrap().displacements[[3, 9, 2]] - 0.01).abs() < 1e-5);
        assert_eq!(face.frame_weights.unwrap()[1], 4.0);
        for (generated, counts, reason) in [
            (3, &[1.0; 4][..], "generated_displacements"),
            (4, &[1.0; 3][..], "one number a frame"),
            (4, &[1.0, 0.0, 1.0, 1.0][..], "from 0.001 to 1000, got 0"),
            (4, &[1.0, f32::NAN, 1.0, 1.0][..], "got NaN"),
        ] {
            let error = write(generated, counts).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }

    #[test]
    fn lost_frames_are_filled_and_other_files_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("take.csv");
        let names = ARKIT.join(",");
        let row = |t: usize, x: f32| {
            let cells = vec![format!("{x}"); ARKIT.len()].join(",");
            format!("10:00:{:02}:{:02}.000,52,{cells}", t / 30, t % 30)
        };
        let mut rows: Vec<String> = (0..90).map(|t| row(t, t as f32 / 100.0)).collect();
        rows[40] = "10:00:01:10.000,0".into();
        std::fs::write(
            &path,
            format!("Timecode,BlendShapeCount,{names}\n{}\n", rows.join("\n")),
        )
        .unwrap();
        let Motion::Weights(read) = read_captured_face(&path).unwrap().motion else {
            panic!("a CSV holds weights");
        };
        assert_eq!((read.fps, read.weights.nrows()), (30.0, 90));
        assert!((read.weights[[40, 0]] - 0.4).abs() < 1e-3);
        std::fs::write(&path, "time,a,b\n1,2,3\n").unwrap();
        let error = read_captured_face(&path).unwrap_err().to_string();
        assert!(error.contains("Live Link Face"), "{error}");
    }
}
