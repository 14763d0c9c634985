//! The box around some points.

/// An axis-aligned box.
pub(super) struct Box3 {
    pub low: [f32; 3],
    pub high: [f32; 3],
}

impl Box3 {
    pub(super) fn of(points: impl Iterator<Item = [f32; 3]>) -> Box3 {
        let empty = Box3 {
            low: [f32::INFINITY; 3],
            high: [f32::NEG_INFINITY; 3],
        };
        points.fold(empty, |b, p| Box3 {
            low: std::array::from_fn(|i| b.low[i].min(p[i])),
            high: std::array::from_fn(|i| b.high[i].max(p[i])),
        })
    }

    pub(super) fn middle(&self) -> [f32; 3] {
        std::array::from_fn(|i| 0.5 * (self.low[i] + self.high[i]))
    }

    pub(super) fn extents(&self) -> [f32; 3] {
        std::array::from_fn(|i| self.high[i] - self.low[i])
    }

    pub(super) fn largest(&self) -> f32 {
        self.extents().into_iter().fold(0.0, f32::max)
    }

    /// Whether the boxes have a point in common.
    pub(super) fn meets(&self, other: &Box3) -> bool {
        (0..3).all(|i| self.low[i] <= other.high[i] && other.low[i] <= self.high[i])
    }

    pub(super) fn smallest(&self) -> f32 {
        self.extents().into_iter().fold(f32::INFINITY, f32::min)
    }
}
