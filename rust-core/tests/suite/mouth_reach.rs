//! The engine measures which parts of speech a mouth cannot show, and says so.

use anyface::{
    Face, MouthReach,
    job::SILENT,
    mesh::{Mesh, PartChoices},
};

use crate::head;

fn face(mesh: &Mesh, landmarks: &[[f32; 3]]) -> Face {
    head::prepared(mesh, landmarks, PartChoices::default())
}

fn reach(face: &Face) -> MouthReach {
    let reach = head::engine().mouth_reach(face, SILENT).unwrap();
    reach.expect("lips that are not one surface")
}

#[test]
fn the_default_head_shows_all() {
    let whole = reach(&face(&head::head(), &head::landmarks()));
    assert!(whole.has_teeth && whole.parted > 0.8, "{whole:?}");
    assert_eq!(whole.sentences(), Vec::<String>::new(), "{whole:?}");
}

#[test]
fn lips_that_are_modelled_far_apart_do_not_meet() {
    let shut = face(&head::head(), &head::landmarks());
    let half = head::opening()
        .iter()
        .map(|p| p.map(|x| 0.5 * x))
        .collect::<Vec<_>>();
    let moved = head::moved(&shut, &half);
    let mut mesh = head::head();
    for (p, d) in mesh.positions.iter_mut().zip(&moved) {
        (0..3).for_each(|i| p[i] += d[i]);
    }
    let mut marks = head::landmarks();
    for (mark, v) in marks.iter_mut().zip(shut.landmarks.vertices) {
        (0..3).for_each(|i| mark[i] += moved[v as usize][i]);
    }
    let open = reach(&face(&mesh, &marks));
    assert!(open.apart_m > 5e-3, "{open:?}");
    let said = open.sentences();
    assert!(
        said.iter().any(|s| s.contains("p, b and m look")),
        "{said:?}"
    );
    assert!(said.iter().any(|s| s.contains("f and v look")), "{said:?}");
}

#[test]
fn a_board_before_the_lower_lip_hides_it() {
    let marks = head::landmarks();
    let mut mesh = head::head();
    let first = mesh.positions.len() as u32;
    let ([right, left], lip, chin) = ([marks[48], marks[54]], marks[66], marks[8]);
    let z = marks[57][2] + 0.02;
    for [x, y] in [
        [right[0], lip[1]],
        [left[0], lip[1]],
        [left[0], chin[1]],
        [right[0], chin[1]],
    ] {
        mesh.positions.push([x, y, z]);
    }
    mesh.triangles
        .extend([[0, 2, 1], [0, 3, 2]].map(|t: [u32; 3]| t.map(|v| v + first)));
    let covered = reach(&face(&mesh, &marks));
    assert_eq!(covered.hidden, [false, true], "{covered:?}");
    let said = covered.sentences();
    assert!(
        said.iter().any(|s| s.contains("before the lower lip")),
        "{said:?}"
    );
}
