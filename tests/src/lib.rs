//! What the tests of foreign hosts share: a small head and a voice made from formulas, and the
//! way from C sources to a program that runs.

pub mod native;
pub mod scene;
