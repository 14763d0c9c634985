//! Measures the stages of one face: landmark search, skin with its proxy, plate weights, frame
//! product and writing. Measures the stages of the sound too: speech encoder and denoiser.
//!
//! `cargo bench -p anyface --bench face`

#![allow(missing_docs)] // criterion_group! makes a public function

use std::{hint::black_box, path::PathBuf, time::Duration};

use anyface::{
    CachePolicy, Engine, EngineOptions, Face, MotionRequest,
    audio::Waveform,
    deform::{Plate, PlateWeights},
    face::{FaceOptions, PartList, Skin, locate_landmarks},
    job::SILENT,
    mesh::{self, LandmarkSource, Mesh},
    motion::Motion,
    output::write_animation,
    speech::{self, SpeechEncoder},
    spread::{Animation, Collector},
};
use criterion::{Criterion, criterion_group, criterion_main};

/// The default head. Each of its triangles is cut in four, `times` times over.
fn head(times: usize) -> Mesh {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
    let mut mesh = Mesh::read(folder.join("head.obj")).expect("the default head");
    for _ in 0..times {
        mesh = mesh.cut_in_four();
    }
    mesh
}

/// Five seconds of something like a voice.
fn sound() -> Waveform {
    let sample = |i: usize| {
        let t = i as f32 / 16_000.0;
        0.3 * (25.0 * t).sin().max(0.0) * ((750.0 * t).sin() + (1500.0 * t).sin())
    };
    Waveform {
        samples: (0..80_000).map(sample).collect(),
    }
}

fn engine() -> Engine {
    let options = EngineOptions {
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    };
    Engine::new(options).expect("built-in weights")
}

fn speech(c: &mut Criterion) {
    let (engine, sound) = (engine(), sound());
    let mut group = c.benchmark_group("speech 5 s");
    group.sample_size(10);
    let ear = speech::ear(None).expect("built in");
    group.bench_function("ear", |b| b.iter(|| ear.encode(black_box(&sound), SILENT)));
    group.bench_function("ear from its weights", |b| b.iter(|| speech::ear(None)));
    let request = MotionRequest::default();
    group.bench_function("ear and denoiser", |b| {
        b.iter(|| engine.perform(black_box(&sound), &request, SILENT))
    });
    group.finish();
}

fn spread(engine: &Engine, face: &Face, motion: &Motion) -> Animation {
    let animation = Collector::collect(|sink| engine.spread(face, motion, sink, SILENT));
    animation.expect("frames")
}

fn face(c: &mut Criterion) {
    let engine = engine();
    let performance = engine.perform(&sound(), &MotionRequest::default(), SILENT);
    let motion = performance.expect("motion").motion;
    for times in [0, 2] {
        let mesh = head(times);
        let mut group = c.benchmark_group(format!("face/{}", mesh.positions.len()));
        group
            .sample_size(10)
            .measurement_time(Duration::from_secs(5));
        let landmarks = locate_landmarks(&mesh, &FaceOptions::default()).expect("a face");
        group.bench_function("landmark search", |b| {
            b.iter(|| locate_landmarks(black_box(&mesh), &FaceOptions::default()))
        });
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::Vertices(landmarks.vertices.to_vec())),
            ..FaceOptions::default()
        };
        let to = mesh::align_to_canonical(&landmarks).expect("a face");
        let cm = |p: [f32; 3]| to.apply(p).map(|x| 100.0 * x);
        let canonical = Mesh {
            positions: mesh.positions.iter().map(|&p| cm(p)).collect(),
            triangles: mesh.triangles.clone(),
        };
        let places = landmarks.positions.map(cm);
        let parts = PartList::find(&mesh, &landmarks, &to, &options.parts).expect("parts");
        let vertices = &landmarks.vertices;
        let find = || Skin::find(&canonical, &places, vertices, &parts, options.proxy);
        group.bench_function("skin, proxy and operators", |b| b.iter(find));
        let skin = find().expect("skin");
        group.bench_function("plate weights", |b| {
            b.iter(|| PlateWeights::solve(&skin.operators, &skin.landmark_rows, Plate::default()))
        });
        group.bench_function("prepare", |b| {
            b.iter(|| engine.prepare(black_box(&mesh), &options, SILENT).is_ok())
        });
        let prepared = engine.prepare(&mesh, &options, SILENT).expect("a face");
        group.bench_function("frame product, 5 s", |b| {
            b.iter(|| spread(&engine, &prepared, black_box(&motion)))
        });
        let animation = spread(&engine, &prepared, &motion);
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["o.npz", "o.pc2"] {
            let path = folder.path().join(name);
            group.bench_function(format!("write {name}"), |b| {
                b.iter(|| write_animation(&path, black_box(&animation), None, &mesh))
            });
        }
        group.finish();
    }
}

criterion_group!(benches, speech, face);
criterion_main!(benches);
