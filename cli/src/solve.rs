//! `anyface solve`: any vertex animation into weights of ARKit shapes.

use anyface::{
    Result,
    face::{FaceOptions, locate_landmarks},
    job::write_json,
    mesh::{LandmarkSource, Mesh},
    motion::check_fps,
    output::{Report, read_rig, read_vertex_motion, write_blend_weights},
    rig::{ARKIT, SolveOptions, SolvedWeights, meeting_lips, solve},
};
use clap::Args;
use serde::Serialize;

use crate::{
    arguments::{SharedArgs, shown},
    console::Console,
    paths::{InputPath, OutputPath},
    stages::{new_report, timed},
};

/// Share of the motion that may stay unexplained before the user is warned.
const POOR: f32 = 0.3;

/// Turn a vertex animation into weights of ARKit shapes
#[derive(Args)]
pub struct Solve {
    /// The mesh: OBJ or PLY
    #[arg(long, value_name = "M")]
    mesh: InputPath,
    /// Motion of the mesh's vertices: .npz (displacements [T, V, 3]), .pc2 or .mdd
    #[arg(long, value_name = "A")]
    animation: InputPath,
    /// Shapes of the mesh, as `anyface rig` writes them
    #[arg(long, value_name = "R.npz")]
    rig: InputPath,
    /// Landmarks of the mesh as JSON. They say where the lips are, so that lips that meet in the animation
    /// also meet under the weights
    #[arg(long, value_name = "L.json")]
    landmarks: Option<InputPath>,
    /// The result: .csv (Live Link Face) or .json
    #[arg(long, value_name = "W")]
    out: OutputPath,
    /// Frames per second [default: those of the animation, or 30 if it names none]
    #[arg(long)]
    fps: Option<f64>,
    /// How strongly a weight keeps to its value in the neighbouring frames
    #[arg(long, default_value_t = SolveOptions::default().smoothness)]
    smoothness: f64,
    /// How strongly left and right keep to the same value
    #[arg(long, default_value_t = SolveOptions::default().symmetry)]
    symmetry: f64,
    /// Also write a report of the run
    #[arg(long, value_name = "R.json")]
    report: Option<OutputPath>,
}

/// A run and how well the shapes fit the motion.
#[derive(Serialize)]
struct SolveReport<'a> {
    #[serde(flatten)]
    run: &'a Report,
    /// Root mean square of the motion over vertices and frames, in mesh units.
    motion_rms: f32,
    /// The same for the motion that the weights leave unexplained.
    residual_rms: f32,
}

impl Solve {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let mut report = new_report();
        let mesh = timed(&mut report, "read", || Mesh::read(&self.mesh))?;
        let rig = timed(&mut report, "read", || read_rig(&self.rig))?;
        let motion = timed(&mut report, "read", || {
            read_vertex_motion(&self.animation, &mesh)
        })?;
        let fps = self.fps.or(motion.fps).unwrap_or(30.0);
        check_fps(fps)?;
        let options = SolveOptions {
            smoothness: self.smoothness,
            symmetry: self.symmetry,
            ..SolveOptions::default()
        };
        let shapes = rig
            .names
            .iter()
            .take_while(|n| ARKIT.contains(&n.as_str()))
            .count();
        let lips = self.lips(&mesh)?;
        let solved = timed(&mut report, "solve", || {
            let moved = motion.displacements.view();
            let engine = shared.engine()?;
            engine.threads(|| {
                solve(&rig, shapes, moved, &lips, &options, &|p| {
                    console.progress(p)
                })
            })
        })?;
        timed(&mut report, "write", || {
            write_blend_weights(&self.out, &solved, fps)
        })?;
        report.out = Some(shown(&self.out));
        report.frames = solved.weights.nrows();
        report.fps = fps;
        report.vertices = Some(mesh.positions.len());
        self.tell(&mut report, &solved, console)
    }

    /// Pairs of lip vertices that meet. None without `--landmarks`.
    fn lips(&self, mesh: &Mesh) -> Result<Vec<[u32; 2]>> {
        let Some(path) = &self.landmarks else {
            return Ok(Vec::new());
        };
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::read(path)?),
            ..FaceOptions::default()
        };
        let landmarks = locate_landmarks(mesh, &options)?;
        Ok(meeting_lips(&landmarks.vertices))
    }

    fn tell(&self, report: &mut Report, solved: &SolvedWeights, console: &Console) -> Result<()> {
        let (motion, residual) = (rms(&solved.motion), rms(&solved.residual));
        if residual > POOR * motion {
            report.warnings.push(format!(
                "the shapes leave {:.0} % of the motion unexplained; does the whole head move, \
                 or does the mouth do what no mixture of the shapes does?",
                100.0 * residual / motion
            ));
        }
        let full = SolveReport {
            run: report,
            motion_rms: motion,
            residual_rms: residual,
        };
        if let Some(path) = &self.report {
            write_json(path, &full)?;
        }
        let mut text = format!(
            "wrote {}: {} frames at {} fps, {:.1} % of the motion left over\n",
            self.out.display(),
            report.frames,
            report.fps,
            100.0 * residual / motion.max(f32::MIN_POSITIVE)
        );
        for warning in &report.warnings {
            text += &format!("warning: {warning}\n");
        }
        console.value(&full, &text)
    }
}

fn rms(values: &[f32]) -> f32 {
    (values.iter().map(|x| x * x).sum::<f32>() / values.len().max(1) as f32).sqrt()
}
