//! Whether the lips of a mesh can part.

use std::collections::BinaryHeap;

use glam::Vec3;

use super::{Landmarks, Mesh, dijkstra::QueueEntry, parts::weld_seams};

/// Inner-lip landmarks that face each other, upper and lower.
const PAIRS: [(usize, usize); 3] = [(61, 67), (62, 66), (63, 65)];

/// Lips are welded if the shortest path between them along the surface is at most this many times
/// their straight distance, plus `GROOVE_IN_WIDTHS` times the mouth's width.
const DETOUR: f32 = 1.5;
/// 15 mm on a human head: enough for a groove, too little for the inside of a mouth.
const GROOVE_IN_WIDTHS: f32 = 0.3;

/// Lips of one surface are joined in the middle of the mouth too: by a path of at most so many widths
/// of the mouth that leads at most so many widths away from the middle. Around the end of a slit a
/// path leads farther, also where the landmarks lie a third too far apart.
const GROOVE_OF_MIDDLE: (f32, f32) = (0.5, 0.15);

/// Lips further apart than this share of the mouth's width are open (5 mm).
const OPEN_IN_WIDTHS: f32 = 0.1;

/// Vertices this close to an inner-lip landmark, as a share of the mouth's width, are not sewn,
/// because a closed slit looks like a texture seam.
const APART_IN_WIDTHS: f32 = 0.2;

/// If more than this share of the vertices near the inner lips lies on seams, the mesh is cut along
/// every edge (flat shading). Its seams then mean nothing, and all of them are sewn.
const FLAT_SHARE: f32 = 0.6;

/// How the lips of a mesh meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mouth {
    /// Apart, with nothing or the mouth's inside between them.
    Open,
    /// Closed, but not joined.
    Slit,
    /// One surface.
    Welded,
}

impl Mouth {
    /// Decides by the distance along the edges between the inner lips. The majority of the pairs
    /// counts, unless no path joins the middle of the lips. Then the other pairs lie at the ends of a
    /// slit that is narrower than the landmarks, or on the same lip.
    pub fn of(mesh: &Mesh, landmarks: &Landmarks) -> Mouth {
        let at = |i: usize| landmarks.positions[i];
        let width = Vec3::from(at(48)).distance(at(54).into());
        let roads = Roads::near(mesh, landmarks, width);
        let mut welded = 0;
        let mut gaps = PAIRS.map(|(upper, lower)| {
            let gap = Vec3::from(at(upper)).distance(at(lower).into());
            let [from, to] = [upper, lower].map(|i| landmarks.vertices[i]);
            let [a, b] = [from, to].map(|v| mesh.positions[v as usize]);
            let reach = DETOUR * Vec3::from(a).distance(b.into()) + GROOVE_IN_WIDTHS * width;
            welded += usize::from(roads.joined(mesh, (from, to), reach, |_| true));
            gap
        });
        let is_welded = welded >= 2 && roads.is_joined_in_the_middle(mesh, landmarks, width);
        gaps.sort_by(f32::total_cmp);
        match (is_welded, gaps[1] > OPEN_IN_WIDTHS * width) {
            (true, _) => Mouth::Welded,
            (false, true) => Mouth::Open,
            (false, false) => Mouth::Slit,
        }
    }

    /// `open`, `slit` or `welded`.
    pub fn name(self) -> &'static str {
        match self {
            Mouth::Open => "open",
            Mouth::Slit => "slit",
            Mouth::Welded => "welded",
        }
    }

    /// One sentence about its effect on motion.
    pub fn sentence(self) -> &'static str {
        match self {
            Mouth::Open => "the mouth is open: its lips part and close",
            Mouth::Slit => "the lips are a closed slit: they part",
            Mouth::Welded => {
                "the lips are one surface and cannot part: they move as one, and the jaw, lip \
                 corners, pucker, cheeks, brows and lids still move; open the mouth (anyface \
                 open-mouth) to let the lips part"
            }
        }
    }
}

/// Edges around the mouth, with texture seams sewn up.
struct Roads {
    /// `[V]`, the vertex that stands for each vertex.
    sewn: Vec<u32>,
    /// Sorted pairs of vertices that share an edge, in both directions.
    edges: Vec<(u32, u32)>,
}

