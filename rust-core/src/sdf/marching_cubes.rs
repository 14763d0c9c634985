//! Marching cubes (Lorensen & Cline 1987): the surface where a field is zero, as triangles.
//!
//! The table of the 256 cases is made, not printed: on each face of a cell every run of inside corners is cut
//! off by a segment, and segments join to loops. A face that is seen from two cells is cut alike in both, also
//! where the choice is ambiguous, so that surfaces have no holes.

use std::{collections::HashMap, sync::LazyLock};

use ndarray::{Array2, ArrayView2};

use crate::{Error, Result, mesh::Mesh};

/// Fine cells along a side of a coarse one.
const COARSE: usize = 4;
/// A coarse cell is looked into where the field at a corner is below so many of its diagonals.
const REACH: f32 = 1.0;
/// The most cells along a side: the grid of corners then takes 0.5 GB.
const MOST: usize = 512;
/// Points that the field is asked at a time.
const BLOCK: usize = 16_384;

/// Corners of a cell: bit 0 is x, bit 1 y, bit 2 z.
const FACES: [[usize; 4]; 6] = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
];

/// For each case the triangles; an edge is its two corners, the lower one first.
static TABLE: LazyLock<Vec<Vec<[Edge; 3]>>> =
    LazyLock::new(|| (0..256).map(triangles_of).collect());

type Edge = [usize; 2];

/// A cube that holds the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Its lowest corner.
    pub low: [f32; 3],
    /// Its side.
    pub side: f32,
    /// Fine cells along a side; rounded up to a multiple of 4.
    pub cells: usize,
}

impl Grid {
    fn corners(&self) -> usize {
        self.cells + 1
    }

    fn number(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.corners() + y) * self.corners() + x
    }

    fn place(&self, number: usize) -> [f32; 3] {
        let n = self.corners();
        let at = [number % n, number / n % n, number / (n * n)];
        let step = self.side / self.cells as f32;
        std::array::from_fn(|axis| self.low[axis] + step * at[axis] as f32)
    }
}

