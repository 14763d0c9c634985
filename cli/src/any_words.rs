//! Turns any bytes into a command line, for fuzzers and tests. It may hold any option with any
//! value, and names files of one folder.

use std::{
    any::TypeId,
    ffi::OsString,
    fs,
    path::{Path, PathBuf},
};

use clap::{Arg, ArgAction, Command, CommandFactory, FromArgMatches};

use crate::{
    Arguments,
    console::Console,
    paths::{CachePath, InputPath, OutputPath},
};

/// The most options that bytes choose for a command line.
const MAX_OPTIONS: usize = 16;
/// A byte below this chooses one of the values that mean something to some option. Any other byte
/// starts free text.
const KNOWN: u8 = 192;
const LONGEST: usize = 48;
const VALUES: [&str; 44] = [
    "",
    "0",
    "1",
    "-1",
    "2",
    "0.5",
    "1.5",
    "-0",
    "30",
    "24",
    "1e39",
    "-1e39",
    "nan",
    "inf",
    "-inf",
    "18446744073709551615",
    "18446744073709551616",
    "999999999",
    "1e-300",
    "off",
    "auto",
    "happy:0.7",
    "sad:1,angry:nan",
    "0:sad:1",
    "0:sad:1;0:happy:1",
    "1.2-2.0",
    "0-0.05",
    "2-1",
    "7,12,0.3",
    "7,12,nan",
    "face-width=1.5",
    "face-width=nan",
    "3=jaw",
    "4294967296=jaw",
    "low=skull",
    "=",
    "1.2-2.0:12,6:0.8",
    "2.4-2.8:left wink",
    "smile",
    "x",
    "-z",
    "freetalk",
    "cafe-talk",
    "emoface",
];

/// Runs the command that `bytes` describe, with a folder of models that cannot be loaded. The
/// command goes through all checks, reads its files, and stops before the slow work. Returns the
/// message of its error, or `None` if it succeeds.
///
/// The first byte chooses the subcommand. Then one byte chooses each option, and a second one its
/// value if it takes one. Free text needs another byte for its length, and its own bytes. `folder`
/// has the subfolders `in` for files to read, `out` for results, and `models`.
pub fn run(bytes: &[u8], folder: &Path) -> Option<String> {
    let words = words(bytes, folder);
    let matches = match Arguments::command().try_get_matches_from(words) {
        Ok(matches) => matches,
        Err(error) => return Some(error.render().to_string()),
    };
    let arguments = match Arguments::from_arg_matches(&matches) {
        Ok(arguments) => arguments,
        Err(error) => return Some(error.render().to_string()),
    };
    let console = Console::new(arguments.shared.json);
    let files = arguments.files(&matches);
    let error = arguments.job(&files, || false, &console).err()?;
    assert!(error.exit_code() > 2, "{error}");
    Some(error.to_string())
}

/// The words that `bytes` describe.
#[must_use]
pub fn words(bytes: &[u8], folder: &Path) -> Vec<OsString> {
    let mut bytes = bytes.iter().copied();
    let mut command = Arguments::command();
    command.build();
    let has_options = |command: &&Command| command.get_name() != "help";
    let subcommands: Vec<&Command> = command.get_subcommands().filter(has_options).collect();
    let choice = usize::from(bytes.next().unwrap_or_default());
    let subcommand = subcommands[choice % subcommands.len()];
    let places = Places::of(folder);
    let mut words: Vec<OsString> = vec!["anyface".into(), subcommand.get_name().into()];
    // The models are always those of the folder. `help` and `version` would only print and end.
    let of_ours = |arg: &&Arg| !["weights", "help", "version"].contains(&arg.get_id().as_str());
    let options: Vec<&Arg> = subcommand.get_arguments().filter(of_ours).collect();
    let mut named = Vec::new();
    while let Some(choice) = bytes.next().filter(|_| named.len() < MAX_OPTIONS) {
        let option = options[usize::from(choice) % options.len()];
        words.push(word(option, &mut bytes, &places));
        named.push(option.get_id());
    }
    // Without the required options the parser would refuse the command before anything else is
    // checked.
    for option in options.iter().filter(|option| option.is_required_set()) {
        if !named.contains(&option.get_id()) {
            words.push(word(option, &mut [0, 0].into_iter(), &places));
        }
    }
    words.push(joined("weights", folder.join("models").into()));
    words
}

