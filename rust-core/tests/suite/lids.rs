//! Tests blinks under several emotions: eyes shut completely, and no eyeball comes through a lid.

use anyface::{
    Face,
    audio::{Prosody, Waveform},
    conditions::EmotionCurve,
    face::{FaceOptions, Lids},
    job::SILENT,
    mesh::{LandmarkSource, Mesh, PartChoices, PartRole},
    motion::{
        Cues, EmotionOrigin, Expressions, FaceModes, LandmarkClip, Motion, PerformanceControls,
        WeightClip,
    },
    rig::ARKIT,
    spread::Collector,
};
use ndarray::{Array2, Array3, ArrayView2, Axis};

use crate::{
    eyeballs_in_sight::{EyeballsInSight, eyeballs_in_sight},
    head::{self, closing},
};

const FPS: f64 = 30.0;
const FRAMES: usize = 120;
/// Shut eyes show less than this share of the eyeballs' visible area at rest.
const SHUT: f64 = 0.05;
/// Less than this share of that area may show through the lids.
const THROUGH_LIDS: f64 = 0.005;

/// A silent face that shows an emotion and blinks often.
fn blinking(emotion: &str) -> LandmarkClip {
    let affect = EmotionCurve::parse(emotion).unwrap().sample(FRAMES, FPS);
    let expressions = Expressions::open(None).unwrap();
    let prosody = Prosody::of(&Waveform {
        samples: vec![0.0; 64_000],
    });
    let cues = Cues {
        affect: affect.view(),
        blink_affect: affect.view(),
        expressions: &expressions,
        emotion_origin: EmotionOrigin::Added,
        speech_only: false,
        prosody: &prosody,
        seed: 3,
    };
    let still = LandmarkClip {
        displacements: Array3::zeros((FRAMES, 68, 3)),
        fps: FPS,
    };
    let controls = PerformanceControls {
        blinks_per_minute: 60.0,
        ..PerformanceControls::default()
    };
    let modes = FaceModes::open(None).unwrap();
    modes.apply_controls(&still, &cues, &controls).unwrap()
}

/// The share by which both eyes should close: that of the eye that closes less.
fn requested_closure(frame: ArrayView2<'_, f32>) -> f32 {
    let modes = FaceModes::open(None).unwrap();
    let way = |pairs: &[(usize, usize)], moved: ArrayView2<'_, f32>| -> f32 {
        pairs
            .iter()
            .map(|&(u, l)| moved[[l, 1]] - moved[[u, 1]])
            .sum()
    };
    let [right, left] = [
        ("eyeBlink_R", &head::LIDS[..2]),
        ("eyeBlink_L", &head::LIDS[2..]),
    ]
    .map(|(mode, pairs)| way(pairs, frame) / way(pairs, modes.mode(mode).unwrap()));
    right.min(left)
}

/// Skin and eyeballs of a head.
struct Eyes {
    skin: Vec<[u32; 3]>,
    eyeballs: Vec<[u32; 3]>,
    cell: f32,
}

impl Eyes {
    fn of(face: &Face) -> Eyes {
        let of = |role| {
            let all = face.mesh.triangles.iter().copied();
            all.filter(|t| face.parts.is(t[0] as usize, role)).collect()
        };
        Eyes {
            skin: of(PartRole::Skin),
            eyeballs: of(PartRole::Gaze),
            cell: (2e-4 / face.metres_per_unit()) as f32,
        }
    }

    fn sight(&self, positions: &[[f32; 3]]) -> EyeballsInSight {
        eyeballs_in_sight(positions, &self.skin, &self.eyeballs, self.cell)
    }
}

/// The visible area of the eyeballs in each frame, and that at rest. +z points out of the face.
fn sights(face: &Face, motion: &Motion) -> (Vec<EyeballsInSight>, f64) {
    let engine = head::engine();
    let clip = Collector::collect(|sink| engine.spread(face, motion, sink, SILENT)).unwrap();
    let eyes = Eyes::of(face);
    let frames = clip.vertices.displacements.axis_iter(Axis(0)).map(|frame| {
        let moved = face.mesh.positions.iter().zip(frame.rows());
        let posed: Vec<[f32; 3]> = moved
            .map(|(p, d)| std::array::from_fn(|i| p[i] + d[i]))
            .collect();
        eyes.sight(&posed)
    });
    (frames.collect(), eyes.sight(&face.mesh.positions).area)
}

