//! All metrics of one predictor over many clips.

use ndarray::{Array3, Axis};
use serde::Serialize;

use super::{clip::Clip, ict::IctLandmarks};
use crate::{Result, metrics};

const MM: f64 = 1000.0;
/// Delays that are searched, in frames.
const LAG_REACH: usize = 5;

/// Means over clips, weighted by their frames; lengths in millimetres.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Scores {
    /// Pearson r of the inner-lip gap, all clips together.
    pub lip_gap_r: f64,
    /// The same within each clip, averaged.
    pub lip_gap_r_by_clip: f64,
    /// Frames by which the gap comes late at its best correlation.
    pub lag_frames: f64,
    /// Pearson r of the jawOpen equivalent with the captured weight.
    pub jaw_r: Option<f64>,
    pub lve_mm2: f64,
    pub lve_root_mm: f64,
    pub mve_mm: f64,
    pub eve_mm2: Option<f64>,
    pub fdd_mm2: Option<f64>,
    pub dtw_mm: f64,
    pub dfd_mm: f64,
    pub delta_m_mm2: f64,
    pub delta_cd: f64,
}

impl Scores {
    /// Titles and values in the order of the table.
    pub(super) fn columns(&self) -> Vec<(&'static str, Option<f64>)> {
        vec![
            ("lip-gap r", Some(self.lip_gap_r)),
            ("by clip", Some(self.lip_gap_r_by_clip)),
            ("lag frames", Some(self.lag_frames)),
            ("jaw r", self.jaw_r),
            ("LVE mm2", Some(self.lve_mm2)),
            ("root mm", Some(self.lve_root_mm)),
            ("MVE mm", Some(self.mve_mm)),
            ("EVE mm2", self.eve_mm2),
            ("FDD mm2", self.fdd_mm2),
            ("DTW mm", Some(self.dtw_mm)),
            ("DFD mm", Some(self.dfd_mm)),
            ("dM mm2", Some(self.delta_m_mm2)),
            ("dCd", Some(self.delta_cd)),
        ]
    }
}

/// Sums over clips.
#[derive(Default)]
pub(super) struct Tally {
    /// Frame-weighted sums; `finish` divides.
    sums: Scores,
    frames: f64,
    gaps: [Vec<f64>; 2],
    jaws: [Vec<f64>; 2],
}

fn lips(n: usize) -> bool {
    (48..68).contains(&n)
}

/// Brows and eyes.
fn upper(n: usize) -> bool {
    matches!(n, 17..=26 | 36..=47)
}

impl Tally {
    /// `prediction`: `[T, 68, 3]` metres, as long as the clip.
    pub(super) fn add(
        &mut self,
        clip: &Clip,
        prediction: metrics::Clip<'_>,
        ict: &IctLandmarks,
    ) -> Result<()> {
        // Only what the recording saw is judged.
        let seen = |motion: metrics::Clip<'_>| motion.select(Axis(1), &clip.observed) * MM;
        let (p, g) = (seen(prediction), seen(clip.motion.view()));
        let (p, g) = (p.view(), g.view());
        let region = |of: fn(usize) -> bool| -> Vec<usize> {
            let found = clip.observed.iter().enumerate();
            found.filter(|(_, n)| of(**n)).map(|(row, _)| row).collect()
        };
        let (lips, upper) = (region(lips), region(upper));
        let weight = clip.frames() as f64;
        let sums = &mut self.sums;
        sums.lve_mm2 += weight * metrics::lip_vertex_error(p, g, &lips)?;
        sums.mve_mm += weight * metrics::mean_vertex_error(p, g)?;
        if !upper.is_empty() {
            let eve = metrics::eye_vertex_error(p, g, &upper)?;
            *sums.eve_mm2.get_or_insert(0.0) += weight * eve;
            let fdd = metrics::face_dynamics_deviation(p, g, &upper)?.signed;
            *sums.fdd_mm2.get_or_insert(0.0) += weight * fdd;
        }
        sums.dtw_mm += weight * metrics::dynamic_time_warping(p, g, &lips)?;
        sums.dfd_mm += weight * metrics::discrete_frechet_distance(p, g, &lips)?;
        sums.delta_m_mm2 += weight * metrics::delta_m(p, g)?;
        sums.delta_cd += weight * metrics::delta_cd(p, g)?;
        self.frames += weight;
        self.add_curves(clip, prediction, ict)
    }

    fn add_curves(
        &mut self,
        clip: &Clip,
        prediction: metrics::Clip<'_>,
        ict: &IctLandmarks,
    ) -> Result<()> {
        let gap = |motion: metrics::Clip<'_>| -> Result<Vec<f64>> {
            let positions: Array3<f64> = &motion + &clip.neutral;
            metrics::lip_gap(positions.view())
        };
        let (p, g) = (gap(prediction)?, gap(clip.motion.view())?);
        self.sums.lip_gap_r_by_clip += clip.frames() as f64 * metrics::pearson(&p, &g);
        self.gaps[0].extend(p);
        self.gaps[1].extend(g);
        if let Some(jaw) = &clip.jaw {
            self.jaws[0].extend(ict.jaw_open(prediction)?);
            self.jaws[1].extend(jaw);
        }
        Ok(())
    }

    pub(super) fn finish(self) -> Scores {
        let mean = |sum: f64| sum / self.frames.max(1.0);
        let s = self.sums;
        Scores {
            lip_gap_r: metrics::pearson(&self.gaps[0], &self.gaps[1]),
            lip_gap_r_by_clip: mean(s.lip_gap_r_by_clip),
            lag_frames: metrics::best_lag(&self.gaps[0], &self.gaps[1], LAG_REACH).0 as f64,
            jaw_r: (!self.jaws[0].is_empty())
                .then(|| metrics::pearson(&self.jaws[0], &self.jaws[1])),
            lve_mm2: mean(s.lve_mm2),
            lve_root_mm: mean(s.lve_mm2).sqrt(),
            mve_mm: mean(s.mve_mm),
            eve_mm2: s.eve_mm2.map(mean),
            fdd_mm2: s.fdd_mm2.map(mean),
            dtw_mm: mean(s.dtw_mm),
            dfd_mm: mean(s.dfd_mm),
            delta_m_mm2: mean(s.delta_m_mm2),
            delta_cd: mean(s.delta_cd),
        }
    }
}
