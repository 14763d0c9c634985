//! Closes lips in landmarks.

use ndarray::{ArrayView2, ArrayViewMut2};

use super::approach;
use crate::{
    Result,
    mesh::ibug::{CHIN, INNER_LIPS, JAW, OUTER_LIPS},
    motion::{FaceModes, LandmarkClip, phrases::smooth_step},
    speech::LipClosures,
};

/// Gap at which lips touch in speech, metres more than in the neutral face.
pub const TOUCHING_M: f32 = -0.5e-3;
/// For each outer pair: the inner pair that it follows, and by which share.
const FOLLOWS: [(usize, f32); 5] = [(0, 0.4), (0, 0.8), (1, 1.0), (2, 0.8), (2, 0.4)];
/// The upper lip's part of a closing motion.
const UPPER_SHARE: f32 = 0.35;
/// How far the chin hangs below its rest position where lips touch, metres. A chin above the first
/// bound stays; no chin hangs below the second, where lips look stretched. grid_s1's tracked speaker
/// has 3.5 mm (median) there.
const CHIN_DROP_M: [f32; 2] = [2.5e-3, 4.2e-3];
/// Time in which the jaw rises before a contact and falls after it, seconds.
const JAW_S: f64 = 0.1;

/// Closes the lips of a clip where `closures` says so.
///
/// Where the jaw hangs too low for touching lips, it rises. Then the gap of each inner pair narrows
/// by its share ([`approach`]) of the way to touching, and the two lips meet in depth too. No gap
/// grows, and the corners stay.
///
/// # Errors
/// `Weights` for modes without the jaw.
pub fn close_lips(
    clip: &mut LandmarkClip,
    closures: &LipClosures,
    modes: &FaceModes,
) -> Result<()> {
    let fps = clip.fps;
    let frames = clip.displacements.outer_iter();
    let openings: Vec<f32> = frames.map(|face| opening(face)).collect();
    let shares = approach(&openings, &closures.contacts(), fps, &[]);
    raise_jaw(clip, &shares, modes)?;
    for (mut face, share) in clip.displacements.outer_iter_mut().zip(shares) {
        narrow(&mut face, share);
    }
    Ok(())
}

/// How far the lips of a frame `[68, 3]` are from touching, at the pair that is widest open, metres.
pub fn opening(face: ArrayView2<'_, f32>) -> f32 {
    let apart = |(upper, lower): (usize, usize)| face[[upper, 1]] - face[[lower, 1]] - TOUCHING_M;
    INNER_LIPS.into_iter().map(apart).fold(0.0, f32::max)
}

/// Moves the lips of a frame `[68, 3]` by a share of the way to touching.
pub fn narrow(face: &mut ArrayViewMut2<'_, f32>, share: f32) {
    if share == 0.0 {
        return;
    }
    let by = INNER_LIPS.map(|(upper, lower)| {
        let apart = |axis| face[[upper, axis]] - face[[lower, axis]];
        [share * (apart(1) - TOUCHING_M).max(0.0), share * apart(2)]
    });
    let mut bring = |(upper, lower): (usize, usize), [height, depth]: [f32; 2], part: f32| {
        for (axis, by) in [(1, part * height), (2, part * depth)] {
            face[[upper, axis]] -= UPPER_SHARE * by;
            face[[lower, axis]] += (1.0 - UPPER_SHARE) * by;
        }
    };
    for (pair, by) in INNER_LIPS.into_iter().zip(by) {
        bring(pair, by, 1.0);
    }
    for (pair, (follows, part)) in OUTER_LIPS.into_iter().zip(FOLLOWS) {
        bring(pair, by[follows], part);
    }
}

/// Raises the jaw line around frames in which lips touch.
fn raise_jaw(clip: &mut LandmarkClip, shares: &[f32], modes: &FaceModes) -> Result<()> {
    let jaw = modes.mode("jawOpen")?;
    let around = (JAW_S * clip.fps).ceil() as usize;
    let chin = clip.displacements.outer_iter().zip(shares);
    let excess: Vec<f32> = chin
        .map(|(face, share)| share * too_low(-face[[CHIN, 1]]))
        .collect();
    for (t, mut face) in clip.displacements.outer_iter_mut().enumerate() {
        let first = t.saturating_sub(around);
        let near = excess
            .iter()
            .enumerate()
            .skip(first)
            .take(t + around + 1 - first);
        let by = near.map(|(at, excess)| {
            let away_s = at.abs_diff(t) as f64 / clip.fps;
            excess * smooth_step(1.0 - away_s / JAW_S) as f32
        });
        let by = by.fold(0.0, f32::max);
        for n in JAW.filter(|_| by > 0.0) {
            for axis in 0..3 {
                face[[n, axis]] += by / jaw[[CHIN, 1]] * jaw[[n, axis]];
            }
        }
    }
    Ok(())
}

