//! The measurements on one clip, and the table of scores over many clips.

use std::collections::BTreeMap;

use ndarray::{Axis, Slice};

use super::{bootstrap::Estimate, clip::Clip, features};
use crate::metrics::{self, LagCurve, Moments, Spectrum};
use anyface::Result;

const MM: f64 = 1000.0;
/// Longest delay, either way, that is searched, in frames.
const LAG_REACH: usize = 5;
/// Length of a segment of the spectrum, in frames: 2.6 s at 25 fps.
pub(super) const SEGMENT: usize = 64;

/// Scores by the key of their measure.
pub(super) type Scores = BTreeMap<&'static str, Estimate>;

/// One predictor on one clip; lengths in millimetres.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ClipScores {
    pub frames: f64,
    /// Moments of each feature, predicted and recorded.
    pub features: [Moments; features::COUNT],
    pub lag: LagCurve,
    /// Length of a frame, seconds.
    pub frame_s: f64,
    /// Spectra of the lip gap, predicted and recorded, mm².
    pub spectrum: [Spectrum; 2],
    pub lve_mm2: f64,
    pub mve_mm: f64,
    /// `None` where neither brows nor eyes were recorded.
    pub fdd_mm2: Option<f64>,
    pub delta_cd: f64,
}

pub(super) fn lips(n: usize) -> bool {
    (48..68).contains(&n)
}

/// Brows and eyes.
pub(super) fn upper(n: usize) -> bool {
    matches!(n, 17..=26 | 36..=47)
}

impl ClipScores {
    /// `prediction`: `[T, 68, 3]` metres, as long as the clip.
    pub(super) fn new(clip: &Clip, prediction: metrics::Clip<'_>) -> Result<Self> {
        // Judge only the landmarks and frames that the recording saw.
        let frames = Slice::from(clip.judged.clone());
        let judged_part = |motion: metrics::Clip<'_>| {
            let stretch = motion.slice_axis(Axis(0), frames);
            stretch.select(Axis(1), &clip.observed) * MM
        };
        let (p, g) = (judged_part(prediction), judged_part(clip.motion.view()));
        let (p, g) = (p.view(), g.view());
        let (lips, upper) = (clip.rows(lips), clip.rows(upper));
        let fdd = if upper.is_empty() {
            None
        } else {
            Some(metrics::face_dynamics_deviation(p, g, &upper)?)
        };
        let judged = |curve: Vec<f64>| curve[clip.judged.clone()].to_vec();
        let predicted = features::of(&clip.neutral, prediction)?.map(judged);
        let recorded = features::of(&clip.speaker, clip.motion.view())?.map(judged);
        let (gap, truth) = (&predicted[features::GAP], &recorded[features::GAP]);
        Ok(ClipScores {
            frames: clip.judged.len() as f64,
            features: std::array::from_fn(|k| Moments::of(&predicted[k], &recorded[k])),
            lag: LagCurve::of(gap, truth, LAG_REACH),
            frame_s: 1.0 / clip.fps,
            spectrum: [gap, truth].map(|gap| Spectrum::of(gap, clip.fps, SEGMENT)),
            lve_mm2: metrics::lip_vertex_error(p, g, &lips)?,
            mve_mm: metrics::mean_vertex_error(p, g)?,
            fdd_mm2: fdd,
            delta_cd: metrics::delta_cd(p, g)?,
        })
    }
}
