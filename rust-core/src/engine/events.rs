//! Says in words which parts of a performance's events cannot be seen.

use super::{Engine, Performance};
use crate::{
    Result,
    conditions::{ACTION_UNITS, ActionUnit, Event, Side},
    face::{Face, Rig, ShapeReport},
    job::ProgressFn,
    rig::ShapeSource,
};

impl Performance {
    /// Says which parts of its events cannot be seen; see [`Engine::unseen_events`].
    ///
    /// # Errors
    /// Those of [`Engine::rig`].
    pub fn unseen_events(
        &self,
        engine: &Engine,
        face: &Face,
        progress: ProgressFn<'_>,
    ) -> Result<Vec<String>> {
        engine.unseen_events(face, &self.request.events, self.heard.duration_s, progress)
    }
}

impl Engine {
    /// Sentences about the parts of the events that nobody will see. There is one for every event
    /// after the end of the sound at `end_s`, and one for every unit that this face cannot show,
    /// because it has no brows, its lips are one surface or it lacks that eye.
    ///
    /// # Errors
    /// Those of [`Engine::rig`].
    pub fn unseen_events(
        &self,
        face: &Face,
        events: &[Event],
        end_s: f64,
        progress: ProgressFn<'_>,
    ) -> Result<Vec<String>> {
        if events.is_empty() {
            return Ok(Vec::new());
        }
        let rig = self.rig(face, ShapeSource::Network, progress)?;
        let sentences = events.iter().enumerate().map(|(n, event)| {
            let [start, end] = event.slot_s;
            let name = format!("event {} ({start} to {end} s)", n + 1);
            let late = (start >= end_s)
                .then(|| format!("{name} lies behind the end of the sound ({end_s:.2} s)"));
            let unseen = hidden_units(&rig, event)
                .map(move |unit| format!("{name}: this face cannot show {unit}"));
            late.into_iter().chain(unseen).collect::<Vec<_>>()
        });
        Ok(sentences.flatten().collect())
    }
}

/// Names of an event's units whose shapes all move nothing.
fn hidden_units<'a>(rig: &'a Rig, event: &'a Event) -> impl Iterator<Item = String> + 'a {
    let is_hidden = |unit: &ActionUnit, side: Side| {
        let shows_unit = |report: &&ShapeReport| unit.shows(side, &report.name);
        let mut shapes = rig.reports.iter().filter(shows_unit);
        shapes.all(|report| !report.present)
    };
    let named = event
        .units
        .iter()
        .map(|&(unit, side)| (&ACTION_UNITS[unit], side));
    named
        .filter(move |(unit, side)| is_hidden(unit, *side))
        .map(|(unit, _)| format!("unit {}, {}", unit.name, unit.label))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::ARKIT;

    #[test]
    fn units_are_hidden_where_none_of_their_shapes_moves() {
        let report = |name: &str| ShapeReport {
            name: name.into(),
            largest: 0.0,
            largest_mm: 0.0,
            present: !name.starts_with("brow") && name != "eyeBlinkLeft",
            note: None,
        };
        let rig = Rig {
            names: ARKIT.map(str::to_owned).to_vec(),
            deltas: ndarray::Array3::zeros((52, 1, 3)),
            reports: ARKIT.map(report).to_vec(),
        };
        let hidden = |text: &str| {
            let event = Event::parse(text).unwrap();
            hidden_units(&rig, &event).collect::<Vec<_>>()
        };
        assert_eq!(
            hidden("0-1:1,2"),
            ["unit 1, inner brow raiser", "unit 2, outer brow raiser"]
        );
        assert_eq!(hidden("0-1:45L"), ["unit 45, blink"]);
        assert!(hidden("0-1:45,45R,12").is_empty());
    }
}
