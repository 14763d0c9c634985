//! Scales events to their requested strength: strength 1 is the full shape of a unit on either
//! side.
//!
//! The paper has no such step. With guidance alone, a unit reaches 0.4 to 1.3 of its shape, and the
//! two sides of a face differ.

use std::ops::Range;

use ndarray::{Array1, Array2, ArrayRef2, ArrayView1, ArrayViewMut1, Axis};

use crate::{conditions::EventTrack, motion::smoothed};

/// If the network moves a shape by less than this, the shape follows the event's own rise and fall.
const UNHEARD: f32 = 0.02;
/// Frames with less than this share of the largest change do not limit the gain.
const LEAST_SHARE: f32 = 0.1;
/// Within a slot a unit keeps at least this share of its largest difference for each unit of strength.
const HELD: f32 = 0.7;
/// Standard deviation of the Gaussian that smooths the network's course within a slot, seconds.
const COURSE_S: f64 = 0.08;
/// Largest factor by which a shape's change grows.
const MAX_GAIN: f32 = 6.0;

/// Lets the difference that events make in `weights` `[T, S]` compared with `plain`, the same speech
/// without them, rise and fall as `events.shown` does.
///
/// The network itself goes from nothing to a full smile within a tenth of a second. Its own course
/// within the slots remains: the difference for each unit of strength, which is held beyond them.
pub(super) fn retime(
    weights: &mut Array2<f32>,
    plain: &ArrayRef2<f32>,
    events: &EventTrack,
    fps: f64,
) {
    for (s, shown) in events.shown.axis_iter(Axis(1)).enumerate() {
        let (mask, plain) = (events.mask.column(s), plain.column(s));
        let mut weights = weights.column_mut(s);
        for run in runs(shown) {
            let in_slot = |t: &usize| mask[*t] == shown[*t];
            let for_one = |t: usize| (t, (weights[t] - plain[t]) / mask[t]);
            let mut course: Vec<(usize, f32)> = run.clone().filter(in_slot).map(for_one).collect();
            let most = course.iter().map(|(_, by)| *by).fold(0.0, f32::max);
            let held = |by: &mut f32| *by = by.max(HELD * most);
            course.iter_mut().for_each(|(_, by)| held(by));
            let held = run.clone().map(|t| {
                let next = course.partition_point(|(frame, _)| *frame <= t);
                course
                    .get(next.saturating_sub(1))
                    .map_or(0.0, |(_, by)| *by)
            });
            let course = smoothed(&held.collect::<Array1<f32>>(), COURSE_S * fps);
            for (t, by) in run.zip(course) {
                weights[t] = plain[t] + shown[t] * by;
            }
        }
    }
}

/// Scales the difference that events make in `weights` `[T, S]` compared with `plain`, the same
/// speech without them. The largest weight of each shape under an event then equals the strength in
/// `mask` `[T, S]` (Z of eq. 6 as it shows, times the factor of β). If the speech alone already exceeds that
/// strength during the event, its weights stay as they are in `plain`.
pub(super) fn calibrate(weights: &mut Array2<f32>, plain: &ArrayRef2<f32>, mask: &ArrayRef2<f32>) {
    for s in 0..mask.ncols() {
        let strengths = mask.column(s);
        for run in runs(strengths) {
            reach_strength(weights.column_mut(s), plain.column(s), strengths, run);
        }
    }
}

fn reach_strength(
    mut weights: ArrayViewMut1<'_, f32>,
    plain: ArrayView1<'_, f32>,
    strengths: ArrayView1<'_, f32>,
    run: Range<usize>,
) {
    let largest = |of: &dyn Fn(usize) -> f32| run.clone().map(of).fold(0.0f32, f32::max);
    let target = largest(&|t| strengths[t]);
    let change = |t: usize| weights[t] - plain[t];
    let most = largest(&change);
    if most < UNHEARD {
        for t in run {
            weights[t] = plain[t].max(strengths[t]);
        }
        return;
    }
    let tells = run.clone().filter(|&t| change(t) > LEAST_SHARE * most);
    let gains = tells.map(|t| (target - plain[t]) / change(t));
    let gain = gains.fold(MAX_GAIN, f32::min).max(0.0);
    for t in run {
        weights[t] = (plain[t] + gain * (weights[t] - plain[t])).max(0.0);
    }
}

/// Ranges of consecutive frames with a strength above 0.
fn runs(strengths: ArrayView1<'_, f32>) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for t in (0..strengths.len()).filter(|&t| strengths[t] > 0.0) {
        match ranges.last_mut() {
            Some(last) if last.end == t => last.end = t + 1,
            _ => ranges.push(t..t + 1),
        }
    }
    ranges
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    fn calibrated(weights: &[f32], plain: &[f32], mask: &[f32]) -> Vec<f32> {
        let column = |values: &[f32]| {
            ndarray::ArrayView1::from(values)
                .insert_axis(ndarray::Axis(1))
                .to_owned()
        };
        let mut out = column(weights);
        calibrate(&mut out, &column(plain), &column(mask));
        out.column(0).to_vec()
    }

    #[test]
    fn the_largest_weight_is_the_strength_that_was_asked_for() {
        let plain = [0.1, 0.2, 0.1, 0.3, 0.1, 0.1];
        let moved = [0.1, 0.4, 0.5, 0.6, 0.3, 0.1];
        for strength in [0.5, 1.0] {
            let mask = [0.0, strength / 2.0, strength, strength, strength / 2.0, 0.0];
            let out = calibrated(&moved, &plain, &mask);
            let most = out.iter().copied().fold(0.0, f32::max);
            assert!((most - strength).abs() < 1e-5, "{out:?}");
            assert_eq!((out[0], out[5]), (0.1, 0.1));
        }
    }

    #[test]
    fn what_the_network_leaves_still_follows_the_event_and_what_speech_does_already_stays() {
        assert_eq!(
            calibrated(&[0.0, 0.01, 0.0], &[0.0; 3], &[0.5, 1.0, 0.5]),
            [0.5, 1.0, 0.5]
        );
        let wide = [0.9, 0.9, 0.9];
        assert_eq!(
            calibrated(&[0.95, 1.0, 0.95], &wide, &[0.5, 0.5, 0.5]),
            wide
        );
    }

    #[test]
    fn runs_are_apart_where_nothing_is_asked() {
        assert_eq!(runs(array![0.0, 1.0, 0.5, 0.0, 1.0].view()), [1..3, 4..5]);
    }
}
