//! The rows of the table: what each number means, and how to compute it over clips.

use super::{
    bootstrap::estimate,
    features::{CHIN_DROP, GAP, PROTRUSION, WIDTH},
    scores::{ClipScores, Scores},
};
use crate::metrics::{LagCurve, Moments, Spectrum};

const MS: f64 = 1000.0;

/// One measure, a row of the table.
pub(super) struct Measure {
    pub key: &'static str,
    pub title: &'static str,
    /// Decimals to show.
    pub digits: usize,
    pub definition: &'static str,
    pub of: fn(&[&ClipScores]) -> Option<f64>,
}

/// A feature's scatter within each clip, summed over clips: predicted, recorded and joint.
fn scatter(clips: &[&ClipScores], feature: usize) -> [f64; 3] {
    clips.iter().fold([0.0; 3], |sum, clip| {
        let moments = &clip.features[feature];
        let [predicted, recorded] = moments.scatter();
        let scatter = [predicted, recorded, moments.joint_scatter()];
        std::array::from_fn(|k| sum[k] + scatter[k])
    })
}

/// Mean of a value over clips, weighted by frames. None if any clip lacks the value.
fn mean(clips: &[&ClipScores], of: impl Fn(&ClipScores) -> Option<f64>) -> Option<f64> {
    let (mut sum, mut frames) = (0.0, 0.0);
    for clip in clips {
        sum += clip.frames * of(clip)?;
        frames += clip.frames;
    }
    (frames > 0.0).then(|| sum / frames)
}

fn r_by_clip<const FEATURE: usize>(clips: &[&ClipScores]) -> Option<f64> {
    mean(clips, |clip| Some(clip.features[FEATURE].r()))
}

fn r<const FEATURE: usize>(clips: &[&ClipScores]) -> Option<f64> {
    let mut sum = Moments::default();
    clips
        .iter()
        .for_each(|clip| sum.add(&clip.features[FEATURE]));
    (sum.count > 0.0).then(|| sum.r())
}

fn slope<const FEATURE: usize>(clips: &[&ClipScores]) -> Option<f64> {
    let [_, recorded, joint] = scatter(clips, FEATURE);
    (recorded > 0.0).then(|| joint / recorded)
}

/// Square root of the predicted over the recorded scatter within clips.
fn amplitude<const FEATURE: usize>(clips: &[&ClipScores]) -> Option<f64> {
    let [predicted, recorded, _] = scatter(clips, FEATURE);
    (recorded > 0.0).then(|| (predicted / recorded).sqrt())
}

fn lag_ms(clips: &[&ClipScores]) -> Option<f64> {
    let mut sum = LagCurve::default();
    for clip in clips {
        sum.add(&clip.lag);
    }
    let (frames, r) = sum.best();
    (r > 0.0).then(|| frames * clips[0].frame_s * MS)
}

/// Spectra of the lip gap over all clips, predicted and recorded.
fn spectra(clips: &[&ClipScores]) -> [Spectrum; 2] {
    [0, 1].map(|k| {
        let mut sum = Spectrum::default();
        clips.iter().for_each(|clip| sum.add(&clip.spectrum[k]));
        sum
    })
}

fn band_ratio(clips: &[&ClipScores], low: f64, high: f64) -> Option<f64> {
    let [predicted, recorded] = spectra(clips).map(|s| s.band(low, high));
    (recorded > 0.0).then(|| predicted / recorded)
}

/// The four measures of one feature.
macro_rules! of_feature {
    ($feature:ident, $name:literal, $definition:literal) => {
        [
            Measure {
                key: concat!($name, "_r_by_clip"),
                title: concat!($name, " r, by clip"),
                digits: 3,
                definition: concat!("Pearson r within each clip, averaged, of ", $definition),
                of: r_by_clip::<$feature>,
            },
            Measure {
                key: concat!($name, "_r"),
                title: concat!($name, " r"),
                digits: 3,
                definition: "the same over all frames of all clips together",
                of: r::<$feature>,
            },
            Measure {
                key: concat!($name, "_slope"),
                title: concat!($name, " slope"),
                digits: 2,
                definition: "least-squares slope of the prediction over the recording within clips: \
                             summed joint scatter over summed scatter of the recording; 1: as large",
                of: slope::<$feature>,
            },
            Measure {
                key: concat!($name, "_amplitude"),
                title: concat!($name, " amplitude"),
                digits: 2,
                definition: "standard deviation within clips, predicted over recorded",
                of: amplitude::<$feature>,
            },
        ]
    };
}

