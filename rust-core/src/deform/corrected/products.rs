//! Products of corrected frames with shapes, without the frames.
//!
//! A solve for the weights of shapes needs only `D_s · x`, the product of each frame `x` with each shape `D_s`. A frame
//! comes from landmarks `ℓ` through a linear decoder `W`, plus corrections that are not linear. The corrections change
//! few vertices `v`, so the product splits:
//!
//! `D_s · x = D_s · (W ℓ) + Σ_v D_sv · (x_v − W_v ℓ)`
//!
//! 1. The decoder multiplies the shapes with its weights once, in one pass over V. Its part of a frame is then a matrix
//!    `[204, S]` times the coordinates of the landmarks ([`Deformer::products_with`]).
//! 2. Vertices that only the jaw carries do not follow the decoder. Their motion is linear in the [`POSE_NUMBERS`] of
//!    the jaw's pose, though the pose is not linear in the landmarks. Their part is a matrix `[12, S]` times these
//!    numbers.
//! 3. Vertices beside lips and eyes are decoded with corrections and without them. The difference times the shapes at
//!    these vertices is the rest.
//!
//! A frame costs the decoding of these few vertices and S products for each of their coordinates, instead of both for
//! all of V. The few are the skin around mouth and eyes, and the vertices that are shown.
//!
//! Not obvious: every vertex must count once. For a vertex that the jaw carries, the shapes are set
//! to 0 in parts 1 and 3. If a correction also touches the vertex, it is left out of part 2
//! instead: part 1 counts the decoder's motion for it, and the difference in part 3 replaces that
//! motion with the true one. Rims are among the few vertices because corrections read them, even
//! where they do not move them.
//!
//! What can go wrong: a decoder that is not linear, or that cannot decode a few vertices alone, has no products. Then
//! [`CorrectedProducts::new`] returns `None`, and the caller decodes whole frames.

use std::collections::BTreeSet;

use ndarray::{Array2, Array3, ArrayView3, Axis, s};

use super::corrections::{Corrected, Corrections};
use crate::{
    Result,
    deform::jaw::POSE_NUMBERS,
    face::{Deformer, ShapeProducts},
    job::SILENT,
};

/// The parts of a mesh and its shapes that products need.
pub(super) struct CorrectedProducts {
    /// Products of the decoder alone, without the vertices that the jaw carries.
    linear: Box<dyn ShapeProducts>,
    /// `[12, S]`: products of the vertices that the jaw carries, for each number of its pose.
    carried: Array2<f64>,
    /// Corrections of the whole mesh.
    corrections: Corrections,
    /// The deformer of the few vertices that corrections move or read, or that are shown.
    few: Corrected<Box<dyn Deformer>>,
    /// `[3 · few, S]`: the shapes at these vertices, 0 where the jaw carries a vertex.
    shapes: Array2<f32>,
    /// Index of each shown vertex among the few.
    shown: Vec<usize>,
}

impl CorrectedProducts {
    /// `None` where the decoder is not linear.
    pub(super) fn new<D: Deformer>(
        deformer: &Corrected<D>,
        shapes: ArrayView3<'_, f32>,
        shown: &[u32],
    ) -> Option<CorrectedProducts> {
        let corrections = &deformer.corrections;
        let touched: BTreeSet<u32> = corrections.touched_vertices().collect();
        let carried = corrections.carried.iter();
        let carried: Vec<_> = carried.filter(|(v, ..)| !touched.contains(v)).collect();
        let mut free = shapes.to_owned();
        for (v, ..) in &carried {
            free.slice_mut(s![.., *v as usize, ..]).fill(0.0);
        }
        let linear = deformer.decoder.products_with(free.view(), &[])?;
        let few_vertices = touched
            .iter()
            .chain(shown)
            .copied()
            .chain(corrections.rims());
        let few_vertices: BTreeSet<u32> = few_vertices.collect();
        let few = deformer
            .decoder
            .of_vertices(&Vec::from_iter(few_vertices))?;
        let numbers: Vec<usize> = few.vertices.iter().map(|v| *v as usize).collect();
        let at_few = free.select(Axis(1), &numbers);
        let (count, vertices, _) = at_few.dim();
        let flat = at_few.to_shape((count, 3 * vertices));
        let flat = flat.expect("row-major array");
        Some(CorrectedProducts {
            linear,
            carried: of_carried(corrections, shapes, &carried),
            corrections: corrections.clone(),
            shown: shown
                .iter()
                .map(|v| few.vertices.binary_search(v).ok())
                .collect::<Option<_>>()?,
            few: Corrected {
                corrections: corrections.of_vertices(&few.vertices),
                decoder: few.deformer,
            },
            shapes: flat.t().to_owned(),
        })
    }
}

/// `[12, S]`: how much each number of the jaw's pose adds to each product through the carried vertices.
fn of_carried(
    corrections: &Corrections,
    shapes: ArrayView3<'_, f32>,
    carried: &[&(u32, f32, [f32; 3])],
) -> Array2<f64> {
    let to_canonical = &corrections.to_canonical;
    let to_mesh = 0.01 * to_canonical.inverse().scale as f32;
    let mut sums = Array2::<f64>::zeros((POSE_NUMBERS, shapes.len_of(Axis(0))));
    for (shape, mut sums) in shapes.outer_iter().zip(sums.columns_mut()) {
        for &&(v, share, from_hinge) in carried {
            let moved = shape.row(v as usize);
            let along = to_canonical.rotate([moved[0], moved[1], moved[2]]);
            for (i, along) in along.into_iter().enumerate() {
                let along = f64::from(share * to_mesh * along);
                for (j, from) in from_hinge.into_iter().enumerate() {
                    sums[3 * i + j] += along * f64::from(from);
                }
                sums[9 + i] += along;
            }
        }
    }
    sums
}

impl ShapeProducts for CorrectedProducts {
    fn of(&self, landmarks: ArrayView3<'_, f32>) -> Result<(Array2<f64>, Array3<f32>)> {
        let adapted = self.corrections.adapt_landmarks(landmarks);
        let adapted = adapted.as_standard_layout().into_owned();
        let for_decoder = self.corrections.landmarks_for_decoder(&adapted);
        let (mut products, _) = self.linear.of(for_decoder.view())?;
        let poses = Array2::from_shape_vec(
            (adapted.len_of(Axis(0)), POSE_NUMBERS),
            adapted
                .outer_iter()
                .flat_map(|frame| {
                    let frame = frame.to_slice().expect("standard layout");
                    self.corrections.pose(frame).numbers().map(f64::from)
                })
                .collect(),
        );
        products += &poses.expect("a pose a frame").dot(&self.carried);
        let free = self.few.decoder.deform(for_decoder.view(), SILENT)?;
        let mut moved = free.clone();
        self.few
            .each_frame(adapted.view(), &mut moved, |landmarks, frame| {
                self.few.corrections.apply(landmarks, frame);
            });
        let shown = moved.select(Axis(1), &self.shown);
        moved -= &free;
        let (frames, vertices, _) = moved.dim();
        let flat = moved.into_shape_with_order((frames, 3 * vertices));
        let corrected = flat.expect("row-major array").dot(&self.shapes);
        products += &corrected.mapv(f64::from);
        Ok((products, shown))
    }
}
