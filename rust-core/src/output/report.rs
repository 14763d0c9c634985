//! What a run did, for machines and for people: sizes, times, and why nothing moves if nothing does.

use std::collections::BTreeMap;

use ndarray::{ArrayView3, s};
use serde::Serialize;

use crate::{audio::Waveform, motion::MotionClip};

/// Motion of a landmark below which nobody sees a mouth move.
const VISIBLE_M: f32 = 5e-4;
/// Share of samples at full scale from which a sound counts as clipped.
const CLIPPED_SHARE: f64 = 0.005;

/// A run in numbers; every field that does not apply is left out of the JSON.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Report {
    /// Version of the library.
    pub version: String,
    /// The file that was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub out: Option<String>,
    /// Number of frames.
    pub frames: usize,
    /// Frames per second.
    pub fps: f64,
    /// Length of the sound.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub audio_s: Option<f64>,
    /// Number of vertices.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertices: Option<usize>,
    /// Largest displacement of any vertex, mesh units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_displacement: Option<f32>,
    /// The same on a human head.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_displacement_mm: Option<f32>,
    /// Largest displacement of any landmark on a human head.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_landmark_displacement_mm: Option<f32>,
    /// Least and mean confidence of the landmarks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub landmark_confidence: Option<[f32; 2]>,
    /// How the lips meet: `open`, `slit` or `welded`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mouth: Option<String>,
    /// Seconds that each stage took.
    pub seconds: BTreeMap<String, f64>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Length of the longest displacement, in the unit of `displacements` `[T, V, 3]`.
pub(crate) fn largest(displacements: ArrayView3<'_, f32>) -> f32 {
    let squared = displacements
        .rows()
        .into_iter()
        .map(|d| d.iter().map(|x| x * x).sum::<f32>());
    squared.fold(0.0, f32::max).sqrt()
}

/// What is wrong with a sound that can still be used.
pub fn warnings_of_sound(waveform: &Waveform) -> Vec<String> {
    let mut warnings = Vec::new();
    if waveform.is_silent() {
        warnings.push(format!(
            "the sound is silent (its peak is {:.5} of full scale), so the mouth stays at rest",
            waveform.peak()
        ));
    }
    let clipped = waveform.samples.iter().filter(|x| x.abs() >= 0.999).count();
    if clipped as f64 > CLIPPED_SHARE * waveform.samples.len() as f64 {
        warnings.push(format!(
            "{:.1} % of the sound is clipped, which may open the mouth too far",
            100.0 * clipped as f64 / waveform.samples.len() as f64
        ));
    }
    if waveform.duration_s() < 0.1 {
        warnings.push(format!(
            "the sound is only {:.0} ms long, too short for a word",
            waveform.duration_s() * 1000.0
        ));
    }
    warnings
}

/// Says so when jaw and mouth move too little to be seen; blinks alone are no speech.
pub fn warnings_of_motion(motion: &MotionClip) -> Vec<String> {
    let jaw = largest(motion.displacements.slice(s![.., 0..17, ..]));
    let most = jaw.max(largest(motion.displacements.slice(s![.., 48..68, ..])));
    if most >= VISIBLE_M {
        return Vec::new();
    }
    vec![format!(
        "nothing moves visibly but the eyes: the largest motion of jaw and mouth is {:.3} mm on a human head; is there \
         speech in the sound, and on the channel that carries it?",
        most * 1000.0
    )]
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn speech_that_moves_needs_no_warning() {
        let samples = (0..16_000).map(|i| (i as f32 * 0.1).sin() * 0.5).collect();
        assert!(warnings_of_sound(&Waveform { samples }).is_empty());
        let mut displacements = Array3::zeros((3, 68, 3));
        displacements[[1, 8, 1]] = -0.01;
        let motion = MotionClip {
            displacements,
            fps: 30.0,
        };
        assert!(warnings_of_motion(&motion).is_empty());
        assert!((largest(motion.displacements.view()) - 0.01).abs() < 1e-9);
    }

    #[test]
    fn silence_clipping_brevity_and_stillness_are_named() {
        let silent = warnings_of_sound(&Waveform {
            samples: vec![0.0; 16_000],
        });
        assert!(silent[0].contains("silent"), "{silent:?}");
        let clipped = warnings_of_sound(&Waveform {
            samples: vec![1.0; 16_000],
        });
        assert!(clipped[0].contains("clipped"), "{clipped:?}");
        let short = warnings_of_sound(&Waveform {
            samples: vec![0.3; 320],
        });
        assert!(short[0].contains("20 ms"), "{short:?}");
        let still = MotionClip {
            displacements: Array3::zeros((3, 68, 3)),
            fps: 30.0,
        };
        assert!(warnings_of_motion(&still)[0].contains("nothing moves"));
        let mut blinking = still;
        blinking.displacements[[1, 43, 1]] = -0.008;
        assert!(warnings_of_motion(&blinking)[0].contains("nothing moves"));
    }
}
