use std::path::PathBuf;

use glam::Vec3;
use ndarray::Array3;

use super::*;
use crate::{
    CachePolicy, Engine, EngineOptions, Error,
    face::{FaceOptions, locate_landmarks},
    job::SILENT,
    mesh::{LandmarkSource, parts::weld_seams},
    spread::{Collector, Movement},
};

/// Half the width of the part of the default head that is drawn, metres.
const SIDE: f32 = 0.085;
/// Its lowest and highest point, metres.
const HEIGHTS: [f32; 2] = [-0.125, 0.085];

fn default_head() -> (Mesh, Vec<[f32; 3]>) {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
    let mesh = Mesh::read(folder.join("head.obj")).unwrap();
    let source = LandmarkSource::read(&folder.join("landmarks.json")).unwrap();
    let options = FaceOptions {
        landmarks: Some(source),
        ..FaceOptions::default()
    };
    let landmarks = locate_landmarks(&mesh, &options).unwrap();
    (mesh, landmarks.positions.to_vec())
}

/// Depths of the default head seen from the front. Its mesh is one sheet, closed by a point behind
/// it, so that its lips are one surface.
struct Mask {
    columns: usize,
    rows: usize,
    depths: Vec<f32>,
    landmarks: Vec<[f32; 3]>,
}

impl Mask {
    fn new(columns: usize, rows: usize) -> Mask {
        let (head, landmarks) = default_head();
        let mut mask = Mask {
            columns,
            rows,
            depths: vec![-0.02; columns * rows],
            landmarks,
        };
        for t in &head.triangles {
            mask.draw(t.map(|v| head.positions[v as usize]));
        }
        for _ in 0..(columns / 60).pow(2) {
            mask.smooth();
        }
        mask
    }

    fn place(&self, column: usize, row: usize) -> [f32; 2] {
        let along = |i: usize, n: usize| i as f32 / (n - 1) as f32;
        let y = HEIGHTS[0] + (HEIGHTS[1] - HEIGHTS[0]) * along(row, self.rows);
        [SIDE * (2.0 * along(column, self.columns) - 1.0), y]
    }

