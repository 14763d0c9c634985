//! Vectors `[x, y, z]` in flat rows, such as displacements `[T, 3V]`, in loops that compilers turn
//! into vector code.

use ndarray::{Array2, ArrayView2};

/// Vectors whose lengths are computed together.
const BLOCK: usize = 64;

/// The columns of some `vertices` of `rows` `[N, 3V]`, which are row-major.
pub fn columns_of(rows: ArrayView2<'_, f32>, vertices: &[usize]) -> Array2<f32> {
    let mut chosen = Array2::zeros((rows.nrows(), 3 * vertices.len()));
    for (mut to, from) in chosen.outer_iter_mut().zip(rows.outer_iter()) {
        let (to, from) = (to.as_slice_mut(), from.to_slice());
        let (to, _) = to.expect("row-major").as_chunks_mut::<3>();
        let (from, _) = from.expect("row-major").as_chunks::<3>();
        for (to, &v) in to.iter_mut().zip(vertices) {
            *to = from[v];
        }
    }
    chosen
}

/// The squared distances between `a` and `b`, both `[n, 3]`, into `out` `[n]`.
pub fn squared_distances(a: &[f32], b: &[f32], out: &mut [f32]) {
    let pairs = a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0);
    for (out, (a, b)) in out.iter_mut().zip(pairs) {
        let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
        *out = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    }
}

/// Raises each of `largest` `[n]` to the value beside it.
pub fn raise(largest: &mut [f32], values: &[f32]) {
    for (largest, value) in largest.iter_mut().zip(values) {
        *largest = if value > largest { *value } else { *largest };
    }
}

/// The largest of `values`, none of which is below 0.
pub fn largest(values: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut lanes = [0.0; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    chunks.iter().for_each(|chunk| raise(&mut lanes, chunk));
    raise(&mut lanes, rest);
    lanes.into_iter().fold(0.0, f32::max)
}

/// The squared length of the longest of `vectors` `[3n]`.
pub fn longest_square(vectors: &[f32]) -> f32 {
    let mut squares = [0.0; BLOCK];
    let blocks = vectors.chunks(3 * BLOCK).map(|vectors| {
        let (vectors, _) = vectors.as_chunks::<3>();
        let squares = &mut squares[..vectors.len()];
        for (out, vector) in squares.iter_mut().zip(vectors) {
            *out = square(vector);
        }
        largest(squares)
    });
    blocks.fold(0.0, f32::max)
}

/// The squared length of the longest of `vectors` `[3n]`, and its number.
pub fn longest(vectors: &[f32]) -> (f32, usize) {
    let mut best = (0.0, 0);
    for (block, vectors) in vectors.chunks(3 * BLOCK).enumerate() {
        let longest = longest_square(vectors);
        if longest > best.0 {
            let mut vectors = vectors.as_chunks::<3>().0.iter();
            let number = vectors.position(|vector| square(vector) == longest);
            best = (longest, BLOCK * block + number.unwrap_or(0));
        }
    }
    best
}

fn square([x, y, z]: &[f32; 3]) -> f32 {
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_is_found_in_any_block() {
        for count in [1, 63, 64, 65, 200] {
            for at in [0, count / 2, count - 1] {
                let mut vectors = vec![0.1; 3 * count];
                vectors[3 * at + 1] = -2.0;
                let (square, number) = longest(&vectors);
                assert_eq!((square, number), (longest_square(&vectors), at));
                assert!((square - 4.02).abs() < 1e-6);
            }
        }
        assert_eq!(longest(&[]), (0.0, 0));
    }

    #[test]
    fn columns_are_those_of_the_vertices() {
        let rows = Array2::from_shape_fn((2, 12), |(n, c)| (100 * n + c) as f32);
        let chosen = columns_of(rows.view(), &[1, 3]);
        let expected = [3.0, 4.0, 5.0, 9.0, 10.0, 11.0];
        assert_eq!(chosen.row(0).to_vec(), expected);
        assert_eq!(chosen.row(1).to_vec(), expected.map(|x| x + 100.0));
    }
}
