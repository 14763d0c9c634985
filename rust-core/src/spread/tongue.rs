//! What a tongue that is a part of its own does beside its jaw.
//!
//! Fields over its own length raise its tip, middle and back, and bring its tip forward. Lengths are canonical
//! centimetres, on a mouth 5 cm wide; +y is up, +z out of the face.

use std::{array, ops::Range};

use ndarray::{Array3, ArrayView1, ArrayView2, ArrayViewMut2, Axis};
use rayon::prelude::*;

use crate::{
    face::Face,
    mesh::{PartRole, Similarity},
    rig::parts::{TongueFound, middle_of_lips, tongue},
    speech::TONGUE_PLACES,
};

/// Where on the tongue's length, 0 at the root and 1 at the tip, middle and back rise most, and how far to either side
/// they rise at all.
const MIDDLE: (f32, f32) = (0.6, 0.45);
const BACK: (f32, f32) = (0.25, 0.35);
/// From where to where on its length the tip's share rises from 0 to 1.
const TIP: (f32, f32) = (0.4, 0.95);
/// From here on the surface counts as the tip's.
const TIP_TOP: f32 = 0.88;
/// From here on the tongue lies below the edge of the upper teeth where its tip touches them.
const BELOW_TEETH: f32 = 0.75;
/// Half the length whose top counts for middle and back.
const PLACE: f32 = 0.15;
/// Share of a rise that the tongue's underside takes part in: the floor of the mouth holds it.
const UNDERSIDE: f32 = 0.35;
/// The farthest that a place rises or the tip goes down and back.
const RISE_CM: f32 = 1.5;
const BACKWARD_CM: f32 = 0.3;
/// The ridge and the palate above the edge of the upper teeth: the crown of an upper incisor is about 1 cm long, a
/// palate about 1.5 cm deep.
const RIDGE_CM: f32 = 0.6;
const PALATE_CM: f32 = 1.5;
/// The skin of the tongue stays so far off teeth and palate.
const CLEAR_CM: f32 = 0.05;
/// Where no upper teeth are found, their inner face lies so far behind the lips.
const INNER_CM: f32 = 1.15;
/// How far apart the faces of the front teeth are at most.
const THICK_CM: f32 = 1.2;

/// Steps by which the shares of a tongue that stands somewhere are found.
const FIRST_STEP: f32 = 0.25;
const LAST_STEP: f32 = 1e-4;

/// Why the tongue of a face does not speak, where it does not.
pub fn tongue_note(face: &Face) -> Option<&'static str> {
    let (positions, landmarks) = centimetres(face);
    tongue(&positions, &face.parts, &landmarks).complaint()
}

/// Positions `[V]` and landmarks of a face, canonical centimetres.
fn centimetres(face: &Face) -> (Vec<[f32; 3]>, [[f32; 3]; 68]) {
    let cm = |p: [f32; 3]| face.to_canonical.apply(p).map(|x| 100.0 * x);
    let positions = face.mesh.positions.iter().map(|&p| cm(p)).collect();
    (positions, face.landmarks.positions.map(cm))
}

/// The tongue of a face, which may move by itself.
#[derive(Debug, Clone)]
pub(crate) struct FaceTongue {
    vertices: Vec<TongueVertex>,
    room: Room,
    to_canonical: Similarity,
}

#[derive(Debug, Clone)]
struct TongueVertex {
    number: usize,
    rest: [f32; 3],
    /// Place on the tongue's length, 0 at the root, 1 at the tip.
    along: f32,
    /// Shares of the rise of tip, middle and back, and of the tip's way forward.
    shares: [f32; 4],
}

/// What lies around the tongue.
#[derive(Debug, Clone, PartialEq)]
struct Room {
    /// Height of the roof over the tip, the middle and the back, and where these lie along z.
    roof: [f32; 3],
    places: [f32; 3],
    /// Height of the edge of the upper front teeth.
    edge: f32,
    /// Inner face of the upper front teeth along z.
    inner: f32,
    /// A fifth of the mouth's width.
    unit: f32,
}

