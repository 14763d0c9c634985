//! Cuts the mesh along a line over its surface and parts the two banks.
//!
//! The line crosses the skin between the lips (`trace`). Its places lie on vertices and on edges,
//! and its two ends may lie inside triangles. This module turns it into a line of edges and then
//! gives the lips separate vertices.
//!
//! 1. [`Splitter`] cuts every triangle of the patch that the line crosses into pieces. A place on
//!    an edge becomes one new vertex for each pair of old vertices, so both triangles at that edge
//!    get the same one. At a texture seam the edge has several pairs of vertices, and each pair
//!    gets its own. An end inside a triangle divides the triangle into a fan around that end.
//! 2. [`Banks`] decides for every corner on the line whether it belongs to the upper or to the
//!    lower lip.
//! 3. [`CutMesh::part`] copies the line's vertices that both banks use. The lower bank gets the
//!    copies. Both ends stay shared, since a mouth opens between its corners.
//!
//! Old vertices keep their numbers and places, and old triangles keep their order, so that the
//! surface at rest stays the same. Every new vertex and corner stores its shares of the old
//! vertices and triangles it comes from.
//!
//! The cost is one pass over the triangles of the mesh (F) and hash look-ups for those of the
//! patch.
//!
//! Not obvious: pieces along the line are compared by the points of the patch, where texture seams
//! are sewn up. Their vertices will not do, because a seam has several at one place. A triangle
//! that the line cuts on all three edges has no rule of its own and becomes a plain fan. Where the
//! line has skin on only one side, the mesh is refused.

use std::collections::{HashMap, HashSet};

use glam::{DVec2, DVec3};

use super::{
    patch::{MouthFrame, Patch},
    trace::Node,
};
use crate::{
    Error, Result,
    face::opened::TriangleSource,
    mesh::{Mesh, tree::blend},
};

/// A triangle of the new mesh, which lies inside a triangle of the old one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    pub corners: [u32; 3],
    /// Triangle of the old mesh.
    pub source: u32,
    /// For each corner its shares of the source's corners.
    pub shares: [[f32; 3]; 3],
    /// For each corner its point of the patch. Numbers past the last point are places on the line.
    points: [u32; 3],
}

/// The mesh while it is cut. The old vertices come first and keep their positions.
pub(super) struct CutMesh {
    pub positions: Vec<[f32; 3]>,
    /// For each vertex three old vertices and their shares.
    pub sources: Vec<[(u32, f32); 3]>,
    /// The pieces of the old triangles, in the order of these.
    pub pieces: Vec<Piece>,
    /// The banks from the right corner to the left one. They share both ends.
    pub upper: Vec<u32>,
    pub lower: Vec<u32>,
    /// Whether the faces of the mesh look inward.
    pub is_inside_out: bool,
}

/// A corner of a piece: vertex, point, shares of the source's corners.
type Corner = (u32, u32, [f64; 3]);

impl CutMesh {
    /// Cuts the mesh and parts the banks. `above`: height of a place in the mouth's frame above the
    /// seam.
    ///
    /// # Errors
    /// `Mesh` where the line has no surface on one of its sides.
    pub fn new(
        mesh: &Mesh,
        patch: &Patch,
        line: &[Node],
        above: impl Fn(DVec3) -> f64,
    ) -> Result<CutMesh> {
        let sources = (0..mesh.positions.len() as u32).map(|v| [(v, 1.0), (v, 0.0), (v, 0.0)]);
        let mut cut = CutMesh {
            positions: mesh.positions.clone(),
            sources: sources.collect(),
            pieces: Vec::with_capacity(mesh.triangles.len() + 4 * line.len()),
            upper: Vec::new(),
            lower: Vec::new(),
            is_inside_out: false,
        };
        let in_patch = cut.split(mesh, patch, line);
        cut.part(patch, line, &in_patch, above)?;
        Ok(cut)
    }

