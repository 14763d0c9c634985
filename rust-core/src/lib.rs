//! Anyface makes any face mesh talk: speech in, facial animation with emotion out, on a plain CPU.
//!
//! The data passes through these types, in this order:
//!
//! [`audio::Waveform`] → [`speech::SpeechFeatures`] → [`motion::Motion`] (of a [`systems::System`]) → spread
//! over a [`Face`] ([`spread`]) → a file ([`output`]), a C buffer or shape keys.
//!
//! [`Engine`] runs all these steps:
//!
//! ```
//! use std::path::Path;
//! use anyface::{Engine, EngineOptions, MotionRequest, audio::Waveform, conditions::EmotionCurve};
//! use anyface::{face::FaceOptions, mesh::Mesh, output::ClipFile, job::SILENT};
//!
//! # let folder = tempfile::tempdir().unwrap();
//! # let (voice, out) = (folder.path().join("voice.wav"), folder.path().join("talk.npz"));
//! # let head = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head/head.obj");
//! # let spec = hound::WavSpec { channels: 1, sample_rate: 16_000, bits_per_sample: 32,
//! #     sample_format: hound::SampleFormat::Float };
//! # let mut wav = hound::WavWriter::create(&voice, spec).unwrap();
//! # (0..8000).for_each(|i| wav.write_sample((i as f32 * 0.08).sin()).unwrap());
//! # wav.finalize().unwrap();
//! let engine = Engine::new(EngineOptions::default())?;
//! let mesh = Mesh::read(&head)?;
//! let face = engine.prepare(&mesh, &FaceOptions::default(), SILENT)?;
//! let sound = Waveform::from_file(&voice)?;
//! let happy = MotionRequest { emotion: EmotionCurve::parse("happy:0.7")?, ..Default::default() };
//! let report = engine.animate(&face, &sound, &happy, &mut ClipFile::new(&out)?, SILENT)?;
//! assert_eq!(report.landmarks.dim(), (15, 68, 3));
//! assert!(1000.0 * face.metres_per_unit() * f64::from(report.largest) > 1.0, "millimetres");
//! # Ok::<(), anyface::Error>(())
//! ```
//!
//! Shapes in the documentation use fixed letters: `B` batch,
//! `T` motion frames, `S` samples, `C` channels, `V` vertices, `F` faces, `K` eigenpairs,
//! `N` landmarks.
// With some of the systems alone, as in browsers, layers of the others are left over.
#![cfg_attr(
    not(all(
        feature = "freetalk",
        feature = "cafe-talk",
        feature = "emoface",
        feature = "facetalk"
    )),
    allow(dead_code)
)]
// `deny`, not `forbid`: the slicing macro of ndarray expands to an `allow` of its own.
#![deny(unsafe_code)]
// What the library has to say goes into results, errors and `tracing`.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod annotation;
pub mod audio;
pub mod cache;
pub mod chart;
pub mod conditions;
pub mod curves;
pub mod deform;
pub mod diffusion;
mod engine;
mod error;
pub mod face;
pub mod head;
pub mod job;
pub mod mesh;
pub mod models;
pub mod motion;
mod nn;
pub mod operators;
pub mod output;
pub mod rig;
pub mod sdf;
pub mod speech;
pub mod spread;
pub mod systems;
pub mod text;

pub use cache::CachePolicy;
pub use engine::{
    CapturedTake, Engine, EngineOptions, MouthReach, Part, Performance, SliderChange,
};
pub use error::{Error, Result};
pub use face::Face;
pub use motion::MotionRequest;
