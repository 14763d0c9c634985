//! Finds landmarks on the default head, however it is turned, and refuses meshes without a face.

use std::{
    path::PathBuf,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};

use anyface::{
    Error,
    face::{FaceOptions, locate_landmarks, locate_landmarks_with},
    job::Progress,
    mesh::{
        Axis, FixedLandmark, LandmarkFinder, LandmarkPlace, LandmarkSource, Landmarks, Mesh, Mouth,
        align_to_canonical,
    },
};

fn default_head() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head")
}

fn head() -> Mesh {
    Mesh::read(default_head().join("head.obj")).unwrap()
}

fn truth() -> Vec<[f32; 3]> {
    match LandmarkSource::read(&default_head().join("landmarks.json")).unwrap() {
        LandmarkSource::Known(known) => known.iter().map(|landmark| landmark.position).collect(),
        other => panic!("expected positions with their vertices, got {other:?}"),
    }
}

fn moved(mesh: &Mesh, by: impl Fn([f32; 3]) -> [f32; 3]) -> Mesh {
    Mesh {
        positions: mesh.positions.iter().map(|p| by(*p)).collect(),
        ..mesh.clone()
    }
}

fn find(mesh: &Mesh, forward: Axis, up: Axis) -> Result<Landmarks, Error> {
    let options = FaceOptions {
        forward,
        up,
        ..FaceOptions::default()
    };
    locate_landmarks(mesh, &options)
}

/// Median distance in metres. `scale`: how many units of the mesh are a metre.
fn median_miss_m(located: &Landmarks, truth: &[[f32; 3]], scale: f32) -> f32 {
    let mut miss: Vec<f32> = located
        .positions
        .iter()
        .zip(truth)
        .map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt() / scale)
        .collect();
    miss.sort_by(f32::total_cmp);
    miss[34]
}

#[test]
fn landmarks_of_the_default_head_are_found_within_two_millimetres() {
    let located = find(&head(), Axis::PosZ, Axis::PosY).unwrap();
    let miss = median_miss_m(&located, &truth(), 1.0);
    assert!(miss < 0.002, "median {miss} m");
    assert!(located.confidence.iter().all(|c| (0.0..=1.0).contains(c)));
    // Landmarks lie on the surface, and the two lips have different vertices.
    let mesh = head();
    for (p, v) in located.positions.iter().zip(located.vertices) {
        let q = mesh.positions[v as usize];
        let d2: f32 = (0..3).map(|i| (p[i] - q[i]).powi(2)).sum();
        assert!(d2.sqrt() < 0.02);
    }
    let upper = located.vertices[61..64].iter();
    assert!(upper.clone().all(|v| !located.vertices[65..68].contains(v)));
}

#[test]
fn units_place_and_stated_axes_do_not_matter() {
    // Facing −y with +z up, in inches, far from the origin.
    let blender = |p: [f32; 3]| [39.4 * p[0] - 120.0, -39.4 * p[2] + 7.0, 39.4 * p[1] + 65.0];
    let located = find(&moved(&head(), blender), Axis::NegY, Axis::PosZ).unwrap();
    let expected: Vec<_> = truth().into_iter().map(blender).collect();
    let miss = median_miss_m(&located, &expected, 39.4);
    assert!(miss < 0.002, "median {miss} m");
    let to_canonical = align_to_canonical(&located).unwrap();
    assert!((to_canonical.scale * 39.4 - 1.0).abs() < 0.08);
    // The canonical z axis is the mesh's −y.
    assert!(to_canonical.rotation[2][1] < -0.98);
}

#[test]
fn a_head_turned_by_fifteen_degrees_is_found() {
    let (s, c) = 15f32.to_radians().sin_cos();
    let turn = |p: [f32; 3]| [c * p[0] + s * p[2], p[1], c * p[2] - s * p[0]];
    let located = find(&moved(&head(), turn), Axis::PosZ, Axis::PosY).unwrap();
    let expected: Vec<_> = truth().into_iter().map(turn).collect();
    assert!(median_miss_m(&located, &expected, 1.0) < 0.0025);
}

