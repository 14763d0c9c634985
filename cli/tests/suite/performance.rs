//! Whole performances through the command: speech in, files out.

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

use anyface::output::{LandmarkMotion, read_landmark_motion};
use ndarray::Array3;
use tempfile::TempDir;

use crate::{folder_with_sound, model, voice::babble};

fn anyface(folder: &TempDir, line: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_anyface"))
        .current_dir(folder.path())
        .args(line.split_whitespace())
        .output()
        .unwrap()
}

/// Runs a line that must succeed. Returns its standard output and standard error.
fn done(folder: &TempDir, line: &str) -> (String, String) {
    let output = anyface(folder, line);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let said = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{line}: {}", said.1);
    said
}

/// Runs a line that must fail with `code`, say `words` and leave no new file.
fn refused(folder: &TempDir, line: &str, code: i32, words: &str) {
    let before = count(folder.path());
    let output = anyface(folder, line);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{line}: {said}");
    assert!(said.contains(words), "{line}: {said}");
    assert_eq!(count(folder.path()), before, "{line} left a file");
}

fn count(folder: &Path) -> usize {
    fs::read_dir(folder).unwrap().count()
}

fn head() -> String {
    let folder = model("default_head");
    format!(
        "--mesh {} --landmarks {}",
        folder.join("head.obj").display(),
        folder.join("landmarks.json").display()
    )
}

fn motion(folder: &TempDir, name: &str) -> LandmarkMotion {
    read_landmark_motion(&folder.path().join(name)).unwrap()
}

fn largest(displacements: &Array3<f32>) -> f32 {
    let squared = displacements.rows().into_iter().map(|d| d.dot(&d));
    squared.fold(0.0, f32::max).sqrt()
}

#[test]
fn speech_opens_the_mouth_and_the_same_seed_gives_the_same_file() {
    let folder = folder_with_sound(&babble(1.0, 16_000), 16_000);
    done(
        &folder,
        "motion --audio a.wav --out a.npz --seed 3 --threads 1",
    );
    done(
        &folder,
        "motion --audio a.wav --out b.npz --seed 3 --threads 2",
    );
    let bytes = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(
        bytes("a.npz") == bytes("b.npz"),
        "threads changed the result"
    );
    let clip = motion(&folder, "a.npz");
    assert_eq!(clip.displacements.dim(), (30, 68, 3));
    assert_eq!((clip.fps, clip.neutral), (Some(30.0), None));
    let most = largest(&clip.displacements);
    assert!((0.002..0.05).contains(&most), "{most} m");
}

