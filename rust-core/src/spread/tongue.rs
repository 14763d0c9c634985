//! Moves a tongue that is a separate part of the mesh, on top of the motion of its jaw.
//!
//! Fields over the length of the tongue raise its tip, middle and back, and bring its tip forward. Lengths are
//! canonical centimetres, on a mouth 5 cm wide. +y is up, +z out of the face.

use std::{array, ops::Range};

use glam::Vec3;
use ndarray::{Array3, ArrayView1, ArrayView2, ArrayViewMut2, Axis};
use rayon::prelude::*;

use crate::{
    face::Face,
    mesh::{PartRole, Similarity},
    rig::parts::{TongueFound, middle_of_lips, tongue},
    speech::TONGUE_PLACES,
};

/// The place along the tongue, 0 at the root and 1 at the tip, where its middle rises most, and how far
/// to either side of it the rise reaches.
const MIDDLE: (f32, f32) = (0.6, 0.45);
/// The same for the back of the tongue.
const BACK: (f32, f32) = (0.25, 0.35);
/// Between these places along the tongue, the tip's share grows from 0 to 1.
const TIP: (f32, f32) = (0.4, 0.95);
/// From this place along the tongue on, the surface belongs to the tip.
const TIP_TOP: f32 = 0.88;
/// The middle and the back extend this far to either side of their places when their tops are measured.
const PLACE: f32 = 0.15;
/// A cross-section of the tongue extends this far to either side of its place.
const SLICE: f32 = 0.1;
/// The tongue's underside rises by this share only, because the floor of the mouth holds it.
const UNDERSIDE: f32 = 0.35;
/// The farthest that any place rises or that the tip goes forward.
const RISE_CM: f32 = 1.5;
/// The farthest that the tip goes down or back.
const BACKWARD_CM: f32 = 0.3;
/// Height of the ridge above the edge of the upper teeth: the crown of an upper incisor is about 1 cm
/// long.
const RIDGE_CM: f32 = 0.6;
/// Height of the palate above that edge: a palate is about 1.5 cm deep.
const PALATE_CM: f32 = 1.5;
/// The skin of the tongue stays at least this far from teeth and palate.
const CLEAR_CM: f32 = 0.03;
/// On a face without upper teeth, their inner face is assumed to lie this far behind the lips.
const INNER_CM: f32 = 1.15;
/// The largest distance between the outer and the inner face of the front teeth.
const THICK_CM: f32 = 1.2;

/// The inner face of the front teeth is sampled over this height.
const WALL_CM: f32 = 1.5;
/// Number of heights at which it is sampled.
const WALL_HEIGHTS: usize = 16;
/// Number of distances from the middle at which it is sampled.
const WALL_SIDES: usize = 9;
/// How much farther forward the tongue may go for each unit of height that it is beyond the edge of the
/// teeth.
const SLOPE: f32 = 1.0;
/// Each side of a triangle is divided into this many parts to sample points on the triangle.
const SAMPLES: usize = 8;

/// The first step of the search that recovers the shares of a tongue from its vertices.
const FIRST_STEP: f32 = 0.25;
/// The search ends when its step is no larger than this.
const LAST_STEP: f32 = 1e-4;

/// Says why the tongue of a face cannot move in speech; `None` if it can.
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

/// Vertices of all parts with a role, except the part that is the `tongue`.
fn vertices_of_role(face: &Face, role: PartRole, tongue: &[u32]) -> Vec<usize> {
    let lists = face.parts.connected.vertices().into_iter();
    let parts = face.parts.parts.iter().zip(lists);
    let parts = parts.filter(|(part, list)| part.role == role && list != tongue);
    let numbers = parts.flat_map(|(_, list)| list);
    numbers.map(|v| v as usize).collect()
}

/// The tongue of a face, if it can move by itself.
#[derive(Debug, Clone)]
pub(crate) struct FaceTongue {
    vertices: Vec<TongueVertex>,
    room: Room,
    lower: Option<LowerTeeth>,
    to_canonical: Similarity,
}

#[derive(Debug, Clone)]
struct TongueVertex {
    number: usize,
    rest: [f32; 3],
    /// Place on the tongue's length, 0 at the root, 1 at the tip.
    along: f32,
    /// Its shares in the rise of the tip, the middle and the back, and in the tip's motion forward.
    shares: [f32; 4],
}

/// The lower front teeth at rest, and some of their vertices.
#[derive(Debug, Clone)]
struct LowerTeeth {
    wall: Wall,
    numbers: Vec<usize>,
}

