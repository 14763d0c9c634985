//! Landmarks, events and times of sounds as text: the first byte chooses the reader.
#![no_main]

use anyface::{
    annotation::Annotation,
    conditions::{EmotionCurve, Event},
    mesh::{FixedLandmark, LandmarkSource},
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
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
        let _ = (LandmarkSource::read(&path), FixedLandmark::read(&path), Event::read(&path));
    }
    let _ = EmotionCurve::parse_keys(&String::from_utf8_lossy(bytes));
});
