//! Deformers move the vertices of one face by its landmarks, code fields by a system's codes.

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

    /// Shuts the lids in frames `moved` `[T, V, 3]` that something else made, as far as `landmarks` `[T, 68, 3]` say,
    /// and keeps the eyeballs behind the lids. Does nothing to a face whose lids are unknown.
    fn shut_lids(&self, landmarks: ArrayView3<'_, f32>, moved: &mut Array3<f32>) {
        let _ = (landmarks, moved);
    }

    /// The share by which each vertex attends to each landmark, `[T, V, 68]`; `None` for a deformer without attention.
    /// Vertices that follow no skin have zeros.
    fn attention(&self, landmarks: ArrayView3<'_, f32>) -> Option<Array3<f32>> {
        let _ = landmarks;
        None
    }

    /// A deformer of some `vertices`, in ascending order, and of the further vertices that it needs for them. `None`
    /// where a few vertices cost as much as all.
    fn of_vertices(&self, vertices: &[u32]) -> Option<FewVertices> {
        let _ = vertices;
        None
    }

    /// The products of this mesh's frames with `shapes` `[S, V, 3]`, mesh units and axes. A solve for weights needs
    /// only these products, and they cost a small part of the frames. `shown`, in rising order: vertices whose
    /// displacements come with the products. `None` where the products cost as much as all frames.
    fn products_with(
        &self,
        shapes: ArrayView3<'_, f32>,
        shown: &[u32],
    ) -> Option<Box<dyn ShapeProducts>> {
        let _ = (shapes, shown);
        None
    }

    /// [`Deformer::deform`] with displacements `[T, V, 3]` added to those of the landmarks. The
    /// corrections of contacts come after the sum.
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

    /// [`Deformer::deform`] without the corrections of contacts: skin alone. The result is linear
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

/// Moves the vertices of one face by codes, which hold more than the landmarks that go with them.
pub trait CodeField: Send + Sync {
    /// How the codes' own landmarks move from rest under codes `[t, X]`: `[t, 68, 3]`, canonical metres.
    ///
    /// # Errors
    /// `InvalidInput` or `ShapeMismatch` for codes of another length or that are not finite.
    fn landmarks(&self, codes: ArrayView2<'_, f32>) -> Result<Array3<f32>>;

    /// What to add to the motion `base` `[t, V, 3]` of the mesh, so that the vertices that follow
    /// the codes `[t, X]` go where the codes take them. Returns `[t, V, 3]`, mesh units and axes.
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
    /// Their numbers in the mesh, ascending, in the order of the deformer's output.
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

/// Passes every method on: a default method would hide the one of the deformer in the box.
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

    fn of_vertices(&self, vertices: &[u32]) -> Option<FewVertices> {
        self.as_ref().of_vertices(vertices)
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
