//! Motion of head, eyes and tongue, next to that of the face.
//!
//! Each has its own track. Head and eyes turn bones, empties or eyeballs, never the skin. The lids
//! are landmarks, so they follow the eyes. The tongue track moves a mesh's tongue, if it has one.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis};

use super::{face_modes::FaceModes, gaze::Gaze, head::HeadMotion, mood::moods, upper_face::lids};
use crate::{Result, audio::Prosody, speech::TONGUE_PLACES};

/// Radius of an eyeball, over which the upper lid slides, metres.
const EYEBALL_M: f32 = 0.012;
/// How far the upper lid moves with the eye, as a share of the eyeball's travel. In the tracked
/// face of grid_s1 it moves 7.4 mm for a whole ARKit look down of about 30°, which is 1.2 times the
/// travel of the eyeball. Becker & Fuchs 1988 found 0.8 to 1 for the lid itself.
const LID_SHARE: f32 = 0.9;

/// Rotation of head and eyes, and position of the tongue, over time.
///
/// ```
/// let still = anyface::motion::Life::still(25);
/// assert_eq!((still.head.dim(), still.gaze.dim()), ((25, 3), (25, 2, 2)));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Life {
    /// `[T, 3]`: rotation vectors in radians about canonical axes. The origin lies between the
    /// jaw's hinges. A rotation about +x nods down, one about +y turns to the subject's left, and
    /// one about +z tilts to the subject's right.
    pub head: Array2<f32>,
    /// `[T, 2, 2]`: right eye, then left eye. Each has yaw to the subject's left and pitch up, in
    /// radians relative to the head.
    pub gaze: Array3<f32>,
    /// `[T, 4]`: how far the tongue is from rest (0) to contact (1) at four places: tip to the
    /// ridge behind the upper teeth, middle to the palate, back to the palate, tip to the upper
    /// teeth.
    pub tongue: Array2<f32>,
}

/// Strengths of the motion in one frame: 0 is still, 1 natural.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LifeStrengths {
    /// Rotation of the head.
    pub head: f64,
    /// Rotation of the eyes.
    pub gaze: f64,
    /// Rise of the head before phrases, which is a part of its rotation.
    pub breath: f64,
}

impl Life {
    /// `frames` frames in which nothing moves.
    pub fn still(frames: usize) -> Life {
        Life {
            head: Array2::zeros((frames, 3)),
            gaze: Array3::zeros((frames, 2, 2)),
            tongue: Array2::zeros((frames, TONGUE_PLACES)),
        }
    }

    /// Draws the motion of head and eyes for some speech. `strengths` has one entry per frame.
    ///
    /// `affect` `[T, 16]` is a mixture of emotions and an intensity. It sets the posture of the
    /// head, how far and how fast the head moves, and how often the eyes look away. The eyes
    /// counter the head's rotation as scaled by its strength. The same seed gives the same tracks.
    pub fn of_speech(
        prosody: &Prosody,
        affect: ArrayView2<'_, f32>,
        seed: u64,
        fps: f64,
        strengths: &[LifeStrengths],
    ) -> Life {
        let mut life = Life::still(strengths.len());
        let motion = HeadMotion::draw(prosody, seed);
        let moods = moods(affect, fps);
        let mut gaze = Gaze::draw(prosody, strengths.len() as f64 / fps, seed);
        let mood_at = |time_s: f64| moods.get((time_s * fps) as usize);
        gaze.avert(
            |time_s| mood_at(time_s).map_or(0.0, |mood| mood.aversion),
            seed,
        );
        let mut drift_s = 0.0;
        for (t, (strength, mood)) in strengths.iter().zip(&moods).enumerate() {
            let time_s = t as f64 / fps;
            let head = motion
                .at(time_s, drift_s, strength.breath, mood)
                .map(|x| strength.head * x);
            drift_s += mood.pace / fps;
            let eyes = gaze.at(time_s, head);
            for i in 0..3 {
                life.head[[t, i]] = head[i] as f32;
            }
            for (eye, angles) in eyes.iter().enumerate() {
                for (i, angle) in angles.iter().enumerate() {
                    life.gaze[[t, eye, i]] = (strength.gaze * angle) as f32;
                }
            }
        }
        life
    }
}

