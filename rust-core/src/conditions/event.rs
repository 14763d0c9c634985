//! Events: action units that are active for a while, and the inputs of the model that they become.
//!
//! Cafe-Talk (Chen et al. 2025), eq. 1: `F = {(F_d, F_s, F_e)}`. We added sides, strengths and
//! times in seconds.

use ndarray::{Array2, Array3, Axis};

use super::{
    action_units::{ACTION_UNITS, LEARNED_UNITS, SIDES, Side},
    expression::{Expression, MAX_EVENT_STRENGTH},
};
use crate::{Error, Result};

/// Time over which an event's strength rises before its slot and falls after it, seconds.
pub const EDGE_S: f64 = 0.12;

/// Action units that are active for a while.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// First and last second.
    pub slot_s: [f64; 2],
    /// Numbers in [`ACTION_UNITS`], each with its side.
    pub units: Vec<(usize, Side)>,
    /// 0 to [`MAX_EVENT_STRENGTH`].
    pub strength: f32,
    /// Whether the event overrides the speech: lips that the speech would close may stay apart.
    pub over_speech: bool,
}

impl Event {
    /// Reads `1.2-2.0:12,6:0.8` or `0.5-0.9:left wink!`: seconds, and an [`Expression`] of units or
    /// of words from the menu.
    ///
    /// # Errors
    /// `InvalidInput` if the times do not rise, the expression needs a text model, a unit is unknown
    /// or the strength is out of range.
    pub fn parse(text: &str) -> Result<Event> {
        let (slot_s, said) = Event::slot_and_expression(text)?;
        Event::of(slot_s, Expression::parse(said)?)
    }

    /// Splits the text of an event into its first and last second and its expression.
    ///
    /// # Errors
    /// `InvalidInput` if the text does not start with two numbers, a `-` between them and a `:` after.
    pub fn slot_and_expression(text: &str) -> Result<([f64; 2], &str)> {
        let read = || {
            let (slot, said) = text.split_once(':')?;
            let (start, end) = slot.split_once('-')?;
            Some(([start.trim().parse().ok()?, end.trim().parse().ok()?], said))
        };
        read().ok_or_else(|| {
            Error::InvalidInput(format!(
                "event: expected seconds, units or words, and strength as in 1.2-2.0:12,6L:0.8, got {text:?}"
            ))
        })
    }

    /// An event that shows an expression between two times.
    ///
    /// # Errors
    /// Those of [`Event::check`].
    pub fn of(slot_s: [f64; 2], expression: Expression) -> Result<Event> {
        let event = Event {
            slot_s,
            units: expression.units,
            strength: expression.strength,
            over_speech: expression.over_speech,
        };
        event.check()?;
        Ok(event)
    }

    /// Whether one of the event's units moves this ARKit shape.
    pub fn shows(&self, shape: &str) -> bool {
        self.shows_by(shape, |_| true)
    }

    fn shows_by(&self, shape: &str, counts: impl Fn(usize) -> bool) -> bool {
        let mut units = self.units.iter().filter(|(unit, _)| counts(*unit));
        units.any(|&(unit, side)| ACTION_UNITS[unit].shows(side, shape))
    }

    /// The frames of the slot and of the fades around it, each with its share of the event's
    /// strength. The strength rises and falls over `edge_s`.
    fn shares(&self, frames: usize, fps: f64, edge_s: f64) -> impl Iterator<Item = (usize, f32)> {
        let [first, end] = self.slot(fps);
        let edge = (edge_s * fps).round() as usize;
        let all = first.saturating_sub(edge)..end.saturating_add(edge).min(frames);
        all.map(move |t| {
            let beyond = first.saturating_sub(t).max((t + 1).saturating_sub(end));
            (t, 1.0 - beyond as f32 / (edge + 1) as f32)
        })
    }

    /// The first frame of the slot, and the frame after its last.
    fn slot(&self, fps: f64) -> [usize; 2] {
        let [first, last] = self.slot_s.map(|second| (second * fps).round() as usize);
        [first, last.max(first.saturating_add(1))]
    }

    /// The event's units in the form that [`Event::parse`] reads: `12`, `6L`.
    pub fn written_units(&self) -> Vec<String> {
        let written = |(unit, side): &(usize, Side)| side.written(ACTION_UNITS[*unit].name);
        self.units.iter().map(written).collect()
    }

