//! Sparse-To-Mesh: 68 moving landmarks to every vertex.

pub mod paper;
