//! Measures per-mesh work on a head of 26,719 vertices, or on a sphere of 10,242 without its data.
//!
//! `cargo bench -p anyface --bench operators`
// The macro of criterion makes a public function without documentation.
#![allow(missing_docs)]

use std::{hint::black_box, path::PathBuf, time::Duration};

use anyface::{
    job::SILENT,
    mesh::{Mesh, SurfaceTree},
    operators::{
        HeatGeodesics, OperatorOptions, Operators, SparseCholesky, edge_distance, gradient::RIDGE,
    },
};
use criterion::{Criterion, criterion_group, criterion_main};
use safetensors::SafeTensors;

fn head() -> Option<Mesh> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let shared = std::env::var_os("ANYFACE_SHARED").map_or(beside, PathBuf::from);
    let bytes = std::fs::read(shared.join("data/faces/ict_facekit.safetensors")).ok()?;
    let file = SafeTensors::deserialize(&bytes).ok()?;
    let words = |name: &str| {
        let data = file
            .tensor(name)
            .expect("tensor of the face model")
            .data()
            .to_vec();
        let (words, _) = data.as_chunks::<4>();
        words.to_vec()
    };
    let positions = words("neutral")
        .as_chunks::<3>()
        .0
        .iter()
        .map(|p| p.map(f32::from_le_bytes))
        .collect();
    let triangles = words("triangles")
        .as_chunks::<3>()
        .0
        .iter()
        .map(|t| t.map(u32::from_le_bytes))
        .collect();
    Mesh::from_arrays(positions, triangles).ok()
}

/// A sphere by latitude and longitude.
fn sphere() -> Mesh {
    let (rows, columns) = (80u32, 128u32);
    let mut positions = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    for i in 0..rows {
        let polar = (i + 1) as f32 / (rows + 1) as f32 * std::f32::consts::PI;
        for j in 0..columns {
            let around = j as f32 / columns as f32 * std::f32::consts::TAU;
            positions.push([
                polar.sin() * around.cos(),
                polar.sin() * around.sin(),
                polar.cos(),
            ]);
        }
    }
    let at = |i: u32, j: u32| 2 + i * columns + j % columns;
    let mut triangles = Vec::new();
    for j in 0..columns {
        triangles.extend([
            [0, at(0, j), at(0, j + 1)],
            [1, at(rows - 1, j + 1), at(rows - 1, j)],
        ]);
        for i in 0..rows - 1 {
            triangles.extend([
                [at(i, j), at(i + 1, j), at(i + 1, j + 1)],
                [at(i, j), at(i + 1, j + 1), at(i, j + 1)],
            ]);
        }
    }
    Mesh::from_arrays(positions, triangles).expect("a sphere is a mesh")
}

fn operators(c: &mut Criterion) {
    let mesh = head().unwrap_or_else(sphere);
    let options = OperatorOptions::default();
    let built = Operators::new(&mesh, &options).expect("operators");
    let frames = built.tangent_frames();
    let mut group = c.benchmark_group(format!("operators/{}", mesh.positions.len()));
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(3));
    group.bench_function("laplacian", |b| {
        b.iter(|| Operators::new(black_box(&mesh), &options))
    });
    group.bench_function("gradient", |b| {
        b.iter(|| built.tangent_gradient(black_box(&frames), RIDGE))
    });
    group.bench_function("heat/factor", |b| {
        b.iter(|| HeatGeodesics::new(black_box(&built)))
    });
    let heat = HeatGeodesics::new(&built).expect("geodesics");
    group.bench_function("heat/one", |b| {
        b.iter(|| heat.distance_from(black_box(&[7])))
    });
    group.bench_function("edge_distance", |b| {
        b.iter(|| edge_distance(&built, black_box(&[7])))
    });
    let inverse: Vec<f64> = built.mass.iter().map(|m| 1.0 / m).collect();
    let mut middle = built.laplacian.clone();
    middle.scale_rows(&inverse);
    let bilaplacian = built
        .laplacian
        .matmul(&middle)
        .and_then(|b| b.add_diagonal(1.0, &built.mass))
        .expect("sizes");
    group.bench_function("bilaplacian/factor", |b| {
        b.iter(|| SparseCholesky::factor(black_box(&bilaplacian)))
    });
    let factor = SparseCholesky::factor(&bilaplacian).expect("positive definite");
    let rhs = vec![1.0; 68 * built.rows()];
    group.bench_function("bilaplacian/solve 68", |b| {
        b.iter(|| factor.solve_in_place(black_box(&mut rhs.clone()), 68));
    });
    let tree = SurfaceTree::new(&mesh);
    group.bench_function("tree/build", |b| {
        b.iter(|| SurfaceTree::new(black_box(&mesh)))
    });
    group.bench_function("tree/1000 queries", |b| {
        b.iter(|| {
            mesh.positions
                .iter()
                .take(1000)
                .filter(|[x, y, z]| tree.closest([*x, *y, z + 0.1]).is_some())
                .count()
        });
    });
    group.bench_function("eigenbasis 128", |b| {
        b.iter(|| built.eigenbasis(black_box(128), SILENT))
    });
    group.finish();
}

criterion_group!(benches, operators);
criterion_main!(benches);
