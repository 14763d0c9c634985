//! Adds expressions frame by frame, without knowing later frames.

use std::sync::Arc;

use ndarray::{Array2, ArrayViewMut2};

use super::{
    apply::{Moment, SLUR_S},
    dynamics::{Follower, Wandering},
    lips,
    table::Expressions,
};
use crate::{
    Result,
    conditions::Emotion,
    mesh::ibug::LANDMARKS,
    motion::{
        FaceModes, LandmarkFrame,
        gestures::{GestureModes, Gestures},
        upper_face::{lids, limit_frame},
    },
};

/// The lips rest this long after the last sound, seconds.
const REST_AFTER_S: f64 = 0.35;
/// How fast the lips leave rest and return to it, per second.
const WAKE_PER_S: f32 = 8.0;
const REST_PER_S: f32 = 3.0;
/// Time constant with which the parting of the lips returns after a closure, seconds.
const RELEASE_S: f64 = 0.06;

/// Adds expressions to a stream of frames. A change of emotion acts from the next frame on.
///
/// Unlike [`Expressions::add`], it ignores stressed syllables, because only later sound shows that a
/// syllable stands out. It slurs speech with past frames alone, and the lips rest when the sound does.
pub struct CausalExpression {
    table: Arc<Expressions>,
    modes: Arc<FaceModes>,
    fps: f64,
    follower: Follower,
    wandering: Wandering,
    gestures: Gestures,
    gesture_modes: GestureModes,
    /// The speech so far, smoothed with a pole at [`SLUR_S`]: `[68, 3]`, canonical metres.
    smooth: Option<Array2<f32>>,
    yielding: f32,
    speaking: f32,
}

impl CausalExpression {
    /// A stream that starts at the first frame's emotion in full, with the lips at rest.
    ///
    /// # Errors
    /// `Weights` where `modes` lack a shape of the gestures.
    pub fn new(table: Arc<Expressions>, modes: Arc<FaceModes>, fps: f64) -> Result<Self> {
        let gesture_modes = GestureModes::of(&modes)?;
        Ok(CausalExpression {
            table,
            modes,
            fps,
            follower: Follower::new(1.0),
            wandering: Wandering::new(0),
            gestures: Gestures::new(0),
            gesture_modes,
            smooth: None,
            yielding: 0.0,
            speaking: 0.0,
        })
    }

    /// Sets the factor on the times in which emotions come and go from the next frame on; 0 follows at once.
    pub fn set_onset(&mut self, onset: f32) {
        self.follower.onset = onset;
    }

    /// Adds the expression to the next frame. `quiet_s`: how long nobody has spoken, seconds.
    pub fn add(&mut self, frame: &mut LandmarkFrame, emotion: &Emotion, quiet_s: f64) {
        let time_s = frame.index as f64 / self.fps;
        let flat = frame.displacements.as_flattened_mut();
        let mut frame = ArrayViewMut2::from_shape((LANDMARKS, 3), flat).expect("68 landmarks");
        let targets = emotion.mixture.map(|share| share * emotion.intensity);
        let strengths = self.follower.step(&targets, &self.table, self.fps);
        self.hear(&frame, quiet_s);
        let moment = Moment {
            strengths,
            regions: self.wandering.at(time_s),
            yielding: self.yielding,
            speaking: self.speaking,
        };
        let smooth = self.smooth.as_ref().expect("hear was called").view();
        let eyes = lids(&self.modes).expect("both lids, checked when the modes were opened");
        self.table.show(&mut frame, smooth, &moment, &eyes);
        let shown = frame.to_owned();
        let weights = self.gestures.step(&strengths, 1.0 / self.fps);
        self.gesture_modes.add(&mut frame, &weights);
        limit_frame(&mut frame, &eyes);
        lips::hold(&mut frame, shown.view(), 1.0);
    }

    /// Updates the smoothed speech, how much the lips speak and how far they yield, from a spoken frame.
    fn hear(&mut self, frame: &ArrayViewMut2<'_, f32>, quiet_s: f64) {
        let keep = |time_s: f64| (-1.0 / (time_s * self.fps)).exp() as f32;
        let (slur, release) = (keep(SLUR_S), keep(RELEASE_S));
        let smooth = self.smooth.get_or_insert_with(|| frame.to_owned());
        smooth.zip_mut_with(frame, |slow, now| *slow = now + slur * (*slow - now));
        let step = if quiet_s < REST_AFTER_S {
            WAKE_PER_S
        } else {
            -REST_PER_S
        };
        self.speaking = (self.speaking + step / self.fps as f32).clamp(0.0, 1.0);
        let closed = self.speaking * lips::closed_lips(frame.view());
        self.yielding = closed.max(closed + release * (self.yielding - closed));
    }
}
