//! Speech features at the times of motion frames.

use ndarray::Array2;

use super::FeatureTrack;

/// Samples the features at times `t / fps`, linearly between neighbours. Beyond the ends the first
/// and the last feature are held.
///
/// Returns `[frames, C]`. Feature `i` of the track belongs to second `first_s + i / rate_hz`, as in
/// training (`training/speech/hubert.py`). The paper also resamples after the encoder.
pub fn at_motion_frames(track: &FeatureTrack, frames: usize, fps: f64) -> Array2<f32> {
    let (count, channels) = track.features.dim();
    let mut out = Array2::zeros((frames, channels));
    if count == 0 {
        return out;
    }
    for (t, mut row) in out.outer_iter_mut().enumerate() {
        let second = t as f64 / fps - track.first_s;
        let position = (second * track.rate_hz).clamp(0.0, (count - 1) as f64);
        let before = position.floor() as usize;
        let after = (before + 1).min(count - 1);
        let share = (position - before as f64) as f32;
        for (c, value) in row.iter_mut().enumerate() {
            let from = track.features[[before, c]];
            *value = from + (track.features[[after, c]] - from) * share;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::{Golden, distance};

    fn ramp(count: usize, rate_hz: f64) -> FeatureTrack {
        FeatureTrack {
            features: Array2::from_shape_fn((count, 2), |(i, c)| (i * (c + 1)) as f32),
            rate_hz,
            first_s: 0.0,
        }
    }

    #[test]
    fn instants_are_those_of_training() {
        let golden = Golden::open("instants");
        let number = |key: &str| golden.metadata(key).parse::<f64>().unwrap();
        let track = FeatureTrack {
            features: Array2::from_shape_vec((40, 3), golden.values("features")).unwrap(),
            rate_hz: number("rate_hz"),
            first_s: number("first_s"),
        };
        let sampled = at_motion_frames(&track, 26, number("fps"));
        assert!(distance(&sampled, &golden.values("sampled")) < 1e-5);
    }

    #[test]
    fn the_own_rate_changes_nothing() {
        let track = ramp(7, 25.0);
        assert_eq!(at_motion_frames(&track, 7, 25.0), track.features);
    }

    #[test]
    fn times_are_kept_between_rates() {
        let out = at_motion_frames(&ramp(51, 50.0), 30, 30.0);
        for t in 0..30 {
            assert!((out[[t, 0]] - t as f32 * 50.0 / 30.0).abs() < 1e-4);
            assert!((out[[t, 1]] - 2.0 * out[[t, 0]]).abs() < 1e-4);
        }
    }

    #[test]
    fn the_last_feature_is_held() {
        let out = at_motion_frames(&ramp(3, 25.0), 10, 25.0);
        assert_eq!(out[[9, 0]], 2.0);
    }
}
