//! FaceTalk through the engine: it turns speech into landmarks of a head that is a field.

use std::{
    f32::consts::PI,
    fs,
    path::Path,
    sync::{
        Arc, LazyLock,
        atomic::{AtomicUsize, Ordering},
    },
};

use anyface::{
    CachePolicy, Engine, EngineOptions, Error, Face, MotionRequest, Result,
    audio::Waveform,
    conditions::{Controls, EmotionCurve},
    face::{CodeField, FaceOptions},
    head::{Head, HeadOnMesh, HeadSurface, MadeHead, Reach, ScanFit},
    job::{Progress, SILENT},
    mesh::{LandmarkSource, Mesh, Similarity},
    motion::{CodeClip, LandmarkClip, Motion, WeightClip},
    output::write_surface_frames,
    rig::ShapeSource,
    spread::Collector,
};
use ndarray::{Array2, Array3, s};

use crate::voice::babble;

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

/// A request with some controls, and with nothing that chance adds except through the seed.
fn request_with(seed: u64, controls: &[(&str, f32)]) -> MotionRequest {
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

/// Standard deviation over time of the gap between the inner lips, mm.
fn amplitude(motion: &Array3<f32>) -> f32 {
    let gap = &motion.slice(s![.., 62, 1]) - &motion.slice(s![.., 66, 1]);
    1e3 * gap.std(0.0)
}

#[test]
fn a_voice_moves_the_mouth_and_silence_hardly_does() {
    let spoken = said(voice(), &request_with(0, &[])).unwrap();
    assert_eq!(spoken.dim(), (75, 68, 3));
    let silent = said(vec![0.0; voice().len()], &request_with(0, &[])).unwrap();
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
    let first = said(voice(), &request_with(3, &[])).unwrap();
    assert_eq!(first, said(voice(), &request_with(3, &[])).unwrap());
    assert_ne!(first, said(voice(), &request_with(4, &[])).unwrap());
}

#[test]
fn vividness_and_guidance_open_the_mouth_wider() {
    for (name, low, high) in [("vividness", 0.7, 1.3), ("speech_guidance", 1.0, 3.0)] {
        let [less, more] = [low, high]
            .map(|value| amplitude(&said(voice(), &request_with(0, &[(name, value)])).unwrap()));
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
    refused(&request_with(0, &[("vividness", 2.0)]), "vividness");
    let style = MotionRequest {
        style: Some("nobody".into()),
        ..request_with(0, &[])
    };
    refused(&style, "nobody");
}

/// A random head at rest as a mesh, metres, and its coefficients.
fn own_head(seed: u64) -> (MadeHead, Vec<f32>) {
    let coefficients = Head::random(seed);
    let one = HEAD.one(HEAD.identity_code(&coefficients).unwrap());
    (one.unwrap().mesh(72, SILENT).unwrap(), coefficients)
}

fn prepared(mesh: &Mesh, head: &MadeHead, field: f32) -> Face {
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Vertices(head.landmarks.vertices.to_vec())),
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
    let (head, coefficients) = own_head(5);
    let face = prepared(&head.mesh, &head, 1.0);
    let fit = ScanFit {
        coefficients: coefficients.clone(),
        mean_mm: 0.0,
        most_mm: 0.0,
        points: head.mesh.positions.len(),
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
    let base = Array3::zeros((1, head.mesh.positions.len(), 3));
    let moved = field.beyond(codes.view(), &base).unwrap();
    let one = HEAD.one(HEAD.identity_code(&coefficients).unwrap());
    let posed = one.unwrap().mover(head.canonical.clone()).at(&code);
    let (posed, shares) = (posed.unwrap(), field.shares());
    let (mut off, mut travel, mut count) = (0.0, 0.0, 0);
    for (v, share) in shares
        .iter()
        .enumerate()
        .filter(|(_, share)| **share > 0.99)
    {
        let rest = head.mesh.positions[v];
        let to = std::array::from_fn(|i| rest[i] + moved[[0, v, i]] / share);
        off += distance(to, &posed[v]);
        travel += distance(rest, &posed[v]);
        count += 1;
    }
    assert!(count > 500, "{count} vertices follow");
    assert!(off < 0.05 * travel, "{off} of {travel}");
    let touching = head.landmarks.vertices[36..].iter();
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

/// Spreads a performance over a face. Returns the displacements and the notes of the report.
fn spread(face: &Face) -> (Array3<f32>, Vec<String>) {
    let waveform = Waveform { samples: voice() };
    let performed = ENGINE
        .perform(&waveform, &request_with(1, &[]), SILENT)
        .unwrap();
    let mut notes = Vec::new();
    let clip = Collector::collect(|sink| {
        let report = ENGINE.spread(face, &performed.motion, sink, SILENT)?;
        notes.clone_from(&report.notes);
        Ok(report)
    });
    (clip.unwrap().vertices.displacements, notes)
}

#[test]
fn a_mesh_like_a_head_moves_by_the_field_and_another_by_its_landmarks() {
    let (head, _) = own_head(6);
    let (by_landmarks, none) = spread(&prepared(&head.mesh, &head, 0.0));
    let (by_field, notes) = spread(&prepared(&head.mesh, &head, 1.0));
    assert!(none.is_empty() && notes.is_empty(), "{none:?} {notes:?}");
    let differ = (&by_field - &by_landmarks).mapv(f32::abs);
    let most = differ.iter().fold(0.0f32, |most, x| most.max(*x));
    assert!(most > 2e-4 && most < 2e-2, "{most} m");
    assert!(by_field.iter().all(|x| x.is_finite()));

    // Three times as broad as any face.
    let mut broad = head.mesh.clone();
    broad.positions.iter_mut().for_each(|p| p[0] *= 3.0);
    let (by_field, notes) = spread(&prepared(&broad, &head, 1.0));
    assert!(
        notes.len() == 1 && notes[0].contains("landmarks alone"),
        "{notes:?}"
    );
    let (by_landmarks, _) = spread(&prepared(&broad, &head, 0.0));
    assert_eq!(by_field, by_landmarks);
}

/// The code of an open jaw.
fn jaw_open(weight: f32) -> Vec<f32> {
    let channels = HEAD.config().channels.iter();
    let weights: Vec<f32> = channels
        .map(|name| if name == "jawOpen" { weight } else { 0.0 })
        .collect();
    HEAD.expression_code(&weights).unwrap()
}

/// Codes of a jaw that opens.
fn some_codes(frames: usize) -> Array2<f32> {
    let codes: Vec<f32> = (0..frames)
        .flat_map(|t| jaw_open(t as f32 / frames as f32))
        .collect();
    Array2::from_shape_vec((frames, codes.len() / frames), codes).unwrap()
}

/// Landmarks of the mean face, which opens its jaw, smiles and raises its brows once in two
/// seconds.
fn moving_landmarks() -> LandmarkClip {
    let names = [
        "jawOpen",
        "mouthSmileLeft",
        "mouthSmileRight",
        "browInnerUp",
    ];
    let wave = |t: usize| (PI * t as f32 / 50.0).sin().powi(2);
    let weights = Array2::from_shape_fn((50, names.len()), |(t, n)| {
        [0.5, 0.8, 0.8, 0.9][n] * wave(t)
    });
    let clip = WeightClip {
        names: names.map(str::to_owned).to_vec(),
        weights,
        fps: 25.0,
        together: Vec::new(),
    };
    ENGINE.landmarks_of(&Motion::Weights(clip)).unwrap()
}

/// The codes that follow landmarks.
fn codes_of(clip: &LandmarkClip) -> CodeClip {
    match ENGINE.follow(clip, &Controls::default(), SILENT).unwrap() {
        Motion::Codes(codes) => codes,
        other => panic!("expected codes, got {}", other.kind()),
    }
}

#[test]
fn landmarks_lead_the_head_as_speech_does() {
    let clip = moving_landmarks();
    let led = codes_of(&clip);
    assert_eq!(led.landmarks, clip);
    let mean = HEAD.one(HEAD.identity_code(&[0.0; 100]).unwrap()).unwrap();
    let marks = mean.mover(mean.landmarks());
    let rest = marks.at(&HEAD.rest_code()).unwrap();
    let (mut off, mut way) = (0.0, 0.0);
    for (t, code) in led.codes.rows().into_iter().enumerate() {
        let moved = marks.at(&code.to_vec()).unwrap();
        for n in 17..68 {
            let target: [f32; 3] = std::array::from_fn(|i| clip.displacements[[t, n, i]]);
            let done = std::array::from_fn(|i| moved[n][i] - rest[n][i]);
            off += distance(done, &target);
            way += distance([0.0; 3], &target);
        }
    }
    assert!(way > 1.0 && off < 0.25 * way, "{off} of {way} m");

    // At twice the frame rate, every other frame has the codes of a frame at the single rate.
    let fast = codes_of(&clip.at_rate(50.0, 100));
    assert_eq!(fast.codes.nrows(), 100);
    let apart = (&fast.codes.slice(s![..;2, ..]) - &led.codes).mapv(f32::abs);
    assert!(apart.iter().all(|x| *x < 1e-3));
}

#[test]
fn vertices_follow_the_field_under_landmarks_of_another_system() {
    let (head, _) = own_head(6);
    let clip = moving_landmarks();
    let shown = |face: &Face, motion: &Motion| {
        let clip = Collector::collect(|sink| ENGINE.spread(face, motion, sink, SILENT)).unwrap();
        clip.vertices.displacements
    };
    let both = [1.0, 0.0].map(|field| {
        let face = prepared(&head.mesh, &head, field);
        let followed = ENGINE.follow(&clip, &face.options.controls, SILENT);
        shown(&face, &followed.unwrap())
    });
    let with_field = prepared(&head.mesh, &head, 1.0);
    assert_eq!(both[0], shown(&with_field, &Motion::Codes(codes_of(&clip))));
    // Landmarks without codes move the vertices by landmarks alone, even with this system.
    assert_eq!(both[1], shown(&with_field, &Motion::Landmarks(clip)));
    let apart = (&both[0] - &both[1])
        .iter()
        .fold(0.0f32, |most, x| most.max(x.abs()));
    assert!((1e-4..2e-2).contains(&apart), "{apart} m");
}

/// Mean distance from some points to the nearest vertices of a mesh.
fn distance_to(points: &[[f32; 3]], mesh: &Mesh) -> f32 {
    let nearest = |p: &[f32; 3]| {
        let all = mesh.positions.iter().map(|q| distance(*p, q));
        all.fold(f32::INFINITY, f32::min)
    };
    points.iter().map(nearest).sum::<f32>() / points.len() as f32
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn a_head_comes_as_a_surface_for_every_frame() {
    let (head, _) = own_head(6);
    // The mesh is in centimetres and away from the origin.
    let mut mesh = head.mesh.clone();
    mesh.positions
        .iter_mut()
        .for_each(|p| *p = [100.0 * p[0] + 30.0, 100.0 * p[1], 100.0 * p[2] - 5.0]);
    let face = prepared(&mesh, &head, 1.0);
    let (surface, note) = ENGINE.head_surface(&face, 64, SILENT).unwrap();
    assert_eq!(note, None);
    let marks = &face.landmarks.positions[17..];
    let rest = Mesh {
        positions: surface.at_rest().unwrap(),
        triangles: surface.triangles().to_vec(),
    };
    // Cells are 0.6 cm wide.
    let off = distance_to(marks, &rest);
    assert!(off < 0.35, "{off} cm");

    let folder = tempfile::tempdir().unwrap();
    let (out, codes) = (folder.path().join("frames"), some_codes(5));
    let most = write_surface_frames(&out, &surface, codes.view(), SILENT).unwrap();
    assert!((0.1..5.0).contains(&most), "{most} cm");
    let expected = ["0001.ply", "0002.ply", "0003.ply", "0004.ply", "0005.ply"];
    assert_eq!(names(&out), expected);
    let frames = expected.map(|name| Mesh::read(out.join(name)).unwrap());
    for (frame, code) in frames.iter().zip(codes.rows()) {
        assert_eq!(frame.triangles, rest.triangles);
        assert_eq!(frame.positions, surface.at(&code.to_vec()).unwrap());
    }
    assert_ne!(frames[0].positions, frames[4].positions);
    assert_eq!(names(folder.path()), ["frames"]);
}

/// Displacements of the mean head's landmarks under codes, `[T, 68, 3]`.
fn landmarks_under(codes: &Array2<f32>) -> Array3<f32> {
    let (places, rest) = HEAD.mean_landmarks().unwrap();
    let moved = codes
        .rows()
        .into_iter()
        .map(|code| places.at(&code.to_vec()).unwrap());
    let moved: Vec<_> = moved.collect();
    Array3::from_shape_fn((codes.nrows(), 68, 3), |(t, n, axis)| {
        moved[t][n][axis] - rest[n][axis]
    })
}

#[test]
fn a_surface_shows_emotion_articulation_and_blinks() {
    let happy = EmotionCurve::parse("happy:1").unwrap();
    let wishes = [
        (
            "emotion",
            MotionRequest {
                emotion: happy,
                ..request_with(1, &[])
            },
        ),
        ("articulation", request_with(1, &[("articulation", 0.0)])),
        ("blinks", request_with(1, &[("blinks_per_minute", 60.0)])),
    ];
    let sound = Waveform { samples: voice() };
    for (name, request) in wishes {
        let performed = ENGINE.perform(&sound, &request, SILENT).unwrap();
        let Motion::Codes(clip) = performed.motion else {
            panic!("expected codes")
        };
        let target = &clip.landmarks.displacements;
        let led = HEAD
            .led_codes(clip.codes.view(), target.view(), SILENT)
            .unwrap();
        let off = |codes: &Array2<f32>| {
            1e3 * (&landmarks_under(codes) - target)
                .mapv(|x| x * x)
                .mean()
                .unwrap()
                .sqrt()
        };
        let (before, after) = (off(&clip.codes), off(&led));
        assert!(after < 0.5 * before, "{name}: {before} {after} mm");
    }
}

#[test]
fn the_mean_head_stands_in_where_none_is_like_the_mesh() {
    let (head, _) = own_head(6);
    let mut broad = head.mesh.clone();
    broad.positions.iter_mut().for_each(|p| p[0] *= 3.0);
    let face = prepared(&broad, &head, 1.0);
    let (surface, note) = ENGINE.head_surface(&face, 32, SILENT).unwrap();
    let note = note.unwrap();
    assert!(note.contains("that of the mean head"), "{note}");
    let zero = vec![0.0; 100];
    let mean = HEAD.one(HEAD.identity_code(&zero).unwrap()).unwrap();
    let back = face.to_canonical;
    let rest = surface.at_rest().unwrap().into_iter();
    let rest: Vec<[f32; 3]> = rest.map(|p| back.apply(p)).collect();
    let at_rest = mean.posed(&HEAD.rest_code()).unwrap();
    let far = at_rest.distance(&rest).into_iter().map(f32::abs);
    let far = far.sum::<f32>() / rest.len() as f32;
    assert!(far < 1e-3, "{far} m");
}

#[test]
fn frames_of_a_surface_appear_whole_or_not_at_all_and_harm_no_other_file() {
    let zero = vec![0.0; 100];
    let surface = HeadSurface::new(HEAD.clone(), &zero, Similarity::IDENTITY, 32, SILENT).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (out, codes) = (folder.path().join("frames"), some_codes(4));

    let calls = AtomicUsize::new(0);
    let stop = |p: Progress| p.stage != "frames" || calls.fetch_add(1, Ordering::Relaxed) < 2;
    let stopped = write_surface_frames(&out, &surface, codes.view(), &stop);
    assert!(matches!(stopped, Err(Error::Cancelled)), "{stopped:?}");
    assert_eq!(names(folder.path()), [] as [&str; 0]);

    fs::create_dir(&out).unwrap();
    fs::write(out.join("notes.txt"), "mine").unwrap();
    let refused = write_surface_frames(&out, &surface, codes.view(), SILENT).unwrap_err();
    assert!(
        refused.to_string().contains("1 files, such as notes.txt"),
        "{refused}"
    );
    assert_eq!(names(&out), ["notes.txt"]);
    fs::remove_file(out.join("notes.txt")).unwrap();
    write_surface_frames(&out, &surface, codes.view(), SILENT).unwrap();
    assert_eq!(names(&out).len(), 4);
    let again = write_surface_frames(&out, &surface, codes.view(), SILENT).unwrap_err();
    assert!(again.to_string().contains("4 files"), "{again}");
}

#[test]
fn shapes_by_the_field_are_those_of_its_codes_and_bend_in_between() {
    let (head, coefficients) = own_head(5);
    let face = prepared(&head.mesh, &head, 1.0);
    let by_field = ShapeSource::Field { in_betweens: true };
    let rig = ENGINE.rig(&face, by_field, SILENT).unwrap();
    assert_eq!(rig.names.len(), 2 * 52 + 15);
    let shape = |name: &str| {
        let row = rig.names.iter().position(|known| known == name).unwrap();
        rig.deltas.index_axis(ndarray::Axis(0), row)
    };
    // The chin is far from lips and lids, so the field alone moves it.
    let one = HEAD
        .one(HEAD.identity_code(&coefficients).unwrap())
        .unwrap();
    let posed = one
        .mover(head.canonical.clone())
        .at(&jaw_open(1.0))
        .unwrap();
    let chin = head.landmarks.vertices[8] as usize;
    let truth: [f32; 3] = std::array::from_fn(|i| posed[chin][i] - head.mesh.positions[chin][i]);
    let open = shape("jawOpen");
    let off = distance(std::array::from_fn(|i| open[[chin, i]]), &truth);
    let way = distance([0.0; 3], &truth);
    assert!(way > 0.01 && off < 0.1 * way, "{off} of {way} m");

    // Lids move on a curve around the eye, while the path of the jaw hardly bends.
    let bent = |name: &str| {
        let halfway = shape(name).mapv(|x| 0.5 * x);
        let off = (&shape(&format!("{name}_half")) - &halfway).mapv(f32::abs);
        off.iter().fold(0.0f32, |most, x| most.max(*x))
    };
    assert!(
        (2e-4..1e-2).contains(&bent("eyeBlinkLeft")),
        "{} m",
        bent("eyeBlinkLeft")
    );
    assert!(bent("jawOpen") > 1e-6 && bent("tongueOut") == 0.0);
    // `mouthClose` is added to an open jaw and lifts the lower lip.
    let lip = head.landmarks.vertices[57] as usize;
    assert!(shape("mouthClose")[[lip, 1]] > 0.005);
    let linear = ENGINE.rig(&face, ShapeSource::Network, SILENT).unwrap();
    let row = linear.names.iter().position(|known| known == "tongueOut");
    let expected = linear.deltas.index_axis(ndarray::Axis(0), row.unwrap());
    assert_eq!(shape("tongueOut"), expected);
    let brow = head.landmarks.vertices[21] as usize;
    let raised = shape("browInnerUp")[[brow, 1]];
    assert!(raised > 0.003, "{raised} m");
    assert!(
        rig.reports
            .iter()
            .zip(&rig.names)
            .all(|(report, name)| report.name == *name)
    );

    // Three times as broad as any face.
    let (head, _) = own_head(6);
    let mut broad = head.mesh.clone();
    broad.positions.iter_mut().for_each(|p| p[0] *= 3.0);
    let face = prepared(&broad, &head, 1.0);
    let by_field = ShapeSource::Field { in_betweens: false };
    let refused = ENGINE.rig(&face, by_field, SILENT).unwrap_err();
    assert!(
        refused.to_string().contains("is like a head of the model"),
        "{refused}"
    );
}
