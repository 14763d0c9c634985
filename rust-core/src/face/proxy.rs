//! A proxy of the skin for per-mesh work, and the map from it to the full skin.
//!
//! Operators, plate weights and the learned correction cost time for every vertex, yet their
//! results are smooth. So on a scan of a million triangles they are solved on about ten thousand
//! vertices, and [`Prolongation`] carries them to the rest. Edges of the proxy are shortest at the
//! lips and lids, where weights change fastest, and grow with the distance from them. Every
//! landmark is a vertex, and a mesh too coarse for the plate gets finer triangles for the solve
//! (`refine`). The proxy comes from collapsing edges, and every vertex looks for its place on it
//! only around the vertex into which it was collapsed. That keeps the lips separate.
//!
//! Lengths are canonical centimetres.

mod prolongation;
mod refine;

use glam::{DVec3, Vec3};
pub use prolongation::Prolongation;
use prolongation::place_vertices;
use rayon::prelude::*;
use refine::Refined;

use crate::mesh::{
    Mesh,
    ibug::LANDMARKS,
    simplify::{SimplifyOptions, simplify},
};

/// The proxy lies at most this far from the skin, centimetres.
const ERROR_CM: f64 = 0.05;
/// Landmarks around which the proxy is finest: lids and lips.
const FINE: std::ops::Range<usize> = 36..68;
/// Edge length at the lips and lids, and at other landmarks, relative to each other.
const EDGE_CM: [f32; 2] = [0.1, 0.2];
/// Growth of the edge length with the distance from a landmark.
const GROWTH: f32 = 0.1;
/// An edge of a coarse skin is split where it is this many times longer than [`target_edge`].
const LONG: f32 = 2.0;

/// The version of the skin on which the solve works.
#[derive(Debug, Clone)]
pub struct Proxy {
    /// Triangles of the proxy. Positions are those of the whole mesh, then those that were added.
    pub mesh: Mesh,
    /// Carries values from the proxy's vertices to all vertices of the skin.
    pub prolongation: Prolongation,
    /// Largest distance of a skin vertex from the proxy, centimetres.
    pub error_cm: f32,
}

impl Proxy {
    /// Reduces the skin to `vertices` vertices, or adds up to that many where the skin has long
    /// edges. The landmarks become vertices.
    ///
    /// # Shapes
    /// `positions`: `[V]`. `triangles`: of the skin, seams sewn up. `landmarks`: of the neutral
    /// face. `anchors`: on entry the vertex nearest to each landmark, on return the landmark's own
    /// vertex.
    pub fn build(
        positions: &[[f32; 3]],
        triangles: &[[u32; 3]],
        landmarks: &[[f32; 3]; LANDMARKS],
        anchors: &mut [u32; LANDMARKS],
        vertices: usize,
    ) -> Proxy {
        let exact = positions.iter().map(|&p| Vec3::from(p).as_dvec3());
        let mut skin = Refined::new(exact.collect(), triangles.to_vec());
        skin.add_landmarks(landmarks, anchors);
        let edge_length = |p: DVec3| target_edge(p.as_vec3(), landmarks);
        let least = f64::from(LONG * EDGE_CM[0]);
        skin.split_long(least, |p| f64::from(LONG * edge_length(p)), vertices);
        let (positions, triangles) = (skin.positions, skin.triangles);
        let mut locked = vec![false; positions.len()];
        anchors.iter().for_each(|&v| locked[v as usize] = true);
        let edge_lengths: Vec<f32> = positions.par_iter().map(|&p| edge_length(p)).collect();
        let options = SimplifyOptions {
            vertices,
            error: ERROR_CM,
        };
        let simple = simplify(&positions, &triangles, &edge_lengths, &locked, &options);
        let (prolongation, error) = place_vertices(&positions, &triangles, &simple);
        Proxy {
            mesh: Mesh {
                positions: positions.iter().map(|p| p.as_vec3().into()).collect(),
                triangles: simple.triangles,
            },
            prolongation,
            error_cm: error as f32,
        }
    }
}

/// Requested edge length at a place, up to a common factor.
fn target_edge(here: Vec3, landmarks: &[[f32; 3]; LANDMARKS]) -> f32 {
    let of = |(n, &landmark): (usize, &[f32; 3])| {
        let edge = EDGE_CM[usize::from(!FINE.contains(&n))];
        edge + GROWTH * here.distance(landmark.into())
    };
    landmarks
        .iter()
        .enumerate()
        .map(of)
        .fold(f32::INFINITY, f32::min)
}

#[cfg(test)]
mod tests;
