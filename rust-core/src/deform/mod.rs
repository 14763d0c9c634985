//! Landmark motion spread over a whole mesh.
//!
//! [`Deformer`] is what every decoder offers. [`LandmarkWeights`] is the default one: fixed weights
//! over the landmarks, shared by systems. They come from [`PlateWeights`] on the skin and from
//! [`binding`] on everything else, by the role of each part ([`PartList`]); beside them [`StaticWeights`]
//! are what is learned, [`Creases`] what another face shows between the landmarks. [`Corrected`] adds what
//! is not linear: the jaw's rotation, lips that touch, lids that slide over their eyeballs. [`compression`]
//! turns the result into a few basis shapes, [`projection`] finds other motion on them.

pub mod binding;
pub mod compression;
mod contact;
mod corrected;
mod correspondence;
pub mod creases;
mod eye_parts;
mod eyes;
pub(crate) mod fade;
pub mod jaw;
mod joined_lips;
mod landmark_weights;
mod lids;
mod nearest;
mod part_list;
mod prepare;
pub mod projection;
pub mod proxy;
mod role_rules;
mod row_weights;
mod skin;
pub mod static_weights;
mod tension_screened_biharmonic;

pub use corrected::{Corrected, Corrections};
pub use correspondence::{Correspondence, FollowingFace, ReferencePoints};
pub use creases::{Creases, ReferenceFace};
pub(crate) use eyes::Openings;
pub use landmark_weights::LandmarkWeights;
pub(crate) use nearest::PointGrid;
pub use part_list::PartList;
pub use prepare::{LEARNED, SolvedSkin, static_deformer};
pub use skin::Skin;
pub use static_weights::{StaticWeights, VertexGeometry};
pub use tension_screened_biharmonic::{Plate, PlateWeights, REACHES_CM};

use std::{fmt, sync::Arc};

use ndarray::{Array3, ArrayView2, ArrayView3};

use crate::{Result, cache::Cache, face::Face, progress::ProgressFn};

/// Displacements of every vertex over time.
#[derive(Debug, Clone, PartialEq)]
pub struct VertexClip {
    /// `[T, V, 3]`, in the mesh's own units, axes and vertex order.
    pub displacements: Array3<f32>,
    /// Frames per second.
    pub fps: f64,
}

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

    /// The face under codes `[t, X]`: displacements `[t, V, 3]`, mesh units and axes. `deformer` moves what does not
    /// follow the codes, and adds what `landmarks` `[t, 68, 3]`, in mesh units, do beside them.
    ///
    /// # Errors
    /// Those of [`CodeField::landmarks`] and of the deformer.
    fn frames(
        &self,
        (face, deformer): (&Face, &dyn Deformer),
        landmarks: ArrayView3<'_, f32>,
        codes: ArrayView2<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let base = face.own_motion(self.landmarks(codes)?.view());
        let base = deformer.deform_freely(base.view(), progress)?;
        let beside = self.beyond(codes, &base)?;
        deformer.deform_beside(landmarks, &beside, progress)
    }
}

/// The field on one face, or why no field fits it.
pub type Field = std::result::Result<Arc<dyn CodeField>, String>;

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

/// Some vertices of a mesh.
pub struct FewVertices {
    /// Moves them as the whole mesh does.
    pub deformer: Box<dyn Deformer>,
    /// Their numbers in the mesh, rising, in the order in which they are moved.
    pub vertices: Vec<u32>,
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
