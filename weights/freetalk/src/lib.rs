//! FreeTalk's weights for Anyface: denoiser, decoder and the causal student.

use anyface_weights_shared::{Model, model};

/// Turns speech into landmark motion.
pub static ATS_COMPACT: Model = model!("ats_compact");
/// Turns speech into landmark motion while it is being spoken.
pub static STREAM: Model = model!("stream");
/// The paper's decoder.
pub static STM_PAPER: Model = model!("stm_paper");
