//! The line between the lips on the surface: a level set of the height above the seam.
//!
//! Every point of the patch has a height above the seam. The line crosses the surface where this
//! height changes sign. It may run through triangles, so the mesh needs no edges along it. Folds
//! and beards would give it branches. So the heights are smoothed along the surface (one backward
//! step of heat flow), more and more until one line leads from corner to corner.

use std::collections::{BTreeMap, BinaryHeap};

use glam::DVec3;

use super::{patch::Patch, valley::SeamLine};
use crate::{
    Error, Result,
    mesh::{
        Mesh,
        dijkstra::QueueEntry,
        tree::{blend, closest_weights},
    },
    operators::{NO_ROW, OperatorOptions, Operators, SparseCholesky},
};

/// Lengths over which heights are smoothed, in widths of the mouth, tried one after the other.
const SMOOTHED_OVER: [f64; 5] = [0.01, 0.03, 0.06, 0.12, 0.25];
/// A crossing this near to the end of an edge, as a share of the edge, is moved to the vertex
/// there.
const SNAP: f64 = 0.18;
/// The line may end this far from a corner, in widths, plus 1.2 times the longest edge there.
const MISS: f64 = 0.06;
/// The line reaches at most this far beyond a corner, in widths.
const BEYOND: f64 = 0.3;
const LONGEST: f64 = 3.0;
/// A corner beside a piece of the line cuts the piece, but not within this share of either end.
const TRIM: f64 = 0.15;

/// A point where the line meets an edge or a vertex of the patch, or one of the line's two ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Node {
    /// A point of the patch.
    Vertex(u32),
    /// Two points of the patch, ascending, and the weight of the second.
    Edge(u32, u32, f64),
    /// A triangle of the patch and the weights of its corners. Only an end of the line lies inside
    /// a triangle.
    Inside(u32, [f64; 3]),
}

impl Node {
    pub fn position(self, patch: &Patch) -> DVec3 {
        let at = |v: u32| patch.points[v as usize];
        match self {
            Node::Vertex(v) => at(v),
            Node::Edge(a, b, t) => at(a) + t * (at(b) - at(a)),
            Node::Inside(f, shares) => blend(patch.triangles[f as usize].map(at), shares),
        }
    }
}

/// The line from the subject's right corner of the mouth to the left one. `corners`: the corners of
/// the mouth, in its frame.
///
/// # Errors
/// `Mesh` where no line leads from corner to corner.
pub(super) fn trace(patch: &Patch, line: &SeamLine, corners: [DVec3; 2]) -> Result<Vec<Node>> {
    let heights = patch.points.iter();
    let heights: Vec<f64> = heights.map(|p| p[1] - line.height(p[0])).collect();
    let heat = Heat::of(patch);
    for length in SMOOTHED_OVER {
        let smooth = heat
            .as_ref()
            .and_then(|heat| heat.smoothed(&heights, length));
        let level = Level::of(patch, smooth.as_deref().unwrap_or(&heights));
        if let Some(nodes) = level.line(corners) {
            return Ok(nodes);
        }
    }
    Err(Error::Mesh(
        "expected a line between the lips from corner to corner (landmarks 60 and 64), got a surface \
         that ends or folds there; check the landmarks of the mouth"
            .into(),
    ))
}

/// Smooths values of points along the patch.
struct Heat {
    operators: Operators,
}

impl Heat {
    /// `None` where the operators of the patch cannot be built.
    fn of(patch: &Patch) -> Option<Heat> {
        let mesh = Mesh {
            positions: patch.points.iter().map(|p| p.as_vec3().into()).collect(),
            triangles: patch.triangles.clone(),
        };
        let options = OperatorOptions {
            weld: false,
            ..OperatorOptions::default()
        };
        let operators = Operators::new(&mesh, &options).ok()?;
        Some(Heat { operators })
    }

