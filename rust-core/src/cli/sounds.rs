//! `anyface sounds`: what is heard, as a file that can be mended, or one such file as another.

use std::path::PathBuf;

use clap::Args;

use super::{
    arguments::{SharedArgs, shown},
    console::Console,
    stages::{new_report, read_sound},
};
use crate::{
    Result,
    annotation::{Annotation, AnnotationFormat},
    conditions::check_fps,
};

/// Write where the lips are heard to be together (p, b, m), to be mended and given to `animate --sounds`
#[derive(Args)]
pub(super) struct Sounds {
    /// The speech: WAV, MP3, FLAC, Ogg Vorbis, M4A or AIFF
    #[arg(long, value_name = "A", required_unless_present = "sounds")]
    audio: Option<PathBuf>,
    /// Turn this file of times into another kind instead of listening
    #[arg(long, value_name = "S", conflicts_with = "audio")]
    sounds: Option<PathBuf>,
    /// The result: .TextGrid (Praat), .tsv or .json (Rhubarb), .pgo (Papagayo), .dat (Moho) or .txt
    /// (lines of start, end and label)
    #[arg(long, value_name = "O")]
    out: PathBuf,
    /// Frames per second that .pgo and .dat count
    #[arg(long, default_value_t = 24.0)]
    fps: f64,
}

impl Sounds {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        AnnotationFormat::from_path(&self.out)?;
        check_fps(self.fps)?;
        let found = match (&self.sounds, &self.audio) {
            (Some(path), _) => Annotation::read(path, self.fps)?,
            (None, path) => {
                let path = path.as_deref().unwrap_or(&self.out);
                let waveform = read_sound(&mut new_report(), path)?;
                shared.engine()?.listen(&waveform)?
            }
        };
        found.write(&self.out, self.fps)?;
        let intervals: usize = found.tiers.iter().map(|tier| tier.intervals.len()).sum();
        let out = shown(&self.out);
        let text = format!("wrote {out}: {intervals} intervals");
        let value = serde_json::json!({
            "out": out,
            "intervals": intervals,
            "duration_s": found.duration_s,
            "closures": found.closures().unwrap_or_default(),
        });
        console.value(&value, &text);
        Ok(())
    }
}