impl Roads {
    fn near(mesh: &Mesh, landmarks: &Landmarks, width: f32) -> Self {
        let inner = &landmarks.positions[60..68];
        let within = |v: u32, reach: f32| {
            let p = mesh.positions[v as usize];
            inner
                .iter()
                .any(|q| Vec3::from(p).distance((*q).into()) < reach)
        };
        let all = 0..mesh.positions.len() as u32;
        let apart: Vec<u32> = all
            .filter(|&v| within(v, APART_IN_WIDTHS * width))
            .collect();
        let around = |t: &&[u32; 3]| t.iter().any(|&v| within(v, width));
        let triangles: Vec<[u32; 3]> = mesh.triangles.iter().filter(around).copied().collect();
        let mut sewn = weld_seams(&mesh.positions, &triangles, &apart);
        let all_sewn = weld_seams(&mesh.positions, &triangles, &[]);
        if flat_shaded(&triangles, &apart, &all_sewn) {
            sewn = all_sewn;
        }
        let mut edges = Vec::new();
        for t in triangles {
            let [a, b, c] = t.map(|v| sewn[v as usize]);
            edges.extend([(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)]);
        }
        edges.sort_unstable();
        edges.dedup();
        Roads { sewn, edges }
    }

    /// Whether a path joins the middles of both lips and does not lead around an end of a slit.
    fn is_joined_in_the_middle(&self, mesh: &Mesh, landmarks: &Landmarks, width: f32) -> bool {
        let at = |i: usize| Vec3::from(landmarks.positions[i]);
        let across = (at(54) - at(48)).normalize_or_zero();
        let (upper, lower) = PAIRS[1];
        let middle = at(upper).midpoint(at(lower));
        let (length, beside) = GROOVE_OF_MIDDLE;
        let reach = DETOUR * at(upper).distance(at(lower)) + length * width;
        let aside = |v: u32| {
            let way = Vec3::from(mesh.positions[v as usize]) - middle;
            way.dot(across).abs()
        };
        let ends = [upper, lower].map(|i| landmarks.vertices[i]);
        // On a coarse mesh the vertices of the landmarks may lie farther aside.
        let most = ends.map(aside).into_iter().fold(beside * width, f32::max);
        // A texture seam may run between the lips' middles, as on mirrored faces, and is not sewn up here.
        let is_touching = mesh.positions[ends[0] as usize] == mesh.positions[ends[1] as usize];
        let [uppers, lowers] = if is_touching {
            ends.map(|end| vec![end])
        } else {
            ends.map(|end| copies_of(mesh, end))
        };
        let mut pairs = uppers
            .iter()
            .flat_map(|&upper| lowers.iter().map(move |&lower| (upper, lower)));
        pairs.any(|pair| self.joined(mesh, pair, reach, |v| aside(v) <= most))
    }

    /// Whether a path no longer than `reach` joins two vertices over vertices that are `allowed`.
    fn joined(
        &self,
        mesh: &Mesh,
        (from, to): (u32, u32),
        reach: f32,
        allowed: impl Fn(u32) -> bool,
    ) -> bool {
        let [from, to] = [from, to].map(|v| self.sewn[v as usize]);
        let mut nearest = std::collections::HashMap::from([(from, 0.0f32)]);
        let mut heap = BinaryHeap::from([QueueEntry(0.0, from, ())]);
        while let Some(QueueEntry(distance, vertex, ())) = heap.pop() {
            if vertex == to {
                return true;
            }
            let first = self.edges.partition_point(|e| e.0 < vertex);
            for &(_, next) in self.edges[first..].iter().take_while(|e| e.0 == vertex) {
                let [a, b] = [vertex, next].map(|v| mesh.positions[v as usize]);
                let there = distance + Vec3::from(a).distance(b.into());
                let known = nearest.get(&next).copied().unwrap_or(f32::MAX);
                if there <= reach && there < known && allowed(next) {
                    nearest.insert(next, there);
                    heap.push(QueueEntry(there, next, ()));
                }
            }
        }
        false
    }
}

/// The vertices at the place of a vertex, itself included.
fn copies_of(mesh: &Mesh, vertex: u32) -> Vec<u32> {
    let place = mesh.positions[vertex as usize];
    let all = (0u32..).zip(&mesh.positions);
    all.filter(|(_, p)| **p == place).map(|(v, _)| v).collect()
}

