//! Teeth, tongue and eyes of the default head; lips and lids that touch; mirrored heads.

use std::sync::LazyLock;

use anyface::{
    Error, Face,
    face::FaceOptions,
    job::SILENT,
    mesh::{
        LandmarkSource, Mesh, NamedMesh, ObjectNames, PartChoices, PartRole, PartSelector,
        RoleSource, SurfaceTree, ibug::MIRROR,
    },
};
use ndarray::Array3;
use proptest::prelude::*;

use super::head::{
    LIDS, LIPS, Points, closing, engine, head, landmarks, mm, moved, opening, prepared, sum,
};
use super::rim_crossing::{RimCrossing, rim_crossing};

fn names() -> ObjectNames {
    let head = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../weights/shared/default_head/head.obj"
    );
    NamedMesh::read(head).unwrap().names
}

fn chosen(selector: PartSelector, role: PartRole) -> PartChoices {
    PartChoices {
        roles: vec![(selector, role)],
        names: names(),
    }
}

#[test]
fn the_parts_of_the_default_head_are_told_by_shape_and_place() {
    let face = prepared(
        &head(),
        &landmarks(),
        PartChoices {
            roles: vec![],
            names: names(),
        },
    );
    let named_roles: Vec<(&str, PartRole)> = face
        .parts
        .parts
        .iter()
        .map(|part| (part.name.as_deref().unwrap(), part.role))
        .collect();
    let expected = [
        ("skin", PartRole::Skin),
        ("eye_left", PartRole::Gaze),
        ("eye_right", PartRole::Gaze),
        ("teeth_upper", PartRole::Skull),
        ("teeth_lower", PartRole::Jaw),
        ("tongue", PartRole::Jaw),
    ];
    assert_eq!(named_roles, expected);
    assert!(
        face.parts
            .parts
            .iter()
            .all(|part| part.source == RoleSource::Shape)
    );
    assert_eq!(
        face.parts
            .parts
            .iter()
            .map(|part| part.vertices)
            .sum::<usize>(),
        head().positions.len()
    );
}

/// Rest positions and displacements of each part's vertices, by the part's name.
fn by_part(
    choices: PartChoices,
    motion: &[[f32; 3]],
) -> std::collections::HashMap<String, (Points, Points)> {
    let mesh = head();
    let face = prepared(&mesh, &landmarks(), choices);
    let got = moved(&face, motion);
    let mut parts: std::collections::HashMap<String, (Points, Points)> = Default::default();
    for (v, &part) in face.parts.of_vertex().iter().enumerate() {
        let name = face.parts.parts[part as usize].name.clone().unwrap();
        let (at, moved) = parts.entry(name).or_default();
        at.push(mesh.positions[v]);
        moved.push(got[v]);
    }
    parts
}

#[test]
fn lower_teeth_turn_rigidly_and_eyes_and_upper_teeth_rest() {
    let parts = by_part(
        PartChoices {
            roles: vec![],
            names: names(),
        },
        &opening(),
    );
    for name in ["eye_left", "eye_right", "teeth_upper"] {
        assert!(parts[name].1.iter().all(|d| *d == [0.0; 3]), "{name}");
    }
    for name in ["teeth_lower", "tongue"] {
        let (at, by) = &parts[name];
        assert!(by.iter().all(|d| d[1] < -0.003), "{name} goes down");
        let posed: Points = at.iter().zip(by).map(|(p, d)| sum(*p, *d)).collect();
        for k in (0..at.len() - 40).step_by(17) {
            let stretch = mm(posed[k], posed[k + 40]) - mm(at[k], at[k + 40]);
            assert!(stretch.abs() < 1e-3, "{name} stretches by {stretch} mm");
        }
    }
}

#[test]
fn a_caller_overrides_by_number_and_by_name() {
    for selector in [
        PartSelector::Number(4),
        PartSelector::Name("teeth_lower".into()),
    ] {
        let parts = by_part(chosen(selector, PartRole::Skull), &opening());
        assert!(parts["teeth_lower"].1.iter().all(|d| *d == [0.0; 3]));
        assert!(parts["tongue"].1.iter().all(|d| *d != [0.0; 3]));
    }
    let refuse = |choices| {
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::Positions(landmarks())),
            parts: choices,
            ..FaceOptions::default()
        };
        engine().prepare(&head(), &options, SILENT).err().unwrap()
    };
    let unknown = refuse(chosen(PartSelector::Number(6), PartRole::Jaw));
    assert!(matches!(unknown, Error::InvalidInput(_)), "{unknown}");
    let faceless = refuse(chosen(PartSelector::Number(0), PartRole::Still));
    assert!(matches!(faceless, Error::Mesh(_)), "{faceless}");
}

