//! Fits the shapes of a basis to other motion, using only some of the vertices where they suffice.

use faer::{Mat, Side, linalg::solvers::Solve};
use ndarray::{Array2, Array3, ArrayView2};

use super::compression::VertexBasis;
use crate::{
    Error, Result,
    nn::matrix::{by_row_blocks, product, rows_of, view, view_mut},
};

/// Added to the diagonal of the products of shapes of length 1, so that two equal shapes get equal
/// weights.
const RIDGE: f64 = 1e-9;

/// Finds the weights that bring the shapes of a basis nearest to a motion of some vertices. Every
/// vertex counts the same.
pub struct Projection {
    /// `[K, 3S]`, each shape scaled to length 1.
    shapes: Array2<f32>,
    /// `[K]`, the lengths of the shapes before scaling.
    lengths: Vec<f32>,
    /// `[K, K]`, the inverse of the products of the shapes.
    inverse: Mat<f64>,
}

impl Projection {
    /// Prepares the shapes of a basis at `vertices` `[S]`.
    ///
    /// # Errors
    /// `Numerics` for shapes that are not finite.
    pub fn new(basis: &VertexBasis, vertices: &[u32]) -> Result<Projection> {
        let count = basis.shapes.dim().0;
        let mut shapes = Array2::from_shape_fn((count, 3 * vertices.len()), |(k, i)| {
            basis.shapes[[k, vertices[i / 3] as usize, i % 3]]
        });
        let mut lengths = Vec::with_capacity(count);
        for mut shape in shapes.rows_mut() {
            let squares: f64 = shape.iter().map(|x| f64::from(*x).powi(2)).sum();
            let length = squares.sqrt().max(f64::MIN_POSITIVE) as f32;
            shape.mapv_inplace(|x| x / length.max(f32::MIN_POSITIVE));
            lengths.push(length.max(f32::MIN_POSITIVE));
        }
        let products = products(shapes.view(), &shapes);
        let gram = Mat::from_fn(count, count, |i, j| {
            let ridge = if i == j { RIDGE } else { 0.0 };
            f64::from(0.5 * (products[[i, j]] + products[[j, i]])) + ridge
        });
        let solver = gram
            .llt(Side::Lower)
            .map_err(|e| Error::Numerics(format!("projection: products of shapes: {e:?}")))?;
        let inverse = solver.solve(Mat::<f64>::identity(count, count));
        Ok(Projection {
            shapes,
            lengths,
            inverse,
        })
    }

    /// Number `K` of shapes.
    pub fn shapes(&self) -> usize {
        self.shapes.nrows()
    }

    /// `[K]`: the largest displacement of any of the vertices by each shape at weight 1.
    pub fn sizes(&self) -> Vec<f32> {
        let shapes = self.shapes.rows().into_iter().zip(&self.lengths);
        let size = |(shape, length): (ndarray::ArrayView1<'_, f32>, &f32)| {
            let (rows, _) = shape.to_slice().expect("row-major").as_chunks::<3>();
            let squares = rows.iter().map(|[x, y, z]| x * x + y * y + z * z);
            length * squares.fold(0.0, f32::max).sqrt()
        };
        shapes.map(size).collect()
    }

    /// `[T, K]`: the weights that bring the shapes nearest to `displacements` `[T, S, 3]`, mesh units.
    pub fn weights(&self, displacements: &Array3<f32>) -> Array2<f32> {
        let (frames, vertices, _) = displacements.dim();
        let rows = displacements.as_standard_layout();
        let flat = rows.view().into_shape_with_order((frames, 3 * vertices));
        let along = products(flat.expect("row-major"), &self.shapes);
        Array2::from_shape_fn((frames, self.shapes()), |(t, k)| {
            let sum: f64 = (0..self.shapes())
                .map(|j| f64::from(along[[t, j]]) * self.inverse[(j, k)])
                .sum();
            (sum / f64::from(self.lengths[k])) as f32
        })
    }
}

/// Chooses about `count` vertices that tell the shapes of a basis apart. They are in rising order.
///
/// Half of them lie where the shapes move, the other half are spread over the whole mesh. If the
/// mesh has at most `2 · count` vertices, all of them are chosen.
pub fn choose_probes(basis: &VertexBasis, count: usize) -> Vec<u32> {
    let (shapes, vertices, _) = basis.shapes.dim();
    if vertices <= 2 * count || shapes == 0 {
        return (0..vertices as u32).collect();
    }
    let mut movement = vec![0.0f32; vertices];
    let mut squares = vec![0.0f32; vertices];
    for shape in basis.shapes.outer_iter() {
        let shape = shape.as_standard_layout();
        let (rows, _) = shape.as_slice().expect("row-major").as_chunks::<3>();
        for (square, [x, y, z]) in squares.iter_mut().zip(rows) {
            *square = x * x + y * y + z * z;
        }
        let total: f64 = squares.iter().map(|square| f64::from(*square)).sum();
        let share = (1.0 / total.max(f64::MIN_POSITIVE)) as f32;
        for (movement, square) in movement.iter_mut().zip(&squares) {
            *movement += share * square;
        }
    }
    let mut place = 0.0;
    let even = 1.0 / vertices as f64;
    let passes = |(v, movement): (usize, &f32)| {
        let before = f64::floor(place);
        place += 0.5 * count as f64 * (f64::from(*movement) / shapes as f64 + even);
        (place.floor() > before).then_some(v as u32)
    };
    movement.iter().enumerate().filter_map(passes).collect()
}

