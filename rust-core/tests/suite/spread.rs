//! How motion of each kind reaches a mesh.

use std::sync::Arc;

use anyface::{
    Error, Face, Result,
    mesh::{Mesh, PartChoices},
    motion::{CodeClip, LandmarkClip, Motion, Template, TemplateClip, WeightClip},
    progress::SILENT,
    spread::{ClipStart, Collector, FrameSink, LandmarkTrack},
};
use ndarray::{Array2, Array3, Axis, Slice, array};

use crate::head;

fn face() -> Face {
    head::prepared(&head::head(), &head::landmarks(), PartChoices::default())
}

/// A mouth that opens and closes.
fn talking(frames: usize) -> Motion {
    let opening = head::opening();
    let displacements = Array3::from_shape_fn((frames, 68, 3), |(t, n, i)| {
        (0.5 - 0.5 * (0.7 * t as f32).cos()) * opening[n][i]
    });
    Motion::Landmarks(LandmarkClip {
        displacements,
        fps: 25.0,
    })
}

#[test]
fn weights_move_a_mesh_by_its_own_shapes() {
    let (engine, face) = (head::engine(), face());
    let motion = Motion::Weights(WeightClip {
        names: ["jawOpen", "noSuchShape", "mouthSmileLeft"]
            .map(str::to_owned)
            .to_vec(),
        weights: array![[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.25]],
        fps: 25.0,
        together: vec![],
    });
    let made = Collector::collect(|sink| engine.spread(&face, &motion, sink, SILENT)).unwrap();
    let rig = engine.rig(&face, SILENT).unwrap();
    let shape = |name: &str| {
        let number = rig.names.iter().position(|known| known == name).unwrap();
        rig.deltas.index_axis(Axis(0), number)
    };
    let frame = |t: usize| made.vertices.displacements.index_axis(Axis(0), t);
    assert!(frame(0).iter().all(|x| *x == 0.0));
    assert_eq!(frame(1), shape("jawOpen"));
    let mixed: Array2<f32> = 0.5 * &shape("jawOpen") + 0.25 * &shape("mouthSmileLeft");
    assert!((&frame(2) - &mixed).iter().all(|x| x.abs() < 1e-6));
    // The landmarks are those of the mesh that moved.
    let chin = face.landmarks.vertices[8] as usize;
    let read_off = made.landmark_displacements.index_axis(Axis(0), 1);
    assert_eq!(read_off.row(8), frame(1).row(chin));
    assert!(read_off[[8, 1]] < -0.01);
}

#[test]
fn kinds_that_nothing_puts_on_a_mesh_are_refused_by_name() {
    let (engine, face) = (head::engine(), face());
    let codes = Motion::Codes(CodeClip {
        head: "field".into(),
        codes: Array2::zeros((2, 9)),
        fps: 25.0,
    });
    let refused = engine.spread(&face, &codes, &mut Collector::default(), SILENT);
    let message = refused.unwrap_err().to_string();
    assert!(message.contains("got codes"), "{message}");
}

/// A template that is the head itself, with one shape that moves its right cheek out.
fn of_the_head(face: &Face) -> TemplateClip {
    let cheek = face.landmarks.positions[48];
    let vertices = face.mesh.positions.len();
    let mut between = Array2::zeros((vertices, 3));
    for (v, p) in face.mesh.positions.iter().enumerate() {
        let away = (0..3).map(|i| (p[i] - cheek[i] - [-0.03, 0.0, -0.02][i]).powi(2));
        between[[v, 0]] = -(-away.sum::<f32>() / 2e-4).exp();
    }
    let canonical = |p: &[f32; 3]| face.to_canonical.apply(*p);
    let template = Template {
        name: "head".into(),
        mesh: Mesh {
            positions: face.mesh.positions.iter().map(canonical).collect(),
            triangles: face.mesh.triangles.clone(),
        },
        landmarks: face.landmarks.vertices.map(|v| v as usize),
        between,
    };
    let Motion::Landmarks(landmarks) = talking(4) else {
        unreachable!();
    };
    TemplateClip {
        template: Arc::new(template),
        landmarks,
        between: array![[0.0], [0.01], [0.02], [-0.01]],
    }
}

