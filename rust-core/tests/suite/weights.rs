//! Models of the user's own. Those of a folder are opened by their configs. A refusal says what was
//! expected and what was found.

use std::{fs, path::Path};

use anyface::{
    CachePolicy, Engine, EngineOptions, MotionRequest, audio::Waveform, job::SILENT, motion::Motion,
};

/// A copy of a built-in model of FreeTalk in `folder`, under `name`.
fn copy(folder: &Path, built_in: &str, name: &str) {
    fs::create_dir_all(folder.join(name)).unwrap();
    for file in ["config.json", "model.planes.gz"] {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/freetalk");
        fs::copy(
            models.join(built_in).join(file),
            folder.join(name).join(file),
        )
        .unwrap();
    }
}

fn change_config(folder: &Path, change: impl Fn(&mut serde_json::Value)) {
    let path = folder.join("config.json");
    let mut config = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    change(&mut config);
    fs::write(path, config.to_string()).unwrap();
}

fn open(folder: &Path) -> anyface::Result<Engine> {
    Engine::new(EngineOptions {
        models: Some(folder.to_owned()),
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    })
}

fn complaint(folder: &Path) -> String {
    open(folder).err().expect("a refusal").to_string()
}

#[test]
fn a_model_of_any_size_is_opened_by_what_its_config_says() {
    let folder = tempfile::tempdir().unwrap();
    copy(folder.path(), "ats_compact", "ats_mine");
    change_config(&folder.path().join("ats_mine"), |config| {
        config["default_style"] = "grid_s1".into();
    });
    let waveform = Waveform {
        samples: (0..12_000).map(|i| (i as f32 * 0.05).sin()).collect(),
    };
    let performed = |engine: Engine, style: Option<&str>| {
        let request = MotionRequest {
            style: style.map(str::to_owned),
            ..MotionRequest::default()
        };
        match engine.perform(&waveform, &request, SILENT).unwrap().motion {
            Motion::Landmarks(clip) => clip.displacements,
            _ => panic!("FreeTalk moves landmarks"),
        }
    };
    let built_in = || Engine::new(EngineOptions::default()).unwrap();
    let custom = performed(open(folder.path()).unwrap(), None);
    assert_eq!(custom, performed(built_in(), Some("grid_s1")));
    assert_ne!(custom, performed(built_in(), None));
}

#[test]
fn two_sizes_of_one_model_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    copy(folder.path(), "ats_compact", "ats_compact");
    copy(folder.path(), "ats_compact", "ats_paper");
    let said = complaint(folder.path());
    assert!(
        said.contains("expected one size of ats, got ats_compact, ats_paper"),
        "{said}"
    );
}

#[test]
fn a_model_that_nobody_reads_is_not_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let said = complaint(folder.path());
    assert!(
        said.contains("expected folders of models (whisper_trunk,"),
        "{said}"
    );
    assert!(said.ends_with("got none"), "{said}");
    copy(folder.path(), "ats_compact", "ats_compact");
    fs::create_dir(folder.path().join("runs")).unwrap();
    open(folder.path()).unwrap();
    copy(folder.path(), "ats_compact", "atscompact");
    assert!(complaint(folder.path()).ends_with("got atscompact"));
}

#[test]
fn the_speech_encoder_of_the_training_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    copy(folder.path(), "ats_compact", "ats_paper");
    let ats = folder.path().join("ats_paper");
    change_config(&ats, |config| config["speech"]["encoder"] = "hubert".into());
    let said = complaint(folder.path());
    assert!(
        said.contains("trained with features of hubert: expected its Hugging Face checkpoint"),
        "{said}"
    );
    fs::create_dir(folder.path().join("hubert")).unwrap();
    let said = complaint(folder.path());
    assert!(said.contains("hubert/config.json"), "{said}");
    change_config(&ats, |config| config["speech"]["encoder"] = "ear".into());
    change_config(&ats, |config| config["speech"]["channels"] = 768.into());
    let said = complaint(folder.path());
    assert!(said.contains("768") && said.contains("192"), "{said}");
}
