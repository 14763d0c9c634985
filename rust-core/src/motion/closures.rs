//! Lips that touch where the sound says p, b or m.
//!
//! Whatever is trained by squared error blurs closure, which lasts a frame or two; the speech
//! encoder's own read-out of it ([`LipClosures`]) does not. Twin of `lips_closed` in
//! `training/corpus/closures.py`.

use super::LandmarkClip;
use crate::{
    mesh::ibug::{INNER_LIPS, OUTER_LIPS},
    speech::LipClosures,
};

/// Opening over that of the neutral face at which lips touch in speech, metres.
const TOUCHING: f32 = -0.5e-3;
/// Of each outer pair the inner pair that it follows, and how far.
const FOLLOWS: [(usize, f32); 5] = [(0, 0.4), (0, 0.8), (1, 1.0), (2, 0.8), (2, 0.4)];
/// Part of a closing motion that the upper lip makes.
const UPPER_SHARE: f32 = 0.35;

/// Closes the lips of a clip.
///
/// [`LipClosures::share`] decides how far the gap of each inner pair goes to where lips touch, and how
/// far one lip comes forward to the other; it never widens. Frames where nothing closes stay as the network
/// made them, which moves as recorded lips do, and so do the corners.
pub fn close_lips(clip: &mut LandmarkClip, closures: &LipClosures) {
    let fps = clip.fps;
    for (t, mut face) in clip.displacements.outer_iter_mut().enumerate() {
        let share = closures.share(t as f64 / fps, 1.0 / fps);
        if share == 0.0 {
            continue;
        }
        let by = INNER_LIPS.map(|(upper, lower)| {
            let apart = |axis| face[[upper, axis]] - face[[lower, axis]];
            [share * (apart(1) - TOUCHING).max(0.0), share * apart(2)]
        });
        let mut narrow = |(upper, lower): (usize, usize), [height, depth]: [f32; 2], part: f32| {
            for (axis, by) in [(1, part * height), (2, part * depth)] {
                face[[upper, axis]] -= UPPER_SHARE * by;
                face[[lower, axis]] += (1.0 - UPPER_SHARE) * by;
            }
        };
        for (pair, by) in INNER_LIPS.into_iter().zip(by) {
            narrow(pair, by, 1.0);
        }
        for (pair, (follows, part)) in OUTER_LIPS.into_iter().zip(FOLLOWS) {
            narrow(pair, by[follows], part);
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    /// Frames of an open mouth, 10 mm at the inner lips.
    fn open(frames: usize, fps: f64) -> LandmarkClip {
        let mut displacements = Array3::zeros((frames, 68, 3));
        for mut frame in displacements.outer_iter_mut() {
            for lower in [55, 56, 57, 58, 59, 65, 66, 67] {
                frame[[lower, 1]] = -0.01;
            }
        }
        LandmarkClip { displacements, fps }
    }

    fn gap(clip: &LandmarkClip, t: usize, (upper, lower): (usize, usize)) -> f32 {
        clip.displacements[[t, upper, 1]] - clip.displacements[[t, lower, 1]]
    }

    #[test]
    fn sure_closures_touch_and_unlikely_ones_change_nothing() {
        let mut clip = open(3, 25.0);
        close_lips(&mut clip, &LipClosures::heard(&[0.9, 0.1, 0.1], 25.0));
        for pair in INNER_LIPS {
            assert!((gap(&clip, 0, pair) - TOUCHING).abs() < 1e-7);
        }
        let later = |clip: &LandmarkClip| {
            clip.displacements
                .slice(ndarray::s![1.., .., ..])
                .to_owned()
        };
        assert_eq!(later(&clip), later(&open(3, 25.0)));
    }

    #[test]
    fn lips_that_close_meet_in_depth_too() {
        let mut clip = open(1, 25.0);
        for lower in [65, 66, 67] {
            clip.displacements[[0, lower, 2]] = -0.003;
        }
        close_lips(&mut clip, &LipClosures::heard(&[0.9], 25.0));
        for (upper, lower) in INNER_LIPS {
            let apart = clip.displacements[[0, upper, 2]] - clip.displacements[[0, lower, 2]];
            assert!(apart.abs() < 1e-7, "{apart}");
        }
    }

    #[test]
    fn a_closure_of_one_frame_is_met_at_any_rate() {
        for fps in [24.0, 25.0, 29.97, 30.0, 48.0, 60.0] {
            for at in 3..12 {
                let mut clip = open(fps as usize, fps);
                let mut probability = [0.0; 25];
                probability[at] = 0.9;
                close_lips(&mut clip, &LipClosures::heard(&probability, 25.0));
                let gaps = (0..fps as usize).map(|t| gap(&clip, t, INNER_LIPS[1]));
                let least = gaps.fold(f32::INFINITY, f32::min);
                assert!(
                    least < 0.0,
                    "{fps} frames a second, closure at {at}: {least}"
                );
            }
        }
    }

    #[test]
    fn lips_that_are_closer_already_stay() {
        let mut clip = open(1, 25.0);
        clip.displacements.fill(0.0);
        for lower in [65, 66, 67] {
            clip.displacements[[0, lower, 1]] = 0.002;
        }
        let before = clip.clone();
        close_lips(&mut clip, &LipClosures::heard(&[1.0], 25.0));
        assert_eq!(clip, before);
    }

    #[test]
    fn corners_and_the_rest_of_the_face_stay() {
        let mut clip = open(1, 25.0);
        close_lips(&mut clip, &LipClosures::heard(&[1.0], 25.0));
        let (made, before) = (clip.displacements, open(1, 25.0).displacements);
        let found: Vec<usize> = (0..68)
            .filter(|n| made[[0, *n, 1]] != before[[0, *n, 1]])
            .collect();
        assert_eq!(
            found,
            [
                49, 50, 51, 52, 53, 55, 56, 57, 58, 59, 61, 62, 63, 65, 66, 67
            ]
        );
    }

    #[test]
    fn the_foot_of_a_peak_closes_nothing() {
        let mut clip = open(5, 25.0);
        close_lips(
            &mut clip,
            &LipClosures::heard(&[0.0, 0.5, 0.9, 0.8, 0.3], 25.0),
        );
        let closed: Vec<bool> = (0..5).map(|t| gap(&clip, t, INNER_LIPS[1]) < 0.0).collect();
        assert_eq!(closed, [false, false, true, true, false]);
    }

    #[test]
    fn closing_is_the_same_on_both_sides() {
        let mut clip = open(1, 25.0);
        close_lips(&mut clip, &LipClosures::heard(&[0.3], 25.0));
        for (left, right) in [(61, 63), (67, 65), (49, 53), (59, 55), (50, 52), (58, 56)] {
            assert_eq!(
                clip.displacements[[0, left, 1]],
                clip.displacements[[0, right, 1]]
            );
        }
    }

    #[test]
    fn without_a_probability_nothing_closes() {
        let mut clip = open(3, 25.0);
        close_lips(&mut clip, &LipClosures::heard(&[], 25.0));
        assert_eq!(clip, open(3, 25.0));
    }

    #[test]
    fn what_was_heard_and_given_back_closes_the_same_to_the_bit() {
        let heard = LipClosures::heard(&[0.1, 0.3, 0.9, 0.8, 0.15, 0.0, 0.0, 0.28, 0.1], 25.0);
        let mended = heard.mended(&heard.intervals());
        let (mut plain, mut again) = (open(20, 60.0), open(20, 60.0));
        close_lips(&mut plain, &heard);
        close_lips(&mut again, &mended);
        assert_ne!(plain, open(20, 60.0));
        assert_eq!(plain, again);
    }

    #[test]
    fn a_closure_moves_goes_and_comes() {
        let mut probability = [0.0; 50];
        (probability[10], probability[30]) = (0.9, 0.9);
        let heard = LipClosures::heard(&probability, 25.0);
        // The first is moved by a fifth of a second, the second goes.
        let mended = heard.mended(&[[0.58, 0.62]]);
        let mut clip = open(50, 25.0);
        close_lips(&mut clip, &mended);
        let closed: Vec<usize> = (0..50)
            .filter(|t| gap(&clip, *t, INNER_LIPS[1]) < 0.0)
            .collect();
        assert_eq!(closed, [15]);
        assert_eq!(mended.intervals(), [[0.58, 0.62]]);
        assert_eq!(heard.mended(&[]).intervals(), [] as [[f64; 2]; 0]);
    }

    #[test]
    fn a_given_interval_is_met_at_any_rate() {
        for fps in [12.0, 24.0, 25.0, 29.97, 60.0] {
            for at in 0..20 {
                let start = 0.3 + 0.007 * f64::from(at);
                let given = LipClosures::heard(&[], 25.0).mended(&[[start, start + 0.01]]);
                let mut clip = open(fps as usize, fps);
                close_lips(&mut clip, &given);
                let gaps = (0..fps as usize).map(|t| gap(&clip, t, INNER_LIPS[1]));
                assert!(gaps.fold(f32::INFINITY, f32::min) < 0.0, "{fps}, {start}");
            }
        }
    }
}
