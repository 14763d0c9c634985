//! Compares emotions with the true motion, to show how the skin moves between the landmarks.

use ndarray::ArrayView3;

use super::{
    cells::{Cells, View, beside, error_mm, under},
    subjects::Subject,
};
use crate::{
    pictures::raster::Picture,
    vertex_motion::{distance, pose, spread_landmarks},
};
use anyface::{Engine, Face, Result, job::SILENT, mesh::Mesh};

const SIZE: (usize, usize) = (200, 150);
const HALF_HEIGHT_M: f32 = 0.055;
/// A region holds the vertices within this distance of its middle, millimetres.
const REGION_MM: f32 = 18.0;
/// Normals whose true turn is no more than this do not count. A turn is the length of a normal's
/// change.
const LEAST_TURN: f32 = 0.05;

/// Emotions on a face whose true motion is known.
pub(super) struct Emotions {
    pub picture: Picture,
    /// The mean error of each emotion over the vertices that truly move, millimetres.
    pub error_mm: Vec<f32>,
    /// How far normals turn along their true turn, as a share of it, between the brows and on the
    /// cheeks.
    pub turned: [f32; 2],
}

/// Measures and draws the emotions. `None` for a subject whose true motion is unknown.
pub(super) fn emotions(engine: &Engine, subject: &Subject) -> Result<Option<Emotions>> {
    let Some(truth) = &subject.truth else {
        return Ok(None);
    };
    let face = engine.prepare(&subject.mesh, &subject.options, SILENT)?;
    let prediction = spread_landmarks(engine, &face, truth.of_landmarks())?;
    let cells = Cells::new(&subject.mesh, &face);
    let view = View::about(&face, 17..48, SIZE, HALF_HEIGHT_M);
    let row = |frames: ArrayView3<'_, f32>| {
        let cells = frames
            .outer_iter()
            .map(|frame| cells.close_up(Some(frame), &view));
        beside(&cells.collect::<Vec<_>>())
    };
    let between_brows = near(&face, truth.mm, [21, 22]);
    let cheeks = [[41, 48], [46, 54]].map(|marks| near(&face, truth.mm, marks));
    let turned = [between_brows, cheeks.concat()].map(|region| {
        turn(
            &subject.mesh,
            &region,
            truth.displacements.view(),
            prediction.view(),
        )
    });
    Ok(Some(Emotions {
        picture: under(&[row(truth.displacements.view()), row(prediction.view())]),
        error_mm: error_mm(truth, prediction.view()).means,
        turned,
    }))
}

/// The vertices around the midpoint of two landmarks.
fn near(face: &Face, mm: f32, marks: [usize; 2]) -> Vec<usize> {
    let [a, b] = marks.map(|n| face.landmarks.positions[n]);
    let middle = std::array::from_fn(|i| 0.5 * (a[i] + b[i]));
    let at = &face.mesh.positions;
    let near = |v: &usize| mm * distance(at[*v], middle) < REGION_MM;
    (0..at.len()).filter(near).collect()
}

/// How far normals turn along their true turn, as a share of it, over all frames.
fn turn(
    mesh: &Mesh,
    region: &[usize],
    truth: ArrayView3<'_, f32>,
    prediction: ArrayView3<'_, f32>,
) -> f32 {
    let rest = mesh.vertex_normals();
    let normals = |frame| pose(mesh, frame).vertex_normals();
    let (mut along, mut whole) = (0.0f32, 0.0f32);
    for (truth, prediction) in truth.outer_iter().zip(prediction.outer_iter()) {
        let (truth, prediction) = (normals(truth), normals(prediction));
        for &v in region {
            let turned =
                |of: &[[f32; 3]]| -> [f32; 3] { std::array::from_fn(|i| of[v][i] - rest[v][i]) };
            let (truth, prediction) = (turned(&truth), turned(&prediction));
            let squared: f32 = truth.iter().map(|x| x * x).sum();
            if squared > LEAST_TURN * LEAST_TURN {
                whole += squared;
                along += (0..3).map(|i| truth[i] * prediction[i]).sum::<f32>();
            }
        }
    }
    along / whole.max(f32::MIN_POSITIVE)
}
