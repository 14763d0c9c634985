//! Controls by name: what a system lets its user change, and the values that a user requests.
//!
//! A [`Control`] is written down once, beside the code that obeys it. The command's flags, the C
//! interface and the panel in Blender are drawn from these entries.

use std::collections::BTreeMap;

use crate::{Error, Result};

/// Something that a user may change, with all that an interface needs to show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Control {
    /// Its name in C, in files and in the extension, such as `blinks_per_minute`.
    pub name: &'static str,
    /// Its name for people.
    pub label: &'static str,
    /// One or two sentences of help.
    pub help: &'static str,
    /// The unit of its numbers, with which the name ends: `s`, `per_minute`, or nothing.
    pub unit: &'static str,
    /// What its numbers mean.
    pub values: ControlValues,
    /// The least number.
    pub low: f32,
    /// The largest number.
    pub high: f32,
    /// The number if a user sets none.
    pub default: f32,
    /// The number that leaves the motion as the system made it.
    pub neutral: f32,
    /// The stage that it changes.
    pub stage: ControlStage,
    /// Whether it may follow a curve over time.
    pub is_animatable: bool,
}

/// What the numbers of a control mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControlValues {
    /// Any number of the range.
    Real,
    /// Whole numbers of the range.
    Whole,
    /// The number of one of these names.
    Choice(&'static [&'static str]),
}

/// The stage that a control changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControlStage {
    /// How a face is prepared; read once for a mesh.
    Face,
    /// How the face speaks; read for every performance.
    Motion,
}

/// The number that a control is set to, and how it changes over time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ControlCurve {
    /// The number, which applies at all times if there are no keys.
    pub value: f32,
    /// `(time_s, number)` in rising order; linear in between, held outside. May be empty.
    pub keys: Vec<(f64, f64)>,
}

/// The values that a user sets. All other controls have their defaults.
///
/// ```
/// use anyface::conditions::{ControlCurve, Controls};
///
/// let mut controls = Controls::default();
/// controls.set("blinks_per_minute", 0.0);
/// let keys = vec![(0.0, 0.5), (2.0, 1.5)];
/// controls.set_curve("articulation", ControlCurve { value: 1.0, keys });
/// assert_eq!(controls.animated("articulation").unwrap().at(1.0), 1.0);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Controls(BTreeMap<String, ControlCurve>);

/// Denoising steps; 0 leaves them to the model.
pub static STEPS: Control = Control {
    name: "steps",
    label: "Steps",
    help: "Denoising steps; 0 takes the model's own number.",
    unit: "",
    values: ControlValues::Whole,
    low: 0.0,
    high: 1000.0,
    default: 0.0,
    neutral: 0.0,
    stage: ControlStage::Motion,
    is_animatable: false,
};

/// How much takes with different seeds differ at the start of denoising, relative to the model's
/// measured noise.
pub static NOISE: Control = Control {
    name: "noise",
    label: "Noise",
    help: "How far takes of different seeds begin from each other: 0 gives every seed the same motion, 1 is what was \
           measured, more is livelier and less exact.",
    values: ControlValues::Real,
    high: 2.0,
    default: 1.0,
    neutral: 1.0,
    ..STEPS
};

impl Control {
    /// The name without its unit, as the command's flags have it: `blinks_per_minute` is `blinks`.
    pub fn short_name(&self) -> &'static str {
        let without = self.name.strip_suffix(self.unit);
        without.map_or(self.name, |name| name.trim_end_matches('_'))
    }

    /// Its number in `controls`, without changes over time.
    pub fn value(&self, controls: &Controls) -> f32 {
        let entry = controls.0.get(self.name);
        entry.map_or(self.default, |curve| curve.value)
    }

    /// Reads a number or, for a choice, a name.
    ///
    /// # Errors
    /// `InvalidInput` for text that is neither, or a number out of range.
    pub fn parse(&self, text: &str) -> Result<f32> {
        let value = match self.values {
            ControlValues::Choice(names) => names.iter().position(|name| *name == text),
            _ => None,
        };
        let value = match value {
            Some(number) => number as f32,
            None => text.parse().unwrap_or(f32::NAN),
        };
        self.check(value).map_err(|_| self.wrong(text))?;
        Ok(value)
    }

    fn check(&self, value: f32) -> Result<()> {
        let is_whole = value.fract() == 0.0 || self.values == ControlValues::Real;
        if (self.low..=self.high).contains(&value) && is_whole {
            Ok(())
        } else {
            Err(self.wrong(value))
        }
    }

    fn wrong(&self, got: impl std::fmt::Display) -> Error {
        let (name, low, high) = (self.name, self.low, self.high);
        let expected = match self.values {
            ControlValues::Real => format!("{low} to {high}"),
            ControlValues::Whole => format!("a whole number from {low} to {high}"),
            ControlValues::Choice(names) => format!("one of {}", names.join(", ")),
        };
        Error::InvalidInput(format!("{name}: expected {expected}, got {got}"))
    }
}

