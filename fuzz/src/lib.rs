//! What each fuzz target does with its bytes. The fuzzers call these functions, and so do the
//! tests, which replay the corpus.

use std::{io::Write, path::Path, sync::OnceLock};

use anyface::{
    CachePolicy, Engine, EngineOptions, MotionRequest,
    annotation::Annotation,
    audio::{LOUDEST, SoundFile, Waveform},
    conditions::EmotionCurve,
    head::{self, Head, HeadMaker, ScanOptions},
    job::SILENT,
    mesh::{FixedLandmark, LandmarkSource, Landmarks, Mesh, ObjectNames},
    motion::{LandmarkClip, Life, Motion, Stretch, WeightClip},
    output::{read_landmark_motion, read_life, read_rig, read_vertex_motion, read_weights},
    systems::{Registration, SYSTEMS, built_in_models},
    text::{self, TextUnits},
};

/// OBJ, PLY and GLB: a mesh that can be read passes its own check and is no larger than the size of
/// its file allows.
pub fn mesh(bytes: &[u8]) {
    if let Ok(mesh) = Mesh::parse(bytes) {
        mesh.check().unwrap();
        assert!(mesh.positions.len() <= 8_000_000 + 8 * bytes.len());
        if mesh.positions.len() < 10_000 {
            let _ = mesh.report();
        }
    }
    let names = ObjectNames::of_obj(&String::from_utf8_lossy(bytes));
    assert!(names.of_vertex.len() <= bytes.len());
}

/// Sound files of every kind: samples that can be read are finite, and a damaged share is more than
/// 0 and at most the whole.
pub fn sound(bytes: &[u8]) {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    if let Ok(sound) = SoundFile::read(file.path(), true, SILENT) {
        // Resampling may ring a little beyond the largest sample.
        let is_sound = |x: &f32| x.is_finite() && x.abs() <= 4.0 * LOUDEST;
        if let Some(damage) = sound.damage {
            assert!(damage.share() > 0.0 && damage.share() <= 1.0);
        }
        let waveform = sound.whole(SILENT).unwrap();
        assert!(waveform.samples.iter().all(is_sound));
    }
}

/// npz, pc2 and mdd files: values that can be read are finite. The first byte chooses the reader.
pub fn arrays(bytes: &[u8]) {
    let Some((choice, bytes)) = bytes.split_first() else {
        return;
    };
    let ending = ["npz", "pc2", "mdd"][usize::from(choice % 3)];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("a.{ending}"));
    std::fs::write(&path, bytes).unwrap();
    let mesh = Mesh {
        positions: vec![[0.0; 3]; 4],
        triangles: vec![[0, 1, 2]],
    };
    if let Ok(motion) = read_vertex_motion(&path, &mesh) {
        assert!(motion.displacements.iter().all(|x| x.is_finite()));
    }
    if ending == "npz" {
        if let Ok(motion) = read_landmark_motion(&path) {
            assert!(motion.displacements.iter().all(|x| x.is_finite()));
        }
        if let Ok(rig) = read_rig(&path) {
            assert!(rig.deltas.iter().all(|x| x.is_finite()));
        }
        let _ = (read_life(&path), read_weights(&path));
    }
}

/// Text files with landmarks, events or the times of sounds. The first byte chooses the reader.
pub fn text(bytes: &[u8]) {
    let Some((choice, bytes)) = bytes.split_first() else {
        return;
    };
    let endings = ["json", "TextGrid", "tsv", "pgo", "dat", "txt"];
    let ending = endings[usize::from(*choice) % endings.len()];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("a.{ending}"));
    std::fs::write(&path, bytes).unwrap();
    if let Ok(annotation) = Annotation::read(&path, 24.0) {
        let out = folder.path().join("b.TextGrid");
        let _ = annotation.write(&out, 24.0);
    }
    if ending == "json" {
        let _ = (
            LandmarkSource::read(&path),
            FixedLandmark::read(&path),
            text::Reader::default().events_of_file(&path),
        );
    }
    let _ = EmotionCurve::parse_keys(&String::from_utf8_lossy(bytes));
}

