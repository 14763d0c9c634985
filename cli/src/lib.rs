//! The `anyface` command, one file per subcommand.
//!
//! Exit codes: 0 done, 2 usage, otherwise [`anyface::Error::exit_code`]. Results go to standard output,
//! warnings, progress and errors to standard error; with `--json` both are JSON.
#![deny(unsafe_code)]

mod animate;
pub mod any_words;
mod arguments;
mod batch;
mod chart;
mod console;
mod controls;
mod deform;
mod fields;
mod head;
mod info;
mod landmarks;
mod layers;
mod live;
mod memory;
mod motion;
mod opened;
mod parts;
mod paths;
mod performer;
mod redo;
mod rig;
mod scene;
mod signals;
mod solve;
mod sounds;
mod stages;
mod surface;
mod units;

use std::{path::PathBuf, process::ExitCode};

use anyface::{Error, Result, job::all_or_none};
use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};

use arguments::SharedArgs;
use console::Console;
use opened::Feature;
use paths::Files;

/// Makes any face mesh talk: speech in, facial animation with emotion out, on a plain CPU.
#[derive(Parser)]
#[command(name = "anyface", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    shared: SharedArgs,
}

#[derive(Subcommand)]
enum Command {
    Animate(Box<animate::Animate>),
    Motion(motion::Motion),
    Batch(Box<batch::Batch>),
    Live(Box<live::Live>),
    Deform(deform::Deform),
    Landmarks(landmarks::FindLandmarks),
    /// Part lips that are one surface, and sew the inside of a mouth behind them
    OpenMouth(opened::Open),
    /// Cut free eyes that are one surface with their lids, so that they blink
    OpenEyes(opened::Open),
    Head(head::MakeHead),
    #[command(subcommand)]
    Performer(performer::Performer),
    Rig(rig::MakeRig),
    Solve(solve::Solve),
    Sounds(sounds::Sounds),
    Chart(chart::Chart),
    Parts(parts::ListParts),
    Units(units::Units),
    Info(info::Info),
}

/// Reads the command line, runs the command and returns its exit code.
#[must_use]
pub fn main() -> ExitCode {
    let matches = Arguments::command().try_get_matches();
    let matches = matches.unwrap_or_else(|error| refuse(&error));
    let arguments = Arguments::from_arg_matches(&matches).unwrap_or_else(|error| refuse(&error));
    let console = Console::new(arguments.shared.json);
    console.listen();
    signals::listen();
    memory::guard(arguments.shared.json);
    let files = arguments.files(&matches);
    match arguments.job(&files, signals::are_to_end, &console) {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            console.error(&error);
            ExitCode::from(error.exit_code())
        }
    }
}

/// Ends the command with help, the version, or an error of the command line.
fn refuse(error: &clap::Error) -> ! {
    if error.use_stderr() {
        // It repeats words of the command line, which a script may have taken from anywhere.
        console::print_error_line(&error.to_string().trim_end());
        std::process::exit(error.exit_code());
    }
    error.exit()
}

impl Command {
    /// If no face was found, extends the error with the argument that helps.
    fn with_remedy(&self, error: Error) -> Error {
        let remedy = match self {
            Command::Head(_) => {
                "`anyface landmarks --points` makes all 68 of five, and --like-landmarks reads them"
            }
            _ => "--points takes the five",
        };
        match error {
            Error::FaceNotFound(why) => Error::FaceNotFound(format!("{why}. {remedy}")),
            other => other,
        }
    }
}

impl Arguments {
    /// The files that the command line reads and writes.
    fn files(&self, matches: &ArgMatches) -> Files {
        let mut command = Arguments::command();
        command.build();
        Files::new(&command, matches, self.outputs_beside())
    }

    /// Further results, whose names derive from those of other results.
    fn outputs_beside(&self) -> Vec<PathBuf> {
        match &self.command {
            Command::Animate(command) => command.outputs_beside(&self.shared),
            Command::Head(command) => command.outputs_beside(),
            Command::OpenMouth(command) | Command::OpenEyes(command) => command.outputs_beside(),
            Command::Rig(command) => command.outputs_beside(),
            _ => Vec::new(),
        }
    }

    /// Runs the command and returns its exit code. Either all results are written or none. Only a batch
    /// writes its results one by one.
    fn job(&self, files: &Files, is_cancelled: fn() -> bool, console: &Console) -> Result<u8> {
        files.check(&self.shared.receipts())?;
        for warning in files.link_warnings() {
            console.aside(&format!("warning: {warning}"));
        }
        if let Command::Batch(command) = &self.command {
            self.shared.check()?;
            return command.run(&self.shared, console);
        }
        let run = || {
            let done = self.run(console);
            done.map_err(|error| self.command.with_remedy(error))
        };
        all_or_none(files.inputs(), is_cancelled, run).map(|()| 0)
    }

