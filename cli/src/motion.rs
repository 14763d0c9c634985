//! `anyface motion`: speech to motion of landmarks or weights, before any mesh is known.

use anyface::{
    Engine, Part, Result,
    job::{ProgressFn, write_json},
    motion::{self, Extent, Life, MotionKind},
    output::{MotionFile, check_motion_path},
    speech::frames_of,
};
use clap::Args;

use crate::{
    arguments::{MotionArgs, SharedArgs, SoundArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath},
    redo::RedoArgs,
    stages::{add_heard, new_report, note_memory, read_sound, summary, timed},
};

/// Turn speech into the motion of 68 landmarks, in metres on a human head, or into weights of ARKit's shapes
#[derive(Args)]
pub struct Motion {
    /// The speech: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF
    #[arg(long, value_name = "A")]
    audio: InputPath,
    /// The result, .npz: landmark_displacements [T, 68, 3], head [T, 3], gaze [T, 2, 2], tongue [T, 4] and fps.
    /// A system that makes weights adds weights [T, S] and their names [S]. .csv (Live Link Face) and .json hold only the
    /// weights
    #[arg(long, value_name = "O")]
    out: OutputPath,
    /// Also write a report of the run
    #[arg(long, value_name = "R.json")]
    report: Option<OutputPath>,
    /// Make the motion as the live stream does: each frame hears a fifth of a second ahead, in one style and without noise
    #[arg(long, conflicts_with_all = ["style", "performer", "sounds", "redo"])]
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
        // The kind of motion is known only once the system is loaded. Refuse a name that fits no kind
        // before that.
        check_motion_path(&self.out, true)?;
        let request = self.motion.request(shared)?;
        let redo = self.redo.request()?;
        let mut report = new_report();
        let progress = &|p| console.progress(p);
        let sound = read_sound(&mut report, &self.audio, &self.sound, progress)?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        let duration_s = sound.levels.duration_s();
        let is_whole = self.causal || redo.is_some();
        let heard_s = if is_whole {
            duration_s
        } else {
            Engine::longest_stretch_s(duration_s)
        };
        note_memory(&mut report, &engine, 0, 0, heard_s)?;
        let is_weights = engine.system().motion == MotionKind::Weights;
        let frames = frames_of(duration_s, request.fps);
        let mut file = MotionFile::new(&self.out, is_weights, frames, request.fps)?;
        let mut extent = Extent::default();
        let mut write = |motion: &motion::Motion, life: Option<&Life>| {
            let landmarks = engine.landmarks_of(motion)?;
            extent = extent.with(Extent::of(None, landmarks.displacements.view()));
            file.add(motion, &landmarks, life)
        };
        let mut heard = None;
        timed(&mut report, "motion", || {
            if !is_whole {
                let mut take = |part: Part, _: ProgressFn<'_>| {
                    add_heard(&mut heard, part.heard_emotion);
                    write(&part.motion, Some(&part.life))
                };
                return engine.perform_in_parts(sound, &request, &mut take, progress);
            }
            let waveform = sound.whole(progress)?;
            match &redo {
                Some(redo) => {
                    let performance = engine.perform(&waveform, &request, progress)?;
                    add_heard(&mut heard, performance.heard_emotion().cloned());
                    let (motion, life) = redo.motion(&performance)?;
                    write(&motion, Some(&life))
                }
                None => {
                    let motion = engine.causal_motion(&waveform, &request, progress)?;
                    write(&motion::Motion::Landmarks(motion), None)
                }
            }
        })?;
        report.heard_emotion = heard;
        let articulation = if self.causal {
            1.0
        } else {
            request.articulation()
        };
        report.note_motion(&extent, 1.0, articulation);
        report.frames = frames;
        report.fps = request.fps;
        report.out = Some(shown(&self.out));
        timed(&mut report, "write", || file.finish())?;
        if let Some(path) = &self.report {
            write_json(path, &report)?;
        }
        console.report(&report, &summary(&report))
    }
}
