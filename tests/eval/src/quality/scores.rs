//! What is measured on one clip, and the table of numbers that many clips give together.

use std::collections::BTreeMap;

use ndarray::{Array3, Axis};

use super::{
    bootstrap::{Estimate, estimate},
    clip::Clip,
    measures::MEASURES,
};
use crate::ict::IctLandmarks;
use anyface::{
    Result,
    metrics::{self, LagCurve, Moments, Spectrum},
};

const MM: f64 = 1000.0;
/// Delays that are searched, in frames.
const LAG_REACH: usize = 5;
/// Frames of a segment of the spectrum: 2.6 s at 25 fps.
pub(super) const SEGMENT: usize = 64;

/// Numbers by the key of their measure.
pub(super) type Scores = BTreeMap<&'static str, Estimate>;

/// One predictor on one clip; lengths in millimetres.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ClipScores {
    pub frames: f64,
    /// Inner-lip gap, predicted and recorded; and so on.
    pub gap: Moments,
    pub width: Moments,
    pub jaw: Option<Moments>,
    pub pucker: Option<Moments>,
    pub lag: LagCurve,
    /// Seconds of a frame.
    pub frame_s: f64,
    /// Of the gap, predicted and recorded, mm².
    pub spectrum: [Spectrum; 2],
    pub lve_mm2: f64,
    pub mve_mm: f64,
    pub eve_mm2: Option<f64>,
    pub fdd_mm2: Option<f64>,
    pub dtw_mm: f64,
    pub dfd_mm: f64,
    pub delta_m_mm2: f64,
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
    pub(super) fn new(
        clip: &Clip,
        prediction: metrics::Clip<'_>,
        ict: &IctLandmarks,
    ) -> Result<Self> {
        // Only what the recording saw is judged.
        let seen = |motion: metrics::Clip<'_>| motion.select(Axis(1), &clip.observed) * MM;
        let (p, g) = (seen(prediction), seen(clip.motion.view()));
        let (p, g) = (p.view(), g.view());
        let (lips, upper) = (clip.rows(lips), clip.rows(upper));
        let (eve, fdd) = match upper.is_empty() {
            true => (None, None),
            false => (
                Some(metrics::eye_vertex_error(p, g, &upper)?),
                Some(metrics::face_dynamics_deviation(p, g, &upper)?.signed),
            ),
        };
        let gaps = [clip.gap_mm(prediction)?, clip.gap_mm(clip.motion.view())?];
        let widths = [
            width_mm(clip, prediction)?,
            width_mm(clip, clip.motion.view())?,
        ];
        let against = |made: Result<Vec<f64>>, captured: &Option<Vec<f64>>| match captured {
            Some(captured) => made.map(|made| Some(Moments::of(&made, captured))),
            None => Ok(None),
        };
        Ok(ClipScores {
            frames: clip.frames() as f64,
            gap: Moments::of(&gaps[0], &gaps[1]),
            width: Moments::of(&widths[0], &widths[1]),
            jaw: against(ict.jaw_open(prediction), &clip.jaw)?,
            pucker: against(ict.pucker(prediction), &clip.pucker)?,
            lag: LagCurve::of(&gaps[0], &gaps[1], LAG_REACH),
            frame_s: 1.0 / clip.fps,
            spectrum: gaps.map(|gap| Spectrum::of(&gap, clip.fps, SEGMENT)),
            lve_mm2: metrics::lip_vertex_error(p, g, &lips)?,
            mve_mm: metrics::mean_vertex_error(p, g)?,
            eve_mm2: eve,
            fdd_mm2: fdd,
            dtw_mm: metrics::dynamic_time_warping(p, g, &lips)?,
            dfd_mm: metrics::discrete_frechet_distance(p, g, &lips)?,
            delta_m_mm2: metrics::delta_m(p, g)?,
            delta_cd: metrics::delta_cd(p, g)?,
        })
    }
}

fn width_mm(clip: &Clip, motion: metrics::Clip<'_>) -> Result<Vec<f64>> {
    let positions: Array3<f64> = (&motion + &clip.neutral) * MM;
    metrics::mouth_width(positions.view())
}

/// Every measure of `clips` with its interval; those that the clips do not hold are left out.
pub(super) fn scores(clips: &[ClipScores]) -> Scores {
    let found = MEASURES.iter().filter_map(|measure| {
        let value = estimate(clips, measure.of)?;
        Some((measure.key, value))
    });
    found.collect()
}
