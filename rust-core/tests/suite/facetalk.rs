//! FaceTalk through the engine: speech to the landmarks of a head that is a field.

use std::sync::{Arc, LazyLock};

use anyface::{
    CachePolicy, Engine, EngineOptions, Error, Face, MotionRequest, Result,
    audio::Waveform,
    conditions::Controls,
    deform::CodeField,
    head::{Head, HeadOnMesh, HeadOptions, MadeHead, Reach, ScanFit},
    mesh::{FaceOptions, LandmarkSource, Mesh, Similarity},
    motion::Motion,
    progress::SILENT,
    spread::Collector,
};
use ndarray::{Array2, Array3, s};

use crate::performance::babble;

const SECONDS: f32 = 3.0;

static ENGINE: LazyLock<Engine> = LazyLock::new(|| {
    Engine::new(EngineOptions {
        system: Some("facetalk".into()),
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
    .unwrap()
});

static HEAD: LazyLock<Arc<Head>> = LazyLock::new(|| Arc::new(Head::open(None).unwrap()));

/// A request with some controls, and nothing that chance adds but the seed.
fn asked(seed: u64, controls: &[(&str, f32)]) -> MotionRequest {
    let still = ["blinks_per_minute", "brow_accents", "gaze", "head_motion"];
    let all = still.iter().map(|name| (*name, 0.0));
    let all = all.chain(controls.iter().copied());
    MotionRequest {
        fps: 25.0,
        seed,
        controls: all.fold(Controls::default(), |all, (name, value)| {
            all.with(name, value)
        }),
        ..MotionRequest::default()
    }
}

fn said(samples: Vec<f32>, request: &MotionRequest) -> Result<Array3<f32>> {
    match ENGINE
        .perform(&Waveform { samples }, request, SILENT)?
        .motion
    {
        Motion::Codes(clip) => Ok(clip.landmarks.displacements),
        other => panic!("expected codes, got {}", other.kind()),
    }
}

fn voice() -> Vec<f32> {
    babble(SECONDS, 16_000)
}

/// Deviation of the distance of the inner lips over time, mm.
fn amplitude(motion: &Array3<f32>) -> f32 {
    let gap = &motion.slice(s![.., 62, 1]) - &motion.slice(s![.., 66, 1]);
    1e3 * gap.std(0.0)
}

#[test]
fn a_voice_moves_the_mouth_and_silence_hardly_does() {
    let spoken = said(voice(), &asked(0, &[])).unwrap();
    assert_eq!(spoken.dim(), (75, 68, 3));
    let silent = said(vec![0.0; voice().len()], &asked(0, &[])).unwrap();
    let (voiced, still) = (amplitude(&spoken), amplitude(&silent));
    assert!(voiced > 1.0 && voiced > 1.5 * still, "{voiced} {still}");
    let bridge = spoken.slice(s![.., 27, ..]).mapv(f32::abs);
    assert!(
        bridge.iter().all(|x| *x < 1e-3),
        "the bridge of the nose moves"
    );
}

#[test]
fn the_same_seed_says_it_the_same_way_and_another_one_otherwise() {
    let first = said(voice(), &asked(3, &[])).unwrap();
    assert_eq!(first, said(voice(), &asked(3, &[])).unwrap());
    assert_ne!(first, said(voice(), &asked(4, &[])).unwrap());
}

#[test]
fn vividness_and_guidance_open_the_mouth_wider() {
    for (name, low, high) in [("vividness", 0.7, 1.3), ("speech_guidance", 1.0, 3.0)] {
        let [less, more] = [low, high]
            .map(|value| amplitude(&said(voice(), &asked(0, &[(name, value)])).unwrap()));
        assert!(more > less, "{name}: {less} {more}");
    }
}

#[test]
fn styles_and_values_that_it_does_not_know_are_told() {
    let refused = |request: &MotionRequest, words: &str| {
        let error = said(voice(), request).unwrap_err();
        assert!(matches!(error, Error::InvalidInput(_)), "{error:?}");
        assert!(error.to_string().contains(words), "{error}");
    };
    refused(&asked(0, &[("vividness", 2.0)]), "vividness");
    let style = MotionRequest {
        style: Some("nobody".into()),
        ..asked(0, &[])
    };
    refused(&style, "nobody");
}

/// A head at rest as a mesh of its own, metres.
fn own_head(seed: u64) -> (MadeHead, Vec<f32>) {
    let coefficients = Head::random(seed);
    let one = HEAD.one(HEAD.identity_code(&coefficients).unwrap());
    let options = HeadOptions {
        resolution: 72,
        parts: false,
    };
    (one.unwrap().mesh(&options, SILENT).unwrap(), coefficients)
}

fn prepared(mesh: &Mesh, made: &MadeHead, field: f32) -> Face {
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Vertices(made.landmarks.vertices.to_vec())),
        controls: Controls::default().with("field", field),
        ..FaceOptions::default()
    };
    ENGINE.prepare(mesh, &options, SILENT).unwrap()
}

