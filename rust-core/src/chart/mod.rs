//! Turns a performance into a mouth chart: one of a few drawn mouths for each frame.
//!
//! Each frame is compared with every mouth by the distance of the lips and the width of the mouth.
//! Dynamic programming over segments (Viterbi 1967) finds the cheapest sequence in which each mouth
//! stays for at least the requested time. If there is an annotation, closed lips, the lip at the
//! teeth and the tongue behind them count too.

mod features;
mod mouths;
#[cfg(test)]
mod tests;
mod way;

use ndarray::ArrayView3;

use crate::{
    Error, Result,
    annotation::{Annotation, Interval, Symbols, Tier},
};
use features::Frame;
use mouths::Mouth;

/// Options of a chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChartOptions {
    /// Rhubarb's nine mouths, or Preston Blair's ten as Papagayo names them.
    pub mouths: Symbols,
    /// Mouths change only at every `on`-th frame: 2 for poses on twos.
    pub on: usize,
    /// The fewest frames for which a mouth stays.
    pub hold: usize,
    /// The fewest frames for which lips stay closed for p, b and m; 0 for `hold`.
    pub closure_hold: usize,
    /// The fewest frames for which the mouth of a vowel stays; 0 for `hold`.
    pub vowel_hold: usize,
}

impl Default for ChartOptions {
    fn default() -> Self {
        ChartOptions {
            mouths: Symbols::Rhubarb,
            on: 1,
            hold: 2,
            closure_hold: 0,
            vowel_hold: 0,
        }
    }
}

impl ChartOptions {
    /// Checks the options before anything is drawn.
    ///
    /// # Errors
    /// `InvalidInput` for symbols that are not mouths, or numbers of frames out of range.
    pub fn check(&self) -> Result<()> {
        mouths::of(self.mouths)?;
        for (name, frames, least) in [
            ("on", self.on, 1),
            ("hold", self.hold, 1),
            ("closure_hold", self.closure_hold, 0),
            ("vowel_hold", self.vowel_hold, 0),
        ] {
            if !(least..=240).contains(&frames) {
                let message =
                    format!("chart: expected {name} of {least} to 240 frames, got {frames}");
                return Err(Error::InvalidInput(message));
            }
        }
        Ok(())
    }

    /// The fewest frames for which `mouth` stays. `rest`: the fewest for a mouth at rest.
    fn hold_of(&self, mouth: &Mouth, rest: usize) -> usize {
        let hold = match mouth {
            mouth if mouth.is_rest => return self.hold.max(rest),
            mouth if mouth.closes_lips() => self.closure_hold,
            mouth if mouth.is_vowel() => self.vowel_hold,
            _ => 0,
        };
        if hold == 0 { self.hold } else { hold }
    }
}

/// Charts moving landmarks: intervals without gaps, from 0 to the end of the last frame.
///
/// `neutral` `[68]` are the landmarks at rest and `displacements` `[T, 68, 3]` their motion, in any
/// unit and axes. `said` may hold phones or the times when the lips close.
///
/// # Errors
/// `InvalidInput` for symbols that are not mouths, an invalid frame rate or hold, numbers that are
/// not finite, or a mouth at rest without width; `ShapeMismatch` for another number of landmarks.
pub fn draw(
    neutral: &[[f32; 3]; 68],
    displacements: ArrayView3<'_, f32>,
    fps: f64,
    said: Option<&Annotation>,
    options: &ChartOptions,
) -> Result<Annotation> {
    let mouths = mouths::of(options.mouths)?;
    if !(fps.is_finite() && fps > 0.0) {
        let message = format!("chart: expected frames per second above 0, got {fps}");
        return Err(Error::InvalidInput(message));
    }
    options.check()?;
    let frames = features::of(neutral, displacements, fps, said)?;
    let on = options.on;
    let poses: Vec<Vec<f64>> = frames.chunks(on).map(|pose| costs(pose, mouths)).collect();
    let rest_frames = (mouths::REST_S * fps).ceil() as usize;
    let least = |mouth: &Mouth| options.hold_of(mouth, rest_frames).div_ceil(on);
    let least: Vec<usize> = mouths.iter().map(least).collect();
    let chosen = way::cheapest(&poses, &least, mouths::CHANGE);
    let mut intervals: Vec<Interval> = Vec::new();
    let time_s = |pose: usize| (pose * on).min(frames.len()) as f64 / fps;
    for (pose, &mouth) in chosen.iter().enumerate() {
        let label = mouths[mouth].name;
        match intervals.last_mut().filter(|last| last.label == label) {
            Some(last) => last.end_s = time_s(pose + 1),
            None => intervals.push(Interval {
                start_s: time_s(pose),
                end_s: time_s(pose + 1),
                label: label.to_owned(),
            }),
        }
    }
    let tier = Tier {
        symbols: options.mouths,
        intervals,
    };
    Ok(Annotation {
        tiers: vec![tier],
        duration_s: frames.len() as f64 / fps,
    })
}

/// The cost of each mouth for the frames of a pose. If the lips close in one of the frames, they
/// count as closing in all.
fn costs(pose: &[Frame], mouths: &[Mouth]) -> Vec<f64> {
    let closes = pose.iter().any(|frame| frame.closes);
    let cost = |mouth: &Mouth| -> f64 {
        let frames = pose.iter();
        frames.map(|frame| mouths::cost(mouth, frame, closes)).sum()
    };
    mouths.iter().map(cost).collect()
}