#[test]
fn a_head_with_its_winding_reversed_is_found() {
    let mut mesh = head();
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let located = find(&mesh, Axis::PosZ, Axis::PosY).unwrap();
    assert!(median_miss_m(&located, &truth(), 1.0) < 0.002);
}

#[test]
fn a_head_turned_any_way_is_found_whatever_axes_are_stated() {
    // Rotation matrices, row by row.
    for turn in [
        [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]],
    ] {
        let by = |p: [f32; 3]| turn.map(|row: [f32; 3]| (0..3).map(|k| row[k] * p[k]).sum());
        let located = find(&moved(&head(), by), Axis::NegX, Axis::PosZ).unwrap();
        let expected: Vec<_> = truth().into_iter().map(by).collect();
        let miss = median_miss_m(&located, &expected, 1.0);
        assert!(miss < 0.0025, "median {miss} m after {turn:?}");
    }
}

#[test]
fn fixed_landmarks_stay_and_the_others_follow() {
    let free = find(&head(), Axis::PosZ, Axis::PosY).unwrap();
    // Fixes the corners of the mouth half a centimetre further down on the skin.
    let lower = |i: usize| {
        let [x, y, z] = free.positions[i];
        FixedLandmark {
            index: i,
            place: LandmarkPlace::Position([x, y - 0.005, z]),
        }
    };
    let options = FaceOptions {
        fixed: vec![lower(48), lower(54)],
        ..FaceOptions::default()
    };
    let located = locate_landmarks(&head(), &options).unwrap();
    assert_eq!([48, 54].map(|i| located.confidence[i]), [1.0, 1.0]);
    let down = |i: usize| free.positions[i][1] - located.positions[i][1];
    assert!([48, 54].iter().all(|i| (down(*i) - 0.005).abs() < 0.0015));
    assert!(
        down(60) > 0.001 && down(64) > 0.001,
        "{} {}",
        down(60),
        down(64)
    );
    assert!(down(39).abs() < 0.001, "{}", down(39));
}

#[test]
fn four_fixed_landmarks_say_where_a_face_is_that_nobody_would_see() {
    let mesh = sphere();
    let at = |x: f32, y: f32| [x, y, (1.0 - x * x - y * y).sqrt()];
    let places = [
        (36, at(-0.4, 0.2)),
        (45, at(0.4, 0.2)),
        (30, at(0.0, -0.1)),
        (48, at(-0.22, -0.4)),
        (54, at(0.22, -0.4)),
    ];
    let fixed = places.map(|(index, place)| FixedLandmark {
        index,
        place: LandmarkPlace::Position(place),
    });
    let options = FaceOptions {
        fixed: fixed.to_vec(),
        ..FaceOptions::default()
    };
    let located = locate_landmarks(&mesh, &options).unwrap();
    let off = |i: usize, place: [f32; 3]| {
        let p = located.positions[i];
        (0..3)
            .map(|k| (p[k] - place[k]).powi(2))
            .sum::<f32>()
            .sqrt()
    };
    assert!(places.iter().all(|(i, place)| off(*i, *place) < 0.02));
    assert!(located.positions[8][1] < -0.5 && located.positions[8][2] > 0.0);
}

#[test]
fn shapes_without_a_face_are_refused_with_a_reason_and_help() {
    let cube = Mesh {
        positions: (0..8u8)
            .map(|i| [0, 1, 2].map(|k| f32::from((i >> k) & 1)))
            .collect(),
        triangles: vec![
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ],
    };
    for mesh in [cube, sphere(), wavy(), hand()] {
        let error = find(&mesh, Axis::PosZ, Axis::PosY).unwrap_err();
        assert!(matches!(error, Error::FaceNotFound(_)), "{error}");
        let text = error.to_string();
        let reasons = ["likeness", "confidence", "12 triangles"];
        assert!(reasons.iter().any(|reason| text.contains(reason)), "{text}");
        assert!(text.contains("or give all 68"), "{text}");
    }
}

