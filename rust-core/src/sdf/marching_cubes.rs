//! Marching cubes (Lorensen & Cline 1987): the surface where a field is zero, as triangles.

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

use super::{
    grid::{BRICK, BRICK_BYTES, Grid, NONE, Sparse},
    table::TABLE,
};
use crate::{Error, Result, mesh::Mesh};

/// A cell is divided if the field changes sign between its corners or if, at a corner, it is within
/// this share of the cell's diagonal of zero. One half would be exact for true distances, but
/// learned fields are steeper in places.
const REACH: f32 = 0.65;
/// About how many cells lie along the longest side of the coarsest grid.
const COARSEST: usize = 16;
/// The most bytes that making a surface may take.
const MAX_BYTES: usize = 1 << 30;
/// Points in one call of the field.
const BLOCK: usize = 1024;

/// The surface where `field` is zero. Triangles run counter-clockwise, seen from the positive side.
///
/// `field` takes points `[Q, 3]` and returns the signed distance at each, in the same unit,
/// negative inside. It is evaluated on a coarse grid, then in ever finer cells near the surface.
/// The search follows the surface from cell to cell, so the mesh is closed if the surface closes
/// within the grid. Where the surface leaves the grid, the mesh is open.
///
/// # Errors
/// `InvalidInput` for a field that is not finite, for a grid that contains no surface, and for a
/// surface that needs more than 1 GiB; this message gives the numbers.
pub fn surface(grid: Grid, field: impl Fn(ArrayView2<'_, f32>) -> Vec<f32> + Sync) -> Result<Mesh> {
    meshed(grid, field, REACH, MAX_BYTES)
}

type Corner = [usize; 3];

fn meshed(
    grid: Grid,
    field: impl Fn(ArrayView2<'_, f32>) -> Vec<f32> + Sync,
    reach: f32,
    most_bytes: usize,
) -> Result<Mesh> {
    let longest = grid.cells.into_iter().max().unwrap_or_default();
    let mut size = (longest / COARSEST).next_power_of_two().max(BRICK);
    let cells = grid.cells.map(|cells| cells.next_multiple_of(size));
    let mut known = Known {
        sparse: Sparse::new(cells),
        grid,
        field,
    };
    check_bytes(longest, known.sparse.bytes(), most_bytes)?;
    let steps = |axis: usize| (0..cells[axis]).step_by(size);
    let mut near: Vec<Corner> = steps(2)
        .flat_map(|z| steps(1).flat_map(move |y| steps(0).map(move |x| [x, y, z])))
        .collect();
    while size > 1 {
        known.ask(&near, size)?;
        near.retain(|cell| known.is_near(*cell, size, reach));
        if size == BRICK {
            // Cells of this size are bricks. The values on their far sides lie in the next bricks.
            check_bytes(longest, near.len() * BRICK_BYTES * 3 / 2, most_bytes)?;
        }
        size /= 2;
        let halves = near.iter();
        near = halves
            .flat_map(|cell| (0..8).map(|corner| corner_of(*cell, corner, size)))
            .filter(|cell| cell.iter().zip(grid.cells).all(|(x, cells)| *x < cells))
            .collect();
    }
    let crossed = known.follow(near, (longest, most_bytes))?;
    let mesh = known.joined(&crossed)?;
    if mesh.triangles.is_empty() {
        wrong("expected the field to be zero somewhere in the grid, got one sign".to_owned())
    } else {
        Ok(mesh)
    }
}

fn wrong<T>(complaint: String) -> Result<T> {
    Err(Error::InvalidInput(format!("surface: {complaint}")))
}

fn check_bytes(longest: usize, bytes: usize, most: usize) -> Result<()> {
    let mb = |bytes: usize| bytes.div_ceil(1 << 20);
    if bytes > most {
        wrong(format!(
            "{longest} cells along a side need {} MB for this field, expected at most {} MB; choose fewer cells",
            mb(bytes),
            mb(most)
        ))
    } else {
        Ok(())
    }
}

fn corner_of(cell: Corner, corner: usize, size: usize) -> Corner {
    std::array::from_fn(|axis| cell[axis] + size * (corner >> axis & 1))
}

/// The grid and the known values of the field.
struct Known<F> {
    grid: Grid,
    sparse: Sparse,
    field: F,
}

impl<F: Fn(ArrayView2<'_, f32>) -> Vec<f32> + Sync> Known<F> {
    /// Evaluates the field at the corners of cells.
    fn ask(&mut self, cells: &[Corner], size: usize) -> Result<()> {
        let mut unknown = Vec::new();
        for corner in cells
            .iter()
            .flat_map(|cell| (0..8).map(|c| corner_of(*cell, c, size)))
        {
            let slot = self.sparse.slot(corner);
            let value = self.sparse.value_mut(slot);
            if value.is_nan() {
                *value = f32::INFINITY;
                unknown.push((slot, self.grid.place(corner)));
            }
        }
        let places: Vec<[f32; 3]> = unknown.iter().map(|(_, place)| *place).collect();
        for ((slot, _), value) in unknown.iter().zip(self.values(&places)?) {
            *self.sparse.value_mut(*slot) = value;
        }
        Ok(())
    }

    /// The values of the field at `places`.
    fn values(&self, places: &[[f32; 3]]) -> Result<Vec<f32>> {
        let blocks = places.par_chunks(BLOCK).map(|block| {
            let points = Array2::from_shape_vec((block.len(), 3), block.as_flattened().to_vec());
            let values = (self.field)(points.expect("three numbers each").view());
            match values.iter().position(|value| !value.is_finite()) {
                Some(bad) => wrong(format!(
                    "expected a finite field, got {} at {:?}",
                    values[bad], block[bad]
                )),
                None => Ok(values),
            }
        });
        Ok(blocks.collect::<Result<Vec<_>>>()?.concat())
    }

    /// Whether the surface may cross a cell.
    fn is_near(&self, cell: Corner, size: usize, reach: f32) -> bool {
        let reach = reach * 3f32.sqrt() * self.grid.step * size as f32;
        let values = (0..8).map(|corner| self.sparse.value(corner_of(cell, corner, size)));
        let (low, high) = values.fold((f32::MAX, f32::MIN), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        low < reach && high > -reach
    }

    /// The case of a fine cell: one bit for each corner that is inside.
    fn case(&self, cell: Corner) -> usize {
        (0..8).fold(0, |case, corner| {
            let value = self.sparse.value(corner_of(cell, corner, 1));
            case | usize::from(value < 0.0) << corner
        })
    }

    /// Finds all cells that the surface crosses. Starts with those in `first` and follows the
    /// surface from cell to cell.
    fn follow(
        &mut self,
        first: Vec<Corner>,
        (longest, most_bytes): (usize, usize),
    ) -> Result<Vec<Corner>> {
        let mut crossed = Vec::new();
        let mut next: Vec<Corner> = first
            .into_iter()
            .filter(|cell| self.sparse.see(*cell))
            .collect();
        while !next.is_empty() {
            self.ask(&next, 1)?;
            check_bytes(longest, self.sparse.bytes(), most_bytes)?;
            let mut beside = Vec::new();
            for cell in next {
                let case = self.case(cell);
                if case == 0 || case == 255 {
                    continue;
                }
                crossed.push(cell);
                for (axis, side) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]) {
                    let of_side = (0..8).filter(|corner| corner >> axis & 1 == side);
                    let inside = of_side.filter(|corner| case >> corner & 1 == 1).count();
                    let beyond = match side {
                        0 => cell[axis].checked_sub(1),
                        _ => Some(cell[axis] + 1).filter(|x| *x < self.grid.cells[axis]),
                    };
                    let (1..=3, Some(beyond)) = (inside, beyond) else {
                        continue;
                    };
                    let mut other = cell;
                    other[axis] = beyond;
                    if self.sparse.see(other) {
                        beside.push(other);
                    }
                }
            }
            next = beside;
        }
        Ok(crossed)
    }

    /// Makes the mesh from the cells that the surface crosses.
    fn joined(&mut self, cells: &[Corner]) -> Result<Mesh> {
        let mut triangles = Vec::new();
        let mut edges: Vec<[Corner; 2]> = Vec::new();
        for cell in cells {
            for triangle in &TABLE[self.case(*cell)] {
                triangles.push(triangle.map(|[a, b]| {
                    let ends = [a, b].map(|corner| corner_of(*cell, corner, 1));
                    let axis = (a ^ b).trailing_zeros() as usize;
                    let vertex = self.sparse.vertex_mut(ends[0], axis);
                    if *vertex == NONE {
                        *vertex = edges.len() as u32;
                        edges.push(ends);
                    }
                    *vertex
                }));
            }
        }
        Ok(Mesh {
            positions: self.crossings(&edges)?,
            triangles,
        })
    }

    /// The zeros of the field on edges. Interpolates between the two ends, then once more between
    /// that point and the end with the opposite sign. The result stays a little away from both
    /// ends, so that no triangle vanishes.
    fn crossings(&self, edges: &[[Corner; 2]]) -> Result<Vec<[f32; 3]>> {
        const NEAREST: f32 = 1e-3;
        let between = |[a, b]: [f32; 2]| a / (a - b);
        let ends: Vec<[f32; 2]> = edges
            .iter()
            .map(|ends| ends.map(|corner| self.sparse.value(corner)))
            .collect();
        let place = |ends: &[Corner; 2], share: f32| -> [f32; 3] {
            let [from, to] = ends.map(|corner| self.grid.place(corner));
            std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]))
        };
        let first: Vec<f32> = ends.iter().map(|ends| between(*ends)).collect();
        let places: Vec<[f32; 3]> = edges
            .iter()
            .zip(&first)
            .map(|(ends, share)| place(ends, *share))
            .collect();
        let there = self.values(&places)?;
        let again = edges.iter().zip(&ends).zip(first.iter().zip(&there));
        let again = again.map(|((edge, [a, b]), (share, here))| {
            let share = if (*here < 0.0) == (*a < 0.0) {
                share + (1.0 - share) * between([*here, *b])
            } else {
                share * between([*a, *here])
            };
            place(edge, share.clamp(NEAREST, 1.0 - NEAREST))
        });
        Ok(again.collect())
    }
}

