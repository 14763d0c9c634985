//! The rows of the table: what each number is, and how clips give it together.

use super::scores::ClipScores;
use anyface::metrics::{LagCurve, Moments, Spectrum};

const MS: f64 = 1000.0;

/// One number of the table.
pub(super) struct Measure {
    pub key: &'static str,
    pub title: &'static str,
    /// Decimals that are shown.
    pub digits: usize,
    pub definition: &'static str,
    pub of: fn(&[&ClipScores]) -> Option<f64>,
}

/// Sum of the correlations' moments, where every clip has them.
fn pooled(clips: &[&ClipScores], of: fn(&ClipScores) -> Option<&Moments>) -> Option<Moments> {
    let mut sum = Moments::default();
    for clip in clips {
        sum.add(of(clip)?);
    }
    (sum.count > 0.0).then_some(sum)
}

/// Mean over clips, weighted by frames, of what every clip has.
fn mean(clips: &[&ClipScores], of: impl Fn(&ClipScores) -> Option<f64>) -> Option<f64> {
    let (mut sum, mut frames) = (0.0, 0.0);
    for clip in clips {
        sum += clip.frames * of(clip)?;
        frames += clip.frames;
    }
    (frames > 0.0).then(|| sum / frames)
}

fn gap_r(clips: &[&ClipScores]) -> Option<f64> {
    Some(pooled(clips, |c| Some(&c.gap))?.r())
}

fn width_r(clips: &[&ClipScores]) -> Option<f64> {
    Some(pooled(clips, |c| Some(&c.width))?.r())
}

fn jaw_r(clips: &[&ClipScores]) -> Option<f64> {
    Some(pooled(clips, |c| c.jaw.as_ref())?.r())
}

fn pucker_r(clips: &[&ClipScores]) -> Option<f64> {
    Some(pooled(clips, |c| c.pucker.as_ref())?.r())
}

/// Root of the ratio of the scatters within clips.
fn amplitude(clips: &[&ClipScores], of: fn(&ClipScores) -> &Moments) -> Option<f64> {
    let sum = |k: usize| clips.iter().map(|c| of(c).scatter()[k]).sum::<f64>();
    let (made, recorded) = (sum(0), sum(1));
    (recorded > 0.0).then(|| (made / recorded).sqrt())
}

fn lag_ms(clips: &[&ClipScores]) -> Option<f64> {
    let mut sum = LagCurve::default();
    for clip in clips {
        sum.add(&clip.lag);
    }
    let (frames, r) = sum.best();
    (r > 0.0).then(|| frames * clips[0].frame_s * MS)
}

/// Spectra of the gap over all clips, predicted and recorded.
fn spectra(clips: &[&ClipScores]) -> [Spectrum; 2] {
    [0, 1].map(|k| {
        let mut sum = Spectrum::default();
        clips.iter().for_each(|clip| sum.add(&clip.spectrum[k]));
        sum
    })
}

fn band_ratio(clips: &[&ClipScores], low: f64, high: f64) -> Option<f64> {
    let [made, recorded] = spectra(clips).map(|s| s.band(low, high));
    (recorded > 0.0).then(|| made / recorded)
}