/// The space around the tongue.
#[derive(Debug, Clone, PartialEq)]
struct Room {
    /// Height of the roof over the tip, the middle and the back.
    roof: [f32; 3],
    /// Where the tip, the middle and the back lie along z.
    places: [f32; 3],
    /// Height of the edge of the upper front teeth.
    edge: f32,
    /// Inner face of the upper front teeth.
    upper: Wall,
    /// A fifth of the mouth's width.
    unit: f32,
}

impl FaceTongue {
    /// Finds the tongue of a face and the room in which it moves, or says why the face has no movable
    /// tongue.
    ///
    /// The motion depends on the tongue's own shape and on the space around it, so that on any mesh the
    /// tongue touches the palate and the teeth without passing through them.
    ///
    /// 1. The tongue is the part that follows the jaw and runs deep along the midline ([`tongue`]).
    /// 2. Each of its vertices gets a place along the tongue, from the root to the tip, and its shares in
    ///    the rise of the tip, the middle and the back. The underside rises less, because the floor of
    ///    the mouth holds it ([`vertices`]).
    /// 3. Parts near the lips that rest with the skull are upper teeth, gums and palate. They give the
    ///    height of the teeth's edge, the roof over three places of the tongue, and the inner face of the
    ///    front teeth as a grid of depths ([`Room::find`], [`Wall::of`]).
    /// 4. Parts that follow the jaw, except the tongue, give the inner face of the lower front teeth, which moves
    ///    with the jaw ([`LowerTeeth::find`]).
    ///
    /// It passes over the triangles of the mesh once for the skull and once for the jaw. Each triangle
    /// near the lips becomes 45 points, because the inside of a large triangle may be the only part of a
    /// tooth in a cell of the grid. These points take up memory until the walls are known.
    ///
    /// Not obvious: all lengths grow with the width of the mouth (`unit`), and the room is that of the
    /// neutral face. Only the lower teeth move later. Where several parts lie in front, the innermost
    /// points form the wall.
    ///
    /// What can go wrong: if the tongue is sewn to the gums or missing, the error says so. Without upper
    /// teeth, the edge lies at the height of the lips, the wall is flat and [`INNER_CM`] behind them, and
    /// the roof is at most as high as in people. Without lower teeth, nothing below holds the tongue
    /// back.
    pub(crate) fn find(face: &Face) -> Result<FaceTongue, &'static str> {
        let (positions, landmarks) = centimetres(face);
        let tongue = match tongue(&positions, &face.parts, &landmarks) {
            TongueFound::Own(tongue) => tongue,
            other => return Err(other.complaint().unwrap_or_default()),
        };
        let lips = middle_of_lips(&landmarks);
        let unit = Vec3::from(landmarks[48]).distance(landmarks[54].into()) / 5.0;
        let vertices = vertices(&positions, &tongue.vertices);
        let is_near_lips = |p: [f32; 3]| {
            let away = |axis: usize| (p[axis] - lips[axis]).abs() / unit;
            away(0) < 1.5 && away(1) < 3.0 && away(2) < 3.5
        };
        let surface = |numbers: &[usize]| {
            let near: Vec<usize> = numbers
                .iter()
                .copied()
                .filter(|&v| is_near_lips(positions[v]))
                .collect();
            surface(&positions, &face.mesh.triangles, &near)
        };
        let skull = vertices_of_role(face, PartRole::Skull, &tongue.vertices);
        let points = surface(&skull);
        let skull: Vec<[f32; 3]> = skull.iter().map(|&v| positions[v]).collect();
        let room = Room::find(&vertices, (&skull, &points), lips, unit);
        let jaw = vertices_of_role(face, PartRole::Jaw, &tongue.vertices);
        let lower = LowerTeeth::find(&positions, &jaw, &surface(&jaw), &room);
        Ok(FaceTongue {
            lower,
            room,
            vertices,
            to_canonical: face.to_canonical,
        })
    }

    /// Mesh numbers of the tongue's vertices and of the vertices of the lower teeth that limit it.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = usize> + '_ {
        let teeth = self.lower.iter().flat_map(|teeth| &teeth.numbers);
        let tongue = self.vertices.iter().map(|vertex| vertex.number);
        tongue.chain(teeth.copied())
    }

    /// Renumbers the vertices to their indices in `known`, mesh numbers in ascending order. `None` if a
    /// vertex of the tongue or of its teeth is missing there.
    pub(crate) fn among(mut self, known: &[usize]) -> Option<FaceTongue> {
        for vertex in &mut self.vertices {
            vertex.number = known.binary_search(&vertex.number).ok()?;
        }
        for number in self.lower.iter_mut().flat_map(|teeth| &mut teeth.numbers) {
            *number = known.binary_search(number).ok()?;
        }
        Some(self)
    }

    /// Adds the motion of the tongue, `rows` `[t, 4]`, to the displacements `[t, V, 3]` of the mesh, mesh units.
    pub(crate) fn speak(&self, rows: ArrayView2<'_, f32>, moved: &mut Array3<f32>) {
        let frames = moved.axis_iter_mut(Axis(0)).into_par_iter();
        frames
            .zip(rows.axis_iter(Axis(0)))
            .filter(|(_, row)| row.iter().any(|x| *x != 0.0))
            .for_each(|(frame, row)| self.speak_frame(frame, row));
    }

    /// Positions of the tongue under displacements `[V, 3]` of the mesh, mesh units.
    fn now(&self, frame: ArrayView2<'_, f32>) -> Vec<[f32; 3]> {
        let per_unit = 100.0 * self.to_canonical.scale as f32;
        let now = self.vertices.iter().map(|vertex| {
            let moved = frame.row(vertex.number);
            let moved = self.to_canonical.rotate([moved[0], moved[1], moved[2]]);
            array::from_fn(|i| vertex.rest[i] + per_unit * moved[i])
        });
        now.collect()
    }

    /// Where displacements `[V, 3]` take the lower front teeth.
    fn below(&self, frame: ArrayView2<'_, f32>) -> Option<Wall> {
        let LowerTeeth { wall, numbers } = self.lower.as_ref()?;
        let mut by = [0.0f32; 3];
        for &number in numbers {
            let moved = frame.row(number);
            for (by, moved) in by.iter_mut().zip(moved) {
                *by += moved / numbers.len() as f32;
            }
        }
        let per_unit = 100.0 * self.to_canonical.scale as f32;
        let by = self.to_canonical.rotate(by).map(|x| per_unit * x);
        Some(wall.moved(by[1], by[2]))
    }

    /// Finds the shares, in the order of a row of [`FaceTongue::speak`], that best explain the tongue of
    /// a pose. `shown` are the displacements of that pose and `jaw` those that its jaw alone causes, both
    /// `[V, 3]` in mesh units.
    pub(super) fn shares_of(
        &self,
        shown: ArrayView2<'_, f32>,
        jaw: ArrayView2<'_, f32>,
    ) -> [f32; TONGUE_PLACES] {
        let rests = |vertex: &TongueVertex| shown.row(vertex.number).iter().all(|x| *x == 0.0);
        if self.vertices.iter().all(rests) {
            // No vertex of the tongue is displaced, so nobody posed it, even if the jaw moves.
            return [0.0; TONGUE_PLACES];
        }
        let below = self.below(jaw);
        let (shown, jaw) = (self.now(shown), self.now(jaw));
        let off = |row: &[f32; TONGUE_PLACES]| -> f32 {
            let by = self.displacements((&jaw, below.as_ref()), ArrayView1::from(row));
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
        let (now, below) = (self.now(frame.view()), self.below(frame.view()));
        let to_mesh = self.to_canonical.inverse();
        let each = self.displacements((&now, below.as_ref()), row);
        for (vertex, by) in self.vertices.iter().zip(each) {
            let by = to_mesh.rotate(by);
            let mut moved = frame.row_mut(vertex.number);
            for i in 0..3 {
                moved[i] += by[i] / per_unit;
            }
        }
    }

    /// The displacement of each vertex of the tongue on top of the jaw's motion. The jaw has brought the
    /// vertices to `now` and the lower teeth to `below`.
    fn displacements(
        &self,
        (now, below): (&[[f32; 3]], Option<&Wall>),
        row: ArrayView1<'_, f32>,
    ) -> Vec<[f32; 3]> {
        let Room {
            roof, edge, unit, ..
        } = self.room;
        let share = |place: usize| row[place].clamp(0.0, 1.0);
        // The tip can only be in one place at a time, so its two shares sum to at most 1.
        let (mut ridge, mut between) = (share(0), share(3));
        let both = (ridge + between).max(1.0);
        (ridge, between) = (ridge / both, between / both);
        let rise = |from: f32, to: f32| (to - from).clamp(0.0, RISE_CM * unit);
        let clear = CLEAR_CM * unit;
        let to_ridge = rise(self.top(now, TIP_TOP..2.0), roof[0]);
        let over_teeth = below.map_or(f32::NEG_INFINITY, |below| below.top() + 2.0 * clear);
        let to_edge = self.rise_of_foremost(now, (edge - clear).max(over_teeth));
        let [to_ridge, to_edge] = [to_ridge, to_edge].map(|rise| [rise, self.reach(now, rise)]);
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
            self.room.keep_inside(*now, by, below)
        });
        each.collect()
    }

    /// How far the tip must rise for its foremost point to reach a height.
    fn rise_of_foremost(&self, now: &[[f32; 3]], height: f32) -> f32 {
        let unit = self.room.unit;
        // Picked by rest position, so that it is always the same vertex: another one has another share.
        let of_tip = self.vertices.iter().zip(now);
        let foremost = of_tip.max_by(|a, b| a.0.rest[2].total_cmp(&b.0.rest[2]));
        let rise = foremost.map_or(0.0, |(vertex, p)| {
            (height - p[1]) / vertex.shares[0].max(UNDERSIDE)
        });
        rise.clamp(-BACKWARD_CM * unit, RISE_CM * unit)
    }

    /// How far forward the tip goes until it touches the upper teeth, once it has risen by `rise`.
    fn reach(&self, now: &[[f32; 3]], rise: f32) -> f32 {
        let Room { edge, unit, .. } = self.room;
        let of_tip = self.vertices.iter().zip(now);
        let of_tip = of_tip.filter(|(vertex, _)| vertex.shares[3] > 0.5);
        let ways = of_tip.map(|(vertex, p)| {
            let height = (p[1] + vertex.shares[0] * rise).max(edge);
            let room = self.room.upper.limit(p[0], height) - CLEAR_CM * unit - p[2];
            room / vertex.shares[3]
        });
        let least = ways.fold(f32::INFINITY, f32::min);
        least.clamp(-BACKWARD_CM * unit, RISE_CM * unit)
    }

    /// The height of the highest point on a stretch of the tongue's length.
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
    let (root, tip) = range(2);
    let share = |x: f32, (low, high): (f32, f32)| ((x - low) / (high - low)).clamp(0.0, 1.0);
    // Lowest and highest point of the cross-section at a place along the tongue.
    let slice = |along: f32| {
        let near = numbers.iter().map(|&v| of(v));
        let near = near.filter(|p| (share(p[2], (root, tip)) - along).abs() < SLICE);
        near.map(|p| p[1])
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), y| {
                (low.min(y), high.max(y))
            })
    };
    let bump = |along: f32, (at, reach): (f32, f32)| {
        0.5 + 0.5 * (std::f32::consts::PI * ((along - at) / reach).clamp(-1.0, 1.0)).cos()
    };
    numbers
        .iter()
        .map(|&v| {
            let along = share(of(v)[2], (root, tip));
            let height_share = UNDERSIDE + (1.0 - UNDERSIDE) * share(of(v)[1], slice(along));
            let of_tip = smooth_step(share(along, TIP));
            TongueVertex {
                number: v as usize,
                rest: of(v),
                along,
                shares: [
                    height_share * of_tip,
                    height_share * bump(along, MIDDLE),
                    height_share * bump(along, BACK),
                    of_tip,
                ],
            }
        })
        .collect()
}

