//! Brings the mouth to the shapes of sounds that a viewer has to tell apart, in weights of shapes.

use ndarray::{Array2, ArrayView1, ArrayView3, ArrayViewMut1};

use super::{
    super::{
        FaceModes, WeightClip,
        contacts::{chin, forward, gap, missing, width},
    },
    columns,
    reach::{Aim, reach},
};
use crate::{
    Result,
    speech::{LIP_SHAPES, LipShape, LipShapes},
};

/// Lengths of a mouth: how far the chin hangs, how far forward the lips are, width and opening.
const LENGTHS: usize = 4;
/// The chin is aimed at first, by the jaw alone: the lips follow it.
const CHIN: usize = 0;
const MOUTH_WIDTH: usize = 2;
const JAW: &str = "jawOpen";
/// Shapes that narrow, widen, part and close the lips and bring them forward, without the jaw.
const LIPS: [&str; 7] = [
    "mouthPucker",
    "mouthFunnel",
    "mouthStretchLeft",
    "mouthStretchRight",
    "mouthLowerDownLeft",
    "mouthLowerDownRight",
    "mouthClose",
];
/// Those that narrow and widen the mouth.
const WIDTH: [&str; 3] = ["mouthPucker", "mouthStretchLeft", "mouthStretchRight"];
/// How far the lips widen and narrow the mouth, times what the network learned. Smiles, the jaw and the price
/// of a weight leave about 1.5 of it.
const WIDTH_GAIN: f32 = 2.0;
/// The largest weights that are set here, unless they were larger before.
const MOST: f32 = 0.9;

/// How each shape of a head moves the lengths of its mouth.
#[derive(Debug, Clone, PartialEq)]
pub struct MouthLengths {
    /// `[4, S]`, how far each shape at weight 1 changes each length, metres.
    by: Array2<f32>,
    /// No lengths have to stay as they are, `[S, 0]`.
    free: Array2<f32>,
    jaw: Option<usize>,
    lips: Vec<usize>,
    width: Vec<usize>,
}

impl MouthLengths {
    /// The mouth of the mean face.
    ///
    /// # Errors
    /// `Weights` for a name that is none of ARKit's.
    pub fn of_mean_face(modes: &FaceModes, names: &[String]) -> Result<MouthLengths> {
        Ok(MouthLengths::new(modes.of_shapes(names)?.view(), names))
    }

    /// From the landmark displacements of each shape at weight 1, `[S, 68, 3]`, canonical metres.
    pub fn new(shapes: ArrayView3<'_, f32>, names: &[String]) -> MouthLengths {
        let length = |(length, s): (usize, usize)| {
            let shape = shapes.index_axis(ndarray::Axis(0), s);
            [chin(shape), forward(shape), width(shape), gap(shape)][length]
        };
        MouthLengths {
            by: Array2::from_shape_fn((LENGTHS, names.len()), length),
            free: Array2::zeros((names.len(), 0)),
            jaw: names.iter().position(|name| name == JAW),
            lips: columns(names, |name| LIPS.contains(&name)),
            width: columns(names, |name| WIDTH.contains(&name)),
        }
    }

    /// Widens and narrows the mouth of a clip by [`WIDTH_GAIN`] and brings it to the shapes, as far as it
    /// is not there yet, except in frames with an event `over_speech`. The jaw goes first, then the lips.
    ///
    /// `of_events`: `[T, S]`, the part of the weights that belongs to events and not to the speech.
    pub fn take_shapes(
        &self,
        clip: &mut WeightClip,
        shapes: &LipShapes,
        over_speech: &[bool],
        of_events: &Array2<f32>,
    ) {
        let degrees = shapes.at_frames(clip.weights.nrows(), clip.fps);
        for (t, mut row) in clip.weights.outer_iter_mut().enumerate() {
            if over_speech.get(t) == Some(&true) {
                continue;
            }
            self.widen(&mut row, of_events.row(t));
            for (number, shape) in LIP_SHAPES.iter().enumerate() {
                let degree = degrees[[t, number]];
                if degree > 0.0 {
                    self.take_shape(&mut row, shape, degree);
                }
            }
        }
    }

