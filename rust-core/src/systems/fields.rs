//! Everything that one can ask of a performance, by name.
//!
//! A setting that is no control of a system is written down once, in [`FIELDS`]: how it is called,
//! what it takes, who obeys it and how it enters a [`MotionRequest`]. The C interface sets fields and
//! controls by name, and knows of no single one.

use std::{fmt::Display, path::Path, sync::Arc};

use ndarray::ArrayView2;

use super::{Ability, Registration, SYSTEMS};
use crate::{
    Error, Result,
    audio::Waveform,
    conditions::{Control, ControlCurve, EMOTIONS, Emotion, EmotionCurve},
    motion::{FPS, MotionRequest, Performer, Pose, check_closures, check_fps},
    speech::{Script, VoiceTrack},
    text::Reader,
};

/// 2^53: a double holds every whole number below it.
const MAX_SEED: f64 = 9_007_199_254_740_992.0;

/// A setting of a performance that is no control of a system.
pub struct Field {
    /// The name by which it is set.
    pub name: &'static str,
    /// The name that is shown to people.
    pub label: &'static str,
    /// One or two sentences of help.
    pub help: &'static str,
    /// What it takes.
    pub kind: FieldKind,
    /// What a system needs to obey it; `None` if all do.
    pub needs: Option<Need>,
    set: fn(&mut MotionRequest, &NamedValue<'_>) -> Result<()>,
}

/// What a system needs to obey a field.
pub struct Need {
    /// The ability.
    pub ability: Ability,
    /// The name of the task in the error of a system that lacks the ability.
    task: &'static str,
    /// Whether a request sets the field.
    is_set: fn(&MotionRequest) -> bool,
}

/// What a field takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldKind {
    /// A number, or a text that holds one.
    Number(NumberRange),
    /// A text; an empty one is as if none had been set.
    Text,
    /// A text such as `happy:0.7`, `auto`, `auto-arousal` or `off`, or rows with times: the strength of
    /// each of the [`EMOTIONS`], linear between the rows.
    Emotion,
    /// Rows of two seconds, start and end, without times.
    Intervals,
    /// A text as [`Reader::events`] reads it: JSON, or lines such as `1.2-2.0:smile:0.8`.
    Events,
    /// A sound.
    Sound,
    /// A file, by the text of its path.
    File,
    /// The last frame of a motion.
    Pose,
}

/// The numbers that a field takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NumberRange {
    /// The smallest one.
    pub low: f64,
    /// The largest one.
    pub high: f64,
    /// What a request has if nobody sets it.
    pub default: f64,
    /// Whether it is a whole number.
    pub is_whole: bool,
}

/// A value for a field or for a control.
#[derive(Debug, Clone)]
pub enum FieldValue<'a> {
    /// A number. For a control that is a choice, the number of the chosen name.
    Number(f64),
    /// A text. For a control that is a choice, the chosen name.
    Text(&'a str),
    /// Rows of numbers, and the second of each row if they change over time. For a control that
    /// changes over time, each row holds one number.
    Rows(Option<&'a [f64]>, ArrayView2<'a, f64>),
    /// A sound.
    Sound(&'a Waveform),
    /// A pose.
    Pose(Box<Pose>),
}

/// A value, and the name of its field or control.
pub struct NamedValue<'a> {
    /// The name.
    pub name: &'a str,
    /// The value.
    pub value: FieldValue<'a>,
}