/// In the order of the table.
pub(super) static MEASURES: [Measure; 22] = [
    Measure {
        key: "lip_gap_r",
        title: "lip-gap r",
        digits: 3,
        definition: "Pearson r of the inner-lip gap ‖62 − 66‖, all frames of all clips together",
        of: gap_r,
    },
    Measure {
        key: "lip_gap_r_by_clip",
        title: "lip-gap r, by clip",
        digits: 3,
        definition: "the same within each clip, averaged",
        of: |c| mean(c, |c| Some(c.gap.r())),
    },
    Measure {
        key: "width_r",
        title: "mouth-width r",
        digits: 3,
        definition: "Pearson r of the mouth's width ‖48 − 54‖, all frames together",
        of: width_r,
    },
    Measure {
        key: "width_r_by_clip",
        title: "mouth-width r, by clip",
        digits: 3,
        definition: "the same within each clip, averaged",
        of: |c| mean(c, |c| Some(c.width.r())),
    },
    Measure {
        key: "jaw_r",
        title: "jawOpen r",
        digits: 3,
        definition: "Pearson r of the captured jawOpen weight with the jawOpen weight that comes \
                     closest to the chin's motion (landmarks 6 to 10), least squares",
        of: jaw_r,
    },
    Measure {
        key: "pucker_r",
        title: "pucker r",
        digits: 3,
        definition: "Pearson r of the captured mouthPucker weight with the mouthPucker weight of \
                     the least-squares fit of nine ICT modes to mouth and chin (landmarks 48 to \
                     67, 6 to 10)",
        of: pucker_r,
    },
    Measure {
        key: "lag_ms",
        title: "lag, ms",
        digits: 1,
        definition: "delay of the lip gap at its best correlation, within 5 frames either way, \
                     between frames by a parabola; positive: the prediction is late",
        of: lag_ms,
    },
    Measure {
        key: "gap_amplitude",
        title: "lip-gap amplitude",
        digits: 2,
        definition: "standard deviation of the lip gap within clips, predicted over recorded",
        of: |c| amplitude(c, |c| &c.gap),
    },
    Measure {
        key: "width_amplitude",
        title: "mouth-width amplitude",
        digits: 2,
        definition: "the same of the mouth's width",
        of: |c| amplitude(c, |c| &c.width),
    },
    Measure {
        key: "power_0_3_hz",
        title: "gap power 0–3 Hz",
        digits: 2,
        definition: "power of the lip gap in the band, predicted over recorded (Welch, Hann \
                     windows of 64 frames, each freed of its mean)",
        of: |c| band_ratio(c, 0.0, 3.0),
    },
    Measure {
        key: "power_3_6_hz",
        title: "gap power 3–6 Hz",
        digits: 2,
        definition: "the same from 3 to 6 Hz",
        of: |c| band_ratio(c, 3.0, 6.0),
    },
    Measure {
        key: "power_6_12_hz",
        title: "gap power 6–12 Hz",
        digits: 2,
        definition: "the same from 6 to 12 Hz",
        of: |c| band_ratio(c, 6.0, 12.0),
    },
    Measure {
        key: "lve_mm2",
        title: "LVE, mm²",
        digits: 2,
        definition: "lip vertex error: mean over frames of the largest squared distance of a lip \
                     landmark (48 to 67) from the recorded one",
        of: |c| mean(c, |c| Some(c.lve_mm2)),
    },
    Measure {
        key: "lve_root_mm",
        title: "√LVE, mm",
        digits: 2,
        definition: "its square root",
        of: |c| mean(c, |c| Some(c.lve_mm2)).map(f64::sqrt),
    },
    Measure {
        key: "mve_mm",
        title: "MVE, mm",
        digits: 2,
        definition: "mean distance of a landmark from the recorded one",
        of: |c| mean(c, |c| Some(c.mve_mm)),
    },
    Measure {
        key: "eve_mm2",
        title: "EVE, mm²",
        digits: 2,
        definition: "LVE's formula over brows and eyes (17 to 26, 36 to 47)",
        of: |c| mean(c, |c| c.eve_mm2),
    },
    Measure {
        key: "fdd_mm2",
        title: "FDD, mm²",
        digits: 2,
        definition: "upper-face dynamics deviation: mean over brows and eyes of the deviation \
                     over time of ‖displacement‖², recorded minus predicted; positive: too still",
        of: |c| mean(c, |c| c.fdd_mm2),
    },
    Measure {
        key: "dtw_mm",
        title: "DTW, mm",
        digits: 0,
        definition: "dynamic time warping: smallest sum of distances of lip frames (60 numbers \
                     each) along a monotone path",
        of: |c| mean(c, |c| Some(c.dtw_mm)),
    },
    Measure {
        key: "dfd_mm",
        title: "DFD, mm",
        digits: 1,
        definition: "discrete Fréchet distance of the same frames",
        of: |c| mean(c, |c| Some(c.dfd_mm)),
    },
    Measure {
        key: "delta_m_mm2",
        title: "δM, mm²",
        digits: 3,
        definition: "mean ‖ΔP − ΔG‖², Δ the change to the next frame",
        of: |c| mean(c, |c| Some(c.delta_m_mm2)),
    },
    Measure {
        key: "delta_cd",
        title: "δCd",
        digits: 3,
        definition: "mean 1 − cos(ΔP, ΔG); a still face has 1",
        of: |c| mean(c, |c| Some(c.delta_cd)),
    },
    Measure {
        key: "clips",
        title: "clips",
        digits: 0,
        definition: "number of clips that the predictor was measured on",
        of: |c| (!c.is_empty()).then_some(c.len() as f64),
    },
];
