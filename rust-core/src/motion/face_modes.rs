//! ARKit's expressions at the landmarks, and the emotions made of them.
//!
//! Twin of `training/corpus/{ict,emotions,manner}.py`, written by `training/export_face_modes.py`.

use std::{collections::BTreeMap, path::Path};

use ndarray::{Array2, Array3, ArrayView2, Axis, s};
use serde::Deserialize;

use super::LandmarkClip;
use crate::{
    Error, Result,
    conditions::EMOTIONS,
    ibug::LANDMARKS,
    models::{BuiltIn, built_in},
    nn::Weights,
};

/// Its built-in weights.
pub static MODEL: BuiltIn = built_in!("face_modes");

/// Expression modes of the mean ICT face and the emotion prototypes.
#[derive(Debug, Clone)]
pub struct FaceModes {
    names: Vec<String>,
    /// `[M, 68, 3]`, canonical metres.
    modes: Array3<f32>,
    /// `[15, 204]`, canonical metres at intensity 1.
    emotions: Array2<f32>,
    /// `[15]`, time constants of emotions that come, seconds.
    rise_s: Vec<f64>,
    fall_over_rise: f64,
    settling_s: f64,
}

#[derive(Deserialize)]
struct Config {
    modes: Vec<String>,
    emotions: BTreeMap<String, Prototype>,
    fall_over_rise: f64,
    settling_s: f64,
}

/// Weights by the name of the mode.
#[derive(Deserialize)]
struct Prototype {
    lasting: BTreeMap<String, f32>,
    opening: BTreeMap<String, f32>,
    rise_s: f64,
}

