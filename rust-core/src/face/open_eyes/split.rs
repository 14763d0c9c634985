//! Cuts the skin along a closed line around an eye, and frees the piece inside.
//!
//! 1. [`sheet`] gathers the triangles around the eye that are connected with the foremost one in
//!    its middle. This leaves out parts that only lie behind the eye.
//! 2. Every vertex of the sheet gets its distance from the line, negative inside ([`Cut::of`]). The
//!    line is a polygon seen from the front, so no edge of the mesh has to follow it.
//! 3. Where the distance changes sign along an edge, the edge gets a vertex and its triangles are
//!    cut ([`split`]). A crossing near the end of an edge goes through the vertex instead, so that
//!    no slivers arise.
//! 4. [`set_free`] gives the pieces inside their own vertices along the line. Lids and eye are then
//!    two surfaces that touch.
//!
//! The cost is the number of vertices of the sheet times the corners of the polygon, then one pass
//! over the triangles of the mesh.
//!
//! Not obvious: places are compared by the bits of their coordinates, because several vertices
//! along a texture seam share one place. A new vertex on an edge is computed from the smaller place
//! towards the larger one, so that both sides of a seam get the same bits. Where the corners of a
//! piece do not say on which side it lies, its middle decides.
//!
//! What can go wrong: the line crosses a hole or itself and is not a single loop. Such an eye is
//! refused.

use std::collections::{HashMap, HashSet};

use glam::{Vec2, Vec3};

use super::{rim::Rim, space::EyeSpace};
use crate::{
    Error, Result,
    face::opened::{FineMesh, TriangleSource, mixed},
    mesh::depth_at,
};

/// A crossing this near to the end of an edge, as a share of the edge, goes through the vertex
/// instead.
const SNAP: f32 = 0.18;
/// The sheet reaches this far beyond the line, in widths.
const BEYOND: f32 = 0.25;
/// A line with fewer places cannot lead around an eye.
const LEAST_PLACES: usize = 8;

/// A place in space as the bits of its coordinates. Vertices along a texture seam share one.
type Place = [u32; 3];

/// A place of the line.
#[derive(Debug, Clone, Copy)]
pub(super) struct RimPlace {
    /// The vertices of the lid and of the eye at this place.
    pub lid: u32,
    pub eye: u32,
    /// The sources of triangles that begin here, on the lid's side and on the eye's.
    pub lid_source: TriangleSource,
    pub eye_source: TriangleSource,
}

/// A corner of a piece.
#[derive(Clone, Copy)]
struct Corner {
    vertex: u32,
    shares: [f32; 3],
    /// −1 inside, 1 outside, 0 on the line.
    side: i8,
}

/// Triangles around the eye that are connected with the foremost one in its middle.
pub(super) fn sheet(fine: &FineMesh, space: &EyeSpace, rim: &Rim, width: f32) -> Vec<u32> {
    let mesh = &fine.mesh;
    let corners =
        |t: u32| mesh.triangles[t as usize].map(|v| space.local(mesh.positions[v as usize]));
    let is_near = |t: &u32| {
        corners(*t)
            .iter()
            .any(|p| p.length() < 2.0 * width && rim.distance(p.truncate()) < BEYOND * width)
    };
    let near: Vec<u32> = (0..mesh.triangles.len() as u32).filter(is_near).collect();
    let middle = rim.middle();
    let depths = near.iter().filter_map(|&t| {
        let depth = depth_at(&corners(t).map(Into::into), middle.into())?;
        Some((depth, t))
    });
    let Some((_, first)) = depths.max_by(|a, b| a.0.total_cmp(&b.0)) else {
        return Vec::new();
    };
    let mut beside: HashMap<[Place; 2], Vec<u32>> = HashMap::new();
    for &t in &near {
        for edge in edges(fine, t) {
            beside.entry(edge).or_default().push(t);
        }
    }
    let (mut known, mut open) = (HashSet::from([first]), vec![first]);
    while let Some(t) = open.pop() {
        for edge in edges(fine, t) {
            open.extend(beside[&edge].iter().filter(|&&next| known.insert(next)));
        }
    }
    let mut sheet: Vec<u32> = known.into_iter().collect();
    sheet.sort_unstable();
    sheet
}

