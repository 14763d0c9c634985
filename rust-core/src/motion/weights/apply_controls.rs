//! Applies an artist's controls to sampled weights.

use ndarray::{Array1, Array2, ArrayView2, ArrayView3};

use super::{columns, scale, starts};
use crate::{
    Result,
    audio::Prosody,
    conditions::{ControlStage, Controls},
    motion::{
        Expressions, FaceModes, PERFORMANCE_CONTROLS, PerformanceControls, WeightClip,
        blinks::{Blink, blinks},
        brow_accents::brow_accents,
        effort::effort_gain,
        gestures::{Gestures, arkit_names},
        upper_face::{Lids, lids},
        variety::Variety,
    },
};

/// Stems of the shapes that speech moves. Smiles, frowns and dimples belong to expression.
const SPEECH: [&str; 13] = [
    "jaw",
    "mouthClose",
    "mouthFunnel",
    "mouthPucker",
    "mouthRoll",
    "mouthShrug",
    "mouthPress",
    "mouthLowerDown",
    "mouthUpperUp",
    "mouthStretch",
    "mouthLeft",
    "mouthRight",
    "cheekPuff",
];
/// Stems of the shapes that round the lips.
const ROUND: [&str; 2] = ["mouthFunnel", "mouthPucker"];
const UPPER: [&str; 4] = ["brow", "eye", "cheekSquint", "noseSneer"];
/// Stems of the shapes that `asymmetry` makes stronger on one side.
const LOPSIDED: [&str; 4] = ["brow", "mouthSmile", "mouthFrown", "mouthDimple"];
const MAX_LOPSIDED: f32 = 0.5;
/// Largest weight of a performance: emotions go up to 1.5 of an expression.
const MOST: f32 = 1.5;
/// The shapes that raise the brows in a brow accent.
const RAISING: [&str; 3] = ["browInnerUp", "browOuterUpLeft", "browOuterUpRight"];
/// For the subject's right and left eye, the shape that closes the lids and the one that opens them
/// wide.
const BLINKS: [[&str; 2]; 2] = [
    ["eyeBlinkRight", "eyeWideRight"],
    ["eyeBlinkLeft", "eyeWideLeft"],
];

/// The conditions of a performance of weights: its emotion, its speech and its seed.
#[derive(Debug, Clone, Copy)]
pub struct WeightCues<'a> {
    /// `[T, 16]` at the clip's rate: a mixture of 15 emotions and an intensity.
    pub affect: ArrayView2<'a, f32>,
    /// The same for the times of blinks. They stay the same if only the emotion's strength changes.
    pub blink_affect: ArrayView2<'a, f32>,
    /// How fast each emotion comes and goes.
    pub expressions: &'a Expressions,
    /// How the speech was said.
    pub prosody: &'a Prosody,
    /// Leaves out the upper face, gestures, accents, blinks and variety, which speech does not
    /// cause.
    pub speech_only: bool,
    /// The same seed gives the same blinks, accents and variety.
    pub seed: u64,
}

impl WeightClip {
    /// Applies `controls` to the clip: smoothing, variety, articulation with effort, jaw, rounding
    /// and width, the upper face's scale, brow accents, asymmetry, blinks. Head and gaze are not
    /// weights; see [`crate::motion::Life`]. Afterwards [`super::LipGaps`] brings lips together
    /// that have to meet.
    ///
    /// # Errors
    /// `InvalidInput` for a control out of range, `Weights` for a name that is none of ARKit's.
    pub fn apply_controls(
        &self,
        modes: &FaceModes,
        cues: &WeightCues<'_>,
        controls: &PerformanceControls,
    ) -> Result<WeightClip> {
        Controls::from(*controls).check(PERFORMANCE_CONTROLS, ControlStage::Motion)?;
        let mut clip = self.smoothed(f64::from(controls.smoothing_s));
        let variety = (controls.variety > 0.0 && !cues.speech_only)
            .then(|| Variety::draw(cues.prosody, cues.seed));
        if let Some(variety) = &variety {
            clip.vary_mouth(modes, variety, controls.variety)?;
        }
        clip.articulate(cues.prosody, controls);
        let of = |stems: &[&str]| columns(&self.names, |name| starts(name, stems));
        if cues.speech_only {
            scale(&mut clip.weights, &of(&UPPER), |_| 0.0);
        } else {
            if let Some(variety) = &variety {
                clip.vary_brows(modes, variety, controls.variety)?;
                clip.gesture(cues, controls);
            }
            scale(&mut clip.weights, &of(&UPPER), |_| controls.upper_face);
            clip.raise_brows(cues, controls.brow_accents);
        }
        clip.lean(controls.asymmetry);
        if !cues.speech_only {
            let (fps, rate) = (clip.fps, controls.blinks_per_minute);
            let blinks = blinks(cues.blink_affect, fps, cues.prosody, rate, cues.seed);
            clip.blink(modes, &blinks)?;
        }
        clip.weights.mapv_inplace(|weight| weight.clamp(0.0, MOST));
        Ok(clip)
    }

    /// Takes the speech from the mouth by a share of each frame, `[T]`. Shapes with a weight above 0 in
    /// `kept` `[T, S]` stay in that frame.
    pub(crate) fn hush(&mut self, shares: &[f32], kept: &Array2<f32>) {
        let spoken = columns(&self.names, |name| starts(name, &SPEECH));
        for (t, share) in shares.iter().enumerate() {
            for &column in spoken.iter().filter(|column| kept[[t, **column]] == 0.0) {
                self.weights[[t, column]] *= 1.0 - share;
            }
        }
    }

