//! Compares the same motion on the same head in several triangulations.

use std::collections::HashMap;

use ndarray::{Array3, Axis};
use serde_json::{Value, json};

use crate::arguments::SharedArgs;
use crate::metrics::quantile;
use crate::vertex_motion::vertex_motion;
use anyface::{
    MotionRequest, Result,
    audio::Waveform,
    face::{FaceOptions, locate_landmarks},
    job::SILENT,
    mesh::{
        LandmarkSource, Mesh,
        simplify::{SimplifyOptions, simplify},
    },
};

/// Numbers of vertices of the coarser triangulations.
const SIZES: [usize; 3] = [1_000, 4_000, 12_000];
/// The finest triangulation cuts each triangle in four, as often as the number of vertices stays
/// below this.
const FINEST: usize = 450_000;

/// Differences over all frames and all vertices that every triangulation has.
pub(super) struct Spread {
    vertices: Vec<usize>,
    /// For each pair of triangulations: their indices, then the 95 % quantile and the largest of
    /// the differences, mm on a human head.
    pairs: Vec<(usize, usize, f64, f64)>,
    /// The largest displacement of these vertices on the coarsest triangulation.
    largest_motion_mm: f64,
}

/// Animates every triangulation and compares the results.
pub(super) fn measure(
    shared: &SharedArgs,
    mesh: &Mesh,
    waveform: &Waveform,
    options: &FaceOptions,
) -> Result<Spread> {
    let engine = shared.engine()?;
    let performance = engine.perform(waveform, &MotionRequest::default(), SILENT)?;
    let landmarks = locate_landmarks(mesh, options)?;
    let (meshes, common) = triangulations(mesh);
    let known = FaceOptions {
        landmarks: Some(LandmarkSource::Positions(landmarks.positions.to_vec())),
        ..options.clone()
    };
    let mut results = Vec::new();
    let mut to_mm = 1000.0;
    for (mesh, shared_vertices) in meshes.iter().zip(&common) {
        let face = engine.prepare(mesh, &known, SILENT)?;
        to_mm = 1000.0 * face.to_canonical.scale as f32;
        let moved = vertex_motion(&engine, &face, &performance.motion)?;
        results.push(at(&moved, shared_vertices));
    }
    let mut pairs = Vec::new();
    for a in 0..results.len() {
        for b in a + 1..results.len() {
            let differences = distances(&results[a], &results[b], to_mm);
            let most = differences.iter().copied().fold(0.0, f64::max);
            pairs.push((a, b, quantile(&differences, 0.95), most));
        }
    }
    let rest = Array3::zeros(results[0].dim());
    let largest = distances(&results[0], &rest, to_mm)
        .into_iter()
        .fold(0.0, f64::max);
    Ok(Spread {
        vertices: meshes.iter().map(|mesh| mesh.positions.len()).collect(),
        pairs,
        largest_motion_mm: largest,
    })
}

fn at(moved: &Array3<f32>, vertices: &[u32]) -> Array3<f32> {
    let vertices: Vec<usize> = vertices.iter().map(|v| *v as usize).collect();
    moved.select(Axis(1), &vertices)
}

fn distances(a: &Array3<f32>, b: &Array3<f32>, to_mm: f32) -> Vec<f64> {
    let difference = a - b;
    let rows = difference.rows().into_iter();
    rows.map(|d| f64::from(to_mm * d.dot(&d).sqrt())).collect()
}

