//! Tangent frames and the gradient of a function on vertices.
//!
//! They follow the authors of DiffusionNet (Sharp et al. 2022, section 3.3): at each vertex the
//! gradient is the least-squares fit to the differences along the edges of its one-ring, projected
//! onto the tangent plane, with a small ridge. One thing differs: normals are weighted by area, so
//! slivers do not tilt them.

use glam::DVec3;

use super::{Csr, Operators};
use crate::mesh::direction::unit;

/// Ridge of the authors' code, for meshes about one unit in size.
pub const RIDGE: f64 = 1e-5;

/// Two tangents and the normal at a row: orthonormal, right-handed.
pub type Frame = [DVec3; 3];

/// Gradients as two sparse matrices.
#[derive(Debug, Clone, PartialEq)]
pub struct TangentGradient {
    /// `[R, R]`, component along the first tangent, one over mesh units.
    pub x: Csr,
    /// `[R, R]`, component along the second tangent.
    pub y: Csr,
}

impl Operators {
    /// Tangent frames `[R]`. The first tangent is the x axis projected onto the tangent plane, or
    /// the y axis where the normal is within 26° of the x axis.
    pub fn tangent_frames(&self) -> Vec<Frame> {
        let mut normals = vec![DVec3::ZERO; self.rows()];
        for &[a, b, c] in &self.triangles {
            let [p, q, r] = [a, b, c].map(|v| self.positions[v as usize]);
            let normal = (q - p).cross(r - p);
            for v in [a, b, c] {
                normals[v as usize] += normal;
            }
        }
        normals.into_iter().map(frame_of).collect()
    }

    /// The gradient in the given frames. `ridge`: mesh units squared, at least 0. For a network,
    /// use [`RIDGE`] times the square of its unit of length.
    ///
    /// # Panics
    /// If the number of frames is not the number of rows.
    pub fn tangent_gradient(&self, frames: &[Frame], ridge: f64) -> TangentGradient {
        assert_eq!(frames.len(), self.rows(), "number of frames");
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for (row, ring) in self.rings().iter().enumerate() {
            let centre = self.positions[row];
            let tangent = |&v: &u32| {
                let edge = self.positions[v as usize] - centre;
                [edge.dot(frames[row][0]), edge.dot(frames[row][1])]
            };
            let edges: Vec<_> = ring.iter().map(tangent).collect();
            let weights = least_squares(&edges, ridge);
            let mut centre = [0.0; 2];
            for (&v, w) in ring.iter().zip(&weights) {
                x.push((row as u32, v, w[0]));
                y.push((row as u32, v, w[1]));
                centre = [centre[0] - w[0], centre[1] - w[1]];
            }
            x.push((row as u32, row as u32, centre[0]));
            y.push((row as u32, row as u32, centre[1]));
        }
        let rows = self.rows();
        TangentGradient {
            x: Csr::from_triplets(rows, rows, &x),
            y: Csr::from_triplets(rows, rows, &y),
        }
    }

    /// Neighbours of every row along edges, ascending.
    pub fn rings(&self) -> Vec<Vec<u32>> {
        let mut rings = vec![Vec::new(); self.rows()];
        for &[a, b, c] in &self.triangles {
            for (v, others) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
                rings[v as usize].extend(others);
            }
        }
        for ring in &mut rings {
            ring.sort_unstable();
            ring.dedup();
        }
        rings
    }
}

fn frame_of(normal: DVec3) -> Frame {
    let normal = unit(normal);
    let seed = if normal[0].abs() < 0.9 {
        DVec3::X
    } else {
        DVec3::Y
    };
    let first = unit(seed - seed.dot(normal) * normal);
    [first, normal.cross(first), normal]
}

