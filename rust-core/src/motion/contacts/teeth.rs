//! Brings the lower lip to the upper teeth, in landmarks.

use super::approach;
use crate::{motion::LandmarkClip, speech::LipClosures};

/// Position of the middle of the lower lip in f and v relative to rest, metres downward and forward.
/// Medians of 387 f and v of grid_s1's tracked speaker, none of them from a held-out clip.
pub const AT_TEETH_M: [f32; 2] = [1.4e-3, -2.0e-3];
/// The inner rim of the lower lip's middle.
pub const LIP: usize = 66;
/// The landmarks that move with it, and their shares of its motion.
const FOLLOWS: [(usize, f32); 8] = [
    (66, 1.0),
    (65, 0.8),
    (67, 0.8),
    (57, 0.9),
    (56, 0.75),
    (58, 0.75),
    (55, 0.3),
    (59, 0.3),
];

/// Brings the lower lip of a clip up and back to the teeth where f or v is `heard`. It never moves the
/// lip away from them.
pub fn reach_teeth(clip: &mut LandmarkClip, heard: &LipClosures) {
    let away: Vec<[f32; 2]> = clip
        .displacements
        .outer_iter()
        .map(|face| excess([-face[[LIP, 1]], face[[LIP, 2]]]))
        .collect();
    let far: Vec<f32> = away.iter().map(distance).collect();
    let shares = approach(&far, &heard.contacts(), clip.fps, &[]);
    let frames = clip.displacements.outer_iter_mut().zip(away);
    for ((mut face, [down, forward]), share) in frames.zip(shares) {
        for (n, part) in FOLLOWS.into_iter().filter(|_| share > 0.0) {
            face[[n, 1]] += part * share * down;
            face[[n, 2]] -= part * share * forward;
        }
    }
}

/// How far the lip is below and in front of its position at the teeth, metres; at least 0.
pub fn excess(place: [f32; 2]) -> [f32; 2] {
    [0, 1].map(|axis| (place[axis] - AT_TEETH_M[axis]).max(0.0))
}

/// Length of that way, metres.
pub fn distance(excess: &[f32; 2]) -> f32 {
    excess[0].hypot(excess[1])
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    #[test]
    fn the_lower_lip_comes_to_the_teeth_and_the_upper_one_stays() {
        let mut displacements = Array3::zeros((25, 68, 3));
        for mut face in displacements.outer_iter_mut() {
            for (n, _) in FOLLOWS {
                (face[[n, 1]], face[[n, 2]]) = (-8e-3, 1e-3);
            }
        }
        let before = LandmarkClip {
            displacements,
            fps: 25.0,
        };
        let mut clip = before.clone();
        let mut probability = [0.0; 25];
        probability[12] = 0.9;
        reach_teeth(&mut clip, &LipClosures::heard(&probability, 25.0));
        let at = |t: usize| {
            [
                -clip.displacements[[t, LIP, 1]],
                clip.displacements[[t, LIP, 2]],
            ]
        };
        for axis in 0..2 {
            assert!(
                (at(12)[axis] - AT_TEETH_M[axis]).abs() < 1e-6,
                "{:?}",
                at(12)
            );
        }
        assert!((at(2)[0] - 8e-3).abs() < 1e-5 && at(11)[0] > at(12)[0]);
        for n in (0..68).filter(|n| FOLLOWS.iter().all(|(moves, _)| moves != n)) {
            assert_eq!(
                clip.displacements[[12, n, 1]],
                before.displacements[[12, n, 1]]
            );
        }
        let mut there = before.clone();
        there.displacements.fill(0.0);
        let mut depth = there.displacements.index_axis_mut(ndarray::Axis(2), 2);
        depth.fill(-3e-3);
        let expected = there.clone();
        reach_teeth(&mut there, &LipClosures::heard(&probability, 25.0));
        assert_eq!(there, expected);
    }
}
