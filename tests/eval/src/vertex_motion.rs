//! How motion moves the vertices of a mesh.

use anyface::{
    Engine, Face, Result,
    job::SILENT,
    mesh::Mesh,
    spread::{Collector, Movement},
};
use ndarray::{Array3, ArrayView2};

/// Displacements of the vertices of a face under a motion, `[T, V, 3]`, mesh units.
pub(super) fn vertex_motion<'a>(
    engine: &Engine,
    face: &Face,
    movement: impl Into<Movement<'a>>,
) -> Result<Array3<f32>> {
    let animation = Collector::collect(|sink| engine.spread(face, movement, sink, SILENT))?;
    Ok(animation.vertices.displacements)
}

/// The same under motion `[T, 68, 3]` of the mesh's own landmarks.
pub(super) fn spread_landmarks(
    engine: &Engine,
    face: &Face,
    landmarks: Array3<f32>,
) -> Result<Array3<f32>> {
    let fps = 1.0;
    vertex_motion(engine, face, Movement::Own { landmarks, fps })
}

/// The mesh, moved by the displacements `[V, 3]` of one frame.
pub(super) fn pose(mesh: &Mesh, frame: ArrayView2<'_, f32>) -> Mesh {
    let mut posed = mesh.clone();
    for (point, offset) in posed.positions.iter_mut().zip(frame.rows()) {
        (0..3).for_each(|i| point[i] += offset[i]);
    }
    posed
}

pub(super) fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt()
}

/// Normal of a triangle, as long as twice its area.
pub(super) fn normal([a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    let [u, v]: [[f32; 3]; 2] = [b, c].map(|p| std::array::from_fn(|i| p[i] - a[i]));
    [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ]
}

/// Dot product.
pub(super) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| a[i] * b[i]).sum()
}