/// A ball with bumps.
fn wavy() -> Mesh {
    moved(&sphere(), |[x, y, z]| {
        let out = 1.0 + 0.15 * (5.0 * x + 1.0).sin() * (4.0 * y).cos() + 0.1 * (7.0 * z).sin();
        [x * out, 1.3 * y * out, z * out]
    })
}

#[test]
fn a_search_says_how_far_it_is_and_stops_when_it_is_not_wanted() {
    let finder = LandmarkFinder::embedded().unwrap();
    let (mesh, options) = (wavy(), FaceOptions::default());
    let (calls, farthest) = (AtomicUsize::new(0), Mutex::new(0.0f32));
    let watch = |at: Progress| {
        assert_eq!(at.stage, "landmarks");
        let mut farthest = farthest.lock().unwrap();
        *farthest = farthest.max(at.fraction);
        calls.fetch_add(1, Ordering::Relaxed);
        true
    };
    let error = locate_landmarks_with(finder, &mesh, &options, &watch).unwrap_err();
    assert!(matches!(error, Error::FaceNotFound(_)), "{error}");
    let (all, farthest) = (calls.into_inner(), farthest.into_inner().unwrap());
    assert!(
        all > 100 && (0.05..1.0).contains(&farthest),
        "{all} {farthest}"
    );
    for after in [0, 20, all / 2] {
        let calls = AtomicUsize::new(0);
        let watch = |_: Progress| calls.fetch_add(1, Ordering::Relaxed) < after;
        let error = locate_landmarks_with(finder, &mesh, &options, &watch).unwrap_err();
        assert!(matches!(error, Error::Cancelled), "{error}");
    }
}

#[test]
fn the_back_of_a_head_is_not_taken_for_a_face() {
    let mut back = head();
    let eyes = truth()[36][2];
    let positions = &back.positions;
    let behind = |t: &[u32; 3]| t.iter().all(|&v| positions[v as usize][2] < eyes - 0.03);
    back.triangles.retain(behind);
    for (forward, up) in [(Axis::PosZ, Axis::PosY), (Axis::NegZ, Axis::PosY)] {
        let error = find(&back, forward, up).unwrap_err();
        assert!(matches!(error, Error::FaceNotFound(_)), "{error}");
    }
}

/// An open hand: a palm, a wrist and five fingers, each an ellipsoid.
fn hand() -> Mesh {
    let mut mesh = Mesh::default();
    let mut limb = |centre: [f32; 3], radii: [f32; 3], lean: f32| {
        let first = mesh.positions.len() as u32;
        let (s, c) = lean.sin_cos();
        mesh.positions.extend(sphere().positions.iter().map(|p| {
            let [x, y, z] = [0, 1, 2].map(|k| p[k] * radii[k]);
            [
                centre[0] + c * x + s * y,
                centre[1] + c * y - s * x,
                centre[2] + z,
            ]
        }));
        let triangles = sphere().triangles;
        mesh.triangles
            .extend(triangles.iter().map(|t| t.map(|v| v + first)));
    };
    limb([0.0, 0.0, 0.0], [0.9, 1.0, 0.35], 0.0);
    limb([0.0, -1.6, 0.0], [0.55, 1.2, 0.4], 0.0);
    for (x, length, lean) in [(-0.75, 0.7, -0.25), (-0.28, 0.9, -0.08), (0.22, 0.95, 0.05)] {
        limb([x, 0.9 + length, 0.0], [0.18, length, 0.18], lean);
    }
    limb([0.75, 1.55, 0.0], [0.17, 0.75, 0.17], 0.2);
    limb([1.2, 0.1, 0.2], [0.2, 0.7, 0.2], 0.9);
    mesh
}