    /// Makes the mouth [`WIDTH_GAIN`] times as wide or narrow as the lips make it in speech. Smiles and the
    /// jaw count as they are, and so do events.
    fn widen(&self, weights: &mut ArrayViewMut1<'_, f32>, of_events: ArrayView1<'_, f32>) {
        let by = self.by.row(MOUTH_WIDTH);
        let of_speech = |s: usize| (weights[s] - of_events[s]).max(0.0);
        let said: f32 = self.lips.iter().map(|&s| of_speech(s) * by[s]).sum();
        let moving = self.width.iter().map(|&s| (s, weights[s].max(MOST)));
        let moving: Vec<(usize, f32)> = moving.collect();
        let aim = Aim {
            by,
            goal: weights.dot(&by) + (WIDTH_GAIN - 1.0) * said,
            slack: 0.0,
        };
        reach(weights, &[aim], &self.free, &moving);
    }

    fn take_shape(&self, weights: &mut ArrayViewMut1<'_, f32>, shape: &LipShape, degree: f32) {
        let bounds = [shape.chin_m, shape.forward_m, shape.width_m, shape.gap_m];
        let jaw: Vec<(usize, f32)> = self.jaw.map(|jaw| (jaw, 1.0)).into_iter().collect();
        let others = self.lips.iter();
        let others: Vec<(usize, f32)> = others.map(|&s| (s, weights[s].max(MOST))).collect();
        let all = [&jaw[..], &others].concat();
        for (lengths, moving) in [(CHIN..CHIN + 1, jaw), (CHIN..LENGTHS, all)] {
            let aims: Vec<Aim<'_>> = lengths
                .filter_map(|length| {
                    let by = self.by.row(length);
                    let now = weights.dot(&by);
                    let far = missing(now, bounds[length], degree);
                    let holds = bounds[length].iter().any(|bound| bound.is_finite());
                    holds.then_some(Aim {
                        by,
                        goal: now + far,
                        slack: 0.0,
                    })
                })
                .collect();
            reach(weights, &aims, &self.free, &moving);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::ARKIT;

    fn clip(jaw: f32) -> (WeightClip, MouthLengths) {
        let names: Vec<String> = ARKIT[..51].iter().map(|&name| name.to_owned()).collect();
        let mut clip = WeightClip {
            weights: Array2::zeros((90, names.len())),
            names,
            fps: 60.0,
            together: Vec::new(),
        };
        let column = clip.column(JAW).unwrap();
        clip.weights.column_mut(column).fill(jaw);
        let modes = FaceModes::open(None).unwrap();
        let lengths = MouthLengths::of_mean_face(&modes, &clip.names).unwrap();
        (clip, lengths)
    }

    #[test]
    fn the_mouth_is_in_every_shape_in_time_and_back_afterwards() {
        for (shape, jaw) in LIP_SHAPES.iter().flat_map(|s| [(s, 0.0), (s, 0.4)]) {
            let (before, mouth) = clip(jaw);
            let mut after = before.clone();
            mouth.take_shapes(
                &mut after,
                &LipShapes::at(shape.name, 0.5..0.6),
                &[],
                &Array2::zeros(before.weights.dim()),
            );
            let bounds = [shape.chin_m, shape.forward_m, shape.width_m, shape.gap_m];
            for (by, [least, most]) in mouth.by.outer_iter().zip(bounds) {
                let length = after.weights.row(33).dot(&by);
                let inside = (least - 2e-3..=most + 2e-3).contains(&length);
                assert!(
                    inside,
                    "{} {jaw}: {length} of {least} to {most}",
                    shape.name
                );
            }
            assert!(
                after
                    .weights
                    .iter()
                    .all(|weight| (0.0..=1.0).contains(weight))
            );
            for t in (0..20).chain(50..90) {
                assert_eq!(after.weights.row(t), before.weights.row(t));
            }
        }
    }

    #[test]
    fn an_event_over_speech_keeps_its_weights() {
        let (before, mouth) = clip(0.3);
        let mut after = before.clone();
        mouth.take_shapes(
            &mut after,
            &LipShapes::at("oo", 0.5..0.6),
            &[true; 90],
            &Array2::zeros(before.weights.dim()),
        );
        assert_eq!(after, before);
    }
}
