//! VRM: a mesh with expressions that avatars are moved by, and a take as such expressions over time.
//!
//! An avatar keeps all that its file has, bones and materials and springs, and gets targets and expressions (VRM 1.0, or the
//! groups of VRM 0). A head alone gets the fewest bones that VRM 1.0 allows. Extensions VRMC_vrm and VRMC_vrm_animation as
//! <https://github.com/vrm-c/vrm-specification> has them.

mod animation;
mod avatar;
mod expressions;
mod new_groups;
mod old_groups;
mod skeleton;

pub use animation::VrmNames;
pub(super) use animation::write_vrm_animation;
pub use avatar::write_avatar;

#[cfg(test)]
mod tests;