#[cfg(test)]
mod tests {
    use std::{
        collections::HashMap,
        sync::atomic::{AtomicUsize, Ordering},
    };

    use rand::{Rng, SeedableRng};

    use super::*;
    use glam::DVec3;

    fn grid(cells: usize) -> Grid {
        Grid::of_box([-1.0; 3], [1.0; 3], cells).unwrap()
    }

    fn sphere(points: ArrayView2<'_, f32>) -> Vec<f32> {
        let points = points.outer_iter();
        points.map(|p| p.dot(&p).sqrt() - 0.7).collect()
    }

    /// How often each directed edge is used.
    fn directed(mesh: &Mesh) -> HashMap<(u32, u32), usize> {
        let mut used = HashMap::new();
        for [a, b, c] in &mesh.triangles {
            for ends in [(*a, *b), (*b, *c), (*c, *a)] {
                *used.entry(ends).or_default() += 1;
            }
        }
        used
    }

    fn assert_closed(mesh: &Mesh) {
        let used = directed(mesh);
        for ((a, b), count) in &used {
            assert_eq!(Some(count), used.get(&(*b, *a)), "edge {a} {b}");
        }
    }

    #[test]
    fn a_sphere_is_closed_and_has_its_size() {
        let mesh = surface(grid(32), sphere).unwrap();
        assert_closed(&mesh);
        let used = directed(&mesh);
        assert!(used.values().all(|count| *count == 1));
        let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
        assert_eq!(vertices + faces, used.len() / 2 + 2, "Euler's formula");
        let volume: f64 = mesh
            .triangles
            .iter()
            .map(|t| t.map(|v| mesh.positions[v as usize].map(f64::from)))
            .map(|[a, b, c]| DVec3::from(a).dot(DVec3::from(b).cross(c.into())) / 6.0)
            .sum();
        let truth = 4.0 / 3.0 * std::f64::consts::PI * 0.7f64.powi(3);
        assert!((volume / truth - 1.0).abs() < 0.01, "{volume} for {truth}");
        for p in &mesh.positions {
            let off = p.iter().map(|x| x * x).sum::<f32>().sqrt() - 0.7;
            // The cells are 0.0625 wide.
            assert!(off.abs() < 3e-4, "{off}");
        }
    }