impl FaceTongue {
    /// The tongue of a face, or why it has none that moves.
    pub(crate) fn find(face: &Face) -> Result<FaceTongue, &'static str> {
        let (positions, landmarks) = centimetres(face);
        let found = tongue(&positions, &face.parts, &landmarks);
        let found = match found {
            TongueFound::Own(found) => found,
            other => return Err(other.complaint().unwrap_or_default()),
        };
        let lips = middle_of_lips(&landmarks);
        let unit = (0..3)
            .map(|i| (landmarks[48][i] - landmarks[54][i]).powi(2))
            .sum::<f32>()
            .sqrt()
            / 5.0;
        let vertices = vertices(&positions, &found.vertices);
        let skull: Vec<[f32; 3]> = {
            let lists = face.parts.connected.vertices().into_iter();
            let parts = face.parts.parts.iter().zip(lists);
            let parts = parts
                .filter(|(part, list)| part.role == PartRole::Skull && *list != found.vertices);
            let numbers = parts.flat_map(|(_, list)| list);
            numbers.map(|v| positions[v as usize]).collect()
        };
        Ok(FaceTongue {
            room: Room::find(&vertices, &skull, lips, unit),
            vertices,
            to_canonical: face.to_canonical,
        })
    }

    /// The numbers of its vertices in the mesh.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = usize> + '_ {
        self.vertices.iter().map(|vertex| vertex.number)
    }

    /// The same where the mesh is known by some of its vertices alone, rising; `None` where these lack one of the tongue's.
    pub(crate) fn among(mut self, known: &[usize]) -> Option<FaceTongue> {
        for vertex in &mut self.vertices {
            vertex.number = known.binary_search(&vertex.number).ok()?;
        }
        Some(self)
    }

    /// Adds what the tongue does, `rows` `[t, 4]`, to the displacements `[t, V, 3]` of the mesh, its own units.
    pub(crate) fn speak(&self, rows: ArrayView2<'_, f32>, moved: &mut Array3<f32>) {
        let frames = moved.axis_iter_mut(Axis(0)).into_par_iter();
        frames
            .zip(rows.axis_iter(Axis(0)))
            .filter(|(_, row)| row.iter().any(|x| *x != 0.0))
            .for_each(|(frame, row)| self.speak_frame(frame, row));
    }

    /// Where displacements `[V, 3]` of the mesh, its own units, take the tongue.
    fn now(&self, frame: ArrayView2<'_, f32>) -> Vec<[f32; 3]> {
        let per_unit = 100.0 * self.to_canonical.scale as f32;
        let now = self.vertices.iter().map(|vertex| {
            let moved = frame.row(vertex.number);
            let moved = self.to_canonical.rotate([moved[0], moved[1], moved[2]]);
            array::from_fn(|i| vertex.rest[i] + per_unit * moved[i])
        });
        now.collect()
    }

    /// What the tongue does, shares as a row of [`FaceTongue::speak`] has them, where the mesh stands as in `shown`
    /// `[V, 3]` and its jaw alone brings it to `jaw` `[V, 3]`, mesh units.
    pub(super) fn shares_of(
        &self,
        shown: ArrayView2<'_, f32>,
        jaw: ArrayView2<'_, f32>,
    ) -> [f32; TONGUE_PLACES] {
        let rests = |vertex: &TongueVertex| shown.row(vertex.number).iter().all(|x| *x == 0.0);
        if self.vertices.iter().all(rests) {
            // Nobody has moved it, whatever the jaw does.
            return [0.0; TONGUE_PLACES];
        }
        let (shown, jaw) = (self.now(shown), self.now(jaw));
        let off = |row: &[f32; TONGUE_PLACES]| -> f32 {
            let by = self.displacements(&jaw, ArrayView1::from(row));
            let each = shown.iter().zip(&jaw).zip(&by);
            let squares = each.map(|((shown, jaw), by)| {
                let left: [f32; 3] = array::from_fn(|i| shown[i] - jaw[i] - by[i]);
                left.iter().map(|x| x * x).sum::<f32>()
            });
            squares.sum()
        };
        let mut row = [0.0; TONGUE_PLACES];
        let mut least = off(&row);
        let mut step = FIRST_STEP;
        while step > LAST_STEP {
            let before = least;
            for place in 0..TONGUE_PLACES {
                for by in [step, -step] {
                    let mut other = row;
                    other[place] = (row[place] + by).clamp(0.0, 1.0);
                    let left = off(&other);
                    if left < least {
                        (row, least) = (other, left);
                    }
                }
            }
            if least == before {
                step *= 0.5;
            }
        }
        row
    }

    fn speak_frame(&self, mut frame: ArrayViewMut2<'_, f32>, row: ArrayView1<'_, f32>) {
        let per_unit = 100.0 * self.to_canonical.scale as f32;
        let now = self.now(frame.view());
        let to_mesh = self.to_canonical.inverse();
        for (vertex, by) in self.vertices.iter().zip(self.displacements(&now, row)) {
            let by = to_mesh.rotate(by);
            let mut moved = frame.row_mut(vertex.number);
            for i in 0..3 {
                moved[i] += by[i] / per_unit;
            }
        }
    }

    /// What each vertex of the tongue, which its jaw has brought to `now`, does beside it.
    fn displacements(&self, now: &[[f32; 3]], row: ArrayView1<'_, f32>) -> Vec<[f32; 3]> {
        let Room {
            roof,
            edge,
            inner,
            unit,
            ..
        } = self.room;
        let share = |place: usize| row[place].clamp(0.0, 1.0);
        // A tip is in one place at a time.
        let (mut ridge, mut between) = (share(0), share(3));
        let both = (ridge + between).max(1.0);
        (ridge, between) = (ridge / both, between / both);
        let rise = |from: f32, to: f32| (to - from).clamp(0.0, RISE_CM * unit);
        let forward = |from: f32, to: f32| (to - from).clamp(-BACKWARD_CM * unit, RISE_CM * unit);
        let clear = CLEAR_CM * unit;
        let tip = self
            .vertices
            .iter()
            .zip(now)
            .map(|(_, p)| p[2])
            .fold(f32::NEG_INFINITY, f32::max);
        let to_ridge = [
            rise(self.top(now, TIP_TOP..2.0), roof[0]),
            forward(tip, inner - clear),
        ];
        let below = edge - clear - self.top(now, BELOW_TEETH..2.0);
        let to_edge = [
            below.clamp(-BACKWARD_CM * unit, RISE_CM * unit),
            forward(tip, inner - clear),
        ];
        let of_tip: [f32; 2] = std::array::from_fn(|i| ridge * to_ridge[i] + between * to_edge[i]);
        let near = |(at, _): (f32, f32)| at - PLACE..at + PLACE;
        let middle = share(1) * rise(self.top(now, near(MIDDLE)), roof[1]);
        let back = share(2) * rise(self.top(now, near(BACK)), roof[2]);
        let each = self.vertices.iter().zip(now).map(|(vertex, now)| {
            let [at_tip, at_middle, at_back, forward] = vertex.shares;
            let by = [
                0.0,
                at_tip * of_tip[0] + at_middle * middle + at_back * back,
                forward * of_tip[1],
            ];
            self.room.kept_inside(*now, by)
        });
        each.collect()
    }

    /// The highest point of a stretch of the tongue's length.
    fn top(&self, now: &[[f32; 3]], along: Range<f32>) -> f32 {
        top(&self.vertices, now, along)
    }
}

