//! Measures how a stream responds to sounds other than speech, to speech in noise and at other
//! levels, and to hours of sound.

mod hours;
mod sounds;

use std::{fs, path::Path};

use anyface::{Engine, Result, audio::Waveform};
use clap::Args;

use crate::{
    arguments::{DataArgs, SharedArgs},
    console::Console,
};

/// Samples from one frame to the next.
const FRAME: usize = 640;
/// Frames at the start of a word, 0.2 s.
const ONSET: usize = 5;
/// Silent frames before a word.
const BEFORE: usize = 8;
/// A frame counts as spoken if its power exceeds this share of the clip's 95th percentile (−30 dB).
const SPOKEN_POWER: f32 = 1e-3;
const LOUDEST: f32 = 0.5;

/// Measure a stream's mouth under music, noise and speech, or its memory and clock over hours
#[derive(Args)]
pub(super) struct Live {
    #[command(flatten)]
    data: DataArgs,
    /// Instead, push this many hours of sound through a stream as fast as possible
    #[arg(long, value_name = "N")]
    hours: Option<f64>,
}

impl Live {
    pub(super) fn run(&self, shared: &SharedArgs, _: &Console) -> Result<()> {
        let engine = shared.engine()?;
        if let Some(hours) = self.hours {
            // Every sound costs the same amount of work.
            let sounds = sounds::no_speech().into_iter().map(|(_, sound)| sound);
            return hours::run(&engine, &sounds.collect::<Vec<_>>(), hours);
        }
        let clips = clips(&self.data.folder()?)?;
        println!(
            "| sound | lips part, any sound, mm | lips part, mm | frames that move |\n|---|---|---|---|"
        );
        for (name, sound) in sounds::no_speech() {
            let (all, heard) = (gaps(&engine, &sound, true)?, gaps(&engine, &sound, false)?);
            let moving = heard.iter().filter(|gap| gap.abs() > 0.2).count();
            println!(
                "| {name} | {:.1} | {:.1} | {:.0} % |",
                widest(&all),
                widest(&heard),
                1e2 * moving as f64 / heard.len() as f64
            );
        }
        println!(
            "\n| speech | lost | lost at onsets | off the clean face, mm |\n|---|---|---|---|"
        );
        for (name, change) in sounds::changes() {
            let mut scores = Scores::default();
            for clean in &clips {
                let sound = change(clean);
                let (all, heard) = (gaps(&engine, &sound, true)?, gaps(&engine, &sound, false)?);
                scores.add(clean, &all, &heard, &gaps(&engine, clean, false)?);
            }
            println!("| {name} | {} |", scores.row());
        }
        Ok(())
    }
}

/// Clips of speech with a second of silence before and after.
fn clips(data: &Path) -> Result<Vec<Vec<f32>>> {
    let mut files = vec![
        data.join("clips/jfk.wav"),
        data.join("clips/Claire_neutral.wav"),
    ];
    for folder in ["kathleen_en", "picovoice_en", "nathalie_nl", "kerstin_de"] {
        let folder = data.join("speech").join(folder);
        let listed = fs::read_dir(&folder)
            .map_err(|e| anyface::Error::InvalidInput(format!("{}: {e}", folder.display())))?;
        let mut paths: Vec<_> = listed
            .filter_map(|entry| Some(entry.ok()?.path()))
            .collect();
        paths.retain(|path| path.extension().is_some_and(|kind| kind == "ogg"));
        paths.sort();
        files.extend(
            [
                paths.len() / 5,
                paths.len() / 3,
                paths.len() / 2,
                2 * paths.len() / 3,
            ]
            .map(|n| paths[n].clone()),
        );
    }
    let read = |path: &std::path::PathBuf| {
        let mut samples = Waveform::from_file(path)?.samples;
        samples.truncate(160_000);
        let peak = samples.iter().fold(1e-6f32, |most, x| most.max(x.abs()));
        let mut clip = vec![0.0; 16_000];
        clip.extend(samples.iter().map(|x| x * LOUDEST / peak));
        clip.extend([0.0; 16_000]);
        Ok(clip)
    };
    files.iter().map(read).collect()
}

/// How far the lips part beyond rest in each frame, mm.
fn gaps(engine: &Engine, sound: &[f32], any: bool) -> Result<Vec<f32>> {
    let mut stream = engine.stream()?;
    if any {
        stream.hear_all();
    }
    stream.push(sound)?;
    stream.finish()?;
    let frames = stream.drain().into_iter();
    Ok(frames
        .map(|frame| 1e3 * (frame.displacements[62][1] - frame.displacements[66][1]))
        .collect())
}

/// The 95th percentile.
fn widest(gaps: &[f32]) -> f32 {
    let mut sorted: Vec<f32> = gaps.iter().map(|gap| gap.abs()).collect();
    sorted.sort_by(f32::total_cmp);
    sorted[sorted.len() * 95 / 100]
}

#[derive(Default)]
struct Scores {
    said: f64,
    lost: f64,
    begun: f64,
    cut: f64,
    off: f64,
    frames: usize,
}

impl Scores {
    fn add(&mut self, clean: &[f32], all: &[f32], heard: &[f32], best: &[f32]) {
        let power: Vec<f32> = clean
            .chunks(FRAME)
            .map(|frame| frame.iter().map(|x| x * x).sum::<f32>())
            .collect();
        let mut sorted = power.clone();
        sorted.sort_by(f32::total_cmp);
        let least = SPOKEN_POWER * sorted[sorted.len() * 95 / 100];
        let spoken = |t: usize| power[t] > least;
        for t in 0..heard.len() {
            if !spoken(t) {
                continue;
            }
            let lost = f64::from((all[t] - heard[t]).abs());
            self.said += f64::from(all[t].abs());
            self.lost += lost;
            self.off += f64::from((heard[t] - best[t]).abs());
            self.frames += 1;
            let start = (t.saturating_sub(ONSET - 1)..=t)
                .find(|s| spoken(*s) && (s.saturating_sub(BEFORE)..*s).all(|q| !spoken(q)));
            if start.is_some() {
                self.begun += f64::from(all[t].abs());
                self.cut += lost;
            }
        }
    }

    fn row(&self) -> String {
        format!(
            "{:.1} % | {:.1} % | {:.2}",
            1e2 * self.lost / self.said,
            1e2 * self.cut / self.begun,
            self.off / self.frames as f64
        )
    }
}