    /// Solves `(M + ℓ² L) x = M h`, which evens out heights that differ over less than `ℓ`.
    fn smoothed(&self, heights: &[f64], length: f64) -> Option<Vec<f64>> {
        let operators = &self.operators;
        let flow = operators
            .laplacian
            .combine(length * length, 0.0, &operators.laplacian)
            .ok()?;
        let system = flow.add_diagonal(1.0, &operators.mass).ok()?;
        let rows = operators.vertex_of_row.iter().zip(&operators.mass);
        let mut values: Vec<f64> = rows.map(|(&v, m)| m * heights[v as usize]).collect();
        SparseCholesky::factor(&system)
            .ok()?
            .solve_in_place(&mut values, 1);
        let of_point = |(v, &row): (usize, &u32)| match row {
            NO_ROW => heights[v],
            row => values[row as usize],
        };
        Some(
            operators
                .row_of_vertex
                .iter()
                .enumerate()
                .map(of_point)
                .collect(),
        )
    }
}

/// The level set: its nodes, and links between two nodes of one triangle.
struct Level<'a> {
    patch: &'a Patch,
    nodes: Vec<Node>,
    positions: Vec<DVec3>,
    /// For each node its links: the other node and the triangle.
    links: Vec<Vec<(u32, u32)>>,
}

impl<'a> Level<'a> {
    fn of(patch: &'a Patch, heights: &[f64]) -> Level<'a> {
        let signs = signs(patch, heights);
        let mut level = Level {
            patch,
            nodes: Vec::new(),
            positions: Vec::new(),
            links: Vec::new(),
        };
        let mut numbers = BTreeMap::new();
        for (face, t) in patch.triangles.iter().enumerate() {
            let on = t.iter().filter(|&&v| signs[v as usize] == 0);
            let mut met: Vec<Node> = on.map(|&v| Node::Vertex(v)).collect();
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let (a, b) = (a.min(b), a.max(b));
                if signs[a as usize] * signs[b as usize] < 0 {
                    let [x, y] = [a, b].map(|v| heights[v as usize]);
                    met.push(Node::Edge(a, b, x / (x - y)));
                }
            }
            let met: Vec<u32> = met
                .into_iter()
                .map(|n| level.number(&mut numbers, n))
                .collect();
            for (i, &a) in met.iter().enumerate() {
                for &b in &met[i + 1..] {
                    level.links[a as usize].push((b, face as u32));
                    level.links[b as usize].push((a, face as u32));
                }
            }
        }
        level
    }

    fn number(&mut self, numbers: &mut BTreeMap<(u32, u32), u32>, node: Node) -> u32 {
        let key = match node {
            Node::Vertex(v) => (v, v),
            Node::Edge(a, b, _) => (a, b),
            Node::Inside(..) => unreachable!("ends are found later"),
        };
        *numbers.entry(key).or_insert_with(|| {
            self.nodes.push(node);
            self.positions.push(node.position(self.patch));
            self.links.push(Vec::new());
            self.nodes.len() as u32 - 1
        })
    }

    /// The first line that leads from near one corner to near the other.
    fn line(&self, corners: [DVec3; 2]) -> Option<Vec<Node>> {
        let [starts, ends] = corners.map(|corner| {
            let reach = MISS + 1.2 * self.patch.edge_near(corner);
            self.near(corner, reach)
        });
        let mut tried = vec![false; self.nodes.len()];
        for start in starts {
            if tried[start as usize] {
                continue;
            }
            let from = self.ways_from(start);
            (tried.iter_mut().zip(&from)).for_each(|(tried, from)| *tried |= from.is_some());
            if let Some(&end) = ends.iter().find(|&&end| from[end as usize].is_some()) {
                let way = self.way_back(&from, end);
                if way.len() > 1 && self.is_between(&way, corners) {
                    return Some(self.with_ends(way, corners)).filter(|line| line.len() > 2);
                }
            }
        }
        None
    }

    /// Nodes near a corner, the nearest first.
    fn near(&self, corner: DVec3, reach: f64) -> Vec<u32> {
        let mut near: Vec<(f64, u32)> = (0..self.nodes.len() as u32)
            .map(|n| (self.positions[n as usize].distance(corner), n))
            .filter(|(away, _)| *away < reach)
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.into_iter().map(|(_, n)| n).collect()
    }

    /// Whether a path stays on the front of the mouth: it never goes far beyond the corners and is
    /// not too long.
    fn is_between(&self, way: &[u32], corners: [DVec3; 2]) -> bool {
        let (low, high) = (corners[0][0] - BEYOND, corners[1][0] + BEYOND);
        let length: f64 = way
            .windows(2)
            .map(|ends| self.positions[ends[0] as usize].distance(self.positions[ends[1] as usize]))
            .sum();
        let inside = |&n: &u32| (low..high).contains(&self.positions[n as usize][0]);
        way.iter().all(inside) && length < LONGEST
    }

