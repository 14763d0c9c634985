//! VRM files: a mesh as an avatar with expressions, and a take as expressions over time.
//!
//! An avatar keeps all that its file has, such as bones, materials and springs, and gets morph
//! targets and expressions (of VRM 1.0, or groups of VRM 0). A head without a body gets the fewest
//! bones that VRM 1.0 allows. The extensions VRMC_vrm and VRMC_vrm_animation follow
//! <https://github.com/vrm-c/vrm-specification>.

mod animation;
mod avatar;
mod expressions;
mod new_groups;
mod old_groups;
mod skeleton;

pub use animation::VrmNames;
pub(super) use animation::{VrmWeights, write_vrm_animation};
pub(super) use avatar::add_expressions;
pub use avatar::write_avatar;
pub(super) use expressions::Existing;

#[cfg(test)]
mod tests;
