//! Shared by the point caches, which hold positions instead of displacements.

use std::io::{self, Write};

use ndarray::ArrayView3;

/// Appends rest position + displacement for every vertex and frame, in the byte order of `encode`.
pub(super) fn write_positions(
    file: &mut impl Write,
    displacements: ArrayView3<'_, f32>,
    rest: &[[f32; 3]],
    encode: fn(f32) -> [u8; 4],
) -> io::Result<()> {
    let mut row = Vec::with_capacity(rest.len() * 12);
    for frame in displacements.outer_iter() {
        row.clear();
        for (moved, rest) in frame.outer_iter().zip(rest) {
            for i in 0..3 {
                row.extend_from_slice(&encode(rest[i] + moved[i]));
            }
        }
        file.write_all(&row)?;
    }
    Ok(())
}

/// Point caches store counts as signed 32-bit numbers.
pub(super) fn count(n: usize) -> io::Result<i32> {
    i32::try_from(n).map_err(|_| io::Error::other(format!("expected at most 2^31 − 1, got {n}")))
}