#[test]
fn the_skin_of_a_template_moves_a_cheek_that_its_landmarks_leave() {
    let (engine, face) = (head::engine(), face());
    let clip = of_the_head(&face);
    let spread = |motion: &Motion| {
        let made = Collector::collect(|sink| engine.spread(&face, motion, sink, SILENT));
        made.unwrap().vertices.displacements
    };
    let alone = spread(&Motion::Landmarks(clip.landmarks.clone()));
    let both = spread(&Motion::Template(clip.clone()));
    let added = &both - &alone;
    let unit = 1.0 / face.metres_per_unit() as f32;
    let most = |t: usize| {
        let frame = added.index_axis(Axis(0), t);
        frame.iter().fold(0.0f32, |most, x| most.max(x.abs()))
    };
    assert_eq!(most(0), 0.0);
    // The head is of another kind than the template's owner or of its own: at least the floor is carried.
    assert!(
        most(1) > 0.3 * 0.01 * unit && most(1) < 1.05 * 0.01 * unit,
        "{}",
        most(1)
    );
    assert!((most(2) / most(1) - 2.0).abs() < 1e-2);
    // It is a cheek that moves, on its own side, and outwards.
    let frame = added.index_axis(Axis(0), 2);
    for (v, row) in frame.outer_iter().enumerate() {
        let x = face.to_canonical.apply(face.mesh.positions[v])[0];
        assert!(x < 0.0 || row.iter().all(|d| d.abs() < 1e-4 * unit), "{v}");
    }
    let (v, _) = frame
        .outer_iter()
        .enumerate()
        .max_by(|a, b| a.1.dot(&a.1).total_cmp(&b.1.dot(&b.1)))
        .unwrap();
    let moved = face.to_canonical.rotate([0, 1, 2].map(|i| frame[[v, i]]));
    assert!(moved[0] < 0.0 && moved[0].abs() > 5.0 * moved[1].abs());
}

#[test]
fn skin_of_other_frames_or_shapes_is_refused() {
    let clip = of_the_head(&face());
    for wrong in [Array2::zeros((3, 1)), Array2::zeros((4, 2))] {
        let made = TemplateClip::new(clip.template.clone(), clip.landmarks.clone(), wrong);
        assert!(matches!(made, Err(Error::ShapeMismatch { .. })));
    }
}

/// Takes five frames at a time, up to a number of blocks.
struct Small {
    blocks: Vec<Array3<f32>>,
    room: usize,
    finished: bool,
}

impl FrameSink for Small {
    fn begin(&mut self, start: &ClipStart<'_>) -> Result<()> {
        assert_eq!((start.frames, start.is_brought), (23, false));
        Ok(())
    }

    fn frames_at_once(&self, _start: &ClipStart<'_>) -> usize {
        5
    }

    fn take(&mut self, block: Array3<f32>) -> Result<()> {
        if self.blocks.len() == self.room {
            return Err(Error::Cancelled);
        }
        self.blocks.push(block);
        Ok(())
    }

    fn finish(&mut self, _landmarks: &LandmarkTrack<'_>) -> Result<()> {
        self.finished = true;
        Ok(())
    }
}

#[test]
fn blocks_hold_the_frames_of_the_whole_and_a_sink_may_stop_the_run() {
    let (engine, face, motion) = (head::engine(), face(), talking(23));
    let whole = Collector::collect(|sink| engine.spread(&face, &motion, sink, SILENT)).unwrap();
    for (room, stops) in [(9, false), (2, true)] {
        let mut small = Small {
            blocks: Vec::new(),
            room,
            finished: false,
        };
        let run = engine.spread(&face, &motion, &mut small, SILENT);
        assert_eq!(matches!(run, Err(Error::Cancelled)), stops);
        assert_eq!(small.finished, !stops);
        for (k, block) in small.blocks.iter().enumerate() {
            let frames = Slice::from(5 * k..(5 * k + 5).min(23));
            let same = whole.vertices.displacements.slice_axis(Axis(0), frames);
            assert!((block - &same).iter().all(|x| x.abs() < 1e-7), "block {k}");
        }
    }
}