    fn draw(&mut self, [a, b, c]: [[f32; 3]; 3]) {
        let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let range = |i: usize, low: f32, high: f32, n: usize| {
            let at = |x: f32| ((x - low) / (high - low) * (n - 1) as f32).clamp(0.0, n as f32);
            let [p, q, r] = [a, b, c].map(|v| at(v[i]));
            p.min(q).min(r).ceil() as usize..(p.max(q).max(r).floor() as usize + 1).min(n)
        };
        for column in range(0, -SIDE, SIDE, self.columns) {
            for row in range(1, HEIGHTS[0], HEIGHTS[1], self.rows) {
                let [x, y] = self.place(column, row);
                let v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / twice;
                let w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / twice;
                if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
                    let slot = &mut self.depths[row * self.columns + column];
                    *slot = slot.max((1.0 - v - w) * a[2] + v * b[2] + w * c[2]);
                }
            }
        }
    }

    fn smooth(&mut self) {
        let old = self.depths.clone();
        let at =
            |c: usize, r: usize| old[r.min(self.rows - 1) * self.columns + c.min(self.columns - 1)];
        for (row, column) in (0..self.rows).flat_map(|r| (0..self.columns).map(move |c| (r, c))) {
            let beside = at(column.saturating_sub(1), row) + at(column + 1, row);
            let around = beside + at(column, row.saturating_sub(1)) + at(column, row + 1);
            self.depths[row * self.columns + column] = 0.5 * at(column, row) + 0.125 * around;
        }
    }

    /// Adds `of` to the depths, metres. `of` receives the offset from the middle of the mouth,
    /// metres.
    fn moved(mut self, of: impl Fn([f32; 2]) -> f32) -> Mask {
        let middle = self.landmarks[62];
        for (row, column) in (0..self.rows).flat_map(|r| (0..self.columns).map(move |c| (r, c))) {
            let [x, y] = self.place(column, row);
            self.depths[row * self.columns + column] += of([x - middle[0], y - middle[1]]);
        }
        self
    }

    /// Averages the two sides, landmarks included.
    fn symmetric(mut self) -> Mask {
        for row in 0..self.rows {
            for column in 0..self.columns / 2 {
                let [a, b] = [column, self.columns - 1 - column].map(|c| row * self.columns + c);
                let mean = 0.5 * (self.depths[a] + self.depths[b]);
                (self.depths[a], self.depths[b]) = (mean, mean);
            }
        }
        let old = self.landmarks.clone();
        for (n, landmark) in self.landmarks.iter_mut().enumerate() {
            let [p, q] = [old[n], old[crate::mesh::ibug::MIRROR[n]]];
            *landmark = [
                0.5 * (p[0] - q[0]),
                0.5 * (p[1] + q[1]),
                0.5 * (p[2] + q[2]),
            ];
        }
        self
    }

    fn mesh(&self) -> Mesh {
        let mut mesh = Mesh::default();
        for (row, column) in (0..self.rows).flat_map(|r| (0..self.columns).map(move |c| (r, c))) {
            let [x, y] = self.place(column, row);
            mesh.positions
                .push([x, y, self.depths[row * self.columns + column]]);
        }
        let number = |c: usize, r: usize| (r * self.columns + c) as u32;
        for (r, c) in (0..self.rows - 1).flat_map(|r| (0..self.columns - 1).map(move |c| (r, c))) {
            let [p, q, s, t] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| number(c + i, r + j));
            mesh.triangles.extend(if 2 * c < self.columns - 1 {
                [[p, q, s], [p, s, t]]
            } else {
                [[p, q, t], [q, s, t]]
            });
        }
        let back = mesh.positions.len() as u32;
        mesh.positions.push([0.0, -0.02, -0.1]);
        for (a, b) in crate::mesh::parts::boundary_edges(&mesh.triangles) {
            mesh.triangles.push([b, a, back]);
        }
        mesh
    }

    fn opened(&self) -> (Mesh, OpenedFace) {
        let mesh = self.mesh();
        let opened = open_mouth(&mesh, &self.locate(&mesh)).unwrap();
        (mesh, opened)
    }

    fn locate(&self, mesh: &Mesh) -> Landmarks {
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::Positions(self.landmarks.clone())),
            ..FaceOptions::default()
        };
        locate_landmarks(mesh, &options).unwrap()
    }
}

fn area(mesh: &Mesh, triangles: std::ops::Range<usize>) -> f64 {
    mesh.face_areas()[triangles].iter().sum()
}

/// Checks what must hold for every opened mouth. Returns the width of the slit, metres.
fn check(mesh: &Mesh, opened: &OpenedFace) -> f32 {
    let report = opened.mesh.report();
    let before = mesh.report();
    assert_eq!(report.boundary_edges, before.boundary_edges);
    assert_eq!(report.nonmanifold_edges, before.nonmanifold_edges);
    assert_eq!(report.parts, before.parts);
    assert_eq!(
        opened.mesh.positions[..mesh.positions.len()],
        mesh.positions
    );
    let originals = opened.vertex_sources[..mesh.positions.len()].iter();
    assert!(
        (0..)
            .zip(originals)
            .all(|(v, sources)| sources[0] == (v, 1.0))
    );
    assert_eq!(Mouth::of(&opened.mesh, &opened.landmarks), Mouth::Slit);
    let skin = area(&opened.mesh, 0..opened.first_lining_triangle);
    let whole = area(mesh, 0..mesh.triangles.len());
    assert!((skin / whole - 1.0).abs() < 1e-5, "{skin} of {whole}");
    let [a, b] = [0, opened.upper_rim.len() - 1]
        .map(|i| opened.mesh.positions[opened.upper_rim[i] as usize]);
    (b[0] - a[0]).hypot(b[2] - a[2])
}

#[test]
fn a_closed_head_stays_closed_and_its_surface_the_same() {
    for (columns, rows) in [(37, 38), (100, 120), (200, 240)] {
        let mask = Mask::new(columns, rows);
        let (mesh, opened) = mask.opened();
        let width = check(&mesh, &opened);
        let expected = mask.landmarks[64][0] - mask.landmarks[60][0];
        assert!(
            (width / expected - 1.0).abs() < 0.12,
            "{columns}: {width} of {expected}"
        );
    }
}

