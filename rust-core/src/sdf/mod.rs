//! Fields of signed distance, and their surfaces.

mod marching_cubes;

pub use marching_cubes::{Grid, surface};
