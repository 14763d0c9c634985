//! Brings the lower lip to the upper teeth in weights of shapes.

use ndarray::{Array2, ArrayView1, ArrayView3, ArrayViewMut1};

use super::{
    super::{
        FaceModes, WeightClip,
        contacts::{AT_TEETH_M, LIP, approach, distance, excess},
    },
    reach::{Aim, corners_of, reach},
};
use crate::{Result, speech::LipClosures};

/// How much farther up and back than the teeth the lip may stay, metres.
const SLACK_M: f32 = 3e-3;
/// The shape that tucks the lip in.
const TUCKS: &str = "mouthRollLower";
/// The largest weight of that shape here, unless it was larger before.
const MAX_TUCKED: f32 = 0.6;
/// Shapes that move the lip away by no more than this at weight 1 keep their weights, metres.
const STILL_M: f32 = 0.5e-3;

/// How far each shape moves the lower lip of one head away from the upper teeth, where it is in f
/// and v.
#[derive(Debug, Clone, PartialEq)]
pub struct LowerLip {
    /// `[2, S]`, how far each shape at weight 1 moves the lip down and forward, metres.
    away: Array2<f32>,
    /// `[S, 6]`, how far each shape at weight 1 moves the corners of the mouth, metres.
    corners: Array2<f32>,
    tucks: Option<usize>,
}

impl LowerLip {
    /// The lower lip of the mean face.
    ///
    /// # Errors
    /// `Weights` if a name is not one of ARKit's.
    pub fn of_mean_face(modes: &FaceModes, names: &[String]) -> Result<LowerLip> {
        Ok(LowerLip::new(modes.of_shapes(names)?.view(), names))
    }

    /// From the landmark displacements of each shape at weight 1, `[S, 68, 3]`, canonical metres.
    pub fn new(shapes: ArrayView3<'_, f32>, names: &[String]) -> LowerLip {
        let away = |(axis, s): (usize, usize)| match axis {
            0 => -shapes[[s, LIP, 1]],
            _ => shapes[[s, LIP, 2]],
        };
        LowerLip {
            away: Array2::from_shape_fn((2, names.len()), away),
            corners: corners_of(shapes),
            tucks: names.iter().position(|name| name == TUCKS),
        }
    }

    /// Brings the lower lip of a clip to the teeth where f or v is `heard`, except where an event
    /// is `over_speech`. Lowers the shapes that keep the lip away and raises `mouthRollLower`.
    /// Never moves the lip away from the teeth.
    pub fn reach_teeth(&self, clip: &mut WeightClip, heard: &LipClosures, over_speech: &[bool]) {
        let place = |row: ArrayView1<'_, f32>| [0, 1].map(|axis| row.dot(&self.away.row(axis)));
        let rows = clip.weights.outer_iter();
        let far: Vec<f32> = rows.map(|row| distance(&excess(place(row)))).collect();
        let shares = approach(&far, &heard.contacts(), clip.fps, over_speech);
        let rows = clip.weights.outer_iter_mut().zip(shares);
        for (mut row, share) in rows.filter(|(_, share)| *share > 0.0) {
            self.reach_in_frame(&mut row, share);
        }
    }

    fn reach_in_frame(&self, weights: &mut ArrayViewMut1<'_, f32>, share: f32) {
        let aims = [0, 1].map(|axis| {
            let by = self.away.row(axis);
            let now = weights.dot(&by);
            Aim {
                by,
                goal: now - share * (now - AT_TEETH_M[axis]).max(0.0),
                slack: SLACK_M,
            }
        });
        let keeps_away = |s: &usize| {
            let away = self.away.column(*s);
            weights[*s] > 0.0 && away.iter().any(|by| *by > STILL_M)
        };
        let give_way = (0..weights.len()).filter(keeps_away);
        let mut moving: Vec<(usize, f32)> = give_way.map(|s| (s, weights[s])).collect();
        moving.extend(self.tucks.map(|s| (s, weights[s].max(MAX_TUCKED))));
        reach(weights, &aims, &self.corners, &moving);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::ARKIT;

    /// Five frames with the same weights, and the lower lip of the mean face.
    fn clip(open: &[(&str, f32)]) -> (WeightClip, LowerLip) {
        let names: Vec<String> = ARKIT[..51].iter().map(|&name| name.to_owned()).collect();
        let mut weights = Array2::zeros((5, names.len()));
        for (name, weight) in open {
            let column = names.iter().position(|known| known == name).unwrap();
            weights.column_mut(column).fill(*weight);
        }
        let lip = LowerLip::of_mean_face(&FaceModes::open(None).unwrap(), &names).unwrap();
        let clip = WeightClip {
            names,
            weights,
            fps: 25.0,
            together: Vec::new(),
        };
        (clip, lip)
    }

    fn place(clip: &WeightClip, lip: &LowerLip, t: usize) -> [f32; 2] {
        [0, 1].map(|axis| clip.weights.row(t).dot(&lip.away.row(axis)))
    }

    const OPEN: [&[(&str, f32)]; 4] = [
        &[("jawOpen", 0.4)],
        &[("jawOpen", 0.2), ("mouthFunnel", 0.5)],
        &[("mouthPucker", 0.6)],
        &[
            ("jawOpen", 0.3),
            ("mouthShrugLower", 0.8),
            ("mouthSmileLeft", 0.9),
        ],
    ];

    #[test]
    fn the_lip_comes_to_the_teeth_from_every_mouth_and_no_shape_grows_but_the_tuck() {
        for open in OPEN {
            let (mut clip, lip) = clip(open);
            let before = clip.weights.clone();
            let heard = LipClosures::heard(&[0.0, 0.0, 0.9, 0.0, 0.0], 25.0);
            lip.reach_teeth(&mut clip, &heard, &[]);
            let [down, forward] = place(&clip, &lip, 2);
            let message = format!("{open:?}: {down} {forward}");
            assert!(
                down < AT_TEETH_M[0] + 0.6e-3 && forward < AT_TEETH_M[1] + 0.6e-3,
                "{message}"
            );
            assert!(down > AT_TEETH_M[0] - SLACK_M - 1e-3, "{message}");
            let tucks = lip.tucks.unwrap();
            for (s, (now, was)) in clip.weights.row(2).iter().zip(before.row(2)).enumerate() {
                assert!(
                    s == tucks || (0.0..=*was).contains(now),
                    "{}",
                    clip.names[s]
                );
            }
            // One frame earlier the lip is partly there; two frames earlier it has hardly moved.
            let missed = |t| {
                let place = place(&clip, &lip, t);
                (0..2)
                    .map(|axis| (place[axis] - AT_TEETH_M[axis]).max(0.0))
                    .sum::<f32>()
            };
            assert!(missed(2) < missed(1) && missed(1) < missed(0), "{message}");
            let moved = (&clip.weights.row(0) - &before.row(0)).mapv(f32::abs).sum();
            assert!(moved < 0.06, "{message}: {moved}");
        }
    }

    #[test]
    fn a_lip_that_is_there_stays_and_so_does_one_under_an_event_over_the_speech() {
        let heard = LipClosures::heard(&[0.9; 5], 25.0);
        let (mut there, lip) = clip(&[("mouthRollLower", 0.3)]);
        let before = there.weights.clone();
        lip.reach_teeth(&mut there, &heard, &[]);
        assert_eq!(there.weights, before);
        let (mut open, lip) = clip(OPEN[0]);
        let before = open.weights.clone();
        lip.reach_teeth(&mut open, &heard, &[true; 5]);
        assert_eq!(open.weights, before);
    }
}
