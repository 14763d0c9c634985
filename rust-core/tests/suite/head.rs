//! The default head, and landmark motion to move it with.

use std::{path::PathBuf, sync::LazyLock};

use anyface::{
    CachePolicy, Engine, EngineOptions, Face,
    face::FaceOptions,
    job::SILENT,
    mesh::{LandmarkSource, Mesh, PartChoices},
    spread::{Collector, FrameSink, Movement},
};
use ndarray::Array3;

pub type Points = Vec<[f32; 3]>;

pub fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head")
}

/// Skin with a mouth bag and lids, eyes, teeth and tongue; metres.
pub fn head() -> Mesh {
    Mesh::read(folder().join("head.obj")).unwrap()
}

pub fn landmarks() -> Points {
    match LandmarkSource::read(&folder().join("landmarks.json")).unwrap() {
        LandmarkSource::Known(known) => known.iter().map(|landmark| landmark.position).collect(),
        other => panic!("expected positions with their vertices, got {other:?}"),
    }
}

static ENGINE: LazyLock<Engine> = LazyLock::new(engine);

pub fn engine() -> Engine {
    Engine::new(EngineOptions {
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap()
}

pub fn prepared(mesh: &Mesh, landmarks: &[[f32; 3]], parts: PartChoices) -> Face {
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Positions(landmarks.to_vec())),
        parts,
        ..FaceOptions::default()
    };
    ENGINE.prepare(mesh, &options, SILENT).unwrap()
}

/// Displacements of one frame, `[V]`.
pub fn moved(face: &Face, motion: &[[f32; 3]]) -> Points {
    let motion = Array3::from_shape_fn((1, 68, 3), |(_, n, i)| motion[n][i]);
    let motion = Movement::Own {
        landmarks: motion,
        fps: 30.0,
    };
    let moved = |sink: &mut dyn FrameSink| ENGINE.spread(face, motion, sink, SILENT);
    let frame = Collector::collect(moved).unwrap().vertices.displacements;
    let rows = frame.index_axis(ndarray::Axis(0), 0);
    rows.outer_iter().map(|p| [p[0], p[1], p[2]]).collect()
}

/// The mouth opens by about 2 cm: chin and lower lip go down and back.
pub fn opening() -> Points {
    let mut motion = vec![[0.0; 3]; 68];
    for (n, share) in (2..=14usize).map(|n| (n, 1.0 - n.abs_diff(8) as f32 / 7.0)) {
        motion[n] = [0.0, -0.018 * share, -0.014 * share];
    }
    for (n, share) in [(55, 0.6), (56, 0.9), (57, 1.0), (58, 0.9), (59, 0.6)] {
        motion[n] = [0.0, -0.018 * share, -0.008 * share];
    }
    for (n, share) in [(65, 0.8), (66, 1.0), (67, 0.8)] {
        motion[n] = [0.0, -0.018 * share, -0.008 * share];
    }
    motion
}

/// Upper and lower landmarks of mouth or lids move towards each other until they have passed each
/// other by `past` metres.
pub fn closing(landmarks: &[[f32; 3]], pairs: &[(usize, usize)], past: f32) -> Points {
    let mut motion = vec![[0.0; 3]; 68];
    for &(upper, lower) in pairs {
        let gap = landmarks[upper][1] - landmarks[lower][1];
        motion[upper][1] = -0.5 * (gap + past);
        motion[lower][1] = 0.5 * (gap + past);
    }
    motion
}

pub const LIPS: [(usize, usize); 3] = [(61, 67), (62, 66), (63, 65)];
pub const LIDS: [(usize, usize); 4] = [(37, 41), (38, 40), (43, 47), (44, 46)];

/// Straight distance in millimetres.
pub fn mm(a: [f32; 3], b: [f32; 3]) -> f32 {
    1000.0 * (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt()
}

pub fn sum(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Value below which this share of the values lies.
pub fn quantile(mut values: Vec<f32>, share: f32) -> f32 {
    values.sort_by(f32::total_cmp);
    values[((values.len() - 1) as f32 * share) as usize]
}
