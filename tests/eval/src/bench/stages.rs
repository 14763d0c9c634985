//! Times the stages in the order in which a mesh and a recording pass through them.

use super::clock::Clock;
use crate::arguments::SharedArgs;
use anyface::{
    MotionRequest, Result,
    audio::Waveform,
    deform::{Plate, PlateWeights},
    face::{FaceOptions, PartList, Skin, locate_landmarks},
    job::SILENT,
    mesh::{self, LandmarkSource, Mesh, ibug::LANDMARKS},
    operators::{HeatGeodesics, OperatorOptions, Operators, SparseCholesky},
    output::write_animation,
    spread::{Animation, Collector},
};

/// Multiply-adds per vertex and frame in addition to those for the 68 landmarks: three axes of the
/// learned part and the jaw, see [`anyface::deform::LandmarkWeights`].
const CROSS: usize = 3 * 27;

/// Runs and times everything; returns the number of frames.
pub(super) fn run(
    clock: &mut Clock,
    shared: &SharedArgs,
    mesh: &Mesh,
    waveform: &Waveform,
    options: &FaceOptions,
) -> Result<usize> {
    let engine = clock.time("load", None, || shared.engine())?;
    let request = MotionRequest::default();
    let motion = clock.time("speech and denoiser", None, || {
        engine.perform(waveform, &request, SILENT)
    })?;
    let landmarks = clock.time("landmark search", None, || locate_landmarks(mesh, options))?;
    solving(clock, mesh, &landmarks, options)?;
    let known = FaceOptions {
        landmarks: Some(LandmarkSource::Vertices(landmarks.vertices.to_vec())),
        ..options.clone()
    };
    let face = clock.time("prepare, landmarks given", None, || {
        engine.prepare(mesh, &known, SILENT)
    })?;
    let motion = &motion.motion;
    let (frames, vertices) = (motion.frames(), mesh.positions.len());
    let products = frames * vertices * (3 * LANDMARKS + CROSS);
    let moved = clock.time("frame product", Some(2e-9 * products as f64), || {
        Collector::collect(|sink| engine.spread(&face, motion, sink, SILENT))
    })?;
    writing(clock, mesh, &moved)?;
    Ok(frames)
}

/// Times the work of [`Skin`] and [`PlateWeights`] piece by piece.
fn solving(
    clock: &mut Clock,
    mesh: &Mesh,
    landmarks: &mesh::Landmarks,
    options: &FaceOptions,
) -> Result<()> {
    let to_canonical = mesh::align_to_canonical(landmarks)?;
    let cm = |p: [f32; 3]| to_canonical.apply(p).map(|x| 100.0 * x);
    let canonical = Mesh {
        positions: mesh.positions.iter().map(|&p| cm(p)).collect(),
        triangles: mesh.triangles.clone(),
    };
    let places = landmarks.positions.map(cm);
    let parts = clock.time("parts", None, || {
        PartList::find(mesh, landmarks, &to_canonical, &options.parts)
    })?;
    let skin = clock.time("skin, proxy and operators", None, || {
        Skin::find(
            &canonical,
            &places,
            &landmarks.vertices,
            &parts,
            options.proxy,
        )
    })?;
    let solved = Mesh {
        positions: (skin.operators.positions.iter())
            .map(|p| p.as_vec3().into())
            .collect(),
        triangles: skin.operators.triangles.clone(),
    };
    let operators = clock.time("  operators", None, || {
        Operators::new(&solved, &OperatorOptions::default())
    })?;
    clock.time("  geodesics", None, || {
        Ok(HeatGeodesics::new(&operators)?.distance_from(&[0]).len())
    })?;
    let shifted = operators.laplacian.add_diagonal(1.0, &operators.mass)?;
    clock.time("  factorisation", None, || SparseCholesky::factor(&shifted))?;
    clock.time("plate weights", None, || {
        PlateWeights::solve(&skin.operators, &skin.landmark_rows, Plate::default())
    })?;
    Ok(())
}

fn writing(clock: &mut Clock, mesh: &Mesh, moved: &Animation) -> Result<()> {
    let folder = tempfile::tempdir().map_err(anyface::Error::io(std::env::temp_dir()))?;
    for (name, file) in [("write npz", "o.npz"), ("write pc2", "o.pc2")] {
        let path = folder.path().join(file);
        clock.time(name, None, || write_animation(&path, moved, None, mesh))?;
    }
    Ok(())
}
