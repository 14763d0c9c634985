//! `anyface deform`: puts motion of landmarks or weights from a file on a mesh.

use std::path::Path;

use anyface::{
    Engine, Error, Face, Result,
    conditions::Controls,
    mesh::{LandmarkSource, NamedMesh, ibug::LANDMARKS},
    motion::{
        LandmarkClip, Life, Motion,
        bounds::{WEIGHT, check_life},
    },
    output::{
        LandmarkMotion, Report, read_landmark_motion, read_life, read_weights, write_attention,
    },
    spread::Movement,
};
use clap::Args;
use ndarray::{Array2, Axis};

use crate::{
    arguments::{FaceArgs, SharedArgs},
    console::Console,
    paths::{InputPath, OutputPath},
    scene::SceneArgs,
    stages::{new_report, note_face, spread_into, timed},
    surface::SurfaceArgs,
};

/// Frame rate of motion files that do not contain one.
const DEFAULT_FPS: f64 = 30.0;

/// Put motion from a file on a mesh
#[derive(Args)]
#[command(mut_arg("surface", |arg| arg.conflicts_with("attention")))]
pub struct Deform {
    /// The mesh: OBJ, PLY, GLB, VRM or glTF
    #[arg(long, value_name = "M")]
    mesh: InputPath,
    /// Motion, .npz: landmarks_neutral [68, 3] and landmark_displacements [T, 68, 3] in mesh units. Without
    /// landmarks_neutral the displacements are in metres on a human head, as `anyface motion` writes them. If the file has
    /// weights, they move the ARKit shapes of the mesh. If it has head, gaze and tongue [T, 4], the tongue of the mesh moves
    #[arg(long, value_name = "L.npz")]
    motion: InputPath,
    /// The result: .npz (arrays), .pc2 or .mdd (point caches), .glb or .usda (shapes with their weights over time), .vrma
    /// (expressions of avatars). With --surface the result is a new folder
    #[arg(long, value_name = "O")]
    out: OutputPath,
    /// Also write how much each vertex attends to each landmark, as shares averaged over the
    /// frames: .npz with attention [V, 68]. Needs --decoder paper and motion in mesh units
    #[arg(long, value_name = "A.npz")]
    attention: Option<OutputPath>,
    #[command(flatten)]
    face: FaceArgs,
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    surface: SurfaceArgs,
}

impl Deform {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        self.surface.check(&self.out)?;
        if !self.surface.is_asked() {
            self.scene.check(&self.out)?;
        }
        let mut report = new_report();
        let motion = timed(&mut report, "read", || read_landmark_motion(&self.motion))?;
        let named = timed(&mut report, "read", || NamedMesh::read(&self.mesh))?;
        let mesh = &named.mesh;
        let known = motion
            .neutral
            .map(|neutral| LandmarkSource::Positions(neutral.to_vec()));
        let file = (&*self.mesh, &named);
        let options = self.face.options(file, known, &mut report.warnings)?;
        let engine = timed(&mut report, "load", || shared.engine())?;
        self.surface.check_system(&engine)?;
        let face = timed(&mut report, "prepare", || {
            let progress = &|p| console.progress(p);
            if self.surface.is_asked() {
                engine.find(mesh, &options, progress)
            } else {
                engine.prepare(mesh, &options, progress)
            }
        })?;
        note_face(&mut report, &face);
        if self.surface.is_asked() {
            self.write_surface((&engine, &face), motion, &mut report, console)?;
            return self.surface.tell(&report, console);
        }
        if let Some(path) = &self.attention {
            self.write_attention(path, &engine, &face, &motion, console)?;
        }
        let weights = read_weights(&self.motion)?;
        let frames = motion.displacements.len_of(Axis(0));
        let life = read_life(&self.motion)?.unwrap_or_else(|| Life::still(frames));
        report.warnings.extend(check_life(&life)?);
        if let Some(clip) = &weights {
            report.warnings.extend(WEIGHT.check(&clip.weights)?);
        }
        let fps = motion.fps.unwrap_or(DEFAULT_FPS);
        let (progress, displacements) = (&|p| console.progress(p), motion.displacements);
        // The speech is unknown, so resting lips give no warning.
        let files = (Some(&*self.mesh), None);
        let file = self
            .scene
            .file(&self.out, files, (&engine, &face), progress)?;
        spread_into(file, &face, fps, 0.0, None, &mut report, |sink| {
            let spoken;
            let movement = match (motion.neutral, weights) {
                (Some(_), _) => Movement::Own {
                    landmarks: displacements,
                    fps,
                },
                (None, Some(clip)) => {
                    spoken = Motion::Weights(clip);
                    Movement::from(&spoken)
                }
                (None, None) => {
                    let clip = LandmarkClip { displacements, fps };
                    spoken = engine.follow(&clip, &face.options.controls, progress)?;
                    Movement::from(&spoken)
                }
            };
            engine.spread(&face, movement.with_tongue(&life), sink, progress)
        })?;
        self.surface.tell(&report, console)
    }

    /// Writes the surface of the head as it follows the landmarks.
    fn write_surface(
        &self,
        (engine, face): (&Engine, &Face),
        motion: LandmarkMotion,
        report: &mut Report,
        console: &Console,
    ) -> Result<()> {
        if motion.neutral.is_some() {
            return Err(Error::InvalidInput(format!(
                "{}: expected metres on a human head for --surface, as `anyface motion` writes them, got the units of \
                 a mesh",
                self.motion.display()
            )));
        }
        let progress = &|p| console.progress(p);
        let clip = LandmarkClip {
            displacements: motion.displacements,
            fps: motion.fps.unwrap_or(DEFAULT_FPS),
        };
        // The face's own controls could switch the codes off, but only codes move the head itself.
        let codes = engine.follow(&clip, &Controls::default(), progress)?;
        // The speech is unknown, so resting lips give no warning.
        self.surface
            .write((engine, face), (&codes, 0.0), &self.out, report, progress)
    }

    /// Works frame by frame. The attention of all frames would be more than twenty times as large
    /// as the clip.
    fn write_attention(
        &self,
        path: &Path,
        engine: &Engine,
        face: &Face,
        motion: &LandmarkMotion,
        console: &Console,
    ) -> Result<()> {
        if motion.neutral.is_none() {
            return Err(Error::InvalidInput(format!(
                "{}: expected landmarks_neutral for --attention, got none",
                self.motion.display()
            )));
        }
        let mut mean = Array2::zeros((face.mesh.positions.len(), LANDMARKS));
        let frames = motion.displacements.dim().0;
        for frame in motion.displacements.axis_chunks_iter(Axis(0), 1) {
            let shares = engine.attention(face, frame, &|p| console.progress(p))?;
            mean.scaled_add(1.0 / frames as f32, &shares.index_axis(Axis(0), 0));
        }
        write_attention(path, mean.view())
    }
}