fn distance(a: [f32; 3], b: &[f32; 3]) -> f32 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt()
}

#[test]
fn vertices_go_where_the_field_takes_them() {
    let (made, coefficients) = own_head(5);
    let face = prepared(&made.mesh, &made, 1.0);
    let fit = ScanFit {
        coefficients: coefficients.clone(),
        mean_mm: 0.0,
        most_mm: 0.0,
        points: made.mesh.positions.len(),
        metres_per_unit: 1.0,
        to_head: Similarity::IDENTITY,
        warnings: vec![],
    };
    let on_mesh = |reach| HeadOnMesh::of_fit(HEAD.clone(), &face, fit.clone(), reach, SILENT);
    let field = on_mesh(Reach::default()).unwrap();
    let mut weights = vec![0.0; HEAD.config().channels.len()];
    for (name, weight) in HEAD.config().channels.iter().zip(&mut weights) {
        *weight = f32::from(u8::from(name == "jawOpen" || name == "cheekPuff"));
    }
    let code = HEAD.expression_code(&weights).unwrap();
    let codes = Array2::from_shape_vec((1, code.len()), code.clone()).unwrap();
    let base = Array3::zeros((1, made.mesh.positions.len(), 3));
    let moved = field.beyond(codes.view(), &base).unwrap();
    let one = HEAD.one(HEAD.identity_code(&coefficients).unwrap());
    let posed = one.unwrap().mover(made.canonical.clone()).at(&code);
    let (posed, shares) = (posed.unwrap(), field.shares());
    let (mut off, mut travel, mut count) = (0.0, 0.0, 0);
    for (v, share) in shares
        .iter()
        .enumerate()
        .filter(|(_, share)| **share > 0.99)
    {
        let rest = made.mesh.positions[v];
        let to = std::array::from_fn(|i| rest[i] + moved[[0, v, i]] / share);
        off += distance(to, &posed[v]);
        travel += distance(rest, &posed[v]);
        count += 1;
    }
    assert!(count > 500, "{count} vertices follow");
    assert!(off < 0.05 * travel, "{off} of {travel}");
    let touching = made.landmarks.vertices[36..].iter();
    assert!(
        touching
            .map(|v| shares[*v as usize])
            .all(|share| share == 0.0)
    );

    let half = on_mesh(Reach {
        share: 0.5,
        sigma_m: 0.0,
    })
    .unwrap();
    let halved = half.beyond(codes.view(), &base).unwrap();
    assert!(
        halved
            .iter()
            .zip(&moved)
            .all(|(h, m)| (2.0 * h - m).abs() < 1e-6)
    );
    let near = on_mesh(Reach {
        share: 1.0,
        sigma_m: 0.03,
    })
    .unwrap();
    let near = near.beyond(codes.view(), &base).unwrap();
    let largest = |of: &Array3<f32>| of.iter().fold(0.0f32, |most, x| most.max(x.abs()));
    assert!(largest(&near) < 0.9 * largest(&moved) && largest(&near) > 0.0);
}

/// Codes and landmarks of a performance, spread over a face.
fn spread(face: &Face) -> (Array3<f32>, Vec<String>) {
    let waveform = Waveform { samples: voice() };
    let performed = ENGINE.perform(&waveform, &asked(1, &[]), SILENT).unwrap();
    let mut notes = Vec::new();
    let clip = Collector::collect(|sink| {
        let made = ENGINE.spread(face, &performed.motion, sink, SILENT)?;
        notes.clone_from(&made.notes);
        Ok(made)
    });
    (clip.unwrap().vertices.displacements, notes)
}

#[test]
fn a_mesh_like_a_head_moves_by_the_field_and_another_by_its_landmarks() {
    let (made, _) = own_head(6);
    let (by_landmarks, none) = spread(&prepared(&made.mesh, &made, 0.0));
    let (by_field, notes) = spread(&prepared(&made.mesh, &made, 1.0));
    assert!(none.is_empty() && notes.is_empty(), "{none:?} {notes:?}");
    let differ = (&by_field - &by_landmarks).mapv(f32::abs);
    let most = differ.iter().fold(0.0f32, |most, x| most.max(*x));
    assert!(most > 2e-4 && most < 2e-2, "{most} m");
    assert!(by_field.iter().all(|x| x.is_finite()));

    // Three times as broad as any face.
    let mut broad = made.mesh.clone();
    broad.positions.iter_mut().for_each(|p| p[0] *= 3.0);
    let (by_field, notes) = spread(&prepared(&broad, &made, 1.0));
    assert!(
        notes.len() == 1 && notes[0].contains("landmarks alone"),
        "{notes:?}"
    );
    let (by_landmarks, _) = spread(&prepared(&broad, &made, 0.0));
    assert_eq!(by_field, by_landmarks);
}