fn sphere() -> Mesh {
    let (rings, around) = (24u32, 48u32);
    let mut mesh = Mesh::default();
    for ring in 0..=rings {
        let theta = ring as f32 / rings as f32 * std::f32::consts::PI;
        for step in 0..around {
            let phi = step as f32 / around as f32 * std::f32::consts::TAU;
            mesh.positions.push([
                theta.sin() * phi.cos(),
                theta.cos(),
                theta.sin() * phi.sin(),
            ]);
        }
    }
    for ring in 0..rings {
        for step in 0..around {
            let (a, b) = (ring * around + step, ring * around + (step + 1) % around);
            mesh.triangles
                .extend([[a, b, a + around], [b, b + around, a + around]]);
        }
    }
    mesh
}

#[test]
fn broken_meshes_are_errors_and_nothing_panics() {
    assert!(find(&Mesh::default(), Axis::PosZ, Axis::PosY).is_err());
    let mut three = head();
    three.triangles.truncate(3);
    let error = find(&three, Axis::PosZ, Axis::PosY).unwrap_err();
    assert!(error.to_string().contains("got 3"), "{error}");
    let mut broken = head();
    broken.positions[10][1] = f32::NAN;
    assert!(find(&broken, Axis::PosZ, Axis::PosY).is_err());
    let flat = moved(&head(), |_| [1.0, 2.0, 3.0]);
    assert!(find(&flat, Axis::PosZ, Axis::PosY).is_err());
    assert!(matches!(
        find(&head(), Axis::PosZ, Axis::NegZ),
        Err(Error::InvalidInput(_))
    ));
}

#[test]
fn hand_marked_landmarks_win_over_the_finder_and_mirrored_ones_are_refused() {
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Positions(truth())),
        forward: Axis::NegX,
        ..FaceOptions::default()
    };
    let marked = locate_landmarks(&head(), &options).unwrap();
    assert!(median_miss_m(&marked, &truth(), 1.0) < 1e-5);
    let mirror = |p: [f32; 3]| [-p[0], p[1], p[2]];
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Positions(
            truth().into_iter().map(mirror).collect(),
        )),
        ..FaceOptions::default()
    };
    let mirrored = locate_landmarks(&moved(&head(), mirror), &options).unwrap();
    let error = align_to_canonical(&mirrored).unwrap_err();
    assert!(error.to_string().contains("mirrored"), "{error}");
}

/// A scan, a whole body and a coarse mask from other sources. None was in the training data in this
/// form.
#[test]
#[ignore = "needs ../shared"]
fn heads_of_others_are_found() {
    let shared = std::env::var_os("ANYFACE_SHARED").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared"),
        PathBuf::from,
    );
    for name in [
        "lee_perry_smith",
        "makehuman_body",
        "mediapipe_canonical_face",
    ] {
        let mesh = Mesh::read(shared.join(format!("data/meshes/{name}.obj"))).unwrap();
        let located = find(&mesh, Axis::PosZ, Axis::PosY).unwrap();
        align_to_canonical(&located).unwrap();
        let mean = located.confidence.iter().sum::<f32>() / 68.0;
        assert!(mean > 0.7, "{name}: {mean}");
    }
}

#[test]
fn the_default_head_has_lips_that_part_and_welding_them_is_noticed() {
    let located = find(&head(), Axis::PosZ, Axis::PosY).unwrap();
    assert_eq!(Mouth::of(&head(), &located), Mouth::Slit);
    let mut welded = head();
    let bridge = [61, 62, 63, 65, 66, 67].map(|i| located.vertices[i]);
    let [a, b, c, d, e, f] = bridge;
    welded
        .triangles
        .extend([[a, b, f], [b, e, f], [b, c, e], [c, d, e]]);
    assert_eq!(Mouth::of(&welded, &located), Mouth::Welded);
}