impl Controls {
    /// Sets a control for the whole time.
    pub fn set(&mut self, name: &str, value: f32) {
        self.set_curve(
            name,
            ControlCurve {
                value,
                keys: Vec::new(),
            },
        );
    }

    /// Sets a control that changes over time.
    pub fn set_curve(&mut self, name: &str, curve: ControlCurve) {
        self.0.insert(name.to_owned(), curve);
    }

    /// A copy with one control at another number for the whole time.
    #[must_use]
    pub fn with(&self, name: &str, value: f32) -> Controls {
        let mut controls = self.clone();
        controls.set(name, value);
        controls
    }

    /// A copy for a motion that starts at `start_s`: keys come that much earlier.
    #[must_use]
    pub(crate) fn after_second(&self, start_s: f64) -> Controls {
        let mut controls = self.clone();
        let curves = controls.0.values_mut();
        for (time_s, _) in curves.flat_map(|curve| &mut curve.keys) {
            *time_s -= start_s;
        }
        controls
    }

    /// The controls that `known` lists.
    #[must_use]
    pub fn among<'a>(&self, known: impl IntoIterator<Item = &'a Control>) -> Controls {
        let known = known.into_iter().map(|control| control.name);
        let entries = known.filter_map(|name| Some((name.to_owned(), self.0.get(name)?.clone())));
        Controls(entries.collect())
    }

    /// The number that is set for a control, without changes over time.
    pub fn get(&self, name: &str) -> Option<f32> {
        self.0.get(name).map(|curve| curve.value)
    }

    /// Whether any control changes over time.
    pub fn change_over_time(&self) -> bool {
        self.0.values().any(|curve| !curve.keys.is_empty())
    }

    /// The curve of a control that changes over time.
    pub fn animated(&self, name: &str) -> Option<&ControlCurve> {
        self.0.get(name).filter(|curve| !curve.keys.is_empty())
    }

    /// Whether no control changes over time, and each number is its default or its neutral one.
    pub fn ask_nothing<'a>(&self, known: impl IntoIterator<Item = &'a Control>) -> bool {
        known.into_iter().all(|control| {
            let value = control.value(self);
            let is_still = self.animated(control.name).is_none();
            is_still && (value == control.default || value == control.neutral)
        })
    }

    /// Checks that every control is one of `known` that acts on `stage`, with its numbers in range.
    ///
    /// # Errors
    /// `InvalidInput` names the first control that fails, what was expected and what it got.
    pub fn check<'a>(
        &self,
        known: impl IntoIterator<Item = &'a Control>,
        stage: ControlStage,
    ) -> Result<()> {
        let known: Vec<&Control> = known.into_iter().filter(|c| c.stage == stage).collect();
        for (name, curve) in &self.0 {
            let Some(control) = known.iter().find(|control| control.name == name) else {
                let names: Vec<&str> = known.iter().map(|control| control.name).collect();
                return Err(Error::InvalidInput(format!(
                    "control: expected one of {}, got {name:?}",
                    names.join(", ")
                )));
            };
            control.check(curve.value)?;
            curve.check(control)?;
        }
        Ok(())
    }
}