/// Whether more than `FLAT_SHARE` of the vertices of `apart` that have faces lie on seams.
fn flat_shaded(triangles: &[[u32; 3]], apart: &[u32], sewn: &[u32]) -> bool {
    let mut group = std::collections::HashMap::new();
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    for v in &used {
        *group.entry(sewn[*v as usize]).or_insert(0) += 1;
    }
    let near: Vec<&u32> = apart
        .iter()
        .filter(|v| used.binary_search(v).is_ok())
        .collect();
    let on_seam = near
        .iter()
        .filter(|v| group[&sewn[***v as usize]] > 1)
        .count();
    on_seam as f32 > FLAT_SHARE * near.len() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{canonical_landmarks, ibug::LANDMARKS};

    /// A sheet at the mean mouth. If `cut`, it is cut along the inner lips over the mouth's width.
    /// The lower bank lies `drop` metres lower.
    fn sheet(cut: bool, drop: f32) -> (Mesh, Landmarks) {
        sheet_with(cut, drop, 1.0)
    }

    /// The same with a cut of this share of the mouth's width.
    fn sheet_with(cut: bool, drop: f32, share: f32) -> (Mesh, Landmarks) {
        let mean = canonical_landmarks();
        let middle = 0.5 * (mean[62][1] + mean[66][1]);
        let (columns, rows, step) = (81u32, 40u32, 0.0015f32);
        let mut mesh = Mesh::default();
        for half in [1.0f32, -1.0] {
            for row in 0..rows {
                for column in 0..columns {
                    let x = (column as f32 - 40.0) * step;
                    let inside = x.abs() < share * mean[54][0];
                    let lower = if half < 0.0 && inside { drop } else { 0.0 };
                    let y = middle + half * row as f32 * step - lower;
                    mesh.positions.push([x, y, mean[62][2]]);
                }
            }
        }
        let number = |half: u32, row: u32, column: u32| {
            let x = (column as f32 - 40.0) * step;
            let is_separate = row > 0 || (cut && x.abs() < share * mean[54][0]);
            (if is_separate { half } else { 0 }) * rows * columns + row * columns + column
        };
        for half in 0..2 {
            for (row, column) in (0..rows - 1).flat_map(|r| (0..columns - 1).map(move |c| (r, c))) {
                let [a, b] = [0, 1].map(|d| number(half, row, column + d));
                let [c, d] = [0, 1].map(|d| number(half, row + 1, column + d));
                mesh.triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
        let nearest = |i: usize| {
            let lower = (64..68).contains(&i);
            let range = if lower && cut {
                rows * columns..2 * rows * columns
            } else {
                0..rows * columns
            };
            let p = [mean[i][0], middle, mean[62][2]];
            let candidates = range;
            candidates.min_by(|a, b| {
                let far = |v: &u32| Vec3::from(mesh.positions[*v as usize]).distance(p.into());
                far(a).total_cmp(&far(b))
            })
        };
        let vertices: [u32; LANDMARKS] = std::array::from_fn(|i| nearest(i).unwrap());
        let landmarks = Landmarks {
            positions: vertices.map(|v| mesh.positions[v as usize]),
            vertices,
            confidence: [1.0; LANDMARKS],
        };
        (mesh, landmarks)
    }

    #[test]
    fn lips_on_one_surface_are_welded() {
        let (mesh, landmarks) = sheet(false, 0.0);
        assert_eq!(Mouth::of(&mesh, &landmarks), Mouth::Welded);
    }

    #[test]
    fn flat_shaded_lips_on_one_surface_are_welded_all_the_same() {
        let (mesh, mut landmarks) = sheet(false, 0.0);
        let corners = mesh.triangles.iter().flatten();
        let flat = Mesh {
            positions: corners.map(|&v| mesh.positions[v as usize]).collect(),
            triangles: (0..mesh.triangles.len() as u32)
                .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
                .collect(),
        };
        let corners: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
        let first = |v: u32| corners.iter().position(|c| *c == v).unwrap() as u32;
        landmarks.vertices = landmarks.vertices.map(first);
        assert_eq!(Mouth::of(&flat, &landmarks), Mouth::Welded);
    }

    #[test]
    fn touching_banks_of_a_cut_are_a_slit_though_they_look_like_a_seam() {
        let (mesh, landmarks) = sheet(true, 0.0);
        assert_eq!(Mouth::of(&mesh, &landmarks), Mouth::Slit);
    }

    #[test]
    fn a_slit_narrower_than_the_landmarks_is_no_joint() {
        for share in [0.83, 0.6, 0.45] {
            let (mesh, landmarks) = sheet_with(true, 0.0, share);
            assert_eq!(Mouth::of(&mesh, &landmarks), Mouth::Slit, "{share}");
        }
    }

    #[test]
    fn banks_apart_are_an_open_mouth() {
        let (mesh, landmarks) = sheet(true, 0.012);
        assert_eq!(Mouth::of(&mesh, &landmarks), Mouth::Open);
    }

    #[test]
    fn welded_lips_say_what_still_moves() {
        assert!(Mouth::Welded.sentence().contains("cannot part"));
        assert!(Mouth::Welded.sentence().contains("still move"));
        assert!(Mouth::Welded.sentence().contains("anyface open-mouth"));
    }
}
