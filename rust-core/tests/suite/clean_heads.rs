//! Heads of clean quads under the largest motions of a face.

use anyface::{
    head::{HeadMaker, MadeHead},
    mesh::PartChoices,
};

use crate::head::{LIDS, Points, closing, moved, opening, prepared, sum};

fn of_seed(seed: u64) -> MadeHead {
    let maker = HeadMaker::open(None).unwrap();
    maker.mesh(&maker.random(seed), true).unwrap()
}

/// Triangles of what is seen of the skin that look the other way afterwards.
fn turned_over(made: &MadeHead, by: &Points) -> usize {
    let across = |places: [[f32; 3]; 3]| {
        let [a, b, c] = places.map(|p| p.map(f64::from));
        let [u, v]: [[f64; 3]; 2] = [b, c].map(|p| std::array::from_fn(|n| p[n] - a[n]));
        [
            u[1] * v[2] - u[2] * v[1],
            u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0],
        ]
    };
    let is_seen = |name: &str| name == "skin" || name == "lips";
    let seen = made.materials.iter().filter(|(name, _)| is_seen(name));
    let faces = seen.flat_map(|(_, faces)| &made.faces[faces.clone()]);
    let triangles = faces.flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]);
    let turned = triangles.filter(|t| {
        let rest = t.map(|v| made.mesh.positions[v as usize]);
        let now = t.map(|v| sum(made.mesh.positions[v as usize], by[v as usize]));
        let (rest, now) = (across(rest), across(now));
        (0..3).map(|n| rest[n] * now[n]).sum::<f64>() < 0.0
    });
    turned.count()
}

#[test]
fn shut_lids_meet_and_nothing_turns_over() {
    for seed in 1..6 {
        let made = of_seed(seed);
        let marks = made.landmarks.positions;
        let face = prepared(&made.mesh, &marks, PartChoices::default());
        let by = moved(&face, &closing(&marks, &LIDS, 0.0));
        for (upper, lower) in LIDS {
            let [a, b] = [upper, lower].map(|n| {
                let vertex = made.landmarks.vertices[n] as usize;
                made.mesh.positions[vertex][1] + by[vertex][1]
            });
            let gap_mm = 1e3 * (a - b);
            assert!(
                gap_mm < 1.0,
                "seed {seed}: {upper} over {lower}: {gap_mm} mm"
            );
        }
        // Of 7,000 triangles; these few lie in the corners of lids and lips.
        let turned = turned_over(&made, &by);
        assert!(turned <= 10, "seed {seed}: {turned}");
    }
}

#[test]
fn an_open_mouth_shows_teeth_and_turns_nothing_over() {
    for seed in 1..6 {
        let made = of_seed(seed);
        let face = prepared(
            &made.mesh,
            &made.landmarks.positions,
            PartChoices::default(),
        );
        let by = moved(&face, &opening());
        let middle = |name: &str| {
            let (_, rows) = made
                .objects
                .iter()
                .find(|(known, _)| known == name)
                .unwrap();
            rows.clone().map(|v| by[v][1]).sum::<f32>() / rows.len() as f32
        };
        assert!(
            middle("teeth_lower") < -4e-3,
            "seed {seed}: the lower teeth follow the jaw"
        );
        assert!(
            middle("teeth_upper").abs() < 1e-3,
            "seed {seed}: the upper ones stay"
        );
        // Of 7,000 triangles; these few lie in the corners of lids and lips.
        let turned = turned_over(&made, &by);
        assert!(turned <= 10, "seed {seed}: {turned}");
    }
}
