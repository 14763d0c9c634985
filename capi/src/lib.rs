//! The C interface: opaque handles, status codes, owned errors.
//!
//! The contract for C programs is at the top of `include/anyface.h`, which is generated from this
//! crate (the text of the contract is in `cbindgen.toml`). Every exported function has the same
//! shape: [`guard::guard`] catches panics and fills the error, [`pointer`] turns raw
//! pointers into checked borrows, the library does the work, and the result is written last.
//!
//! This is the only crate of the workspace that touches raw pointers.

// All functions share one safety contract, which is stated at the top of the header.
#![allow(clippy::missing_safety_doc)]

mod guard;
mod pointer;

#[cfg(test)]
mod foreign_handles;

mod audio;
mod basis;
mod clip;
mod clip_stream;
mod curves;
mod engine;
mod error;
mod face;
mod face_request;
mod head;
mod mesh;
mod motion;
mod motion_notes;
mod motion_values;
mod motion_weights;
mod numbers;
mod opened_face;
mod options;
mod performer;
mod progress;
mod request;
mod rig;
mod sliders;
mod sounds;
mod status;
mod stream;
mod text;
mod version;
mod weight_stream;
mod weights;
