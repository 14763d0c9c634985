//! Damage to a mesh must not change the result. The tests compare the same motion on the damaged
//! and on the sound head, vertex by vertex.

use anyface::mesh::{Mesh, PartChoices};

use super::head::{LIDS, Points, closing, head, landmarks, mm, moved, opening, prepared, quantile};

/// An open mouth together with a blink: the largest motions in speech.
fn motion() -> Points {
    let (open, blink) = (opening(), closing(&landmarks(), &LIDS, 0.0));
    let both = open.iter().zip(&blink);
    both.map(|(a, b)| std::array::from_fn(|i| a[i] + b[i]))
        .collect()
}

fn result(mesh: &Mesh) -> Points {
    moved(
        &prepared(mesh, &landmarks(), PartChoices::default()),
        &motion(),
    )
}

/// Distances in millimetres between the damaged and the sound result, for vertices of the sound
/// head that still have a face.
fn differences(damaged: &Mesh) -> Vec<f32> {
    let sound = result(&head());
    let got = result(damaged);
    let mut used = vec![false; damaged.positions.len()];
    damaged
        .triangles
        .iter()
        .flatten()
        .for_each(|&v| used[v as usize] = true);
    let both = sound.iter().zip(&got).zip(used);
    both.filter(|(_, used)| *used)
        .map(|((a, b), _)| mm(*a, *b))
        .collect()
}

/// Expects 95 of 100 vertices within `usual` mm of the sound result and all within `worst`.
fn close(damaged: &Mesh, usual: f32, worst: f32) {
    let distances = differences(damaged);
    let (most, all) = (quantile(distances.clone(), 0.95), quantile(distances, 1.0));
    assert!(
        most < usual && all < worst,
        "95th percentile {most} mm, largest {all} mm"
    );
}

fn near_landmark(p: [f32; 3], within_mm: f32) -> bool {
    landmarks().iter().any(|&l| mm(l, p) < within_mm)
}

/// The head without the triangles that `drop` selects by their number and centre.
fn without(drop: impl Fn(usize, [f32; 3]) -> bool) -> Mesh {
    let mut mesh = head();
    let centre = |t: &[u32; 3]| -> [f32; 3] {
        std::array::from_fn(|i| {
            t.iter()
                .map(|&v| mesh.positions[v as usize][i])
                .sum::<f32>()
                / 3.0
        })
    };
    let faces = mesh.triangles.iter().enumerate();
    let faces = faces.filter(|(f, t)| !drop(*f, centre(t)));
    mesh.triangles = faces.map(|(_, t)| *t).collect();
    mesh
}

#[test]
fn a_scan_full_of_small_tears_moves_as_the_sound_head() {
    let torn = without(|f, p| f % 29 == 0 && !near_landmark(p, 5.0));
    close(&torn, 0.3, 2.0);
}

#[test]
fn a_hole_in_the_cheek_is_no_matter_beyond_its_rim() {
    let pierced = without(|_, p| mm(p, [0.0523, -0.0363, 0.0496]) < 12.0);
    assert!(pierced.triangles.len() + 10 < head().triangles.len());
    close(&pierced, 0.2, 4.0);
}

#[test]
fn fins_on_edges_follow_their_edge_and_change_nothing_else() {
    let mut mesh = head();
    let skin = mesh.triangles.len() / 3;
    let roots: Vec<[u32; 2]> = (0..60)
        .map(|k| mesh.triangles[k * (skin / 60)])
        .map(|t| [t[0], t[1]])
        .collect();
    for &[a, b] in &roots {
        let p = mesh.positions[a as usize];
        mesh.triangles.push([a, b, mesh.positions.len() as u32]);
        mesh.positions.push([p[0], p[1], p[2] + 0.001]);
    }
    let sound = head().positions.len();
    close(&mesh, 0.1, 0.5);
    let got = result(&mesh);
    for (k, [a, _]) in roots.iter().enumerate() {
        let apart = mm(got[sound + k], got[*a as usize]);
        assert!(apart < 1.0, "fin {k}: {apart} mm from its root");
    }
}

#[test]
fn faces_turned_inside_out_change_nothing_that_shows() {
    let mut mesh = head();
    mesh.triangles
        .iter_mut()
        .step_by(3)
        .for_each(|t| t.swap(1, 2));
    close(&mesh, 0.01, 0.01);
}

#[test]
fn vertices_of_collapsed_faces_go_with_the_skin_about_them() {
    let mut mesh = head();
    let sound = mesh.positions.len();
    let roots: Vec<u32> = (0..40).map(|k| mesh.triangles[97 * k][0]).collect();
    for &root in &roots {
        let new = mesh.positions.len() as u32;
        mesh.positions.push(mesh.positions[root as usize]);
        mesh.triangles.extend([[root, root, new], [root, new, new]]);
    }
    close(&mesh, 0.01, 0.01);
    let got = result(&mesh);
    for (k, &root) in roots.iter().enumerate() {
        let apart = mm(got[sound + k], got[root as usize]);
        assert!(apart < 0.01, "vertex {k}: {apart} mm from its root");
    }
}

#[test]
fn a_soup_of_triangles_holds_together() {
    let whole = head();
    let mut soup = Mesh::default();
    for t in &whole.triangles {
        let first = soup.positions.len() as u32;
        soup.positions
            .extend(t.map(|v| whole.positions[v as usize]));
        soup.triangles.push([first, first + 1, first + 2]);
    }
    let (sound, got) = (result(&whole), result(&soup));
    let corners = whole.triangles.iter().flatten().zip(&got);
    let distances: Vec<f32> = corners.map(|(&v, &b)| mm(sound[v as usize], b)).collect();
    let (most, all) = (quantile(distances.clone(), 0.95), quantile(distances, 1.0));
    assert!(
        most < 0.01 && all < 0.01,
        "95th percentile {most} mm, largest {all} mm"
    );
}

#[test]
fn vertices_in_no_face_rest_and_change_no_bit() {
    let mut mesh = head();
    let sound = mesh.positions.len();
    mesh.positions.extend([[0.0, -0.05, 0.09], [9.0; 3]]);
    let (expected, got) = (result(&head()), result(&mesh));
    assert_eq!(got[..sound], expected[..]);
    assert_eq!(got[sound..], [[0.0; 3]; 2]);
}

#[test]
fn of_two_heads_the_one_with_the_landmarks_speaks() {
    let mut mesh = head();
    let sound = mesh.positions.len();
    let other = head();
    mesh.positions
        .extend(other.positions.iter().map(|p| [p[0] + 0.4, p[1], p[2]]));
    mesh.triangles
        .extend(other.triangles.iter().map(|t| t.map(|v| v + sound as u32)));
    let (expected, got) = (result(&other), result(&mesh));
    let off = expected
        .iter()
        .zip(&got)
        .map(|(a, b)| mm(*a, *b))
        .fold(0.0, f32::max);
    assert!(off < 0.01, "{off} mm");
    assert!(got[sound..].iter().all(|d| *d == [0.0; 3]));
}

#[test]
fn a_mouth_bag_grown_to_the_lips_lets_them_part() {
    let mesh = head();
    let face = prepared(&mesh, &landmarks(), PartChoices::default());
    let got = moved(&face, &opening());
    let [upper, lower] = [62, 66].map(|n| got[face.landmarks.vertices[n] as usize][1]);
    assert!(upper - lower > 0.8 * 0.018, "{}", upper - lower);
    let most = got.iter().map(|d| mm(*d, [0.0; 3])).fold(0.0, f32::max);
    assert!(
        most < 30.0,
        "the chin's landmark moves 22.8 mm, a vertex {most} mm"
    );
}
