//! Motion for a sound that is still going on.

use std::collections::VecDeque;

use anyface::{Result, conditions::Event};
use wasm_bindgen::prelude::*;

use crate::{clip::Act, shapes::Landmarks, speaker::Speaker};

/// A performance in progress: push samples, pull frames with [`crate::Engine::live_frame`].
#[wasm_bindgen]
pub struct Live {
    speaker: Speaker,
    /// What events do from the next frame on.
    acts: VecDeque<Act>,
    head: [f32; 3],
}

impl Live {
    pub(crate) fn new(speaker: Speaker) -> Live {
        Live {
            speaker,
            acts: VecDeque::new(),
            head: [0.0; 3],
        }
    }

    pub(crate) fn next(&mut self) -> Result<Option<Landmarks>> {
        let Some(mut spoken) = self.speaker.next()? else {
            return Ok(None);
        };
        if let Some(act) = self.acts.pop_front() {
            act.put_on(self.speaker.shapes(), &mut spoken.landmarks);
        }
        self.head = spoken.head;
        Ok(Some(spoken.landmarks))
    }
}

#[wasm_bindgen]
impl Live {
    /// Adds samples: mono, 16 kHz, within ±1.
    ///
    /// # Errors
    /// If samples are not finite.
    pub fn push(&mut self, samples: &[f32]) -> Result<(), JsError> {
        Ok(self.speaker.push(samples)?)
    }

    /// Sets the emotion from the next frame on, such as `happy:0.7`, or `auto` for the one heard in
    /// the voice.
    ///
    /// # Errors
    /// If the emotion is unknown.
    #[wasm_bindgen(js_name = setEmotion)]
    pub fn set_emotion(&mut self, emotion: &str) -> Result<(), JsError> {
        Ok(self.speaker.set_emotion(emotion)?)
    }

    /// Fades in an expression such as `smile:0.8` from the next frame on, and holds it for this
    /// many seconds.
    ///
    /// # Errors
    /// If the expression is unknown.
    pub fn show(&mut self, expression: &str, seconds: f64) -> Result<(), JsError> {
        let mut event = Event::parse(&format!("0-{seconds}:{expression}"))?;
        let [rise_s, fall_s] = event.edges_s(1.0);
        event.slot_s = [rise_s, rise_s + seconds];
        let frames = ((rise_s + seconds + fall_s) * self.speaker.fps()).ceil() as usize;
        let acts = Act::of(&[event], frames, self.speaker.fps());
        self.acts.resize(self.acts.len().max(frames), Act::NONE);
        for (to, act) in self.acts.iter_mut().zip(&acts) {
            *to = to.with(act);
        }
        Ok(())
    }

    /// How the head turned in the last frame: rotation vector, radians, axes of the face, `[3]`.
    pub fn head(&self) -> Vec<f32> {
        self.head.to_vec()
    }

    /// Frames per second.
    #[wasm_bindgen(getter)]
    pub fn fps(&self) -> f64 {
        self.speaker.fps()
    }

    /// How many seconds of sound after its own time a frame waits for.
    #[wasm_bindgen(getter, js_name = latencyS)]
    pub fn latency_s(&self) -> f64 {
        self.speaker.latency_s()
    }
}
