//! `anyface animate`: speech and a mesh to vertex displacements.

use std::path::PathBuf;

use anyface::{
    Engine, Face, Result,
    job::ProgressFn,
    mesh::{Mesh, Mouth},
    output::Report,
    speech::frames_of,
};
use clap::Args;

use crate::{
    arguments::{FaceArgs, MotionArgs, SharedArgs, SoundArgs},
    console::Console,
    layers::{LayerArgs, Layered},
    opened,
    paths::{InputPath, OutputPath, landmarks_beside},
    redo::{Redo, RedoArgs},
    stages::{
        Frames, new_report, note_face, note_memory, note_result, read_sound, speak_into, timed,
    },
    surface::SurfaceArgs,
};

/// Animate a mesh with speech
#[derive(Args)]
#[command(mut_arg("surface", |arg| {
    arg.conflicts_with_all(["redo", "mask", "layers", "mask_out", "open_mouth"])
}))]
pub struct Animate {
    /// The mesh: OBJ, PLY or GLB
    #[arg(long, value_name = "M")]
    mesh: InputPath,
    /// The speech: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF
    #[arg(long, value_name = "A")]
    audio: InputPath,
    /// The result: .npz (arrays, with the rotation of head and eyes and the tongue beside them), .pc2 or .mdd (point
    /// caches); with --surface a new folder
    #[arg(long, value_name = "O")]
    out: OutputPath,
    /// Part lips that are one surface first; the new mesh is written beside the result, its name with
    /// _open_mouth.obj behind it
    #[arg(long)]
    open_mouth: bool,
    #[command(flatten)]
    sound: SoundArgs,
    #[command(flatten)]
    face: FaceArgs,
    #[command(flatten)]
    motion: MotionArgs,
    #[command(flatten)]
    redo: RedoArgs,
    #[command(flatten)]
    layers: LayerArgs,
    #[command(flatten)]
    surface: SurfaceArgs,
}

impl Animate {
    /// Results whose names come from that of the animation.
    pub fn outputs_beside(&self) -> Vec<PathBuf> {
        let mesh = opened::beside(&self.out);
        let opened = [landmarks_beside(&mesh), mesh];
        (opened.into_iter().filter(|_| self.open_mouth))
            .chain(self.layers.outputs_beside(&self.out))
            .collect()
    }

    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        // What is cheap to check comes before what takes time.
        self.surface.check(&self.out)?;
        self.layers.check()?;
        let request = self.motion.request(shared)?;
        let redo = self.redo.asked()?;
        let options = self.face.options(&self.mesh, None)?;
        let mut report = new_report();
        let progress = &|p| console.progress(p);
        let sound = read_sound(&mut report, &self.audio, &self.sound, progress)?;
        let mesh = timed(&mut report, "read", || Mesh::read(&self.mesh))?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        self.surface.check_system(&engine)?;
        let is_whole = self.layers.are_asked() || redo.is_some() || self.surface.is_asked();
        let duration_s = sound.levels.duration_s();
        if !self.surface.is_asked() {
            let heard_s = match is_whole {
                true => duration_s,
                false => Engine::longest_stretch_s(duration_s),
            };
            let frames = frames_of(heard_s, request.fps);
            let (vertices, kept) = (mesh.positions.len(), self.layers.kept(frames, &mesh));
            note_memory(&mut report, &engine, vertices, kept, heard_s)?;
        }
        let mut face = timed(&mut report, "prepare", || {
            match self.open_mouth || self.surface.is_asked() {
                true => engine.find(&mesh, &options, progress),
                false => engine.prepare(&mesh, &options, progress),
            }
        })?;
        if self.open_mouth {
            face = self.opened(&engine, &face, &mut report, console)?;
        }
        note_face(&mut report, &face);
        let unseen = engine.unseen_events(&face, &request.events, duration_s, progress)?;
        report.warnings.extend(unseen);
        if !self.surface.is_asked() {
            let reach = engine.mouth_reach(&face, progress)?;
            let limits = reach.map(|reach| reach.sentences());
            report.warnings.extend(limits.into_iter().flatten());
        }
        if !is_whole {
            let way = (&engine, &face);
            speak_into(&self.out, way, sound, &request, &mut report, progress)?;
            return self.surface.tell(&report, console);
        }
        let waveform = sound.whole(progress)?;
        let performance = timed(&mut report, "motion", || {
            engine.perform(&waveform, &request, progress)
        })?;
        report.heard_emotion = performance.heard_emotion().cloned();
        if self.surface.is_asked() {
            let moved = (&performance.motion, performance.articulation());
            self.surface
                .write((&engine, &face), moved, &self.out, &mut report, progress)?;
            return self.surface.tell(&report, console);
        }
        let layered = timed(&mut report, "motion", || {
            self.layers.of(&engine, &face, &performance, progress)
        })?;
        self.spread(&layered, redo, &mut report, progress)?;
        self.surface.tell(&report, console)
    }

    /// Writes the result, or an earlier one with a stretch of this.
    fn spread(
        &self,
        layered: &Layered<'_>,
        redo: Option<Redo<'_>>,
        report: &mut Report,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        let Some(redo) = redo else {
            return self.layers.write(layered, &self.out, report, progress);
        };
        let Layered {
            engine,
            face,
            performance,
            ..
        } = *layered;
        let motion = &performance.motion;
        let (fps, articulation) = (motion.fps(), performance.articulation());
        let mut made = Frames::default();
        made.add(timed(report, "deform", || {
            redo.animate(engine, face, performance, &self.out, progress)
        })?);
        note_result(report, &self.out, face, fps, articulation, made);
        Ok(())
    }

    /// The same face with lips that part; its mesh is written beside the result.
    fn opened(
        &self,
        engine: &Engine,
        face: &Face,
        report: &mut Report,
        console: &Console,
    ) -> Result<Face> {
        let progress = &|p| console.progress(p);
        if face.mouth() != Mouth::Welded {
            return engine.prepare(&face.mesh, &face.options, progress);
        }
        let new = timed(report, "open", || engine.open_mouth(face, progress))?;
        let out = opened::beside(&self.out);
        timed(report, "write", || {
            opened::write(&out, &self.mesh, &face.mesh, &new, Mouth::Slit)
        })?;
        let options = new.face_options(face);
        timed(report, "prepare", || {
            engine.prepare(&new.mesh, &options, progress)
        })
    }
}
