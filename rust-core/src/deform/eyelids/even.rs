//! Skin about the lids that goes evenly between what lies round it.
//!
//! What is even is how far a vertex turns about the axis of its eye, how much further out it goes and how far across:
//! where all that lies round it turns with a lid, so does the skin between. Lengths are canonical centimetres.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::axis::{elevation, turn};
use crate::{
    Result,
    operators::{SparseCholesky, sparse::Csr},
};

/// Shares below this are left out.
const LEAST_SHARE: f64 = 1e-3;
/// From this distance from the axis of the eye on places turn about it.
const TURNS_FROM_CM: f32 = 1.0;

/// A vertex and where it lies in the neutral face, in the eye's frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Resting {
    pub vertex: u32,
    pub place: [f32; 3],
}

/// Vertices that go between others, by fixed shares.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct EvenSkin {
    vertices: Vec<Resting>,
    /// What they lie between.
    round: Vec<Resting>,
    /// `[vertices + 1]`: where the shares of each begin.
    start: Vec<u32>,
    /// Numbers in `round`.
    between: Vec<u32>,
    shares: Vec<f32>,
}

impl EvenSkin {
    /// Of `inside`, rising, with the `others` that move like each of them; `edges`: of the whole surface, each with
    /// its length; `place`: of a vertex. Where the inside touches nothing else, it is left out.
    pub(super) fn of(
        inside: &[u32],
        edges: &[(u32, u32, f32)],
        others: &BTreeMap<u32, Vec<u32>>,
        place: impl Fn(u32) -> [f32; 3],
    ) -> Result<EvenSkin> {
        let (inside, edges) = touching(inside, edges);
        let row = |v: u32| inside.binary_search(&v).ok();
        let mut entries = Vec::new();
        let mut round: BTreeMap<u32, Vec<(usize, f64)>> = BTreeMap::new();
        for &(a, b, length) in &edges {
            let weight = 1.0 / f64::from(length).max(1e-3);
            for (from, to) in [(a, b), (b, a)] {
                let Some(i) = row(from) else {
                    continue;
                };
                entries.push((i as u32, i as u32, weight));
                match row(to) {
                    Some(j) => entries.push((i as u32, j as u32, -weight)),
                    None => round.entry(to).or_default().push((i, weight)),
                }
            }
        }
        let (size, columns) = (inside.len(), round.len());
        if size == 0 {
            return Ok(EvenSkin::default());
        }
        let solver = SparseCholesky::factor_rounded(&Csr::from_triplets(size, size, &entries))?;
        let mut shares = vec![0.0; size * columns];
        for (column, own) in shares.chunks_mut(size).zip(round.values()) {
            own.iter().for_each(|&(i, weight)| column[i] += weight);
        }
        solver.solve_in_place(&mut shares, columns);
        let resting = |vertex: u32, like: u32| Resting {
            vertex,
            place: place(like),
        };
        let mut even = EvenSkin::default();
        even.round.extend(round.keys().map(|v| resting(*v, *v)));
        even.start.push(0);
        for (i, &v) in inside.iter().enumerate() {
            let own = (0..columns).map(|column| (column as u32, shares[column * size + i]));
            let own: Vec<(u32, f64)> = own.filter(|(_, share)| *share > LEAST_SHARE).collect();
            let whole: f64 = own.iter().map(|(_, share)| share).sum();
            for like in [v].iter().chain(others.get(&v).into_iter().flatten()) {
                even.vertices.push(resting(*like, v));
                even.between.extend(own.iter().map(|(to, _)| to));
                even.shares
                    .extend(own.iter().map(|(_, share)| (share / whole) as f32));
                even.start.push(even.between.len() as u32);
            }
        }
        Ok(even)
    }

    /// Vertices that must be known for it.
    pub(super) fn needs(&self) -> impl Iterator<Item = u32> {
        self.round.iter().map(|v| v.vertex)
    }

    /// The same where only some vertices are left; `new` gives their numbers, also those of all that it needs.
    pub(super) fn renumbered(&self, new: impl Fn(u32) -> Option<u32>) -> EvenSkin {
        let mut left = EvenSkin {
            round: self.round.clone(),
            ..EvenSkin::default()
        };
        for v in &mut left.round {
            v.vertex = new(v.vertex).expect("what is needed is left");
        }
        left.start.push(0);
        for (i, v) in self.vertices.iter().enumerate() {
            let Some(vertex) = new(v.vertex) else {
                continue;
            };
            let own = self.start[i] as usize..self.start[i + 1] as usize;
            left.vertices.push(Resting { vertex, ..*v });
            left.between.extend(&self.between[own.clone()]);
            left.shares.extend(&self.shares[own]);
            left.start.push(left.between.len() as u32);
        }
        left
    }