/// Checks that blinks under every emotion shut the eyes and that no frame shows an eyeball through
/// a lid.
fn check_blinks(face: &Face) {
    for emotion in ["neutral:0", "surprised:1", "afraid:1", "happy:1"] {
        let clip = blinking(emotion);
        let (frames, rest) = sights(face, &Motion::Landmarks(clip.clone()));
        assert!(rest > 0.0, "eyes that are open at rest");
        let mut shut = 0;
        for (t, sight) in frames.iter().enumerate() {
            let share = sight.area / rest;
            if requested_closure(clip.displacements.index_axis(Axis(0), t)) > 0.999 {
                shut += 1;
                assert!(share < SHUT, "{emotion}, frame {t}: {share} in sight");
            }
            let through = sight.through_lids / rest;
            assert!(
                through < THROUGH_LIDS,
                "{emotion}, frame {t}: {through} through the lids"
            );
        }
        assert!(shut >= 3, "{emotion}: {shut} frames with shut eyes");
    }
}

#[test]
fn the_default_head_shuts_its_eyes_under_every_emotion() {
    check_blinks(&head::prepared(
        &head::head(),
        &head::landmarks(),
        PartChoices::default(),
    ));
}

/// Weights add up linearly, so under squints and raised cheeks the lids of a plain blink would
/// neither shut nor stay in front of the eyeballs.
#[test]
fn blinks_of_weights_shut_under_every_expression() {
    let face = head::prepared(&head::head(), &head::landmarks(), PartChoices::default());
    for others in [
        &[][..],
        &["eyeSquint", "cheekSquint", "mouthSmile"],
        &["eyeSquint", "browDown", "noseSneer"],
        &["browOuterUp", "mouthFrown"],
    ] {
        let clip = shutting(others);
        let (frames, rest) = sights(&face, &Motion::Weights(clip));
        let share = frames[SHUTTING - 1].area / rest;
        assert!(share < SHUT, "{others:?}: {share} in sight");
        for (t, sight) in frames.iter().enumerate() {
            let through = sight.through_lids / rest;
            assert!(
                through < THROUGH_LIDS,
                "{others:?}, frame {t}: {through} through the lids"
            );
        }
    }
}

const SHUTTING: usize = 8;

/// A blink from open to shut with the shapes `others` of both sides at weight 1. The blink closes
/// the lids of the mean face by the part that `others` leave open.
fn shutting(others: &[&str]) -> WeightClip {
    let names: Vec<String> = ARKIT[..51].iter().map(|name| name.to_string()).collect();
    let mut clip = WeightClip {
        weights: Array2::zeros((SHUTTING, names.len())),
        names,
        fps: FPS,
        together: Vec::new(),
    };
    for other in others
        .iter()
        .flat_map(|name| [format!("{name}Left"), format!("{name}Right")])
    {
        let column = clip.column(&other).unwrap();
        clip.weights.column_mut(column).fill(1.0);
    }
    let modes = FaceModes::open(None).unwrap();
    let frame = clip.landmarks(&modes).unwrap().displacements;
    let lacking = 1.0 - requested_closure(frame.index_axis(Axis(0), 0));
    for name in ["eyeBlinkLeft", "eyeBlinkRight"] {
        let column = clip.column(name).unwrap();
        for t in 0..SHUTTING {
            clip.weights[[t, column]] = lacking * t as f32 / (SHUTTING - 1) as f32;
        }
    }
    clip
}

/// The default head with eyes opened 0.6 times and 1.5 times as far. Lids travel as far as the
/// head's own eyes are open.
#[test]
fn eyes_that_are_open_less_or_more_shut_as_well() {
    let marks = head::landmarks();
    let face = head::prepared(&head::head(), &marks, PartChoices::default());
    for opened in [-0.4f32, 0.5] {
        let way: Vec<[f32; 3]> = closing(&marks, &head::LIDS, 0.0)
            .iter()
            .map(|d| d.map(|x| -opened * x))
            .collect();
        let moved = head::moved(&face, &way);
        let mut mesh = head::head();
        for (p, d) in mesh.positions.iter_mut().zip(&moved) {
            *p = head::sum(*p, *d);
        }
        let marks: head::Points = face
            .landmarks
            .vertices
            .iter()
            .map(|&v| mesh.positions[v as usize])
            .collect();
        let other = head::prepared(&mesh, &marks, PartChoices::default());
        let (at_rest, before) = (Eyes::of(&other), Eyes::of(&face));
        let open = at_rest.sight(&mesh.positions).area / before.sight(&face.mesh.positions).area;
        assert!((open - 1.0 - f64::from(opened)).abs() < 0.3, "{open}");
        check_blinks(&other);
    }
}

