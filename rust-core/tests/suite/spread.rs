//! How motion of each kind reaches a mesh.

use anyface::{
    Error, Face, Result,
    job::{ProgressFn, SILENT},
    mesh::PartChoices,
    motion::{LandmarkClip, Motion, WeightClip},
    rig::ShapeSource,
    spread::{ClipStart, Collector, FrameBlock, FrameSink},
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
    let clip = Collector::collect(|sink| engine.spread(&face, &motion, sink, SILENT)).unwrap();
    let rig = engine.rig(&face, ShapeSource::Network, SILENT).unwrap();
    let shape = |name: &str| {
        let number = rig.names.iter().position(|known| known == name).unwrap();
        rig.deltas.index_axis(Axis(0), number)
    };
    let frame = |t: usize| clip.vertices.displacements.index_axis(Axis(0), t);
    assert!(frame(0).iter().all(|x| *x == 0.0));
    // Only lids may differ from the shapes, because the skin has to stay in front of the eyeballs.
    let apart = |moved: &Array2<f32>, t: usize| {
        let away = (moved - &frame(t)).mapv(f32::abs);
        away.fold(0.0, |a: f32, b| a.max(*b))
    };
    let mixed = 0.5 * &shape("jawOpen") + 0.25 * &shape("mouthSmileLeft");
    for (t, shapes) in [(1, shape("jawOpen").to_owned()), (2, mixed)] {
        let off = apart(&shapes, t);
        assert!(off < 0.3e-3, "frame {t}: {off}");
    }
    // The landmark displacements are read off the mesh that moved.
    let chin = face.landmarks.vertices[8] as usize;
    let read_off = clip.landmark_displacements.index_axis(Axis(0), 1);
    assert_eq!(read_off.row(8), frame(1).row(chin));
    assert!(read_off[[8, 1]] < -0.01);
}

/// Takes five frames at a time, up to a number of blocks.
struct Small {
    blocks: Vec<Array3<f32>>,
    room: usize,
    finished: bool,
}

impl FrameSink for Small {
    fn begin(&mut self, start: &ClipStart<'_>) -> Result<()> {
        assert_eq!(start.frames, 23);
        Ok(())
    }

    fn frames_at_once(&self, _start: &ClipStart<'_>) -> usize {
        5
    }

    fn take(&mut self, block: FrameBlock) -> Result<()> {
        if self.blocks.len() == self.room {
            return Err(Error::Cancelled);
        }
        self.blocks.push(block.displacements);
        Ok(())
    }

    fn finish(&mut self, _progress: ProgressFn<'_>) -> Result<()> {
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