/// A folder with one damaged model: the engine either refuses it or gives finite motion.
///
/// The first byte chooses the model. The second chooses whether to damage its config or its
/// weights, and which system uses a model that all share. Then follow groups of four bytes: three
/// for a position, one for the new value.
pub fn models(bytes: &[u8]) {
    let [choice, part, changes @ ..] = bytes else {
        return;
    };
    let models: Vec<_> = built_in_models().collect();
    let model = models[usize::from(*choice) % models.len()];
    let files = model.open(None).unwrap();
    let (mut weights, mut config) = (files.weights, files.config.into_owned().into_bytes());
    let target = if part % 2 == 0 {
        &mut config
    } else {
        &mut weights
    };
    for change in changes.chunks_exact(4) {
        let at = u32::from_le_bytes([change[0], change[1], change[2], 0]) as usize % target.len();
        target[at] = change[3];
    }
    let folder = tempfile::tempdir().unwrap();
    let model_folder = folder.path().join(model.name);
    std::fs::create_dir(&model_folder).unwrap();
    std::fs::write(model_folder.join("model.safetensors"), weights).unwrap();
    std::fs::write(model_folder.join("config.json"), config).unwrap();
    // If no system owns the model, all share it: use any of them.
    let owns = |system: &&&Registration| {
        system
            .models
            .iter()
            .any(|model_folder| model_folder.name == model.name)
    };
    let shared = SYSTEMS[usize::from(part / 2) % SYSTEMS.len()];
    let options = EngineOptions {
        system: Some(SYSTEMS.iter().find(owns).unwrap_or(&shared).name.to_owned()),
        models: Some(folder.path().to_owned()),
        cache: CachePolicy::Off,
        threads: Some(1),
        ..Default::default()
    };
    beside_the_engine(model.name, folder.path());
    let Ok(engine) = Engine::new(options) else {
        return;
    };
    let samples = (0..4_000).map(|i| (i as f32 * 0.08).sin() * 0.5).collect();
    let request = MotionRequest::default();
    if let Ok(performance) = engine.perform(&Waveform { samples }, &request, SILENT) {
        assert!(performance.motion.values().iter().all(|x| x.is_finite()));
    }
}

/// Checks the models that an engine does not need for motion: those of texts and heads.
fn beside_the_engine(model: &str, folder: &Path) {
    if model == text::MODEL.name
        && let Ok(words) = TextUnits::open(Some(folder))
    {
        let meaning = words.understand("a wide smile, the left eye shut");
        for unit in meaning.unwrap_or_default().units {
            assert!(unit.2.is_finite() && unit.3.is_finite());
        }
    }
    if model == head::MODEL.name
        && let Ok(head) = Head::open(Some(folder))
        && let Ok(one) = head.one(vec![0.1; head.config().identity_code()])
        && let Ok(head) = one.mesh(32, SILENT)
    {
        let numbers = head.mesh.positions.as_flattened().iter();
        assert!(numbers.copied().all(f32::is_finite));
    }
}

/// Replaces a stretch of a motion, which comes from a file or from arbitrary numbers. The result
/// has the same shape, frames outside the stretch are identical to the bit, and finite frames stay
/// finite.
///
/// The first byte chooses the kind. The next sixteen are the start and end of the stretch, or its
/// text.
pub fn redo(bytes: &[u8]) {
    let Some((&kind, bytes)) = bytes.split_first() else {
        return;
    };
    let Some((ends, rest)) = bytes.split_at_checked(16) else {
        return;
    };
    let number = |bytes: &[u8]| f64::from_le_bytes(bytes.try_into().unwrap());
    let stretch = match kind % 2 {
        0 => Stretch::new(number(&ends[..8]), number(&ends[8..])),
        _ => Stretch::parse(String::from_utf8_lossy(ends).trim_end_matches('\0')),
    };
    let Ok(stretch) = stretch else {
        return;
    };
    match kind / 2 % 2 {
        0 => redo_of_file(rest, &stretch),
        _ => redo_of_numbers(kind, rest, &stretch),
    }
}

fn redo_of_file(bytes: &[u8], stretch: &Stretch) {
    let file = tempfile::Builder::new().suffix(".npz").tempfile().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    if let Ok(was) = read_landmark_motion(file.path()) {
        let fps = was.fps.unwrap_or(30.0);
        let frames = was.displacements.dim().0;
        let was = Motion::Landmarks(LandmarkClip {
            displacements: was.displacements,
            fps,
        });
        redo_as_still(&was, stretch);
        if let Ok(Some(life)) = read_life(file.path()) {
            let _ = life.redone(&Life::still(frames), stretch, fps);
        }
    }
    if let Ok(Some(was)) = read_weights(file.path()) {
        redo_as_still(&Motion::Weights(was), stretch);
    }
}

fn redo_of_numbers(kind: u8, bytes: &[u8], stretch: &Stretch) {
    let Some((fps, values)) = bytes.split_at_checked(8) else {
        return;
    };
    let fps = f64::from_le_bytes(fps.try_into().unwrap());
    let values: Vec<f32> = values
        .chunks_exact(4)
        .map(|value| f32::from_le_bytes(value.try_into().unwrap()))
        .collect();
    let was = match kind / 4 % 2 {
        0 => {
            let frames = values.len();
            let values = values.into_iter().flat_map(|value| [value; 204]);
            let shape = (frames, 68, 3);
            let displacements = ndarray::Array3::from_shape_vec(shape, values.collect()).unwrap();
            Motion::Landmarks(LandmarkClip { displacements, fps })
        }
        _ => Motion::Weights(WeightClip {
            names: vec!["jawOpen".to_owned()],
            together: values.clone(),
            weights: ndarray::Array2::from_shape_vec((values.len(), 1), values).unwrap(),
            fps,
        }),
    };
    redo_as_still(&was, stretch);
}