impl ControlCurve {
    fn check(&self, control: &Control) -> Result<()> {
        let wrong = |why: String| Err(Error::InvalidInput(format!("{}: {why}", control.name)));
        if !self.keys.is_empty() && !control.is_animatable {
            return wrong("expected one number for the whole time, got keys".into());
        }
        if let Some((time_s, _)) = self.keys.iter().find(|(time_s, _)| !time_s.is_finite()) {
            return wrong(format!("expected finite times, got {time_s}"));
        }
        if let Some(pair) = self.keys.windows(2).find(|pair| pair[0].0 >= pair[1].0) {
            let (first, second) = (pair[0].0, pair[1].0);
            return wrong(format!(
                "expected rising times, got {first} s before {second} s"
            ));
        }
        let mut values = self.keys.iter().map(|(_, value)| *value as f32);
        values.try_for_each(|value| control.check(value))
    }

    /// The number at `time_s`.
    pub fn at(&self, time_s: f64) -> f64 {
        let after = self.keys.partition_point(|(key_s, _)| *key_s <= time_s);
        let value = |at: usize| self.keys[at].1;
        match (after, self.keys.len()) {
            (_, 0) => f64::from(self.value),
            (0, _) => value(0),
            (after, count) if after == count => value(count - 1),
            (after, _) => {
                let (from_s, to_s) = (self.keys[after - 1].0, self.keys[after].0);
                let slope = (value(after) - value(after - 1)) / (to_s - from_s);
                slope * (time_s - from_s) + value(after - 1)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: Control = Control {
        name: "blinks_per_minute",
        label: "Blinks per Minute",
        help: "How often both eyes blink.",
        unit: "per_minute",
        values: ControlValues::Real,
        low: 0.0,
        high: 60.0,
        default: 15.0,
        neutral: 0.0,
        stage: ControlStage::Motion,
        is_animatable: true,
    };
    const KIND: Control = Control {
        name: "decoder",
        unit: "",
        values: ControlValues::Choice(&["static", "paper"]),
        high: 1.0,
        default: 0.0,
        is_animatable: false,
        ..RATE
    };

    fn message(controls: &Controls) -> String {
        let checked = controls.check(&[RATE, KIND], ControlStage::Motion);
        checked.map_or_else(|error| error.to_string(), |()| String::new())
    }

    #[test]
    fn the_short_name_leaves_the_unit_out() {
        assert_eq!(
            (RATE.short_name(), KIND.short_name()),
            ("blinks", "decoder")
        );
    }

    #[test]
    fn choices_are_read_by_name_and_by_number() {
        assert_eq!(KIND.parse("paper").unwrap(), 1.0);
        assert_eq!(KIND.parse("0").unwrap(), 0.0);
        let wrong = KIND.parse("best").unwrap_err().to_string();
        assert_eq!(wrong, "decoder: expected one of static, paper, got best");
        assert!(KIND.parse("0.5").is_err() && RATE.parse("many").is_err());
    }

    #[test]
    fn unknown_names_numbers_out_of_range_and_falling_times_are_refused() {
        let mut controls = Controls::default();
        assert_eq!(message(&controls), "");
        controls.set("blinks_per_minute", 61.0);
        assert_eq!(
            message(&controls),
            "blinks_per_minute: expected 0 to 60, got 61"
        );
        controls.set("blinks_per_minute", f32::NAN);
        assert!(message(&controls).contains("got NaN"));
        controls.set_curve(
            "blinks_per_minute",
            ControlCurve {
                value: 1.0,
                keys: vec![(1.0, 2.0), (1.0, 3.0)],
            },
        );
        assert!(message(&controls).contains("rising times"));
        let unknown = Controls::default().with("winks", 1.0);
        let expected = "control: expected one of blinks_per_minute, decoder, got \"winks\"";
        assert_eq!(message(&unknown), expected);
        let mut animated = Controls::default();
        animated.set_curve(
            "decoder",
            ControlCurve {
                value: 0.0,
                keys: vec![(0.0, 1.0)],
            },
        );
        assert!(message(&animated).contains("got keys"));
    }

    #[test]
    fn curves_are_linear_between_their_keys_and_held_outside() {
        let curve = ControlCurve {
            value: 9.0,
            keys: vec![(1.0, 2.0), (2.0, 4.0)],
        };
        let at = [0.0, 1.0, 1.5, 2.0, 3.0].map(|time_s| curve.at(time_s));
        assert_eq!(at, [2.0, 2.0, 3.0, 4.0, 4.0]);
        assert_eq!(
            ControlCurve {
                value: 9.0,
                keys: vec![]
            }
            .at(1.0),
            9.0
        );
    }
}