/// The surface where `field` is zero; triangles run counter-clockwise seen from where it is positive.
///
/// `field` takes points `[Q, 3]` and returns the signed distance at each, in the same unit, negative inside.
/// It is asked on a coarse grid, and again in the coarse cells that lie near the surface. What the surface
/// does outside the grid is not seen: there it is left open.
///
/// # Errors
/// `InvalidInput` for a grid without cells, with more than 512 along a side, without size, for a field that
/// is not finite, and where nothing of the surface is found.
pub fn surface(grid: Grid, field: impl FnMut(ArrayView2<'_, f32>) -> Vec<f32>) -> Result<Mesh> {
    meshed(grid, field, REACH)
}

fn meshed(
    mut grid: Grid,
    mut field: impl FnMut(ArrayView2<'_, f32>) -> Vec<f32>,
    reach: f32,
) -> Result<Mesh> {
    let wrong = |complaint: String| Err(Error::InvalidInput(format!("surface: {complaint}")));
    if grid.cells == 0 || grid.cells > MOST {
        return wrong(format!("expected 1 to {MOST} cells, got {}", grid.cells));
    }
    if !(grid.side > 0.0 && grid.side.is_finite() && grid.low.iter().all(|x| x.is_finite())) {
        let Grid { low, side, .. } = grid;
        return wrong(format!(
            "expected a finite cube, got {low:?} and side {side}"
        ));
    }
    grid.cells = grid.cells.next_multiple_of(COARSE);
    let mut values = vec![f32::NAN; grid.corners().pow(3)];
    let steps = || (0..=grid.cells).step_by(COARSE);
    let coarse: Vec<usize> = steps()
        .flat_map(|z| steps().flat_map(move |y| steps().map(move |x| [x, y, z])))
        .map(|at| grid.number(at))
        .collect();
    ask(&grid, &coarse, &mut values, &mut field)?;
    let near = near_cells(&grid, &values, reach);
    let mut fine: Vec<usize> = near
        .iter()
        .flat_map(|cell| inside_of(*cell, COARSE + 1))
        .map(|at| grid.number(at))
        .filter(|number| values[*number].is_nan())
        .collect();
    fine.sort_unstable();
    fine.dedup();
    ask(&grid, &fine, &mut values, &mut field)?;
    let cells = near.iter().flat_map(|cell| inside_of(*cell, COARSE));
    let mesh = joined(&grid, &values, cells);
    match mesh.triangles.is_empty() {
        true => {
            wrong("expected the field to be zero somewhere in the grid, got one sign".to_owned())
        }
        false => Ok(mesh),
    }
}

/// Writes the field at the corners of these numbers into `values`.
fn ask(
    grid: &Grid,
    numbers: &[usize],
    values: &mut [f32],
    field: &mut impl FnMut(ArrayView2<'_, f32>) -> Vec<f32>,
) -> Result<()> {
    for block in numbers.chunks(BLOCK) {
        let places: Vec<f32> = block.iter().flat_map(|n| grid.place(*n)).collect();
        let places = Array2::from_shape_vec((block.len(), 3), places).expect("three per point");
        let made = field(places.view());
        for (number, value) in block.iter().zip(made) {
            if !value.is_finite() {
                let place = grid.place(*number);
                return Err(Error::InvalidInput(format!(
                    "surface: expected a finite field, got {value} at {place:?}"
                )));
            }
            values[*number] = value;
        }
    }
    Ok(())
}

/// Lowest corners of coarse cells that the surface may cross.
fn near_cells(grid: &Grid, values: &[f32], reach: f32) -> Vec<[usize; 3]> {
    let step = COARSE as f32 * grid.side / grid.cells as f32;
    let reach = reach * step * 3f32.sqrt();
    let starts = || (0..grid.cells).step_by(COARSE);
    starts()
        .flat_map(|z| starts().flat_map(move |y| starts().map(move |x| [x, y, z])))
        .filter(|cell| {
            let at = (0..8).map(|corner| values[grid.number(corner_of(*cell, corner, COARSE))]);
            let (low, high) = at.fold((f32::MAX, f32::MIN), |(low, high), x| {
                (low.min(x), high.max(x))
            });
            low < reach && high > -reach
        })
        .collect()
}

fn corner_of(cell: [usize; 3], corner: usize, size: usize) -> [usize; 3] {
    std::array::from_fn(|axis| cell[axis] + size * (corner >> axis & 1))
}

fn inside_of(cell: [usize; 3], count: usize) -> impl Iterator<Item = [usize; 3]> {
    let [x, y, z] = cell;
    (0..count.pow(3)).map(move |n| {
        [
            x + n % count,
            y + n / count % count,
            z + n / (count * count),
        ]
    })
}

/// Triangles of all `cells`, whose corners are known.
fn joined(grid: &Grid, values: &[f32], cells: impl Iterator<Item = [usize; 3]>) -> Mesh {
    let mut mesh = Mesh::default();
    let mut known: HashMap<[usize; 2], u32> = HashMap::new();
    for cell in cells {
        let numbers: [usize; 8] =
            std::array::from_fn(|corner| grid.number(corner_of(cell, corner, 1)));
        let case = (0..8).fold(0, |case, c| {
            case | usize::from(values[numbers[c]] < 0.0) << c
        });
        for triangle in &TABLE[case] {
            mesh.triangles.push(triangle.map(|edge| {
                let ends = edge.map(|corner| numbers[corner]);
                *known.entry(ends).or_insert_with(|| {
                    mesh.positions.push(crossing(grid, values, ends));
                    mesh.positions.len() as u32 - 1
                })
            }));
        }
    }
    mesh
}

/// Where the field is zero on the way between two corners; a little off either, so that no triangle vanishes.
fn crossing(grid: &Grid, values: &[f32], [a, b]: [usize; 2]) -> [f32; 3] {
    let share = (values[a] / (values[a] - values[b])).clamp(1e-3, 1.0 - 1e-3);
    let (from, to) = (grid.place(a), grid.place(b));
    std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]))
}

/// Loops of one case, each as a fan.
fn triangles_of(case: usize) -> Vec<[Edge; 3]> {
    let inside = |corner: usize| case >> corner & 1 == 1;
    let mut next: HashMap<Edge, Edge> = HashMap::new();
    for face in FACES {
        let ends = |n: usize| [face[n % 4], face[(n + 1) % 4]];
        for enter in (0..4).filter(|n| !inside(ends(*n)[0]) && inside(ends(*n)[1])) {
            let leave = (enter + 1..enter + 4).find(|n| !inside(ends(*n)[1]));
            let leave = leave.expect("a run of inside corners ends");
            next.insert(edge(ends(enter)), edge(ends(leave)));
        }
    }
    let mut starts: Vec<Edge> = next.keys().copied().collect();
    starts.sort_unstable();
    let mut triangles = Vec::new();
    for start in starts {
        let mut around = Vec::new();
        let mut at = start;
        while let Some(to) = next.remove(&at) {
            around.push(at);
            at = to;
        }
        triangles.extend(fan(&around));
    }
    triangles
}

fn edge([a, b]: [usize; 2]) -> Edge {
    [a.min(b), a.max(b)]
}

