//! `anyface sounds`: writes the sounds heard in speech to a file that people can correct.
//!
//! It also converts one such file to another.

use anyface::{
    Result,
    annotation::{Annotation, AnnotationFormat, Symbols},
    motion::check_fps,
};
use clap::Args;

use crate::{
    arguments::{SharedArgs, SoundArgs, read_words, shown},
    console::Console,
    paths::{InputPath, OutputPath},
    stages::{new_report, read_sound},
};

/// Write the times at which the speech closes the lips (p, b, m). Correct the file and pass it to
/// `animate --sounds`. With --phones or a text, the file also has the phones that are heard and the times of
/// the text's words
#[derive(Args)]
pub struct Sounds {
    /// The speech: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF
    #[arg(long, value_name = "A", required_unless_present = "sounds")]
    audio: Option<InputPath>,
    /// Convert this file of times to another format instead of listening to speech
    #[arg(long, value_name = "S", conflicts_with = "audio")]
    sounds: Option<InputPath>,
    /// Also write the phones that are heard (IPA)
    #[arg(long, conflicts_with = "sounds")]
    phones: bool,
    /// The words that are spoken. The result gets their times and phones
    #[arg(long, value_name = "W", conflicts_with_all = ["sounds", "text_file"])]
    text: Option<String>,
    /// Read the spoken words from this UTF-8 file instead
    #[arg(long, value_name = "F", conflicts_with = "sounds")]
    text_file: Option<InputPath>,
    /// The result: .TextGrid (Praat), .tsv or .json (Rhubarb), .pgo (Papagayo), .dat (Moho) or .txt
    /// (lines of start, end and label)
    #[arg(long, value_name = "O")]
    out: OutputPath,
    #[command(flatten)]
    sound: SoundArgs,
    /// Frames per second of .pgo and .dat files
    #[arg(long, default_value_t = 24.0)]
    fps: f64,
}

impl Sounds {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        AnnotationFormat::writable(&self.out)?;
        check_fps(self.fps)?;
        let mut report = new_report();
        let annotation = match (&self.sounds, &self.audio) {
            (Some(path), _) => Annotation::read(path, self.fps)?,
            (None, path) => {
                let path = path.as_deref().unwrap_or(&self.out);
                let words = read_words(self.text_file.as_ref())?;
                let text = self.text.clone().or(words);
                let progress = &|p| console.progress(p);
                let sound = read_sound(&mut report, path, &self.sound, progress)?;
                let engine = shared.engine()?;
                let waveform = sound.whole(progress)?;
                if self.asks_for_phones() {
                    engine.listen_to_phones(&waveform, text.as_deref())?
                } else {
                    engine.listen(&waveform)?
                }
            }
        };
        annotation.write(&self.out, self.fps)?;
        let intervals: usize = annotation
            .tiers
            .iter()
            .map(|tier| tier.intervals.len())
            .sum();
        let out = shown(&self.out);
        let text = format!("wrote {out}: {intervals} intervals");
        let mut value = serde_json::json!({
            "out": out,
            "intervals": intervals,
            "duration_s": annotation.duration_s,
            "closures": annotation.closures().unwrap_or_default(),
            "warnings": report.warnings,
        });
        if self.asks_for_phones() {
            for symbols in [Symbols::Phones, Symbols::Words] {
                let rows = annotation.intervals(symbols).iter();
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
}
