//! What every target does with its bytes, for the fuzzers and for the tests, which replay the corpus.

use std::{io::Write, path::Path};

use anyface::{
    CachePolicy, Engine, EngineOptions, MotionRequest,
    annotation::Annotation,
    audio::{LOUDEST, SoundFile, Waveform},
    conditions::EmotionCurve,
    head::{self, Head, HeadOptions},
    job::SILENT,
    mesh::{FixedLandmark, LandmarkSource, Mesh, ObjectNames},
    output::{read_landmark_motion, read_life, read_rig, read_vertex_motion, read_weights},
    systems::{Registration, SYSTEMS, built_in_models},
    text::{self, TextUnits},
};

/// OBJ, PLY and GLB: a mesh that is read passes its own check and keeps to the size of its file.
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

/// Sounds of every kind: what is read is finite, and a loss is less than the whole.
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

/// npz, pc2 and mdd: the first byte chooses the reader; what is read is finite.
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

/// Landmarks, events and times of sounds as text: the first byte chooses the reader.
pub fn text(bytes: &[u8]) {
    let Some((choice, bytes)) = bytes.split_first() else {
        return;
    };
    let endings = ["json", "TextGrid", "tsv", "pgo", "dat", "txt"];
    let ending = endings[usize::from(*choice) % endings.len()];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("a.{ending}"));
    std::fs::write(&path, bytes).unwrap();
    if let Ok(found) = Annotation::read(&path, 24.0) {
        let out = folder.path().join("b.TextGrid");
        let _ = found.write(&out, 24.0);
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

/// A folder with one damaged model: an engine of it is refused, or what it performs is finite.
///
/// The first byte chooses the model, the second whether its config or its weights are damaged; the others
/// are places and bytes.
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
    let own = folder.path().join(model.name);
    std::fs::create_dir(&own).unwrap();
    std::fs::write(own.join("model.safetensors"), weights).unwrap();
    std::fs::write(own.join("config.json"), config).unwrap();
    // Of a model that all share, any system's.
    let owns = |system: &&&Registration| system.models.iter().any(|own| own.name == model.name);
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
    if let Ok(made) = engine.perform(&Waveform { samples }, &request, SILENT) {
        assert!(made.motion.values().iter().all(|x| x.is_finite()));
    }
}

/// What an engine does not read for motion: texts and heads.
fn beside_the_engine(model: &str, folder: &Path) {
    if model == text::MODEL.name
        && let Ok(words) = TextUnits::open(Some(folder))
    {
        let told = words.understand("a wide smile, the left eye shut");
        for unit in told.unwrap_or_default().units {
            assert!(unit.2.is_finite() && unit.3.is_finite());
        }
    }
    if model == head::MODEL.name
        && let Ok(head) = Head::open(Some(folder))
        && let Ok(one) = head.one(vec![0.1; head.config().identity_code()])
    {
        let options = HeadOptions {
            resolution: 24,
            parts: false,
        };
        if let Ok(made) = one.mesh(&options, SILENT) {
            let numbers = made.mesh.positions.as_flattened().iter();
            assert!(numbers.copied().all(f32::is_finite));
        }
    }
}
