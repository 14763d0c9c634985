//! `anyface animate`: turns speech and a mesh into vertex displacements.

use std::path::{Path, PathBuf};

use anyface::{
    Engine, Error, Face, Result,
    audio::SoundFile,
    job::ProgressFn,
    mesh::{Mesh, Mouth, NamedMesh},
    output::{ClipFile, Format, Report},
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
    scene::{SceneArgs, SceneSound},
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
    /// The mesh: OBJ, PLY, GLB, VRM or glTF
    #[arg(long, value_name = "M")]
    mesh: InputPath,
    /// The speech: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF
    #[arg(long, value_name = "A")]
    audio: InputPath,
    /// The result: .npz (arrays of the motion, the rotation of head and eyes, and the tongue), .pc2
    /// or .mdd (point caches), .glb or .usda (shapes with their weights over time, and the head as
    /// a node that turns), .vrma (expressions, head and eyes of avatars). A GLB result keeps
    /// everything else from the GLB of the mesh. The sound is copied beside a .glb or .usda. With
    /// --surface the result is a new folder
    #[arg(long, value_name = "O")]
    out: OutputPath,
    /// First cut the mouth open if the lips are one surface. The new mesh is written beside the
    /// result; its name ends in _open_mouth.obj
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
    scene: SceneArgs,
    #[command(flatten)]
    surface: SurfaceArgs,
}

/// What is written, and how much of the motion has to be known for it.
enum Job<'a> {
    /// The frames of the mesh, while they are made.
    Frames,
    /// The frames of the mesh once all motion is known: for layers, or a stretch made again.
    Whole(Option<Redo<'a>>),
    /// The surface of the head that resembles the mesh.
    Surface,
}

impl Animate {
    /// Results whose names derive from that of the animation.
    pub fn outputs_beside(&self, shared: &SharedArgs) -> Vec<PathBuf> {
        let sound = self.scene_sound(shared);
        let sound = sound.as_ref().and_then(SceneSound::output);
        let mesh = opened::beside(&self.out);
        let opened = [landmarks_beside(&mesh), mesh];
        (opened.into_iter().filter(|_| self.open_mouth))
            .chain(sound.map(Path::to_owned))
            .chain(self.layers.outputs_beside(&self.out))
            .collect()
    }