#[test]
fn what_belongs_to_vertices_and_corners_is_carried_over() {
    let (mesh, opened) = Mask::new(80, 90).opened();
    let at = |mesh: &Mesh, v: u32| Vec3::from(mesh.positions[v as usize]);
    for v in 0..opened.first_inside_vertex {
        let sources = opened.vertex_sources[v].iter();
        let mixed: Vec3 = sources.map(|&(v, share)| share * at(&mesh, v)).sum();
        assert!(mixed.distance(at(&opened.mesh, v as u32)) < 2e-6);
    }
    for number in 0..opened.first_lining_triangle {
        let source = opened.triangle_sources[number];
        let old = mesh.triangles[source.triangle as usize];
        for (v, shares) in opened.mesh.triangles[number]
            .into_iter()
            .zip(source.corners)
        {
            let mixed: Vec3 = (old.iter().zip(shares))
                .map(|(&v, share)| share * at(&mesh, v))
                .sum();
            assert!(mixed.distance(at(&opened.mesh, v)) < 2e-6);
        }
    }
    for sources in &opened.vertex_sources {
        let sum: f32 = sources.iter().map(|(_, share)| share).sum();
        assert!((sum - 1.0).abs() < 1e-6);
    }
}

#[test]
fn the_rim_is_no_more_jagged_than_a_fifth_of_an_edge() {
    let mask = Mask::new(90, 100);
    let (_, opened) = mask.opened();
    let rim: Vec<[f32; 3]> = opened
        .upper_rim
        .iter()
        .map(|&v| opened.mesh.positions[v as usize])
        .collect();
    let edge = (HEIGHTS[1] - HEIGHTS[0]) / (mask.rows - 1) as f32;
    for three in rim.windows(3) {
        let along = (three[1][0] - three[0][0]) / (three[2][0] - three[0][0]);
        let straight = three[0][1] + along * (three[2][1] - three[0][1]);
        assert!((three[1][1] - straight).abs() < 0.2 * edge, "{three:?}");
    }
}

#[test]
fn a_symmetric_head_gets_a_symmetric_slit() {
    let (_, opened) = Mask::new(101, 120).symmetric().opened();
    let rim: Vec<[f32; 3]> = opened
        .upper_rim
        .iter()
        .map(|&v| opened.mesh.positions[v as usize])
        .collect();
    let count = rim.len();
    for (i, p) in rim.iter().enumerate() {
        let q = rim[count - 1 - i];
        let off = (p[0] + q[0]).abs().max((p[1] - q[1]).abs());
        assert!(off < 1e-4, "{p:?} {q:?}");
    }
}

#[test]
fn bearded_wavy_and_slightly_open_lips_are_parted() {
    let bristles = |[x, y]: [f32; 2]| 0.0015 * (1900.0 * x).sin() * (1300.0 * y + 700.0 * x).sin();
    let (mesh, opened) = Mask::new(140, 160).moved(bristles).opened();
    check(&mesh, &opened);
    let waves = |[x, y]: [f32; 2]| {
        let seam = 0.003 * (250.0 * x).sin();
        -0.004 * (-((y - seam) / 0.002).powi(2)).exp()
    };
    let (mesh, opened) = Mask::new(140, 160).moved(waves).opened();
    check(&mesh, &opened);
    // The strip between the lips is 4 mm high and lies 4 mm behind them.
    let ajar = |[x, y]: [f32; 2]| {
        if x.abs() < 0.02 && y.abs() < 0.002 {
            -0.004
        } else {
            0.0
        }
    };
    let (mesh, opened) = Mask::new(140, 160).moved(ajar).opened();
    check(&mesh, &opened);
}