    /// Splits every triangle that the line crosses. Returns the pieces of the patch.
    fn split(&mut self, mesh: &Mesh, patch: &Patch, line: &[Node]) -> Vec<u32> {
        let mut splitter = Splitter::new(patch, line);
        let mut of_face = vec![None; mesh.triangles.len()];
        for (number, &face) in patch.faces.iter().enumerate() {
            of_face[face as usize] = Some(number as u32);
        }
        let mut in_patch = Vec::new();
        for (face, &corners) in mesh.triangles.iter().enumerate() {
            let first = self.pieces.len() as u32;
            match of_face[face] {
                Some(number) => splitter.split(self, mesh, face as u32, number),
                None => self.pieces.push(Piece {
                    corners,
                    source: face as u32,
                    shares: TriangleSource::whole(face as u32).corners,
                    points: [u32::MAX; 3],
                }),
            }
            if of_face[face].is_some() {
                in_patch.extend(first..self.pieces.len() as u32);
            }
        }
        in_patch
    }

    /// Adds a vertex as a mixture of old ones.
    fn add(&mut self, mesh: &Mesh, corners: [u32; 3], shares: [f64; 3]) -> u32 {
        let points = corners.map(|v| mesh.point(v));
        self.positions.push(blend(points, shares).as_vec3().into());
        self.sources
            .push([0, 1, 2].map(|k| (corners[k], shares[k] as f32)));
        self.positions.len() as u32 - 1
    }

    /// Gives the lower bank its own vertices.
    fn part(
        &mut self,
        patch: &Patch,
        line: &[Node],
        in_patch: &[u32],
        above: impl Fn(DVec3) -> f64,
    ) -> Result<()> {
        let banks = Banks::new(self, patch, line, in_patch, above)?;
        self.is_inside_out = banks.is_inside_out;
        let (mut lower_copy, mut used_above) = (HashMap::new(), HashMap::new());
        for &(piece, corner, is_lower) in &banks.corners {
            let vertex = self.pieces[piece as usize].corners[corner];
            *used_above.entry(vertex).or_insert(false) |= !is_lower;
        }
        for &(piece, corner, is_lower) in &banks.corners {
            let vertex = self.pieces[piece as usize].corners[corner];
            if !is_lower || !used_above[&vertex] {
                continue;
            }
            let copy = *lower_copy.entry(vertex).or_insert_with(|| {
                self.positions.push(self.positions[vertex as usize]);
                self.sources.push(self.sources[vertex as usize]);
                self.positions.len() as u32 - 1
            });
            self.pieces[piece as usize].corners[corner] = copy;
        }
        let vertex = |&(piece, corner): &(u32, usize)| self.pieces[piece as usize].corners[corner];
        self.upper = banks.upper.iter().map(vertex).collect();
        self.lower = banks.lower.iter().map(vertex).collect();
        // At a texture seam an end may have several vertices. Both banks take the same one.
        let last = line.len() - 1;
        (self.lower[0], self.lower[last]) = (self.upper[0], self.upper[last]);
        Ok(())
    }
}

impl CutMesh {
    /// The skin around the mouth, seen from the front.
    pub fn fronts(&self, frame: &MouthFrame) -> Fronts {
        let pieces = self
            .pieces
            .iter()
            .filter(|piece| piece.points[0] != u32::MAX);
        let place = |v: u32| frame.local_of(self.positions[v as usize]);
        Fronts {
            triangles: pieces
                .map(|piece| (piece.corners, piece.corners.map(place)))
                .collect(),
        }
    }