#[test]
fn the_emotion_that_is_heard_stands_in_every_report() {
    let folder = folder_with_sound(&babble(4.0, 16_000), 16_000);
    let lines = [
        "motion --audio a.wav --emotion auto --out m.npz".to_owned(),
        format!(
            "animate {} --audio a.wav --emotion auto --out a.npz",
            head()
        ),
        "motion --system emoface --audio a.wav --out e.npz".to_owned(),
    ];
    for line in lines {
        let (said, _) = done(&folder, &format!("{line} --report r.json"));
        let says = ["of what is heard", "heard as neutral"];
        assert!(
            says.iter().any(|says| said.contains(says)),
            "{line}: {said}"
        );
        let text = fs::read_to_string(folder.path().join("r.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        let heard = &report["heard_emotion"];
        let count = heard["time_s"].as_array().unwrap().len();
        assert!(count > 5, "{line}: {heard}");
        let neutral = heard["probability"]["neutral"].as_array().unwrap();
        assert_eq!(neutral.len(), count);
    }
    let (said, _) = done(
        &folder,
        "motion --audio a.wav --emotion happy:1 --out m.npz --report r.json",
    );
    assert!(!said.contains("is heard"), "{said}");
    let text = fs::read_to_string(folder.path().join("r.json")).unwrap();
    assert!(!text.contains("heard_emotion"));
}

#[test]
fn a_neutral_voice_is_what_an_emotion_differs_from() {
    let folder = folder_with_sound(&babble(4.0, 16_000), 16_000);
    let line = "motion --audio a.wav --emotion auto --out m.npz --report r.json";
    let heard = |more: &str| {
        done(&folder, &format!("{line} {more}"));
        let text = fs::read_to_string(folder.path().join("r.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        report["heard_emotion"].clone()
    };
    let (alone, beside) = (heard(""), heard("--neutral-voice a.wav"));
    assert_ne!(alone["probability"], beside["probability"]);
    assert_eq!(alone["time_s"], beside["time_s"]);
    let of = |name: &str| beside[name].as_array().unwrap().clone();
    for axis in ["valence", "arousal"] {
        let within = |x: &serde_json::Value| x.as_f64().unwrap().abs() <= 1.0;
        assert!(of(axis).len() == of("time_s").len() && of(axis).iter().all(within));
    }
    let silent = folder_with_sound(&[0.0; 16_000], 16_000);
    let silent = silent.path().join("a.wav");
    let line = "motion --audio a.wav --emotion auto --out n.npz --neutral-voice";
    let line = format!("{line} {}", silent.display());
    refused(&folder, &line, 4, "neutral voice: expected a voice");
}

#[test]
fn silence_keeps_still_and_says_so() {
    let folder = folder_with_sound(&[0.0; 16_000], 16_000);
    let (_, warning) = done(&folder, "motion --audio a.wav --out o.npz --blinks 0");
    assert!(warning.contains("the sound is silent"), "{warning}");
    let clip = motion(&folder, "o.npz");
    assert_eq!(clip.displacements.dim(), (30, 68, 3));
    let most = largest(&clip.displacements);
    assert!(most < 0.004, "silence moves a landmark by {most} m");
}

#[test]
fn silence_blinks_by_default_and_not_when_emotion_is_off() {
    let folder = folder_with_sound(&[0.0; 10 * 16_000], 16_000);
    let lids = |line: &str| {
        done(&folder, &format!("motion --audio a.wav --out o.npz {line}"));
        let displacements = motion(&folder, "o.npz").displacements;
        let upper = displacements.slice(ndarray::s![.., 36..48, ..]).to_owned();
        largest(&upper)
    };
    assert!(lids("") > 0.007);
    assert_eq!(lids("--emotion off"), 0.0);
    assert!(lids("--emotion-keys 0:neutral --blinks 0 --articulation 2") < 0.004);
}

#[test]
fn odd_but_usable_sounds_give_sane_motion() {
    let clipped: Vec<f32> = babble(0.5, 44_100)
        .iter()
        .map(|x| (x * 20.0).clamp(-1.0, 1.0))
        .collect();
    for (samples, rate_hz, frames) in [
        (vec![0.1; 320], 16_000, 1),
        (babble(0.5, 8_000), 8_000, 15),
        (clipped, 44_100, 15),
    ] {
        let folder = folder_with_sound(&samples, rate_hz);
        done(
            &folder,
            "motion --audio a.wav --out o.npz --emotion happy:0.7",
        );
        let clip = motion(&folder, "o.npz");
        assert_eq!(clip.displacements.dim(), (frames, 68, 3));
        assert!(largest(&clip.displacements) < 0.05);
    }
}

#[test]
fn damaged_weights_are_refused() {
    let folder = folder_with_sound(&babble(0.2, 16_000), 16_000);
    let models = folder.path().join("own/ats_compact");
    fs::create_dir_all(&models).unwrap();
    let weights = fs::read(model("ats_compact").join("model.planes.gz")).unwrap();
    fs::copy(
        model("ats_compact").join("config.json"),
        models.join("config.json"),
    )
    .unwrap();
    let line = "motion --audio a.wav --out o.npz --weights own";
    for length in [0, 5, weights.len() / 2, weights.len() - 1] {
        fs::write(models.join("model.planes.gz"), &weights[..length]).unwrap();
        refused(&folder, line, 7, "weights: ");
    }
    fs::write(models.join("model.planes.gz"), &weights).unwrap();
    done(&folder, line);
}

#[test]
fn a_head_talks_in_every_format() {
    let folder = folder_with_sound(&babble(0.4, 16_000), 16_000);
    let animate = format!("animate {} --audio a.wav --cache cache --fps 25", head());
    let (json, _) = done(
        &folder,
        &format!("{animate} --out o.npz --report r.json --json"),
    );
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    let written = fs::read_to_string(folder.path().join("r.json")).unwrap();
    assert_eq!(
        report,
        serde_json::from_str::<serde_json::Value>(&written).unwrap()
    );
    assert_eq!(
        (&report["frames"], &report["vertices"]),
        (&10.into(), &8510.into())
    );
    let mm = report["largest_displacement_mm"].as_f64().unwrap();
    assert!((1.0..60.0).contains(&mm), "{mm} mm");

    let file = fs::File::open(folder.path().join("o.npz")).unwrap();
    let mut npz = ndarray_npy::NpzReader::new(file).unwrap();
    let displacements: Array3<f32> = npz.by_name("displacements").unwrap();
    assert_eq!(displacements.dim(), (10, 8510, 3));
    assert!(displacements.iter().all(|x| x.is_finite()));
    let track = motion(&folder, "o.npz");
    assert!(track.neutral.is_some());
    assert_eq!(track.displacements.dim(), (10, 68, 3));

    let length = |name: &str| fs::metadata(folder.path().join(name)).unwrap().len();
    done(&folder, &format!("{animate} --out o.pc2"));
    assert_eq!(length("o.pc2"), 32 + 10 * 8510 * 12);
    done(&folder, &format!("{animate} --out o.mdd"));
    assert_eq!(length("o.mdd"), 8 + 10 * 4 + 10 * 8510 * 12);

    // The landmark motion of one run, put on the mesh again, gives the same animation.
    let mesh = model("default_head").join("head.obj");
    let deform = format!(
        "deform --mesh {} --motion o.npz --cache cache --out d.npz",
        mesh.display()
    );
    done(&folder, &deform);
    let file = fs::File::open(folder.path().join("d.npz")).unwrap();
    let mut npz = ndarray_npy::NpzReader::new(file).unwrap();
    let again: Array3<f32> = npz.by_name("displacements").unwrap();
    let difference = largest(&(&again - &displacements));
    assert!(difference < 2e-4, "{difference} m");
}

#[test]
fn a_cache_that_cannot_be_written_changes_nothing() {
    let folder = folder_with_sound(&babble(0.2, 16_000), 16_000);
    // A file where the folder should be: nobody can write into it, not even root.
    fs::write(folder.path().join("cache"), b"").unwrap();
    let animate = format!("animate {} --audio a.wav", head());
    done(&folder, &format!("{animate} --cache cache --out a.npz"));
    done(&folder, &format!("{animate} --no-cache --out b.npz"));
    let bytes = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("a.npz") == bytes("b.npz"));
}

/// A limit on the size of files acts on the writer as a full disk does.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_no_file() {
    let folder = folder_with_sound(&babble(0.2, 16_000), 16_000);
    let command = format!(
        "{} motion --audio a.wav --out o.npz",
        env!("CARGO_BIN_EXE_anyface")
    );
    let output = Command::new("sh")
        .current_dir(folder.path())
        .args(["-c", &format!("trap '' XFSZ; ulimit -f 2; exec {command}")])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(8), "{said}");
    assert!(said.contains("o.npz"), "{said}");
    assert_eq!(count(folder.path()), 1, "a partial file is left");
}

#[test]
fn landmarks_of_the_default_head_are_found_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = model("default_head").join("head.obj");
    let line = format!("landmarks --mesh {} --out l.json", mesh.display());
    let (said, _) = done(&folder, &line);
    assert!(said.contains("68 landmarks"), "{said}");
    let text = fs::read_to_string(folder.path().join("l.json")).unwrap();
    let landmarks: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(landmarks["landmarks"].as_array().unwrap().len(), 68);
    fs::create_dir_all(folder.path().join("own/landmarks")).unwrap();
    let again = format!(
        "landmarks --mesh {} --out m.json --weights own",
        mesh.display()
    );
    refused(&folder, &again, 8, "own/landmarks");
}

