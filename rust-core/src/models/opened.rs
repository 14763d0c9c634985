//! What is read from models that may be fetched after the engine was made.

use std::path::Path;

use super::BuiltIn;
use crate::{Error, Result};

/// What a model became; where its weights are yet to be fetched, what to say to who needs it.
pub(crate) struct Opened<T>(std::result::Result<T, String>);

impl<T> Opened<T> {
    /// Opens what `model` holds, in `folder` or beside it, unless its weights are yet to be fetched.
    ///
    /// # Errors
    /// Those of `open` where the weights are here.
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

    /// It.
    ///
    /// # Errors
    /// `Weights` where it was yet to be fetched.
    pub fn get(&self) -> Result<&T> {
        let refuse = |message: &String| Error::Weights(message.clone());
        self.0.as_ref().map_err(refuse)
    }
}