/// Rises smoothly from 0 to 1 while `x` goes from 0 to 1.
fn smooth_step(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

impl Room {
    /// Measures the room from the parts that rest with the skull: upper teeth, gums and palate. `skull`
    /// are their vertices and `surface` points on their triangles.
    ///
    /// 1. Vertices in the middle of the mouth, from the tip of the tongue to the lips, are front teeth.
    ///    The lowest of them is their edge.
    /// 2. Points less than [`THICK_CM`] behind the foremost of these vertices lie on either face of the
    ///    teeth. The hindmost point in each cell of a grid over width and height lies on the inner face.
    /// 3. The roof over the tip, the middle and the back is as high above the edge as in people. If a
    ///    vertex above the tongue there is lower, the roof lies just below it.
    ///
    /// The cost grows with the number of vertices plus that of points. If there are no front teeth behind
    /// the lips, the edge is at the height of the lips and the inner face is flat, [`INNER_CM`] behind
    /// them.
    fn find(
        vertices: &[TongueVertex],
        (skull, surface): (&[[f32; 3]], &[[f32; 3]]),
        lips: [f32; 3],
        unit: f32,
    ) -> Room {
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
        let heights = in_front.iter().map(|p| p[1]);
        let edge = if in_front.is_empty() {
            lips[1]
        } else {
            heights.fold(f32::INFINITY, f32::min)
        };
        let deepest = in_front
            .iter()
            .map(|p| p[2])
            .fold(f32::NEG_INFINITY, f32::max)
            - THICK_CM * unit;
        let front: Vec<[f32; 3]> = surface.iter().filter(|p| p[2] > deepest).copied().collect();
        let anywhere = lips[2] - INNER_CM * unit;
        let upper = if in_front.is_empty() {
            Wall::flat(lips[0], edge, anywhere, unit)
        } else {
            Wall::of(&front, lips[0], edge, unit)
        };
        let palate = edge + PALATE_CM * unit;
        let mut room = Room {
            roof: [edge + RIDGE_CM * unit, palate, palate],
            places,
            edge,
            upper,
            unit,
        };
        room.lower_roof((vertices, &rest), skull, lips);
        room
    }

    /// Lowers the roof to just below the lowest vertex of the `skull` above each of the tongue's three
    /// places. `rest`: the tongue's rest positions.
    fn lower_roof(
        &mut self,
        (vertices, rest): (&[TongueVertex], &[[f32; 3]]),
        skull: &[[f32; 3]],
        lips: [f32; 3],
    ) {
        let unit = self.unit;
        let stretches = [
            TIP_TOP..2.0,
            MIDDLE.0 - PLACE..MIDDLE.0 + PLACE,
            BACK.0 - PLACE..BACK.0 + PLACE,
        ];
        for (k, stretch) in stretches.into_iter().enumerate() {
            let top = top(vertices, rest, stretch);
            let above = skull.iter().filter(|p| {
                (p[0] - lips[0]).abs() < 0.6 * unit
                    && (p[2] - self.places[k]).abs() < 0.5 * unit
                    && (top..lips[1] + 2.5 * unit).contains(&p[1])
            });
            let lowest = above
                .map(|p| p[1] - CLEAR_CM * unit)
                .fold(f32::INFINITY, f32::min);
            self.roof[k] = self.roof[k].min(lowest);
        }
    }

    /// The height of the roof at a place along z.
    fn roof_at(&self, z: f32) -> f32 {
        let [tip, middle, back] = self.places;
        let mix = |from: usize, to: usize, share: f32| {
            self.roof[from] + share.clamp(0.0, 1.0) * (self.roof[to] - self.roof[from])
        };
        if z > middle {
            mix(1, 0, (z - middle) / (tip - middle))
        } else {
            mix(2, 1, (z - back) / (middle - back))
        }
    }

    /// Shortens a displacement so that it brings the vertex no farther through the roof, the upper teeth or the teeth
    /// `below` than it already is.
    fn keep_inside(&self, now: [f32; 3], mut by: [f32; 3], below: Option<&Wall>) -> [f32; 3] {
        let clear = CLEAR_CM * self.unit;
        by[1] = by[1].min((self.roof_at(now[2] + by[2]) - now[1]).max(0.0));
        let height = now[1] + by[1];
        let free = |beyond: f32| SLOPE * beyond.max(0.0);
        let upper = self.upper.limit(now[0], height) + free(self.edge - height);
        let lower = below.map(|below| below.limit(now[0], height) + free(height - below.top()));
        for limit in [Some(upper), lower].into_iter().flatten() {
            let limit = (limit - clear).max(now[2]);
            by[2] = by[2].min(limit - now[2]);
        }
        by
    }
}

impl LowerTeeth {
    /// Finds the lower teeth among the parts that follow the jaw. `jaw` are the vertices of these parts
    /// and `surface` points on their triangles. `None` if no vertex lies in front.
    fn find(
        positions: &[[f32; 3]],
        jaw: &[usize],
        surface: &[[f32; 3]],
        room: &Room,
    ) -> Option<LowerTeeth> {
        let (unit, middle) = (room.unit, room.upper.middle);
        let is_in_front =
            |p: &[f32; 3]| (p[0] - middle).abs() < 0.4 * unit && p[2] > room.places[0] - 0.5 * unit;
        let numbers: Vec<usize> = jaw
            .iter()
            .copied()
            .filter(|&v| is_in_front(&positions[v]))
            .collect();
        let front = numbers.iter().map(|&v| positions[v]);
        let (top, outer) = front.fold((f32::NEG_INFINITY, f32::NEG_INFINITY), |(top, outer), p| {
            (top.max(p[1]), outer.max(p[2]))
        });
        if numbers.is_empty() {
            return None;
        }
        let deepest = outer - THICK_CM * unit;
        let front: Vec<[f32; 3]> = surface.iter().filter(|p| p[2] > deepest).copied().collect();
        let wall = Wall::of(&front, middle, top - WALL_CM * unit, unit);
        Some(LowerTeeth { wall, numbers })
    }
}

/// The inner face of the front teeth: its z at each distance from the middle and each height.
#[derive(Debug, Clone, PartialEq)]
struct Wall {
    middle: f32,
    /// Its lowest height.
    low: f32,
    /// Distance between neighbouring heights, and between neighbouring distances from the middle.
    step: f32,
    z: [[f32; WALL_HEIGHTS]; WALL_SIDES],
}

impl Wall {
    /// Builds the wall from points on teeth, from the height `low` up. A cell without points takes the
    /// value of the cell below it, or else of the cell above.
    fn of(points: &[[f32; 3]], middle: f32, low: f32, unit: f32) -> Wall {
        let step = WALL_CM * unit / (WALL_HEIGHTS - 1) as f32;
        let mut z = [[f32::INFINITY; WALL_HEIGHTS]; WALL_SIDES];
        for p in points {
            let (side, height) = ((p[0] - middle).abs() / step, (p[1] - low) / step);
            for (s, column) in z.iter_mut().enumerate() {
                for (h, z) in column.iter_mut().enumerate() {
                    let away = (side - s as f32 - 0.5).abs().max((height - h as f32).abs());
                    let is_near = away < 0.55;
                    if is_near {
                        *z = z.min(p[2]);
                    }
                }
            }
        }
        for column in &mut z {
            for h in 1..WALL_HEIGHTS {
                if column[h].is_infinite() {
                    column[h] = column[h - 1];
                }
            }
            for h in (1..WALL_HEIGHTS).rev() {
                if column[h - 1].is_infinite() {
                    column[h - 1] = column[h];
                }
            }
        }
        Wall {
            middle,
            low,
            step,
            z,
        }
    }

    /// A wall with the same z everywhere.
    fn flat(middle: f32, low: f32, z: f32, unit: f32) -> Wall {
        Wall {
            middle,
            low,
            step: WALL_CM * unit / (WALL_HEIGHTS - 1) as f32,
            z: [[z; WALL_HEIGHTS]; WALL_SIDES],
        }
    }

    fn top(&self) -> f32 {
        self.low + self.step * (WALL_HEIGHTS - 1) as f32
    }

    fn moved(&self, up: f32, forward: f32) -> Wall {
        Wall {
            low: self.low + up,
            z: self.z.map(|column| column.map(|z| z + forward)),
            ..*self
        }
    }

    /// The largest z allowed at `x` across the face and at `height`; infinite beside the front teeth.
    fn limit(&self, x: f32, height: f32) -> f32 {
        let side = ((x - self.middle).abs() / self.step) as usize;
        let Some(column) = self.z.get(side) else {
            return f32::INFINITY;
        };
        let place = ((height - self.low) / self.step).clamp(0.0, (WALL_HEIGHTS - 1) as f32);
        let (h, share) = ((place as usize).min(WALL_HEIGHTS - 2), place.fract());
        let share = if place as usize > h { 1.0 } else { share };
        if column[h].is_finite() {
            column[h] + share * (column[h + 1] - column[h])
        } else {
            f32::INFINITY
        }
    }
}

/// Points on the triangles whose corners are all in `numbers`, too close together for a tooth to fit
/// between.
fn surface(positions: &[[f32; 3]], triangles: &[[u32; 3]], numbers: &[usize]) -> Vec<[f32; 3]> {
    let mut sorted = numbers.to_vec();
    sorted.sort_unstable();
    let mut points = Vec::new();
    for corners in triangles {
        let is_inside = |&v: &u32| sorted.binary_search(&(v as usize)).is_ok();
        if !corners.iter().all(is_inside) {
            continue;
        }
        let at = corners.map(|v| positions[v as usize]);
        for a in 0..=SAMPLES {
            for b in 0..=SAMPLES - a {
                let shares = [a, b, SAMPLES - a - b].map(|n| n as f32 / SAMPLES as f32);
                points.push(array::from_fn(|i| {
                    (0..3).map(|corner| shares[corner] * at[corner][i]).sum()
                }));
            }
        }
    }
    points
}

#[cfg(test)]
mod tests;
