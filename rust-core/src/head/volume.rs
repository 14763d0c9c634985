//! The surface of a head over time. Marching cubes runs once, in the canonical pose. The forward
//! field then moves the vertices that it found, so every frame has the same triangles.

use std::{ops::RangeInclusive, sync::Arc};

use ndarray::{Array2, ArrayView2, ArrayView3};

use super::{Head, Trunks};
use crate::{
    Error, Result,
    job::{ProgressFn, report},
    mesh::Similarity,
};

/// How many cells the grid of a surface over time may have along its longest side.
pub const SURFACE_CELLS: RangeInclusive<usize> = 32..=512;
/// Bytes of a surface over time, divided by the square of its cells along the longest side. They
/// include what the field keeps for each vertex. Measured at 128, 256 and 512 cells.
const BYTES_OF_SQUARE: usize = 2500;

/// The surface of one head, ready for many poses.
pub struct HeadSurface {
    head: Arc<Head>,
    points: Trunks,
    triangles: Vec<[u32; 3]>,
    to_mesh: Similarity,
}

/// Checks a number of cells before any memory is taken.
///
/// # Errors
/// `InvalidInput` outside [`SURFACE_CELLS`] and `OutOfMemory` if there is no room. Both messages
/// say how much memory it would need.
pub fn check_surface_cells(cells: usize) -> Result<()> {
    let bytes = cells.saturating_mul(cells).saturating_mul(BYTES_OF_SQUARE);
    let megabytes = bytes >> 20;
    if !SURFACE_CELLS.contains(&cells) {
        let (low, high) = (SURFACE_CELLS.start(), SURFACE_CELLS.end());
        return Err(Error::InvalidInput(format!(
            "surface: expected {low} to {high} cells along the longest side, got {cells}, which would take about \
             {megabytes} MB of memory"
        )));
    }
    Vec::<u8>::new().try_reserve_exact(bytes).map_err(|_| {
        Error::OutOfMemory(format!(
            "a surface of {cells} cells along the longest side takes about {megabytes} MB; choose fewer cells"
        ))
    })
}

impl HeadSurface {
    /// Makes the surface of the head with `coefficients` `[100]`, with `cells` along the longest
    /// side of the grid. `to_mesh` takes its points from canonical metres to the caller's space.
    ///
    /// # Errors
    /// Those of [`check_surface_cells`]; `InvalidInput` for a wrong count of coefficients or one
    /// that is not finite; `Cancelled`.
    pub fn new(
        head: Arc<Head>,
        coefficients: &[f32],
        to_mesh: Similarity,
        cells: usize,
        progress: ProgressFn<'_>,
    ) -> Result<HeadSurface> {
        check_surface_cells(cells)?;
        let one = head.one(head.identity_code(coefficients)?)?;
        let surface = one.canonical_surface(cells, progress)?;
        report(progress, "surface", 1.0)?;
        let points = one.trunks(surface.positions);
        Ok(HeadSurface {
            points,
            triangles: surface.triangles,
            to_mesh,
            head,
        })
    }

    /// Number `V` of vertices.
    pub fn vertices(&self) -> usize {
        self.points.points.len()
    }

    /// Triangles of every pose, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Vertices `[V]` in the pose of `code` `[X]`.
    ///
    /// # Errors
    /// `InvalidInput` for a code of another length or one that is not finite.
    pub fn at(&self, code: &[f32]) -> Result<Vec<[f32; 3]>> {
        let mut posed = self.points.at(&self.head, code)?;
        posed.iter_mut().for_each(|p| *p = self.to_mesh.apply(*p));
        Ok(posed)
    }

    /// Codes `[T, X]` that move the surface as the landmarks of a take move: see
    /// [`Head::led_codes`].
    ///
    /// # Errors
    /// Those of [`Head::led_codes`].
    pub fn led_codes(
        &self,
        codes: ArrayView2<'_, f32>,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        self.head.led_codes(codes, landmarks, progress)
    }

    /// Vertices `[V]` of the face at rest.
    ///
    /// # Errors
    /// Never fails for a head that could be opened.
    pub fn at_rest(&self) -> Result<Vec<[f32; 3]>> {
        self.at(&self.head.rest_code())
    }
}