/// Replaces a stretch of a motion with one at rest, and checks the result.
fn redo_as_still(was: &Motion, stretch: &Stretch) {
    let still = ndarray::ArrayD::zeros(was.values().raw_dim());
    let again = match was {
        Motion::Landmarks(clip) => Motion::Landmarks(LandmarkClip {
            displacements: still.into_dimensionality().unwrap(),
            fps: clip.fps,
        }),
        Motion::Weights(clip) => Motion::Weights(WeightClip {
            weights: still.into_dimensionality().unwrap(),
            ..clip.clone()
        }),
        _ => return,
    };
    let Ok(again_made) = was.redone(&again, stretch) else {
        return;
    };
    assert_eq!(again_made.values().shape(), was.values().shape());
    let rows = stretch.frames(was.frames(), was.fps()).unwrap();
    for (t, (again_made, was)) in again_made
        .values()
        .outer_iter()
        .zip(was.values().outer_iter())
        .enumerate()
    {
        let same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits();
        assert!(rows.contains(&t) || again_made.iter().zip(&was).all(same));
        let finite = |x: &f32| x.is_finite();
        assert!(!was.iter().all(finite) || again_made.iter().all(finite));
    }
    let _ = again_made.frames_of(rows);
}

/// Options and files of the parametric head: each is either refused or gives a valid mesh.
///
/// The first byte chooses between coefficients from a file, numbers (seeds, a mixture, a slider)
/// and a scan. The second chooses the resolution.
pub fn heads(bytes: &[u8]) {
    static HEADS: OnceLock<HeadMaker> = OnceLock::new();
    const RESOLUTIONS: [usize; 12] = [
        32,
        24,
        0,
        31,
        40,
        33,
        23,
        1 << 20,
        1 << 40,
        usize::MAX,
        1,
        4097,
    ];
    let [kind, resolution, rest @ ..] = bytes else {
        return;
    };
    let maker = HEADS.get_or_init(|| HeadMaker::open(None).unwrap());
    let cells = RESOLUTIONS[usize::from(*resolution) % RESOLUTIONS.len()];
    let numbers = match kind % 3 {
        0 => {
            let read = serde_json::from_slice::<Vec<f32>>(rest);
            read.ok()
                .and_then(|numbers| maker.checked(numbers, kind / 3 % 2 == 1).ok())
        }
        1 => head_of_numbers(maker, rest),
        _ => head_like(maker, kind / 3, rest),
    };
    let Some(numbers) = numbers else {
        return;
    };
    assert!(numbers.len() == maker.count() && numbers.iter().all(|x| x.is_finite()));
    let quads = maker.mesh(&numbers, resolution % 2 == 1).unwrap();
    let surface = maker.surface(&numbers, cells, SILENT).ok();
    for head in std::iter::once(quads).chain(surface) {
        head.mesh.check().unwrap();
        assert!(
            head.mesh
                .positions
                .as_flattened()
                .iter()
                .all(|x| x.is_finite())
        );
        assert!(!head.to_obj().is_empty() && !head.landmarks.to_json().is_empty());
    }
}

fn head_of_numbers(maker: &HeadMaker, bytes: &[u8]) -> Option<Vec<f32>> {
    let (numbers, name) = bytes.split_at_checked(24)?;
    let seed = |at: usize| u64::from_le_bytes(numbers[at..at + 8].try_into().unwrap());
    let real = |at: usize| f32::from_le_bytes(numbers[at..at + 4].try_into().unwrap());
    let [first, other] = [seed(0), seed(8)].map(|seed| maker.random(seed));
    let mut code = maker.mixture(&first, &other, real(16)).ok()?;
    let named = maker.direction(&String::from_utf8_lossy(name)).ok();
    let direction = named.or_else(|| name.first().map(|byte| usize::from(*byte)));
    maker.set_along(&mut code, direction?, real(20)).ok()?;
    maker.along(&code).unwrap();
    Some(code)
}

/// Fits a head to the mesh in a file, with arbitrary vertices as its landmarks.
fn head_like(maker: &HeadMaker, choice: u8, bytes: &[u8]) -> Option<Vec<f32>> {
    let (numbers, file) = bytes.split_at_checked(68)?;
    let scan = Mesh::parse(file).ok()?;
    let count = scan.positions.len();
    // Without vertices there is nothing to fit; more than this would only take longer.
    if count == 0 || count > 5_000 {
        return None;
    }
    let vertices = std::array::from_fn(|n| (usize::from(numbers[n]) * count / 256) as u32);
    let landmarks = Landmarks {
        positions: vertices.map(|vertex| scan.positions[vertex as usize]),
        vertices,
        confidence: [1.0; 68],
    };
    let options = ScanOptions {
        steps: usize::from(choice % 3),
        points: 30,
        seed: choice.into(),
    };
    let fit = maker
        .head()
        .fit_scan(&scan.positions, &landmarks, &options, SILENT)
        .ok()?;
    maker.checked(fit.coefficients, true).ok()
}
