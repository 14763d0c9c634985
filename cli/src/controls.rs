//! Flags for the controls of systems, drawn from their registry, and for emotion.

use std::{collections::BTreeMap, path::Path};

use anyface::{
    Result,
    conditions::{Control, ControlStage, ControlValues, Controls, EmotionCurve},
    systems::SYSTEMS,
    text::TextUnits,
};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};

/// What the emotion is.
#[derive(Args)]
pub struct EmotionArgs {
    /// Emotion and intensity: happy:0.7, a blend happy:0.4,surprised:0.3, auto (the emotion
    /// that is heard in the voice), auto-arousal (how excited it sounds, not which emotion it has) or off
    /// (speech alone: no blinks, no brows); cafe-talk
    /// takes other words too, such as relieved, as what lies nearest among the categories
    #[arg(long, default_value = "neutral:0")]
    emotion: String,
    /// Emotion over time: "0:neutral 2.5:happy:0.8 4:sad:0.5", seconds and emotions, linear between
    #[arg(long, value_name = "KEYS", conflicts_with = "emotion")]
    emotion_keys: Option<String>,
}

impl EmotionArgs {
    /// What was asked for; words that are no category through the text space of `models`, for a system that takes
    /// them.
    pub fn curve(&self, takes_words: bool, models: Option<&Path>) -> Result<EmotionCurve> {
        // Loaded for such a word alone.
        let of = |word: &str| TextUnits::open(models)?.emotion(word);
        match (&self.emotion_keys, takes_words) {
            (Some(keys), true) => EmotionCurve::parse_keys_with(keys, &of),
            (Some(keys), false) => EmotionCurve::parse_keys(keys),
            (None, true) => EmotionCurve::parse_with(&self.emotion, &of),
            (None, false) => EmotionCurve::parse(&self.emotion),
        }
    }
}

/// Flags of the controls that act on a face.
pub struct FaceControls(Asked);
/// Flags of the controls that act on a performance.
pub struct MotionControls(Asked);

/// Controls that were asked for, and the words that the user wrote.
#[derive(Default)]
struct Asked(Vec<(&'static Control, String)>);

/// Every control of any system that acts on `stage`, by its flag.
fn flags(stage: ControlStage) -> BTreeMap<String, &'static Control> {
    let all = SYSTEMS.iter().flat_map(|system| system.controls_of(stage));
    all.map(|control| (control.short_name().replace('_', "-"), control))
        .collect()
}

fn augment(command: Command, stage: ControlStage) -> Command {
    let arguments = flags(stage).into_iter().map(|(flag, control)| {
        Arg::new(control.name)
            .long(flag)
            .value_name(value_name(control))
            .allow_hyphen_values(control.low < 0.0)
            .help(help(control))
    });
    command.args(arguments)
}

fn value_name(control: &Control) -> &'static str {
    match (control.values, control.unit) {
        (ControlValues::Choice(_), _) => "NAME",
        (_, "s") => "S",
        (ControlValues::Whole, _) | (_, "per_minute") => "N",
        _ => "X",
    }
}

fn help(control: &Control) -> String {
    let Control {
        help,
        low,
        high,
        default,
        ..
    } = control;
    let (range, default) = match control.values {
        ControlValues::Choice(names) => (names.join(" or "), names[*default as usize].to_owned()),
        _ => (format!("{low} to {high}"), default.to_string()),
    };
    format!(
        "{} ({range}) [default: {default}]",
        help.trim_end_matches('.')
    )
}

impl Asked {
    fn read(matches: &ArgMatches, stage: ControlStage) -> Asked {
        let known = flags(stage).into_values();
        let asked = known.filter_map(|control| {
            let text = matches.get_one::<String>(control.name)?;
            Some((control, text.clone()))
        });
        Asked(asked.collect())
    }

    fn controls(&self) -> Result<Controls> {
        let mut controls = Controls::default();
        for (control, text) in &self.0 {
            controls.set(control.name, control.parse(text)?);
        }
        Ok(controls)
    }
}

/// The same for both stages: clap asks for a type of its own where flags are flattened.
macro_rules! control_flags {
    ($name:ident, $stage:expr) => {
        impl $name {
            pub fn controls(&self) -> Result<Controls> {
                self.0.controls()
            }
        }

        impl FromArgMatches for $name {
            fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
                Ok($name(Asked::read(matches, $stage)))
            }

            fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
                *self = Self::from_arg_matches(matches)?;
                Ok(())
            }
        }

        impl Args for $name {
            fn augment_args(command: Command) -> Command {
                augment(command, $stage)
            }

            fn augment_args_for_update(command: Command) -> Command {
                augment(command, $stage)
            }
        }
    };
}

control_flags!(FaceControls, ControlStage::Face);
control_flags!(MotionControls, ControlStage::Motion);
