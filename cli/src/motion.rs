//! `anyface motion`: speech to motion of landmarks or weights, before any mesh is known.

use anyface::{
    Result,
    job::write_json,
    motion,
    output::{check_motion_path, write_motion},
};
use clap::Args;

use crate::{
    arguments::{MotionArgs, SharedArgs, SoundArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath},
    redo::RedoArgs,
    stages::{new_report, read_sound, summary, timed},
};

/// Turn speech into the motion of 68 landmarks, in metres on a human head, or into weights of ARKit's shapes
#[derive(Args)]
pub struct Motion {
    /// The speech: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF
    #[arg(long, value_name = "A")]
    audio: InputPath,
    /// The result, .npz: landmark_displacements [T, 68, 3], head [T, 3], gaze [T, 2, 2], tongue [T, 4] and fps.
    /// Of a system that makes weights also weights [T, S] and their names [S]; or these alone: .csv (Live Link Face),
    /// .json
    #[arg(long, value_name = "O")]
    out: OutputPath,
    /// Also write a report of the run
    #[arg(long, value_name = "R.json")]
    report: Option<OutputPath>,
    /// As the stream hears it: each frame knows a fifth of a second ahead; one style, no noise
    #[arg(long, conflicts_with_all = ["style", "sounds", "redo"])]
    causal: bool,
    #[command(flatten)]
    sound: SoundArgs,
    #[command(flatten)]
    motion: MotionArgs,
    #[command(flatten)]
    redo: RedoArgs,
}

impl Motion {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        // Which kind it is, the system says; a name that fits none is refused before anything is loaded.
        check_motion_path(&self.out, true)?;
        let request = self.motion.request(shared)?;
        let redo = self.redo.asked()?;
        let mut report = new_report();
        let waveform = read_sound(&mut report, &self.audio, &self.sound)?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        let made = timed(&mut report, "motion", || {
            let progress = |p| console.progress(p);
            if self.causal {
                let motion = engine.causal_motion(&waveform, &request, &progress)?;
                return Ok((motion::Motion::Landmarks(motion), None, 1.0));
            }
            let performance = engine.perform(&waveform, &request, &progress)?;
            let articulation = performance.articulation();
            if let Some(redo) = &redo {
                let (motion, life) = redo.motion(&performance)?;
                return Ok((motion, Some(life), articulation));
            }
            Ok((performance.motion, Some(performance.life), articulation))
        });
        let (made, life, articulation) = made?;
        check_motion_path(&self.out, matches!(made, motion::Motion::Weights(_)))?;
        let motion = engine.landmarks_of(&made)?;
        report.note_motion(None, motion.displacements.view(), 1.0, articulation);
        report.frames = motion.displacements.dim().0;
        report.fps = motion.fps;
        report.out = Some(shown(&self.out));
        timed(&mut report, "write", || {
            write_motion(&self.out, &made, &motion, life.as_ref())
        })?;
        if let Some(path) = &self.report {
            write_json(path, &report)?;
        }
        console.report(&report, &summary(&report))
    }
}
