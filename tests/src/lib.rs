//! Shared code of the tests of foreign hosts: makes a small head and a voice from formulas, and
//! builds and runs programs from C sources.

pub mod native;
pub mod scene;
