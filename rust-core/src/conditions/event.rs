//! Events: action units that are active for a while, and the inputs of the model that they become.
//!
//! Cafe-Talk (Chen et al. 2025), eq. 1: `F = {(F_d, F_s, F_e)}`. We added sides, strengths and
//! times in seconds.

use ndarray::{Array2, Array3, Axis};

use super::{
    action_units::{ACTION_UNITS, ActionUnit, LEARNED_UNITS, OFFSET_OVER_ONSET, SIDES, Side},
    expression::{Expression, MAX_EVENT_STRENGTH},
};
use crate::{Error, Result};

/// Time over which an event's strength rises before its slot and falls after it, as the network has
/// learned it, seconds.
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

    /// The frames of the slot and of the fades around it, each with its share of the event's
    /// strength. The strength rises over the first of `edges_s` and falls over the second.
    fn shares(
        &self,
        frames: usize,
        fps: f64,
        edges_s: [f64; 2],
    ) -> impl Iterator<Item = (usize, f32)> {
        let [first, end] = self.slot(fps);
        let [rise, fall] = edges_s.map(|edge_s| (edge_s * fps).round() as usize);
        let all = first.saturating_sub(rise)..end.saturating_add(fall).min(frames);
        all.map(move |t| {
            let before = first.saturating_sub(t) as f32 / (rise + 1) as f32;
            let behind = (t + 1).saturating_sub(end) as f32 / (fall + 1) as f32;
            (t, 1.0 - before.max(behind))
        })
    }

    /// How long before its slot the first of its units starts to rise, and how long after it the last
    /// one has fallen, seconds. `onset`: as in [`EventTrack::of`].
    pub fn edges_s(&self, onset: f64) -> [f64; 2] {
        let units = self.units.iter().map(|(unit, _)| &ACTION_UNITS[*unit]);
        let edges = units.map(|unit| edges_of(unit, onset));
        edges.fold([0.0; 2], |[rise, fall], [other_rise, other_fall]| {
            [rise.max(other_rise), fall.max(other_fall)]
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
    /// `[T, S]`: the same strengths as in `mask`, but they rise and fall as long as the units take on a
    /// face.
    pub shown: Array2<f32>,
    /// `[T, S]`: the least weight of each shape in each frame, as set by units that no network has
    /// learned. 0 elsewhere.
    pub put_on: Array2<f32>,
    /// `[T]`, 0 to 1: how far events keep the speech from moving the lips, which then stay shut.
    pub shut: Vec<f32>,
    /// `[T]`: whether an event overrides the speech in this frame.
    pub over_speech: Vec<bool>,
}

impl EventTrack {
    /// Samples events in `frames` frames at `fps`; frame `t` is at `t / fps` seconds. An event has
    /// at least one frame. In the mask its strength rises over `edge_s` before its slot and falls
    /// over `edge_s` after it. `edge_s` is [`EDGE_S`], as the model has learned it, or 0 for a mask
    /// of the slot alone. What is `shown` and `put_on` rises and falls over `onset` times the units' own
    /// times.
    ///
    /// `shapes`: the ARKit names of the model's shapes.
    pub fn of(
        events: &[Event],
        shapes: &[String],
        (frames, fps): (usize, f64),
        edge_s: f64,
        onset: f64,
    ) -> EventTrack {
        let mut track = EventTrack {
            active: Array2::zeros((frames, SIDES * LEARNED_UNITS)),
            mask: Array2::zeros((frames, shapes.len())),
            shown: Array2::zeros((frames, shapes.len())),
            put_on: Array2::zeros((frames, shapes.len())),
            shut: vec![0.0; frames],
            over_speech: vec![false; frames],
        };
        for event in events {
            track.add(event, shapes, fps, (edge_s, onset));
        }
        track
    }

    fn add(&mut self, event: &Event, shapes: &[String], fps: f64, (edge_s, onset): (f64, f64)) {
        let frames = self.mask.nrows();
        for (s, shape) in shapes.iter().enumerate() {
            for &(unit, side) in &event.units {
                let is_learned = unit < LEARNED_UNITS;
                let unit = &ACTION_UNITS[unit];
                if unit.turns_eyes() || unit.closes_lips() || !unit.shows(side, shape) {
                    continue;
                }
                let shown = if is_learned {
                    &mut self.shown
                } else {
                    &mut self.put_on
                };
                for (t, share) in event.shares(frames, fps, edges_of(unit, onset)) {
                    shown[[t, s]] = shown[[t, s]].max(smooth(share) * event.strength);
                }
                if is_learned {
                    for (t, share) in event.shares(frames, fps, [edge_s; 2]) {
                        self.mask[[t, s]] = self.mask[[t, s]].max(share * event.strength);
                    }
                }
            }
        }
        let mut units = event.units.iter().map(|(unit, _)| &ACTION_UNITS[*unit]);
        let closing = units.find(|unit| unit.closes_lips());
        if let Some(unit) = closing {
            for (t, share) in event.shares(frames, fps, edges_of(unit, onset)) {
                self.shut[t] = self.shut[t].max(smooth(share) * event.strength.min(1.0));
            }
        }
        let [first, end] = event.slot(fps);
        for t in first..end.min(frames) {
            self.over_speech[t] |= event.over_speech || closing.is_some();
            let learned = event.units.iter().filter(|(unit, _)| *unit < LEARNED_UNITS);
            for &(unit, _) in learned {
                for side in 0..SIDES {
                    self.active[[t, side * LEARNED_UNITS + unit]] = 1.0;
                }
            }
        }
    }
}

/// Turns the eyes as the events ask. `gaze` `[T, 2, 2]`: as in [`crate::motion::Life`]. `onset`: as in
/// [`EventTrack::of`].
pub(crate) fn turn_eyes(events: &[Event], gaze: &mut Array3<f32>, fps: f64, onset: f64) {
    for event in events {
        let units = event.units.iter().map(|(unit, _)| ACTION_UNITS[*unit]);
        let turning: Vec<ActionUnit> = units.filter(ActionUnit::turns_eyes).collect();
        let Some(unit) = turning.first() else {
            continue;
        };
        let [start_s, end_s] = event.slot_s;
        for (t, share) in event.shares(gaze.dim().0, fps, edges_of(unit, onset)) {
            let share = smooth(share);
            let gone = (t as f64 / fps - start_s) / (end_s - start_s);
            let turns = turning
                .iter()
                .map(|unit| unit.gaze_at(gone.clamp(0.0, 1.0) as f32));
            let to = turns.fold([0.0; 2], |sum: [f32; 2], turn| {
                [0, 1].map(|axis| sum[axis] + event.strength * turn[axis])
            });
            for mut angles in gaze.index_axis_mut(Axis(0), t).outer_iter_mut() {
                for (angle, to) in angles.iter_mut().zip(to) {
                    *angle += share * (to - *angle);
                }
            }
        }
    }
}

/// How long a unit takes to come and to go, seconds. `onset`: as in [`EventTrack::of`].
fn edges_of(unit: &ActionUnit, onset: f64) -> [f64; 2] {
    let rise_s = onset * unit.onset_s;
    [rise_s, OFFSET_OVER_ONSET * rise_s]
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
        let track = EventTrack::of(&events, &shapes, (25, 25.0), EDGE_S, 1.0);
        let at = |name: &str| ARKIT.iter().position(|known| *known == name).unwrap();
        let wink = track.mask.column(at("eyeBlinkLeft")).to_vec();
        assert_eq!(wink[6..11], [0.0, 0.125, 0.25, 0.375, 0.5]);
        let slot = EventTrack::of(&events, &shapes, (25, 25.0), 0.0, 1.0).mask;
        let wink = slot.column(at("eyeBlinkLeft")).to_vec();
        assert_eq!(wink[8..12], [0.0, 0.0, 0.5, 0.5]);
        assert_eq!(wink[18..22], [0.5, 0.5, 0.0, 0.0]);
        assert_eq!(track.mask.column(at("eyeBlinkRight")).sum(), 0.0);
        assert_eq!(track.mask[[24, at("browInnerUp")]], 1.0);
        assert_eq!((track.active[[20, 0]], track.active[[20, 16]]), (1.0, 1.0));
        assert_eq!(track.active.sum(), 2.0 * 10.0 + 2.0 * 10.0);
        for never in ["1e300-2e300:1", "1.2-2:1"] {
            let never = [Event::parse(never).unwrap()];
            let track = EventTrack::of(&never, &shapes, (25, 25.0), EDGE_S, 1.0);
            assert_eq!((track.active.sum(), track.mask.sum()), (0.0, 0.0));
        }
        let soon = [Event::parse("1.04-2:1").unwrap()];
        let mask = EventTrack::of(&soon, &shapes, (25, 25.0), EDGE_S, 1.0).mask;
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
        let track = EventTrack::of(&events, &shapes, (25, 25.0), EDGE_S, 0.2);
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
        turn_eyes(&events, &mut gaze, 25.0, 1.0);
        assert_eq!(
            gaze[[12, 0, 1]],
            ACTION_UNITS[ActionUnit::find("63").unwrap()].gaze[1]
        );
        assert_eq!((gaze[[12, 1, 0]], gaze[[2, 0, 1]]), (0.0, 0.1));
    }
}