#[test]
fn the_slit_follows_a_groove_that_the_landmarks_miss() {
    let groove = |[x, y]: [f32; 2]| {
        if x.abs() < 0.022 {
            -0.004 * (-((y - 0.002) / 0.0015).powi(2)).exp()
        } else {
            0.0
        }
    };
    let flat = Mask::new(160, 200).moved(|[x, y]| {
        if x.abs() < 0.03 && y.abs() < 0.008 {
            0.0
        } else {
            -0.0005
        }
    });
    let middle = flat.landmarks[62];
    let (_, opened) = flat.moved(groove).opened();
    let rim = opened
        .upper_rim
        .iter()
        .map(|&v| opened.mesh.positions[v as usize]);
    let inner = rim.filter(|p| (p[0] - middle[0]).abs() < 0.012);
    let offsets: Vec<f32> = inner.map(|p| p[1] - middle[1]).collect();
    let mean = offsets.iter().sum::<f32>() / offsets.len() as f32;
    assert!((mean - 0.002).abs() < 0.0012, "{mean}");
}

#[test]
fn texture_seams_and_faces_that_look_inward_are_no_hindrance() {
    let mask = Mask::new(81, 90);
    let mut mesh = mask.mesh();
    // Doubles every vertex of the middle column, as exporters do along texture seams.
    let middle: Vec<u32> = (0..90).map(|row| row * 81 + 40).collect();
    let first = mesh.positions.len() as u32;
    let copies: Vec<[f32; 3]> = middle.iter().map(|&v| mesh.positions[v as usize]).collect();
    mesh.positions.extend(copies);
    for t in &mut mesh.triangles {
        let x = t
            .iter()
            .map(|&v| mesh.positions[v as usize][0])
            .sum::<f32>();
        let right = x > 3.0 * mesh.positions[40][0];
        for v in t.iter_mut().filter(|_| right) {
            if let Some(row) = middle.iter().position(|m| m == v) {
                *v = first + row as u32;
            }
        }
    }
    let opened = open_mouth(&mesh, &mask.locate(&mesh)).unwrap();
    let sewn = weld_seams(&opened.mesh.positions, &opened.mesh.triangles, &[]);
    let triangles: Vec<[u32; 3]> = opened
        .mesh
        .triangles
        .iter()
        .map(|t| t.map(|v| sewn[v as usize]))
        .collect();
    assert!(crate::mesh::parts::boundary_edges(&triangles).is_empty());
    assert_eq!(Mouth::of(&opened.mesh, &opened.landmarks), Mouth::Slit);
    let mut inward = mask.mesh();
    inward.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let opened = open_mouth(&inward, &mask.locate(&inward)).unwrap();
    check(&inward, &opened);
    let volume = |mesh: &Mesh| -> f64 {
        let six = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| mesh.point(v));
            a.dot(b.cross(c))
        };
        mesh.triangles.iter().map(six).sum::<f64>() / 6.0
    };
    // The bag's faces are oriented like the head's, so the bag takes volume from the head.
    assert!(volume(&inward) < 0.0 && volume(&opened.mesh) > volume(&inward) + 5e-6);
}

#[test]
fn lips_that_part_already_are_left_alone() {
    let (mesh, landmarks) = default_head();
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Positions(landmarks)),
        ..FaceOptions::default()
    };
    let landmarks = locate_landmarks(&mesh, &options).unwrap();
    let error = open_mouth(&mesh, &landmarks).unwrap_err();
    assert!(matches!(error, Error::InvalidInput(_)));
    assert!(error.to_string().contains("part already (slit)"), "{error}");
}

/// Motion of the landmarks that opens the mouth wide, on a head of human size, metres.
fn wide_open() -> Array3<f32> {
    let mut moved = Array3::zeros((1, 68, 3));
    for (n, share) in [
        (55, 0.8),
        (56, 1.0),
        (57, 1.05),
        (58, 1.0),
        (59, 0.8),
        (65, 1.0),
        (66, 1.05),
        (67, 1.0),
    ] {
        moved[[0, n, 1]] = -0.022 * share;
        moved[[0, n, 2]] = -0.007 * share;
    }
    for n in 4..=12usize {
        let share = 1.0 - n.abs_diff(8) as f32 / 6.0;
        moved[[0, n, 1]] = -0.022 * share;
        moved[[0, n, 2]] = -0.012 * share;
    }
    for n in [48, 54, 60, 64] {
        moved[[0, n, 1]] = -0.008;
    }
    moved
}

