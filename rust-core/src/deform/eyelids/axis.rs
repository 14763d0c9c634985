//! Angles about the axis across an eye, in the eye's frame.

/// Angle of a point above the plane of across and front, radians.
pub(super) fn elevation(p: [f32; 3]) -> f32 {
    p[1].atan2(p[2])
}

/// A point turned up by an angle about the axis across.
pub(super) fn turn(p: [f32; 3], angle: f32) -> [f32; 3] {
    let (sine, cosine) = angle.sin_cos();
    [
        p[0],
        cosine * p[1] + sine * p[2],
        cosine * p[2] - sine * p[1],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_keeps_the_distance_from_the_axis() {
        let p = turn([0.4, 0.3, 1.1], 0.7);
        assert!((p[1].hypot(p[2]) - 0.3f32.hypot(1.1)).abs() < 1e-6);
        assert!((elevation(p) - elevation([0.4, 0.3, 1.1]) - 0.7).abs() < 1e-6);
        assert_eq!(turn([0.4, 0.3, 1.1], 0.0), [0.4, 0.3, 1.1]);
    }
}
