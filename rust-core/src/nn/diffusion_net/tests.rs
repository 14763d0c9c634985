//! Compares the network with its authors' results.

use ndarray::Array2;

use super::*;
use crate::nn::golden::{Golden, distance};
use crate::nn::matrix::view;
use ndarray::{Axis, stack};

fn network(golden: &Golden, shape: DiffusionNetShape) -> DiffusionNet {
    DiffusionNet::load(&golden.weights(), shape).unwrap()
}

const RANDOM: DiffusionNetShape = DiffusionNetShape {
    inputs: 3,
    outputs: 5,
    width: 32,
    blocks: 2,
};

/// Compares the output of every block and of the network. Errors are relative to the largest value
/// of each.
fn check(golden: &Golden, shape: DiffusionNetShape, tolerance: f32) {
    let (network, surface) = (network(golden, shape), golden.surface());
    let x = golden.matrix("vertices").insert_axis(Axis(0));
    let first = |_, rows: Range<usize>, out: &mut [f32]| {
        let x = golden.matrix("vertices");
        let x = view(&x).subrows(rows.start, rows.len());
        network.first_lin.forward_rows(x, out);
    };
    let watch = Watch::new(SILENT, "test", 0.0);
    let mut fields = Fields::new(1, shape.width, &surface, &watch, first);
    for (index, block) in network.blocks.iter().enumerate() {
        fields.apply(block, index + 1 < shape.blocks);
        let got: Vec<f32> = fields
            .pieces
            .iter()
            .flat_map(|p| p.fields[0].clone())
            .collect();
        compare(&got, &golden.values(&format!("block_{index}")), tolerance);
    }
    let got = network.forward(&x, &surface);
    compare(got.as_slice().unwrap(), &golden.values("y"), tolerance);
}

fn compare(got: &[f32], expected: &[f32], tolerance: f32) {
    let largest = expected.iter().fold(0.0f32, |a, b| a.max(b.abs()));
    let error = distance(got, expected) / largest;
    assert!(error < tolerance, "relative error {error}");
}

#[test]
fn random_network_matches_block_by_block() {
    check(&Golden::open("diffusion_net_random"), RANDOM, 1e-4);
}

#[test]
#[ignore = "needs ../shared"]
fn trained_network_matches_block_by_block() {
    let shape = DiffusionNetShape {
        inputs: 3,
        outputs: 8,
        width: 128,
        blocks: 4,
    };
    check(&Golden::open_shared("diffusion_net"), shape, 1e-3);
}

#[test]
fn fields_of_a_batch_do_not_touch_each_other() {
    let golden = Golden::open("diffusion_net_random");
    let (network, surface) = (network(&golden, RANDOM), golden.surface());
    let one = golden.matrix("vertices");
    let two = one.mapv(|x| 1.0 - x * x);
    let alone = |x: &Array2<f32>| network.forward(&x.clone().insert_axis(Axis(0)), &surface);
    let both = stack![Axis(0), two, one];
    let both = network.forward(&both, &surface);
    assert_eq!(
        both.index_axis(Axis(0), 0),
        alone(&two).index_axis(Axis(0), 0)
    );
    assert_eq!(
        both.index_axis(Axis(0), 1),
        alone(&one).index_axis(Axis(0), 0)
    );
}

#[test]
fn number_of_threads_changes_no_bit() {
    let golden = Golden::open("diffusion_net_random");
    let (network, surface) = (network(&golden, RANDOM), golden.surface());
    let x = golden.matrix("vertices").insert_axis(Axis(0));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build()
            .unwrap()
            .install(|| network.forward(&x, &surface))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}

#[test]
fn cancelled_values_are_not_returned() {
    let golden = Golden::open("diffusion_net_random");
    let (network, surface) = (network(&golden, RANDOM), golden.surface());
    let asked = std::sync::atomic::AtomicUsize::new(0);
    // The host cancels in the middle, and only once.
    let host = |_| asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed) != 1;
    let watch = Watch::new(&host, "test", 0.0);
    let ended = network.forward_from(1, &surface, &watch, |_, _, out| out.fill(0.0));
    assert!(matches!(ended, Err(crate::Error::Cancelled)));
}
