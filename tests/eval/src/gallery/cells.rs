//! Draws the pictures of one mesh, upright in the canonical frame.

use std::ops::Range;

use ndarray::{ArrayView2, ArrayView3, Axis};

use super::Truth;
use crate::{
    pictures::raster::{Picture, Scene},
    vertex_motion::{distance, pose},
};
use anyface::{
    Face,
    mesh::{Mesh, PartRole},
};

const GAP: usize = 3;
const SKIN: [f32; 3] = [0.55, 0.5, 0.47];
const EYEBALL: [f32; 3] = [0.82, 0.86, 0.95];
const TOOTH: [f32; 3] = [0.93, 0.91, 0.85];
const TONGUE: [f32; 3] = [0.72, 0.22, 0.24];
const LINING: [f32; 3] = [0.42, 0.16, 0.15];
const HOT: [f32; 3] = [0.8, 0.03, 0.02];
/// The mean error leaves out vertices whose true motion is no more than this, millimetres.
const LEAST_MOTION_MM: f32 = 0.5;
/// Half the side of a landmark's mark, pixels.
const MARK: isize = 1;

/// The viewpoint of a cell.
#[derive(Clone, Copy)]
pub(crate) struct View {
    /// Pixels.
    pub size: (usize, usize),
    /// Half the picture's height, and its middle in view space, both in canonical metres.
    pub half_height_m: f32,
    pub middle_m: [f32; 2],
    /// The head turns this far, radians.
    pub yaw: f32,
}

impl View {
    /// The whole face, turned a little.
    const FACE: View = View {
        size: (150, 180),
        half_height_m: 0.135,
        middle_m: [-0.022, -0.015],
        yaw: 0.3,
    };

    /// A close-up of some landmarks from the front. `metres` is half the picture's height.
    pub(crate) fn about(
        face: &Face,
        marks: Range<usize>,
        size: (usize, usize),
        metres: f32,
    ) -> View {
        let view = View {
            size,
            half_height_m: metres,
            middle_m: [0.0; 2],
            yaw: 0.0,
        };
        view.turned(face, marks, 0.0)
    }

    /// The same view with the head turned by `yaw` radians, centred on the landmarks `marks`.
    pub(crate) fn turned(self, face: &Face, marks: Range<usize>, yaw: f32) -> View {
        let view = View { yaw, ..self };
        let count = marks.len() as f32;
        let marks = &face.landmarks.positions[marks];
        let positions_in_view = marks.iter().map(|p| view.project(face, *p));
        let middle_m = positions_in_view.fold([0.0; 2], |sum, [x, y, _]| {
            [sum[0] + x / count, sum[1] + y / count]
        });
        View { middle_m, ..view }
    }

    /// Transforms a point of the mesh to view space: metres, x right, y up, z towards the viewer.
    fn project(&self, face: &Face, point: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = face.to_canonical.apply(point);
        let (sin, cos) = self.yaw.sin_cos();
        // The face lies some centimetres in front of the axis. The offset keeps it in the middle.
        [cos * x + sin * (z - 0.09), y, cos * z - sin * x]
    }
}

pub(crate) struct Cells<'a> {
    pub mesh: &'a Mesh,
    pub face: &'a Face,
    /// Numbers of its vertices, where they are known.
    pub tongue: Range<usize>,
}

/// Places pictures next to one another in a row.
pub(crate) fn beside(cells: &[Picture]) -> Picture {
    let width: usize = cells.iter().map(|cell| cell.width + GAP).sum();
    let height = cells.iter().map(|cell| cell.height).max().unwrap_or(0);
    let mut row = Picture::white(width, height);
    let mut left = 0;
    for cell in cells {
        row.place(cell, left, 0);
        left += cell.width + GAP;
    }
    row
}

/// Places rows below one another.
pub(crate) fn under(rows: &[Picture]) -> Picture {
    let width = rows.iter().map(|row| row.width).max().unwrap_or(0);
    let mut whole = Picture::white(width, rows.iter().map(|row| row.height + GAP).sum());
    let mut top = 0;
    for row in rows {
        whole.place(row, 0, top);
        top += row.height + GAP;
    }
    whole
}