    fn scene_sound(&self, shared: &SharedArgs) -> Option<SceneSound> {
        SceneSound::of(&self.out, &self.audio, &shared.receipts())
    }

    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let job = self.job()?;
        let request = self.motion.request(shared)?;
        let mut report = new_report();
        let progress = &|p| console.progress(p);
        let sound = read_sound(&mut report, &self.audio, &self.sound, progress)?;
        let duration_s = sound.levels.duration_s();
        let scene_sound = self.scene_sound(shared);
        if let Some(scene_sound) = &scene_sound {
            scene_sound.copy(&self.audio)?;
            report.warnings.extend(scene_sound.warning.clone());
        }
        let named = timed(&mut report, "read", || NamedMesh::read(&self.mesh))?;
        let mesh = &named.mesh;
        let file = (&*self.mesh, &named);
        let options = self.face.options(file, None, &mut report.warnings)?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        self.surface.check_system(&engine)?;
        if let Some((frames, heard_s)) = self.memory(&job, mesh, duration_s, request.fps)? {
            note_memory(&mut report, &engine, mesh.positions.len(), frames, heard_s)?;
        }
        let found = timed(&mut report, "prepare", || {
            if self.open_mouth || matches!(job, Job::Surface) {
                engine.find(mesh, &options, progress)
            } else {
                engine.prepare(mesh, &options, progress)
            }
        })?;
        let vertices = found.mesh.positions.len();
        let face = if self.open_mouth {
            self.opened(&engine, &found, &mut report, console)?
        } else {
            found
        };
        // If the mouth was cut open, the mesh differs from its file, so the result takes nothing from that file.
        let mesh_file = (face.mesh.positions.len() == vertices).then_some(&*self.mesh);
        let beside = (mesh_file, scene_sound.as_ref().map(|sound| &*sound.path));
        let way = (&engine, &face);
        note_face(&mut report, &face);
        let unseen = engine.unseen_events(&face, &request.events, duration_s, progress)?;
        report.warnings.extend(unseen);
        let file = |report: &mut Report| {
            let reach = engine.mouth_reach(&face, progress)?;
            let limits = reach.map(|reach| reach.sentences());
            report.warnings.extend(limits.into_iter().flatten());
            self.scene.file(&self.out, beside, way, progress)
        };
        let perform = |report: &mut Report, sound: SoundFile| {
            let waveform = sound.whole(progress)?;
            let performance = timed(report, "motion", || {
                engine.perform(&waveform, &request, progress)
            })?;
            report.heard_emotion = performance.heard_emotion().cloned();
            Ok::<_, Error>(performance)
        };
        match job {
            Job::Frames => {
                let file = file(&mut report)?;
                speak_into(file, way, sound, &request, &mut report, progress)?;
            }
            Job::Whole(redo) => {
                let file = file(&mut report)?;
                let performance = perform(&mut report, sound)?;
                let layered = timed(&mut report, "motion", || {
                    self.layers.of(&engine, &face, &performance, progress)
                })?;
                self.spread(&layered, (redo, file), &mut report, progress)?;
            }
            Job::Surface => {
                let performance = perform(&mut report, sound)?;
                let moved = (&performance.motion, performance.articulation());
                self.surface
                    .write(way, moved, &self.out, &mut report, progress)?;
            }
        }
        self.surface.tell(&report, console)
    }

    /// What the command line asks for, after all checks that need no work.
    fn job(&self) -> Result<Job<'_>> {
        self.surface.check(&self.out)?;
        self.layers.check(&self.out)?;
        if self.surface.is_asked() {
            return Ok(Job::Surface);
        }
        self.scene.check(&self.out)?;
        let redo = self.redo.request()?;
        if redo.is_some() || self.layers.are_asked() {
            return Ok(Job::Whole(redo));
        }
        Ok(Job::Frames)
    }

    /// How many frames are in memory at once, and how many seconds of sound; `None` for a surface.
    fn memory(
        &self,
        job: &Job<'_>,
        mesh: &Mesh,
        duration_s: f64,
        fps: f64,
    ) -> Result<Option<(usize, f64)>> {
        let heard_s = match job {
            Job::Surface => return Ok(None),
            Job::Whole(_) => duration_s,
            Job::Frames => Engine::longest_stretch_s(duration_s),
        };
        let frames = if Format::from_path(&self.out)?.is_scene() {
            let frames = frames_of(duration_s, fps);
            ClipFile::frames_in_memory(frames) + self.scene.count_shape_frames(&self.out)
        } else {
            let frames = frames_of(heard_s, fps);
            self.layers.count_frames_in_memory(frames, mesh)
        };
        Ok(Some((frames, heard_s)))
    }

    /// Writes the result. With --redo this is the earlier result with one stretch replaced.
    fn spread(
        &self,
        layered: &Layered<'_>,
        (redo, file): (Option<Redo<'_>>, ClipFile),
        report: &mut Report,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        let Some(redo) = redo else {
            let file = (&*self.out, file);
            return self.layers.write(layered, file, report, progress);
        };
        let Layered {
            engine,
            face,
            performance,
            ..
        } = *layered;
        let motion = &performance.motion;
        let (fps, articulation) = (motion.fps(), performance.articulation());
        let mut result = Frames::default();
        result.add(timed(report, "deform", || {
            redo.animate(engine, face, performance, file, progress)
        })?);
        note_result(report, &self.out, face, fps, articulation, result);
        Ok(())
    }

    /// Prepares the face with its mouth cut open, and writes the new mesh beside the result. If the
    /// lips are not one surface, prepares the mesh as it is and writes none.
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