/// r by clip, r, slope and amplitude of the four features, in the order of the features.
static FEATURES: [[Measure; 4]; 4] = [
    of_feature!(GAP, "gap", "the inner-lip gap ‖62 − 66‖"),
    of_feature!(WIDTH, "width", "the mouth's width ‖48 − 54‖"),
    of_feature!(CHIN_DROP, "chin", "the chin's fall, −y of landmark 8"),
    of_feature!(
        PROTRUSION,
        "protrusion",
        "the lips' protrusion, mean z of 51 and 57"
    ),
];

static OTHERS: [Measure; 9] = [
    Measure {
        key: "lag_ms",
        title: "lag, ms",
        digits: 1,
        definition: "delay of the lip gap at its best correlation, within 5 frames either way, \
                     between frames by a parabola; positive: the prediction is late",
        of: lag_ms,
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
        key: "lve_root_mm",
        title: "√LVE, mm",
        digits: 2,
        definition: "root of the lip vertex error: mean over frames of the largest squared distance \
                     of a lip landmark (48 to 67) from the recorded one",
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
        key: "fdd_mm2",
        title: "FDD, mm²",
        digits: 2,
        definition: "upper-face dynamics deviation: mean over brows (17 to 26) of the deviation \
                     over time of ‖displacement‖², recorded minus predicted; positive: too still",
        of: |c| mean(c, |c| c.fdd_mm2),
    },
    Measure {
        key: "delta_cd",
        title: "δCd",
        digits: 3,
        definition: "mean 1 − cos(ΔP, ΔG), Δ the change to the next frame; a still face has 1",
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

/// How many of [`measures`] belong to the features. They come first.
pub(super) const FEATURE_ROWS: usize = 16;

/// All measures in the order of the table.
pub(super) fn measures() -> impl Iterator<Item = &'static Measure> {
    FEATURES.iter().flatten().chain(&OTHERS)
}

/// r by clip and slope of each feature, for the short table.
pub(super) fn pairs() -> impl Iterator<Item = [&'static Measure; 2]> {
    FEATURES.iter().map(|feature| [&feature[0], &feature[2]])
}

/// Every measure of `clips` with its interval, except measures that the clips do not have.
pub(super) fn scores(clips: &[ClipScores]) -> Scores {
    let estimates = measures().filter_map(|measure| {
        let value = estimate(clips, measure.of)?;
        Some((measure.key, value))
    });
    estimates.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::Spectrum;

    fn clip(predicted: &[f64], recorded: &[f64]) -> ClipScores {
        ClipScores {
            frames: predicted.len() as f64,
            features: [Moments::of(predicted, recorded); 4],
            lag: LagCurve::default(),
            frame_s: 0.04,
            spectrum: [Spectrum::default(), Spectrum::default()],
            lve_mm2: 0.0,
            mve_mm: 0.0,
            fdd_mm2: None,
            delta_cd: 0.0,
        }
    }

    #[test]
    fn slope_and_amplitude_are_those_within_clips() {
        let recorded = [1.0, 4.0, 2.0, 9.0];
        let half = |shift: f64| recorded.map(|x| 0.5 * x + shift);
        let clips = [clip(&half(0.0), &recorded), clip(&half(30.0), &recorded)];
        let all: Vec<&ClipScores> = clips.iter().collect();
        assert!((slope::<GAP>(&all).unwrap() - 0.5).abs() < 1e-9);
        assert!((amplitude::<GAP>(&all).unwrap() - 0.5).abs() < 1e-9);
        assert!((r_by_clip::<GAP>(&all).unwrap() - 1.0).abs() < 1e-9);
        assert!(r::<GAP>(&all).unwrap() < 0.5);
    }

    #[test]
    fn every_measure_has_a_key_of_its_own() {
        let mut keys: Vec<&str> = measures().map(|m| m.key).collect();
        let count = keys.len();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), count);
        assert_eq!(pairs().count(), 4);
        let titles: Vec<&str> = measures().take(FEATURE_ROWS).map(|m| m.title).collect();
        assert_eq!(titles[FEATURE_ROWS - 1], "protrusion amplitude");
    }
}
