//! Distances along the surface.
//!
//! The heat method, Crane, Weischedel and Wardetzky 2013: let heat flow for a short time, follow
//! its gradient at unit speed, integrate. It runs on the intrinsic Delaunay triangulation of the
//! tufted cover, so it copes with holes, needles and non-manifold edges. The time is the square of
//! the mean edge length. The result is smooth and a few per cent off near sources and the cut
//! locus.

use std::{cmp::Reverse, collections::BinaryHeap};

use rayon::prelude::*;

use super::{
    Operators,
    cholesky::SparseCholesky,
    intrinsic::{apex, area},
};
use crate::Result;

/// Relative size of the mass added to the singular Laplacian; errors stay near 1e-6.
const SHIFT: f64 = 1e-6;

/// Heat method that keeps its factorisations: build once, query often.
pub struct HeatGeodesics<'a> {
    operators: &'a Operators,
    heat: SparseCholesky,
    poisson: SparseCholesky,
}

impl<'a> HeatGeodesics<'a> {
    /// Factors the two systems.
    ///
    /// # Errors
    /// `Numerics` if a factorisation fails.
    pub fn new(operators: &'a Operators) -> Result<Self> {
        let lengths = &operators.cover.length;
        let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
        let mut heat = operators.laplacian.clone();
        heat.values.iter_mut().for_each(|v| *v *= mean * mean);
        let shift = SHIFT * 4.0 * std::f64::consts::PI / operators.area();
        let poisson = operators.laplacian.add_diagonal(shift, &operators.mass)?;
        let heat = heat.add_diagonal(1.0, &operators.mass)?;
        let (heat, poisson) = rayon::join(
            || SparseCholesky::factor(&heat),
            || SparseCholesky::factor(&poisson),
        );
        Ok(HeatGeodesics {
            operators,
            heat: heat?,
            poisson: poisson?,
        })
    }

    /// Distance of each row to the nearest of the rows `sources`. Returns `[R]`, mesh units,
    /// at least 0; infinite in connected parts without a source.
    ///
    /// # Panics
    /// If a source is not a row.
    pub fn distance_from(&self, sources: &[u32]) -> Vec<f64> {
        self.distances_from_each(&[sources]).remove(0)
    }

    /// [`HeatGeodesics::distance_from`] for several sets at once, which share the solves.
    /// Returns one `[R]` per set.
    ///
    /// # Panics
    /// If a source is not a row.
    pub fn distances_from_each<S: AsRef<[u32]> + Sync>(&self, sets: &[S]) -> Vec<Vec<f64>> {
        let rows = self.operators.rows();
        let mut field = vec![0.0; rows * sets.len()];
        for (column, set) in field.chunks_mut(rows).zip(sets) {
            for &source in set.as_ref() {
                column[source as usize] = 1.0;
            }
        }
        self.heat.solve_in_place(&mut field, sets.len());
        field
            .par_chunks_mut(rows)
            .for_each(|column| column.copy_from_slice(&divergence_of_flow(self.operators, column)));
        self.poisson.solve_in_place(&mut field, sets.len());
        let columns = field.chunks(rows).zip(sets);
        columns
            .map(|(c, set)| self.shifted_to(c, set.as_ref()))
            .collect()
    }

    /// Shifts each connected part so that its lowest source is at zero. All sources become zero.
    fn shifted_to(&self, potential: &[f64], sources: &[u32]) -> Vec<f64> {
        let parts = &self.operators.parts;
        let mut zero = vec![f64::INFINITY; parts.count];
        for &source in sources {
            let part = parts.of_vertex[source as usize] as usize;
            zero[part] = zero[part].min(potential[source as usize]);
        }
        let shift = |(row, &value): (usize, &f64)| match zero[parts.of_vertex[row] as usize] {
            f64::INFINITY => f64::INFINITY,
            zero => (value - zero).max(0.0),
        };
        let mut distance: Vec<f64> = potential.iter().enumerate().map(shift).collect();
        for &source in sources {
            distance[source as usize] = 0.0;
        }
        distance
    }
}