    /// The sources of a bag's faces: each takes its material and texture from a piece at the rim in
    /// front of it.
    pub fn sources_of_bag(&self, bag: &[[u32; 3]]) -> Vec<TriangleSource> {
        let rims: HashSet<u32> = self.upper.iter().chain(&self.lower).copied().collect();
        let mut beside = HashMap::new();
        for piece in &self.pieces {
            for (corner, shares) in piece.corners.iter().zip(piece.shares) {
                if rims.contains(corner) {
                    beside
                        .entry(self.key_of(*corner))
                        .or_insert((piece.source, shares));
                }
            }
        }
        let of_face = |face: &[u32; 3]| {
            let (triangle, shares) = beside[&self.key_of(face[0])];
            TriangleSource {
                triangle,
                corners: [shares; 3],
            }
        };
        bag.iter().map(of_face).collect()
    }

    /// The sources of a vertex as a key for a hash map.
    fn key_of(&self, vertex: u32) -> [(u32, u32); 3] {
        self.sources[vertex as usize].map(|(v, share)| (v, share.to_bits()))
    }
}

/// Triangles of the skin around the mouth, and their corners in the mouth's frame.
pub(super) struct Fronts {
    triangles: Vec<([u32; 3], [DVec3; 3])>,
}

impl Fronts {
    /// The foremost place at `[x, y]`, and the vertex nearest to it.
    pub fn place(&self, at: DVec2) -> Option<(DVec3, u32)> {
        let hit = |(vertices, corners): &([u32; 3], [DVec3; 3])| {
            let [a, b, c] = corners.map(DVec3::truncate);
            let twice = (b - a).perp_dot(c - a);
            let v = (at - a).perp_dot(c - a) / twice;
            let w = (b - a).perp_dot(at - a) / twice;
            let is_inside = v >= 0.0 && w >= 0.0 && v + w <= 1.0;
            is_inside.then(|| (blend(*corners, [1.0 - v - w, v, w]), *vertices, *corners))
        };
        let hits = self.triangles.iter().filter_map(hit);
        let (place, vertices, corners) = hits.max_by(|a, b| a.0.z.total_cmp(&b.0.z))?;
        let away = |k: &usize| corners[*k].distance(place);
        let nearest = (0..3).min_by(|a, b| away(a).total_cmp(&away(b)))?;
        Some((place, vertices[nearest]))
    }

    /// How far out of the face the foremost place lies, in widths.
    pub fn depth(&self, at: DVec2) -> Option<f64> {
        self.place(at).map(|(place, _)| place.z)
    }
}

/// Cuts triangles at the places of a line.
struct Splitter<'a> {
    patch: &'a Patch,
    /// For edges of the patch with a place: its number on the line, and its share of the edge's
    /// larger point.
    on_edge: HashMap<(u32, u32), (u32, f64)>,
    /// For triangles of the patch with an end inside: its number on the line, and its shares of the
    /// corners.
    inside: HashMap<u32, (u32, [f64; 3])>,
    /// New vertices on edges of the mesh.
    vertices_on_edges: HashMap<(u32, u32), u32>,
}

impl<'a> Splitter<'a> {
    fn new(patch: &'a Patch, line: &[Node]) -> Self {
        let (mut on_edge, mut inside) = (HashMap::new(), HashMap::new());
        for (n, node) in line.iter().enumerate() {
            match *node {
                Node::Vertex(_) => {}
                Node::Edge(a, b, t) => drop(on_edge.insert((a, b), (n as u32, t))),
                Node::Inside(f, shares) => drop(inside.insert(f, (n as u32, shares))),
            }
        }
        Splitter {
            patch,
            on_edge,
            inside,
            vertices_on_edges: HashMap::new(),
        }
    }

    /// Appends the pieces of triangle `face` of the mesh, which has this `number` in the patch.
    fn split(&mut self, cut: &mut CutMesh, mesh: &Mesh, face: u32, number: u32) {
        let rim = self.rim(cut, mesh, face, number);
        let push = |cut: &mut CutMesh, corners: [Corner; 3]| {
            cut.pieces.push(Piece {
                corners: corners.map(|c| c.0),
                source: face,
                shares: corners.map(|c| c.2.map(|x| x as f32)),
                points: corners.map(|c| c.1),
            });
        };
        if let Some(&(place, shares)) = self.inside.get(&number) {
            let vertex = cut.add(mesh, mesh.triangles[face as usize], shares);
            let middle = (vertex, self.patch.points.len() as u32 + place, shares);
            for (i, &corner) in rim.iter().enumerate() {
                push(cut, [corner, rim[(i + 1) % rim.len()], middle]);
            }
            return;
        }
        for corners in triangles_of(&rim, self.patch.points.len() as u32, &cut.positions) {
            push(cut, corners);
        }
    }