/// All fields, in the order in which a panel shows them.
pub static FIELDS: &[Field] = &[
    Field {
        name: "emotion",
        label: "Emotion",
        help: "What the face feels, and how strongly: named, heard in the voice, or nothing at all.",
        kind: FieldKind::Emotion,
        needs: None,
        set: |request, value| {
            request.emotion = value.emotion()?;
            Ok(())
        },
    },
    Field {
        name: "neutral_voice",
        label: "Neutral Voice",
        help: "A recording in which the same person speaks neutrally, ten seconds or more: the emotion of the voice is \
               then heard as the difference from it.",
        kind: FieldKind::Sound,
        needs: None,
        set: |request, value| {
            request.neutral_voice = Some(Arc::new(VoiceTrack::neutral(value.sound()?)?));
            Ok(())
        },
    },
    Field {
        name: "text",
        label: "Text",
        help: "The words that are spoken. Their places are found in the sound, and the mouth then shows their sounds.",
        kind: FieldKind::Text,
        needs: None,
        set: |request, value| {
            let text = value.text()?;
            request.script = text.map(|text| Arc::new(Script::Text(text.to_owned())));
            Ok(())
        },
    },
    Field {
        name: "closures",
        label: "Closures",
        help: "When the lips are together, instead of where that is heard.",
        kind: FieldKind::Intervals,
        needs: None,
        set: |request, value| {
            let closures = value.intervals()?;
            check_closures(&closures)?;
            request.closures = Some(closures);
            Ok(())
        },
    },
    Field {
        name: "events",
        label: "Events",
        help: "What the face has to do, and when.",
        kind: FieldKind::Events,
        needs: Some(Need {
            ability: Ability::Events,
            task: "events",
            is_set: |request| !request.events.is_empty(),
        }),
        set: |request, value| {
            request.events = match value.text()? {
                Some(text) => Reader::new(None).events(text)?,
                None => Vec::new(),
            };
            Ok(())
        },
    },
    Field {
        name: "emotion_of",
        label: "Emotion of",
        help: "Another recording, whose emotion the face shows, stretched to the length of the sound.",
        kind: FieldKind::Sound,
        needs: Some(Need {
            ability: Ability::Emotion,
            task: "emotion of another recording",
            is_set: |request| request.emotion_of.is_some(),
        }),
        set: |request, value| {
            request.emotion_of = Some(Arc::new(VoiceTrack::checked(value.sound()?)?));
            Ok(())
        },
    },
    Field {
        name: "starts_from",
        label: "Start from",
        help: "The pose in which the face begins: the last frame of a motion.",
        kind: FieldKind::Pose,
        needs: Some(Need {
            ability: Ability::FirstPose,
            task: "first pose",
            is_set: |request| request.starts_from.is_some(),
        }),
        set: |request, value| match &value.value {
            FieldValue::Pose(pose) => {
                request.starts_from = Some(**pose);
                Ok(())
            }
            _ => value.refuse("a motion"),
        },
    },
    Field {
        name: "performer",
        label: "Performer",
        help: "A file of `anyface performer learn`: the mouth then moves as that person's does.",
        kind: FieldKind::File,
        needs: Some(Need {
            ability: Ability::Performer,
            task: "performers",
            is_set: |request| request.performer.is_some(),
        }),
        set: |request, value| {
            let read = |path: &str| Performer::read(Path::new(path)).map(Arc::new);
            request.performer = value.text()?.map(read).transpose()?;
            Ok(())
        },
    },
    Field {
        name: "performer_strength",
        label: "Performer Strength",
        help: "How much of the performer the face shows: 1 is as that person speaks, 0 as without.",
        kind: FieldKind::Number(NumberRange {
            low: 0.0,
            high: 2.0,
            default: 1.0,
            is_whole: false,
        }),
        needs: None,
        set: |request, value| {
            let strength = value.number()?;
            if !(0.0..=2.0).contains(&strength) {
                return value.refuse("0 to 2");
            }
            request.performer_strength = strength as f32;
            Ok(())
        },
    },
    Field {
        name: "style",
        label: "Speaker",
        help: "Name of the speaker whose style the face copies; without one, the model's own.",
        kind: FieldKind::Text,
        needs: None,
        set: |request, value| {
            request.style = value.text()?.map(str::to_owned);
            Ok(())
        },
    },
    Field {
        name: "fps",
        label: "Frame Rate",
        help: "Frames per second of the result.",
        kind: FieldKind::Number(NumberRange {
            low: *FPS.start(),
            high: *FPS.end(),
            default: 30.0,
            is_whole: false,
        }),
        needs: None,
        set: |request, value| {
            let fps = value.number()?;
            check_fps(fps)?;
            request.fps = fps;
            Ok(())
        },
    },
    Field {
        name: "seed",
        label: "Seed",
        help: "The same seed makes the same motion. It decides about blinks, brow accents, head, gaze and variety.",
        kind: FieldKind::Number(NumberRange {
            low: 0.0,
            high: u64::MAX as f64,
            default: 0.0,
            is_whole: true,
        }),
        needs: None,
        set: |request, value| {
            request.seed = value.seed()?;
            Ok(())
        },
    },
];

