//! The `anyface-eval` command: measures the quality of Anyface's animation and what it costs.
//!
//! Results go to standard output, progress and errors to standard error. Exit codes are those of
//! the `anyface` command: 0 done, 2 usage, otherwise [`anyface::Error::exit_code`].

mod arguments;
mod bench;
mod console;
mod creatures;
mod face_model;
mod field;
mod gallery;
mod lids;
mod live;
mod metrics;
mod mouths;
mod pictures;
mod quality;
mod sounds;
mod stopwatch;
mod template;
mod tensors;
mod turned;
mod vertex_motion;

use std::process::ExitCode;

use anyface::Result;
use clap::{Parser, Subcommand};

use arguments::SharedArgs;
use console::Console;

/// Measures Anyface: quality against recordings, pictures of meshes, time of every stage.
#[derive(Parser)]
#[command(name = "anyface-eval", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    shared: SharedArgs,
}

#[derive(Subcommand)]
enum Command {
    Quality(quality::Quality),
    Gallery(gallery::Gallery),
    Bench(bench::Bench),
    Creatures(creatures::Creatures),
    Field(field::Field),
    Lids(lids::Lids),
    Live(live::Live),
    Mouths(mouths::Mouths),
    Sounds(sounds::Sounds),
    Template(template::Template),
    Turned(turned::Turned),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match arguments.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

impl Arguments {
    fn run(&self) -> Result<()> {
        self.shared.set_threads()?;
        let console = Console::new(self.shared.json);
        match &self.command {
            Command::Quality(command) => command.run(&self.shared, &console),
            Command::Gallery(command) => command.run(&self.shared, &console),
            Command::Bench(command) => command.run(&self.shared, &console),
            Command::Lids(command) => command.run(&self.shared, &console),
            Command::Live(command) => command.run(&self.shared, &console),
            Command::Mouths(command) => command.run(&self.shared, &console),
            Command::Sounds(command) => command.run(&self.shared, &console),
            Command::Creatures(command) => command.run(&self.shared, &console),
            Command::Field(command) => command.run(&self.shared, &console),
            Command::Template(command) => command.run(&self.shared, &console),
            Command::Turned(command) => command.run(&self.shared, &console),
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
    fn the_documented_command_line_is_accepted() {
        for line in [
            "anyface-eval quality --data D --limit 3 --json",
            "anyface-eval field --data D --heads 2",
            "anyface-eval template --data D --heads 2",
            "anyface-eval quality --aligned A --also B --report R.md --long",
            "anyface-eval quality --data D --weights W --quick --also B --beside cafe-talk --beside emoface",
            "anyface-eval quality --data D --aligned A --only closures",
            "anyface-eval quality --data D --system cafe-talk --only events",
            "anyface-eval creatures --only fish --pictures P --write W",
            "anyface-eval mouths --also D --pictures P",
            "anyface-eval live --data D --hours 10",
            "anyface-eval lids --also D --made 2 --strength 1",
            "anyface-eval turned --also D --made 2 --rotations 200 --first 7 --only cat",
            "anyface-eval gallery --out G.md --no-cache",
            "anyface-eval bench --mesh M.obj --no-proxy --runs 2 --json",
            "anyface-eval bench --mesh M.obj --triangulations",
        ] {
            if let Err(error) = Arguments::try_parse_from(line.split_whitespace()) {
                panic!("{line}: {error}");
            }
        }
    }
}