    /// The corners of a triangle and the places on its edges, in order around it.
    fn rim(&mut self, cut: &mut CutMesh, mesh: &Mesh, face: u32, number: u32) -> Vec<Corner> {
        let vertices = mesh.triangles[face as usize];
        let points = self.patch.triangles[number as usize];
        let mut rim = Vec::with_capacity(5);
        for k in 0..3 {
            let next = (k + 1) % 3;
            let mut shares = [0.0; 3];
            shares[k] = 1.0;
            rim.push((vertices[k], points[k], shares));
            let (a, b) = (points[k], points[next]);
            let Some(&(place, t)) = self.on_edge.get(&(a.min(b), a.max(b))) else {
                continue;
            };
            let to_next = if a < b { t } else { 1.0 - t };
            shares[k] = 1.0 - to_next;
            shares[next] = to_next;
            let (v, w) = (vertices[k], vertices[next]);
            let entry = self.vertices_on_edges.entry((v.min(w), v.max(w)));
            let vertex = *entry.or_insert_with(|| {
                let (first, second) = if v < w {
                    (1.0 - to_next, to_next)
                } else {
                    (to_next, 1.0 - to_next)
                };
                cut.add(mesh, [v.min(w), v.max(w), v], [first, second, 0.0])
            });
            rim.push((vertex, self.patch.points.len() as u32 + place, shares));
        }
        rim
    }
}

/// Divides a triangle with places on up to two of its edges into triangles. `first_place`: points
/// from this number on are such places.
fn triangles_of(rim: &[Corner], first_place: u32, positions: &[[f32; 3]]) -> Vec<[Corner; 3]> {
    let is_place = |c: &Corner| c.1 >= first_place;
    let at = |i: usize| rim[i % rim.len()];
    let Some(start) =
        (0..rim.len()).find(|&i| is_place(&at(i)) && !is_place(&at(i + 2)) || rim.len() == 3)
    else {
        return fan_of_all(rim);
    };
    match rim.len() {
        3 => vec![[rim[0], rim[1], rim[2]]],
        // The place, then the three corners.
        4 => vec![
            [at(start), at(start + 1), at(start + 2)],
            [at(start), at(start + 2), at(start + 3)],
        ],
        5 => {
            // Two places with one corner between them, in order from the second place on.
            let second = (0..5).find(|&i| is_place(&at(i)) && is_place(&at(i + 3)));
            let Some(second) = second else {
                return fan_of_all(rim);
            };
            let [n2, d, e, n1, c] = [0, 1, 2, 3, 4].map(|k| at(second + k));
            let away = |a: &Corner, b: &Corner| {
                let [p, q] = [a, b].map(|c| positions[c.0 as usize].map(f64::from));
                DVec3::from(p).distance(q.into())
            };
            let mut out = vec![[n1, c, n2]];
            if away(&n2, &e) < away(&d, &n1) {
                out.extend([[n2, d, e], [n2, e, n1]])
            } else {
                out.extend([[n2, d, n1], [d, e, n1]])
            }
            out
        }
        _ => fan_of_all(rim),
    }
}

fn fan_of_all(rim: &[Corner]) -> Vec<[Corner; 3]> {
    (1..rim.len() - 1)
        .map(|i| [rim[0], rim[i], rim[i + 1]])
        .collect()
}

