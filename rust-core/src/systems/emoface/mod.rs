//! EmoFace (Lin et al. 2025): one branch follows the words, the other the emotion, and Mesh
//! Attention mixes them.

mod branch;
mod config;
mod emotion_source;
mod model;
mod stream;
mod system;
mod template;

pub use config::{EmoFaceConfig, Fusion};
pub use model::{HeardFrame, Layer, MadeFrame, Model, Progressing};
pub use system::{EmoFace, MODEL, REGISTRATION};
pub use template::read_template;