/// Displacements of the vertices, `[V]`, when a mouth opens wide.
fn moved(mesh: &Mesh, landmarks: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let engine = Engine::new(EngineOptions {
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    });
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Positions(landmarks.to_vec())),
        ..FaceOptions::default()
    };
    let engine = engine.unwrap();
    let face = engine.prepare(mesh, &options, SILENT).unwrap();
    let clip = Collector::collect(|sink| {
        engine.spread(
            &face,
            Movement::Own {
                landmarks: wide_open(),
                fps: 30.0,
            },
            sink,
            SILENT,
        )
    });
    let displacements = clip.unwrap().vertices.displacements;
    displacements
        .as_slice()
        .unwrap()
        .as_chunks::<3>()
        .0
        .to_vec()
}

#[test]
fn opened_lips_part_by_what_the_landmarks_say() {
    let mask = Mask::new(90, 110);
    let (_, opened) = mask.opened();
    let landmarks = &opened.landmarks;
    let ways = moved(&opened.mesh, &landmarks.positions);
    let motion = wide_open();
    for (upper, lower) in [(61, 67), (62, 66), (63, 65)] {
        let [a, b] = [upper, lower].map(|n| ways[landmarks.vertices[n] as usize][1]);
        let expected = motion[[0, upper, 1]] - motion[[0, lower, 1]];
        assert!(
            (a - b) > 0.85 * expected,
            "{upper}: {} of {expected}",
            a - b
        );
    }
    // Between the landmarks no part of the rim lags behind.
    let range = |n: usize| landmarks.positions[n][0];
    for (&u, &l) in opened.upper_rim.iter().zip(&opened.lower_rim) {
        let x = opened.mesh.positions[u as usize][0];
        if x > range(61) && x < range(63) {
            let gap = ways[u as usize][1] - ways[l as usize][1];
            assert!(gap > 0.85 * 0.022, "{x}: {gap}");
        }
    }
}

#[test]
fn lips_that_stay_one_surface_are_not_pulled_apart() {
    let mask = Mask::new(90, 110);
    let mesh = mask.mesh();
    let ways = moved(&mesh, &mask.landmarks);
    let mut posed = mesh.clone();
    for (p, way) in posed.positions.iter_mut().zip(&ways) {
        *p = std::array::from_fn(|i| p[i] + way[i]);
    }
    let located = mask.locate(&mesh);
    let middle = located.positions[62];
    let width = located.positions[54][0] - located.positions[48][0];
    let near = |t: &[u32; 3]| {
        let p = mesh.positions[t[0] as usize];
        (p[0] - middle[0]).hypot(p[1] - middle[1]) < 0.75 * width
    };
    let growth = mesh.face_areas().into_iter().zip(posed.face_areas());
    let growth = growth.zip(&mesh.triangles).filter(|(_, t)| near(t));
    let growth: Vec<f64> = growth.map(|((before, after), _)| after / before).collect();
    let torn = growth.iter().filter(|g| **g > 2.0).count();
    assert!(torn * 200 <= growth.len(), "{torn} of {}", growth.len());
    // The outer borders of the lips still show that the mouth is open.
    let [a, b] = [51, 57].map(|n| ways[located.vertices[n] as usize][1]);
    assert!(a - b > 0.004, "{}", a - b);
}

#[test]
fn a_coarse_mesh_gets_a_fine_rim_on_the_same_surface() {
    let mask = Mask::new(15, 18);
    let (mesh, opened) = mask.opened();
    check(&mesh, &opened);
    let width = mask.landmarks[64][0] - mask.landmarks[60][0];
    let rim = opened.upper_rim.iter();
    let rim: Vec<Vec3> = rim
        .map(|&v| opened.mesh.positions[v as usize].into())
        .collect();
    for ends in rim.windows(2) {
        assert!(ends[0].distance(ends[1]) < 0.08 * width, "{ends:?}");
    }
}