/// Which bank every corner on the line belongs to.
///
/// The triangles have been cut along the line, and now one sheet becomes two banks, the upper and
/// the lower lip. The banks share the line's vertices until [`CutMesh::part`] copies those of the
/// lower bank. For this it needs to know the bank of every corner on the line, also for pieces that
/// touch the line at only one place.
///
/// 1. Pieces with a side on the line come in two kinds. All triangles of the skin wind the same
///    way, so the side of a piece on one bank runs along the line and the side of its neighbour on
///    the other bank runs against it.
/// 2. The heights above the seam say which kind is the upper bank. The sum over all these pieces
///    decides, because a single third corner may lie on the wrong side of the smooth seam. If the
///    kind that runs against the line is higher, the faces of the mesh look inward.
/// 3. Around each inner place of the line the pieces fall into groups that are connected without
///    crossing the line ([`fans`]). A group belongs to the bank of its pieces that have a side on
///    the line.
/// 4. Where a group has no such piece, or pieces of both banks, it belongs to the bank on whose
///    side the points of its pieces lie on average.
///
/// The two ends of the line are corners of the mouth. Both banks keep them, so no corner there is
/// listed.
///
/// The cost is one pass over the pieces of the patch, and at each place of the line the square of
/// the number of pieces around it. Where a segment of the line has no piece on one bank, the skin
/// has a hole and the mesh is refused.
struct Banks {
    /// For each corner on the line its piece, its number in the piece, and whether it lies on the
    /// lower bank.
    corners: Vec<(u32, usize, bool)>,
    /// For each place of the line a piece and its corner on that bank.
    upper: Vec<(u32, usize)>,
    lower: Vec<(u32, usize)>,
    is_inside_out: bool,
}

impl Banks {
    fn new(
        cut: &CutMesh,
        patch: &Patch,
        line: &[Node],
        in_patch: &[u32],
        above: impl Fn(DVec3) -> f64,
    ) -> Result<Banks> {
        let line = CutLine {
            cut,
            patch,
            nodes: line,
        };
        let beside = line.pieces_beside(in_patch, &above);
        let is_inside_out = beside.height < 0.0;
        let [with, against] = if is_inside_out { [1, 0] } else { [0, 1] };
        Ok(Banks {
            upper: line.bank(&beside, with)?,
            lower: line.bank(&beside, against)?,
            corners: line.corners(&beside, [with, against], &above),
            is_inside_out,
        })
    }
}

/// The line and the pieces along it.
struct CutLine<'a> {
    cut: &'a CutMesh,
    patch: &'a Patch,
    nodes: &'a [Node],
}

/// The pieces that touch the line.
struct Beside {
    /// For each segment of the line the piece whose side runs along it, and the piece whose side
    /// runs against it.
    sides: Vec<[Option<u32>; 2]>,
    /// For each place of the line the pieces around it, with their corner there.
    around: Vec<Vec<(u32, usize)>>,
    /// Sum of the heights above the seam of the pieces that run along the line, minus that of the
    /// pieces that run against it. The height of a piece is that of its corner off the line.
    height: f64,
}

