//! The pictures of one mesh, seen upright in the canonical frame.

use ndarray::{ArrayView2, ArrayView3, Axis};

use super::Truth;
use crate::pictures::raster::{Picture, Scene};
use anyface::{Face, mesh::Mesh};

const CELL: (usize, usize) = (150, 180);
const GAP: usize = 3;
/// Canonical metres of half a picture's height, and its middle in view space.
const HALF_HEIGHT_M: f32 = 0.135;
const MIDDLE_M: [f32; 2] = [-0.022, -0.015];
/// The head turns this far, radians.
const YAW: f32 = 0.3;
const SKIN: [f32; 3] = [0.55, 0.5, 0.47];
const HOT: [f32; 3] = [0.8, 0.03, 0.02];
/// A vertex that truly moves less is not counted, millimetres.
const LEAST_MOTION_MM: f32 = 0.5;
/// Half the side of a landmark's mark, pixels.
const MARK: isize = 1;

pub(super) struct Cells<'a> {
    pub mesh: &'a Mesh,
    pub face: &'a Face,
}

impl Cells<'_> {
    /// Landmarks, the frames `[E, V, 3]`, and `map` `[V]`, red from `scale` on.
    pub(super) fn row(&self, moved: ArrayView3<'_, f32>, map: &[f32], scale: f32) -> Picture {
        let plain = vec![SKIN; self.mesh.triangles.len()];
        let mut cells = vec![self.neutral(&plain)];
        for frame in moved.axis_iter(Axis(0)) {
            cells.push(self.draw(Some(frame), &plain));
        }
        let colours: Vec<_> = self
            .mesh
            .triangles
            .iter()
            .map(|t| heat(t, map, scale))
            .collect();
        cells.push(self.draw(None, &colours));
        let width = cells.len() * (CELL.0 + GAP);
        let mut row = Picture::white(width, CELL.1);
        for (k, cell) in cells.iter().enumerate() {
            row.place(cell, k * (CELL.0 + GAP), 0);
        }
        row
    }

    fn neutral(&self, colours: &[[f32; 3]]) -> Picture {
        let mut picture = self.draw(None, colours);
        let pixels = 0.5 * CELL.1 as f32 / HALF_HEIGHT_M;
        for landmark in self.face.landmarks.positions {
            let [x, y, _] = self.seen(landmark);
            let column = (0.5 * CELL.0 as f32 + (x - MIDDLE_M[0]) * pixels) as isize;
            let row = (0.5 * CELL.1 as f32 - (y - MIDDLE_M[1]) * pixels) as isize;
            for (dx, dy) in (-MARK..=MARK).flat_map(|x| (-MARK..=MARK).map(move |y| (x, y))) {
                if let (Ok(x), Ok(y)) = ((column + dx).try_into(), (row + dy).try_into()) {
                    picture.darken(x, y, 0.85);
                }
            }
        }
        picture
    }

    /// A point of the mesh in the picture's space.
    fn seen(&self, point: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.face.to_canonical.apply(point);
        let (sin, cos) = YAW.sin_cos();
        // The face lies some centimetres before the axis: keeps it in the middle.
        [cos * x + sin * (z - 0.09), y, cos * z - sin * x]
    }

    fn draw(&self, moved: Option<ArrayView2<'_, f32>>, colours: &[[f32; 3]]) -> Picture {
        let mut mesh = self.mesh.clone();
        for (v, point) in mesh.positions.iter_mut().enumerate() {
            let offset = |i: usize| moved.as_ref().map_or(0.0, |m| m[[v, i]]);
            *point = self.seen(std::array::from_fn(|i| point[i] + offset(i)));
        }
        let scene = Scene {
            normals: &mesh.vertex_normals(),
            points: &mesh.positions,
            triangles: &mesh.triangles,
            colours,
            centre: MIDDLE_M,
            half_height: HALF_HEIGHT_M,
        };
        scene.draw(CELL.0, CELL.1)
    }
}

fn heat(corners: &[u32; 3], map: &[f32], scale: f32) -> [f32; 3] {
    let mean = corners.iter().map(|&v| map[v as usize]).sum::<f32>() / 3.0;
    let share = (mean / scale).clamp(0.0, 1.0);
    std::array::from_fn(|i| SKIN[i] + share * (HOT[i] - SKIN[i]))
}

pub(super) struct Errors {
    /// `[V]`, largest over the frames, millimetres.
    pub worst_of_vertex: Vec<f32>,
    /// Mean over the vertices that truly move, one a frame.
    pub means: Vec<f32>,
}

/// Distance from the truth. `moved`: `[E, V, 3]`, mesh units.
pub(super) fn error_mm(truth: &Truth, moved: ArrayView3<'_, f32>) -> Errors {
    let mut errors = Errors {
        worst_of_vertex: vec![0.0; moved.dim().1],
        means: Vec::new(),
    };
    for (made, real) in moved.outer_iter().zip(truth.displacements.outer_iter()) {
        let (mut sum, mut count) = (0.0, 0);
        for (v, (made, real)) in made.rows().into_iter().zip(real.rows()).enumerate() {
            let squared =
                |value: &dyn Fn(usize) -> f32| (0..3).map(|i| value(i).powi(2)).sum::<f32>();
            let error = truth.mm * squared(&|i| made[i] - real[i]).sqrt();
            let motion = truth.mm * squared(&|i| real[i]).sqrt();
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

/// `[F]`, the largest |ln| of an area's ratio to that of the neutral face. `moved`: `[E, V, 3]`.
pub(super) fn stretch(mesh: &Mesh, moved: ArrayView3<'_, f32>) -> Vec<f32> {
    let areas = |mesh: &Mesh| mesh.face_areas().into_iter().map(|area| area as f32);
    let neutral: Vec<f32> = areas(mesh).collect();
    let typical = neutral.iter().sum::<f32>() / neutral.len().max(1) as f32;
    let mut worst = vec![0.0f32; neutral.len()];
    for frame in moved.outer_iter() {
        let mut posed = mesh.clone();
        for (point, offset) in posed.positions.iter_mut().zip(frame.rows()) {
            (0..3).for_each(|i| point[i] += offset[i]);
        }
        // A thousandth of a typical area keeps slivers out of it.
        let least = 1e-3 * typical.max(f32::MIN_POSITIVE);
        for ((worst, now), before) in worst.iter_mut().zip(areas(&posed)).zip(&neutral) {
            *worst = worst.max(((now + least) / (before + least)).ln().abs());
        }
    }
    worst
}

/// `[V]`, the largest of the triangles around.
pub(super) fn at_vertices(mesh: &Mesh, of_triangles: &[f32]) -> Vec<f32> {
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
        let found = stretch(&mesh, moved.view())[0];
        assert!((found - 2f32.ln()).abs() < 1e-2, "{found}");
        assert_eq!(at_vertices(&mesh, &[found]), [found; 3]);
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
