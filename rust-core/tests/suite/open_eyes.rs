//! Cuts free eyes that are one surface with their lids. The mesh is the front of the default head
//! as one sheet.

use anyface::{
    Face,
    face::{FaceOptions, Lids},
    job::SILENT,
    mesh::{FrontView, LandmarkSource, Mesh},
};

use crate::head::{engine, head, landmarks};

/// Distance between the vertices of the sheet, metres.
const STEP: f32 = 1.2e-3;

/// The front of the default head as one surface without a slit.
fn sheet() -> Mesh {
    let head = head();
    let (low, high) = ([-0.08, -0.12], [0.08, 0.08]);
    let mut view = FrontView::new(low, high, STEP);
    head.triangles
        .iter()
        .for_each(|t| view.draw(t.map(|v| head.positions[v as usize]), 1));
    let (columns, rows) = (view.columns(), view.rows());
    let mut mesh = Mesh {
        positions: Vec::new(),
        triangles: Vec::new(),
    };
    for (row, column) in (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c))) {
        let depth = view.depth(column, row);
        let at = |i: usize, cell: usize| low[i] + STEP * (cell as f32 + 0.5);
        let depth = if depth.is_finite() { depth } else { -0.02 };
        mesh.positions.push([at(0, column), at(1, row), depth]);
    }
    for (row, column) in (0..rows - 1).flat_map(|r| (0..columns - 1).map(move |c| (r, c))) {
        let a = (row * columns + column) as u32;
        let [b, c, d] = [a + 1, a + columns as u32 + 1, a + columns as u32];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

fn find_face(mesh: &Mesh) -> Face {
    let options = FaceOptions {
        landmarks: Some(LandmarkSource::Positions(landmarks())),
        ..FaceOptions::default()
    };
    engine().find(mesh, &options, SILENT).unwrap()
}

fn area(mesh: &Mesh, triangles: std::ops::Range<usize>) -> f64 {
    let areas = mesh.triangles[triangles].iter().map(|t| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize].map(f64::from));
        let [u, v]: [[f64; 3]; 2] = [b, c].map(|p| std::array::from_fn(|i| p[i] - a[i]));
        let cross = [
            u[1] * v[2] - u[2] * v[1],
            u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0],
        ];
        0.5 * cross.iter().map(|x| x * x).sum::<f64>().sqrt()
    });
    areas.sum()
}

#[test]
fn eyes_that_are_one_with_their_lids_are_cut_free_and_blink() {
    let mesh = sheet();
    let face = find_face(&mesh);
    assert_eq!(face.lids(), [Lids::Joined; 2]);
    let engine = engine();
    let opened = engine.open_eyes(&face, SILENT).unwrap();
    let count = mesh.positions.len();
    assert_eq!(opened.mesh.positions[..count], mesh.positions[..]);
    // At rest the surface is the same, and each triangle lies where its source says.
    let [before, after] = [
        area(&mesh, 0..mesh.triangles.len()),
        area(&opened.mesh, 0..opened.first_lining_triangle),
    ];
    assert!((after / before - 1.0).abs() < 1e-5, "{before} {after}");
    for (t, source) in opened.mesh.triangles[..opened.first_lining_triangle]
        .iter()
        .zip(&opened.triangle_sources)
    {
        let old = mesh.triangles[source.triangle as usize];
        for (v, shares) in t.iter().zip(source.corners) {
            for i in 0..3 {
                let corners = old.iter().zip(shares);
                let mixed: f32 = corners
                    .map(|(v, share)| share * mesh.positions[*v as usize][i])
                    .sum();
                let place = opened.mesh.positions[*v as usize][i];
                assert!((mixed - place).abs() < 1e-5, "{mixed} {place}");
            }
        }
    }
    for (vertex, sources) in opened.vertex_sources.iter().enumerate() {
        let sum: f32 = sources.iter().map(|(_, share)| share).sum();
        assert!((sum - 1.0).abs() < 1e-5, "vertex {vertex}: {sum}");
    }
    let trials = engine.eye_trials(&face, &opened, SILENT).unwrap();
    for trial in trials {
        assert!(trial.in_sight < 0.05 && trial.turned < 0.02, "{trial:?}");
    }
    let after = engine
        .prepare(&opened.mesh, &opened.face_options(&face), SILENT)
        .unwrap();
    assert_eq!(after.lids(), [Lids::Close; 2]);
}

#[test]
fn eyes_that_blink_already_are_left_alone() {
    let error = engine().open_eyes(&find_face(&head()), SILENT).unwrap_err();
    assert!(error.to_string().contains("whose lids close"), "{error}");
}