    /// Checks that all numbers of the event are in range.
    ///
    /// # Errors
    /// `InvalidInput` names the number that is out of range.
    pub fn check(&self) -> Result<()> {
        let [start, end] = self.slot_s;
        let complaint = if !(start >= 0.0 && start < end && end.is_finite()) {
            format!("slot: expected two rising times from 0 s, got {start} to {end} s")
        } else if self.units.is_empty() {
            "units: expected at least one, got none".to_owned()
        } else if let Some((unit, _)) = self
            .units
            .iter()
            .find(|(unit, _)| *unit >= ACTION_UNITS.len())
        {
            format!(
                "unit: expected a number below {}, got {unit}",
                ACTION_UNITS.len()
            )
        } else if !(0.0..=MAX_EVENT_STRENGTH).contains(&self.strength) {
            format!(
                "strength: expected 0 to {MAX_EVENT_STRENGTH}, got {}",
                self.strength
            )
        } else {
            return Ok(());
        };
        Err(Error::InvalidInput(format!("event {complaint}")))
    }
}

/// Events frame by frame, in the form that the model takes.
#[derive(Debug, Clone, PartialEq)]
pub struct EventTrack {
    /// `[T, 32]` of 0 and 1: units on the left, then on the right. A unit for one side is active on
    /// both, because the built-in model learned from symmetric faces. The mask restricts it to its
    /// side.
    pub active: Array2<f32>,
    /// `[T, S]`, Z of eq. 6: for each frame and shape, the largest strength of any event whose
    /// learned units move the shape. 0 elsewhere.
    pub mask: Array2<f32>,
    /// `[T, S]`: the least weight of each shape in each frame, as set by units that no network has
    /// learned. 0 elsewhere.
    pub put_on: Array2<f32>,
    /// `[T]`: whether an event overrides the speech in this frame.
    pub over_speech: Vec<bool>,
}

impl EventTrack {
    /// Samples events in `frames` frames at `fps`; frame `t` is at `t / fps` seconds. An event has
    /// at least one frame. In the mask its strength rises over `edge_s` before its slot and falls
    /// over `edge_s` after it. `edge_s` is [`EDGE_S`], as the model has learned it, or 0 for a mask
    /// of the slot alone.
    ///
    /// `shapes`: the ARKit names of the model's shapes.
    pub fn of(
        events: &[Event],
        shapes: &[String],
        frames: usize,
        fps: f64,
        edge_s: f64,
    ) -> EventTrack {
        let mut track = EventTrack {
            active: Array2::zeros((frames, SIDES * LEARNED_UNITS)),
            mask: Array2::zeros((frames, shapes.len())),
            put_on: Array2::zeros((frames, shapes.len())),
            over_speech: vec![false; frames],
        };
        for event in events {
            track.add(event, shapes, fps, edge_s);
        }
        track
    }

    fn add(&mut self, event: &Event, shapes: &[String], fps: f64, edge_s: f64) {
        let frames = self.mask.nrows();
        for (s, shape) in shapes.iter().enumerate() {
            if event.shows_by(shape, |unit| unit < LEARNED_UNITS) {
                for (t, share) in event.shares(frames, fps, edge_s) {
                    self.mask[[t, s]] = self.mask[[t, s]].max(share * event.strength);
                }
            }
            let is_put_on = |unit: usize| unit >= LEARNED_UNITS && !ACTION_UNITS[unit].turns_eyes();
            if event.shows_by(shape, is_put_on) {
                for (t, share) in event.shares(frames, fps, EDGE_S) {
                    let weight = smooth(share) * event.strength;
                    self.put_on[[t, s]] = self.put_on[[t, s]].max(weight);
                }
            }
        }
        let [first, end] = event.slot(fps);
        for t in first..end.min(frames) {
            self.over_speech[t] |= event.over_speech;
            let learned = event.units.iter().filter(|(unit, _)| *unit < LEARNED_UNITS);
            for &(unit, _) in learned {
                for side in 0..SIDES {
                    self.active[[t, side * LEARNED_UNITS + unit]] = 1.0;
                }
            }
        }
    }
}

/// Turns the eyes as the events ask. `gaze` `[T, 2, 2]`: as in [`crate::motion::Life`].
pub(crate) fn turn_eyes(events: &[Event], gaze: &mut Array3<f32>, fps: f64) {
    for event in events {
        let units = event.units.iter().map(|(unit, _)| ACTION_UNITS[*unit]);
        let turns: Vec<[f32; 2]> = units
            .filter(|unit| unit.turns_eyes())
            .map(|unit| unit.gaze)
            .collect();
        if turns.is_empty() {
            continue;
        }
        for (t, share) in event.shares(gaze.dim().0, fps, EDGE_S) {
            let share = smooth(share);
            for mut angles in gaze.index_axis_mut(Axis(0), t).outer_iter_mut() {
                for (axis, angle) in angles.iter_mut().enumerate() {
                    let to: f32 = turns.iter().map(|turn| event.strength * turn[axis]).sum();
                    *angle += share * (to - *angle);
                }
            }
        }
    }
}