/// `(EᵀE + ridge)⁻¹ Eᵀ`, one pair per row of `E`; zeros where a pair is not finite.
fn least_squares(edges: &[[f64; 2]], ridge: f64) -> Vec<[f64; 2]> {
    let [mut a, mut b, mut c] = [ridge, 0.0, ridge];
    for e in edges {
        a += e[0] * e[0];
        b += e[0] * e[1];
        c += e[1] * e[1];
    }
    let determinant = a * c - b * b;
    let solve = |e: &[f64; 2]| {
        let w = [
            (c * e[0] - b * e[1]) / determinant,
            (a * e[1] - b * e[0]) / determinant,
        ];
        if w.iter().all(|x| x.is_finite()) {
            w
        } else {
            [0.0; 2]
        }
    };
    edges.iter().map(solve).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{
        OperatorOptions,
        fixtures::{Golden, icosphere, square},
    };
    use super::*;

    fn frames(golden: &Golden) -> Vec<Frame> {
        let numbers = golden.numbers("frames");
        let vector = DVec3::from_slice;
        numbers
            .chunks(9)
            .map(|f| [vector(&f[..3]), vector(&f[3..6]), vector(&f[6..])])
            .collect()
    }

    fn check_reference(golden: &Golden) {
        let mesh = golden.mesh("vertices", "faces");
        let options = OperatorOptions {
            weld: false,
            ..Default::default()
        };
        let ops = Operators::new(&mesh, &options).unwrap();
        assert_eq!(ops.rows(), mesh.positions.len());
        let gradient = ops.tangent_gradient(&frames(golden), RIDGE);
        for (name, got) in [("gradX", &gradient.x), ("gradY", &gradient.y)] {
            let values = golden.numbers(&format!("{name}.values"));
            let indices = golden.numbers(&format!("{name}.indices"));
            let (rows, columns) = indices.split_at(values.len());
            let scale = values.iter().fold(0f64, |m, v| m.max(v.abs()));
            for ((&row, &column), value) in rows.iter().zip(columns).zip(&values) {
                let got = got.get(row as usize, column as usize);
                assert!(
                    (got - value).abs() < 1e-5 * scale,
                    "{name} {row} {column}: expected {value}, got {got}"
                );
            }
            assert_eq!(got.nnz(), values.len());
        }
    }

    #[test]
    fn gradients_match_the_reference_in_its_frames() {
        check_reference(&Golden::open("diffusion_net_random.safetensors"));
    }

    #[test]
    #[ignore = "needs ../shared"]
    fn gradients_on_a_head_match_the_reference_in_its_frames() {
        check_reference(&Golden::shared("parity/diffusion_net.safetensors"));
    }

    #[test]
    fn frames_are_orthonormal_and_right_handed() {
        let mesh = icosphere(2);
        let ops = Operators::new(&mesh, &OperatorOptions::default()).unwrap();
        for (row, [x, y, n]) in ops.tangent_frames().into_iter().enumerate() {
            assert!(n.dot(ops.positions[row]) > 0.99);
            assert!(x.dot(n).abs() < 1e-12 && (x.length_squared() - 1.0).abs() < 1e-12);
            assert!((x.cross(y).dot(n) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_linear_function_on_a_plane_has_its_slope() {
        let mut mesh = square(7);
        // Make the square uneven, tilted and far from the origin.
        for p in &mut mesh.positions {
            *p = [p[0] * p[0] + 10.0, 2.0 * p[1], 0.5 * p[1] + 3.0];
        }
        let ops = Operators::new(&mesh, &OperatorOptions::default()).unwrap();
        let slope = DVec3::new(0.3, -1.2, 0.7);
        let values: Vec<f64> = ops.positions.iter().map(|&p| p.dot(slope)).collect();
        let frames = ops.tangent_frames();
        let gradient = ops.tangent_gradient(&frames, 0.0);
        let (x, y) = (gradient.x.mul(&values), gradient.y.mul(&values));
        for row in 0..ops.rows() {
            assert!((x[row] - slope.dot(frames[row][0])).abs() < 1e-5, "{row}");
            assert!((y[row] - slope.dot(frames[row][1])).abs() < 1e-5, "{row}");
        }
        let constant = gradient.x.mul(&vec![1.0; ops.rows()]);
        assert!(constant.iter().all(|g| g.abs() < 1e-12));
    }
}