/// Integrated divergence of the unit field along falling heat, which is the right side of the
/// Poisson equation. It is halved because the cover counts everything twice.
fn divergence_of_flow(operators: &Operators, heat: &[f64]) -> Vec<f64> {
    let cover = &operators.cover;
    let mut divergence = vec![0.0; heat.len()];
    for f in 0..cover.triangle_count() {
        let corners = cover.corners(f);
        let [ab, bc, ca] = cover.lengths(f);
        let twice_area = 2.0 * area([ab, bc, ca]);
        if twice_area <= 0.0 {
            continue;
        }
        // Corners at (0, 0), (ab, 0) and `top`; gradient of each hat function, times twice the area.
        let top = apex(ab, bc, ca);
        let hats = [[-top[1], top[0] - ab], [top[1], -top[0]], [0.0, ab]];
        let u = corners.map(|v| heat[v as usize]);
        // Heat falls by hundreds of orders of magnitude: scale before squaring.
        let scale = u.iter().fold(0f64, |m, x| m.max(x.abs()));
        if scale == 0.0 {
            continue;
        }
        let along = |axis: usize| -> f64 { (0..3).map(|i| u[i] / scale * hats[i][axis]).sum() };
        let (gx, gy) = (along(0), along(1));
        let norm = gx.hypot(gy);
        if norm == 0.0 {
            continue;
        }
        for i in 0..3 {
            // ∫ ∇hat · X with X = −∇u/|∇u|; area / (2 area) = 1/2, halved for the two sheets.
            let flow = -(hats[i][0] * gx + hats[i][1] * gy) / norm;
            divergence[corners[i] as usize] += 0.25 * flow;
        }
    }
    divergence
}

/// Length of the shortest path along edges, and across pairs of triangles, to the nearest of
/// `sources` (Dijkstra). Cheaper than the heat method for a single query, but up to about ten per
/// cent too long. Returns `[R]`, mesh units; infinite where there is no path.
///
/// # Panics
/// If a source is not a row.
pub fn edge_distance(operators: &Operators, sources: &[u32]) -> Vec<f64> {
    let graph = &operators.laplacian;
    let mut distances = vec![f64::INFINITY; operators.rows()];
    let mut queue = BinaryHeap::new();
    for &source in sources {
        distances[source as usize] = 0.0;
        queue.push((Reverse(0u64), source));
    }
    // Bits of non-negative floats sort like the floats.
    while let Some((Reverse(bits), row)) = queue.pop() {
        let so_far = f64::from_bits(bits);
        if so_far > distances[row as usize] {
            continue;
        }
        for (other, _) in graph.row(row as usize).filter(|&(c, _)| c != row as usize) {
            let step = operators.positions[row as usize].distance(operators.positions[other]);
            if so_far + step < distances[other] {
                distances[other] = so_far + step;
                queue.push((Reverse((so_far + step).to_bits()), other as u32));
            }
        }
    }
    distances
}

#[cfg(test)]
mod tests {
    use super::super::{
        OperatorOptions,
        fixtures::{icosphere, joined, square},
    };
    use super::*;

    fn operators(mesh: &crate::mesh::Mesh) -> Operators {
        Operators::new(mesh, &OperatorOptions::default()).unwrap()
    }

    #[test]
    fn heat_distance_on_a_sphere_is_the_angle() {
        let mesh = icosphere(4);
        let ops = operators(&mesh);
        let distance = HeatGeodesics::new(&ops).unwrap().distance_from(&[0]);
        let source = mesh.point(0);
        for (v, d) in distance.iter().enumerate() {
            let p = mesh.point(v as u32);
            let angle = (p[0] * source[0] + p[1] * source[1] + p[2] * source[2])
                .clamp(-1.0, 1.0)
                .acos();
            assert!((d - angle).abs() < 0.06, "{v}: expected {angle}, got {d}");
        }
    }

    #[test]
    fn distances_on_a_square_are_straight() {
        let mesh = square(40);
        let ops = operators(&mesh);
        let middle = (20 * 41 + 20) as u32;
        let heat = HeatGeodesics::new(&ops).unwrap().distance_from(&[middle]);
        let edges = edge_distance(&ops, &[middle]);
        for v in 0..ops.rows() {
            let straight = ops.positions[v].distance(ops.positions[middle as usize]);
            assert!(
                (heat[v] - straight).abs() < 0.05 * 0.71,
                "heat {v}: {straight}, {}",
                heat[v]
            );
            assert!(
                edges[v] > straight - 1e-4 && edges[v] < 1.1 * straight + 1e-4,
                "edges {v}"
            );
        }
    }

    #[test]
    fn several_sources_give_the_nearest_and_other_parts_are_out_of_reach() {
        let mesh = joined(&square(20), &icosphere(1), [5.0; 3]);
        let ops = operators(&mesh);
        let corners = [0, 20, 20 * 21, 20 * 21 + 20];
        let solver = HeatGeodesics::new(&ops).unwrap();
        let all = solver.distances_from_each(&[vec![0], corners.to_vec()]);
        assert_eq!(all[1], solver.distance_from(&corners));
        for v in 0..21 * 21 {
            let p = ops.positions[v];
            let nearest = corners
                .iter()
                .map(|&c| p.distance(ops.positions[c as usize]));
            let expected = nearest.fold(f64::INFINITY, f64::min);
            assert!(
                (all[1][v] - expected).abs() < 0.06,
                "{v}: {expected}, {}",
                all[1][v]
            );
        }
        assert!(all[0][21 * 21..].iter().all(|d| d.is_infinite()));
        assert!(
            edge_distance(&ops, &[0])[21 * 21..]
                .iter()
                .all(|d| d.is_infinite())
        );
    }
}