/// Puts a value into a request: into the field of this name, or into the control that some system
/// has. Whether the system that performs has this control is checked when it performs. An error
/// leaves the request as it was.
///
/// # Errors
/// `InvalidInput` for a name that no field and no control has, for a value of another kind, or for
/// one out of range; the errors of what the field takes, such as `Audio` for a silent sound.
pub fn set_field<'a>(
    request: &mut MotionRequest,
    name: &'a str,
    value: FieldValue<'a>,
) -> Result<()> {
    let value = NamedValue { name, value };
    if let Some(field) = FIELDS.iter().find(|field| field.name == name) {
        return (field.set)(request, &value);
    }
    let mut controls = SYSTEMS.iter().flat_map(|system| system.controls());
    match controls.find(|control| control.name == name) {
        Some(control) => {
            let constant = request.controls.get(name);
            let curve = value.curve(control, constant)?;
            request.controls.set_curve(name, curve);
            Ok(())
        }
        None => {
            let known: Vec<&str> = FIELDS.iter().map(|field| field.name).collect();
            Err(Error::InvalidInput(format!(
                "request: expected one of {} or a control of a system, got {name:?}",
                known.join(", ")
            )))
        }
    }
}

/// Checks that a system obeys every field that a request sets.
///
/// # Errors
/// `InvalidInput`, with the names of the systems that obey it, for the first field that it does not, and for a
/// performer of another system.
pub(crate) fn check_abilities(request: &MotionRequest, system: &Registration) -> Result<()> {
    let needs = FIELDS.iter().filter_map(|field| field.needs.as_ref());
    let mut needs = needs.filter(|need| (need.is_set)(request));
    needs.try_for_each(|need| system.require(need.ability, need.task))?;
    match &request.performer {
        Some(performer) => performer.check_system(system.name),
        None => Ok(()),
    }
}

impl FieldKind {
    /// The numbers that it takes, if it takes numbers.
    pub fn range(self) -> Option<NumberRange> {
        match self {
            FieldKind::Number(range) => Some(range),
            _ => None,
        }
    }

    /// Its name in descriptions.
    pub fn name(self) -> &'static str {
        match self {
            FieldKind::Number(_) => "number",
            FieldKind::Text => "text",
            FieldKind::Emotion => "emotion",
            FieldKind::Intervals => "intervals",
            FieldKind::Events => "events",
            FieldKind::Sound => "sound",
            FieldKind::File => "file",
            FieldKind::Pose => "pose",
        }
    }
}

