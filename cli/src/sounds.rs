//! `anyface sounds`: what is heard, as a file that can be mended, or one such file as another.

use anyface::{
    Result,
    annotation::{Annotation, AnnotationFormat, Symbols},
    job::{InputKind, read_text},
    motion::check_fps,
};
use clap::Args;

use crate::{
    arguments::{SharedArgs, SoundArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath},
    stages::{new_report, read_sound},
};

/// Write where the lips are heard to be together (p, b, m), to be mended and given to `animate --sounds`;
/// with --phones or a text also which phones are heard, and when the words of the text are said
#[derive(Args)]
pub struct Sounds {
    /// The speech: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF
    #[arg(long, value_name = "A", required_unless_present = "sounds")]
    audio: Option<InputPath>,
    /// Turn this file of times into another kind instead of listening
    #[arg(long, value_name = "S", conflicts_with = "audio")]
    sounds: Option<InputPath>,
    /// Write the phones that are heard, too (IPA)
    #[arg(long, conflicts_with = "sounds")]
    phones: bool,
    /// The words that are said: written with their times, and with the phones in them
    #[arg(long, value_name = "W", conflicts_with_all = ["sounds", "text_file"])]
    text: Option<String>,
    /// The same from a file in UTF-8
    #[arg(long, value_name = "F", conflicts_with = "sounds")]
    text_file: Option<InputPath>,
    /// The result: .TextGrid (Praat), .tsv or .json (Rhubarb), .pgo (Papagayo), .dat (Moho) or .txt
    /// (lines of start, end and label)
    #[arg(long, value_name = "O")]
    out: OutputPath,
    #[command(flatten)]
    sound: SoundArgs,
    /// Frames per second that .pgo and .dat count
    #[arg(long, default_value_t = 24.0)]
    fps: f64,
}

impl Sounds {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        AnnotationFormat::from_path(&self.out)?;
        check_fps(self.fps)?;
        let mut report = new_report();
        let found = match (&self.sounds, &self.audio) {
            (Some(path), _) => Annotation::read(path, self.fps)?,
            (None, path) => {
                let path = path.as_deref().unwrap_or(&self.out);
                let text = self.spoken()?;
                let progress = &|p| console.progress(p);
                let sound = read_sound(&mut report, path, &self.sound, progress)?;
                let engine = shared.engine()?;
                let waveform = sound.whole(progress)?;
                match self.asks_for_phones() {
                    true => engine.listen_to_phones(&waveform, text.as_deref())?,
                    false => engine.listen(&waveform)?,
                }
            }
        };
        found.write(&self.out, self.fps)?;
        let intervals: usize = found.tiers.iter().map(|tier| tier.intervals.len()).sum();
        let out = shown(&self.out);
        let text = format!("wrote {out}: {intervals} intervals");
        let mut value = serde_json::json!({
            "out": out,
            "intervals": intervals,
            "duration_s": found.duration_s,
            "closures": found.closures().unwrap_or_default(),
            "warnings": report.warnings,
        });
        if self.asks_for_phones() {
            for symbols in [Symbols::Phones, Symbols::Words] {
                let rows = found.intervals(symbols).iter();
                value[symbols.name()] = rows
                    .map(|i| serde_json::json!([i.start_s, i.end_s, i.label]))
                    .collect();
            }
        }
        console.value(&value, &text)?;
        console.warn(&report.warnings);
        Ok(())
    }

    fn asks_for_phones(&self) -> bool {
        self.phones || self.text.is_some() || self.text_file.is_some()
    }

    /// The text that is said in the sound.
    fn spoken(&self) -> Result<Option<String>> {
        let Some(path) = &self.text_file else {
            return Ok(self.text.clone());
        };
        let text = read_text(path, InputKind::Text)?;
        Ok(Some(text.trim_start_matches('\u{FEFF}').to_owned()))
    }
}