fn top(vertices: &[TongueVertex], now: &[[f32; 3]], along: Range<f32>) -> f32 {
    let inside = vertices
        .iter()
        .zip(now)
        .filter(|(vertex, _)| along.contains(&vertex.along));
    let heights = inside.map(|(_, p)| p[1]);
    heights.fold(f32::NEG_INFINITY, f32::max)
}

/// Vertices of a tongue with their places on it.
fn vertices(positions: &[[f32; 3]], numbers: &[u32]) -> Vec<TongueVertex> {
    let of = |v: u32| positions[v as usize];
    let range = |axis: usize| {
        numbers
            .iter()
            .map(|&v| of(v)[axis])
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| {
                (low.min(x), high.max(x))
            })
    };
    let ((root, tip), (low, high)) = (range(2), range(1));
    let share = |x: f32, (low, high): (f32, f32)| ((x - low) / (high - low)).clamp(0.0, 1.0);
    let bump = |along: f32, (at, reach): (f32, f32)| {
        0.5 + 0.5 * (std::f32::consts::PI * ((along - at) / reach).clamp(-1.0, 1.0)).cos()
    };
    numbers
        .iter()
        .map(|&v| {
            let along = share(of(v)[2], (root, tip));
            let taken = UNDERSIDE + (1.0 - UNDERSIDE) * share(of(v)[1], (low, high));
            let of_tip = smooth_step(share(along, TIP));
            TongueVertex {
                number: v as usize,
                rest: of(v),
                along,
                shares: [
                    taken * of_tip,
                    taken * bump(along, MIDDLE),
                    taken * bump(along, BACK),
                    of_tip,
                ],
            }
        })
        .collect()
}