impl CutLine<'_> {
    /// The number of a place of the line in the `points` of pieces.
    fn point(&self, n: usize) -> u32 {
        match self.nodes[n] {
            Node::Vertex(v) => v,
            _ => self.patch.points.len() as u32 + n as u32,
        }
    }

    fn position(&self, point: u32) -> DVec3 {
        match point.checked_sub(self.patch.points.len() as u32) {
            Some(n) => self.nodes[n as usize].position(self.patch),
            None => self.patch.points[point as usize],
        }
    }

    fn points_of(&self, piece: u32) -> [u32; 3] {
        self.cut.pieces[piece as usize].points
    }

    fn pieces_beside(&self, in_patch: &[u32], above: &impl Fn(DVec3) -> f64) -> Beside {
        let count = self.nodes.len();
        let place: HashMap<u32, usize> = (0..count).map(|n| (self.point(n), n)).collect();
        let mut beside = Beside {
            sides: vec![[None; 2]; count - 1],
            around: vec![Vec::new(); count],
            height: 0.0,
        };
        for &number in in_patch {
            let points = self.points_of(number);
            for k in 0..3 {
                let Some(&n) = place.get(&points[k]) else {
                    continue;
                };
                beside.around[n].push((number, k));
                let Some(&next) = place.get(&points[(k + 1) % 3]) else {
                    continue;
                };
                let third = above(self.position(points[(k + 2) % 3]));
                if next == n + 1 {
                    beside.sides[n][0] = Some(number);
                    beside.height += third;
                } else if next + 1 == n {
                    beside.sides[next][1] = Some(number);
                    beside.height -= third;
                }
            }
        }
        beside
    }

    /// For each place of the line a piece and its corner on one bank.
    fn bank(&self, beside: &Beside, side: usize) -> Result<Vec<(u32, usize)>> {
        let hole = || {
            Error::Mesh(
                "expected skin on both sides of the line between the lips, got a hole".into(),
            )
        };
        let corner_of = |number: u32, n: usize| {
            let points = self.points_of(number);
            let k = points.iter().position(|p| *p == self.point(n));
            (number, k.expect("a piece along the line has its places"))
        };
        (0..self.nodes.len())
            .map(|n| {
                beside.sides[n.min(self.nodes.len() - 2)][side]
                    .map(|number| corner_of(number, n))
                    .ok_or_else(hole)
            })
            .collect()
    }

    /// All corners at the inner places of the line, and whether each lies on the lower bank.
    fn corners(
        &self,
        beside: &Beside,
        [with, against]: [usize; 2],
        above: &impl Fn(DVec3) -> f64,
    ) -> Vec<(u32, usize, bool)> {
        let sides = &beside.sides;
        let mut corners = Vec::new();
        for n in 1..self.nodes.len() - 1 {
            let ends = [self.point(n - 1), self.point(n + 1)];
            let groups = fans(self.cut, &beside.around[n], ends);
            let group_of = |piece: Option<u32>| {
                groups
                    .iter()
                    .position(|g| g.iter().any(|(p, _)| Some(*p) == piece))
            };
            let lower = [n - 1, n].map(|s| group_of(sides[s][against]));
            let upper = [n - 1, n].map(|s| group_of(sides[s][with]));
            for (g, group) in groups.iter().enumerate() {
                let is_lower = match (lower.contains(&Some(g)), upper.contains(&Some(g))) {
                    (true, false) => true,
                    (false, true) => false,
                    _ => {
                        let points = group.iter().flat_map(|&(p, _)| self.points_of(p));
                        points.map(|p| above(self.position(p))).sum::<f64>() < 0.0
                    }
                };
                corners.extend(group.iter().map(|&(piece, k)| (piece, k, is_lower)));
            }
        }
        corners
    }
}

/// Groups the pieces around a place so that each group is connected without crossing the line.
/// `ends`: the place's neighbours on the line.
fn fans(cut: &CutMesh, around: &[(u32, usize)], ends: [u32; 2]) -> Vec<Vec<(u32, usize)>> {
    let others = |&(piece, k): &(u32, usize)| {
        let points = cut.pieces[piece as usize].points;
        [points[(k + 1) % 3], points[(k + 2) % 3]]
    };
    let mut groups: Vec<Vec<(u32, usize)>> = Vec::new();
    for corner in around {
        let sides = others(corner);
        let touches = |group: &Vec<(u32, usize)>| {
            let all = group.iter().flat_map(others);
            all.into_iter()
                .any(|p| sides.contains(&p) && !ends.contains(&p))
        };
        let (joined, apart): (Vec<_>, Vec<_>) = groups.into_iter().partition(touches);
        groups = apart;
        groups.push(joined.into_iter().flatten().chain([*corner]).collect());
    }
    groups
}
