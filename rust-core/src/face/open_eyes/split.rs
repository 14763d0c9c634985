//! Cuts the skin along a closed line around an eye, and frees the piece inside.
//!
//! Every vertex of the sheet around the eye gets its distance from the line. An edge along which
//! the sign changes gets a vertex, and triangles are cut there. Pieces inside get vertices of their
//! own along the line, so that lids and eye are two surfaces that touch. A line that crosses a hole
//! or itself is no single loop: such an eye is refused.

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

/// A place in space, by its bits: vertices along texture seams share one.
type Place = [u32; 3];

/// A place of the line.
#[derive(Debug, Clone, Copy)]
pub(super) struct RimPlace {
    /// Vertices of the lid and of the eye, at one place.
    pub lid: u32,
    pub eye: u32,
    /// What a triangle that begins here on either side is made of.
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

/// Triangles about the eye that are connected with those in sight in its middle.
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

/// The places of a triangle's edges, the smaller first.
fn edges(fine: &FineMesh, t: u32) -> [[Place; 2]; 3] {
    let [a, b, c] = fine.mesh.triangles[t as usize].map(|v| place(fine, v));
    [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)])
}

fn place(fine: &FineMesh, v: u32) -> Place {
    // Adding zero makes −0 and 0 one place.
    fine.mesh.positions[v as usize].map(|x| (x + 0.0).to_bits())
}

/// Cuts the sheet along the line. Returns the line in the order in which it bounds the triangles of
/// the eye.
///
/// # Errors
/// `Mesh` where the line is no single loop over the surface.
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
    // New triangles of the sheet and their sides.
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

/// Where edges of the sheet cross the line.
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

    /// The corners of a triangle and the places where its edges cross the line, all around.
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
                    // From the smaller place on, so that both banks of a texture seam get the same one.
                    let [p, q] = [v, w].map(|v| fine.mesh.positions[v as usize]);
                    let is_turned = place(fine, v) > place(fine, w);
                    let between = |p: [f32; 3], q: [f32; 3], t: f32| -> [f32; 3] {
                        std::array::from_fn(|i| p[i] + t * (q[i] - p[i]))
                    };
                    fine.mesh.positions.push(match is_turned {
                        false => between(p, q, to_next),
                        true => between(q, p, b / (b - a)),
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

/// A triangle with places of the line on up to two of its edges as triangles.
fn cut_pieces(around: &[Corner]) -> Vec<[Corner; 3]> {
    let at = |i: usize| around[i % around.len()];
    let is_new = |i: usize| at(i).shares.iter().all(|share| *share < 1.0);
    match around.len() {
        4 => {
            let m = (0..4).find(|&i| is_new(i)).unwrap_or(0);
            vec![[at(m), at(m + 1), at(m + 2)], [at(m), at(m + 2), at(m + 3)]]
        }
        5 => {
            // Two places with one corner between them.
            let m = (0..5).find(|&i| is_new(i) && is_new(i + 2)).unwrap_or(0);
            let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|i| at(m + i));
            vec![[a, b, c], [a, c, d], [a, d, e]]
        }
        _ => vec![[at(0), at(1), at(2)]],
    }
}

/// Gives the pieces inside vertices of their own along the line. `pieces`: number, whether it lies
/// inside, and which of its corners lie on the line.
fn set_free(fine: &mut FineMesh, pieces: &[(usize, bool, [bool; 3])]) -> Result<Vec<RimPlace>> {
    let mut outside = HashMap::new();
    // Edges along the line of pieces outside, by their places.
    let mut banks = HashSet::new();
    for &(number, _, on_line) in pieces.iter().filter(|piece| !piece.1) {
        let t = fine.mesh.triangles[number];
        for k in 0..3 {
            if on_line[k] {
                let source = fine.triangle_sources[number].at_corner(k);
                outside.entry(place(fine, t[k])).or_insert((t[k], source));
                if on_line[(k + 1) % 3] {
                    banks.insert([place(fine, t[k]), place(fine, t[(k + 1) % 3])]);
                }
            }
        }
    }
    let (mut copies, mut next, mut inside) = (HashMap::new(), HashMap::new(), HashMap::new());
    let mut twice = false;
    for &(number, _, on_line) in pieces.iter().filter(|piece| piece.1) {
        let t = fine.mesh.triangles[number];
        for k in 0..3 {
            if !on_line[k] {
                continue;
            }
            let (here, there) = (place(fine, t[k]), place(fine, t[(k + 1) % 3]));
            if !outside.contains_key(&here) {
                continue;
            }
            let copy = *copies.entry(t[k]).or_insert_with(|| {
                fine.mesh.positions.push(fine.mesh.positions[t[k] as usize]);
                fine.vertex_sources.push(fine.vertex_sources[t[k] as usize]);
                fine.mesh.positions.len() as u32 - 1
            });
            fine.mesh.triangles[number][k] = copy;
            let source = fine.triangle_sources[number].at_corner(k);
            inside.entry(here).or_insert((copy, source));
            if banks.contains(&[there, here]) {
                twice |= next.insert(here, there).is_some();
            }
        }
    }
    let first = next.keys().min().copied();
    let mut line = Vec::new();
    let mut at = first;
    while let Some(here) = at {
        let ((lid, lid_source), (eye, eye_source)) = (outside[&here], inside[&here]);
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
    if twice || line.len() < 8 || line.len() != next.len() {
        return Err(Error::Mesh(
            "open eyes: expected one line around each eye on the skin, got a surface that ends or folds there; \
             check the landmarks of the eyes (36 to 47)"
                .into(),
        ));
    }
    Ok(line)
}
