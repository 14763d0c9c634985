//! Brings lips together by the weights of shapes.

use ndarray::{Array2, Array3, ArrayView3, ArrayViewMut1, s};

use super::{
    super::{
        FaceModes, WeightClip,
        contacts::{TOUCHING_M, approach},
    },
    reach::{Aim, corners_of, reach},
};
use crate::{Result, mesh::ibug::INNER_LIPS, speech::LipClosures};

/// How much farther than their contact the lips may be pressed, metres. Any farther, one passes
/// through the other.
const PRESSED_M: f32 = 0.3e-3;
const CLOSE: &str = "mouthClose";
/// A shape that changes no gap between the lips by more than this is left alone, metres.
const STILL_M: f32 = 0.1e-3;
const PAIRS: usize = INNER_LIPS.len();

/// How far each shape parts the lips of one head.
///
/// ```
/// use anyface::{motion::{FaceModes, LipGaps, WeightClip}, speech::LipClosures, rig::ARKIT};
///
/// let names: Vec<String> = ARKIT[..51].iter().map(|name| name.to_string()).collect();
/// let mut clip = WeightClip { weights: ndarray::Array2::zeros((5, 51)), names, fps: 25.0, together: vec![] };
/// let jaw = clip.column("jawOpen").unwrap();
/// clip.weights.column_mut(jaw).fill(0.3);
/// let gaps = LipGaps::of_mean_face(&FaceModes::open(None)?, &clip.names)?;
/// gaps.close(&mut clip, &LipClosures::heard(&[0.0, 0.0, 0.9, 0.0, 0.0], 25.0), &[false; 5]);
/// assert!(gaps.largest(clip.weights.row(2)) < 0.0 && gaps.largest(clip.weights.row(0)) > 0.004);
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct LipGaps {
    /// `[S, 3, 2]`, how far each shape at weight 1 parts each inner pair in height and in depth,
    /// metres.
    gaps: Array3<f32>,
    /// `[S, 6]`, how far each shape at weight 1 moves the corners of the mouth, metres.
    corners: Array2<f32>,
    close: Option<usize>,
}

impl LipGaps {
    /// The gaps of the mean face.
    ///
    /// # Errors
    /// `Weights` for a name that is none of ARKit's.
    pub fn of_mean_face(modes: &FaceModes, names: &[String]) -> Result<LipGaps> {
        Ok(LipGaps::new(modes.of_shapes(names)?.view(), names))
    }

    /// The gaps for landmark displacements at weight 1, `[S, 68, 3]`, canonical metres.
    pub fn new(shapes: ArrayView3<'_, f32>, names: &[String]) -> LipGaps {
        let gap = |(s, pair, axis): (usize, usize, usize)| {
            let (upper, lower) = INNER_LIPS[pair];
            shapes[[s, upper, axis + 1]] - shapes[[s, lower, axis + 1]]
        };
        LipGaps {
            gaps: Array3::from_shape_fn((names.len(), PAIRS, 2), gap),
            corners: corners_of(shapes),
            close: names.iter().position(|name| name == CLOSE),
        }
    }

    /// The widest gap between the lips in a frame `[S]`, as metres more than in the neutral face.
    pub fn largest(&self, weights: ndarray::ArrayView1<'_, f32>) -> f32 {
        let gaps: ndarray::Array1<f32> = weights.dot(&self.gaps.slice(s![.., .., 0]));
        gaps.iter().copied().fold(f32::NEG_INFINITY, f32::max)
    }

    /// Brings the lips of a clip together where `closures` says so, except in frames where an event
    /// is `over_speech`. Stores in the clip how far they come together.
    ///
    /// In each frame every inner pair goes the same share (`approach`) of the way to contact, in
    /// height and in depth. Shapes that part the lips get less weight and `mouthClose` gets more,
    /// by least squares with bounds (coordinate descent, as in [`crate::rig::solve`]). The lips
    /// never open.
    pub fn close(&self, clip: &mut WeightClip, closures: &LipClosures, over_speech: &[bool]) {
        let rows = clip.weights.outer_iter();
        let openings: Vec<f32> = rows
            .map(|row| (self.largest(row) - TOUCHING_M).max(0.0))
            .collect();
        clip.together = approach(&openings, &closures.contacts(), clip.fps, over_speech);
        self.bring_together(clip);
    }

