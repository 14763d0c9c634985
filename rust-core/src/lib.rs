//! Anyface makes any face mesh talk: speech in, facial animation with emotion out, on a plain CPU.
//!
//! Five nouns carry the data, and the modules stand in the order in which they meet it:
//!
//! [`audio::Waveform`] → [`speech::FeatureTrack`] → [`motion::MotionClip`] →
//! [`deform::VertexClip`] → a file ([`output`]), a C buffer or shape keys.
//!
//! [`Engine`] runs the whole way. Shapes in the documentation use fixed letters: `B` batch,
//! `T` motion frames, `S` samples, `C` channels, `V` vertices, `F` faces, `K` eigenpairs,
//! `N` landmarks.
// `deny`, not `forbid`: the slicing macro of ndarray expands to an `allow` of its own.
#![deny(unsafe_code)]

pub mod audio;
#[cfg(feature = "cli")]
pub mod cli;
pub mod conditions;
pub mod deform;
pub mod diffusion;
mod engine;
mod error;
pub mod mesh;
pub mod metrics;
pub mod motion;
pub mod nn;
pub mod operators;
pub mod output;
pub mod progress;
pub mod rig;
pub mod speech;
pub mod systems;
pub mod weights;

pub use engine::{
    Animation, CachePolicy, DecoderKind, Engine, EngineOptions, FoundFace, MotionRequest,
    Performance, PreparedFace, Slider, SliderChange, StreamOptions,
};
pub use error::{Error, Result};
