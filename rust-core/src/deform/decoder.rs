//! What a system brings to move a face by: codes of its own, or a way to spread landmarks.

use std::{fmt, sync::Arc};

use crate::{
    Result,
    cache::Cache,
    face::{Deformer, Face, Field},
    job::ProgressFn,
};

/// What codes of one model mean, on any face.
pub trait CodeSpace: Send + Sync {
    /// The name of the model.
    fn name(&self) -> &'static str;

    /// The field by which the codes move the vertices of a face, kept with the face and in `cache`; `None` where the
    /// face's controls ask for landmarks alone.
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

/// A way to spread landmark motion over faces that is a system's own. It works on every vertex: its faces have no proxy.
pub trait Decoder {
    /// Prepares it for one face; what takes long is kept in `cache`.
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
