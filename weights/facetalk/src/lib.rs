//! FaceTalk's weights for Anyface: the parametric head, and networks that turn speech or landmarks
//! into its codes.

use anyface_weights_shared::{Model, model};

/// The head, and the denoisers of its codes.
pub static FACETALK_COMPACT: Model = model!("facetalk_compact");
/// A head of clean quads.
pub static HEAD_TOPOLOGY: Model = model!("head_topology");