/// `lhs · rhsᵀ` of `[N, 3S]` and `[K, 3S]`, with row blocks in parallel.
fn products(lhs: ArrayView2<'_, f32>, rhs: &Array2<f32>) -> Array2<f32> {
    let (count, length) = rhs.dim();
    by_row_blocks(lhs.nrows(), count, |rows, out| {
        let values = lhs.slice(ndarray::s![rows, ..]);
        let lhs = rows_of(values.to_slice().expect("row-major array"), length);
        product(view_mut(out, count), lhs, view(rhs).transpose());
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [u32; 40] = {
        let mut all = [0; 40];
        let mut v = 0;
        while v < 40 {
            all[v] = v as u32;
            v += 1;
        }
        all
    };

    fn basis() -> VertexBasis {
        let shapes = Array3::from_shape_fn((3, 40, 3), |(k, v, x)| {
            let (k, v) = (k as f32 + 1.0, (3 * v + x) as f32);
            (0.3 * k * v).sin() / (k * k * k)
        });
        VertexBasis {
            shapes,
            weights: Array2::zeros((5, 3)),
            max_error: 0.0,
            fps: 30.0,
        }
    }

    #[test]
    fn motion_of_the_shapes_has_its_weights_back() {
        let mut basis = basis();
        basis.weights = Array2::from_shape_fn((5, 3), |(t, k)| (t as f32 * 0.7 + k as f32).cos());
        let weights = Projection::new(&basis, &ALL)
            .unwrap()
            .weights(&basis.displacements());
        let difference = (&weights - &basis.weights).mapv(f32::abs);
        assert!(difference.iter().all(|d| *d < 1e-4), "{difference}");
    }

    #[test]
    fn what_is_left_stands_square_on_every_shape() {
        let mut basis = basis();
        let moved =
            Array3::from_shape_fn((5, 40, 3), |(t, v, x)| ((7 * t + 3 * v + x) as f32).sin());
        let projection = Projection::new(&basis, &ALL).unwrap();
        basis.weights = projection.weights(&moved);
        let left = (moved - basis.displacements())
            .into_shape_with_order((5, 120))
            .unwrap();
        let along = products(left.view(), &projection.shapes);
        assert!(along.iter().all(|x| x.abs() < 1e-4), "{along}");
    }

    #[test]
    fn a_shape_that_is_there_twice_shares_its_weight() {
        let mut basis = basis();
        let first = basis.shapes.index_axis(ndarray::Axis(0), 0).to_owned();
        basis
            .shapes
            .index_axis_mut(ndarray::Axis(0), 2)
            .assign(&first);
        basis.weights.column_mut(0).fill(1.0);
        let weights = Projection::new(&basis, &ALL)
            .unwrap()
            .weights(&basis.displacements());
        for row in weights.rows() {
            assert!((row[0] + row[2] - 1.0).abs() < 1e-3, "{row}");
        }
    }

    #[test]
    fn some_vertices_tell_as_much_as_all() {
        let mut basis = basis();
        basis.weights = Array2::from_shape_fn((5, 3), |(t, k)| (t as f32 - k as f32).sin());
        let some = [1, 4, 9, 16, 25, 36];
        let moved = basis
            .displacements()
            .select(ndarray::Axis(1), &some.map(|v| v as usize));
        let weights = Projection::new(&basis, &some).unwrap().weights(&moved);
        assert!(
            (&weights - &basis.weights).iter().all(|d| d.abs() < 1e-3),
            "{weights}"
        );
    }

    #[test]
    fn sizes_are_those_of_whole_shapes() {
        let mut basis = basis();
        basis.shapes.fill(0.0);
        basis.shapes[[1, 7, 0]] = 3.0;
        basis.shapes[[1, 7, 2]] = -4.0;
        basis.shapes[[1, 9, 1]] = 1.0;
        let sizes = Projection::new(&basis, &ALL).unwrap().sizes();
        assert!(
            (sizes[1] - 5.0).abs() < 1e-5 && sizes[0] == 0.0,
            "{sizes:?}"
        );
    }

    #[test]
    fn probes_lie_where_shapes_move_and_all_over() {
        let shapes = Array3::from_shape_fn((2, 9000, 3), |(k, v, _)| match v / 300 {
            7 => (k * 50 + v) as f32,
            _ => 0.0,
        });
        let basis = VertexBasis { shapes, ..basis() };
        let chosen = choose_probes(&basis, 400);
        let moving = chosen.iter().filter(|&&v| v / 300 == 7).count();
        assert!(
            chosen.is_sorted() && (390..=400).contains(&chosen.len()),
            "{}",
            chosen.len()
        );
        assert!((180..240).contains(&moving), "{moving}");
        assert_eq!(choose_probes(&basis, 5000).len(), 9000);
    }
}