/// The two places of each edge of a triangle, the smaller one first.
fn edges(fine: &FineMesh, t: u32) -> [[Place; 2]; 3] {
    let [a, b, c] = fine.mesh.triangles[t as usize].map(|v| place(fine, v));
    [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)])
}

fn place(fine: &FineMesh, v: u32) -> Place {
    // Adding zero makes −0 and 0 one place.
    fine.mesh.positions[v as usize].map(|x| (x + 0.0).to_bits())
}

/// Cuts the sheet along the line. Returns the line in the order in which the triangles of the eye
/// run along it.
///
/// # Errors
/// `Mesh` where the line is not a single loop over the surface.
pub(super) fn split(
    fine: &mut FineMesh,
    sheet: &[u32],
    space: &EyeSpace,
    rim: &Rim,
) -> Result<Vec<RimPlace>> {
    let cut = Cut::of(fine, sheet, space, rim);
    let mut vertices_on_edges = HashMap::new();
    let in_sheet: HashSet<u32> = sheet.iter().copied().collect();
    let triangles = std::mem::take(&mut fine.mesh.triangles);
    let sources = std::mem::take(&mut fine.triangle_sources);
    // The new triangles of the sheet.
    let mut pieces = Vec::new();
    for (number, (t, source)) in triangles.into_iter().zip(sources).enumerate() {
        if !in_sheet.contains(&(number as u32)) {
            fine.mesh.triangles.push(t);
            fine.triangle_sources.push(source);
            continue;
        }
        let around = cut.around(fine, &mut vertices_on_edges, t);
        for piece in cut_pieces(&around) {
            let sides: i32 = piece.iter().map(|corner| i32::from(corner.side)).sum();
            let is_inside = match sides {
                0 => rim.distance(middle(fine, space, piece.map(|c| c.vertex))) < 0.0,
                sides => sides < 0,
            };
            pieces.push((
                fine.mesh.triangles.len(),
                is_inside,
                piece.map(|c| c.side == 0),
            ));
            fine.mesh.triangles.push(piece.map(|corner| corner.vertex));
            let shares = piece.map(|corner| corner.shares);
            fine.triangle_sources.push(source.piece(shares));
        }
    }
    set_free(fine, &pieces)
}

fn middle(fine: &FineMesh, space: &EyeSpace, corners: [u32; 3]) -> Vec2 {
    let places = corners.map(|v| space.local(fine.mesh.positions[v as usize]));
    (places.into_iter().sum::<Vec3>() / 3.0).truncate()
}

/// Where the edges of the sheet cross the line.
struct Cut {
    /// How far each place lies from the line, and on which side.
    sides: HashMap<Place, (f32, i8)>,
}

impl Cut {
    fn of(fine: &FineMesh, sheet: &[u32], space: &EyeSpace, rim: &Rim) -> Cut {
        let mut sides = HashMap::new();
        for &t in sheet {
            for v in fine.mesh.triangles[t as usize] {
                let away = || rim.distance(space.local(fine.mesh.positions[v as usize]).truncate());
                sides.entry(place(fine, v)).or_insert_with(|| {
                    let away = away();
                    (away, if away < 0.0 { -1 } else { 1 })
                });
            }
        }
        let mut on_line = HashSet::new();
        for &t in sheet {
            for [p, q] in edges(fine, t) {
                let ((a, from), (b, to)) = (sides[&p], sides[&q]);
                if from == to {
                    continue;
                }
                let share = a / (a - b);
                if share < SNAP {
                    on_line.insert(p);
                } else if share > 1.0 - SNAP {
                    on_line.insert(q);
                }
            }
        }
        for place in on_line {
            sides.insert(place, (0.0, 0));
        }
        Cut { sides }
    }

