//! `anyface chart`: turns speech into a mouth chart for drawn animation.

use anyface::{
    Engine, Result,
    annotation::{Annotation, AnnotationFormat, Symbols},
    chart::{ChartOptions, draw},
    mesh::canonical_landmarks,
    speech::Script,
};
use clap::{Args, ValueEnum};

use crate::{
    arguments::{MotionArgs, SharedArgs, SoundArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath},
    stages::{new_report, note_memory, read_sound},
};

/// The mouths that are drawn.
#[derive(Clone, Copy, ValueEnum)]
enum Mouths {
    /// Rhubarb's nine mouths: A to H and X
    Rhubarb,
    /// Preston Blair's ten mouths, with Papagayo's names
    PrestonBlair,
}

/// Write a chart of which drawn mouth (of nine or ten) to show when, for cut-out and drawn
/// animation
#[derive(Args)]
pub struct Chart {
    /// The speech: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF
    #[arg(long, value_name = "A")]
    audio: InputPath,
    /// The result: .tsv or .json (Rhubarb), .pgo (Papagayo), .dat (Moho), .TextGrid (Praat) or .txt (lines of start, end
    /// and label). .tsv and .json hold Rhubarb's mouths, .pgo and .dat Preston Blair's. A mouth that the format does not
    /// have is written as the most similar one
    #[arg(long, value_name = "O")]
    out: OutputPath,
    /// The mouths that are drawn
    #[arg(long, value_enum, default_value_t = Mouths::Rhubarb)]
    mouths: Mouths,
    /// Mouths may change only on every FRAMES-th frame of --fps: 2 for poses on twos
    #[arg(long, value_name = "FRAMES", default_value_t = 1)]
    on: usize,
    /// The fewest frames for which a mouth is shown
    #[arg(long, value_name = "FRAMES", default_value_t = 2)]
    hold: usize,
    /// The fewest frames for which the lips stay closed for p, b and m, instead of --hold
    #[arg(
        long,
        value_name = "FRAMES",
        default_value_t = 0,
        hide_default_value = true
    )]
    hold_closures: usize,
    /// The fewest frames for which the mouth of a vowel is shown, instead of --hold
    #[arg(
        long,
        value_name = "FRAMES",
        default_value_t = 0,
        hide_default_value = true
    )]
    hold_vowels: usize,
    #[command(flatten)]
    sound: SoundArgs,
    #[command(flatten)]
    motion: MotionArgs,
}

impl Chart {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        AnnotationFormat::from_path(&self.out)?;
        let request = self.motion.request(shared)?;
        let mouths = match self.mouths {
            Mouths::Rhubarb => Symbols::Rhubarb,
            Mouths::PrestonBlair => Symbols::Papagayo,
        };
        let options = ChartOptions {
            mouths,
            on: self.on,
            hold: self.hold,
            closure_hold: self.hold_closures,
            vowel_hold: self.hold_vowels,
        };
        options.check()?;
        let mut report = new_report();
        let progress = &|p| console.progress(p);
        let sound = read_sound(&mut report, &self.audio, &self.sound, progress)?;
        let engine: Engine = shared.engine()?;
        note_memory(&mut report, &engine, 0, 0, sound.levels.duration_s())?;
        let waveform = sound.whole(progress)?;
        let sounds = self.motion.read_sounds(request.fps)?;
        let sounds = match (
            sounds.filter(Annotation::shows_mouths),
            request.script.as_deref(),
        ) {
            (Some(sounds), _) => sounds,
            (None, Some(Script::Text(text))) => engine.listen_to_phones(&waveform, Some(text))?,
            (None, _) => engine.listen_to_phones(&waveform, None)?,
        };
        let performance = engine.perform(&waveform, &request, progress)?;
        let landmarks = engine.landmarks_of(&performance.motion)?;
        let moved = landmarks.displacements.view();
        let neutral = canonical_landmarks();
        let chart = draw(neutral, moved, landmarks.fps, Some(&sounds), &options)?;
        chart.write(&self.out, landmarks.fps)?;
        let intervals = chart.intervals(mouths);
        let out = shown(&self.out);
        let value = serde_json::json!({
            "out": out,
            "mouths": intervals.iter().map(|i| serde_json::json!([i.start_s, i.end_s, i.label])).collect::<Vec<_>>(),
            "duration_s": chart.duration_s,
            "fps": landmarks.fps,
            "warnings": report.warnings,
        });
        console.value(&value, &format!("wrote {out}: {} mouths", intervals.len()))?;
        console.warn(&report.warnings);
        Ok(())
    }
}
