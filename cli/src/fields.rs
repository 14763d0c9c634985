//! Flags of the fields that one word or one file can give, drawn from the registry.

use std::path::Path;

use anyface::{
    Error, MotionRequest, Result,
    audio::Waveform,
    motion::{Life, Pose},
    output::{read_landmark_motion, read_life},
    systems::{FIELDS, Field, FieldKind, FieldValue, NumberRange, SYSTEMS, set_field},
};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, value_parser};

use crate::paths::InputPath;

/// The fields that a command line sets.
pub struct FieldFlags(Vec<(&'static Field, FlagValue)>);

enum FlagValue {
    Word(String),
    File(InputPath),
}

/// How the flag of a field takes its value. Emotions, events and closures have flags of their own,
/// which say more than one word.
fn argument(field: &'static Field) -> Option<Arg> {
    let arg = Arg::new(field.name).long(field.name.replace('_', "-"));
    let mut help = field.help.trim_end_matches('.').to_owned();
    if let Some(need) = &field.needs {
        let able = SYSTEMS.iter().filter(|system| system.can(need.ability));
        let able: Vec<&str> = able.map(|system| system.name).collect();
        help += &format!(" ({})", able.join(", "));
    }
    match field.kind {
        FieldKind::Number(range) => {
            let NumberRange {
                low, high, default, ..
            } = range;
            let limits = if high < u64::MAX as f64 {
                format!(" ({low} to {high})")
            } else {
                String::new()
            };
            let help = format!("{help}{limits} [default: {default}]");
            let value_name = if range.is_whole { "N" } else { "X" };
            Some(arg.value_name(value_name).value_parser(number).help(help))
        }
        FieldKind::Text => Some(arg.value_name("TEXT").help(help)),
        FieldKind::Sound | FieldKind::Pose | FieldKind::File => {
            let arg = arg
                .value_name("FILE")
                .value_parser(value_parser!(InputPath));
            Some(arg.help(help))
        }
        FieldKind::Emotion | FieldKind::Events | FieldKind::Intervals => None,
    }
}

fn number(text: &str) -> std::result::Result<String, String> {
    match text.parse::<f64>() {
        Ok(_) => Ok(text.to_owned()),
        Err(_) => Err(format!("expected a number, got {text:?}")),
    }
}

impl FieldFlags {
    /// The request of the command line; fields that it does not set have their defaults.
    pub fn request(&self) -> Result<MotionRequest> {
        let mut request = MotionRequest::default();
        for (field, value) in &self.0 {
            match (value, field.kind) {
                (FlagValue::Word(word), _) => {
                    set_field(&mut request, field.name, FieldValue::Text(word))?;
                }
                (FlagValue::File(path), FieldKind::Pose) => {
                    let pose = FieldValue::Pose(Box::new(last_pose(path)?));
                    set_field(&mut request, field.name, pose)?;
                }
                (FlagValue::File(path), FieldKind::File) => {
                    let path = path.to_string_lossy();
                    set_field(&mut request, field.name, FieldValue::Text(&path))?;
                }
                (FlagValue::File(path), _) => {
                    let sound = Waveform::from_file(path)?;
                    set_field(&mut request, field.name, FieldValue::Sound(&sound))?;
                }
            }
        }
        Ok(request)
    }
}

/// The last pose of a motion that `anyface motion` wrote.
fn last_pose(path: &Path) -> Result<Pose> {
    let motion = read_landmark_motion(path)?;
    let wrong = |got: &str| {
        let path = path.display();
        Error::InvalidInput(format!(
            "{path}: expected frames of `anyface motion`, got {got}"
        ))
    };
    if motion.neutral.is_some() {
        return Err(wrong("motion in the units of a mesh"));
    }
    let frames = motion.displacements.outer_iter();
    let last = frames.last().ok_or_else(|| wrong("none"))?;
    let still = || Life::still(motion.displacements.dim().0);
    let life = read_life(path)?.unwrap_or_else(still);
    let tongue = life.tongue.outer_iter().last();
    let tongue = tongue.ok_or_else(|| wrong("no frame of the tongue"))?;
    Ok(Pose::of_frame(last, tongue))
}

impl FromArgMatches for FieldFlags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let value = |field: &'static Field| {
            let value = match field.kind {
                FieldKind::Sound | FieldKind::Pose | FieldKind::File => {
                    FlagValue::File(matches.get_one::<InputPath>(field.name)?.clone())
                }
                _ => FlagValue::Word(matches.get_one::<String>(field.name)?.clone()),
            };
            Some((field, value))
        };
        let fields = FIELDS.iter().filter(|field| argument(field).is_some());
        Ok(FieldFlags(fields.filter_map(value).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Args for FieldFlags {
    fn augment_args(command: Command) -> Command {
        command.args(FIELDS.iter().filter_map(argument))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}