    #[test]
    fn looking_near_the_surface_alone_loses_nothing() {
        let evaluated = AtomicUsize::new(0);
        let count = |points: ArrayView2<'_, f32>| {
            evaluated.fetch_add(points.nrows(), Ordering::Relaxed);
            sphere(points)
        };
        let every = meshed(grid(40), sphere, 1e6, MAX_BYTES).unwrap();
        let few = surface(grid(40), count).unwrap();
        assert!(evaluated.into_inner() < 41usize.pow(3) / 2);
        let sorted = |mesh: &Mesh| {
            let mut places: Vec<_> = mesh.positions.iter().map(|p| p.map(f32::to_bits)).collect();
            places.sort_unstable();
            places
        };
        assert_eq!(sorted(&every), sorted(&few));
        assert_eq!(every.triangles.len(), few.triangles.len());
    }

    /// The field is far steeper than a distance, so the search must follow its surface.
    #[test]
    fn a_surface_that_was_seen_in_one_place_is_followed_all_round() {
        let steep = |points: ArrayView2<'_, f32>| -> Vec<f32> {
            let along = points.outer_iter().map(|p| 1.0 + 40.0 * (p[0] + 1.0));
            sphere(points)
                .into_iter()
                .zip(along)
                .map(|(s, steep)| s * steep)
                .collect()
        };
        let mesh = surface(grid(64), steep).unwrap();
        assert_closed(&mesh);
        assert_eq!(
            mesh.triangles.len(),
            surface(grid(64), sphere).unwrap().triangles.len()
        );
    }

    /// Random signs produce every case.
    #[test]
    fn noise_is_closed_in_every_case() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let values: Vec<f32> = (0..17usize.pow(3))
            .map(|_| random.random_range(-1.0..1.0))
            .collect();
        let grid = grid(16);
        let corner = |x: f32| ((x + 1.0) / grid.step).round() as usize;
        let noise = |points: ArrayView2<'_, f32>| -> Vec<f32> {
            let at = |p: [usize; 3]| {
                if p.iter().all(|x| (1..16).contains(x)) {
                    values[(p[2] * 17 + p[1]) * 17 + p[0]]
                } else {
                    1.0
                }
            };
            points
                .outer_iter()
                .map(|p| at([corner(p[0]), corner(p[1]), corner(p[2])]))
                .collect()
        };
        assert_closed(&meshed(grid, noise, 1e6, MAX_BYTES).unwrap());
        let inside = |x: usize, y: usize, z: usize| values[(z * 17 + y) * 17 + x] < 0.0;
        let mut cases = [false; 256];
        for n in 0..14usize.pow(3) {
            let [x, y, z] = [1 + n % 14, 1 + n / 14 % 14, 1 + n / 196];
            let bit =
                |c: usize| usize::from(inside(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2))) << c;
            cases[(0..8).map(bit).sum::<usize>()] = true;
        }
        assert!(cases.iter().all(|occurs| *occurs), "all 256 cases");
    }

    #[test]
    fn wrong_grids_and_fields_are_told() {
        let message = |result: Result<Mesh>| result.unwrap_err().to_string();
        let box_of = |cells| Grid::of_box([-1.0; 3], [1.0; 3], cells).map(|_| Mesh::default());
        assert!(message(box_of(0)).contains("1 to 4096"));
        assert!(message(box_of(5000)).contains("got 5000"));
        let flat = Grid::of_box([0.0; 3], [1.0, 0.0, 1.0], 8).map(|_| Mesh::default());
        assert!(message(flat).contains("finite box"));
        let one_sign = |points: ArrayView2<'_, f32>| vec![1.0; points.nrows()];
        assert!(message(surface(grid(8), one_sign)).contains("one sign"));
        let nan = |points: ArrayView2<'_, f32>| vec![f32::NAN; points.nrows()];
        assert!(message(surface(grid(8), nan)).contains("finite field"));
    }

    #[test]
    fn memory_is_told_before_it_is_taken() {
        let evaluated = AtomicUsize::new(0);
        let count = |points: ArrayView2<'_, f32>| {
            evaluated.fetch_add(points.nrows(), Ordering::Relaxed);
            sphere(points)
        };
        let error = meshed(grid(1024), count, REACH, 64 << 20)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("1024 cells") && error.contains("at most 64 MB"),
            "{error}"
        );
        assert!(
            evaluated.into_inner() < 400_000,
            "the fine cells were not asked"
        );
    }
}
