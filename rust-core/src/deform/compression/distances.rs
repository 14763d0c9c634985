//! Distances of many vertices and the largest of them, in loops that compilers turn into vector code.

/// The squared distances between `a` and `b`, both `[n, 3]`, into `out` `[n]`.
pub(super) fn squared_distances(a: &[f32], b: &[f32], out: &mut [f32]) {
    let pairs = a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0);
    for (out, (a, b)) in out.iter_mut().zip(pairs) {
        let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
        *out = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    }
}

/// Raises each of `largest` `[n]` to the value beside it.
pub(super) fn raise(largest: &mut [f32], values: &[f32]) {
    for (largest, value) in largest.iter_mut().zip(values) {
        *largest = if value > largest { *value } else { *largest };
    }
}

/// The largest of `values`, none of which is below 0.
pub(super) fn largest(values: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut lanes = [0.0; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    chunks.iter().for_each(|chunk| raise(&mut lanes, chunk));
    raise(&mut lanes, rest);
    lanes.into_iter().fold(0.0, f32::max)
}
