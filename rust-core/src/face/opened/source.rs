//! The sources of the pieces of a mesh that was cut.

/// The old triangle that a triangle of the new mesh was cut from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleSource {
    /// Triangle of the old mesh. For a triangle behind the cut, the old triangle beside which it
    /// begins.
    pub triangle: u32,
    /// For each corner the shares of the old triangle's three corners: at least 0, sum 1.
    pub corners: [[f32; 3]; 3],
}

impl TriangleSource {
    /// The source of a triangle that stays as it is.
    pub(in crate::face) fn whole(triangle: u32) -> TriangleSource {
        let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        TriangleSource { triangle, corners }
    }

    /// The source of a triangle behind the cut that begins at one corner of this piece.
    pub(in crate::face) fn at_corner(self, k: usize) -> TriangleSource {
        TriangleSource {
            triangle: self.triangle,
            corners: [self.corners[k]; 3],
        }
    }

    /// The source of a piece of this piece. `shares`: for each corner the shares of this piece's
    /// corners.
    pub(in crate::face) fn piece(self, shares: [[f32; 3]; 3]) -> TriangleSource {
        let mixed = |of: [f32; 3]| {
            let share = |i: usize| (0..3).map(|k| of[k] * self.corners[k][i]).sum();
            [0, 1, 2].map(share)
        };
        TriangleSource {
            triangle: self.triangle,
            corners: shares.map(mixed),
        }
    }
}