impl NamedValue<'_> {
    /// The error of a value that is not what its name takes.
    ///
    /// # Errors
    /// Always `InvalidInput`, with what was expected and what arrived.
    pub fn refuse<T>(&self, expected: impl Display) -> Result<T> {
        let got = match &self.value {
            FieldValue::Number(x) => format!("{x}"),
            FieldValue::Text(text) => format!("{text:?}"),
            FieldValue::Rows(Some(_), rows) => format!("rows of {} with times", rows.ncols()),
            FieldValue::Rows(None, rows) => format!("rows of {}", rows.ncols()),
            FieldValue::Sound(_) => "a sound".into(),
            FieldValue::Pose(_) => "a motion".into(),
        };
        Err(Error::InvalidInput(format!(
            "{}: expected {expected}, got {got}",
            self.name
        )))
    }

    /// The value as a number.
    ///
    /// # Errors
    /// `InvalidInput` for anything else.
    pub fn number(&self) -> Result<f64> {
        match self.value {
            FieldValue::Number(x) => Ok(x),
            FieldValue::Text(text) => text.parse().or_else(|_| self.refuse("a number")),
            _ => self.refuse("a number"),
        }
    }

    /// A whole number, or text for those that a double does not hold.
    fn seed(&self) -> Result<u64> {
        match &self.value {
            FieldValue::Number(x) if x.fract() == 0.0 && (0.0..MAX_SEED).contains(x) => {
                Ok(*x as u64)
            }
            FieldValue::Text(text) => text
                .parse()
                .or_else(|_| self.refuse("a whole number of at least 0")),
            _ => self.refuse("a whole number of at least 0 and below 2^53, or a text"),
        }
    }

    /// The value as a text; `None` for an empty one.
    ///
    /// # Errors
    /// `InvalidInput` for anything else.
    pub fn text(&self) -> Result<Option<&str>> {
        match self.value {
            FieldValue::Text(text) => Ok(Some(text).filter(|text| !text.is_empty())),
            _ => self.refuse("a text"),
        }
    }

    fn sound(&self) -> Result<&Waveform> {
        match self.value {
            FieldValue::Sound(sound) => Ok(sound),
            _ => self.refuse("a sound"),
        }
    }

    fn intervals(&self) -> Result<Vec<[f64; 2]>> {
        match &self.value {
            FieldValue::Rows(None, rows) if rows.ncols() == 2 => {
                Ok(rows.outer_iter().map(|row| [row[0], row[1]]).collect())
            }
            _ => self.refuse("rows of two seconds without times"),
        }
    }

    fn emotion(&self) -> Result<EmotionCurve> {
        let count = EMOTIONS.len();
        match &self.value {
            FieldValue::Text(text) => EmotionCurve::parse(text),
            FieldValue::Rows(times_s, rows) if rows.ncols() == count => {
                let emotions = rows
                    .outer_iter()
                    .map(|row| Emotion::from_strengths(std::array::from_fn(|e| row[e] as f32)));
                let emotions = emotions.collect::<Result<Vec<_>>>()?;
                match (*times_s, &emotions[..]) {
                    (_, []) => Ok(EmotionCurve::default()),
                    (None, [only]) => Ok(EmotionCurve::Constant(*only)),
                    (None, _) => self.refuse("one row, or a time for each row"),
                    (Some(times_s), _) => {
                        self.check_rising(times_s)?;
                        let keys = times_s.iter().copied().zip(emotions);
                        Ok(EmotionCurve::Keys(keys.collect()))
                    }
                }
            }
            _ => self.refuse(format_args!(
                "a text such as happy:0.7, or rows of {count} strengths"
            )),
        }
    }

    fn check_rising(&self, times_s: &[f64]) -> Result<()> {
        let finite = times_s.iter().all(|time| time.is_finite());
        if finite && times_s.windows(2).all(|pair| pair[0] < pair[1]) {
            return Ok(());
        }
        Err(Error::InvalidInput(format!(
            "{}: expected finite times, each above the one before, got {times_s:?}",
            self.name
        )))
    }

    /// The curve of a control; `constant` is its number so far, which a curve over time keeps. Ranges
    /// are checked when a system performs.
    fn curve(&self, control: &Control, constant: Option<f32>) -> Result<ControlCurve> {
        match &self.value {
            FieldValue::Number(x) => Ok(ControlCurve {
                value: *x as f32,
                keys: Vec::new(),
            }),
            FieldValue::Text(text) => Ok(ControlCurve {
                value: control.parse(text)?,
                keys: Vec::new(),
            }),
            FieldValue::Rows(Some(times_s), rows) if rows.ncols() == 1 && !times_s.is_empty() => {
                Ok(ControlCurve {
                    value: constant.unwrap_or(rows[[0, 0]] as f32),
                    keys: times_s
                        .iter()
                        .copied()
                        .zip(rows.column(0).iter().copied())
                        .collect(),
                })
            }
            _ => self.refuse("a number, or rows of one number with times"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    fn with<'a>(name: &'a str, value: FieldValue<'a>) -> Result<MotionRequest> {
        let mut request = MotionRequest::default();
        set_field(&mut request, name, value).map(|()| request)
    }

    fn refusal<'a>(name: &'a str, value: FieldValue<'a>) -> String {
        with(name, value).unwrap_err().to_string()
    }

    #[test]
    fn names_are_unique_among_fields_and_controls() {
        let mut names: Vec<&str> = FIELDS.iter().map(|field| field.name).collect();
        let controls = SYSTEMS.iter().flat_map(|system| system.controls());
        assert!(
            controls
                .into_iter()
                .all(|control| !names.contains(&control.name))
        );
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), FIELDS.len());
    }

    #[test]
    fn every_field_refuses_values_of_other_kinds_by_its_name() {
        let rows = Array2::zeros((1, 3));
        for field in FIELDS {
            let message = refusal(field.name, FieldValue::Rows(None, rows.view()));
            let start = format!("{}: expected ", field.name);
            assert!(message.starts_with(&start), "{message}");
        }
    }

    #[test]
    fn a_field_of_numbers_says_its_range_and_default() {
        let nothing = MotionRequest::default();
        let defaults = [
            ("performer_strength", f64::from(nothing.performer_strength)),
            ("fps", nothing.fps),
            ("seed", nothing.seed as f64),
        ];
        let fields = FIELDS.iter();
        let fields = fields.filter_map(|field| Some((field.name, field.kind.range()?.default)));
        assert_eq!(fields.collect::<Vec<_>>(), defaults);
    }

    #[test]
    fn values_reach_the_request() {
        assert_eq!(with("fps", FieldValue::Number(24.0)).unwrap().fps, 24.0);
        assert_eq!(with("fps", FieldValue::Text("24")).unwrap().fps, 24.0);
        assert!(refusal("fps", FieldValue::Text("fast")).contains("a number, got \"fast\""));
        let large = u64::MAX.to_string();
        assert_eq!(
            with("seed", FieldValue::Text(&large)).unwrap().seed,
            u64::MAX
        );
        assert!(refusal("seed", FieldValue::Number(0.5)).contains("a whole number"));
        assert_eq!(with("style", FieldValue::Text("")).unwrap().style, None);
        let closures = array![[0.5, 0.6], [1.0, 1.1]];
        let request = with("closures", FieldValue::Rows(None, closures.view())).unwrap();
        assert_eq!(request.closures.unwrap()[1], [1.0, 1.1]);
        let json = r#"[{"start_s": 1, "end_s": 2, "units": ["12"]}]"#;
        assert_eq!(
            with("events", FieldValue::Text(json)).unwrap().events.len(),
            1
        );
    }

    #[test]
    fn an_emotion_is_a_text_or_rows_over_time() {
        let sad = with("emotion", FieldValue::Text("sad:0.5")).unwrap();
        assert_eq!(sad.emotion, EmotionCurve::parse("sad:0.5").unwrap());
        let off = with("emotion", FieldValue::Text("off")).unwrap();
        assert_eq!(off.emotion, EmotionCurve::Off);
        let mut rows = Array2::zeros((2, EMOTIONS.len()));
        rows[[1, 1]] = 0.5;
        let curve = with("emotion", FieldValue::Rows(Some(&[0.0, 2.0]), rows.view())).unwrap();
        assert!((curve.emotion.at(1.0).intensity - 0.25).abs() < 1e-6);
        let falling = refusal("emotion", FieldValue::Rows(Some(&[2.0, 0.0]), rows.view()));
        assert!(falling.contains("each above the one before"), "{falling}");
        assert!(
            refusal("emotion", FieldValue::Rows(None, rows.view())).contains("a time for each row")
        );
    }

    #[test]
    fn controls_take_numbers_names_and_curves() {
        let request = with("articulation", FieldValue::Number(1.3)).unwrap();
        assert_eq!(request.controls.get("articulation"), Some(1.3));
        let keys = array![[0.5], [1.5]];
        let curve = with(
            "articulation",
            FieldValue::Rows(Some(&[0.0, 2.0]), keys.view()),
        )
        .unwrap();
        assert_eq!(
            curve.controls.animated("articulation").unwrap().at(1.0),
            1.0
        );
        let unknown = refusal("winks", FieldValue::Number(1.0));
        assert!(
            unknown.contains("got \"winks\"") && unknown.contains("emotion_of"),
            "{unknown}"
        );
    }
}