/// Lashes on the rim of the left upper lid and a moustache: cards whose roots lie on the skin.
#[test]
fn lashes_and_moustache_leave_no_gap_at_their_roots() {
    let mut mesh = head();
    let skin = mesh.positions.len();
    let marks = landmarks();
    let mut roots = Vec::new();
    for (path, out) in [
        ([42usize, 43, 44, 45], [0.0, 0.002, 0.007]),
        ([50, 33, 52, 51], [0.0, -0.003, 0.002]),
    ] {
        for pair in path.windows(2) {
            let first = mesh.positions.len() as u32;
            for k in 0..=4 {
                let along = k as f32 / 4.0;
                let p: [f32; 3] = std::array::from_fn(|i| {
                    marks[pair[0]][i] * (1.0 - along) + marks[pair[1]][i] * along
                });
                roots.push(mesh.positions.len());
                mesh.positions.extend([p, sum(p, out)]);
            }
            for k in 0..4 {
                let a = first + 2 * k;
                mesh.triangles
                    .extend([[a, a + 1, a + 2], [a + 1, a + 3, a + 2]]);
            }
        }
    }
    let face = prepared(&mesh, &marks, PartChoices::default());
    let blink = closing(&marks, &LIDS, 0.0);
    let got = moved(&face, &blink);
    let posed = Mesh {
        positions: mesh.positions[..skin]
            .iter()
            .zip(&got)
            .map(|(p, d)| sum(*p, *d))
            .collect(),
        triangles: head().triangles,
    };
    let (before, after) = (SurfaceTree::new(&head()), SurfaceTree::new(&posed));
    for root in roots {
        let distance = |tree: &SurfaceTree, p| 1000.0 * tree.closest(p).unwrap().distance;
        let at = mesh.positions[root];
        let opened = distance(&after, sum(at, got[root])) - distance(&before, at);
        // A row of lashes turns as one piece, while the shut edge under it bends.
        assert!(opened < 0.45, "a root leaves the skin by {opened} mm");
    }
}

/// Vertices of the upper and of the lower rim, from corner to corner.
type Rims = (Vec<usize>, Vec<usize>);

/// Finds the rims of a slit. Divides the slit into 20 columns and leaves out two at either end.
/// Takes from each of the others the vertex nearest to the other side, among the skin within 3 mm
/// of the landmarks' line. The lower side is the one that moves with the lower landmarks.
fn rims(upper: &[usize], lower: &[usize], probe: &[[f32; 3]]) -> Rims {
    let (mesh, marks) = (head(), landmarks());
    let face = prepared(&mesh, &marks, PartChoices::default());
    let got = moved(&face, probe);
    let depth = lower.iter().map(|&n| probe[n][1]).fold(0.0, f32::min);
    let (start, end) = (marks[upper[0]][0], marks[*upper.last().unwrap()][0]);
    let near = |line: &[usize], p: [f32; 3]| {
        line.windows(2).any(|e| {
            (0..=20).any(|k| {
                let s = k as f32 / 20.0;
                mm(
                    p,
                    std::array::from_fn(|i| marks[e[0]][i] * (1.0 - s) + marks[e[1]][i] * s),
                ) < 3.0
            })
        })
    };
    let mut best = [[None::<(f32, usize)>; 20]; 2];
    for v in (0..mesh.positions.len()).filter(|&v| face.parts.of_vertex()[v] == 0) {
        let p = mesh.positions[v];
        let at = 20.0 * (p[0] - start) / (end - start);
        let below = got[v][1] < 0.5 * depth;
        if !(2.0..18.0).contains(&at) || !near(if below { lower } else { upper }, p) {
            continue;
        }
        let height = if below { p[1] } else { -p[1] };
        let slot = &mut best[usize::from(below)][at as usize];
        if slot.is_none_or(|(most, _)| height > most) {
            *slot = Some((height, v));
        }
    }
    let [above, below] = best.map(|rim| rim.into_iter().flatten().map(|(_, v)| v).collect());
    (above, below)
}

const LEFTWARD: [f64; 3] = [1.0, 0.0, 0.0];
const UP: [f64; 3] = [0.0, 1.0, 0.0];

