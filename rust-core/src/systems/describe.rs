//! What a system can be asked for, as JSON: for interfaces that are drawn from it.

use serde_json::{Value, json};

use super::{Ability, FIELDS, Field, Registration, Slider};
use crate::conditions::{ACTION_UNITS, Control, ControlStage, ControlValues, EMOTIONS, MENU};

/// Describes a system as a JSON object.
///
/// - `name`, `label` and `help` of the system.
/// - `abilities`: names of what it can do that others cannot.
/// - `sliders`: names of the aspects of its takes that can be scaled without a new run.
/// - `fields`: [`FIELDS`] that it obeys, each with `name`, `label`, `help` and `kind`; those of the
///   kind `number` also with `low`, `high`, `default` and `is_whole`.
/// - `controls`: each with `name`, `label`, `help`, `unit`, `values` (`real`, `whole` or `choice`),
///   `choices`, `stage` (`face` or `motion`), `low`, `high`, `default`, `neutral` and `animatable`.
/// - `emotions`: names of the emotions, in the order of their strengths.
/// - `units`: action units that events may name, each with `name` and `label`; `words`: words with
///   fixed units.
pub fn describe(system: &Registration) -> String {
    let units = ACTION_UNITS.iter();
    let units = units.map(|unit| json!({"name": unit.name, "label": unit.label}));
    json!({
        "name": system.name,
        "label": system.label,
        "help": system.help,
        "abilities": system.abilities.iter().map(|ability| ability.name()).collect::<Vec<_>>(),
        "sliders": system.sliders.iter().map(|slider| slider.name()).collect::<Vec<_>>(),
        "fields": FIELDS.iter().filter(|field| obeys(system, field)).map(of_field).collect::<Vec<_>>(),
        "controls": system.controls().map(of_control).collect::<Vec<_>>(),
        "emotions": EMOTIONS,
        "units": units.collect::<Vec<_>>(),
        "words": MENU.iter().map(|(word, _)| word).collect::<Vec<_>>(),
    })
    .to_string()
}

fn obeys(system: &Registration, field: &Field) -> bool {
    let needs = field.needs.as_ref();
    needs.is_none_or(|need| system.can(need.ability))
}

fn of_field(field: &Field) -> Value {
    let mut row = json!({
        "name": field.name,
        "label": field.label,
        "help": field.help,
        "kind": field.kind.name(),
    });
    if let Some(range) = field.kind.range() {
        row["low"] = range.low.into();
        row["high"] = range.high.into();
        row["default"] = range.default.into();
        row["is_whole"] = range.is_whole.into();
    }
    row
}

fn of_control(control: &Control) -> Value {
    let (values, choices) = match control.values {
        ControlValues::Real => ("real", &[][..]),
        ControlValues::Whole => ("whole", &[][..]),
        ControlValues::Choice(names) => ("choice", names),
    };
    let stage = match control.stage {
        ControlStage::Face => "face",
        ControlStage::Motion => "motion",
    };
    json!({
        "name": control.name,
        "label": control.label,
        "help": control.help,
        "unit": control.unit,
        "values": values,
        "choices": choices,
        "stage": stage,
        "low": control.low,
        "high": control.high,
        "default": control.default,
        "neutral": control.neutral,
        "animatable": control.is_animatable,
    })
}

impl Ability {
    /// Its name in descriptions.
    pub fn name(self) -> &'static str {
        match self {
            Ability::Events => "events",
            Ability::Words => "words",
            Ability::Emotion => "emotion",
            Ability::FirstPose => "first_pose",
            Ability::Performer => "performer",
            Ability::Head => "head",
        }
    }
}

impl Slider {
    /// Its name in descriptions.
    pub fn name(self) -> &'static str {
        match self {
            Slider::Articulation => "articulation",
            Slider::Emotion => "emotion",
            Slider::Blinks => "blinks",
            Slider::EmotionAndBlinks => "emotion_and_blinks",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::systems::SYSTEMS;

    #[test]
    fn a_description_lists_what_the_system_obeys_and_nothing_else() {
        for system in SYSTEMS {
            let description: Value = serde_json::from_str(&describe(system)).unwrap();
            let names = |key: &str| -> Vec<String> {
                let rows = description[key].as_array().unwrap().iter();
                rows.map(|row| row["name"].as_str().unwrap_or_default().to_owned())
                    .collect()
            };
            assert_eq!(description["name"], system.name);
            assert_eq!(names("controls").len(), system.controls().count());
            let fields = names("fields");
            assert_eq!(
                fields.contains(&"events".to_owned()),
                system.can(Ability::Events)
            );
            assert_eq!(
                fields.contains(&"starts_from".to_owned()),
                system.can(Ability::FirstPose)
            );
            assert!(fields.contains(&"text".to_owned()));
            assert_eq!(
                description["emotions"].as_array().unwrap().len(),
                EMOTIONS.len()
            );
            assert_eq!(names("units")[0], "1");
        }
    }
}
