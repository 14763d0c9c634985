use std::path::Path;

use ndarray::{Array2, s};

use super::*;
use crate::{
    CachePolicy, Engine, EngineOptions,
    face::FaceOptions,
    job::SILENT,
    mesh::{LandmarkSource, Mesh},
    motion::{LandmarkClip, Life, Motion},
    spread::{Collector, Movement, pose_on},
};

/// Vertices of the default head's tongue, its last part.
const TONGUE_VERTICES: usize = 146;
const L: [f32; 4] = [1.0, 0.0, 0.0, 0.0];
const J: [f32; 4] = [0.0, 1.0, 0.0, 0.0];
const K: [f32; 4] = [0.0, 0.0, 1.0, 0.0];
const TH: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

fn engine() -> Engine {
    let options = EngineOptions {
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    };
    Engine::new(options).unwrap()
}

/// The default head, with its tongue or without.
fn face(engine: &Engine, has_tongue: bool) -> Face {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
    let mut mesh = Mesh::read(folder.join("head.obj")).unwrap();
    if !has_tongue {
        let left = mesh.positions.len() - TONGUE_VERTICES;
        mesh.positions.truncate(left);
        mesh.triangles
            .retain(|corners| corners.iter().all(|&v| (v as usize) < left));
    }
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::read(&folder.join("landmarks.json")).unwrap()),
        ..FaceOptions::default()
    };
    engine.find(&mesh, &options, SILENT).unwrap()
}

/// Motion of a jaw that is lowered by `open_m` metres in each frame.
fn jaw(open_m: &[f32]) -> Motion {
    let lower = |n: usize| (4..13).contains(&n) || (55..60).contains(&n) || (65..68).contains(&n);
    Motion::Landmarks(LandmarkClip {
        displacements: Array3::from_shape_fn((open_m.len(), 68, 3), |(t, n, axis)| {
            if axis == 1 && lower(n) {
                -open_m[t]
            } else {
                0.0
            }
        }),
        fps: 30.0,
    })
}

fn life(rows: &[[f32; 4]]) -> Life {
    Life {
        tongue: Array2::from_shape_fn((rows.len(), 4), |(t, place)| rows[t][place]),
        ..Life::still(rows.len())
    }
}

/// Displacements `[T, V, 3]` and notes.
fn spread(engine: &Engine, face: &Face, movement: Movement<'_>) -> (Array3<f32>, Vec<String>) {
    let mut notes = Vec::new();
    let clip = Collector::collect(|sink| {
        let report = engine.spread(face, movement, sink, SILENT)?;
        notes.clone_from(&report.notes);
        Ok(report)
    });
    (clip.unwrap().vertices.displacements, notes)
}

#[test]
fn each_place_rises_on_its_own_and_nothing_but_the_tongue_moves() {
    let engine = engine();
    let face = face(&engine, true);
    let rows = [[0.0; 4], L, J, K, TH];
    let (motion, life) = (jaw(&[0.0, 0.006, 0.006, 0.006, 0.006]), life(&rows));
    let (plain, _) = spread(&engine, &face, (&motion).into());
    let (spoken, notes) = spread(&engine, &face, Movement::from(&motion).with_tongue(&life));
    assert!(notes.is_empty(), "{notes:?}");
    let first = face.mesh.positions.len() - TONGUE_VERTICES;
    assert_eq!(
        plain.slice(s![.., ..first, ..]),
        spoken.slice(s![.., ..first, ..])
    );
    assert_eq!(plain.index_axis(Axis(0), 0), spoken.index_axis(Axis(0), 0));
    let mm = 1000.0 * face.metres_per_unit() as f32;
    let by = mm * (&spoken - &plain);
    let z = |v: usize| face.mesh.positions[v][2];
    let numbers = first..first + TONGUE_VERTICES;
    let ends = numbers
        .clone()
        .map(z)
        .fold((f32::MAX, f32::MIN), |(low, high), z| {
            (low.min(z), high.max(z))
        });
    let highest = |t: usize| {
        let rising = numbers
            .clone()
            .max_by(|&a, &b| by[[t, a, 1]].total_cmp(&by[[t, b, 1]]));
        let rising = rising.unwrap();
        ((z(rising) - ends.0) / (ends.1 - ends.0), by[[t, rising, 1]])
    };
    for (t, places) in [(1, 0.85..1.01), (2, 0.45..0.75), (3, 0.1..0.4)] {
        let (place, risen_mm) = highest(t);
        assert!(
            places.contains(&place) && risen_mm > 5.0,
            "frame {t}: {risen_mm} mm at {place}"
        );
    }
    let tongue = FaceTongue::find(&face).unwrap();
    let (edge, wall) = (tongue.room.edge, &tongue.room.upper);
    let gaps = numbers.map(|v| {
        let there = std::array::from_fn(|i| face.mesh.positions[v][i] + spoken[[4, v, i]]);
        let [x, height, depth] = face.to_canonical.apply(there).map(|x| 100.0 * x);
        (wall.limit(x, height.max(edge)) - depth, height)
    });
    let (gap, height) = gaps.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    assert!(
        (0.0..0.06).contains(&gap),
        "θ: {gap} cm from the upper teeth"
    );
    assert!((edge - height).abs() < 0.6, "θ: {height} beside {edge}");
}

