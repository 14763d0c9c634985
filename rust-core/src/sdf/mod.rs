//! Fields of signed distance, and their surfaces.

mod grid;
mod marching_cubes;
mod table;

pub use grid::Grid;
pub use marching_cubes::surface;
