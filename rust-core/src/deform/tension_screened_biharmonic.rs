//! Training-free weights from 68 landmarks to every vertex: a thin plate under tension.
//!
//! Twin of `training/deform/tension_screened_biharmonic.py`. For each landmark `j`, the weight
//! field `w` minimises bending, tension and, far from every landmark, its own size:
//!
//! `(L M⁻¹ L + τ L + S M + C) w = C e_j`
//!
//! `L` is the robust Laplacian, `M` the lumped mass, `S` the screening, and `C` a stiff spring at
//! each landmark's row. Without tension the plate overshoots between the lips and on the cheeks.
//! Without the screening the back of the head follows the jaw, and errors double. One sparse
//! Cholesky factorisation serves all landmarks.

use std::ops::Range;

use crate::{
    Result,
    face::lids::{EYES, LidEdge},
    mesh::ibug::LANDMARKS,
    operators::{Csr, Operators, SparseCholesky, edge_distance},
};

/// Landmark numbers of each kind, and how far along the surface they carry motion, in centimetres:
/// contour, brows, nose, eyes, lips. The reach of a lid ends at the skull that holds the eye, while
/// the lining of the mouth follows the lips a long way in.
pub const REACHES_CM: [(Range<usize>, f64); 5] = [
    (0..17, 1.0),
    (17..27, 2.0),
    (27..36, 2.0),
    (36..48, 0.5),
    (48..68, 6.0),
];

/// Constants of the plate, for a human-sized head in centimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plate {
    /// `τ`, 1/cm².
    pub tension: f64,
    /// `S` at twice the reach of the nearest landmark and beyond, 1/cm⁴.
    pub screen: f64,
    /// `C` at a landmark, unitless. It holds each landmark to a few micrometres.
    pub spring: f64,
}

impl Default for Plate {
    fn default() -> Self {
        Plate {
            tension: 2.5,
            screen: 10.0,
            spring: 1e4,
        }
    }
}

/// The training-free weights of a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateWeights {
    /// `[R, 68]`, row-major, unitless.
    pub weights: Vec<f32>,
    /// `[R]`, the least ratio of distance to reach over the kinds of landmarks. Infinite where no
    /// path along the surface leads to a landmark.
    pub remoteness: Vec<f64>,
}

impl PlateWeights {
    /// Solves for all landmarks. `operators`: of a surface in canonical centimetres, `R` rows.
    /// `landmark_rows`: the row of each landmark. If several landmarks share a row, it follows
    /// their mean.
    ///
    /// # Errors
    /// `Numerics` if the factorisation fails.
    pub fn solve(
        operators: &Operators,
        landmark_rows: &[u32; LANDMARKS],
        plate: Plate,
    ) -> Result<PlateWeights> {
        let remoteness = remoteness(operators, landmark_rows);
        let system = system(operators, landmark_rows, &remoteness, plate)?;
        let factor = SparseCholesky::factor_rounded(&system)?;
        let rows = operators.rows();
        let mut columns = vec![0.0; rows * LANDMARKS];
        for (column, &row) in columns.chunks_mut(rows).zip(landmark_rows) {
            column[row as usize] = plate.spring;
        }
        factor.solve_in_place(&mut columns, LANDMARKS);
        let mut weights = vec![0.0; rows * LANDMARKS];
        for (j, column) in columns.chunks(rows).enumerate() {
            for (row, &value) in column.iter().enumerate() {
                weights[row * LANDMARKS + j] = value as f32;
            }
        }
        end_lids(&mut weights, operators, landmark_rows);
        Ok(PlateWeights {
            weights,
            remoteness,
        })
    }
}

/// Multiplies the weights of each eye's landmarks by the share to which a row follows the lids.
fn end_lids(weights: &mut [f32], operators: &Operators, landmark_rows: &[u32; LANDMARKS]) {
    for eye in EYES {
        let corners: [[f64; 3]; 6] = std::array::from_fn(|i| {
            let row = landmark_rows[eye.start + i];
            operators.positions[row as usize].into()
        });
        let edge = LidEdge::through(&corners);
        for (row, position) in weights.chunks_mut(LANDMARKS).zip(&operators.positions) {
            let share = edge.share((*position).into()) as f32;
            row[eye.clone()].iter_mut().for_each(|w| *w *= share);
        }
    }
}

