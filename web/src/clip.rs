//! Motion of a whole sound.

use std::sync::Arc;

use anyface::{
    Error, Result,
    conditions::{EDGE_S, Event, EventTrack},
    motion::Life,
    rig::ARKIT,
};
use ndarray::Array2;
use wasm_bindgen::prelude::*;

use crate::{
    shapes::{Landmarks, Shapes},
    speaker::{Speaker, Spoken},
};

/// Motion of a whole sound, which can move any face.
#[wasm_bindgen]
pub struct Clip {
    frames: Vec<Spoken>,
    fps: f64,
    shapes: Arc<Shapes>,
    events: Vec<Event>,
    /// Weights of ARKit's shapes that the events add, `[T, 52]`.
    event_weights: Array2<f32>,
}

impl Clip {
    pub(crate) fn of(mut speaker: Speaker) -> Result<Clip> {
        let mut frames = Vec::new();
        while let Some(frame) = speaker.next()? {
            frames.push(frame);
        }
        let mut clip = Clip {
            frames,
            fps: speaker.fps(),
            shapes: Arc::clone(speaker.shapes()),
            events: Vec::new(),
            event_weights: Array2::default((0, 0)),
        };
        clip.update_event_weights();
        Ok(clip)
    }

    fn update_event_weights(&mut self) {
        self.event_weights = weights_of(&self.events, self.frames.len(), self.fps);
    }

    /// Displacements of the landmarks in a frame.
    pub(crate) fn landmarks(&self, frame: usize) -> Result<Landmarks> {
        let count = self.frames.len();
        let Some(spoken) = self.frames.get(frame) else {
            return Err(Error::InvalidInput(format!(
                "frame: expected a number below {count}, got {frame}"
            )));
        };
        let mut landmarks = spoken.landmarks;
        let weights = std::array::from_fn(|s| self.event_weights[[frame, s]]);
        self.shapes.add(&weights, &mut landmarks);
        Ok(landmarks)
    }

    /// How the head turns in all frames.
    pub(crate) fn life(&self) -> Life {
        let mut life = Life::still(self.frames.len());
        for (mut to, frame) in life.head.outer_iter_mut().zip(&self.frames) {
            to.iter_mut()
                .zip(frame.head)
                .for_each(|(to, angle)| *to = angle);
        }
        life
    }
}

/// Weights of ARKit's shapes that events ask for, `[frames, 52]`.
pub(crate) fn weights_of(events: &[Event], frames: usize, fps: f64) -> Array2<f32> {
    let shapes = ARKIT.map(str::to_owned);
    let EventTrack { shown, put_on, .. } =
        EventTrack::of(events, &shapes, (frames, fps), EDGE_S, 1.0);
    let mut weights = put_on;
    weights.zip_mut_with(&shown, |to, strength| *to = to.max(*strength));
    weights
}

#[wasm_bindgen]
impl Clip {
    /// Number of frames.
    #[wasm_bindgen(getter, js_name = frameCount)]
    pub fn frame_count(&self) -> usize {
        self.frames.len()
    }

    /// Frames per second.
    #[wasm_bindgen(getter)]
    pub fn fps(&self) -> f64 {
        self.fps
    }

    /// How the head turns in a frame: rotation vector, radians, axes of the face, `[3]`; nothing
    /// after the last frame.
    pub fn head(&self, frame: usize) -> Option<Vec<f32>> {
        self.frames.get(frame).map(|frame| frame.head.to_vec())
    }

    /// Adds an event such as `1.2-2.0:smile:0.8`: seconds, what the face does, and how strongly.
    ///
    /// # Errors
    /// If the seconds do not rise or the expression is unknown.
    #[wasm_bindgen(js_name = addEvent)]
    pub fn add_event(&mut self, event: &str) -> Result<(), JsError> {
        self.events.push(Event::parse(event)?);
        self.update_event_weights();
        Ok(())
    }

    /// Removes all events.
    #[wasm_bindgen(js_name = clearEvents)]
    pub fn clear_events(&mut self) {
        self.events.clear();
        self.update_event_weights();
    }
}
