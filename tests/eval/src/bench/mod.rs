//! `anyface-eval bench`: how long each stage takes on this machine.

mod clock;
mod peak;
mod stages;
mod triangulations;

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use clock::{Clock, Stage};

use crate::{
    arguments::SharedArgs,
    console::Console,
    stopwatch::{forget_peak, peak_mib},
};
use anyface::{
    Error, Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
    face::{DEFAULT_PROXY, FaceOptions},
    mesh::{LandmarkSource, Mesh},
};

/// Measure every stage on this machine
///
/// Each stage runs several times and the least time counts. If the number of operations of a stage
/// is known, its speed is compared with the machine's peak. A matrix product that stays in the
/// cache measures this peak first.
#[derive(Args)]
pub(super) struct Bench {
    /// The mesh: OBJ or PLY
    #[arg(long, value_name = "M")]
    mesh: PathBuf,
    /// The speech [default: five seconds of synthetic sound]
    #[arg(long, value_name = "A")]
    audio: Option<PathBuf>,
    /// Runs of each stage
    #[arg(long, default_value_t = 3)]
    runs: usize,
    /// Instead, apply one motion to the mesh in five triangulations of 1,000 to 400,000 vertices
    /// and report how far the results differ
    #[arg(long)]
    triangulations: bool,
    /// Landmarks as JSON: 68 positions or 68 vertex numbers [default: found on the mesh]
    #[arg(long, value_name = "L.json")]
    landmarks: Option<PathBuf>,
    /// Solve on every vertex of the skin instead of a coarser proxy
    #[arg(long)]
    no_proxy: bool,
}

/// Everything that was measured.
#[derive(Debug, Clone, Serialize)]
struct Measured {
    version: &'static str,
    threads: usize,
    vertices: usize,
    audio_s: f64,
    frames: usize,
    /// The speed of a single-precision matrix product that stays in the cache, on all threads.
    peak_gflops: f64,
    stages: Vec<Stage>,
    peak_mib: Option<f64>,
}

impl Bench {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        if self.runs == 0 {
            let message = "runs: expected 1 or more, got 0";
            return Err(Error::InvalidInput(message.into()));
        }
        let mesh = Mesh::read(&self.mesh)?;
        let waveform = match &self.audio {
            Some(path) => Waveform::from_file(path)?,
            None => made_up(5.0),
        };
        let options = self.options()?;
        if self.triangulations {
            let spread = triangulations::measure(shared, &mesh, &waveform, &options)?;
            console.value(
                &triangulations::json(&spread),
                &triangulations::text(&spread),
            );
            return Ok(());
        }
        forget_peak();
        let mut clock = Clock {
            runs: self.runs,
            stages: Vec::new(),
        };
        let peak_gflops = peak::gflops();
        let frames = stages::run(&mut clock, shared, &mesh, &waveform, &options)?;
        let measured = Measured {
            version: env!("CARGO_PKG_VERSION"),
            threads: rayon::current_num_threads(),
            vertices: mesh.positions.len(),
            audio_s: waveform.duration_s(),
            frames,
            peak_gflops,
            stages: clock.stages,
            peak_mib: peak_mib(),
        };
        let json = serde_json::to_value(&measured);
        let json = json.map_err(|e| Error::InvalidInput(format!("bench: {e}")))?;
        console.value(&json, &table(&measured));
        Ok(())
    }

    /// The options for finding and moving the face.
    fn options(&self) -> Result<FaceOptions> {
        let landmarks = self.landmarks.as_deref().map(LandmarkSource::read);
        Ok(FaceOptions {
            landmarks: landmarks.transpose()?,
            proxy: (!self.no_proxy).then_some(DEFAULT_PROXY),
            ..FaceOptions::default()
        })
    }
}

/// A voice-like tone with syllables and pauses.
fn made_up(seconds: f64) -> Waveform {
    let count = (seconds * f64::from(SAMPLE_RATE_HZ)) as usize;
    let sample = |i: usize| {
        let t = i as f64 / f64::from(SAMPLE_RATE_HZ);
        let loud = (4.0 * std::f64::consts::TAU * t).sin().max(0.0);
        let voice: f64 = (1..20)
            .map(|k| (std::f64::consts::TAU * 120.0 * f64::from(k) * t).sin() / f64::from(k))
            .sum();
        (0.2 * loud * voice) as f32
    };
    Waveform {
        samples: (0..count).map(sample).collect(),
    }
}

fn table(measured: &Measured) -> String {
    let mut text = format!(
        "{} vertices, {:.1} s of sound, {} frames, {} threads, peak {:.0} GFLOP/s\n{:<32}{:>10}{:>10}{:>10}{:>9}\n",
        measured.vertices,
        measured.audio_s,
        measured.frames,
        measured.threads,
        measured.peak_gflops,
        "stage",
        "wall ms",
        "work ms",
        "GFLOP/s",
        "of peak",
    );
    for stage in &measured.stages {
        let (wall, work) = (1000.0 * stage.elapsed_s, 1000.0 * stage.work_s);
        text += &format!("{:<32}{wall:>10.1}{work:>10.0}", stage.name);
        if let Some(gflop) = stage.gflop {
            let rate = gflop / stage.elapsed_s;
            text += &format!("{rate:>10.1}{:>8.0}%", 100.0 * rate / measured.peak_gflops);
        }
        text += "\n";
    }
    if let Some(mib) = measured.peak_mib {
        text += &format!("largest memory {mib:.0} MiB\n");
    }
    text
}
