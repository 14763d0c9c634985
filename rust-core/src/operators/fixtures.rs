//! Meshes and goldens for the tests of this folder.

use std::path::PathBuf;

use faer::{Mat, Side};
use safetensors::{SafeTensors, tensor::Dtype};

use super::Operators;
use crate::mesh::{Mesh, direction::unit};

/// A sphere of radius 1 with `20 · 4^levels` faces.
pub fn icosphere(levels: usize) -> Mesh {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut points: Vec<[f64; 3]> = Vec::new();
    for (a, b) in [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)] {
        points.push([a, b, 0.0]);
    }
    for (a, b) in [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)] {
        points.push([0.0, a, b]);
    }
    for (a, b) in [(g, -1.0), (g, 1.0), (-g, -1.0), (-g, 1.0)] {
        points.push([a, 0.0, b]);
    }
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..levels {
        let mut middle = std::collections::HashMap::new();
        let mut split = |points: &mut Vec<[f64; 3]>, a: u32, b: u32| {
            *middle.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let (p, q) = (points[a as usize], points[b as usize]);
                points.push([0, 1, 2].map(|i| 0.5 * (p[i] + q[i])));
                points.len() as u32 - 1
            })
        };
        let coarse = std::mem::take(&mut triangles);
        for [a, b, c] in coarse {
            let ab = split(&mut points, a, b);
            let bc = split(&mut points, b, c);
            let ca = split(&mut points, c, a);
            triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
    }
    let positions = points
        .iter()
        .map(|&p| unit(p.into()).as_vec3().into())
        .collect();
    Mesh {
        positions,
        triangles,
    }
}

/// The unit square in the xy plane with `n` × `n` cells whose diagonals alternate.
pub fn square(n: usize) -> Mesh {
    let step = 1.0 / n as f32;
    let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    let mut mesh = Mesh::default();
    for j in 0..=n {
        for i in 0..=n {
            mesh.positions.push([i as f32 * step, j as f32 * step, 0.0]);
        }
    }
    for j in 0..n {
        for i in 0..n {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if (i + j) % 2 == 0 {
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                mesh.triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    mesh
}

/// Two meshes as one, the second moved by `offset`.
pub fn joined(a: &Mesh, b: &Mesh, offset: [f32; 3]) -> Mesh {
    let mut out = a.clone();
    let base = a.positions.len() as u32;
    let moved = b
        .positions
        .iter()
        .map(|p| [0, 1, 2].map(|i| p[i] + offset[i]));
    out.positions.extend(moved);
    out.triangles
        .extend(b.triangles.iter().map(|t| t.map(|v| v + base)));
    out
}

/// All eigenvalues of `L x = λ M x`, ascending, by a dense solver: the slow reference.
pub fn dense_eigenvalues(operators: &Operators) -> Vec<f64> {
    let n = operators.rows();
    let root: Vec<f64> = operators.mass.iter().map(|m| m.sqrt()).collect();
    let mut a = Mat::<f64>::zeros(n, n);
    for i in 0..n {
        for (j, v) in operators.laplacian.row(i) {
            a[(i, j)] = v / (root[i] * root[j]);
        }
    }
    a.self_adjoint_eigenvalues(Side::Lower).unwrap()
}

/// A safetensors file of reference numbers.
pub struct Golden(Vec<u8>);

impl Golden {
    /// From `tests/goldens` of the workspace.
    pub fn open(name: &str) -> Golden {
        Golden::read(
            &PathBuf::from(env!("CARGO_MANIFEST_DIR"))
                .join("../tests/goldens")
                .join(name),
        )
    }

    /// From the shared folder, `$ANYFACE_SHARED` or beside the workspace.
    pub fn shared(name: &str) -> Golden {
        let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
        let root = std::env::var_os("ANYFACE_SHARED").map_or(beside, PathBuf::from);
        Golden::read(&root.join(name))
    }

    fn read(path: &std::path::Path) -> Golden {
        Golden(std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())))
    }

    /// A tensor as numbers, row-major.
    pub fn numbers(&self, name: &str) -> Vec<f64> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = file.tensor(name).unwrap_or_else(|e| panic!("{name}: {e}"));
        let data = tensor.data();
        match tensor.dtype() {
            Dtype::F64 => data
                .chunks_exact(8)
                .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
                .collect(),
            Dtype::F32 => data
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes(b.try_into().unwrap()).into())
                .collect(),
            Dtype::I32 => data
                .chunks_exact(4)
                .map(|b| i32::from_le_bytes(b.try_into().unwrap()).into())
                .collect(),
            other => panic!("{name}: {other:?}"),
        }
    }

    /// A mesh from two tensors.
    pub fn mesh(&self, positions: &str, triangles: &str) -> Mesh {
        let p = self.numbers(positions);
        let t = self.numbers(triangles);
        Mesh {
            positions: p
                .chunks(3)
                .map(|c| [c[0] as f32, c[1] as f32, c[2] as f32])
                .collect(),
            triangles: t
                .chunks(3)
                .map(|c| [c[0] as u32, c[1] as u32, c[2] as u32])
                .collect(),
        }
    }
}
