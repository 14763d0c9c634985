//! Flags for the emotion, and for the controls that the registry lists for all systems.

use std::{collections::BTreeMap, path::Path};

use anyface::{
    Result,
    conditions::{Control, ControlStage, ControlValues, Controls, EmotionCurve},
    motion::WeightStream,
    systems::SYSTEMS,
    text::TextUnits,
};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};

/// Options for the emotion.
#[derive(Args)]
pub struct EmotionArgs {
    /// Emotion and intensity, as in happy:0.7, or a blend, as in happy:0.4,surprised:0.3. auto
    /// takes the emotion that is heard in the voice, auto-arousal only how excited the voice
    /// sounds. off shows speech alone, without blinks and brows. cafe-talk also takes other words,
    /// such as relieved, and uses the nearest emotions
    #[arg(long, default_value = "neutral:0")]
    emotion: String,
    /// Emotion over time as seconds and emotions, as in "0:neutral 2.5:happy:0.8 4:sad:0.5". It changes linearly between them
    #[arg(long, value_name = "KEYS", conflicts_with = "emotion")]
    emotion_keys: Option<String>,
}

impl EmotionArgs {
    /// The requested emotion over time. If the system `takes_words`, the text model of `models` turns words that name no
    /// emotion category into a blend of categories.
    pub fn curve(&self, takes_words: bool, models: Option<&Path>) -> Result<EmotionCurve> {
        // The text model is loaded only when there is such a word.
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
pub struct FaceControls(ControlFlags);
/// Flags of the controls that act on a performance.
pub struct MotionControls(ControlFlags);
/// Flags of the controls that a stream obeys.
pub struct LiveControls(ControlFlags);

/// The controls that the command line sets, each with the text of its value.
#[derive(Default)]
struct ControlFlags(Vec<(&'static Control, String)>);

/// Some of the controls of all systems.
#[derive(Clone, Copy)]
enum Chosen {
    /// Those that act on this stage.
    Of(ControlStage),
    /// Those with these names.
    Named(&'static [&'static str]),
}

/// The chosen controls by flag.
fn flags(chosen: Chosen) -> BTreeMap<String, &'static Control> {
    let all = SYSTEMS.iter().flat_map(|system| system.controls());
    let all = all.filter(|control| match chosen {
        Chosen::Of(stage) => control.stage == stage,
        Chosen::Named(names) => names.contains(&control.name),
    });
    all.map(|control| (control.short_name().replace('_', "-"), control))
        .collect()
}

fn augment(command: Command, chosen: Chosen) -> Command {
    let arguments = flags(chosen).into_iter().map(|(flag, control)| {
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

impl ControlFlags {
    fn read(matches: &ArgMatches, chosen: Chosen) -> ControlFlags {
        let controls = flags(chosen).into_values();
        let set_controls = controls.filter_map(|control| {
            let text = matches.get_one::<String>(control.name)?;
            Some((control, text.clone()))
        });
        ControlFlags(set_controls.collect())
    }

    fn controls(&self) -> Result<Controls> {
        let mut controls = Controls::default();
        for (control, text) in &self.0 {
            controls.set(control.name, control.parse(text)?);
        }
        Ok(controls)
    }
}

/// Implements clap's traits for the chosen flags. Each choice needs a type, because clap flattens flags by type.
macro_rules! control_flags {
    ($name:ident, $chosen:expr) => {
        impl $name {
            pub fn controls(&self) -> Result<Controls> {
                self.0.controls()
            }
        }

        impl FromArgMatches for $name {
            fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
                Ok($name(ControlFlags::read(matches, $chosen)))
            }

            fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
                *self = Self::from_arg_matches(matches)?;
                Ok(())
            }
        }

        impl Args for $name {
            fn augment_args(command: Command) -> Command {
                augment(command, $chosen)
            }

            fn augment_args_for_update(command: Command) -> Command {
                augment(command, $chosen)
            }
        }
    };
}

control_flags!(FaceControls, Chosen::Of(ControlStage::Face));
control_flags!(MotionControls, Chosen::Of(ControlStage::Motion));
control_flags!(LiveControls, Chosen::Named(&WeightStream::CONTROLS));