    fn run(&self, console: &Console) -> Result<()> {
        self.shared.check()?;
        match &self.command {
            Command::Batch(command) => command.run(&self.shared, console).map(drop),
            Command::Animate(command) => command.run(&self.shared, console),
            Command::Motion(command) => command.run(&self.shared, console),
            Command::Live(command) => command.run(&self.shared, console),
            Command::Deform(command) => command.run(&self.shared, console),
            Command::Landmarks(command) => command.run(&self.shared, console),
            Command::OpenMouth(command) => command.run(Feature::Mouth, &self.shared, console),
            Command::OpenEyes(command) => command.run(Feature::Eyes, &self.shared, console),
            Command::Head(command) => command.run(&self.shared, console),
            Command::Performer(command) => command.run(&self.shared, console),
            Command::Rig(command) => command.run(&self.shared, console),
            Command::Solve(command) => command.run(&self.shared, console),
            Command::Sounds(command) => command.run(&self.shared, console),
            Command::Chart(command) => command.run(&self.shared, console),
            Command::Parts(command) => command.run(&self.shared, console),
            Command::Units(command) => command.run(&self.shared, console),
            Command::Info(command) => command.run(&self.shared, console),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn the_stable_command_line_is_accepted() {
        for line in [
            "anyface animate --mesh M.obj --audio A.wav --out O.npz --landmarks L.json \
             --emotion happy:0.7 --fps 30 --seed 0 --steps 4 --threads 2 --report R.json",
            "anyface motion --audio A.wav --out O.npz --emotion sad:1 --fps 25 --seed 3",
            "anyface motion --audio A.wav --out O.npz --emotion-keys 0:sad:1 --articulation 1.2 \
             --jaw 0.5 --rounding 1.2 --width 0.8 --tongue 0.7 --smoothing 0.02 --upper-face 0.5 --blinks 20 \
             --brow-accents 0 --asymmetry -1",
            "anyface motion --audio A.wav --out O.npz --emotion sad:1 --causal",
            "anyface batch L.csv --mesh M.obj --rows 1-500 --map P:\\show=/mnt/show --again --dry-run --threads 2 --emotion auto \
             --fps 60 --blinks 20 --system freetalk --no-cache",
            "anyface live --input A.wav --vmc --live-link 10.0.0.2:11111 --subject S --fps 60 --emotion happy:0.5",
            "anyface live --input - --osc 127.0.0.1:9000 --websocket --vmc 127.0.0.1:39540 --vmc-names vrm",
            "anyface live --input A.wav --fast --json",
            "anyface deform --mesh M.obj --motion L.npz --out O.npz",
            "anyface landmarks --mesh M.obj --out L.json --forward -y --up z",
            "anyface open-mouth --mesh M.obj --out O.obj --landmarks L.json",
            "anyface animate --mesh M.obj --audio A.wav --out O.npz --open-mouth",
            "anyface rig --mesh M.obj --out R.npz --report R.json --landmarks L.json",
            "anyface rig --mesh M.obj --out keys/ --by field --in-betweens",
            "anyface solve --mesh M.obj --animation A.mdd --rig R.npz --out W.csv --fps 60",
            "anyface deform --mesh M.obj --motion L.npz --out O.npz --part 3=jaw --part low=skull",
            "anyface parts --mesh M.obj --landmarks L.json --part 3=jaw --json",
            "anyface sounds --audio A.wav --out A.TextGrid",
            "anyface sounds --sounds A.TextGrid --out A.dat --fps 25",
            "anyface chart --audio A.wav --out C.tsv --fps 24 --on 2 --hold 3 --sounds A.TextGrid",
            "anyface chart --audio A.wav --out C.dat --mouths preston-blair",
            "anyface animate --mesh M.obj --audio A.wav --out O.npz --sounds A.TextGrid",
            "anyface animate --mesh M.obj --audio A.wav --out O.npz --redo 1.2-2.0 --from T.npz --seed 2",
            "anyface motion --audio A.wav --out O.npz --redo 1.2-2.0 --from T.npz --emotion sad:1",
            "anyface head --seed 7 --out H.obj --surface 192 --direction face-width=-1.5",
            "anyface head --mix 7,12,0.3 --out H.obj --skin-only --code-out C.json",
            "anyface head --like S.ply --like-landmarks L.json --out H.obj",
            "anyface animate --mesh M.obj --audio A.wav --system facetalk --surface 256 --out frames/",
            "anyface units smile --json",
            "anyface info --json",
        ] {
            let words = line.split_whitespace();
            if let Err(error) = Arguments::try_parse_from(words) {
                panic!("{line}: {error}");
            }
        }
    }
}
