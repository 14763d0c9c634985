//! Makes a rig for any head, with the 52 ARKit shapes and the 15 Oculus visemes. Also turns a
//! vertex animation back into weights of those shapes.
//!
//! [`RigModel`] makes a [`Rig`](crate::face::Rig). On the skin each shape is the landmark motion of
//! a mean face, spread by the face's own [`crate::face::Deformer`], plus the correction of a
//! [`network`]. Raised and lowered brows fold the forehead as the learned decoder does. Jaw parts
//! follow the jaw, eyeballs turn, and a tongue that is a separate part comes out ([`parts`]).
//! [`solve`] turns motion of vertices into weights. If a parametric head is like the face, its
//! field may move the skin instead.

mod by_field;
pub(crate) mod closures;
mod decoded;
mod key_names;
mod lids;
mod looks;
mod make;
mod names;
pub mod network;
pub mod opposing;
pub mod parts;
mod solve;
mod visemes;

pub use by_field::{FieldOfFace, ShapeSource};
pub use closures::meeting_lips;
pub use decoded::Learned;
pub use key_names::{KeyPair, shape_of, shown_shapes};
pub use looks::{EyeLook, eye_looks};
pub use make::{MODEL, RigModel};
pub use names::{ARKIT, VISEMES, is_of_mouth, mirrored_name};
pub(crate) use solve::{MotionSums, ShapeSolver};
pub use solve::{SolveOptions, SolvedWeights, solve};

/// Shapes of a rig.
pub const SHAPES: usize = ARKIT.len() + VISEMES.len();
