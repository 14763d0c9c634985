//! Unit vectors for the directions of a surface.
//!
//! `unit` divides by the length. glam's `normalize` multiplies by the reciprocal, which rounds
//! twice. Every result of the library depends on these bits.

use glam::DVec3;

/// `v / |v|`, or the x axis if the length of `v` is zero or not finite.
pub(crate) fn unit(v: DVec3) -> DVec3 {
    let length = v.length();
    if length > 0.0 && length.is_finite() {
        v / length
    } else {
        DVec3::X
    }
}

/// Two unit vectors x and y that form a right-handed frame (x, y, `axis`).
pub(crate) fn perpendicular(axis: DVec3) -> (DVec3, DVec3) {
    let seed = if axis.x.abs() < 0.9 {
        DVec3::X
    } else {
        DVec3::Y
    };
    let y = unit(axis.cross(seed));
    (y.cross(axis), y)
}
