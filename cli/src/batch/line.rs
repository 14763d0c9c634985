//! One line of speech: its options, and the kinds of result that it can have.

use std::path::Path;

use anyface::{
    Error, Result,
    motion::MotionKind,
    output::{Format, check_motion_path},
    systems::Registration,
};
use clap::{Args, Parser};

use crate::{
    arguments::{FaceArgs, MotionArgs, SharedArgs, SoundArgs},
    paths::{InputPath, OutputPath},
    scene::SceneArgs,
};

/// One line of speech, with the options of its row and those for all rows.
#[derive(Parser)]
#[command(name = "anyface batch", no_binary_name = true)]
pub struct Line {
    /// The speech
    #[arg(long, value_name = "A")]
    pub audio: InputPath,
    /// The result
    #[arg(long, value_name = "O")]
    pub out: OutputPath,
    #[command(flatten)]
    pub options: LineOptions,
    #[command(flatten)]
    pub shared: SharedArgs,
}

/// Options that a row may set, and that the command line may set for all rows.
#[derive(Args)]
pub struct LineOptions {
    /// The mesh for all rows that name none: OBJ, PLY or GLB. A row without a mesh becomes landmark
    /// motion (.npz), or weights if its system makes weights
    #[arg(long, value_name = "M")]
    pub mesh: Option<InputPath>,
    #[command(flatten)]
    pub sound: SoundArgs,
    #[command(flatten)]
    pub face: FaceArgs,
    #[command(flatten)]
    pub motion: MotionArgs,
    #[command(flatten)]
    pub scene: SceneArgs,
}

impl Line {
    /// Whether the result is weights of the face's shapes.
    pub fn wants_weights(&self) -> bool {
        self.options.mesh.is_some() && self.is_table()
    }

    /// Whether the result is a table (.csv or .json).
    pub fn is_table(&self) -> bool {
        let out: &Path = &self.out;
        let ending = out.extension().and_then(|ending| ending.to_str());
        let is = |table: &&str| ending.is_some_and(|ending| table.eq_ignore_ascii_case(ending));
        ["csv", "json"].iter().any(is)
    }

    /// Checks that this line can have a result of the kind that its file name asks for.
    ///
    /// # Errors
    /// `InvalidInput` that lists the possible endings.
    pub fn check_out(&self) -> Result<()> {
        let out = &self.out;
        if self.wants_weights() {
            return Ok(());
        }
        if self.options.mesh.is_none() {
            let system = Registration::find(self.shared.system())?;
            let is_weights = system.motion == MotionKind::Weights;
            return check_motion_path(out, is_weights).map_err(|error| {
                Error::InvalidInput(format!("{error}; for weights or vertices name a mesh"))
            });
        }
        self.options.scene.check(out).map_err(|error| match error {
            Error::InvalidInput(message) if Format::from_path(out).is_err() => Error::InvalidInput(
                format!("{message}; or .csv or .json for weights of ARKit's shapes"),
            ),
            other => other,
        })
    }
}
