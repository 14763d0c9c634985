//! A tree of boxes over the faces of a mesh: the closest place to any number of points.

use super::{
    Mesh,
    vec3::{dot, sub},
};

/// Faces in a leaf.
const LEAF: usize = 4;
/// When both halves of a box hold at least so many faces, two threads go on, one in each half;
/// below that, starting a thread costs more than it saves.
const SHARED: usize = 10_000;

/// Number and corners.
type Face = (u32, [[f64; 3]; 3]);

/// The closest place of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPlace {
    /// Face of the mesh.
    pub face: u32,
    /// Weights of the face's three corners: at least 0, sum 1.
    pub barycentric: [f64; 3],
    /// Distance to the point that was asked about, mesh units.
    pub distance: f64,
}

/// Finds closest places in time logarithmic in the number of faces. Of several equally close
/// faces it names one, always the same.
#[derive(Debug, Clone)]
pub struct SurfaceTree {
    nodes: Vec<Node>,
    /// In the order of the leaves: face number and corners.
    faces: Vec<Face>,
}

#[derive(Debug, Clone)]
struct Node {
    low: [f64; 3],
    high: [f64; 3],
    /// A leaf's range of faces; otherwise the second child comes `end` nodes later (the first
    /// follows the node).
    begin: u32,
    end: u32,
    is_leaf: bool,
}

impl SurfaceTree {
    /// The tree of all faces.
    pub fn new(mesh: &Mesh) -> SurfaceTree {
        let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        SurfaceTree::of_faces(mesh, &all)
    }

    /// The tree of some faces.
    ///
    /// # Panics
    /// If a face does not exist.
    pub fn of_faces(mesh: &Mesh, faces: &[u32]) -> SurfaceTree {
        let corners = |&f: &u32| (f, mesh.triangles[f as usize].map(|v| mesh.point(v)));
        let mut faces: Vec<Face> = faces.iter().map(corners).collect();
        let mut nodes = Vec::with_capacity(faces.len());
        if !faces.is_empty() {
            split(&mut faces, 0, &mut nodes);
        }
        SurfaceTree { nodes, faces }
    }

    /// The closest place to `point` (mesh units); `None` without faces.
    pub fn closest(&self, point: [f32; 3]) -> Option<ClosestPlace> {
        let point = point.map(f64::from);
        let mut best: Option<ClosestPlace> = None;
        let mut best_squared = f64::INFINITY;
        let mut stack = vec![(0.0, 0usize)];
        while let Some((nearest, at)) = stack.pop() {
            let Some(node) = self.nodes.get(at) else {
                continue;
            };
            if nearest >= best_squared {
                continue;
            }
            if !node.is_leaf {
                let mut children =
                    [at + 1, at + node.end as usize].map(|c| (self.nodes[c].squared(point), c));
                if children[0].0 < children[1].0 {
                    children.swap(0, 1);
                }
                stack.extend(children);
                continue;
            }
            for &(face, corners) in &self.faces[node.begin as usize..node.end as usize] {
                let barycentric = closest_weights(point, corners);
                let offset = sub(point, blend(corners, barycentric));
                let squared = dot(offset, offset);
                if squared < best_squared {
                    best_squared = squared;
                    best = Some(ClosestPlace {
                        face,
                        barycentric,
                        distance: squared.sqrt(),
                    });
                }
            }
        }
        best
    }
}

impl Node {
    /// Squared distance from `p` to the box.
    fn squared(&self, p: [f64; 3]) -> f64 {
        let outside = [0, 1, 2].map(|i| (self.low[i] - p[i]).max(p[i] - self.high[i]).max(0.0));
        dot(outside, outside)
    }
}

/// Appends the node of `faces`, which start at number `begin`, and all below it.
fn split(faces: &mut [Face], begin: u32, nodes: &mut Vec<Node>) {
    let (low, high) = bounds(faces);
    let node = nodes.len();
    let is_leaf = faces.len() <= LEAF;
    nodes.push(Node {
        low,
        high,
        begin,
        end: begin + faces.len() as u32,
        is_leaf,
    });
    if is_leaf {
        return;
    }
    let size = sub(high, low);
    let axis = (0..3)
        .max_by(|&a, &b| size[a].total_cmp(&size[b]))
        .unwrap_or(0);
    let centre = |face: &Face| face.1[0][axis] + face.1[1][axis] + face.1[2][axis];
    let middle = faces.len() / 2;
    faces.select_nth_unstable_by(middle, |a, b| {
        centre(a).total_cmp(&centre(b)).then(a.0.cmp(&b.0))
    });
    let (first, second) = faces.split_at_mut(middle);
    let rest = begin + middle as u32;
    if middle < SHARED {
        split(first, begin, nodes);
        nodes[node].end = (nodes.len() - node) as u32;
        return split(second, rest, nodes);
    }
    let mut below = Vec::new();
    rayon::join(
        || split(first, begin, nodes),
        || split(second, rest, &mut below),
    );
    nodes[node].end = (nodes.len() - node) as u32;
    nodes.append(&mut below);
}