/// Crossing of the mouth's rims, millimetres.
fn mouth_crossing(face: &Face, rims: &Rims, motion: &[[f32; 3]]) -> RimCrossing {
    let (mesh, got) = (head(), moved(face, motion));
    let clip = Array3::from_shape_fn((1, got.len(), 3), |(_, v, i)| {
        1000.0 * f64::from(mesh.positions[v][i] + got[v][i])
    });
    rim_crossing(clip.view(), &rims.0, &rims.1, LEFTWARD, UP).unwrap()
}

/// The default head and the rims of its mouth.
static MOUTH: LazyLock<(Face, Rims)> = LazyLock::new(|| {
    let face = prepared(&head(), &landmarks(), PartChoices::default());
    let rims = rims(&[60, 61, 62, 63, 64], &[60, 67, 66, 65, 64], &opening());
    (face, rims)
});

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]
    #[test]
    fn lips_that_are_pressed_meet_and_do_not_pass(past_mm in 0.0f32..3.0, sideways_mm in -2.0f32..2.0, left in 0.3f32..1.0) {
        let (face, rims) = &*MOUTH;
        prop_assert!(rims.0.len() > 5 && rims.1.len() > 5);
        let mut motion = closing(&landmarks(), &LIPS, 0.001 * past_mm);
        for n in 48..68 {
            motion[n][0] += 0.001 * sideways_mm;
        }
        for n in [63, 65] {
            motion[n][1] *= left;
        }
        let rest = mouth_crossing(face, rims, &vec![[0.0; 3]; 68]);
        let crossing = mouth_crossing(face, rims, &motion);
        // The rims are compared in a few places only and move sideways over each other, so a
        // quarter millimetre is allowed.
        prop_assert!(crossing.depth < rest.depth + 0.25, "{:?}, at rest {:?}", crossing, rest);
    }
}

#[test]
fn lips_whose_landmarks_meet_leave_no_gap() {
    let (face, rims) = &*MOUTH;
    let crossing = mouth_crossing(face, rims, &closing(&landmarks(), &LIPS, 0.0));
    let rest = mouth_crossing(face, rims, &vec![[0.0; 3]; 68]);
    assert!(
        crossing.gap < 0.3 && crossing.gap < rest.gap + 0.05,
        "{crossing:?}, at rest {rest:?}"
    );
}

#[test]
fn lids_that_close_meet() {
    let marks = landmarks();
    let face = prepared(&head(), &marks, PartChoices::default());
    let got = moved(&face, &closing(&marks, &LIDS, 0.001));
    for (upper, lower) in LIDS {
        let [u, l] = [upper, lower].map(|n| {
            let v = face.landmarks.vertices[n] as usize;
            face.landmarks.positions[n][1] + got[v][1]
        });
        // Shut lids overlap a little, so that nothing between two vertices of their edges stays open.
        assert!(
            (u - l).abs() < 1e-3,
            "{upper} over {lower}: {} mm",
            1000.0 * (u - l)
        );
    }
}

#[test]
fn nothing_that_rests_is_moved() {
    let face = prepared(&head(), &landmarks(), PartChoices::default());
    assert!(
        moved(&face, &vec![[0.0; 3]; 68])
            .iter()
            .all(|d| *d == [0.0; 3])
    );
}

#[test]
fn a_mirrored_head_makes_the_mirrored_motion() {
    let (mesh, marks) = (head(), landmarks());
    let flip = |p: &[f32; 3]| [-p[0], p[1], p[2]];
    let mirrored = Mesh {
        positions: mesh.positions.iter().map(flip).collect(),
        triangles: mesh.triangles.iter().map(|t| [t[0], t[2], t[1]]).collect(),
    };
    let permuted =
        |points: &[[f32; 3]]| -> Points { MIRROR.iter().map(|&n| flip(&points[n])).collect() };
    let mut motion = opening();
    motion[54] = [0.008, 0.006, -0.003];
    motion[19] = [0.0, 0.006, 0.0];
    let one = moved(&prepared(&mesh, &marks, PartChoices::default()), &motion);
    let other = moved(
        &prepared(&mirrored, &permuted(&marks), PartChoices::default()),
        &permuted(&motion),
    );
    let off = one.iter().zip(&other).map(|(a, b)| mm(flip(a), *b));
    let off = off.fold(0.0, f32::max);
    // Every step is symmetric except for the order of sums and for the 0.2 mm cells of an eye's
    // picture.
    assert!(off < 0.02, "{off} mm");
}
