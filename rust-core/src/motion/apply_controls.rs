//! Applies controls to a sampled performance.

use ndarray::{Array3, ArrayView2};

use super::{
    EmotionOrigin, Expressions, FaceModes, LandmarkClip, Motion, MotionRequest,
    PERFORMANCE_CONTROLS, PerformanceControls,
    articulation::{Mouth, articulate, keep_closures},
    blinks::{blinks, close_lids},
    breath::breathe,
    brow_accents::{brow_accents, raise_brows},
    effort::effort_gain,
    gestures::gesture,
    upper_face,
    variety::Variety,
};
use crate::{
    Result,
    audio::Prosody,
    conditions::{ControlStage, Controls, EmotionCurve},
    mesh::ibug,
};

/// What shapes a performance besides its controls: the requested emotion and the voice.
#[derive(Debug, Clone, Copy)]
pub struct Cues<'a> {
    /// `[T, 16]` at the clip's rate: a mixture of 15 emotions and an intensity.
    pub affect: ArrayView2<'a, f32>,
    /// `[T, 16]`, the same for the times of blinks. It is kept apart because the blinks stay where they
    /// are when only the emotion's strength changes.
    pub blink_affect: ArrayView2<'a, f32>,
    /// The table of expressions.
    pub expressions: &'a Expressions,
    /// Where the clip's emotion comes from.
    pub emotion_origin: EmotionOrigin,
    /// Keep only the motion that speech caused: the upper face stays still and nothing is added.
    pub speech_only: bool,
    /// How the speech was said.
    pub prosody: &'a Prosody,
    /// The same seed gives the same blinks, accents and variety.
    pub seed: u64,
}

/// Applies the controls of a request to landmarks that a system has sampled.
#[derive(Debug, Clone, Copy)]
pub struct LandmarkController<'a> {
    /// How the landmarks move together.
    pub modes: &'a FaceModes,
    /// The expressions of the emotions.
    pub expressions: &'a Expressions,
    /// Whether the sampled motion already shows the emotion.
    pub emotion_origin: EmotionOrigin,
    /// How the speech was said.
    pub prosody: &'a Prosody,
}

impl LandmarkController<'_> {
    /// Applies the controls of `request` to `sampled`, under `emotion`.
    ///
    /// Blinks come as often as under `blink_emotion`. Motion other than landmarks stays as it is.
    ///
    /// # Errors
    /// Those of [`FaceModes::apply_controls`].
    pub fn apply(
        &self,
        sampled: &Motion,
        request: &MotionRequest,
        emotion: &EmotionCurve,
        blink_emotion: &EmotionCurve,
    ) -> Result<Motion> {
        let Some(clip) = sampled.landmarks() else {
            return Ok(sampled.clone());
        };
        let affect = emotion.sample(sampled.frames(), clip.fps);
        let blink_affect = blink_emotion.sample(sampled.frames(), clip.fps);
        let cues = Cues {
            affect: affect.view(),
            blink_affect: blink_affect.view(),
            expressions: self.expressions,
            emotion_origin: self.emotion_origin,
            speech_only: request.emotion == EmotionCurve::Off,
            prosody: self.prosody,
            seed: request.seed,
        };
        let controls = PerformanceControls::from(&request.controls);
        let clip = self.modes.apply_controls(clip, &cues, &controls)?;
        Ok(sampled.with_values(clip.displacements.into_dyn()))
    }
}