fn word(option: &Arg, bytes: &mut impl Iterator<Item = u8>, places: &Places) -> OsString {
    let takes_value = matches!(option.get_action(), ArgAction::Set | ArgAction::Append);
    let value = takes_value.then(|| value(option, bytes, places));
    match (option.get_long(), value) {
        (Some(name), Some(value)) => joined(name, value),
        (Some(name), None) => format!("--{name}").into(),
        (None, value) => value.unwrap_or_default(),
    }
}

fn joined(name: &str, value: OsString) -> OsString {
    let mut word: OsString = format!("--{name}=").into();
    word.push(value);
    word
}

fn value(option: &Arg, bytes: &mut impl Iterator<Item = u8>, places: &Places) -> OsString {
    let choice = bytes.next().unwrap_or_default();
    let kind = option.get_value_parser().type_id();
    if kind == TypeId::of::<InputPath>() {
        return places.input(option.get_id().as_str(), choice);
    }
    if kind == TypeId::of::<OutputPath>() {
        return places.output(choice);
    }
    if kind == TypeId::of::<CachePath>() {
        return places.folder.join("cache").into();
    }
    if choice >= KNOWN {
        let length = usize::from(bytes.next().unwrap_or_default()) % LONGEST;
        return text(bytes.take(length).filter(|byte| *byte != 0).collect());
    }
    let choices = option.get_possible_values();
    let choices = choices.iter().map(|value| value.get_name().to_owned());
    let known: Vec<String> = choices.chain(VALUES.map(str::to_owned)).collect();
    known[usize::from(choice) % known.len()].clone().into()
}

#[cfg(unix)]
fn text(bytes: Vec<u8>) -> OsString {
    use std::os::unix::ffi::OsStringExt;

    // The bytes need not be valid UTF-8.
    OsString::from_vec(bytes)
}

#[cfg(not(unix))]
fn text(bytes: Vec<u8>) -> OsString {
    String::from_utf8_lossy(&bytes).into_owned().into()
}

/// Files that options may name. All of them lie in the folder.
struct Places {
    folder: PathBuf,
    inputs: Vec<PathBuf>,
}

impl Places {
    fn of(folder: &Path) -> Places {
        let entries = fs::read_dir(folder.join("in"))
            .into_iter()
            .flatten()
            .flatten();
        let mut inputs: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        inputs.sort();
        inputs.push(folder.join("gone.npz"));
        inputs.push(folder.join("in"));
        Places {
            folder: folder.to_owned(),
            inputs,
        }
    }

    /// The file named after the option, if there is one and `choice` is even. Otherwise any of the
    /// files.
    fn input(&self, option: &str, choice: u8) -> OsString {
        let is_meant = |path: &&PathBuf| path.file_stem().is_some_and(|stem| stem == option);
        let meant = self
            .inputs
            .iter()
            .find(is_meant)
            .filter(|_| choice.is_multiple_of(2));
        let any = &self.inputs[usize::from(choice / 2) % self.inputs.len()];
        meant.unwrap_or(any).into()
    }

    fn output(&self, choice: u8) -> OsString {
        const ENDINGS: [&str; 12] = [
            "npz", "pc2", "mdd", "csv", "json", "obj", "TextGrid", "tsv", "pgo", "dat", "txt",
            "odd",
        ];
        let out = self.folder.join("out");
        match choice {
            240..=255 => self.input("out", choice),
            230..240 => out.join("new").into(),
            220..230 => out.join("gone").join("deep.npz").into(),
            _ => {
                let ending = ENDINGS[usize::from(choice) % ENDINGS.len()];
                out.join(format!(
                    "o{}.{ending}",
                    usize::from(choice) / ENDINGS.len() % 3
                ))
                .into()
            }
        }
    }
}