impl<'a> Cells<'a> {
    /// Of a mesh whose tongue is not known.
    pub(crate) fn new(mesh: &'a Mesh, face: &'a Face) -> Cells<'a> {
        Cells {
            mesh,
            face,
            tongue: 0..0,
        }
    }

    /// A row of pictures: the neutral face with its landmarks, each of the frames `[E, V, 3]`, and
    /// the values `map` `[V]` as colours, fully red from `scale` on.
    pub(crate) fn row(&self, moved: ArrayView3<'_, f32>, map: &[f32], scale: f32) -> Picture {
        let plain = vec![SKIN; self.mesh.triangles.len()];
        let mut cells = vec![self.neutral(&plain)];
        for frame in moved.axis_iter(Axis(0)) {
            cells.push(self.draw(Some(frame), &plain, &View::FACE));
        }
        let triangles = self.mesh.triangles.iter();
        let colours: Vec<_> = triangles.map(|t| heat(t, map, scale)).collect();
        cells.push(self.draw(None, &colours, &View::FACE));
        beside(&cells)
    }

    fn neutral(&self, colours: &[[f32; 3]]) -> Picture {
        let view = View::FACE;
        let mut picture = self.draw(None, colours, &view);
        let (width, height) = (view.size.0 as f32, view.size.1 as f32);
        let pixels = 0.5 * height / view.half_height_m;
        for landmark in self.face.landmarks.positions {
            let [x, y, _] = view.project(self.face, landmark);
            let column = (0.5 * width + (x - view.middle_m[0]) * pixels) as isize;
            let row = (0.5 * height - (y - view.middle_m[1]) * pixels) as isize;
            for (dx, dy) in (-MARK..=MARK).flat_map(|x| (-MARK..=MARK).map(move |y| (x, y))) {
                if let (Ok(x), Ok(y)) = ((column + dx).try_into(), (row + dy).try_into()) {
                    picture.darken(x, y, 0.85);
                }
            }
        }
        picture
    }

    /// Draws a frame `[V, 3]`, or the neutral face, with eyeballs, teeth, a known tongue and the mouth's lining in their
    /// own colours.
    pub(crate) fn close_up(&self, moved: Option<ArrayView2<'_, f32>>, view: &View) -> Picture {
        self.marked(moved, &[], view)
    }

    /// Like `close_up`, with some triangles in red.
    pub(crate) fn marked(
        &self,
        moved: Option<ArrayView2<'_, f32>>,
        marked: &[[u32; 3]],
        view: &View,
    ) -> Picture {
        let of = |t: &[u32; 3]| {
            if self.tongue.contains(&(t[0] as usize)) {
                return TONGUE;
            }
            let is = |role| self.face.parts.is(t[0] as usize, role);
            let roles = [
                (PartRole::Gaze, EYEBALL),
                (PartRole::Jaw, TOOTH),
                (PartRole::Skull, TOOTH),
                (PartRole::Mouth, LINING),
            ];
            let known = roles.into_iter().find(|(role, _)| is(*role));
            known.map_or(SKIN, |(_, colour)| colour)
        };
        let colour = |t| if marked.contains(t) { HOT } else { of(t) };
        let colours: Vec<_> = self.mesh.triangles.iter().map(colour).collect();
        self.draw(moved, &colours, view)
    }

    fn draw(
        &self,
        moved: Option<ArrayView2<'_, f32>>,
        colours: &[[f32; 3]],
        view: &View,
    ) -> Picture {
        let mut mesh = match moved {
            Some(frame) => pose(self.mesh, frame),
            None => self.mesh.clone(),
        };
        for point in &mut mesh.positions {
            *point = view.project(self.face, *point);
        }
        let scene = Scene {
            normals: &mesh.vertex_normals(),
            points: &mesh.positions,
            triangles: &mesh.triangles,
            colours,
            centre: view.middle_m,
            half_height: view.half_height_m,
        };
        scene.draw(view.size.0, view.size.1)
    }
}