    /// The same for a clip that already stores how far its lips have to come together. For a head
    /// whose lips part differently from those of the mean face.
    pub fn bring_together(&self, clip: &mut WeightClip) {
        let rows = clip.weights.outer_iter_mut().zip(&clip.together);
        for (mut row, share) in rows.filter(|(_, share)| **share > 0.0) {
            self.close_frame(&mut row, *share);
        }
    }

    fn close_frame(&self, weights: &mut ArrayViewMut1<'_, f32>, share: f32) {
        let before = self.opening(weights);
        if before.iter().all(|[height, _]| *height <= TOUCHING_M) {
            return;
        }
        let aim = |(pair, axis): (usize, usize)| {
            let now = before[pair][axis];
            let (goal, slack) = match axis {
                0 => (now - share * (now - TOUCHING_M).max(0.0), PRESSED_M),
                _ => ((1.0 - share) * now, 0.0),
            };
            let by = self.gaps.slice(s![.., pair, axis]);
            Aim { by, goal, slack }
        };
        let places = (0..PAIRS).flat_map(|pair| [(pair, 0), (pair, 1)]);
        let aims: Vec<Aim<'_>> = places.map(aim).collect();
        let moving = self.moving(weights);
        reach(weights, &aims, &self.corners, &moving);
    }

    /// The gap of each inner pair in height and depth, as metres more than in the neutral face.
    fn opening(&self, weights: &ArrayViewMut1<'_, f32>) -> [[f32; 2]; PAIRS] {
        std::array::from_fn(|pair| {
            [0, 1].map(|axis| weights.dot(&self.gaps.slice(s![.., pair, axis])))
        })
    }