impl FaceModes {
    /// Moves the lids with eyes that look up or down. Closed lids stay closed.
    ///
    /// `moved`: `[T, 68, 3]`, canonical metres. `gaze`: as in [`Life::gaze`].
    ///
    /// # Errors
    /// `Weights` if the modes lack the blinks.
    pub fn follow_gaze(&self, moved: &mut Array3<f32>, gaze: ArrayView3<'_, f32>) -> Result<()> {
        let eyes = lids(self)?;
        for (mut frame, angles) in moved.outer_iter_mut().zip(gaze.outer_iter()) {
            for (eye, lids) in eyes.iter().enumerate() {
                let pitch = angles.index_axis(Axis(0), eye)[1];
                if pitch != 0.0 {
                    lids.follow(&mut frame, -LID_SHARE * EYEBALL_M * pitch.sin());
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{conditions::EmotionCurve, motion::phrases::tests::speaking};

    const FPS: f64 = 30.0;

    fn strengths(head: f64, gaze: f64, breath: f64) -> Vec<LifeStrengths> {
        vec![LifeStrengths { head, gaze, breath }; 270]
    }

    fn performed(strengths: &[LifeStrengths]) -> Life {
        let affect = EmotionCurve::default().sample(270, FPS);
        Life::of_speech(&speaking(9, 60), affect.view(), 4, FPS, strengths)
    }

    #[test]
    fn no_strength_is_exact_stillness_and_each_strength_scales_its_own() {
        assert_eq!(performed(&strengths(0.0, 0.0, 1.0)), Life::still(270));
        let (half, whole) = (
            performed(&strengths(0.5, 0.0, 1.0)),
            performed(&strengths(1.0, 0.0, 1.0)),
        );
        assert_eq!(&half.head * 2.0, whole.head);
        let (half, whole) = (
            performed(&strengths(0.0, 0.5, 1.0)),
            performed(&strengths(0.0, 1.0, 1.0)),
        );
        assert_eq!(&half.gaze * 2.0, whole.gaze);
        assert!(whole.gaze.iter().any(|x| *x != 0.0));
    }

    #[test]
    fn ashamed_eyes_look_down_and_away_and_happy_ones_at_the_partner() {
        let strengths = vec![
            LifeStrengths {
                head: 0.0,
                gaze: 1.0,
                breath: 0.0
            };
            1800
        ];
        let averted = |emotion: &str| {
            let affect = EmotionCurve::parse(emotion).unwrap().sample(1800, FPS);
            let life = Life::of_speech(&speaking(60, 60), affect.view(), 4, FPS, &strengths);
            let down = life.gaze.index_axis(Axis(1), 0);
            down.outer_iter().filter(|eye| eye[1] < -0.075).count() as f64 / 1800.0
        };
        let (ashamed, sad, happy) = (averted("ashamed:1"), averted("sad:1"), averted("happy:1"));
        assert!(ashamed > 0.45 && ashamed < 0.9, "{ashamed}");
        assert!(sad > 0.2 && sad < ashamed, "{sad}");
        assert!(happy < 0.12, "{happy}");
        assert!(averted("ashamed:0.5") < ashamed);
    }

    #[test]
    fn a_strength_that_changes_holds_frame_by_frame() {
        let mut changing = strengths(1.0, 1.0, 0.0);
        changing[100..].fill(LifeStrengths {
            head: 2.0,
            gaze: 0.5,
            breath: 0.0,
        });
        let (mixed, one) = (performed(&changing), performed(&strengths(1.0, 1.0, 0.0)));
        for t in 0..270 {
            let factor = if t < 100 { 1.0 } else { 2.0 };
            assert_eq!(mixed.head.row(t), one.head.row(t).mapv(|x| factor * x));
        }
    }

    #[test]
    fn upper_lids_follow_the_eyes_and_closed_lids_stay_closed() {
        let modes = FaceModes::open(None).unwrap();
        let mut gaze = Array3::zeros((3, 2, 2));
        gaze.index_axis_mut(Axis(0), 0).fill(-0.1);
        gaze.index_axis_mut(Axis(0), 1).fill(0.1);
        gaze.index_axis_mut(Axis(0), 2).fill(-0.1);
        let mut moved = Array3::zeros((3, 68, 3));
        let eyes = lids(&modes).unwrap();
        for eye in &eyes {
            eye.close(&mut moved.index_axis_mut(Axis(0), 2), 1.0);
        }
        let shut = moved.index_axis(Axis(0), 2).to_owned();
        modes.follow_gaze(&mut moved, gaze.view()).unwrap();
        for upper in [37, 38, 43, 44] {
            assert!((-1.4e-3..-0.7e-3).contains(&moved[[0, upper, 1]]));
            assert!((0.7e-3..1.4e-3).contains(&moved[[1, upper, 1]]));
        }
        let most = (&moved.index_axis(Axis(0), 2) - &shut)
            .iter()
            .fold(0.0f32, |m, x| m.max(x.abs()));
        assert!(most < 1e-6, "{most}");
        let others = (0..68).filter(|n| !(36..48).contains(n));
        for n in others {
            assert!(moved.index_axis(Axis(1), n).iter().all(|x| *x == 0.0));
        }
    }
}