fn bounds(faces: &[Face]) -> ([f64; 3], [f64; 3]) {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for p in faces.iter().flat_map(|(_, corners)| corners) {
        low = [0, 1, 2].map(|i| low[i].min(p[i]));
        high = [0, 1, 2].map(|i| high[i].max(p[i]));
    }
    (low, high)
}

pub(crate) fn blend([a, b, c]: [[f64; 3]; 3], [u, v, w]: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| u * a[i] + v * b[i] + w * c[i])
}

/// Barycentric weights of the point of a triangle closest to `p`: the plane's own point where it
/// lies inside, else the best of the three sides, which also serves triangles without area.
pub(crate) fn closest_weights(p: [f64; 3], [a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let (d00, d01, d11) = (dot(ab, ab), dot(ab, ac), dot(ac, ac));
    let (d20, d21) = (dot(ap, ab), dot(ap, ac));
    let determinant = d00 * d11 - d01 * d01;
    if determinant > 1e-14 * d00 * d11 {
        let v = (d11 * d20 - d01 * d21) / determinant;
        let w = (d00 * d21 - d01 * d20) / determinant;
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            return [1.0 - v - w, v, w];
        }
    }
    let side = |p0: [f64; 3], p1: [f64; 3]| -> (f64, f64) {
        let (along, offset) = (sub(p1, p0), sub(p, p0));
        let t = (dot(offset, along) / dot(along, along)).clamp(0.0, 1.0);
        let t = if t.is_nan() { 0.0 } else { t };
        let rest = [0, 1, 2].map(|i| offset[i] - t * along[i]);
        (dot(rest, rest), t)
    };
    let sides = [side(a, b), side(b, c), side(c, a)];
    let nearest = (0..3)
        .min_by(|&i, &j| sides[i].0.total_cmp(&sides[j].0))
        .unwrap_or(0);
    let mut weights = [0.0; 3];
    weights[nearest] = 1.0 - sides[nearest].1;
    weights[(nearest + 1) % 3] = sides[nearest].1;
    weights
}

#[cfg(test)]
mod tests {
    use super::{super::closest::Balls, *};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_tree_finds_what_the_plain_search_finds(
            points in proptest::collection::vec(proptest::array::uniform3(-2i8..3), 3..40),
            faces in proptest::collection::vec(proptest::array::uniform3(0u32..40), 1..80),
            queries in proptest::collection::vec(proptest::array::uniform3(-4f32..4.0), 1..8),
        ) {
            // A lattice, so that faces coincide, fold and vanish.
            let count = points.len() as u32;
            let mesh = Mesh {
                positions: points.iter().map(|p| p.map(f32::from)).collect(),
                triangles: faces.iter().map(|t| t.map(|v| v % count)).collect(),
            };
            let tree = SurfaceTree::new(&mesh);
            let odd: Vec<u32> = (0..faces.len() as u32).filter(|f| f % 2 == 1).collect();
            let odd_tree = SurfaceTree::of_faces(&mesh, &odd);
            for &query in &queries {
                for (tree, step) in [(&tree, 1), (&odd_tree, 2)] {
                    let expected = Balls::new(&mesh).closest(query, |f| step == 1 || f % 2 == 1);
                    let got = tree.closest(query);
                    prop_assert_eq!(got.is_some(), expected.is_some());
                    let (Some(got), Some(expected)) = (got, expected) else { continue };
                    prop_assert!((got.distance - f64::from(expected.distance)).abs() < 1e-4, "{:?} {:?}", got, expected);
                    prop_assert!((got.barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                    prop_assert!(got.barycentric.iter().all(|w| *w >= 0.0));
                    prop_assert!(step == 1 || got.face % 2 == 1);
                    let corners = mesh.triangles[got.face as usize].map(|v| mesh.point(v));
                    let offset = sub(blend(corners, got.barycentric), query.map(f64::from));
                    prop_assert!((dot(offset, offset).sqrt() - got.distance).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn no_faces_have_no_closest_place() {
        let mesh = Mesh {
            positions: vec![[0.0; 3]; 3],
            triangles: vec![[0, 1, 2]],
        };
        assert_eq!(SurfaceTree::of_faces(&mesh, &[]).closest([0.0; 3]), None);
        assert_eq!(
            SurfaceTree::new(&mesh)
                .closest([0.0, 3.0, 4.0])
                .unwrap()
                .distance,
            5.0
        );
    }
}