/// How far a chin drops below what touching lips allow, metres.
fn too_low(drop: f32) -> f32 {
    let [free, most] = CHIN_DROP_M;
    let room = most - free;
    let beyond = (drop - free).max(0.0);
    beyond - room * (1.0 - (-beyond / room).exp())
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::{close_lips as close_lips_of, *};

    fn close_lips(clip: &mut LandmarkClip, closures: &LipClosures) {
        close_lips_of(clip, closures, &FaceModes::open(None).unwrap()).unwrap();
    }

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
        let mut clip = open(11, 25.0);
        let mut probability = [0.1; 11];
        close_lips(&mut clip, &LipClosures::heard(&probability, 25.0));
        assert_eq!(clip, open(11, 25.0));
        probability[5] = 0.9;
        close_lips(&mut clip, &LipClosures::heard(&probability, 25.0));
        for pair in INNER_LIPS {
            assert!((gap(&clip, 5, pair) - TOUCHING_M).abs() < 1e-7);
            assert!((gap(&clip, 0, pair) - 0.01).abs() < 1e-4);
        }
    }

    #[test]
    fn a_jaw_that_hangs_rises_and_the_lips_move_no_faster_than_lips() {
        let fps = 60.0;
        let modes = FaceModes::open(None).unwrap();
        let jaw = modes.mode("jawOpen").unwrap();
        let mut clip = open(60, fps);
        for mut face in clip.displacements.outer_iter_mut() {
            face.assign(&(&jaw * (-8e-3 / jaw[[CHIN, 1]])));
        }
        let before = gap(&clip, 0, INNER_LIPS[1]);
        let mut probability = [0.0; 25];
        probability[12] = 0.9;
        close_lips(&mut clip, &LipClosures::heard(&probability, 25.0));
        let chin = |t: usize| -1e3 * clip.displacements[[t, CHIN, 1]];
        assert!(
            (chin(0) - 8.0).abs() < 1e-3 && (3.5..4.2).contains(&chin(29)),
            "{}",
            chin(29)
        );
        let gaps: Vec<f32> = (0..60).map(|t| gap(&clip, t, INNER_LIPS[1])).collect();
        let steps = gaps.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let fastest = steps.fold(0.0, f32::max);
        assert!(
            before > 6e-3 && gaps[29] < 0.0 && fastest < 6e-3,
            "{fastest} {gaps:?}"
        );
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
        let (after, before) = (clip.displacements, open(1, 25.0).displacements);
        let moved: Vec<usize> = (0..68)
            .filter(|n| after[[0, *n, 1]] != before[[0, *n, 1]])
            .collect();
        assert_eq!(
            moved,
            [
                49, 50, 51, 52, 53, 55, 56, 57, 58, 59, 61, 62, 63, 65, 66, 67
            ]
        );
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
        // The first closure moves by a fifth of a second; the second one is removed.
        let mended = heard.mended(&[[0.58, 0.62]]);
        let mut clip = open(50, 25.0);
        close_lips(&mut clip, &mended);
        let closed = |t: &usize| gap(&clip, *t, INNER_LIPS[1]) < 0.0;
        assert_eq!((0..50).filter(closed).collect::<Vec<_>>(), [15]);
        assert_eq!(mended.intervals(), [[0.58, 0.62]]);
        assert_eq!(heard.mended(&[]).intervals(), [] as [[f64; 2]; 0]);
    }

    #[test]
    fn lips_stay_together_as_long_as_an_artist_says() {
        let mended = LipClosures::heard(&[], 25.0).mended(&[[0.4, 0.8]]);
        let mut clip = open(60, 50.0);
        close_lips(&mut clip, &mended);
        assert!((20..=40).all(|t| gap(&clip, t, INNER_LIPS[1]) < 0.0));
        assert!(gap(&clip, 16, INNER_LIPS[1]) > 5e-3 && gap(&clip, 44, INNER_LIPS[1]) > 5e-3);
    }
}
