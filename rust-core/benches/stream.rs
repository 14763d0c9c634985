//! Cost of one streamed frame: 640 samples pushed, one frame pulled, on one thread.
//!
//! `cargo bench -p anyface --bench stream`. Real time allows 40 ms.

#![allow(missing_docs)] // criterion_group! makes a public function

use std::hint::black_box;

use anyface::{Engine, EngineOptions};
use criterion::{Criterion, criterion_group, criterion_main};

/// Samples from one frame to the next.
const FRAME: usize = 640;

fn one_frame(criterion: &mut Criterion) {
    let engine = Engine::new(EngineOptions::default()).unwrap();
    let mut stream = engine.stream().unwrap();
    let samples: Vec<f32> = (0..100 * FRAME)
        .map(|i| (i as f32 * 0.08).sin() * (i as f32 * 0.0015).sin() * 0.5)
        .collect();
    for chunk in samples.chunks(FRAME) {
        stream.push(chunk).unwrap();
        stream.drain();
    }
    let mut chunks = samples.chunks(FRAME).cycle();
    criterion.bench_function("stream one frame of 40 ms", |bencher| {
        bencher.iter(|| {
            stream.push(chunks.next().unwrap()).unwrap();
            black_box(stream.pull().unwrap())
        });
    });
}

criterion_group!(benches, one_frame);
criterion_main!(benches);
