//! A tree of boxes over the faces of a mesh. Finds the closest place to any point.

use glam::{DVec3, Vec3};

use super::Mesh;

/// Faces in a leaf.
const LEAF: usize = 4;
/// When both halves of a box hold at least this many faces, two threads continue, one in each half.
/// With fewer faces a thread costs more than it saves.
const SHARED: usize = 10_000;

/// Face number and corners.
type Face = (u32, [DVec3; 3]);

/// The closest place of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPlace {
    /// Face of the mesh.
    pub face: u32,
    /// Weights of the face's three corners: at least 0, sum 1.
    pub barycentric: [f64; 3],
    /// Distance to the query point, mesh units.
    pub distance: f64,
}

/// The closest place on the faces that a caller allows, in single precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SurfacePoint {
    pub position: [f32; 3],
    pub triangle: usize,
    /// Distance to the query point, mesh units.
    pub distance: f32,
}

/// Finds closest places in time logarithmic in the number of faces. Among equally close faces the
/// choice is always the same.
#[derive(Debug, Clone)]
pub struct SurfaceTree {
    nodes: Vec<Node>,
    /// In the order of the leaves: face number and corners.
    faces: Vec<Face>,
}

#[derive(Debug, Clone)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// In a leaf, `begin` and `end` are its range of faces. In any other node, the first child
    /// follows the node and the second child comes `end` nodes later.
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
        let point = Vec3::from(point).as_dvec3();
        let (mut best, mut best_squared) = (None, f64::INFINITY);
        self.visit(point, |face, corners| {
            let barycentric = closest_weights(point, corners);
            let squared = point.distance_squared(blend(corners, barycentric));
            if squared < best_squared {
                best_squared = squared;
                best = Some(ClosestPlace {
                    face,
                    barycentric,
                    distance: squared.sqrt(),
                });
            }
            best_squared
        });
        best
    }

    /// The closest place on the faces that `allowed` accepts, in single precision. Among equally
    /// close faces, the smallest number wins. `None` if `allowed` accepts no face.
    pub(crate) fn closest_where(
        &self,
        point: [f32; 3],
        allowed: impl Fn(usize) -> bool,
    ) -> Option<SurfacePoint> {
        let point = Vec3::from(point);
        let (mut best, mut bound) = (None::<SurfacePoint>, f64::INFINITY);
        self.visit(point.as_dvec3(), |face, corners| {
            let triangle = face as usize;
            if !allowed(triangle) {
                return bound;
            }
            let weights = closest_weights(point.as_dvec3(), corners);
            let position = blend(corners, weights).as_vec3();
            let distance = point.distance(position);
            let known = best.map_or((f32::INFINITY, 0), |b| (b.distance, b.triangle));
            if (distance, triangle) < known {
                best = Some(SurfacePoint {
                    position: position.into(),
                    triangle,
                    distance,
                });
                // Rounding must not exclude a face that is just as near.
                bound = f64::from(distance + 1e-5 * (distance + point.length())).powi(2);
            }
            bound
        });
        best
    }

    /// Passes faces and their corners to `meet`, near boxes first. `meet` returns a squared
    /// distance. Boxes farther away than that are skipped.
    fn visit(&self, point: DVec3, mut meet: impl FnMut(u32, [DVec3; 3]) -> f64) {
        let mut bound = f64::INFINITY;
        let mut stack = vec![(0.0, 0usize)];
        while let Some((nearest, at)) = stack.pop() {
            let Some(node) = self.nodes.get(at) else {
                continue;
            };
            if nearest >= bound {
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
                bound = meet(face, corners);
            }
        }
    }
}

impl Node {
    /// Squared distance from `p` to the box.
    fn squared(&self, p: DVec3) -> f64 {
        let outside = (self.low - p).max(p - self.high).max(DVec3::ZERO);
        outside.length_squared()
    }
}

/// Appends the node of `faces` and all nodes below it. `begin` is the index of the first face.
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
    let size = high - low;
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

fn bounds(faces: &[Face]) -> (DVec3, DVec3) {
    let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let corners = faces.iter().flat_map(|(_, corners)| corners);
    corners.fold(start, |(low, high), &p| (low.min(p), high.max(p)))
}

pub(crate) fn blend([a, b, c]: [DVec3; 3], [u, v, w]: [f64; 3]) -> DVec3 {
    u * a + v * b + w * c
}