#[test]
fn no_tongue_goes_through_palate_or_teeth() {
    let engine = engine();
    let face = face(&engine, true);
    let rows = [L, J, K, TH, [1.0; 4], [2.0, 0.5, 0.0, 2.0]];
    for open_m in [0.0, 0.004, 0.012] {
        let (motion, life) = (jaw(&[open_m; 6]), life(&rows));
        let (plain, _) = spread(&engine, &face, (&motion).into());
        let (spoken, _) = spread(&engine, &face, Movement::from(&motion).with_tongue(&life));
        let tongue = FaceTongue::find(&face).unwrap();
        let at = |moved: &Array3<f32>, t: usize, vertex: &TongueVertex| -> [f32; 3] {
            let here = face.mesh.positions[vertex.number];
            let moved = moved.slice(s![t, vertex.number, ..]);
            face.to_canonical
                .apply(std::array::from_fn(|i| here[i] + moved[i]))
                .map(|x| 100.0 * x)
        };
        for (t, vertex) in (0..rows.len()).flat_map(|t| tongue.vertices.iter().map(move |v| (t, v)))
        {
            let (was, now) = (at(&plain, t, vertex), at(&spoken, t, vertex));
            let roof = tongue.room.roof_at(now[2]).max(was[1]);
            assert!(
                now[1] < roof + 1e-3,
                "frame {t}: {now:?} through the roof at {roof}"
            );
            let inner = tongue.room.upper.limit(now[0], now[1]);
            let is_in_teeth = now[2] > inner.max(was[2]) && now[1] > tongue.room.edge.max(was[1]);
            assert!(
                !is_in_teeth,
                "frame {t}, open {open_m}: {now:?} in the teeth, {:?}",
                tongue.room
            );
        }
    }
}

#[test]
fn a_tongue_at_rest_changes_no_bit() {
    let engine = engine();
    let face = face(&engine, true);
    let motion = jaw(&[0.0, 0.01, 0.005]);
    let plain = spread(&engine, &face, (&motion).into());
    let still = Life::still(3);
    assert_eq!(
        spread(&engine, &face, Movement::from(&motion).with_tongue(&still)),
        plain
    );
}

#[test]
fn a_mesh_without_a_tongue_says_so() {
    let engine = engine();
    let face = face(&engine, false);
    let (motion, life) = (jaw(&[0.0, 0.01]), life(&[L, TH]));
    let (plain, nothing) = spread(&engine, &face, (&motion).into());
    let (spoken, notes) = spread(&engine, &face, Movement::from(&motion).with_tongue(&life));
    assert_eq!(
        (nothing.len(), notes),
        (0, vec!["no tongue was found in the mouth".to_owned()])
    );
    assert_eq!(tongue_note(&face), Some("no tongue was found in the mouth"));
    assert_eq!(spoken, plain);
}

#[test]
fn frames_that_do_not_fit_are_refused() {
    let engine = engine();
    let face = face(&engine, true);
    let (motion, life) = (jaw(&[0.0, 0.01]), life(&[L]));
    let movement = Movement::from(&motion).with_tongue(&life);
    let refused = Collector::collect(|sink| engine.spread(&face, movement, sink, SILENT));
    assert!(refused.is_err());
}

#[test]
fn the_shares_of_a_pose_are_those_that_made_it() {
    let engine = engine();
    let face = face(&engine, true);
    let rows = [[0.0; 4], L, K, [0.5, 0.3, 0.0, 0.0], [0.2, 0.0, 0.6, 0.3]];
    let (motion, life) = (jaw(&[0.006; 5]), life(&rows));
    let (shown, _) = spread(&engine, &face, Movement::from(&motion).with_tongue(&life));
    for (t, row) in rows.iter().enumerate() {
        let pose = pose_on(&face, shown.index_axis(Axis(0), t)).unwrap();
        let again = Life {
            tongue: ndarray::arr2(&[pose.tongue]),
            ..Life::still(1)
        };
        let jaw_motion = jaw(&[0.006]);
        let (repeated, _) = spread(
            &engine,
            &face,
            Movement::from(&jaw_motion).with_tongue(&again),
        );
        let off = &repeated.index_axis(Axis(0), 0) - &shown.index_axis(Axis(0), t);
        let off =
            1000.0 * face.metres_per_unit() as f32 * off.fold(0.0f32, |most, x| most.max(x.abs()));
        assert!(off < 0.2, "{row:?} {:?}: {off} mm", pose.tongue);
    }
    // A tongue that nobody posed is at rest.
    let mut moved = shown.index_axis(Axis(0), 1).to_owned();
    let first = face.mesh.positions.len() - TONGUE_VERTICES;
    moved.slice_mut(s![first.., ..]).fill(0.0);
    assert_eq!(pose_on(&face, moved.view()).unwrap().tongue, [0.0; 4]);
}