/// The coarser triangulations, the mesh itself and a finer one. For each of them also the indices
/// of the vertices that all of them share.
fn triangulations(mesh: &Mesh) -> (Vec<Mesh>, Vec<Vec<u32>>) {
    let mut coarser: Vec<(Mesh, Vec<u32>)> = SIZES
        .iter()
        .filter(|size| **size < mesh.positions.len())
        .map(|&size| down_to(mesh, size))
        .collect();
    let indices: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    coarser.push((mesh.clone(), indices.clone()));
    let mut fine = mesh.clone();
    while 4 * fine.positions.len() < FINEST {
        fine = fine.cut_in_four();
    }
    coarser.push((fine, indices));
    let places: Vec<HashMap<u32, u32>> = coarser
        .iter()
        .map(|(_, original)| original.iter().copied().zip(0..).collect())
        .collect();
    let shared: Vec<u32> = (coarser[0].1.iter().copied())
        .filter(|v| places.iter().all(|place| place.contains_key(v)))
        .collect();
    let common = places
        .iter()
        .map(|place| shared.iter().map(|v| place[v]).collect())
        .collect();
    (coarser.into_iter().map(|(mesh, _)| mesh).collect(), common)
}

/// A coarser mesh and the original index of each of its vertices. It deliberately does not preserve
/// landmarks, since an artist's mesh has no vertices exactly there.
fn down_to(mesh: &Mesh, vertices: usize) -> (Mesh, Vec<u32>) {
    let exact: Vec<_> = (0..mesh.positions.len() as u32)
        .map(|v| mesh.point(v))
        .collect();
    let weights = vec![1.0; exact.len()];
    let options = SimplifyOptions {
        vertices,
        error: f64::INFINITY,
    };
    let locked = vec![false; exact.len()];
    let simple = simplify(&exact, &mesh.triangles, &weights, &locked, &options);
    let mut original: Vec<u32> = simple.triangles.iter().flatten().copied().collect();
    original.sort_unstable();
    original.dedup();
    let of: HashMap<u32, u32> = original.iter().copied().zip(0..).collect();
    let coarse = Mesh {
        positions: original
            .iter()
            .map(|&v| mesh.positions[v as usize])
            .collect(),
        triangles: simple.triangles.iter().map(|t| t.map(|v| of[&v])).collect(),
    };
    (coarse, original)
}

pub(super) fn json(spread: &Spread) -> Value {
    let pairs: Vec<Value> = spread
        .pairs
        .iter()
        .map(|(a, b, p95, most)| {
            json!({"vertices": [spread.vertices[*a], spread.vertices[*b]],
                   "p95_mm": p95, "largest_mm": most})
        })
        .collect();
    json!({"largest_motion_mm": spread.largest_motion_mm, "pairs": pairs})
}

pub(super) fn text(spread: &Spread) -> String {
    let mut text = format!(
        "largest motion {:.1} mm; difference between triangulations, mm\n{:>10}{:>10}{:>10}{:>10}\n",
        spread.largest_motion_mm, "vertices", "vertices", "95 %", "largest"
    );
    for (a, b, p95, most) in &spread.pairs {
        let (a, b) = (spread.vertices[*a], spread.vertices[*b]);
        text += &format!("{a:>10}{b:>10}{p95:>10.3}{most:>10.3}\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangulations_share_vertices_at_the_same_places() {
        let side = 72;
        let height = |x: u32, y: u32| (0.3 * x as f32).sin() * (0.2 * y as f32).cos();
        let positions = (0..side * side)
            .map(|v| [v % side, v / side])
            .map(|[x, y]| [x as f32, y as f32, height(x, y)])
            .collect();
        let triangles = (0..side - 1)
            .flat_map(|y| (0..side - 1).map(move |x| y * side + x))
            .flat_map(|v| [[v, v + 1, v + side], [v + 1, v + side + 1, v + side]])
            .collect();
        let mesh = Mesh {
            positions,
            triangles,
        };
        let (meshes, common) = triangulations(&mesh);
        assert_eq!(meshes.len(), 4, "1,000, 4,000, itself and a finer one");
        assert!(common[0].len() > 500, "{}", common[0].len());
        for (mesh, vertices) in meshes.iter().zip(&common) {
            let here = vertices.iter().map(|v| mesh.positions[*v as usize]);
            let there = common[0].iter().map(|v| meshes[0].positions[*v as usize]);
            assert!(here.eq(there));
        }
    }
}