/// Eases from 0 to 1 without a corner at either end.
fn smooth(share: f32) -> f32 {
    share * share * (3.0 - 2.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{conditions::ActionUnit, rig::ARKIT};

    #[test]
    fn events_are_read_with_sides_and_strength() {
        let event = Event::parse("1.2-2.0:12,AU06L:0.8").unwrap();
        assert_eq!(event.slot_s, [1.2, 2.0]);
        assert_eq!(event.units, [(8, Side::Both), (4, Side::Left)]);
        assert_eq!((event.strength, event.over_speech), (0.8, false));
        assert!(Event::parse("1.2-2.0:26!").unwrap().over_speech);
        for wrong in [
            "2-1:12",
            "1-2",
            "1-2:99",
            "1-2:12:3",
            "x-2:12",
            "1-2::1",
            "-1-2:12",
            "1-2:12:nan",
        ] {
            assert!(Event::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_track_has_units_in_their_slots_and_nowhere_else() {
        let events = [
            Event::parse("0.4-0.8:45L:0.5").unwrap(),
            Event::parse("0.6-9:1").unwrap(),
        ];
        let shapes = ARKIT.map(str::to_owned);
        let track = EventTrack::of(&events, &shapes, 25, 25.0, EDGE_S);
        let at = |name: &str| ARKIT.iter().position(|known| *known == name).unwrap();
        let wink = track.mask.column(at("eyeBlinkLeft")).to_vec();
        assert_eq!(wink[6..11], [0.0, 0.125, 0.25, 0.375, 0.5]);
        let slot = EventTrack::of(&events, &shapes, 25, 25.0, 0.0).mask;
        let wink = slot.column(at("eyeBlinkLeft")).to_vec();
        assert_eq!(wink[8..12], [0.0, 0.0, 0.5, 0.5]);
        assert_eq!(wink[18..22], [0.5, 0.5, 0.0, 0.0]);
        assert_eq!(track.mask.column(at("eyeBlinkRight")).sum(), 0.0);
        assert_eq!(track.mask[[24, at("browInnerUp")]], 1.0);
        assert_eq!((track.active[[20, 0]], track.active[[20, 16]]), (1.0, 1.0));
        assert_eq!(track.active.sum(), 2.0 * 10.0 + 2.0 * 10.0);
        for never in ["1e300-2e300:1", "1.2-2:1"] {
            let never = [Event::parse(never).unwrap()];
            let track = EventTrack::of(&never, &shapes, 25, 25.0, EDGE_S);
            assert_eq!((track.active.sum(), track.mask.sum()), (0.0, 0.0));
        }
        let soon = [Event::parse("1.04-2:1").unwrap()];
        let mask = EventTrack::of(&soon, &shapes, 25, 25.0, EDGE_S).mask;
        let brow = mask.column(at("browInnerUp"));
        assert_eq!([brow[22], brow[23], brow[24]], [0.0, 0.25, 0.5]);
    }

    #[test]
    fn units_that_no_network_has_learned_are_put_on_and_turn_eyes() {
        let events = [
            Event::parse("0.4-0.8:18,23L:0.5").unwrap(),
            Event::parse("0.4-0.8:look up").unwrap(),
        ];
        let shapes = ARKIT.map(str::to_owned);
        let at = |name: &str| ARKIT.iter().position(|known| *known == name).unwrap();
        let track = EventTrack::of(&events, &shapes, 25, 25.0, EDGE_S);
        assert_eq!((track.active.sum(), track.mask.sum()), (0.0, 0.0));
        let least = |t: usize, name: &str| track.put_on[[t, at(name)]];
        // The gaze angles turn the eyes. The look-down shapes would also shut the lids.
        assert_eq!(
            (least(12, "eyeLookUpLeft"), least(12, "eyeLookDownLeft")),
            (0.0, 0.0)
        );
        assert_eq!(
            (least(12, "mouthPucker"), least(12, "mouthPressLeft")),
            (0.5, 0.5)
        );
        assert_eq!(
            (least(12, "mouthPressRight"), least(4, "mouthPucker")),
            (0.0, 0.0)
        );
        assert!(least(8, "mouthPucker") > 0.2 && least(8, "mouthPucker") < 0.5);
        let mut gaze = Array3::from_elem((25, 2, 2), 0.1);
        turn_eyes(&events, &mut gaze, 25.0);
        assert_eq!(
            gaze[[12, 0, 1]],
            ACTION_UNITS[ActionUnit::find("63").unwrap()].gaze[1]
        );
        assert_eq!((gaze[[12, 1, 0]], gaze[[2, 0, 1]]), (0.0, 0.1));
    }
}