    fn articulate(&mut self, prosody: &Prosody, controls: &PerformanceControls) {
        let frames = self.weights.nrows();
        let gain = effort_gain(prosody, frames, self.fps, controls.effort);
        let of = |stems: &[&str]| columns(&self.names, |name| starts(name, stems));
        let (all, jaw, round, width) =
            (of(&SPEECH), of(&["jaw"]), of(&ROUND), of(&["mouthStretch"]));
        let weights = &mut self.weights;
        scale(weights, &all, |t| controls.articulation * gain[t]);
        scale(weights, &jaw, |_| controls.jaw);
        scale(weights, &round, |_| controls.rounding);
        scale(weights, &width, |_| controls.width);
    }

    /// Adds the gestures of the emotion; no weight falls below 0.
    fn gesture(&mut self, cues: &WeightCues<'_>, controls: &PerformanceControls) {
        let size = controls.variety;
        let columns: Vec<[Option<usize>; 2]> = arkit_names()
            .map(|names| names.map(|name| self.column(&name)))
            .collect();
        let mut gestures = Gestures::new(cues.seed);
        let strengths = cues
            .expressions
            .followed(cues.affect, self.fps, controls.onset);
        for (mut row, strengths) in self.weights.outer_iter_mut().zip(&strengths) {
            let weights = gestures.step(strengths, 1.0 / self.fps);
            for ([right, left], [to_right, to_left]) in columns.iter().zip(weights) {
                // A shape that moves both sides gets half of each side's weight.
                let share = if right == left { 0.5 * size } else { size };
                for (column, weight) in [(right, to_right), (left, to_left)] {
                    if let (Some(column), true) = (column, weight != 0.0) {
                        row[*column] = (row[*column] + share * weight).max(0.0);
                    }
                }
            }
        }
    }

    fn raise_brows(&mut self, cues: &WeightCues<'_>, strength: f32) {
        let raising = columns(&self.names, |name| RAISING.contains(&name));
        let (frames, fps) = (self.weights.nrows(), self.fps);
        for accent in brow_accents(cues.prosody, cues.seed) {
            let first = (accent.start_s * fps) as usize;
            let last = ((accent.end_s() * fps).ceil() as usize).min(frames);
            for t in first.min(last)..last {
                let weight = strength * accent.at(t as f64 / fps);
                raising
                    .iter()
                    .for_each(|&column| self.weights[[t, column]] += weight);
            }
        }
    }

    /// Makes one side of the face move more than the other: the subject's left for positive `asymmetry`.
    fn lean(&mut self, asymmetry: f32) {
        for (side, sign) in [("Left", 1.0), ("Right", -1.0)] {
            let side_columns = columns(&self.names, |name| {
                name.ends_with(side) && starts(name, &LOPSIDED)
            });
            scale(&mut self.weights, &side_columns, |_| {
                1.0 + sign * MAX_LOPSIDED * asymmetry
            });
        }
    }

    /// Closes the lids further than other shapes already do, so that they meet and never pass each
    /// other. Shapes that open the lids wide get less weight.
    fn blink(&mut self, modes: &FaceModes, blinks: &[Blink]) -> Result<()> {
        let closing = closing_of(modes, &self.names)?;
        let (frames, fps) = (self.weights.nrows(), self.fps);
        for (eye, [shut, wide]) in BLINKS.into_iter().enumerate() {
            let (Some(shut), wide) = (self.column(shut), self.column(wide)) else {
                continue;
            };
            for blink in blinks {
                for t in blink.frames(fps, frames) {
                    let weight = blink.closure(t as f64 / fps, eye == 0);
                    if let Some(wide) = wide {
                        self.weights[[t, wide]] *= 1.0 - weight;
                    }
                    let way = (1.0 - self.weights.row(t).dot(&closing[eye])).max(0.0);
                    self.weights[[t, shut]] += weight * way;
                }
            }
        }
        Ok(())
    }

    /// Moves the lids with eyes that look up or down. Closed lids stay closed. `gaze` is as in
    /// [`crate::motion::Life::gaze`].
    ///
    /// # Errors
    /// `Weights` for a name that is none of ARKit's.
    pub fn follow_gaze(&mut self, modes: &FaceModes, gaze: ArrayView3<'_, f32>) -> Result<()> {
        let before = self.landmarks(modes)?.displacements;
        let mut after = before.clone();
        modes.follow_gaze(&mut after, gaze)?;
        for (eye, [shut, _]) in lids(modes)?.iter().zip(BLINKS) {
            let Some(column) = self.column(shut) else {
                continue;
            };
            let moved = before.outer_iter().zip(after.outer_iter());
            for ((was, is), mut row) in moved.zip(self.weights.outer_iter_mut()) {
                let further = eye.closure(&is) - eye.closure(&was);
                row[column] = (row[column] + further).max(0.0);
            }
        }
        Ok(())
    }
}

/// How far each shape at weight 1 closes the right and the left eye, `[S]`.
fn closing_of(modes: &FaceModes, names: &[String]) -> Result<[Array1<f32>; 2]> {
    let shapes = modes.of_shapes(names)?;
    let of = |eye: &Lids<'_>| {
        shapes
            .outer_iter()
            .map(|shape| eye.closure(&shape))
            .collect()
    };
    Ok(lids(modes)?.each_ref().map(of))
}
