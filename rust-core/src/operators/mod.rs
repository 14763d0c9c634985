//! Differential operators of a mesh: Laplacian, mass, gradient, geodesics, eigenbasis.
//!
//! ```
//! use anyface::{mesh::Mesh, operators::{HeatGeodesics, Operators, OperatorOptions}};
//!
//! // An open box without lid, two triangles a side.
//! let positions = (0..8).map(|i| [(i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32]).collect();
//! let triangles = vec![
//!     [0, 2, 1], [1, 2, 3], [0, 1, 4], [1, 5, 4], [1, 3, 5], [3, 7, 5], [3, 2, 7], [2, 6, 7],
//!     [2, 0, 6], [0, 4, 6],
//! ];
//! let mesh = Mesh { positions, triangles };
//! let operators = Operators::new(&mesh, &OperatorOptions::default())?;
//! assert!((operators.mass.iter().sum::<f64>() - 5.0).abs() < 1e-3);
//! let distance = HeatGeodesics::new(&operators)?.distance_from(&[0]);
//! assert_eq!(distance.len(), 8);
//! # Ok::<(), anyface::Error>(())
//! ```

mod build;
pub mod cholesky;
mod eigenbasis;
#[cfg(test)]
mod fixtures;
mod geodesics;
pub mod gradient;
mod intrinsic;
mod lanczos;
mod laplacian;
#[cfg(test)]
mod real_meshes;
pub mod sparse;
mod spectral;
mod threads;
mod tufted;

pub use build::{NO_ROW, OperatorOptions, Operators};
pub use cholesky::SparseCholesky;
pub use eigenbasis::Eigenbasis;
pub use geodesics::{HeatGeodesics, edge_distance};
pub use gradient::{Frame, TangentGradient};
pub use sparse::Csr;
