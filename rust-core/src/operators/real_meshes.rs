//! Tests that run all stages on real meshes, which lie in the shared data.

use std::path::PathBuf;

use super::{HeatGeodesics, OperatorOptions, Operators, edge_distance, fixtures::Golden};
use crate::{CachePolicy, cache::Cache, job::SILENT, mesh::Mesh};

fn read(name: &str) -> Mesh {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let shared = std::env::var_os("ANYFACE_SHARED").map_or(beside, PathBuf::from);
    Mesh::read(shared.join("data/meshes").join(name)).unwrap()
}

fn head() -> Mesh {
    Golden::shared("data/faces/ict_facekit.safetensors").mesh("neutral", "triangles")
}

fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(work)
}

#[test]
#[ignore = "needs ../shared"]
fn heads_animals_and_scans_have_sound_operators() {
    for name in [
        "lee_perry_smith",
        "goathead",
        "koala",
        "makehuman_body",
        "mediapipe_canonical_face",
    ] {
        let mesh = read(&format!("{name}.obj"));
        let ops = Operators::new(&mesh, &OperatorOptions::default()).unwrap();
        let area: f64 = mesh.face_areas().iter().sum();
        assert!(
            (ops.area() / area - 1.0).abs() < 1e-2,
            "{name}: {area}, {}",
            ops.area()
        );
        let positive = (0..ops.rows())
            .flat_map(|i| ops.laplacian.row(i).filter(move |&(j, _)| j != i))
            .filter(|&(_, v)| v > 1e-5)
            .count();
        assert_eq!(positive, 0, "{name}");
        let heat = HeatGeodesics::new(&ops).unwrap().distance_from(&[0]);
        let edges = edge_distance(&ops, &[0]);
        let limit = 0.1 * mesh.diagonal();
        for (row, (h, e)) in heat.iter().zip(&edges).enumerate() {
            assert_eq!(h.is_finite(), e.is_finite(), "{name} {row}");
            assert!(
                !h.is_finite() || (h - e).abs() < limit + 0.15 * e,
                "{name} {row}: {h} {e}"
            );
        }
        let surface = ops
            .surface(16, 1.0, &Cache::new(&CachePolicy::Off), SILENT)
            .unwrap();
        assert!(
            surface
                .evecs
                .iter()
                .chain(&surface.grad_x)
                .all(|x| x.is_finite()),
            "{name}"
        );
    }
}

#[test]
#[ignore = "needs ../shared"]
fn a_head_of_many_parts_has_the_same_numbers_on_any_number_of_threads() {
    let mesh = head();
    let ops = Operators::new(&mesh, &OperatorOptions::default()).unwrap();
    assert_eq!(ops.parts.count, 56);
    let distances = |threads| {
        with_threads(threads, || {
            HeatGeodesics::new(&ops).unwrap().distance_from(&[1000])
        })
    };
    assert_eq!(distances(1), distances(3));
}