/// Barycentric weights of the point of a triangle that is closest to `p`: the projection onto the
/// plane if it lies inside, else the closest point on the three sides. Triangles without area also
/// use the sides.
pub(crate) fn closest_weights(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d00, d01, d11) = (ab.length_squared(), ab.dot(ac), ac.length_squared());
    let (d20, d21) = (ap.dot(ab), ap.dot(ac));
    let determinant = d00 * d11 - d01 * d01;
    if determinant > 1e-14 * d00 * d11 {
        let v = (d11 * d20 - d01 * d21) / determinant;
        let w = (d00 * d21 - d01 * d20) / determinant;
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            return [1.0 - v - w, v, w];
        }
    }
    let side = |p0: DVec3, p1: DVec3| -> (f64, f64) {
        let (along, offset) = (p1 - p0, p - p0);
        let t = (offset.dot(along) / along.length_squared()).clamp(0.0, 1.0);
        let t = if t.is_nan() { 0.0 } else { t };
        ((offset - t * along).length_squared(), t)
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
    use super::*;
    use proptest::prelude::*;

    /// Checks every face.
    fn plain_search(
        mesh: &Mesh,
        point: [f32; 3],
        allowed: impl Fn(usize) -> bool,
    ) -> Option<SurfacePoint> {
        let of_face = |triangle: usize| {
            let corners = mesh.triangles[triangle].map(|v| mesh.point(v));
            let weights = closest_weights(Vec3::from(point).as_dvec3(), corners);
            let position = blend(corners, weights).as_vec3();
            SurfacePoint {
                position: position.into(),
                triangle,
                distance: Vec3::from(point).distance(position),
            }
        };
        let all = (0..mesh.triangles.len()).filter(|&f| allowed(f));
        all.map(of_face)
            .min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    fn triangle() -> Mesh {
        Mesh {
            positions: vec![[0.0, 0.0, 0.0], [2.0, 0.1, -0.3], [0.4, 1.5, 0.6]],
            triangles: vec![[0, 1, 2]],
        }
    }

    proptest! {
        /// Compares with a slow twin: the best of a fine barycentric grid.
        #[test]
        fn closest_point_beats_every_sample(p in prop::array::uniform3(-3.0f32..3.0)) {
            let mesh = triangle();
            let closest = SurfaceTree::new(&mesh).closest_where(p, |_| true).unwrap();
            let mut best = f32::MAX;
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let (u, v) = (i as f32 / 40.0, j as f32 / 40.0);
                    let [a, b, c] = [0, 1, 2].map(|k| Vec3::from(mesh.positions[k]));
                    let sample = (1.0 - u - v) * a + u * b + v * c;
                    best = best.min(sample.distance(p.into()));
                }
            }
            prop_assert!(closest.distance <= best + 1e-4);
            prop_assert!(best - closest.distance < 0.06);
        }

        #[test]
        fn the_tree_finds_what_the_plain_search_finds(
            points in proptest::collection::vec(proptest::array::uniform3(-2i8..3), 3..40),
            faces in proptest::collection::vec(proptest::array::uniform3(0u32..40), 1..80),
            queries in proptest::collection::vec(proptest::array::uniform3(-4f32..4.0), 1..8),
        ) {
            // Points lie on a lattice, so that some faces coincide, fold or vanish.
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
                    let allowed = |f: usize| step == 1 || f % 2 == 1;
                    let expected = plain_search(&mesh, query, allowed);
                    prop_assert_eq!(SurfaceTree::new(&mesh).closest_where(query, allowed), expected);
                    let got = tree.closest(query);
                    prop_assert_eq!(got.is_some(), expected.is_some());
                    let (Some(got), Some(expected)) = (got, expected) else { continue };
                    prop_assert!((got.distance - f64::from(expected.distance)).abs() < 1e-4, "{:?} {:?}", got, expected);
                    prop_assert!((got.barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                    prop_assert!(got.barycentric.iter().all(|w| *w >= 0.0));
                    prop_assert!(step == 1 || got.face % 2 == 1);
                    let corners = mesh.triangles[got.face as usize].map(|v| mesh.point(v));
                    let place = blend(corners, got.barycentric);
                    let away = place.distance(Vec3::from(query).as_dvec3());
                    prop_assert!((away - got.distance).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn no_allowed_triangle_gives_none() {
        for mesh in [triangle(), Mesh::default()] {
            let tree = SurfaceTree::new(&mesh);
            assert!(tree.closest_where([0.0; 3], |_| false).is_none());
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
