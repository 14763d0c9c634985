//! Supports long jobs: reports progress, cancels, estimates memory, reads files within limits,
//! writes them completely or not at all, replaces no file that nobody named, and turns panics of
//! third-party decoders into errors.

mod atomic;
mod input;
mod json;
pub mod memory;
pub(crate) mod outside;
mod place;
mod progress;
pub(crate) mod receipts;

pub(crate) use atomic::{Unfinished, UnfinishedFolder, create_folder};
pub use atomic::{all_or_none, remove_unfinished, write_atomically, write_json};
pub(crate) use input::Input;
pub use input::{InputKind, copy_file, read_file, read_text};
pub(crate) use json::check_json;
pub use place::Place;
pub(crate) use progress::Watch;
pub use progress::{Progress, ProgressFn, SILENT, report};
pub use receipts::Receipts;
