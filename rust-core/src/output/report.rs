//! The report of a run, for machines and people: sizes, times, and the reason if nothing moves.

use std::collections::BTreeMap;

use serde::Serialize;

use super::TargetReport;
use crate::{
    audio::Levels,
    motion::{Extent, VISIBLE_MM, Visibility, bounds::DISPLACEMENT},
    speech::HeardEmotion,
};

/// A sound counts as clipped if more than this share of its samples is at full scale.
const CLIPPED_SHARE: f64 = 0.005;

/// A run in numbers. The JSON leaves out every field that does not apply.
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
    /// Length of the sound, seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub audio_s: Option<f64>,
    /// Seconds of sound that are missing from a damaged file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missing_audio_s: Option<f64>,
    /// Number of vertices.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertices: Option<usize>,
    /// Largest displacement of any vertex, mesh units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_displacement: Option<f32>,
    /// The same on a human head, millimetres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_displacement_mm: Option<f32>,
    /// Largest displacement of any landmark on a human head, millimetres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_landmark_displacement_mm: Option<f32>,
    /// Lowest and mean confidence of the landmarks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub landmark_confidence: Option<[f32; 2]>,
    /// The object that has the face, if the file has several heads or the caller chose one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub head: Option<String>,
    /// How the lips meet: `open`, `slit` or `welded`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mouth: Option<String>,
    /// The morph targets of the file that the take drives.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub targets: Option<TargetReport>,
    /// What `--emotion auto` heard: the times `time_s`, and at each of them the probability of every
    /// emotion, the intensity that the face shows, and valence and arousal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heard_emotion: Option<HeardEmotion>,
    /// Most memory that the job takes at any time, as far as known before it starts, in MB of 2²⁰
    /// bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_mb: Option<u64>,
    /// Duration of each stage, seconds.
    pub seconds: BTreeMap<String, f64>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Warnings about a sound that has faults but can still be used.
pub fn warnings_of_sound(levels: &Levels) -> Vec<String> {
    let mut warnings = Vec::new();
    if levels.is_silent() {
        warnings.push(format!(
            "the sound is silent (its peak is {:.5} of full scale), so the mouth stays at rest",
            levels.peak
        ));
    }
    let clipped = levels.clipped as f64 / levels.samples as f64;
    if clipped > CLIPPED_SHARE {
        warnings.push(format!(
            "{:.1} % of the sound is clipped, which may open the mouth too far",
            100.0 * clipped
        ));
    }
    if levels.duration_s() < 0.1 {
        warnings.push(format!(
            "the sound is only {:.0} ms long, too short for a word",
            levels.duration_s() * 1000.0
        ));
    }
    warnings
}

impl Report {
    /// Notes how far mesh and landmarks move. Warns if that is too little to see the face speak, or
    /// more than a face can move.
    ///
    /// `extent`: in mesh units. `metres_per_unit`: length of a mesh unit. `articulation`: the value of
    /// the control.
    pub fn note_motion(&mut self, extent: &Extent, metres_per_unit: f64, articulation: f32) {
        let to_mm = 1000.0 * metres_per_unit as f32;
        let moved_mm = to_mm * extent.landmarks;
        self.largest_displacement = extent.largest;
        self.largest_displacement_mm = extent.largest.map(|units| units * to_mm);
        self.largest_landmark_displacement_mm = Some(moved_mm);
        let mesh_mm = self.largest_displacement_mm.unwrap_or(moved_mm);
        let lips_mm = to_mm * extent.lips;
        let face_mm = 1000.0 * DISPLACEMENT.face;
        if mesh_mm.max(moved_mm) > face_mm {
            let farthest = mesh_mm.max(moved_mm);
            self.warnings.push(format!(
                "something moves by {farthest:.0} mm on a human head, which no face does (up to {face_mm:.0}); is the \
                 motion in another unit, or the face smaller than it was found?"
            ));
        }
        self.warnings.extend(match Visibility::of(mesh_mm, lips_mm, articulation) {
            Visibility::Speaks => None,
            Visibility::Nothing if moved_mm >= VISIBLE_MM => Some(format!(
                "the landmarks move by up to {moved_mm:.2} mm but the mesh by {mesh_mm:.3} mm only; are \
                 the landmarks on the face?"
            )),
            Visibility::Nothing => Some(format!(
                "nothing moves visibly: by {mesh_mm:.3} mm on a human head at most; is there speech in \
                 the sound, and on the channel that carries it?"
            )),
            Visibility::LipsRest => Some(format!(
                "nothing moves visibly but lids and brows: the lips move by {lips_mm:.3} mm on a human \
                 head at most; is there speech in the sound, and on the channel that carries it?"
            )),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audio::Waveform;
    use ndarray::Array3;

    #[test]
    fn speech_that_moves_needs_no_warning() {
        let samples = (0..16_000).map(|i| (i as f32 * 0.1).sin() * 0.5).collect();
        assert!(warnings_of_sound(&Waveform { samples }.levels()).is_empty());
        let mut displacements = Array3::zeros((3, 68, 3));
        displacements[[1, 66, 1]] = -0.01;
        let mut report = Report::default();
        report.note_motion(&Extent::of(Some(0.01), displacements.view()), 1.0, 1.0);
        assert_eq!(report.warnings, Vec::<String>::new());
        report.note_motion(&Extent::of(Some(0.3), displacements.view()), 1.0, 1.0);
        assert!(report.warnings.pop().unwrap().contains("no face does"));
        report.note_motion(&Extent::of(Some(0.01), displacements.view()), 1.0, 1.0);
        assert!((report.largest_landmark_displacement_mm.unwrap() - 10.0).abs() < 1e-4);
        report.note_motion(&Extent::of(Some(0.0), displacements.view()), 1.0, 1.0);
        assert!(report.warnings[0].contains("are the landmarks on the face"));
    }

    #[test]
    fn silence_clipping_brevity_and_stillness_are_named() {
        let silent = warnings_of_sound(
            &Waveform {
                samples: vec![0.0; 16_000],
            }
            .levels(),
        );
        assert!(silent[0].contains("silent"), "{silent:?}");
        let clipped = warnings_of_sound(
            &Waveform {
                samples: vec![1.0; 16_000],
            }
            .levels(),
        );
        assert!(clipped[0].contains("clipped"), "{clipped:?}");
        let short = warnings_of_sound(
            &Waveform {
                samples: vec![0.3; 320],
            }
            .levels(),
        );
        assert!(short[0].contains("20 ms"), "{short:?}");
        let mut report = Report::default();
        let mut still = Array3::zeros((3, 68, 3));
        report.note_motion(&Extent::of(None, still.view()), 1.0, 1.0);
        still[[1, 43, 1]] = -0.008;
        report.note_motion(&Extent::of(Some(0.008), still.view()), 1.0, 1.0);
        assert!(report.warnings[0].contains("nothing moves visibly:"));
        assert!(report.warnings[1].contains("but lids and brows"));
    }
}
