//! Transforms of nodes, as matrices of four columns.

use super::document::Node;

pub(super) type Matrix = [[f32; 4]; 4];

pub(super) const IDENTITY: Matrix = [
    [1.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 0.0, 1.0],
];

/// A node's transform, in columns: scale, then rotation, then translation.
pub(super) fn matrix(node: &Node) -> Matrix {
    if let Some(m) = &node.matrix {
        return std::array::from_fn(|c| std::array::from_fn(|r| m[4 * c + r]));
    }
    let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let [sx, sy, sz] = node.scale.unwrap_or([1.0; 3]);
    let [tx, ty, tz] = node.translation.unwrap_or([0.0; 3]);
    let columns = [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y + z * w),
            2.0 * (x * z - y * w),
        ],
        [
            2.0 * (x * y - z * w),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z + x * w),
        ],
        [
            2.0 * (x * z + y * w),
            2.0 * (y * z - x * w),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ];
    let scaled = |column: [f32; 3], s: f32| [column[0] * s, column[1] * s, column[2] * s, 0.0];
    [
        scaled(columns[0], sx),
        scaled(columns[1], sy),
        scaled(columns[2], sz),
        [tx, ty, tz, 1.0],
    ]
}

pub(super) fn apply(m: Matrix, p: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| m[0][i] * p[0] + m[1][i] * p[1] + m[2][i] * p[2] + m[3][i])
}

pub(super) fn product(a: Matrix, b: Matrix) -> Matrix {
    std::array::from_fn(|c| std::array::from_fn(|r| (0..4).map(|k| a[k][r] * b[c][k]).sum()))
}
