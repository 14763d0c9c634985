//! Directions of a surface. They divide by the length where glam's `normalize` multiplies by its reciprocal,
//! which rounds twice: every result of the library rests on these bits.

use glam::DVec3;

/// `v / |v|`; the x axis where `v` has no length.
pub(crate) fn unit(v: DVec3) -> DVec3 {
    let length = v.length();
    match length > 0.0 && length.is_finite() {
        true => v / length,
        false => DVec3::X,
    }
}

/// Two unit vectors that make a right-handed frame (x, y, `axis`).
pub(crate) fn perpendicular(axis: DVec3) -> (DVec3, DVec3) {
    let seed = if axis.x.abs() < 0.9 {
        DVec3::X
    } else {
        DVec3::Y
    };
    let y = unit(axis.cross(seed));
    (y.cross(axis), y)
}
