//! The robust Laplacian and lumped mass of any triangle soup.
//!
//! Sharp and Crane 2020: mollify, cover, flip to Delaunay, take half the cotan Laplacian and half
//! the barycentric mass of the cover. The only difference from `robust_laplacian.mesh_laplacian` is
//! that the caller leaves out faces with repeated corners first.

use glam::DVec3;

use super::{
    intrinsic::{Intrinsic, area},
    sparse::Csr,
    tufted,
};

/// Laplacian, mass, and the intrinsic Delaunay triangulation of the tufted cover they come from.
pub(crate) struct RobustLaplacian {
    /// Weak form: symmetric, positive semi-definite, rows sum to zero.
    pub laplacian: Csr,
    /// Lumped mass, whose sum is the area.
    pub mass: Vec<f64>,
    pub cover: Intrinsic,
}

/// Builds the operators and solves nothing. `mollify`: as in [`tufted::cover`].
pub(crate) fn robust(positions: &[DVec3], triangles: &[[u32; 3]], mollify: f64) -> RobustLaplacian {
    let mut cover = tufted::cover(positions, triangles, mollify);
    cover.flip_to_delaunay();
    RobustLaplacian {
        laplacian: half_cotan(&cover, positions.len()),
        mass: half_mass(&cover, positions.len()),
        cover,
    }
}

fn half_cotan(cover: &Intrinsic, size: usize) -> Csr {
    let mut entries = Vec::with_capacity(2 * cover.tail.len() + size);
    let mut diagonal = vec![0.0; size];
    for f in 0..cover.triangle_count() {
        let (t, cot) = (cover.corners(f), cover.cotangents(f));
        for s in 0..3 {
            let (i, j, weight) = (t[s], t[(s + 1) % 3], 0.25 * cot[s]);
            if i != j {
                entries.extend([(i, j, -weight), (j, i, -weight)]);
                diagonal[i as usize] += weight;
                diagonal[j as usize] += weight;
            }
        }
    }
    entries.extend(
        diagonal
            .iter()
            .enumerate()
            .map(|(i, &d)| (i as u32, i as u32, d)),
    );
    Csr::from_triplets(size, size, &entries)
}

