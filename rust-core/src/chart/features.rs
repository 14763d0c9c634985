//! Measures the features of a mouth that decide which drawing is chosen.

use ndarray::ArrayView3;

use crate::{
    Error, Result,
    annotation::{Annotation, Symbols},
    mesh::ibug::{CORNERS, INNER_LIPS, LANDMARKS},
};

/// Lips touch if their distance exceeds the distance at rest by less than this, in mouth widths.
const TOUCHING: f64 = 0.004;

/// A mouth in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// How much the distance of the inner lips exceeds their distance at rest, in widths of the
    /// mouth at rest.
    pub open: f64,
    /// Width of the mouth as a share of its width at rest.
    pub width: f64,
    /// Whether the lips touch.
    pub touches: bool,
    /// Whether the lips close for a phone.
    pub closes: bool,
    /// Whether the lower lip is at the upper teeth for a phone.
    pub at_teeth: bool,
    /// Whether the tongue is behind the upper teeth for a phone.
    pub tongue: bool,
}

pub fn of(
    neutral: &[[f32; 3]; LANDMARKS],
    displacements: ArrayView3<'_, f32>,
    fps: f64,
    said: Option<&Annotation>,
) -> Result<Vec<Frame>> {
    let (frames, landmarks, axes) = displacements.dim();
    if (landmarks, axes) != (LANDMARKS, 3) {
        return Err(Error::ShapeMismatch {
            what: "landmarks",
            expected: format!("[T, {LANDMARKS}, 3]"),
            got: format!("[{frames}, {landmarks}, {axes}]"),
        });
    }
    let rest = measure(&|n, axis| f64::from(neutral[n][axis]));
    if !(rest.1.is_finite() && rest.1 > 0.0) || displacements.iter().any(|x| !x.is_finite()) {
        let message = "chart: expected finite landmarks of a mouth with a width, got others";
        return Err(Error::InvalidInput(message.into()));
    }
    let mut mouth_frames: Vec<Frame> = (0..frames)
        .map(|t| {
            let place = |n: usize, axis: usize| {
                f64::from(neutral[n][axis]) + f64::from(displacements[[t, n, axis]])
            };
            let now = measure(&place);
            let open = (now.0 - rest.0) / rest.1;
            Frame {
                open,
                width: now.1 / rest.1,
                touches: open < TOUCHING,
                closes: false,
                at_teeth: false,
                tongue: false,
            }
        })
        .collect();
    if let Some(said) = said {
        listen(&mut mouth_frames, fps, said);
    }
    Ok(mouth_frames)
}

/// The mean distance of the inner lips and the width of a mouth.
fn measure(place: &impl Fn(usize, usize) -> f64) -> (f64, f64) {
    let apart = |a: usize, b: usize| {
        let square = |axis: usize| (place(a, axis) - place(b, axis)).powi(2);
        (0..3).map(square).sum::<f64>().sqrt()
    };
    let gaps = INNER_LIPS.iter().map(|&(a, b)| apart(a, b));
    let mean = gaps.sum::<f64>() / INNER_LIPS.len() as f64;
    (mean, apart(CORNERS[0], CORNERS[1]))
}

/// Whether a phone is th, which puts the tongue at the upper teeth.
fn is_dental(phone: &str) -> bool {
    ["th", "dh", "θ", "ð"].contains(&phone.trim().to_lowercase().as_str())
}

/// Marks the frames whose phones close the lips, put the lip to the teeth or show the tongue.
fn listen(frames: &mut [Frame], fps: f64, said: &Annotation) {
    let count = frames.len();
    let range = |start_s: f64, end_s: f64| {
        let first = (start_s * fps).round().max(0.0) as usize;
        let last = ((end_s * fps).round() as usize).max(first + 1);
        first.min(count)..last.min(count)
    };
    for [start_s, end_s] in said.closures().unwrap_or_default() {
        frames[range(start_s, end_s)]
            .iter_mut()
            .for_each(|frame| frame.closes = true);
    }
    for phone in said.intervals(Symbols::Phones) {
        let shape = Symbols::Phones.as_shape(&phone.label, Symbols::Papagayo);
        for frame in &mut frames[range(phone.start_s, phone.end_s)] {
            frame.closes |= shape == "MBP";
            frame.at_teeth |= shape == "FV";
            frame.tongue |= shape == "L" || is_dental(&phone.label);
        }
    }
}
