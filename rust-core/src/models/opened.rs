//! Models whose weights a host may fetch after the engine was made.

use std::path::Path;

use super::BuiltIn;
use crate::{Error, Result};

/// An opened model or, if its weights are yet to be fetched, the error message for its users.
pub(crate) struct Opened<T>(std::result::Result<T, String>);

impl<T> Opened<T> {
    /// Opens `model`, from `folder` or built in, by calling `open`. If its weights are yet to be
    /// fetched, keeps the message of the error.
    ///
    /// # Errors
    /// Those of `open` if the weights are here; those of `BuiltIn::place`.
    pub fn of(
        model: &BuiltIn,
        folder: Option<&Path>,
        open: impl FnOnce() -> Result<T>,
    ) -> Result<Self> {
        match (open(), model.is_awaited(folder)?) {
            (Err(Error::Weights(message)), true) => Ok(Opened(Err(message))),
            (opened, _) => opened.map(|opened| Opened(Ok(opened))),
        }
    }

    /// The opened model.
    ///
    /// # Errors
    /// `Weights` if the weights were yet to be fetched when it was opened.
    pub fn get(&self) -> Result<&T> {
        let refuse = |message: &String| Error::Weights(message.clone());
        self.0.as_ref().map_err(refuse)
    }
}
