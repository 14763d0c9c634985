//! FreeTalk's weights for Anyface: denoiser, decoder and the causal student.

use anyface_weights_shared::{Model, model};

/// Speech to landmarks.
pub static ATS_COMPACT: Model = model!("ats_compact");
/// Speech to landmarks while it is spoken.
pub static STREAM: Model = model!("stream");
/// When lips are together, heard while somebody is speaking.
pub static LIVE_CLOSURES: Model = model!("live_closures");
/// The paper's decoder.
pub static STM_PAPER: Model = model!("stm_paper");
