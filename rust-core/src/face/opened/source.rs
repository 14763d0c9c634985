//! Where pieces of a mesh that was cut come from.

/// What a triangle of the new mesh was cut from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleSource {
    /// Triangle of the old mesh; for one behind the cut the one beside which it begins.
    pub triangle: u32,
    /// For each corner the shares of that triangle's three corners: at least 0, sum 1.
    pub corners: [[f32; 3]; 3],
}

impl TriangleSource {
    /// A triangle that stays.
    pub(in crate::face) fn whole(triangle: u32) -> TriangleSource {
        let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        TriangleSource { triangle, corners }
    }

    /// What a triangle is made of that begins at one corner of this piece.
    pub(in crate::face) fn at_corner(self, k: usize) -> TriangleSource {
        TriangleSource {
            triangle: self.triangle,
            corners: [self.corners[k]; 3],
        }
    }

    /// What a piece of this piece was cut from.
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
