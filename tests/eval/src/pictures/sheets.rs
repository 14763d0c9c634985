//! Contact sheets: the default head under landmark motion, frame by frame.

use std::{collections::HashMap, path::Path};

use ndarray::{Array3, Axis};

use super::{
    Album, letters,
    raster::{Picture, Scene},
};
use crate::vertex_motion::{pose, vertex_motion};
use anyface::{
    Engine, Error, Face, Result,
    face::FaceOptions,
    job::SILENT,
    mesh::{LandmarkSource, Mesh},
    motion::{LandmarkClip, Motion},
};

const CELL: (usize, usize) = (112, 132);
const NAMES: usize = 104;
const GAP: usize = 3;
/// Yaw of the head, so that protruding lips show, radians.
const YAW: f32 = 0.30;
/// Half of the picture's height, in distances from chin to brows.
const HALF_HEIGHT: f32 = 0.66;
const CHIN: usize = 8;
const NOSE: usize = 33;
const BROWS: [usize; 2] = [19, 24];

/// One row of a sheet.
pub(crate) struct Row {
    pub title: String,
    /// `[columns, 68, 3]`, canonical metres.
    pub motion: Array3<f64>,
}

/// A prepared head with its colours.
pub(crate) struct Head {
    mesh: Mesh,
    face: Face,
    /// `[F]`, linear.
    colours: Vec<[f32; 3]>,
    centre: [f32; 2],
    half_height: f32,
}

impl Head {
    /// `folder`: head.obj, head.mtl and landmarks.json.
    pub(crate) fn read(engine: &Engine, folder: &Path) -> Result<Self> {
        let path = folder.join("head.obj");
        let mesh = Mesh::read(&path)?;
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::read(&folder.join("landmarks.json"))?),
            ..FaceOptions::default()
        };
        let face = engine.prepare(&mesh, &options, SILENT)?;
        let text = |path: &Path| std::fs::read_to_string(path).map_err(Error::io(path));
        let materials = materials(&text(&folder.join("head.mtl"))?);
        let colours = colours(&text(&path)?, &materials);
        if colours.len() != mesh.triangles.len() {
            return Err(Error::Mesh(format!(
                "{}: expected triangles only, one colour each",
                path.display()
            )));
        }
        let at = |n: usize| turned(face.landmarks.positions[n]);
        let brows = 0.5 * (at(BROWS[0])[1] + at(BROWS[1])[1]);
        let tall = brows - at(CHIN)[1];
        Ok(Head {
            centre: [0.8 * at(NOSE)[0], at(CHIN)[1] + 0.52 * tall],
            half_height: HALF_HEIGHT * tall,
            mesh,
            face,
            colours,
        })
    }

    /// A picture for each frame of landmark motion, `[T, 68, 3]` canonical metres.
    fn frames(&self, engine: &Engine, motion: &Array3<f64>) -> Result<Vec<Picture>> {
        let motion = LandmarkClip {
            displacements: motion.mapv(|x| x as f32),
            fps: 1.0,
        };
        let frames = vertex_motion(engine, &self.face, &Motion::Landmarks(motion))?;
        Ok(frames.axis_iter(Axis(0)).map(|f| self.draw(f)).collect())
    }

    fn draw(&self, displacements: ndarray::ArrayView2<'_, f32>) -> Picture {
        let mut mesh = pose(&self.mesh, displacements);
        mesh.positions.iter_mut().for_each(|p| *p = turned(*p));
        let scene = Scene {
            normals: &mesh.vertex_normals(),
            points: &mesh.positions,
            triangles: &mesh.triangles,
            colours: &self.colours,
            centre: self.centre,
            half_height: self.half_height,
        };
        scene.draw(CELL.0, CELL.1)
    }
}

impl Album {
    /// Draws rows of frames, with the row titles on the left and the titles in `columns` above.
    pub(crate) fn sheet(
        &self,
        name: &str,
        (engine, head): (&Engine, &Head),
        columns: &[String],
        rows: &[Row],
    ) -> Result<String> {
        let left = |column: usize| NAMES + column * (CELL.0 + GAP);
        let top = |row: usize| letters::LINE + 8 + row * (CELL.1 + GAP);
        let mut sheet = Picture::white(left(columns.len()), top(rows.len()));
        for (column, title) in columns.iter().enumerate() {
            let free = CELL.0.saturating_sub(letters::width(title));
            letters::write(&mut sheet, title, left(column) + free / 2, 4);
        }
        for (k, row) in rows.iter().enumerate() {
            let middle = top(k) + (CELL.1 - letters::LINE) / 2;
            letters::write(&mut sheet, &row.title, 6, middle);
            for (column, frame) in head.frames(engine, &row.motion)?.iter().enumerate() {
                sheet.place(frame, left(column), top(k));
            }
        }
        self.picture(name, &sheet)
    }
}

/// Rotates a point about the vertical axis by `YAW`.
fn turned(p: [f32; 3]) -> [f32; 3] {
    let (sin, cos) = YAW.sin_cos();
    [cos * p[0] + sin * p[2], p[1], cos * p[2] - sin * p[0]]
}

/// Colours of the materials by name, from `newmtl` and `Kd` lines.
fn materials(text: &str) -> HashMap<String, [f32; 3]> {
    let mut out = HashMap::new();
    let mut name = String::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["newmtl", new] => name = new.into(),
            ["Kd", r, g, b] => {
                let colour = [r, g, b].map(|word| word.parse().unwrap_or(0.5));
                out.insert(name.clone(), colour);
            }
            _ => {}
        }
    }
    out
}

/// The colour of every face of an OBJ file of triangles.
fn colours(text: &str, materials: &HashMap<String, [f32; 3]>) -> Vec<[f32; 3]> {
    let mut colour = [0.5; 3];
    let mut out = Vec::new();
    for line in text.lines() {
        match line.split_once(' ') {
            Some(("usemtl", name)) => {
                colour = materials.get(name.trim()).copied().unwrap_or([0.5; 3]);
            }
            Some(("f", _)) => out.push(colour),
            _ => {}
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_take_the_colour_that_was_named_last() {
        let known = materials("newmtl skin\nKd 0.7 0.5 0.4\n\nnewmtl lips\nKd 0.6 0.3 0.2\n");
        let result = colours(
            "usemtl skin\nf 1 2 3\nf 1 3 4\nusemtl lips\nf 2 3 4\n",
            &known,
        );
        assert_eq!(result, [[0.7, 0.5, 0.4], [0.7, 0.5, 0.4], [0.6, 0.3, 0.2]]);
    }

    #[test]
    fn turning_keeps_lengths_and_height() {
        let p = turned([0.03, 0.05, 0.09]);
        let length = |p: [f32; 3]| p.iter().map(|x| x * x).sum::<f32>();
        assert!((length(p) - length([0.03, 0.05, 0.09])).abs() < 1e-7);
        assert_eq!(p[1], 0.05);
    }
}
