//! Writes the weights of shapes over time in the formats of capture tools.

use std::{
    io::{self, Write},
    path::Path,
};

use serde::Serialize;

use crate::{
    Error, Result,
    job::{write_atomically, write_json},
    motion::check_fps,
    rig::{ARKIT, SolvedWeights},
};

/// Columns of Live Link Face after the shapes: rotations of head and eyes.
const TURNS: [&str; 9] = [
    "HeadYaw",
    "HeadPitch",
    "HeadRoll",
    "LeftEyeYaw",
    "LeftEyePitch",
    "LeftEyeRoll",
    "RightEyeYaw",
    "RightEyePitch",
    "RightEyeRoll",
];

#[derive(Serialize)]
struct Document<'a> {
    version: u32,
    fps: f64,
    names: &'a [String],
    weights: Vec<Vec<f32>>,
}

/// Writes weights to `.csv` or `.json`.
///
/// A `.csv` has the columns of Live Link Face: `Timecode`, `BlendShapeCount`, the 52 shapes with a
/// capital first letter, then rotations of head and eyes, which are zero. A `.json` has `version`,
/// `fps`, `names` `[S]` and `weights` `[T][S]`.
///
/// # Errors
/// `InvalidInput` for another extension or a frame rate out of range; `Io` if the file
/// cannot be written.
pub fn write_blend_weights(path: &Path, weights: &SolvedWeights, fps: f64) -> Result<()> {
    check_fps(fps)?;
    let extension = path
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default();
    match extension.to_ascii_lowercase().as_str() {
        "csv" => write_atomically(path, |file| csv(file, weights, fps)),
        "json" => write_json(
            path,
            &Document {
                version: 1,
                fps,
                names: &weights.names,
                weights: weights
                    .weights
                    .rows()
                    .into_iter()
                    .map(|w| w.to_vec())
                    .collect(),
            },
        ),
        _ => Err(Error::InvalidInput(format!(
            "{}: expected a name that ends in .csv or .json",
            path.display()
        ))),
    }
}

fn csv(file: &mut impl Write, weights: &SolvedWeights, fps: f64) -> io::Result<()> {
    let columns: Vec<String> = ARKIT.iter().map(|name| capital(name)).collect();
    let count = ARKIT.len() + TURNS.len();
    writeln!(
        file,
        "Timecode,BlendShapeCount,{},{}",
        columns.join(","),
        TURNS.join(",")
    )?;
    let place = ARKIT.map(|name| weights.names.iter().position(|known| known == name));
    for (t, row) in weights.weights.rows().into_iter().enumerate() {
        write!(file, "{},{count}", timecode(t, fps))?;
        for column in place {
            write!(file, ",{:.6}", column.map_or(0.0, |s| row[s]))?;
        }
        writeln!(file, "{}", ",0".repeat(TURNS.len()))?;
    }
    Ok(())
}

/// `HH:MM:SS:FF.mmm`: hours, minutes, seconds, and the frame within the second with its fraction.
fn timecode(frame: usize, fps: f64) -> String {
    let time_s = frame as f64 / fps;
    // Less than a millionth of a second is a rounding error.
    let second = (time_s + 1e-6).floor();
    let within = ((time_s - second) * fps).max(0.0);
    let second = second as u64;
    let (hours, minutes) = (second / 3600, second / 60 % 60);
    format!("{hours:02}:{minutes:02}:{:02}:{within:06.3}", second % 60)
}

fn capital(name: &str) -> String {
    let mut letters = name.chars();
    let first = letters.next().map(|c| c.to_ascii_uppercase());
    first.into_iter().chain(letters).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    fn example() -> SolvedWeights {
        SolvedWeights {
            names: ARKIT.map(str::to_owned).to_vec(),
            weights: Array2::from_shape_fn((3, 52), |(t, s)| (t * 52 + s) as f32 / 156.0),
            residual: vec![0.0; 3],
            motion: vec![0.0; 3],
        }
    }

    #[test]
    fn timecodes_count_frames_within_the_second() {
        assert_eq!(timecode(0, 30.0), "00:00:00:00.000");
        assert_eq!(timecode(29, 30.0), "00:00:00:29.000");
        assert_eq!(timecode(30 * 3661 + 7, 30.0), "01:01:01:07.000");
        assert_eq!(timecode(60, 59.94), "00:00:01:00.060");
    }

    #[test]
    fn csv_has_the_columns_of_the_capture_tool() {
        let mut bytes = Vec::new();
        csv(&mut bytes, &example(), 30.0).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        let lines: Vec<Vec<&str>> = text.lines().map(|l| l.split(',').collect()).collect();
        assert!(lines.iter().all(|line| line.len() == 63));
        assert_eq!(
            lines[0][..3],
            ["Timecode", "BlendShapeCount", "EyeBlinkLeft"]
        );
        assert_eq!(lines[0][53], "TongueOut");
        assert_eq!(lines[2][..3], ["00:00:00:01.000", "61", "0.333333"]);
    }

    #[test]
    fn other_endings_are_refused() {
        let error = write_blend_weights(Path::new("w.txt"), &example(), 30.0).unwrap_err();
        assert!(error.to_string().contains(".csv or .json"));
    }
}
