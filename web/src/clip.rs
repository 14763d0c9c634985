//! Motion of a whole sound.

use std::sync::Arc;

use anyface::{
    Error, Result,
    conditions::{EDGE_S, Event, EventTrack},
    mesh::ibug::REGIONS,
    motion::Life,
    rig::ARKIT,
};
use wasm_bindgen::prelude::*;

use crate::{
    shapes::{Landmarks, Shapes, Weights},
    speaker::{Speaker, Spoken},
};

/// Motion of a whole sound, which can move any face.
#[wasm_bindgen]
pub struct Clip {
    frames: Vec<Spoken>,
    fps: f64,
    shapes: Arc<Shapes>,
    events: Vec<Event>,
    /// What the events do in each frame, `[T]`.
    acts: Vec<Act>,
}

/// What events do to a face in one frame.
#[derive(Clone, Copy)]
pub(crate) struct Act {
    /// Weights of ARKit's shapes that they add.
    pub weights: Weights,
    /// How far they keep the speech from moving mouth and jaw, 0 to 1.
    pub shut: f32,
}

impl Act {
    /// Nothing.
    pub const NONE: Act = Act {
        weights: [0.0; _],
        shut: 0.0,
    };

    /// What `events` do in each frame, `[frames]`.
    pub fn of(events: &[Event], frames: usize, fps: f64) -> Vec<Act> {
        let shapes = ARKIT.map(str::to_owned);
        let track = EventTrack::of(events, &shapes, (frames, fps), EDGE_S, 1.0);
        let weight = |t: usize, s: usize| track.shown[[t, s]].max(track.put_on[[t, s]]);
        let act = |t: usize| Act {
            weights: std::array::from_fn(|s| weight(t, s)),
            shut: track.shut[t],
        };
        (0..frames).map(act).collect()
    }

    /// Both at once.
    pub fn with(&self, other: &Act) -> Act {
        Act {
            weights: std::array::from_fn(|s| self.weights[s].max(other.weights[s])),
            shut: self.shut.max(other.shut),
        }
    }

    /// Puts it on the landmarks of speech.
    pub fn put_on(&self, shapes: &Shapes, landmarks: &mut Landmarks) {
        let spoken = REGIONS
            .iter()
            .filter(|(name, _)| matches!(*name, "mouth" | "jaw"));
        for landmark in spoken.flat_map(|(_, landmarks)| landmarks.clone()) {
            let moved = &mut landmarks[3 * landmark..3 * landmark + 3];
            moved.iter_mut().for_each(|to| *to *= 1.0 - self.shut);
        }
        shapes.add(&self.weights, landmarks);
    }
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
            acts: Vec::new(),
        };
        clip.update_acts();
        Ok(clip)
    }

    fn update_acts(&mut self) {
        self.acts = Act::of(&self.events, self.frames.len(), self.fps);
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
        self.acts[frame].put_on(&self.shapes, &mut landmarks);
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
        self.update_acts();
        Ok(())
    }

    /// Removes all events.
    #[wasm_bindgen(js_name = clearEvents)]
    pub fn clear_events(&mut self) {
        self.events.clear();
        self.update_acts();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lips_that_an_event_shuts_do_not_speak() {
        let shapes = Shapes::open().unwrap();
        let spoken: Landmarks = std::array::from_fn(|i| 1e-3 * (1 + i % 7) as f32);
        let acts = Act::of(&[Event::parse("1-2:8").unwrap()], 75, 25.0);
        let [before, during] = [5, 37].map(|t| {
            let mut landmarks = spoken;
            acts[t].put_on(&shapes, &mut landmarks);
            landmarks
        });
        assert_eq!(before, spoken);
        let still = |n: usize| during[3 * n..3 * n + 3].iter().all(|x| x.abs() < 1e-9);
        assert!((0..17).chain(48..68).all(still), "{during:?}");
        assert_eq!(during[51..144], spoken[51..144]);
        let mut smile = Act::of(&[Event::parse("1-2:12").unwrap()], 75, 25.0)[37];
        smile = smile.with(&acts[37]);
        let (mut both, mut alone) = (spoken, [0.0; _]);
        smile.put_on(&shapes, &mut both);
        shapes.add(&smile.weights, &mut alone);
        assert!(alone[3 * 54 + 1] > 1e-3, "{}", alone[3 * 54 + 1]);
        assert_eq!(both[144..], alone[144..]);
    }
}