fn heat(corners: &[u32; 3], map: &[f32], scale: f32) -> [f32; 3] {
    let mean = corners.iter().map(|&v| map[v as usize]).sum::<f32>() / 3.0;
    let share = (mean / scale).clamp(0.0, 1.0);
    std::array::from_fn(|i| SKIN[i] + share * (HOT[i] - SKIN[i]))
}

pub(crate) struct Errors {
    /// `[V]`, the largest error over the frames, millimetres.
    pub worst_of_vertex: Vec<f32>,
    /// The mean error of each frame over the vertices that truly move, millimetres.
    pub means: Vec<f32>,
}

/// The distances of `moved` `[E, V, 3]`, mesh units, from the truth.
pub(crate) fn error_mm(truth: &Truth, moved: ArrayView3<'_, f32>) -> Errors {
    let mut errors = Errors {
        worst_of_vertex: vec![0.0; moved.dim().1],
        means: Vec::new(),
    };
    for (predicted, real) in moved.outer_iter().zip(truth.displacements.outer_iter()) {
        let (mut sum, mut count) = (0.0, 0);
        for (v, (predicted, real)) in predicted.rows().into_iter().zip(real.rows()).enumerate() {
            let [predicted, real] = [predicted, real].map(|row| [0, 1, 2].map(|i| row[i]));
            let error = truth.mm * distance(predicted, real);
            let motion = truth.mm * distance(real, [0.0; 3]);
            errors.worst_of_vertex[v] = errors.worst_of_vertex[v].max(error);
            if motion > LEAST_MOTION_MM {
                sum += error;
                count += 1;
            }
        }
        errors.means.push(sum / count.max(1) as f32);
    }
    errors
}

/// `[F]`, the largest |ln| over the frames of the ratio of a triangle's area to its neutral area.
/// `moved` is `[E, V, 3]`.
pub(crate) fn stretch(mesh: &Mesh, moved: ArrayView3<'_, f32>) -> Vec<f32> {
    let areas = |mesh: &Mesh| mesh.face_areas().into_iter().map(|area| area as f32);
    let neutral: Vec<f32> = areas(mesh).collect();
    let typical = neutral.iter().sum::<f32>() / neutral.len().max(1) as f32;
    let mut worst = vec![0.0f32; neutral.len()];
    for frame in moved.outer_iter() {
        let posed = pose(mesh, frame);
        // Adding a thousandth of the mean area keeps slivers from dominating.
        let least = 1e-3 * typical.max(f32::MIN_POSITIVE);
        for ((worst, now), before) in worst.iter_mut().zip(areas(&posed)).zip(&neutral) {
            *worst = worst.max(((now + least) / (before + least)).ln().abs());
        }
    }
    worst
}

/// `[V]`, the largest value of the triangles around each vertex.
pub(crate) fn at_vertices(mesh: &Mesh, of_triangles: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0f32; mesh.positions.len()];
    for (corners, value) in mesh.triangles.iter().zip(of_triangles) {
        for &v in corners {
            out[v as usize] = out[v as usize].max(*value);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn stretch_is_the_logarithm_of_the_area_and_zero_at_rest() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2]],
        };
        let mut moved = Array3::zeros((2, 3, 3));
        assert_eq!(stretch(&mesh, moved.view()), [0.0]);
        moved[[1, 1, 0]] = 1.0;
        let value = stretch(&mesh, moved.view())[0];
        assert!((value - 2f32.ln()).abs() < 1e-2, "{value}");
        assert_eq!(at_vertices(&mesh, &[value]), [value; 3]);
    }

    #[test]
    fn errors_count_what_truly_moves() {
        let mut displacements = Array3::zeros((1, 2, 3));
        displacements[[0, 0, 1]] = 0.2;
        let truth = Truth {
            displacements,
            landmarks: [0; 68],
            mm: 10.0,
        };
        let errors = error_mm(&truth, Array3::zeros((1, 2, 3)).view());
        assert!((errors.means[0] - 2.0).abs() < 1e-6);
        assert_eq!(errors.worst_of_vertex, [2.0, 0.0]);
    }
}