fn half_mass(cover: &Intrinsic, size: usize) -> Vec<f64> {
    let mut mass = vec![0.0; size];
    for f in 0..cover.triangle_count() {
        let share = area(cover.lengths(f)) / 6.0;
        for v in cover.corners(f) {
            mass[v as usize] += share;
        }
    }
    mass
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{
        OperatorOptions, Operators,
        fixtures::{Golden, dense_eigenvalues, icosphere, joined, square},
    };
    use crate::{Error, mesh::Mesh};

    fn unwelded() -> OperatorOptions {
        OperatorOptions {
            weld: false,
            ..Default::default()
        }
    }

    fn assert_close(what: &str, got: &[f64], expected: &[f64], relative: f64) {
        assert_eq!(got.len(), expected.len(), "{what}");
        for (i, (g, e)) in got.iter().zip(expected).enumerate() {
            assert!(
                (g - e).abs() <= relative * e.abs() + 1e-9,
                "{what} {i}: expected {e}, got {g}"
            );
        }
    }

    #[test]
    fn difficult_meshes_match_the_reference() {
        let golden = Golden::open("robust_laplacian.safetensors");
        for name in [
            "sphere",
            "slivers",
            "torn_sphere",
            "two_components",
            "duplicate_faces",
        ] {
            let mesh = golden.mesh(&format!("{name}.vertices"), &format!("{name}.faces"));
            let operators = Operators::new(&mesh, &unwelded()).unwrap();
            let mass = golden.numbers(&format!("{name}.mass"));
            let rows: Vec<_> = operators
                .vertex_of_row
                .iter()
                .map(|&v| mass[v as usize])
                .collect();
            if name == "slivers" {
                // A stretched icosphere is full of cocircular quads, where either diagonal is
                // Delaunay. So the masses depend on the order of flips, but their sum does not.
                assert!((operators.area() / rows.iter().sum::<f64>() - 1.0).abs() < 1e-6);
            } else {
                assert_close(&format!("{name} mass"), &operators.mass, &rows, 1e-6);
            }
            let reference = golden.numbers(&format!("{name}.evals"));
            let evals = dense_eigenvalues(&operators);
            for (i, (g, e)) in evals.iter().zip(&reference).enumerate() {
                let close = if *e > 1e-6 {
                    (g - e).abs() < 1e-3 * e
                } else {
                    g.abs() < 1e-6
                };
                assert!(close, "{name} eigenvalue {i}: expected {e}, got {g}");
            }
        }
    }

    fn check_structure(operators: &Operators) {
        let l = &operators.laplacian;
        let scale = l.values.iter().fold(0f64, |m, v| m.max(v.abs()));
        for i in 0..l.nrows() {
            let sum: f64 = l.row(i).map(|(_, v)| v).sum();
            assert!(sum.abs() <= 1e-12 * scale, "row {i} sums to {sum}");
            for (j, v) in l.row(i) {
                assert!((v - l.get(j, i)).abs() <= 1e-12 * scale, "{i} {j}");
            }
        }
    }

    #[test]
    fn laplacian_rows_sum_to_zero_and_mass_to_the_area() {
        for mesh in [
            icosphere(2),
            square(9),
            joined(&icosphere(1), &square(3), [3.0; 3]),
        ] {
            let operators = Operators::new(&mesh, &OperatorOptions::default()).unwrap();
            check_structure(&operators);
            let area: f64 = mesh.face_areas().iter().sum();
            assert!((operators.area() / area - 1.0).abs() < 1e-4);
            assert!(dense_eigenvalues(&operators)[0] > -1e-10);
        }
    }

    #[test]
    fn off_diagonals_are_not_positive() {
        let mut mesh = icosphere(3);
        // On the flattened sphere some plain cotangents are negative.
        mesh.positions.iter_mut().for_each(|p| p[0] *= 0.1);
        let operators = Operators::new(&mesh, &OperatorOptions::default()).unwrap();
        for i in 0..operators.rows() {
            for (j, v) in operators.laplacian.row(i).filter(|&(j, _)| j != i) {
                assert!(v <= 1e-6, "{i} {j}: {v}");
            }
        }
    }

    #[test]
    fn motion_changes_nothing_and_scale_only_the_mass() {
        let mesh = Golden::open("robust_laplacian.safetensors")
            .mesh("torn_sphere.vertices", "torn_sphere.faces");
        let one = Operators::new(&mesh, &OperatorOptions::default()).unwrap();
        let mut moved = mesh.clone();
        for p in &mut moved.positions {
            *p = [-8.0 * p[1], 8.0 * p[0] + 4.0, 8.0 * p[2]];
        }
        let other = Operators::new(&moved, &OperatorOptions::default()).unwrap();
        let mass: Vec<f64> = one.mass.iter().map(|m| 64.0 * m).collect();
        assert_close("mass", &other.mass, &mass, 1e-4);
        let (a, b) = (dense_eigenvalues(&one), dense_eigenvalues(&other));
        let a: Vec<f64> = a[..24].iter().map(|x| x / 64.0).collect();
        assert_close("eigenvalues", &b[..24], &a, 1e-3);
    }

    #[test]
    fn seams_are_sewn_so_that_a_cut_leaves_the_spectrum() {
        // The square is cut in two along a column of vertices.
        let whole = square(8);
        let mut cut = whole.clone();
        let base = cut.positions.len() as u32;
        for j in 0..9 {
            cut.positions.push(whole.positions[j * 9 + 4]);
        }
        for t in &mut cut.triangles {
            let right = t.iter().any(|&v| v % 9 > 4);
            *t = t.map(|v| if right && v % 9 == 4 { base + v / 9 } else { v });
        }
        let options = OperatorOptions::default();
        let (a, b) = (
            Operators::new(&whole, &options).unwrap(),
            Operators::new(&cut, &options).unwrap(),
        );
        assert_eq!(a.mass.len(), b.mass.len());
        assert_close(
            "eigenvalues",
            &dense_eigenvalues(&b),
            &dense_eigenvalues(&a),
            1e-9,
        );
        assert_eq!(
            b.row_of_vertex[base as usize + 2],
            b.row_of_vertex[2 * 9 + 4]
        );
        assert_eq!(Operators::new(&cut, &unwelded()).unwrap().parts.count, 2);
    }

    #[test]
    fn vertices_in_no_face_have_no_row() {
        let mut mesh = icosphere(1);
        mesh.positions.insert(3, [7.0; 3]);
        mesh.triangles
            .iter_mut()
            .flatten()
            .for_each(|v| *v += u32::from(*v >= 3));
        let operators = Operators::new(&mesh, &OperatorOptions::default()).unwrap();
        assert_eq!(operators.rows(), 42);
        assert_eq!(operators.row_of_vertex[3], super::super::NO_ROW);
        assert_eq!(operators.row_of_vertex[4], 3);
    }

    #[test]
    fn meshes_without_area_are_errors() {
        let point = Mesh {
            positions: vec![[1.0; 3]; 3],
            triangles: vec![[0, 1, 2]],
        };
        let none = Mesh {
            positions: vec![[1.0; 3]; 3],
            triangles: vec![[0, 1, 1]],
        };
        for mesh in [point, none, Mesh::default()] {
            let error = Operators::new(&mesh, &OperatorOptions::default()).unwrap_err();
            assert!(matches!(error, Error::Mesh(_)), "{error}");
        }
    }

    proptest! {
        #[test]
        fn any_soup_gives_sound_operators_or_an_error(
            points in proptest::collection::vec(proptest::array::uniform3(-2i8..3), 3..12),
            faces in proptest::collection::vec(proptest::array::uniform3(0u32..12), 1..30),
        ) {
            // On a coarse lattice many points coincide and many faces are lines, repeated or folded.
            let count = points.len() as u32;
            let mesh = Mesh {
                positions: points.iter().map(|p| p.map(f32::from)).collect(),
                triangles: faces.iter().map(|t| t.map(|v| v % count)).collect(),
            };
            match Operators::new(&mesh, &OperatorOptions::default()) {
                Ok(operators) => {
                    check_structure(&operators);
                    prop_assert!(operators.mass.iter().all(|&m| m > 0.0));
                    let distances = super::super::HeatGeodesics::new(&operators).map(|h| h.distance_from(&[0]));
                    prop_assert!(distances.is_ok_and(|d| d.iter().all(|x| *x >= 0.0)));
                }
                Err(error) => {
                    prop_assert!(matches!(error, Error::Mesh(_)), "{}", error);
                    let corners = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize]);
                    let is_line = |[a, b, c]: [[f32; 3]; 3]| a == b || b == c || c == a;
                    prop_assert!(mesh.triangles.iter().all(|t| is_line(corners(t))), "{}", error);
                }
            }
        }
    }
}