/// From 0 to 1 where `x` does.
fn smooth_step(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

impl Room {
    /// Measures it by the parts that rest with the `skull`: upper teeth, gums and palate. Where none are found they lie as
    /// they do behind the lips of people.
    fn find(vertices: &[TongueVertex], skull: &[[f32; 3]], lips: [f32; 3], unit: f32) -> Room {
        let rest: Vec<[f32; 3]> = vertices.iter().map(|vertex| vertex.rest).collect();
        let ends = rest
            .iter()
            .map(|p| p[2])
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), z| {
                (low.min(z), high.max(z))
            });
        let at = |along: f32| ends.0 + along * (ends.1 - ends.0);
        let places = [ends.1, at(MIDDLE.0), at(BACK.0)];
        let is_in_front = |p: &&[f32; 3]| {
            (p[0] - lips[0]).abs() < 0.3 * unit
                && (p[1] - lips[1]).abs() < 2.2 * unit
                && (ends.1 - 0.2 * unit..lips[2] + 0.3 * unit).contains(&p[2])
        };
        let in_front: Vec<[f32; 3]> = skull.iter().filter(is_in_front).copied().collect();
        let least = |axis: usize, of: &dyn Fn(&[f32; 3]) -> bool| {
            in_front
                .iter()
                .filter(|p| of(p))
                .map(|p| p[axis])
                .fold(f32::INFINITY, f32::min)
        };
        let (edge, inner) = match in_front.is_empty() {
            true => (lips[1], lips[2] - INNER_CM * unit),
            false => {
                let edge = least(1, &|_| true);
                let outer = in_front
                    .iter()
                    .map(|p| p[2])
                    .fold(f32::NEG_INFINITY, f32::max);
                let inner = least(2, &|p| {
                    p[1] < edge + 1.1 * unit && p[2] > outer - THICK_CM * unit
                });
                (edge, inner)
            }
        };
        let heights = [
            edge + RIDGE_CM * unit,
            edge + PALATE_CM * unit,
            edge + PALATE_CM * unit,
        ];
        let stretches = [
            TIP_TOP..2.0,
            MIDDLE.0 - PLACE..MIDDLE.0 + PLACE,
            BACK.0 - PLACE..BACK.0 + PLACE,
        ];
        let mut roof = heights;
        for (k, stretch) in stretches.into_iter().enumerate() {
            let top = top(vertices, &rest, stretch);
            let above = skull.iter().filter(|p| {
                (p[0] - lips[0]).abs() < 0.6 * unit
                    && (p[2] - places[k]).abs() < 0.5 * unit
                    && (top..lips[1] + 2.5 * unit).contains(&p[1])
            });
            let lowest = above
                .map(|p| p[1] - CLEAR_CM * unit)
                .fold(f32::INFINITY, f32::min);
            roof[k] = roof[k].min(lowest);
        }
        Room {
            roof,
            places,
            edge,
            inner,
            unit,
        }
    }

    /// The height of the roof at a place along z.
    fn roof_at(&self, z: f32) -> f32 {
        let [tip, middle, back] = self.places;
        let mix = |from: usize, to: usize, share: f32| {
            self.roof[from] + share.clamp(0.0, 1.0) * (self.roof[to] - self.roof[from])
        };
        match z > middle {
            true => mix(1, 0, (z - middle) / (tip - middle)),
            false => mix(2, 1, (z - back) / (middle - back)),
        }
    }

    /// A displacement that brings no vertex farther through roof or teeth than it is.
    fn kept_inside(&self, now: [f32; 3], mut by: [f32; 3]) -> [f32; 3] {
        by[1] = by[1].min((self.roof_at(now[2] + by[2]) - now[1]).max(0.0));
        let into = now[2] + by[2] - (self.inner - CLEAR_CM * self.unit);
        by[2] -= into.clamp(0.0, by[2].max(0.0));
        by
    }
}
#[cfg(test)]
mod tests;
