//! Where the face of a mesh is, without the weights that animating it needs.

use super::{Engine, kept};
use crate::{
    Result,
    deform::PartList,
    mesh::{FaceOptions, Landmarks, Mesh, Mouth},
    progress::{self, ProgressFn},
};

/// What is known of a mesh once its landmarks are.
#[derive(Debug, Clone)]
pub struct FoundFace {
    /// The 68 landmarks in the mesh's own units.
    pub landmarks: Landmarks,
    /// How the lips meet.
    pub mouth: Mouth,
    /// The mesh's parts and what each of them is.
    pub parts: PartList,
}

impl Engine {
    /// Finds or takes the landmarks of a mesh; [`Engine::prepare`] meets them again in the cache.
    ///
    /// # Errors
    /// `FaceNotFound`, `Mesh`, `InvalidInput` for landmarks that cannot be, `Cancelled`.
    pub fn find(
        &self,
        mesh: &Mesh,
        options: &FaceOptions,
        progress: ProgressFn<'_>,
    ) -> Result<FoundFace> {
        self.threads(|| {
            progress::report(progress, "landmarks", 0.0)?;
            let key = kept::key_of(mesh, &self.models);
            let (landmarks, parts) = self.kept_landmarks(&key, mesh, options, progress)?;
            let mouth = Mouth::of(mesh, &landmarks);
            progress::report(progress, "landmarks", 1.0)?;
            Ok(FoundFace {
                landmarks,
                mouth,
                parts,
            })
        })
    }
}