impl FaceModes {
    /// The built-in modes, or those of `folder/face_modes`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing or does not fit the other.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = MODEL.open(folder)?;
        let config: Config = serde_json::from_str(&files.config)
            .map_err(|error| Error::Weights(format!("{}/config.json: {error}", MODEL.name)))?;
        let shape = [config.modes.len(), LANDMARKS, 3];
        let values = Weights::from_bytes(&files.weights)?.values("modes", &shape)?;
        let modes = Array3::from_shape_vec((shape[0], LANDMARKS, 3), values)
            .expect("the shape was checked by the reader");
        let mut this = FaceModes {
            names: config.modes,
            modes,
            emotions: Array2::zeros((EMOTIONS.len(), LANDMARKS * 3)),
            rise_s: Vec::new(),
            fall_over_rise: config.fall_over_rise,
            settling_s: config.settling_s,
        };
        for (row, emotion) in EMOTIONS.iter().enumerate() {
            let prototype = config.emotions.get(*emotion).ok_or_else(|| {
                Error::Weights(format!(
                    "{}: expected the emotion {emotion}, got none",
                    MODEL.name
                ))
            })?;
            let weights = prototype.lasting.iter().chain(&prototype.opening);
            let displacement = this.sum(weights)?;
            this.emotions.row_mut(row).assign(&displacement.flatten());
            this.rise_s.push(prototype.rise_s);
        }
        Ok(this)
    }

    /// One mode by its name, such as `jawOpen` or `eyeBlink_L`: `[68, 3]`, canonical metres.
    ///
    /// # Errors
    /// `Weights` for an unknown name.
    pub fn mode(&self, name: &str) -> Result<ArrayView2<'_, f32>> {
        let known = self.names.iter().position(|known| known == name);
        let index = known.ok_or_else(|| {
            Error::Weights(format!("{}: expected a mode {name}, got none", MODEL.name))
        })?;
        Ok(self.modes.index_axis(Axis(0), index))
    }

    /// What the emotion alone does to the face, `[T, 68, 3]`, canonical metres.
    ///
    /// `affect`: `[T, 16]`, mixture and intensity. Comes fast and goes slower, as in training. Differs:
    /// what opens the mouth does not yield to closures here.
    pub fn emotion(&self, affect: ArrayView2<'_, f32>, fps: f64) -> Array3<f32> {
        let kinds = EMOTIONS.len();
        let mut strength = &affect.slice(s![.., ..kinds]) * &affect.slice(s![.., kinds..]);
        self.follow(&mut strength, fps);
        let displacements = strength
            .dot(&self.emotions)
            .into_shape_with_order((affect.nrows(), LANDMARKS, 3))
            .expect("three axes a landmark");
        LandmarkClip { displacements, fps }
            .smoothed(self.settling_s)
            .displacements
    }

    /// One pole for each emotion, `[T, 15]`, that starts settled; exact at any frame rate.
    fn follow(&self, strength: &mut Array2<f32>, fps: f64) {
        let gain = |time_s: f64| (1.0 - (-1.0 / (time_s * fps)).exp()) as f32;
        for (mut track, rise_s) in strength.columns_mut().into_iter().zip(&self.rise_s) {
            let (rise, fall) = (gain(*rise_s), gain(rise_s * self.fall_over_rise));
            let mut now = track.first().copied().unwrap_or(0.0);
            for value in &mut track {
                let change = *value - now;
                now += change * if change > 0.0 { rise } else { fall };
                *value = now;
            }
        }
    }

    fn sum<'a>(&self, weights: impl Iterator<Item = (&'a String, &'a f32)>) -> Result<Array2<f32>> {
        let mut total = Array2::zeros((LANDMARKS, 3));
        for (name, weight) in weights {
            total.scaled_add(*weight, &self.mode(name)?);
        }
        Ok(total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conditions::{Emotion, EmotionCurve};

    #[test]
    fn the_jaw_opens_downwards_and_the_blink_closes_the_left_eye() {
        let modes = FaceModes::open(None).unwrap();
        assert!(modes.mode("jawOpen").unwrap()[[8, 1]] < -0.02);
        let blink = modes.mode("eyeBlink_L").unwrap();
        assert!(blink[[43, 1]] < -0.005 && blink[[37, 1]].abs() < 1e-4);
        assert!(modes.mode("earWiggle").is_err());
    }

    #[test]
    fn emotions_scale_with_their_intensity_and_neutral_is_nothing() {
        let modes = FaceModes::open(None).unwrap();
        let at = |text: &str| {
            let curve = EmotionCurve::Constant(Emotion::parse(text).unwrap());
            modes.emotion(curve.sample(9, 25.0).view(), 25.0)
        };
        assert!(at("neutral:1").iter().all(|x| *x == 0.0));
        let (half, full) = (at("happy:0.5"), at("happy:1"));
        assert!((&full - &(2.0 * &half)).iter().all(|x| x.abs() < 1e-6));
        assert!(full[[4, 48, 1]] > 1e-3, "corners rise");
    }

    #[test]
    fn an_emotion_sets_in_without_a_step() {
        let modes = FaceModes::open(None).unwrap();
        let mut affect = Array2::zeros((100, 16));
        affect.slice_mut(s![50.., 5]).fill(1.0);
        affect.slice_mut(s![50.., 15]).fill(1.0);
        let sad = modes.emotion(affect.view(), 25.0);
        let corner: Vec<f32> = (0..100).map(|t| sad[[t, 48, 1]]).collect();
        let whole = corner[99] - corner[0];
        let steps = corner.windows(2).map(|w| ((w[1] - w[0]) / whole).abs());
        assert!(steps.fold(0.0, f32::max) < 0.2 && whole < -1e-3);
    }

    #[test]
    fn an_emotion_comes_faster_than_it_goes() {
        let modes = FaceModes::open(None).unwrap();
        let mut affect = Array2::zeros((200, 16));
        affect.slice_mut(s![50..125, 9]).fill(1.0);
        affect.slice_mut(s![50..125, 15]).fill(1.0);
        let angry = modes.emotion(affect.view(), 25.0);
        let brow = |t: usize| angry[[t, 20, 1]] / angry[[124, 20, 1]];
        assert!(brow(56) > 0.75 && brow(131) > 0.25 && brow(199) < 0.02);
    }
}