/// A loop as triangles from the corner whose diagonals lie in no face: there the neighbour has its own edges.
fn fan(around: &[Edge]) -> Vec<[Edge; 3]> {
    let count = around.len();
    let fan_from = |first: usize| -> Vec<[Edge; 3]> {
        (1..count.saturating_sub(1))
            .map(|n| [first, first + n, first + n + 1].map(|k| around[k % count]))
            .collect()
    };
    let in_faces = |first: usize| {
        (2..count.saturating_sub(1))
            .filter(|n| share_a_face(around[first], around[(first + n) % count]))
            .count()
    };
    match (0..count).min_by_key(|first| in_faces(*first)) {
        Some(first) => fan_from(first),
        None => Vec::new(),
    }
}

fn share_a_face(a: Edge, b: Edge) -> bool {
    let lies_in = |face: &[usize; 4], edge: Edge| edge.iter().all(|corner| face.contains(corner));
    FACES
        .iter()
        .any(|face| lies_in(face, a) && lies_in(face, b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::vec3;
    use rand::{Rng, SeedableRng};

    fn grid(cells: usize) -> Grid {
        Grid {
            low: [-1.0; 3],
            side: 2.0,
            cells,
        }
    }

    fn sphere(points: ArrayView2<'_, f32>) -> Vec<f32> {
        points
            .outer_iter()
            .map(|p| p.dot(&p).sqrt() - 0.7)
            .collect()
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

    fn assert_watertight(mesh: &Mesh) {
        let used = directed(mesh);
        for ((a, b), count) in &used {
            assert_eq!((*count, used.get(&(*b, *a))), (1, Some(&1)), "edge {a} {b}");
        }
    }

    #[test]
    fn a_sphere_is_closed_and_has_its_size() {
        let mesh = surface(grid(32), sphere).unwrap();
        assert_watertight(&mesh);
        let used = directed(&mesh).len() / 2;
        assert_eq!(mesh.positions.len() + mesh.triangles.len(), used + 2);
        let volume: f64 = mesh
            .triangles
            .iter()
            .map(|t| t.map(|v| mesh.positions[v as usize]))
            .map(|t| t.map(|x| x.map(f64::from)))
            .map(|[a, b, c]| vec3::dot(a, vec3::cross(b, c)) / 6.0)
            .sum();
        let truth = 4.0 / 3.0 * std::f64::consts::PI * 0.7f64.powi(3);
        assert!((volume / truth - 1.0).abs() < 0.01, "{volume} for {truth}");
    }

    #[test]
    fn looking_near_the_surface_alone_loses_nothing() {
        let every = meshed(grid(24), sphere, 1e6).unwrap();
        let mut asked = 0;
        let few = surface(grid(24), |points| {
            asked += points.nrows();
            sphere(points)
        });
        let few = few.unwrap();
        assert!(asked < 25usize.pow(3) * 3 / 4, "{asked}");
        let sorted = |mesh: &Mesh| {
            let mut places: Vec<_> = mesh.positions.iter().map(|p| p.map(f32::to_bits)).collect();
            places.sort_unstable();
            places
        };
        assert_eq!(sorted(&every), sorted(&few));
        assert_eq!(every.triangles.len(), few.triangles.len());
    }

    #[test]
    fn noise_is_closed_in_every_case() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut cases = [false; 256];
        let grid = grid(16);
        let mut values = vec![1.0f32; grid.corners().pow(3)];
        for at in inside_of([1; 3], 15) {
            values[grid.number(at)] = random.random_range(-1.0..1.0);
        }
        for cell in inside_of([0; 3], 16) {
            let inside = |c| values[grid.number(corner_of(cell, c, 1))] < 0.0;
            let case = (0..8).fold(0, |case, c| case | usize::from(inside(c)) << c);
            cases[case] = true;
        }
        assert!(cases.iter().all(|seen| *seen), "all 256 cases");
        let mesh = joined(&grid, &values, inside_of([0; 3], 16));
        let used = directed(&mesh);
        for ((a, b), count) in &used {
            assert_eq!(Some(count), used.get(&(*b, *a)), "edge {a} {b}");
        }
    }

    #[test]
    fn wrong_grids_and_fields_are_told() {
        let told = |made: Result<Mesh>| made.unwrap_err().to_string();
        assert!(told(surface(grid(1024), sphere)).contains("1 to 512 cells, got 1024"));
        let one_sign = |points: ArrayView2<'_, f32>| vec![1.0; points.nrows()];
        assert!(told(surface(grid(8), one_sign)).contains("one sign"));
        let nan = |points: ArrayView2<'_, f32>| vec![f32::NAN; points.nrows()];
        assert!(told(surface(grid(8), nan)).contains("finite field"));
    }
}