    /// The shapes whose weights may change, each with its largest weight: the shapes in use that
    /// part the lips, up to their present weight, and `mouthClose`.
    fn moving(&self, weights: &ArrayViewMut1<'_, f32>) -> Vec<(usize, f32)> {
        let parts = |s: &usize| {
            let moves = self
                .gaps
                .slice(s![*s, .., ..])
                .iter()
                .any(|gap| gap.abs() > STILL_M);
            moves && (weights[*s] > 0.0 || Some(*s) == self.close)
        };
        let most = |s: usize| {
            if Some(s) == self.close {
                1.0
            } else {
                weights[s].max(0.0)
            }
        };
        let all = (0..weights.len()).filter(parts);
        all.map(|s| (s, most(s))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::ARKIT;

    fn clip(open: &[(&str, f32)]) -> (WeightClip, LipGaps) {
        let names: Vec<String> = ARKIT[..51].iter().map(|&name| name.to_owned()).collect();
        let mut weights = ndarray::Array2::zeros((1, names.len()));
        for (name, weight) in open {
            weights[[0, names.iter().position(|known| known == name).unwrap()]] = *weight;
        }
        let modes = FaceModes::open(None).unwrap();
        let gaps = LipGaps::of_mean_face(&modes, &names).unwrap();
        let fps = 25.0;
        (
            WeightClip {
                names,
                weights,
                fps,
                together: Vec::new(),
            },
            gaps,
        )
    }

    const VOWELS: [&[(&str, f32)]; 4] = [
        &[("jawOpen", 0.5)],
        &[("jawOpen", 0.3), ("mouthFunnel", 0.6)],
        &[
            ("jawOpen", 0.2),
            ("mouthLowerDownLeft", 0.7),
            ("mouthLowerDownRight", 0.7),
        ],
        &[
            ("jawOpen", 0.4),
            ("mouthSmileLeft", 0.9),
            ("mouthSmileRight", 0.9),
        ],
    ];

    #[test]
    fn lips_meet_from_every_vowel_in_height_and_depth() {
        for vowel in VOWELS {
            let (mut clip, gaps) = clip(vowel);
            let jaw = clip.column("jawOpen").unwrap();
            let was = clip.weights[[0, jaw]];
            gaps.close(&mut clip, &LipClosures::heard(&[0.9], 25.0), &[false]);
            let left = gaps.largest(clip.weights.row(0));
            assert!(left < 0.0, "{vowel:?}: {left}");
            let depth = gaps.opening(&clip.weights.row_mut(0))[1][1];
            assert!(depth.abs() < 0.4e-3, "{vowel:?}: {depth}");
            let closed = clip.weights[[0, jaw]];
            assert!(closed <= was && clip.weights.iter().all(|w| (0.0..=1.0).contains(w)));
        }
    }

    #[test]
    fn lips_that_close_under_a_sneer_or_sucked_in_do_not_go_through_each_other() {
        for event in [
            [("noseSneerLeft", 0.8), ("noseSneerRight", 0.8)],
            [("mouthRollUpper", 0.9), ("mouthRollLower", 0.9)],
        ] {
            for vowel in VOWELS {
                let (mut clip, gaps) = clip(&[vowel, &event[..]].concat());
                gaps.close(&mut clip, &LipClosures::heard(&[0.9], 25.0), &[false]);
                let heights = gaps.opening(&clip.weights.row_mut(0)).map(|pair| pair[0]);
                let message = format!("{event:?} in {vowel:?}: {heights:?}");
                assert!(
                    heights.iter().all(|h| (-1.5e-3..0.0).contains(h)),
                    "{message}"
                );
            }
        }
    }

    #[test]
    fn who_smiles_goes_on_smiling_while_the_lips_meet() {
        for strength in [0.7, 1.0, 1.5] {
            let smile = [("mouthSmileLeft", strength), ("mouthSmileRight", strength)];
            for vowel in VOWELS[..3].iter().chain([&&[("jawOpen", 0.0)][..]]) {
                let (mut clip, gaps) = clip(&[vowel, &smile[..]].concat());
                let modes = FaceModes::open(None).unwrap();
                let width = |clip: &WeightClip| {
                    let moved = clip.landmarks(&modes).unwrap().displacements;
                    moved[[0, 54, 0]] - moved[[0, 48, 0]]
                };
                let before = width(&clip);
                gaps.close(&mut clip, &LipClosures::heard(&[0.9], 25.0), &[false]);
                let left = gaps.largest(clip.weights.row(0));
                let after = width(&clip);
                let message = format!("{strength} {vowel:?}: {before} to {after}, gap {left}");
                let most = if strength > 1.0 { 0.3e-3 } else { 0.0 };
                assert!(after > 0.6 * before && left < most, "{message}");
            }
        }
    }

    #[test]
    fn nothing_closes_unheard_or_under_an_event_over_the_speech() {
        for (probability, over) in [(0.0, false), (0.9, true)] {
            let (mut clip, gaps) = clip(VOWELS[1]);
            let before = clip.clone();
            gaps.close(
                &mut clip,
                &LipClosures::heard(&[probability], 25.0),
                &[over],
            );
            assert_eq!(clip.weights, before.weights);
        }
    }

    #[test]
    fn lips_have_the_time_that_lips_need() {
        let (one, gaps) = clip(&[("jawOpen", 0.8)]);
        let frames = 21;
        let mut long = WeightClip {
            weights: one.weights.select(ndarray::Axis(0), &vec![0; frames]),
            fps: 50.0,
            ..one
        };
        let before = long.weights.clone();
        let mut heard = vec![0.0; frames];
        heard[10] = 0.9;
        gaps.close(&mut long, &LipClosures::heard(&heard, 50.0), &[]);
        let apart: Vec<f32> = (0..frames)
            .map(|t| gaps.largest(long.weights.row(t)))
            .collect();
        assert!(apart[0] > 0.02 && apart[10] < 0.0, "{apart:?}");
        let fastest = 0.4 / 50.0;
        let steps = apart.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.clone().all(|step| step < fastest), "{apart:?}");
        assert!(steps.fold(0.0, f32::max) > 0.5 * fastest);
        // Far from the closure nothing moves.
        for t in [0, 19, 20] {
            assert_eq!(long.weights.row(t), before.row(t), "frame {t}");
        }
    }

    #[test]
    fn lips_that_are_closed_stay_as_they_are() {
        let (mut clip, gaps) = clip(&[("mouthPressLeft", 0.5), ("mouthPressRight", 0.5)]);
        let before = clip.clone();
        gaps.close(&mut clip, &LipClosures::heard(&[0.9], 25.0), &[]);
        let moved = (&clip.weights - &before.weights).mapv(f32::abs).sum();
        assert!(gaps.largest(before.weights.row(0)) > TOUCHING_M || moved == 0.0);
    }
}