    /// For every node that can be reached from `start`, the node before it on the shortest path.
    fn ways_from(&self, start: u32) -> Vec<Option<u32>> {
        let mut from = vec![None; self.nodes.len()];
        let mut least = vec![f32::INFINITY; self.nodes.len()];
        let mut heap = BinaryHeap::from([QueueEntry(0.0, start, start)]);
        while let Some(QueueEntry(length, node, before)) = heap.pop() {
            if from[node as usize].is_some() {
                continue;
            }
            from[node as usize] = Some(before);
            for &(next, _) in &self.links[node as usize] {
                let [a, b] = [node, next].map(|n| self.positions[n as usize]);
                let there = length + a.distance(b) as f32;
                if from[next as usize].is_none() && there < least[next as usize] {
                    least[next as usize] = there;
                    heap.push(QueueEntry(there, next, node));
                }
            }
        }
        from
    }

    fn way_back(&self, from: &[Option<u32>], end: u32) -> Vec<u32> {
        let mut way = vec![end];
        let mut at = end;
        while let Some(before) = from[at as usize].filter(|&before| before != at) {
            way.push(before);
            at = before;
        }
        way.reverse();
        way
    }

    /// Ends the line at the corners themselves where they lie well inside a triangle that it
    /// crosses.
    fn with_ends(&self, way: Vec<u32>, corners: [DVec3; 2]) -> Vec<Node> {
        let mut line: Vec<Node> = way.iter().map(|&n| self.nodes[n as usize]).collect();
        let end = self.end(&way, corners[1], true);
        let start = self.end(&way, corners[0], false);
        if let Some((node, beyond)) = end {
            line.truncate(line.len() - usize::from(!beyond));
            line.push(node);
        }
        if let Some((node, beyond)) = start {
            let first = usize::from(!beyond);
            line.splice(..first, [node]);
        }
        line
    }

    /// An end inside a triangle, and whether it lies beyond the outermost node of the path.
    fn end(&self, way: &[u32], corner: DVec3, last: bool) -> Option<(Node, bool)> {
        let at = if last { way.len() - 1 } else { 0 };
        let inner = if last {
            at.checked_sub(1)
        } else {
            (at + 1 < way.len()).then_some(1)
        }?;
        let (tip, before) = (way[at], way[inner]);
        let p = self.positions[tip as usize];
        let ways = self.links[tip as usize].iter();
        let places = ways.filter_map(|&(other, face)| {
            let q = self.positions[other as usize];
            let way = q - p;
            let along = (corner - p).dot(way) / way.length_squared().max(1e-30);
            let fits = (TRIM..1.0 - TRIM).contains(&along) && !self.is_edge(tip, other);
            let beyond = other != before;
            fits.then(|| {
                let place = p + along * way;
                (place.distance(corner), place, face, beyond)
            })
        });
        let (_, place, face, beyond) = places.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let corners = self.patch.triangles[face as usize].map(|v| self.patch.points[v as usize]);
        let shares = closest_weights(place, corners);
        Some((Node::Inside(face, shares), beyond))
    }

    /// Whether two nodes lie on one edge of the mesh.
    fn is_edge(&self, a: u32, b: u32) -> bool {
        let pair = [a, b].map(|n| self.nodes[n as usize]);
        matches!(pair, [Node::Vertex(_), Node::Vertex(_)])
    }
}

/// 1 above the level, −1 below it. 0 is so near to the level that a crossing would leave a sliver.
fn signs(patch: &Patch, heights: &[f64]) -> Vec<i8> {
    let sign = |h: f64| if h < 0.0 { -1i8 } else { 1 };
    let mut signs: Vec<i8> = heights.iter().map(|&h| sign(h)).collect();
    for t in &patch.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            let [x, y] = [a, b].map(|v| heights[v as usize]);
            if sign(x) == sign(y) {
                continue;
            }
            let share = x / (x - y);
            if share < SNAP {
                signs[a as usize] = 0;
            } else if share > 1.0 - SNAP {
                signs[b as usize] = 0;
            }
        }
    }
    signs
}
