//! Features of a face that were not found, such as brows or one eye, stay at rest.

use anyface::{
    Face,
    face::FaceOptions,
    job::SILENT,
    mesh::{KnownLandmark, LandmarkSource},
    rig::ShapeSource,
};

use crate::head::{self, LIDS, closing, mm};

/// Confidence of a landmark that was not found.
const NOT_FOUND: f32 = 0.2;

/// The default head with some landmarks marked as not found.
fn lacking(missing: impl Fn(usize) -> bool) -> Face {
    let source = LandmarkSource::read(&head::folder().join("landmarks.json")).unwrap();
    let LandmarkSource::Known(known) = source else {
        panic!("expected positions with their vertices, got {source:?}");
    };
    let unsure = |(n, landmark): (usize, KnownLandmark)| KnownLandmark {
        confidence: if missing(n) { NOT_FOUND } else { 0.95 },
        ..landmark
    };
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Known(
            known.into_iter().enumerate().map(unsure).collect(),
        )),
        ..FaceOptions::default()
    };
    head::engine()
        .prepare(&head::head(), &options, SILENT)
        .unwrap()
}

/// The largest movement among the vertices of some landmarks, millimetres.
fn travel(face: &Face, moved: &[[f32; 3]], numbers: impl Iterator<Item = usize>) -> f32 {
    let of = |n: usize| mm(moved[face.landmarks.vertices[n] as usize], [0.0; 3]);
    numbers.map(of).fold(0.0, f32::max)
}

#[test]
fn an_eye_that_was_not_found_does_not_blink() {
    let face = lacking(|n| (42..48).contains(&n));
    let text = face.at_rest().unwrap();
    assert!(text.starts_with("not found: left eye"), "{text}");
    let moved = head::moved(&face, &closing(&head::landmarks(), &LIDS, 0.0));
    let (right, left) = (travel(&face, &moved, 37..39), travel(&face, &moved, 42..48));
    assert!(
        right > 3.0 && left < 0.3,
        "right {right:.2} mm, left {left:.2} mm"
    );
    let rig = head::engine()
        .rig(&face, ShapeSource::Network, SILENT)
        .unwrap();
    let present = |name: &str| rig.reports.iter().any(|r| r.name == name && r.present);
    assert!(present("eyeBlinkRight") && !present("eyeBlinkLeft"));
}

#[test]
fn brows_that_were_not_found_rest_and_move_no_forehead() {
    let mut frown = vec![[0.0; 3]; 68];
    frown[17..27].fill([0.0, 0.006, 0.0]);
    let whole = lacking(|_| false);
    assert_eq!(whole.at_rest(), None);
    let raised = head::moved(&whole, &frown);
    assert!(travel(&whole, &raised, 17..27) > 4.0);
    let face = lacking(|n| (17..27).contains(&n));
    let resting = head::moved(&face, &frown);
    let most = resting.iter().map(|d| mm(*d, [0.0; 3])).fold(0.0, f32::max);
    assert!(most < 1e-3, "{most} mm");
}