    /// Where the vertices go, from where `moved` says that those round them go: displacements in the eye's frame.
    pub(super) fn moves(
        &self,
        moved: impl Fn(u32) -> [f32; 3],
    ) -> impl Iterator<Item = (Resting, [f32; 3])> {
        let round = self.round.iter();
        let round: Vec<[f32; 3]> = round.map(|v| turned(v.place, moved(v.vertex))).collect();
        self.vertices.iter().enumerate().map(move |(i, v)| {
            let own = self.start[i] as usize..self.start[i + 1] as usize;
            let mut even = [0.0f32; 3];
            for (n, share) in self.between[own.clone()].iter().zip(&self.shares[own]) {
                (0..3).for_each(|k| even[k] += share * round[*n as usize][k]);
            }
            (*v, unturned(v.place, even))
        })
    }
}

/// How much of a turn about the axis of the eye counts at a place: so near to the axis turns say little.
pub(super) fn near_axis(place: [f32; 3]) -> f32 {
    (place[1].hypot(place[2]) / TURNS_FROM_CM).clamp(1e-3, 1.0)
}

/// How far across a displacement goes, how far it turns about the axis and how much further from it.
fn turned(place: [f32; 3], moved: [f32; 3]) -> [f32; 3] {
    let now: [f32; 3] = std::array::from_fn(|i| place[i] + moved[i]);
    let angle = elevation(now) - elevation(place);
    let whole = std::f32::consts::TAU;
    let angle = angle - whole * (angle / whole).round();
    let further = now[1].hypot(now[2]) - place[1].hypot(place[2]);
    [moved[0], near_axis(place) * angle, further]
}

/// The displacement that goes so far across, turns and goes further from the axis.
fn unturned(place: [f32; 3], [across, angle, further]: [f32; 3]) -> [f32; 3] {
    let now = turn(place, angle / near_axis(place));
    let scale = 1.0 + further / place[1].hypot(place[2]).max(1e-3);
    [across, scale * now[1] - place[1], scale * now[2] - place[2]]
}

/// What of the inside is connected to something else, and the edges that touch it.
fn touching(inside: &[u32], edges: &[(u32, u32, f32)]) -> (Vec<u32>, Vec<(u32, u32, f32)>) {
    let is_inside = |v: &u32| inside.binary_search(v).is_ok();
    let mut reached = vec![false; inside.len()];
    let edges: Vec<(u32, u32, f32)> = edges
        .iter()
        .copied()
        .filter(|(a, b, _)| is_inside(a) || is_inside(b))
        .collect();
    loop {
        let mut changed = false;
        for (a, b, _) in &edges {
            for (from, to) in [(a, b), (b, a)] {
                let is_reached = inside.binary_search(from).map_or(true, |n| reached[n]);
                if let (true, Ok(to)) = (is_reached, inside.binary_search(to)) {
                    changed |= !std::mem::replace(&mut reached[to], true);
                }
            }
        }
        if !changed {
            break;
        }
    }
    let left = inside.iter().zip(&reached).filter(|(_, reached)| **reached);
    let left: Vec<u32> = left.map(|(v, _)| *v).collect();
    let is_left = |v: &u32| left.binary_search(v).is_ok();
    let edges = edges
        .into_iter()
        .filter(|(a, b, _)| is_left(a) || is_left(b));
    let edges = edges.collect();
    (left, edges)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: [f32; 3] = [0.2, 0.3, 1.0];

    #[test]
    fn a_row_of_vertices_goes_evenly_between_its_ends() {
        let edges: Vec<_> = (0..4).map(|v| (v, v + 1, 1.0)).collect();
        let others = BTreeMap::from([(2, vec![5])]);
        let even = EvenSkin::of(&[1, 2, 3], &edges, &others, |_| PLACE).unwrap();
        let by = |angle: f32| {
            let now = turn(PLACE, angle);
            std::array::from_fn(|i| now[i] - PLACE[i])
        };
        let moved = |v: u32| by(if v == 4 { 0.8 } else { 0.0 });
        let went: Vec<_> = even.moves(moved).collect();
        for ((v, d), (expected, angle)) in went.iter().zip([(1, 0.2), (2, 0.4), (5, 0.4), (3, 0.6)])
        {
            assert_eq!(v.vertex, expected);
            let wanted: [f32; 3] = by(angle);
            assert!(
                (0..3).all(|i| (d[i] - wanted[i]).abs() < 1e-5),
                "{expected}: {d:?}"
            );
        }
        let few = even.renumbered(|v| [0, 2, 4].iter().position(|x| *x == v).map(|n| n as u32));
        let went: Vec<_> = few.moves(|v| moved(2 * v)).collect();
        assert_eq!((went.len(), went[0].0.vertex), (1, 1));
    }

    #[test]
    fn what_touches_nothing_else_is_left_out() {
        let even = EvenSkin::of(&[1, 2], &[(1, 2, 1.0)], &BTreeMap::new(), |_| PLACE).unwrap();
        assert_eq!(even, EvenSkin::default());
    }
}
