//! What the fuzz target `options` does with its bytes. The fuzzer calls it, and so do the command's
//! tests.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::{Mutex, OnceLock},
};

use anyface::systems::built_in_models;

/// Runs any subcommand with any options: it either succeeds, or fails with a message and leaves no
/// file behind.
pub fn options(bytes: &[u8]) {
    // All runs write their results to the same folder.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _alone = ONE_AT_A_TIME.lock();
    let folder = folder();
    let out = folder.join("out");
    let _ = fs::remove_dir_all(&out);
    fs::create_dir(&out).unwrap();
    let before = sizes(&folder.join("in"));
    if let Some(message) = anyface_cli::any_words::run(bytes, folder) {
        assert!(!message.trim().is_empty());
        let left: Vec<_> = sizes(&out);
        assert!(left.is_empty(), "{message} left {left:?}");
    }
    assert!(
        before == sizes(&folder.join("in")),
        "a file that is read was changed"
    );
}

/// The paths and sizes of the files in a folder and its subfolders.
fn sizes(folder: &Path) -> Vec<(PathBuf, u64)> {
    let mut entries = Vec::new();
    for entry in fs::read_dir(folder).unwrap().flatten() {
        match entry.metadata().unwrap() {
            kind if kind.is_dir() => entries.extend(sizes(&entry.path())),
            kind => entries.push((entry.path(), kind.len())),
        }
    }
    entries.sort();
    entries
}

/// A folder, made once, with a small file for every option that reads one and with models that
/// cannot be loaded.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    FOLDER.get_or_init(make_folder).path()
}

fn make_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let inputs = folder.path().join("in");
    fs::create_dir(&inputs).unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(inputs.join(name), bytes).unwrap();
    let mesh = b"o face\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n";
    write("mesh.obj", mesh);
    write("like.obj", mesh);
    write("audio.wav", &wav());
    write("emotion.wav", &wav());
    write("landmarks.json", br#"{"landmarks": []}"#);
    write("fix.json", br#"[{"index": 30, "position": [0, 0, 0]}]"#);
    write(
        "events.json",
        br#"[{"start_s": 0.1, "end_s": 0.2, "units": ["12", "45L"]}]"#,
    );
    write("sounds.txt", b"0.1 0.2 p\n0.3 0.4 m\n");
    write("text_file.txt", "Who is it? \u{1F642}".as_bytes());
    write(
        "code.json",
        format!("[{}0.1]", "0.1,".repeat(99)).as_bytes(),
    );
    for name in [
        "animation.npz",
        "from.npz",
        "motion.npz",
        "rig.npz",
        "starts_from.npz",
    ] {
        write(
            name,
            include_bytes!("../corpus/arrays/ok.npz")
                .split_first()
                .unwrap()
                .1,
        );
    }
    for model in built_in_models() {
        let model_folder = folder.path().join("models").join(model.name);
        fs::create_dir_all(&model_folder).unwrap();
        fs::write(model_folder.join("config.json"), "{").unwrap();
        fs::write(model_folder.join("model.safetensors"), "").unwrap();
    }
    folder
}

/// A WAV file with a tenth of a second of sound at 8 kHz.
fn wav() -> Vec<u8> {
    let samples: Vec<u8> = (0..800)
        .flat_map(|i| ((i % 40) as i16 * 500).to_le_bytes())
        .collect();
    let mut bytes =
        b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0\x01\0\x01\0\x40\x1f\0\0\x80\x3e\0\0\x02\0\x10\0data"
            .to_vec();
    bytes.extend((samples.len() as u32).to_le_bytes());
    bytes.extend(&samples);
    let size = bytes.len() as u32 - 8;
    bytes[4..8].copy_from_slice(&size.to_le_bytes());
    bytes
}
