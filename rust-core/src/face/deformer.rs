//! Deformers move the vertices of one face by its landmarks. Code fields move them by the codes of
//! a system.

use std::sync::Arc;

use ndarray::{Array2, Array3, ArrayView2, ArrayView3};

use crate::{Result, job::ProgressFn};

/// Spreads landmark displacements over one prepared mesh.
pub trait Deformer: Send + Sync {
    /// `landmarks`: `[T, 68, 3]`, mesh units and axes. Returns `[T, V, 3]`, also in mesh units and
    /// axes.
    ///
    /// # Errors
    /// `ShapeMismatch` if `landmarks` is not `[T, 68, 3]`; `Cancelled`.
    fn deform(
        &self,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>>;

    /// Shuts the lids as far as `landmarks` `[T, 68, 3]` say, in frames `moved` `[T, V, 3]` that
    /// did not come from this deformer, and keeps the eyeballs behind the lids. Does nothing to a
    /// face whose lids are unknown.
    fn shut_lids(&self, landmarks: ArrayView3<'_, f32>, moved: &mut Array3<f32>) {
        let _ = (landmarks, moved);
    }

    /// The share by which each vertex attends to each landmark, `[T, V, 68]`; `None` for a deformer
    /// without attention. Vertices that do not follow the skin have zeros.
    fn attention(&self, landmarks: ArrayView3<'_, f32>) -> Option<Array3<f32>> {
        let _ = landmarks;
        None
    }

    /// A deformer for some `vertices`, which are in ascending order, and for the further vertices
    /// that these need. `None` if a few vertices cost as much as all.
    fn of_vertices(&self, vertices: &[u32]) -> Option<FewVertices> {
        let _ = vertices;
        None
    }

    /// The products of this mesh's frames with `shapes` `[S, V, 3]`, mesh units and axes. A solve
    /// for weights needs only these products, and they cost a fraction of the frames. `shown`:
    /// vertices whose displacements are returned with the products, in ascending order. `None` if
    /// the products cost as much as all frames.
    fn products_with(
        &self,
        shapes: ArrayView3<'_, f32>,
        shown: &[u32],
    ) -> Option<Box<dyn ShapeProducts>> {
        let _ = (shapes, shown);
        None
    }

    /// Like [`Deformer::deform`], but adds the displacements `beside` `[T, V, 3]` to those of the
    /// landmarks. Contacts are corrected after the sum.
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

    /// Like [`Deformer::deform`], but moves the skin alone and does not correct contacts. The
    /// result is linear if the decoder is.
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

/// Moves the vertices of one face by codes. Codes hold more than the landmarks that belong to them.
pub trait CodeField: Send + Sync {
    /// Displacements `[t, 68, 3]` from rest, canonical metres, of the landmarks that belong to
    /// codes `[t, X]`.
    ///
    /// # Errors
    /// `InvalidInput` or `ShapeMismatch` for codes of another length or that are not finite.
    fn landmarks(&self, codes: ArrayView2<'_, f32>) -> Result<Array3<f32>>;

    /// What to add to the motion `base` `[t, V, 3]` of the mesh, so that the vertices that follow
    /// the codes `[t, X]` go where the codes move them. Returns `[t, V, 3]`, mesh units and axes.
    ///
    /// # Errors
    /// `InvalidInput` or `ShapeMismatch` for codes of another length or that are not finite.
    fn beyond(&self, codes: ArrayView2<'_, f32>, base: &Array3<f32>) -> Result<Array3<f32>>;
}

/// The field on one face, or the reason why no field fits it.
pub type Field = std::result::Result<Arc<dyn CodeField>, String>;

/// Some vertices of a mesh.
pub struct FewVertices {
    /// Moves these vertices as the deformer of the whole mesh does.
    pub deformer: Box<dyn Deformer>,
    /// Their numbers in the mesh, in ascending order, which is the order of the deformer's output.
    pub vertices: Vec<u32>,
}

/// Computes products of a deformer's frames with shapes of its mesh, without making the frames.
pub trait ShapeProducts: Send + Sync {
    /// `landmarks`: `[T, 68, 3]`, mesh units and axes. Returns `[T, S]`, the scalar product of each
    /// frame with each shape over all coordinates, mesh units squared; and `[T, shown, 3]`, the
    /// displacements of the vertices to be shown.
    ///
    /// # Errors
    /// `ShapeMismatch` if `landmarks` is not `[T, 68, 3]`.
    fn of(&self, landmarks: ArrayView3<'_, f32>) -> Result<(Array2<f64>, Array3<f32>)>;
}

/// Forwards every method. A default method would hide the one of the deformer in the box.
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
