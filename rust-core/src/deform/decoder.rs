//! What a system can bring of its own to move a face: codes, or a way to spread landmark motion.

use std::{fmt, sync::Arc};

use crate::{
    Result,
    cache::Cache,
    face::{Deformer, Face, Field},
    job::ProgressFn,
};

/// The meaning of one model's codes on any face.
pub trait CodeSpace: Send + Sync {
    /// The name of the model.
    fn name(&self) -> &'static str;

    /// The field with which the codes move the vertices of a face. It is kept with the face and may
    /// be kept in `cache`. `None` if the face's controls ask for landmarks alone.
    ///
    /// # Errors
    /// `Mesh` if the landmarks lie on no usable face, `Cancelled`.
    fn field(&self, face: &Face, cache: &Cache, progress: ProgressFn<'_>) -> Result<Option<Field>>;
}

impl fmt::Debug for dyn CodeSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A system's own way to spread landmark motion over faces. It works on every vertex, so its faces
/// have no proxy.
pub trait Decoder {
    /// Prepares the decoder for one face. Results that take long to compute are kept in `cache`.
    ///
    /// # Errors
    /// Those of the weights and of the mesh; `Cancelled`.
    fn prepare(
        &self,
        face: &Face,
        cache: &Cache,
        progress: ProgressFn<'_>,
    ) -> Result<Arc<dyn Deformer>>;
}
