//! DiffusionNet forward: width 128, 4 blocks, K = 128, 26,719 vertices, random numbers.
//!
//! `cargo bench -p anyface --bench diffusion_net`; the same in PyTorch:
//! `python -m training.benchmarks.diffusion_net`. Both run on two threads.

#![allow(missing_docs)] // criterion_group! makes a public function

use std::hint::black_box;

use anyface::{
    models::Weights,
    nn::{
        diffusion_net::{DiffusionNet, DiffusionNetShape},
        surface::{Entry, Surface},
    },
};
use criterion::{Criterion, criterion_group, criterion_main};
use ndarray::{Array1, Array2, Array3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use safetensors::{Dtype, tensor::TensorView};

const VERTICES: usize = 26_719;
const EIGENPAIRS: usize = 128;
const THREADS: usize = 2;
const SHAPE: DiffusionNetShape = DiffusionNetShape {
    inputs: 3,
    outputs: 3,
    width: 128,
    blocks: 4,
};

/// Numbers in [−1, 1).
fn random(rng: &mut ChaCha8Rng, count: usize) -> Vec<f32> {
    (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn surface(rng: &mut ChaCha8Rng) -> Surface {
    let gradient: Vec<Entry> = (0..VERTICES * 7)
        .map(|i| {
            (
                i / 7,
                (i / 7 + i % 7 * 53) % VERTICES,
                rng.random_range(-1.0..1.0),
            )
        })
        .collect();
    Surface::new(
        Array1::from_elem(VERTICES, 1.0 / VERTICES as f32),
        (0..EIGENPAIRS).map(|k| k as f32).collect(),
        Array2::from_shape_vec((VERTICES, EIGENPAIRS), random(rng, VERTICES * EIGENPAIRS)).unwrap(),
        gradient.iter().copied(),
        gradient.iter().copied(),
    )
    .unwrap()
}

fn network(rng: &mut ChaCha8Rng) -> DiffusionNet {
    let width = SHAPE.width;
    let mut shapes: Vec<(String, Vec<usize>)> = vec![
        ("first_lin.weight".into(), vec![width, SHAPE.inputs]),
        ("first_lin.bias".into(), vec![width]),
        ("last_lin.weight".into(), vec![SHAPE.outputs, width]),
        ("last_lin.bias".into(), vec![SHAPE.outputs]),
    ];
    for block in 0..SHAPE.blocks {
        let mut add = |name: &str, shape: &[usize]| {
            shapes.push((format!("block_{block}.{name}"), shape.to_vec()));
        };
        add("diffusion.diffusion_time", &[width]);
        add("gradient_features.A_re.weight", &[width, width]);
        add("gradient_features.A_im.weight", &[width, width]);
        for (layer, inputs) in [3 * width, width, width].into_iter().enumerate() {
            add(
                &format!("mlp.miniMLP_mlp_layer_{layer:03}.weight"),
                &[width, inputs],
            );
            add(&format!("mlp.miniMLP_mlp_layer_{layer:03}.bias"), &[width]);
        }
    }
    let bytes: Vec<Vec<u8>> = shapes
        .iter()
        .map(|(_, shape)| {
            let values = random(rng, shape.iter().product());
            values
                .iter()
                .flat_map(|x| (0.05 * x).to_le_bytes())
                .collect()
        })
        .collect();
    let views = shapes.iter().zip(&bytes).map(|((name, shape), bytes)| {
        (
            name,
            TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap(),
        )
    });
    let file = safetensors::serialize(views, None).unwrap();
    DiffusionNet::load(&Weights::from_bytes(&file).unwrap(), SHAPE).unwrap()
}

fn forward(criterion: &mut Criterion) {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let (surface, network) = (surface(&mut rng), network(&mut rng));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(THREADS);
    let pool = pool.build().unwrap();
    let mut group = criterion.benchmark_group("diffusion_net_26719x128x4_2_threads");
    group.sample_size(10);
    for batch in [1, 4] {
        let size = batch * VERTICES * SHAPE.inputs;
        let x = Array3::from_shape_vec((batch, VERTICES, SHAPE.inputs), random(&mut rng, size));
        let x = x.unwrap();
        group.bench_function(format!("{batch} frames"), |bencher| {
            bencher.iter(|| pool.install(|| network.forward(black_box(&x), &surface)));
        });
    }
}

criterion_group!(benches, forward);
criterion_main!(benches);