    /// The corners of a triangle and the places where its edges cross the line, in order around it.
    fn around(
        &self,
        fine: &mut FineMesh,
        vertices_on_edges: &mut HashMap<(u32, u32), u32>,
        t: [u32; 3],
    ) -> Vec<Corner> {
        let mut around = Vec::with_capacity(5);
        for k in 0..3 {
            let (v, w) = (t[k], t[(k + 1) % 3]);
            let [(a, side), (b, next)] = [v, w].map(|v| self.sides[&place(fine, v)]);
            let mut shares = [0.0; 3];
            shares[k] = 1.0;
            around.push(Corner {
                vertex: v,
                shares,
                side,
            });
            if side * next >= 0 {
                continue;
            }
            let to_next = a / (a - b);
            (shares[k], shares[(k + 1) % 3]) = (1.0 - to_next, to_next);
            let vertex = *vertices_on_edges
                .entry((v.min(w), v.max(w)))
                .or_insert_with(|| {
                    // Starts at the smaller place, so that both sides of a texture seam get the
                    // same position.
                    let [p, q] = [v, w].map(|v| fine.mesh.positions[v as usize]);
                    let is_turned = place(fine, v) > place(fine, w);
                    let between = |p: [f32; 3], q: [f32; 3], t: f32| -> [f32; 3] {
                        std::array::from_fn(|i| p[i] + t * (q[i] - p[i]))
                    };
                    fine.mesh.positions.push(if is_turned {
                        between(q, p, b / (b - a))
                    } else {
                        between(p, q, to_next)
                    });
                    let ends = [(v, 1.0 - to_next), (w, to_next), (v, 0.0)];
                    fine.vertex_sources.push(mixed(&fine.vertex_sources, ends));
                    fine.mesh.positions.len() as u32 - 1
                });
            around.push(Corner {
                vertex,
                shares,
                side: 0,
            });
        }
        around
    }
}

/// Divides a triangle that has places of the line on up to two of its edges into triangles.
fn cut_pieces(around: &[Corner]) -> Vec<[Corner; 3]> {
    let at = |i: usize| around[i % around.len()];
    let is_new = |i: usize| at(i).shares.iter().all(|share| *share < 1.0);
    match around.len() {
        4 => {
            let m = (0..4).find(|&i| is_new(i)).unwrap_or(0);
            vec![[at(m), at(m + 1), at(m + 2)], [at(m), at(m + 2), at(m + 3)]]
        }
        5 => {
            // The two places have one corner between them.
            let m = (0..5).find(|&i| is_new(i) && is_new(i + 2)).unwrap_or(0);
            let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|i| at(m + i));
            vec![[a, b, c], [a, c, d], [a, d, e]]
        }
        _ => vec![[at(0), at(1), at(2)]],
    }
}

/// A piece of the sheet: its number, whether it lies inside, and which of its corners lie on the line.
type Piece = (usize, bool, [bool; 3]);

/// Gives the pieces inside vertices of their own along the line, so that lids and eye can part.
/// Returns the line.
///
/// The sheet has been cut along the line, but the pieces on both sides still share the line's
/// vertices.
///
/// 1. [`Bank::outside`] notes the line's places on the lids' side. It also notes each edge along
///    the line as a pair of places, in the order in which its piece runs around.
/// 2. [`Bank::inside`] copies the vertices on the line for the pieces inside. Two pieces that
///    shared a vertex before also share its copy, so the eye stays one surface. Two vertices at one
///    place, as along a texture seam, become two copies.
/// 3. An edge of a piece inside belongs to the line if a piece outside has the same edge in the
///    opposite direction. Each such edge says which place follows which.
/// 4. [`loop_of`] walks from place to place until it is back at its start.
///
/// The keys are places, not vertices. Where a texture seam crosses the line, one place has several
/// vertices, and a walk from vertex to vertex would end at the seam. The walk begins at the
/// smallest place, so that the result does not depend on the order of a hash map.
///
/// The cost is linear in the pieces of the sheet.
///
/// What can go wrong: the line leaves the sheet at a hole, runs along itself in a fold, or falls
/// into several loops. Then a place has two successors, the walk ends early, or it leaves places
/// out. The mesh is refused in all these cases, and so is a loop of fewer than [`LEAST_PLACES`]
/// places.
fn set_free(fine: &mut FineMesh, pieces: &[Piece]) -> Result<Vec<RimPlace>> {
    let outside = Bank::outside(fine, pieces);
    let inside = Bank::inside(fine, pieces, &outside);
    loop_of(&outside, &inside)
}

