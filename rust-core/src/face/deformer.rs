//! What moves the vertices of one face: by its landmarks, and by codes that say more than they.

use std::sync::Arc;

use ndarray::{Array2, Array3, ArrayView2, ArrayView3};

use crate::{Result, job::ProgressFn};

/// Spreads landmark displacements over one prepared mesh.
pub trait Deformer: Send + Sync {
    /// `landmarks`: `[T, 68, 3]`, mesh units and axes. Returns `[T, V, 3]`, the same.
    ///
    /// # Errors
    /// `ShapeMismatch` if `landmarks` is not `[T, 68, 3]`; `Cancelled`.
    fn deform(
        &self,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>>;

    /// Shuts the lids of frames `moved` `[T, V, 3]` that something else has made, as far as `landmarks`
    /// `[T, 68, 3]` ask for, and keeps eyeballs behind them; nothing where no lids are known.
    fn shut_lids(&self, landmarks: ArrayView3<'_, f32>, moved: &mut Array3<f32>) {
        let _ = (landmarks, moved);
    }

    /// By which share each vertex attends to each landmark, `[T, V, 68]`; `None` for a deformer without
    /// attention. Vertices that follow no skin have zeros.
    fn attention(&self, landmarks: ArrayView3<'_, f32>) -> Option<Array3<f32>> {
        let _ = landmarks;
        None
    }

    /// A deformer of `wanted` vertices, rising, and of those that it needs beside them; `None` where one
    /// vertex costs as much as all.
    fn of_vertices(&self, wanted: &[u32]) -> Option<FewVertices> {
        let _ = wanted;
        None
    }

    /// The products of this mesh's frames with `shapes` `[S, V, 3]`, mesh units and axes, of which a solve for weights is
    /// made; they cost a small part of the frames. `shown`, rising: vertices whose displacements are wanted beside them.
    /// `None` where the products cost as much as all frames.
    fn products_with(
        &self,
        shapes: ArrayView3<'_, f32>,
        shown: &[u32],
    ) -> Option<Box<dyn ShapeProducts>> {
        let _ = (shapes, shown);
        None
    }

    /// [`Deformer::deform`] with displacements `[T, V, 3]` beside what landmarks say, before what touches what is
    /// corrected.
    ///
    /// # Errors
    /// Those of [`Deformer::deform`].
    fn deform_beside(
        &self,
        landmarks: ArrayView3<'_, f32>,
        beside: &Array3<f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        Ok(self.deform(landmarks, progress)? + beside)
    }

    /// [`Deformer::deform`] without the corrections that depend on what touches what: skin alone, linear
    /// where the decoder is.
    ///
    /// # Errors
    /// Those of [`Deformer::deform`].
    fn deform_freely(
        &self,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        self.deform(landmarks, progress)
    }
}

/// How the vertices of one face move under codes, which say more than the landmarks that go with them.
pub trait CodeField: Send + Sync {
    /// How the codes' own landmarks move from rest under codes `[t, X]`: `[t, 68, 3]`, canonical metres.
    ///
    /// # Errors
    /// `InvalidInput` or `ShapeMismatch` for codes of another length or that are not finite.
    fn landmarks(&self, codes: ArrayView2<'_, f32>) -> Result<Array3<f32>>;

    /// What is to be added to `base` `[t, V, 3]`, motion of the mesh, so that vertices that follow the codes go where
    /// these take them, by codes `[t, X]`: `[t, V, 3]`, mesh units and axes.
    ///
    /// # Errors
    /// `InvalidInput` or `ShapeMismatch` for codes of another length or that are not finite.
    fn beyond(&self, codes: ArrayView2<'_, f32>, base: &Array3<f32>) -> Result<Array3<f32>>;
}

/// The field on one face, or why no field fits it.
pub type Field = std::result::Result<Arc<dyn CodeField>, String>;

/// Some vertices of a mesh.
pub struct FewVertices {
    /// Moves them as the whole mesh does.
    pub deformer: Box<dyn Deformer>,
    /// Their numbers in the mesh, rising, in the order in which they are moved.
    pub vertices: Vec<u32>,
}

/// Products of the frames of one deformer with shapes of its mesh, without the frames.
pub trait ShapeProducts: Send + Sync {
    /// `landmarks`: `[T, 68, 3]`, mesh units and axes. Returns `[T, S]`, for each frame and shape the sum over all
    /// coordinates of both, mesh units squared; and `[T, shown, 3]`, displacements of the vertices that were to be shown.
    ///
    /// # Errors
    /// `ShapeMismatch` if `landmarks` is not `[T, 68, 3]`.
    fn of(&self, landmarks: ArrayView3<'_, f32>) -> Result<(Array2<f64>, Array3<f32>)>;
}

/// Every method is passed on: a default one would hide that of what is in the box.
impl Deformer for Box<dyn Deformer> {
    fn deform(
        &self,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        self.as_ref().deform(landmarks, progress)
    }

    fn shut_lids(&self, landmarks: ArrayView3<'_, f32>, moved: &mut Array3<f32>) {
        self.as_ref().shut_lids(landmarks, moved);
    }

    fn attention(&self, landmarks: ArrayView3<'_, f32>) -> Option<Array3<f32>> {
        self.as_ref().attention(landmarks)
    }

    fn of_vertices(&self, wanted: &[u32]) -> Option<FewVertices> {
        self.as_ref().of_vertices(wanted)
    }

    fn products_with(
        &self,
        shapes: ArrayView3<'_, f32>,
        shown: &[u32],
    ) -> Option<Box<dyn ShapeProducts>> {
        self.as_ref().products_with(shapes, shown)
    }

    fn deform_beside(
        &self,
        landmarks: ArrayView3<'_, f32>,
        beside: &Array3<f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        self.as_ref().deform_beside(landmarks, beside, progress)
    }

    fn deform_freely(
        &self,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        self.as_ref().deform_freely(landmarks, progress)
    }
}