#[test]
fn landmarks_of_the_lower_lip_above_the_seam_go_below_it() {
    let mut mask = Mask::new(90, 110);
    let rest = mask.landmarks.clone();
    for n in 55..60 {
        mask.landmarks[n][1] = rest[62][1] + 0.003;
    }
    let (_, opened) = mask.opened();
    for (rim, n, side) in [(&opened.lower_rim, 57, -1.0), (&opened.upper_rim, 51, 1.0)] {
        let middle = opened.mesh.positions[rim[rim.len() / 2] as usize];
        let apart = opened.landmarks.positions[n][1] - middle[1];
        assert!(side * apart > 0.003, "{n}: {apart}");
    }
    let marks = &opened.landmarks;
    let ways = moved(&opened.mesh, &marks.positions);
    let [a, b] = [62, 66].map(|n| ways[marks.vertices[n] as usize][1]);
    assert!(a - b > 0.85 * 0.022, "{}", a - b);
}

#[test]
fn inner_lips_roll_behind_the_front_of_the_other_lip() {
    for bulge in [0.0, 0.004] {
        // First a flat mouth, then lips that curve down into a valley.
        let lips = |[x, y]: [f32; 2]| {
            let inside = (1.0 - (x / 0.025).powi(2)).max(0.0);
            bulge * inside * (1.0 - (-(y / 0.004).powi(2)).exp()) * (-(y / 0.012).powi(2)).exp()
        };
        let (_, opened) = Mask::new(120, 140).moved(lips).opened();
        let front = &opened.mesh.triangles[..opened.first_lining_triangle];
        let at = |v: u32| Vec3::from(opened.mesh.positions[v as usize]);
        let covers = |p: Vec3| {
            front.iter().any(|t| {
                let [a, b, c] = t.map(at);
                let twice = (b - a).truncate().perp_dot((c - a).truncate());
                let v = (p - a).truncate().perp_dot((c - a).truncate()) / twice;
                let w = (b - a).truncate().perp_dot((p - a).truncate()) / twice;
                let inside = v >= -1e-3 && w >= -1e-3 && v + w <= 1.001;
                inside && a.z + v * (b.z - a.z) + w * (c.z - a.z) > p.z - 1e-4
            })
        };
        let lips = opened.first_lining_triangle..opened.first_inside_triangle;
        assert!(!lips.is_empty());
        for &v in opened.mesh.triangles[lips].as_flattened() {
            assert!(covers(at(v)), "{bulge}: {}", at(v));
        }
    }
}

#[test]
fn an_engine_refuses_a_mouth_that_opens_crookedly_and_opens_a_good_one() {
    let engine = Engine::new(EngineOptions {
        cache: CachePolicy::Off,
        ..EngineOptions::default()
    });
    let engine = engine.unwrap();
    let face = |mask: &Mask| {
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::Positions(mask.landmarks.clone())),
            ..FaceOptions::default()
        };
        engine.find(&mask.mesh(), &options, SILENT).unwrap()
    };
    let good = Mask::new(90, 110);
    assert!(engine.open_mouth(&face(&good), SILENT).is_ok());
    // On the left side the lips meet 5 mm higher.
    let crooked = Mask::new(200, 240).moved(|[x, y]| {
        let ramp = |x: f32| (x / 0.006).clamp(0.0, 1.0);
        let seam = 0.005 * ramp(x) * (1.0 - ramp(x - 0.018));
        if x.abs() < 0.024 {
            -0.008 * (-((y - seam) / 0.0015).powi(2)).exp()
        } else {
            0.0
        }
    });
    let refused = engine.open_mouth(&face(&crooked), SILENT).err();
    let message = refused.map(|error| error.to_string()).unwrap_or_default();
    assert!(message.contains("the mesh is as it was"), "{message}");
}

#[test]
fn a_trial_says_what_is_wrong() {
    let good = MouthTrial {
        parted: 0.9,
        bend_deg: [10.0, 25.0],
        asymmetry: 0.05,
        turned: 0,
    };
    assert!(good.check().is_ok());
    let bad = [
        (
            MouthTrial {
                parted: 0.7,
                ..good
            },
            "part by 0.70",
        ),
        (
            MouthTrial {
                asymmetry: 0.2,
                ..good
            },
            "differ by 0.20",
        ),
        (
            MouthTrial {
                bend_deg: [10.0, 60.0],
                ..good
            },
            "bends by 60",
        ),
    ];
    for (trial, words) in bad {
        let error = trial.check().unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}
