//! Shows heads whose lips are one surface, both untouched and with an opened mouth.

use ndarray::ArrayView3;

use super::{
    cells::{Cells, View, beside, under},
    subjects::Subject,
};
use crate::{
    pictures::raster::Picture,
    vertex_motion::{distance, pose, vertex_motion},
};
use anyface::{
    Engine, Error, Face, Result,
    job::SILENT,
    mesh::{Mesh, Mouth},
    motion::{LandmarkClip, Motion},
};

const SIZE: (usize, usize) = (220, 170);
const HALF_HEIGHT_M: f32 = 0.045;
/// Turn of the second view, radians. It shows a mouth bag or stretched skin from the side.
const TURNED: f32 = 0.7;
/// Triangles within this distance of the mouth's landmarks belong to the mouth, in widths of the
/// mouth.
const NEAR: f32 = 0.6;

/// One head whose lips are one surface.
pub(super) struct WeldedLips {
    pub picture: Picture,
    /// Share of the untouched mouth's triangles that grow beyond twice their area in any frame.
    pub grown: f32,
    /// How far the opened inner lips part in the first frame, as a share of their landmarks'
    /// motion. An error says why the mouth could not be opened.
    pub parted: std::result::Result<f32, String>,
}

/// Measures and draws a head. `None` if it has no face or its lips are already separate.
pub(super) fn welded_lips(
    engine: &Engine,
    subject: &Subject,
    motion: &LandmarkClip,
) -> Result<Option<WeldedLips>> {
    let face = match engine.prepare(&subject.mesh, &subject.options, SILENT) {
        Ok(face) if face.mouth() == Mouth::Welded => face,
        Ok(_) | Err(Error::FaceNotFound(_)) => return Ok(None),
        Err(other) => return Err(other),
    };
    let whole = Motion::Landmarks(motion.clone());
    let untouched = vertex_motion(engine, &face, &whole)?;
    let mut rows = rows_of(&subject.mesh, &face, untouched.view());
    let grown = grown(&subject.mesh, &face, untouched.view());
    let parted = match opened(engine, &face)? {
        Err(why) => Err(why),
        Ok(opened) => {
            let frames = vertex_motion(engine, &opened, &whole)?;
            rows.extend(rows_of(&opened.mesh, &opened, frames.view()));
            Ok(parting(&opened, frames.view(), motion))
        }
    };
    Ok(Some(WeldedLips {
        picture: under(&rows),
        grown,
        parted,
    }))
}

/// The same head with its mouth opened, or the reason why that is not possible.
fn opened(engine: &Engine, face: &Face) -> Result<std::result::Result<Face, String>> {
    let opened = match engine.open_mouth(face, SILENT) {
        Ok(opened) => opened,
        Err(why) => return Ok(Err(why.to_string())),
    };
    let options = opened.face_options(face);
    engine.prepare(&opened.mesh, &options, SILENT).map(Ok)
}

/// Two rows, from the front and turned. Each shows the head at rest and then every frame.
fn rows_of(mesh: &Mesh, face: &Face, frames: ArrayView3<'_, f32>) -> Vec<Picture> {
    let cells = Cells::new(mesh, face);
    let front = View::about(face, 48..68, SIZE, HALF_HEIGHT_M);
    let turned = front.turned(face, 48..68, TURNED);
    let row = |view: &View| {
        let rest = std::iter::once(cells.close_up(None, view));
        let moved = frames
            .outer_iter()
            .map(|frame| cells.close_up(Some(frame), view));
        let row: Vec<Picture> = rest.chain(moved).collect();
        beside(&row)
    };
    vec![row(&front), row(&turned)]
}

/// Share of the triangles around the mouth that grow beyond twice their area in any frame.
fn grown(mesh: &Mesh, face: &Face, frames: ArrayView3<'_, f32>) -> f32 {
    let marks = &face.landmarks.positions;
    let reach = NEAR * distance(marks[48], marks[54]);
    let near = |t: &[u32; 3]| {
        let p = mesh.positions[t[0] as usize];
        marks[48..68].iter().any(|m| distance(*m, p) < reach)
    };
    let neutral = mesh.face_areas();
    let frames = frames.outer_iter();
    let areas: Vec<_> = frames.map(|frame| pose(mesh, frame).face_areas()).collect();
    let twice = |f: usize| areas.iter().any(|areas| areas[f] > 2.0 * neutral[f]);
    let of_mouth: Vec<usize> = (0..mesh.triangles.len())
        .filter(|&f| near(&mesh.triangles[f]))
        .collect();
    let many = of_mouth.iter().filter(|&&f| twice(f)).count();
    many as f32 / of_mouth.len().max(1) as f32
}

/// How far the middles of the inner lips part in the first frame, as a share of their landmarks'
/// motion.
fn parting(face: &Face, frames: ArrayView3<'_, f32>, motion: &LandmarkClip) -> f32 {
    let [upper, lower] = [62, 66].map(|n| face.landmarks.vertices[n] as usize);
    let frame = frames.index_axis(ndarray::Axis(0), 0);
    let apart: [f32; 3] = std::array::from_fn(|i| frame[[upper, i]] - frame[[lower, i]]);
    let reached = face.to_canonical.rotate(apart)[1] * face.to_canonical.scale as f32;
    let requested = motion.displacements[[0, 62, 1]] - motion.displacements[[0, 66, 1]];
    reached / requested
}
