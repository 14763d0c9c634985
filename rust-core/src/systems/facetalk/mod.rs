//! FaceTalk (Aneja et al. 2023): heads that are fields.
//!
//! What stands is the parametric head; it is not in the registry, since nothing animates yet.

pub mod head;