#[test]
fn a_performer_moves_the_mouth_as_that_person_does() {
    let folder = folder_with_sound(&babble(8.0, 16_000), 16_000);
    let said = "motion --audio a.wav --emotion off --fps 25 --noise 0 --out";
    done(&folder, &format!("{said} plain.npz"));
    done(&folder, &format!("{said} person.npz --width 2 --jaw 1.6"));
    let learn = "performer learn --audio a.wav --motion person.npz --out kim.performer";
    let (card, _) = done(&folder, &format!("{learn} --json"));
    let card: serde_json::Value = serde_json::from_str(&card).unwrap();
    assert_eq!(card["takes"][0]["name"], "person.npz");
    done(
        &folder,
        &format!("{said} kim.npz --performer kim.performer"),
    );
    done(
        &folder,
        &format!("{said} none.npz --performer kim.performer --performer-strength 0"),
    );
    let widths = |name: &str| {
        let moved = motion(&folder, name).displacements;
        let widths = &moved.slice(ndarray::s![.., 54, 0]) - &moved.slice(ndarray::s![.., 48, 0]);
        widths.std(0.0)
    };
    let (plain, person, kim) = (widths("plain.npz"), widths("person.npz"), widths("kim.npz"));
    assert!(
        person > 1.3 * plain && kim > 1.15 * plain,
        "{plain} {person} {kim}"
    );
    assert_eq!(motion(&folder, "none.npz"), motion(&folder, "plain.npz"));

    for (line, code, words) in [
        (
            "motion --audio a.wav --out o.npz --performer kim.performer --system emoface",
            3,
            "freetalk",
        ),
        (
            "motion --audio a.wav --out o.npz --performer a.wav",
            3,
            "expected a performer",
        ),
        (
            "motion --audio a.wav --out o.npz --performer gone.performer",
            8,
            "gone.performer",
        ),
        (
            "performer learn --audio a.wav --motion a.wav --out o.performer",
            3,
            "Live Link Face",
        ),
        (
            "performer learn --audio a.wav --motion plain.npz --motion kim.npz --out o.performer",
            3,
            "one for each of 1 sounds",
        ),
    ] {
        refused(&folder, line, code, words);
    }
}
