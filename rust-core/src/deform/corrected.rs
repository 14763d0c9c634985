//! Corrects decoded frames where weights over the landmarks are not enough: jaw, mouth and eyes.

mod corrections;
mod products;

use std::collections::BTreeSet;

use ndarray::{Array3, ArrayView3};

pub use corrections::{Corrected, Corrections};

use self::products::CorrectedProducts;
use crate::{
    Result,
    face::{Deformer, FewVertices, ShapeProducts},
    job::ProgressFn,
    mesh::ibug::LANDMARKS,
};

impl<D: Deformer> Deformer for Corrected<D> {
    fn of_vertices(&self, vertices: &[u32]) -> Option<FewVertices> {
        let rims = self.corrections.rims();
        let vertices: BTreeSet<u32> = vertices.iter().copied().chain(rims).collect();
        let few = self.decoder.of_vertices(&Vec::from_iter(vertices))?;
        let corrections = self.corrections.of_vertices(&few.vertices);
        Some(FewVertices {
            deformer: Box::new(Corrected {
                decoder: few.deformer,
                corrections,
            }),
            vertices: few.vertices,
        })
    }

    fn products_with(
        &self,
        shapes: ArrayView3<'_, f32>,
        shown: &[u32],
    ) -> Option<Box<dyn ShapeProducts>> {
        let products = CorrectedProducts::new(self, shapes, shown)?;
        Some(Box::new(products))
    }

    fn deform(
        &self,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        if landmarks.dim().1 != LANDMARKS || landmarks.dim().2 != 3 {
            // The decoder returns the error.
            return self.decoder.deform(landmarks, progress);
        }
        self.corrected(landmarks, None, progress)
    }

    fn deform_beside(
        &self,
        landmarks: ArrayView3<'_, f32>,
        beside: &Array3<f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        self.corrected(landmarks, Some(beside), progress)
    }

    fn shut_lids(&self, landmarks: ArrayView3<'_, f32>, moved: &mut Array3<f32>) {
        let landmarks = self.corrections.adapt_landmarks(landmarks);
        self.each_frame(landmarks.view(), moved, |landmarks, frame| {
            self.corrections.shut(landmarks, frame);
        });
    }

    fn attention(&self, landmarks: ArrayView3<'_, f32>) -> Option<Array3<f32>> {
        self.decoder.attention(landmarks)
    }

    fn deform_freely(
        &self,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let landmarks = self.corrections.adapt_landmarks(landmarks);
        self.decoder.deform(landmarks.view(), progress)
    }
}