/// The default head after its own blink of both eyes, of one or of none, and its landmarks then.
fn asleep(pairs: &[(usize, usize)]) -> (Mesh, head::Points) {
    let marks = head::landmarks();
    let face = head::prepared(&head::head(), &marks, PartChoices::default());
    let moved = head::moved(&face, &closing(&marks, pairs, 0.0));
    let mut mesh = head::head();
    for (p, d) in mesh.positions.iter_mut().zip(&moved) {
        *p = head::sum(*p, *d);
    }
    let vertices = face.landmarks.vertices.iter();
    let marks = vertices.map(|&v| mesh.positions[v as usize]).collect();
    (mesh, marks)
}

#[test]
fn eyes_that_are_sculpted_shut_are_noticed_one_by_one() {
    for (pairs, lids) in [
        (&head::LIDS[..0], [Lids::Close, Lids::Close]),
        (&head::LIDS[..2], [Lids::Shut, Lids::Close]),
        (&head::LIDS[2..], [Lids::Close, Lids::Shut]),
        (&head::LIDS[..], [Lids::Shut, Lids::Shut]),
    ] {
        let (mesh, marks) = asleep(pairs);
        let face = head::prepared(&mesh, &marks, PartChoices::default());
        assert_eq!(face.lids(), lids);
    }
}

/// Half a blink closes half of the opening.
#[test]
fn lids_close_by_the_share_that_is_asked_for() {
    let face = head::prepared(&head::head(), &head::landmarks(), PartChoices::default());
    let modes = FaceModes::open(None).unwrap();
    let shares = [0.35f32, 0.5, 0.75];
    let displacements = Array3::from_shape_fn((shares.len(), 68, 3), |(t, n, i)| {
        let both = ["eyeBlink_L", "eyeBlink_R"].map(|name| modes.mode(name).unwrap()[[n, i]]);
        if (36..48).contains(&n) {
            shares[t] * (both[0] + both[1])
        } else {
            0.0
        }
    });
    let (frames, rest) = sights(
        &face,
        &Motion::Landmarks(LandmarkClip {
            displacements,
            fps: FPS,
        }),
    );
    for (sight, share) in frames.iter().zip(shares) {
        let open = sight.area / rest;
        let expected = 1.0 - f64::from(share);
        assert!((open - expected).abs() < 0.12, "{share}: {open} open");
    }
}

/// ICT FaceKit's neutral head, centimetres, with its landmarks.
fn ict() -> (Mesh, LandmarkSource) {
    let shared = std::env::var_os("ANYFACE_SHARED").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"),
        std::path::PathBuf::from,
    );
    let bytes = std::fs::read(shared.join("data/faces/ict_facekit.safetensors")).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let words = |name: &str| -> Vec<[u8; 4]> {
        let tensor = file.tensor(name).unwrap();
        tensor
            .data()
            .chunks_exact(4)
            .map(|b| b.try_into().unwrap())
            .collect()
    };
    let three = |values: Vec<f32>| values.chunks(3).map(|p| [p[0], p[1], p[2]]).collect();
    let numbers = |name: &str| words(name).into_iter().map(u32::from_le_bytes);
    let corners: Vec<u32> = numbers("triangles").collect();
    let mesh = Mesh {
        positions: three(
            words("neutral")
                .into_iter()
                .map(f32::from_le_bytes)
                .collect(),
        ),
        triangles: corners.chunks(3).map(|t| [t[0], t[1], t[2]]).collect(),
    };
    (
        mesh,
        LandmarkSource::Vertices(numbers("landmarks68").collect()),
    )
}

#[test]
#[ignore = "needs ../shared"]
fn the_face_model_shuts_its_eyes_under_every_emotion() {
    let (mesh, landmarks) = ict();
    let options = FaceOptions {
        landmarks: Some(landmarks),
        ..FaceOptions::default()
    };
    check_blinks(&head::engine().prepare(&mesh, &options, SILENT).unwrap());
}
