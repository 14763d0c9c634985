//! What a template's skin does between its landmarks, on another mesh.
//!
//! The landmarks of a template move a mesh as those of any motion do. Of what they cannot tell, such as
//! puffed cheeks, the template knows a few shapes; the points of its surface are bent onto the mesh and carry
//! these there, on the same side of lips and lids, fading where the template ends.

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

use crate::{
    Result,
    cache::{Arrays, Cache},
    deform::{FollowingFace, ReferencePoints},
    face::Face,
    motion::Template,
    nn::matrix,
};

const DM_PER_M: f32 = 10.0;
/// Vertices of one piece of parallel work.
const VERTICES_PER_TASK: usize = 512;

/// The shapes of a template on one mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Between {
    /// `[3 V, K]`, mesh units and axes of a metre on the template.
    shapes: Array2<f32>,
}

impl Between {
    /// Carries the shapes of `template` to a face at `strength`; kept in `cache`.
    ///
    /// # Errors
    /// `Mesh` if the landmarks of the face lie on no usable face.
    pub fn of(face: &Face, template: &Template, strength: f32, cache: &Cache) -> Result<Between> {
        let vertices = face.mesh.positions.len();
        let key = face
            .cache_key()
            .text("between")
            .f32s(template.mesh.positions.as_flattened())
            .f32s(&template.between)
            .f32s(&[strength]);
        let encode = |made: &Between| {
            let mut arrays = Arrays::default();
            let values = made.shapes.iter().copied().collect();
            arrays.insert_f32("shapes", made.shapes.shape(), values);
            arrays
        };
        let decode = |mut arrays: Arrays| {
            let (shape, values) = arrays.take_f32("shapes")?;
            let fits = shape == [3 * vertices, template.shapes()];
            let shapes = Array2::from_shape_vec((3 * vertices, template.shapes()), values);
            fits.then_some(Between {
                shapes: shapes.ok()?,
            })
        };
        cache.get_or_make(&key, decode, encode, || {
            Self::carry(face, template, strength)
        })
    }

    fn carry(face: &Face, template: &Template, strength: f32) -> Result<Between> {
        let (back, count) = (face.to_canonical.inverse(), template.shapes());
        let to_mesh = strength * back.scale as f32;
        let canonical = on_face(face, template, template.between.view())?;
        let mut shapes = Array2::zeros((3 * face.mesh.positions.len(), count));
        for (v, row) in canonical.outer_iter().enumerate() {
            for k in 0..count {
                let own = back.rotate([0, 1, 2].map(|axis| row[axis * count + k]));
                (0..3).for_each(|axis| shapes[[3 * v + axis, k]] = to_mesh * own[axis]);
            }
        }
        Ok(Between { shapes })
    }

    /// The same of some vertices alone.
    pub fn of_vertices(&self, vertices: &[usize]) -> Between {
        let rows: Vec<usize> = vertices.iter().flat_map(|&v| 3 * v..3 * v + 3).collect();
        Between {
            shapes: self.shapes.select(ndarray::Axis(0), &rows),
        }
    }

    /// Adds what the shapes do at `weights` `[T, K]`, metres, to displacements `[T, V, 3]`.
    pub fn add(&self, weights: ArrayView2<'_, f32>, moved: &mut ndarray::Array3<f32>) {
        let (frames, size) = (weights.nrows(), self.shapes.nrows());
        if frames == 0 || size == 0 || weights.is_empty() {
            return;
        }
        let weights = weights.as_standard_layout();
        let weights = matrix::rows_of(
            weights.as_slice().expect("standard layout"),
            weights.ncols(),
        );
        let out = moved
            .as_slice_mut()
            .expect("decoders give row-major frames");
        let mut blocks: Vec<Vec<&mut [f32]>> = Vec::new();
        let task = 3 * VERTICES_PER_TASK;
        blocks.resize_with(size.div_ceil(task), Vec::new);
        for frame in out.chunks_mut(size) {
            let pieces = frame.chunks_mut(task);
            blocks.iter_mut().zip(pieces).for_each(|(b, p)| b.push(p));
        }
        blocks
            .into_par_iter()
            .enumerate()
            .for_each(|(index, mut out)| {
                let (first, rows) = (index * task, out[0].len());
                let mut tile = vec![0.0; frames * rows];
                let shapes = matrix::view(&self.shapes).subrows(first, rows);
                matrix::product(
                    matrix::view_mut(&mut tile, rows),
                    weights,
                    shapes.transpose(),
                );
                for (to, from) in out.iter_mut().zip(tile.chunks_exact(rows)) {
                    to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
                }
            });
    }
}

/// A field over a template's vertices, `[V', C]`, on the vertices of a face, `[V, C]`; 0 where they follow none
/// of its skin.
///
/// # Errors
/// `Mesh` if the landmarks of the face lie on no usable face.
pub fn on_face(
    face: &Face,
    template: &Template,
    field: ArrayView2<'_, f32>,
) -> Result<Array2<f32>> {
    let surface = face.surface()?;
    let (positions, landmarks) = surface.decimetres();
    let decimetres = |p: [f32; 3]| p.map(|x| DM_PER_M * x);
    let points = template.mesh.positions.iter().copied();
    let reference = ReferencePoints {
        points: points.map(decimetres).collect(),
        normals: template.mesh.vertex_normals(),
        landmarks: template.landmark_positions().map(decimetres),
    };
    let rows = reference
        .carried_to(FollowingFace {
            positions: &positions,
            triangles: &surface.skin.operators.triangles,
            landmarks: &landmarks,
        })
        .of(field);
    let mut out = Array2::zeros((face.mesh.positions.len(), field.ncols()));
    let vertices = out.outer_iter_mut().into_par_iter().enumerate();
    vertices.for_each(|(v, mut out)| {
        for (row, share) in surface.rows_followed(v) {
            out.scaled_add(share, &rows.row(row));
        }
    });
    Ok(out)
}
