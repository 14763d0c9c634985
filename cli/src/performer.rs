//! `anyface performer`: one person's own mouth, learned from a few seconds of that person's face.

use anyface::{
    Error, Result,
    motion::performer::{AspectScore, PerformerCard},
};
use clap::{Args, Subcommand};

use crate::{
    arguments::{SharedArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath},
};

/// Learn how one person speaks, so that every face speaks as that person does
#[derive(Subcommand)]
pub enum Performer {
    Learn(Learn),
}

/// Learn a performer from sounds and the motion of the face that spoke them, about fifteen seconds or more in all
#[derive(Args)]
pub struct Learn {
    /// A sound. May be repeated, with a motion for each
    #[arg(long, value_name = "A", required = true)]
    audio: Vec<InputPath>,
    /// How the face moved from the start of the sound on: .csv of Live Link Face, or .npz with landmark_displacements or
    /// weights, as `anyface motion` writes them
    #[arg(long, value_name = "M", required = true)]
    motion: Vec<InputPath>,
    /// The performer, for `--performer` of other commands
    #[arg(long, value_name = "P.performer")]
    out: OutputPath,
}

impl Performer {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        match self {
            Performer::Learn(command) => command.run(shared, console),
        }
    }
}

impl Learn {
    fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        if self.audio.len() != self.motion.len() {
            return Err(Error::InvalidInput(format!(
                "--motion: expected one for each of {} sounds, in the same order, got {}",
                self.audio.len(),
                self.motion.len()
            )));
        }
        let engine = shared.engine()?;
        let mut takes = Vec::new();
        for (audio, motion) in self.audio.iter().zip(&self.motion) {
            takes.push(engine.captured_take(audio, motion)?);
        }
        let performer = engine.learn_performer(&takes, &|p| console.progress(p))?;
        performer.write(&self.out)?;
        let card = performer.card();
        console.value(card, &summary(card, &shown(&self.out)))
    }
}

fn summary(card: &PerformerCard, out: &str) -> String {
    let seconds: f64 = card.takes.iter().map(|take| take.seconds).sum();
    let mut lines = vec![format!("{out}: learned from {seconds:.1} s")];
    let late = card.takes.iter().filter(|take| take.lag_s != 0.0);
    lines.extend(late.map(|take| {
        format!(
            "{}: {:.2} s behind its sound, taken off",
            take.name, take.lag_s
        )
    }));
    lines.push("on parts left out, correlation and slope, and what they are without:".to_owned());
    lines.extend(card.scores.iter().map(line));
    lines.join("\n")
}

fn line(score: &AspectScore) -> String {
    let AspectScore {
        name,
        r,
        slope,
        r_without,
        slope_without,
    } = score;
    format!("  {name:<10} {r:.2} {slope:.2}  ({r_without:.2} {slope_without:.2})")
}