/// The least ratio of surface distance to reach. Returns `[R]`.
fn remoteness(operators: &Operators, landmark_rows: &[u32; LANDMARKS]) -> Vec<f64> {
    let mut least = vec![f64::INFINITY; operators.rows()];
    for (kind, reach) in REACHES_CM {
        let distance = edge_distance(operators, &landmark_rows[kind]);
        for (least, distance) in least.iter_mut().zip(distance) {
            *least = least.min(distance / reach);
        }
    }
    least
}

/// Builds the matrix on the left side of the equation.
fn system(
    operators: &Operators,
    landmark_rows: &[u32; LANDMARKS],
    remoteness: &[f64],
    plate: Plate,
) -> Result<Csr> {
    let laplacian = &operators.laplacian;
    let mut weighted = laplacian.clone();
    let inverse_mass: Vec<f64> = operators.mass.iter().map(|m| 1.0 / m).collect();
    weighted.scale_rows(&inverse_mass);
    let bending = laplacian.matmul(&weighted)?;
    let mut diagonal: Vec<f64> = remoteness
        .iter()
        .zip(&operators.mass)
        .map(|(far, mass)| plate.screen * (far - 1.0).clamp(0.0, 1.0).powi(2) * mass)
        .collect();
    for &row in landmark_rows {
        diagonal[row as usize] += plate.spring;
    }
    bending
        .combine(1.0, plate.tension, laplacian)?
        .add_diagonal(1.0, &diagonal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{mesh::Mesh, nn::golden::Golden, operators::OperatorOptions};

    /// The golden's procedural face in centimetres, and its landmark vertices.
    fn golden_face(golden: &Golden) -> (Operators, [u32; LANDMARKS]) {
        let positions = golden.values("vertices");
        let triangles = golden.integers("triangles");
        let mesh = Mesh {
            positions: positions
                .chunks(3)
                .map(|p| [100.0 * p[0], 100.0 * p[1], 100.0 * p[2]])
                .collect(),
            triangles: triangles
                .chunks(3)
                .map(|t| [t[0] as u32, t[1] as u32, t[2] as u32])
                .collect(),
        };
        let landmarks = golden.integers("landmarks");
        let operators = Operators::new(&mesh, &OperatorOptions::default()).unwrap();
        let rows = std::array::from_fn(|n| operators.row_of_vertex[landmarks[n]]);
        (operators, rows)
    }

    #[test]
    fn weights_match_the_python_twin() {
        let golden = Golden::open("static_weights_debug");
        let (operators, rows) = golden_face(&golden);
        let solved = PlateWeights::solve(&operators, &rows, Plate::default()).unwrap();
        for (got, want) in solved.remoteness.iter().zip(golden.values("remoteness")) {
            assert!((got - f64::from(want)).abs() < 1e-4 * (1.0 + f64::from(want)));
        }
        for (got, want) in solved.weights.iter().zip(golden.values("base")) {
            assert!((got - want).abs() < 1e-4, "expected {want}, got {got}");
        }
    }

    #[test]
    fn landmarks_follow_themselves_and_far_places_rest() {
        let golden = Golden::open("static_weights_debug");
        let (operators, rows) = golden_face(&golden);
        let solved = PlateWeights::solve(&operators, &rows, Plate::default()).unwrap();
        let row_of = |row: usize| &solved.weights[row * LANDMARKS..(row + 1) * LANDMARKS];
        for (n, &row) in rows.iter().enumerate() {
            let sharing = rows.iter().filter(|&&r| r == row).count() as f32;
            assert!((row_of(row as usize)[n] - 1.0 / sharing).abs() < 0.01);
        }
        let (farthest, _) = solved
            .remoteness
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .unwrap();
        assert!(row_of(farthest).iter().map(|w| w.abs()).sum::<f32>() < 0.3);
    }
}