/// The line with the vertices that the pieces on one side of it use.
#[derive(Default)]
struct Bank {
    /// For each place a vertex, and the source of triangles that begin there.
    corners: HashMap<Place, (u32, TriangleSource)>,
    /// The edges along the line, each from one place to the next.
    edges: Vec<[Place; 2]>,
}

impl Bank {
    /// The line on the side of the lids.
    fn outside(fine: &FineMesh, pieces: &[Piece]) -> Bank {
        let mut bank = Bank::default();
        for &(number, _, on_line) in pieces.iter().filter(|piece| !piece.1) {
            let t = fine.mesh.triangles[number];
            for k in (0..3).filter(|&k| on_line[k]) {
                let next = (k + 1) % 3;
                let source = fine.triangle_sources[number].at_corner(k);
                let here = place(fine, t[k]);
                bank.corners.entry(here).or_insert((t[k], source));
                if on_line[next] {
                    bank.edges.push([here, place(fine, t[next])]);
                }
            }
        }
        bank
    }

    /// The line on the side of the eye. Its pieces get their own vertices at every place that the
    /// lids share.
    fn inside(fine: &mut FineMesh, pieces: &[Piece], outside: &Bank) -> Bank {
        let edges: HashSet<&[Place; 2]> = outside.edges.iter().collect();
        let (mut bank, mut copies) = (Bank::default(), HashMap::new());
        for &(number, _, on_line) in pieces.iter().filter(|piece| piece.1) {
            let t = fine.mesh.triangles[number];
            for k in (0..3).filter(|&k| on_line[k]) {
                let (here, there) = (place(fine, t[k]), place(fine, t[(k + 1) % 3]));
                if !outside.corners.contains_key(&here) {
                    continue;
                }
                let copy = *copies.entry(t[k]).or_insert_with(|| {
                    fine.mesh.positions.push(fine.mesh.positions[t[k] as usize]);
                    fine.vertex_sources.push(fine.vertex_sources[t[k] as usize]);
                    fine.mesh.positions.len() as u32 - 1
                });
                fine.mesh.triangles[number][k] = copy;
                let source = fine.triangle_sources[number].at_corner(k);
                bank.corners.entry(here).or_insert((copy, source));
                if edges.contains(&[there, here]) {
                    bank.edges.push([here, there]);
                }
            }
        }
        bank
    }
}

/// Walks along the line from place to place, in the order of the edges inside.
///
/// # Errors
/// `Mesh` where the edges are not a single loop of at least `LEAST_PLACES` places.
fn loop_of(outside: &Bank, inside: &Bank) -> Result<Vec<RimPlace>> {
    let next: HashMap<Place, Place> = inside
        .edges
        .iter()
        .map(|[here, there]| (*here, *there))
        .collect();
    let first = next.keys().min().copied();
    let mut line = Vec::new();
    let mut at = first;
    while let Some(here) = at {
        let ((lid, lid_source), (eye, eye_source)) =
            (outside.corners[&here], inside.corners[&here]);
        line.push(RimPlace {
            lid,
            eye,
            lid_source,
            eye_source,
        });
        at = next
            .get(&here)
            .copied()
            .filter(|there| Some(*there) != first);
        if line.len() > next.len() {
            break;
        }
    }
    let is_branched = next.len() < inside.edges.len();
    if is_branched || line.len() < LEAST_PLACES || line.len() != next.len() {
        return Err(Error::Mesh(
            "open eyes: expected one line around each eye on the skin, got a surface that ends or folds there; \
             check the landmarks of the eyes (36 to 47)"
                .into(),
        ));
    }
    Ok(line)
}
