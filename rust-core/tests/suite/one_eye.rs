//! A head with one eye in its middle, made of the outer half of a left eye and its mirror image.

use std::collections::HashMap;

use anyface::{
    Face,
    face::{FaceOptions, Lids},
    head::HeadMaker,
    job::SILENT,
    mesh::{FrontView, Mesh, PartRole},
    motion::{LandmarkClip, Motion},
    spread::Collector,
};
use ndarray::Array3;

use crate::head::{Points, engine, sum};

/// The head of a seed with its left eye moved to the middle. Nose and mouth stay where they are.
fn cyclops(seed: u64) -> Mesh {
    let maker = HeadMaker::open(None).unwrap();
    let head = maker.mesh(&maker.random(seed), true).unwrap();
    let marks = head.landmarks.positions;
    let [eye_x, eye_y] = [0, 1].map(|i| 0.5 * (marks[42][i] + marks[45][i]));
    let (nose_y, top_y) = (
        marks[33][1],
        eye_y - 0.18 * (marks[45][0] - marks[36][0]).abs(),
    );
    let shifted = |p: [f32; 3]| {
        let t = ((p[1] - nose_y) / (top_y - nose_y)).clamp(0.0, 1.0);
        [p[0] - eye_x * t * t * (3.0 - 2.0 * t), p[1], p[2]]
    };
    let mut half = Half {
        positions: head.mesh.positions.iter().map(|p| shifted(*p)).collect(),
        triangles: Vec::new(),
        on_plane: HashMap::new(),
    };
    for t in &head.mesh.triangles {
        half.clip(*t);
    }
    half.mirrored()
}

/// The part of a mesh on the left side.
struct Half {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    on_plane: HashMap<(u32, u32), u32>,
}

impl Half {
    fn clip(&mut self, t: [u32; 3]) {
        let is_left = |half: &Half, v: u32| half.positions[v as usize][0] >= 0.0;
        let mut corners = Vec::new();
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            if is_left(self, a) {
                corners.push(a);
            }
            if is_left(self, a) != is_left(self, b) {
                corners.push(self.crossing(a, b));
            }
        }
        for k in 1..corners.len().saturating_sub(1) {
            self.triangles
                .push([corners[0], corners[k], corners[k + 1]]);
        }
    }

    fn crossing(&mut self, a: u32, b: u32) -> u32 {
        let positions = &mut self.positions;
        *self
            .on_plane
            .entry((a.min(b), a.max(b)))
            .or_insert_with(|| {
                let [p, q] = [a.min(b), a.max(b)].map(|v| positions[v as usize]);
                let t = p[0] / (p[0] - q[0]);
                let place: [f32; 3] = std::array::from_fn(|i| p[i] + t * (q[i] - p[i]));
                positions.push([0.0, place[1], place[2]]);
                positions.len() as u32 - 1
            })
    }

    fn mirrored(self) -> Mesh {
        let mut mesh = Mesh {
            positions: Vec::new(),
            triangles: Vec::new(),
        };
        let mut numbers = HashMap::new();
        for side in [1.0, -1.0] {
            for t in &self.triangles {
                let corners = t.map(|v| {
                    let [x, y, z] = self.positions[v as usize];
                    let key = (v, side < 0.0 && x > 1e-9);
                    *numbers.entry(key).or_insert_with(|| {
                        mesh.positions.push([side * x, y, z]);
                        mesh.positions.len() as u32 - 1
                    })
                });
                let [a, b, c] = corners;
                mesh.triangles
                    .push(if side > 0.0 { [a, b, c] } else { [a, c, b] });
            }
        }
        mesh
    }
}

/// Displacements under one frame of canonical motion.
fn moved(face: &Face, by: impl Fn(&mut Array3<f32>)) -> Points {
    let mut displacements = Array3::zeros((1, 68, 3));
    by(&mut displacements);
    let motion = Motion::Landmarks(LandmarkClip {
        displacements,
        fps: 30.0,
    });
    let engine = engine();
    let clip = Collector::collect(|sink| engine.spread(face, &motion, sink, SILENT)).unwrap();
    let rows = clip.vertices.displacements;
    let rows = rows.index_axis(ndarray::Axis(0), 0);
    rows.outer_iter().map(|p| [p[0], p[1], p[2]]).collect()
}

/// Number of cells of 0.2 mm over the eye that show the eyeball.
fn eye_in_sight(face: &Face, by: &Points) -> usize {
    let middle = face.landmarks.positions[27];
    let [low, high] = [-0.03, 0.03].map(|reach| [middle[0] + reach, middle[1] + reach]);
    let mut view = FrontView::new(low, high, 2e-4);
    for t in &face.mesh.triangles {
        let is_eye = face.parts.is(t[0] as usize, PartRole::Gaze);
        let kind = if is_eye { 1 } else { 2 };
        view.draw(
            t.map(|v| sum(face.mesh.positions[v as usize], by[v as usize])),
            kind,
        );
    }
    let cells = (0..view.columns()).flat_map(|c| (0..view.rows()).map(move |r| (c, r)));
    cells.filter(|(c, r)| view.kind(*c, *r) == 1).count()
}

#[test]
fn one_eye_in_the_middle_blinks_by_either_side_and_has_one_brow() {
    let engine = engine();
    let mesh = cyclops(3);
    let face = engine
        .prepare(&mesh, &FaceOptions::default(), SILENT)
        .unwrap();
    assert_eq!(face.lids(), [Lids::Close; 2]);
    assert_eq!(face.at_rest(), None);
    let open = eye_in_sight(&face, &vec![[0.0; 3]; mesh.positions.len()]);
    assert!(open > 1000, "{open} cells of the open eye");
    // Lids travel 7.9 mm in a canonical blink.
    for (right, left) in [(0.0079, 0.0), (0.0, 0.0079), (0.0079, 0.0079)] {
        let by = moved(&face, |motion| {
            for (lids, way) in [([37, 38], right), ([43, 44], left)] {
                lids.iter().for_each(|&n| motion[[0, n, 1]] = -way);
            }
        });
        let shut = eye_in_sight(&face, &by);
        assert!(50 * shut < open, "{shut} of {open} cells are in sight");
    }
    let by = moved(&face, |motion| {
        (22..27).for_each(|n| motion[[0, n, 1]] = 0.005)
    });
    let brow = |n: usize| by[face.landmarks.vertices[n] as usize][1];
    for (right, left) in [(19, 24), (20, 23)] {
        let (right, left) = (brow(right), brow(left));
        assert!(left > 2e-3 && (right - left).abs() < 1e-3, "{right} {left}");
    }
}
