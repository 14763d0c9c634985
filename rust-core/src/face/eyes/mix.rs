//! Interpolation between values.

/// Rises smoothly from 0 at 0 to 1 at 1, and stays constant outside.
#[inline]
pub(crate) fn ease(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Linear interpolation between two values.
pub(crate) trait Mix: Copy {
    fn mixed(self, other: Self, share: f32) -> Self;
}

impl Mix for f32 {
    #[inline]
    fn mixed(self, other: f32, share: f32) -> f32 {
        self * (1.0 - share) + other * share
    }
}

impl Mix for [f32; 3] {
    #[inline]
    fn mixed(self, other: [f32; 3], share: f32) -> [f32; 3] {
        let at = |i: usize| self[i].mixed(other[i], share);
        [at(0), at(1), at(2)]
    }
}
