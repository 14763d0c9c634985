//! A grid that stores only the cells near the surface.

use crate::{Error, Result};

/// Cells along a side of a brick.
pub(super) const BRICK: usize = 8;
const IN_BRICK: usize = BRICK * BRICK * BRICK;
/// The most cells along a side.
const MOST: usize = 4096;

/// A box of equal cubes that holds the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Its lowest corner.
    pub low: [f32; 3],
    /// Side of a cell.
    pub step: f32,
    /// Cells along each axis.
    pub cells: [usize; 3],
}

impl Grid {
    /// The box from `low` to `high` with `resolution` cells along its longest side.
    ///
    /// # Errors
    /// `InvalidInput` for a box that is not finite or has no extent along an axis, and for a
    /// resolution of 0 or above 4096.
    pub fn of_box(low: [f32; 3], high: [f32; 3], resolution: usize) -> Result<Grid> {
        if resolution == 0 || resolution > MOST {
            return Err(Error::InvalidInput(format!(
                "resolution: expected 1 to {MOST} cells along the longest side, got {resolution}"
            )));
        }
        let sides: [f32; 3] = std::array::from_fn(|axis| high[axis] - low[axis]);
        if !sides.iter().chain(&low).all(|x| x.is_finite()) || sides.iter().any(|x| *x <= 0.0) {
            return Err(Error::InvalidInput(format!(
                "surface: expected a finite box, got {low:?} to {high:?}"
            )));
        }
        let step = sides.into_iter().fold(0.0, f32::max) / resolution as f32;
        Ok(Grid {
            low,
            step,
            cells: sides.map(|side| ((side / step).ceil() as usize).max(1)),
        })
    }

    /// The position of a corner.
    pub(super) fn place(&self, corner: [usize; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| self.low[axis] + self.step * corner[axis] as f32)
    }
}

/// The stored part of a grid: values at corners, marks of visited cells, vertices on edges.
pub(super) struct Sparse {
    /// Bricks along each axis.
    bricks: [usize; 3],
    /// Number of each brick, `NONE` if it is not stored.
    brick_numbers: Vec<u32>,
    values: Vec<[f32; IN_BRICK]>,
    visited: Vec<[u64; IN_BRICK / 64]>,
    vertices: Vec<[[u32; 3]; IN_BRICK]>,
}

/// Stands for a missing brick or a missing vertex.
pub(super) const NONE: u32 = u32::MAX;
/// Bytes of a brick.
pub(super) const BRICK_BYTES: usize = IN_BRICK * (4 + 12) + IN_BRICK / 8;

/// The number of a corner's brick, and the corner's index within the brick.
pub(super) type Slot = (usize, usize);

impl Sparse {
    /// Makes an empty store for corners up to `last` on each axis.
    pub fn new(last: [usize; 3]) -> Self {
        let bricks = last.map(|x| x / BRICK + 1);
        Sparse {
            bricks,
            brick_numbers: vec![NONE; bricks.iter().product()],
            values: Vec::new(),
            visited: Vec::new(),
            vertices: Vec::new(),
        }
    }

    /// Bytes that the bricks and their numbers take.
    pub fn bytes(&self) -> usize {
        4 * self.brick_numbers.len() + BRICK_BYTES * self.values.len()
    }

    fn number(&self, at: [usize; 3]) -> (usize, usize) {
        let [x, y, z] = at.map(|x| x / BRICK);
        let brick = (z * self.bricks[1] + y) * self.bricks[0] + x;
        let [x, y, z] = at.map(|x| x % BRICK);
        (brick, (z * BRICK + y) * BRICK + x)
    }

    /// The slot of a corner, or of the cell that begins there. Creates its brick if it is missing.
    pub fn slot(&mut self, at: [usize; 3]) -> Slot {
        let (brick, place) = self.number(at);
        if self.brick_numbers[brick] == NONE {
            self.brick_numbers[brick] = self.values.len() as u32;
            self.values.push([f32::NAN; IN_BRICK]);
            self.visited.push([0; IN_BRICK / 64]);
            self.vertices.push([[NONE; 3]; IN_BRICK]);
        }
        (self.brick_numbers[brick] as usize, place)
    }

    /// The value at a corner, NaN if it is unknown.
    pub fn value(&self, at: [usize; 3]) -> f32 {
        let (brick, place) = self.number(at);
        match self.brick_numbers[brick] {
            NONE => f32::NAN,
            number => self.values[number as usize][place],
        }
    }

    /// The value in a slot.
    pub fn value_mut(&mut self, (brick, place): Slot) -> &mut f32 {
        &mut self.values[brick][place]
    }

    /// Marks a cell as visited. Returns whether this was its first visit.
    pub fn see(&mut self, cell: [usize; 3]) -> bool {
        let (brick, place) = self.slot(cell);
        let word = &mut self.visited[brick][place / 64];
        let bit = 1 << (place % 64);
        let new = *word & bit == 0;
        *word |= bit;
        new
    }

    /// The vertex on the edge that starts at a corner along `axis`, `NONE` if there is none yet.
    pub fn vertex_mut(&mut self, corner: [usize; 3], axis: usize) -> &mut u32 {
        let (brick, place) = self.slot(corner);
        &mut self.vertices[brick][place][axis]
    }
}