impl FaceModes {
    /// Applies `controls` to a clip. The result does not depend on the number of threads.
    ///
    /// The order is: smoothing, variety of the mouth, articulation with effort, jaw, rounding and
    /// width, the closures of the sampled clip, the expression if the clip has none, breath, variety of
    /// the brows, gestures of the emotion, brow accents, the upper face's scale, asymmetry, the limits
    /// of brows and wide lids, blinks. Head and gaze are not landmarks: see [`super::Life`].
    /// [`PerformanceControls::as_sampled`] changes nothing but the missing expression and the limits,
    /// unless `speech_only` stills the upper face.
    ///
    /// # Errors
    /// `InvalidInput` for a control out of range.
    pub fn apply_controls(
        &self,
        sampled: &LandmarkClip,
        cues: &Cues<'_>,
        controls: &PerformanceControls,
    ) -> Result<LandmarkClip> {
        Controls::from(*controls).check(PERFORMANCE_CONTROLS, ControlStage::Motion)?;
        let mut clip = sampled.smoothed(f64::from(controls.smoothing_s));
        let variety = Variety::draw(cues.prosody, cues.seed);
        if controls.variety > 0.0 && !cues.speech_only {
            variety.vary_mouth(&mut clip.displacements, sampled.fps, controls.variety);
        }
        self.shape_speech(&mut clip, sampled, cues, controls)?;
        if cues.emotion_origin == EmotionOrigin::Added && !cues.speech_only {
            cues.expressions
                .add(&mut clip, cues, self, controls.onset)?;
        }
        let fps = clip.fps;
        let moved = &mut clip.displacements;
        if cues.speech_only {
            still_upper_face(moved);
        } else {
            if controls.breath > 0.0 {
                let (before, strength) = (sampled.displacements.view(), controls.breath);
                breathe(moved, before, fps, cues.prosody, self, strength)?;
            }
            if controls.variety > 0.0 {
                variety.vary_brows(moved, fps, self, controls.variety)?;
                let strengths = cues.expressions.followed(cues.affect, fps, controls.onset);
                gesture(moved, &strengths, fps, cues.seed, self, controls.variety)?;
            }
            if controls.brow_accents > 0.0 {
                let accents = brow_accents(cues.prosody, cues.seed);
                raise_brows(moved, fps, &accents, self, controls.brow_accents)?;
            }
            if controls.upper_face != 1.0 {
                upper_face::scale(moved, self, controls.upper_face)?;
            }
        }
        if controls.asymmetry != 0.0 {
            upper_face::lean(moved, controls.asymmetry);
        }
        if !cues.speech_only {
            upper_face::limit(moved, self)?;
            let rate = controls.blinks_per_minute;
            let blinks = blinks(cues.blink_affect, fps, cues.prosody, rate, cues.seed);
            close_lids(moved, fps, &blinks, self)?;
        }
        Ok(clip)
    }

    fn shape_speech(
        &self,
        clip: &mut LandmarkClip,
        sampled: &LandmarkClip,
        cues: &Cues<'_>,
        controls: &PerformanceControls,
    ) -> Result<()> {
        let frames = clip.displacements.dim().0;
        let mut gain = effort_gain(cues.prosody, frames, clip.fps, controls.effort);
        gain.iter_mut()
            .for_each(|gain| *gain *= controls.articulation);
        let mouth = Mouth {
            articulation: &gain,
            jaw: controls.jaw,
            rounding: controls.rounding,
            width: controls.width,
        };
        let shaped = !mouth.is_neutral();
        if shaped {
            let emotion = match cues.emotion_origin {
                EmotionOrigin::Learned => {
                    cues.expressions
                        .alone(cues.affect, clip.fps, controls.onset)
                }
                EmotionOrigin::Added => Array3::zeros(clip.displacements.dim()),
            };
            articulate(&mut clip.displacements, emotion.view(), self, &mouth)?;
        }
        if shaped || controls.smoothing_s > 0.0 || controls.variety > 0.0 {
            let fps = clip.fps;
            keep_closures(&mut clip.displacements, sampled.displacements.view(), fps);
        }
        Ok(())
    }
}

fn still_upper_face(moved: &mut Array3<f32>) {
    for mut frame in moved.outer_iter_mut() {
        for n in ibug::upper_face() {
            frame.row_mut(n).fill(0.0);
        }
    }
}

#[cfg(test)]
mod tests;
