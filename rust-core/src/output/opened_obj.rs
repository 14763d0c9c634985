//! Writes a mesh whose mouth or eyes were cut open as OBJ. Keeps the texture coordinates, normals,
//! materials, objects and groups of the old file.

use std::{fmt::Write as _, path::Path};

use crate::{
    Result,
    face::OpenedFace,
    job::write_atomically,
    mesh::{Mesh, obj_text, polygons::triangulate},
};

/// Vertex, texture and normal number of a corner, counted from 0.
type Corner = [Option<usize>; 3];

/// Name of the group for the inside of the mouth (the bag), and of its material if the file has any.
const BAG: &str = "mouth_inside";

/// Keywords of an OBJ file for vertices, texture coordinates and normals.
const KINDS: [&str; 3] = ["v", "vt", "vn"];

/// Writes the new mesh.
///
/// `source`: the bytes of the old file if that was OBJ. All its lines stay except the faces at the
/// cut. Polygons that were not cut stay polygons.
///
/// # Errors
/// `Io` if the file cannot be written.
pub fn write_opened_obj(
    path: &Path,
    source: Option<&[u8]>,
    old: &Mesh,
    opened: &OpenedFace,
) -> Result<()> {
    let text = match source {
        Some(source) => Rewriter::new(&obj_text(source), old, opened).text(),
        None => plain(opened),
    };
    write_atomically(path, |file| {
        std::io::Write::write_all(file, text.as_bytes())
    })
}

fn plain(opened: &OpenedFace) -> String {
    let mut text = String::from("g head\n");
    opened
        .mesh
        .positions
        .iter()
        .for_each(|p| add_numbers(&mut text, "v", p));
    for (number, [a, b, c]) in opened.mesh.triangles.iter().enumerate() {
        if number == opened.first_inside_triangle {
            let _ = writeln!(text, "g {BAG}");
        }
        let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
    }
    text
}

fn add_numbers(text: &mut String, word: &str, numbers: &[f32]) {
    let _ = write!(text, "{word}");
    for x in numbers {
        let _ = write!(text, " {x}");
    }
    text.push('\n');
}

struct Rewriter<'a> {
    source: String,
    old: &'a Mesh,
    opened: &'a OpenedFace,
    /// The lines of vertices, texture coordinates and normals so far. `values` are their numbers.
    lines: [Vec<String>; 3],
    values: [Vec<Vec<f32>>; 3],
    /// Interpolated texture coordinates and normals, which follow those of the file.
    added: [Vec<Vec<f32>>; 3],
    /// For each old triangle its new pieces, and the new triangles behind the cut that begin at it.
    pieces: Vec<Vec<usize>>,
    /// Number of vertices, texture coordinates and normals in the whole source.
    count: [usize; 3],
    /// The current `g` line. `material` is the current `usemtl` line.
    group: String,
    material: Option<String>,
    /// Lines of the bag's faces so far. They are written when `bag_left`, the number still to come,
    /// is 0.
    bag: String,
    bag_left: usize,
}

impl<'a> Rewriter<'a> {
    fn new(source: &str, old: &'a Mesh, opened: &'a OpenedFace) -> Self {
        let mut pieces = vec![Vec::new(); old.triangles.len()];
        for (number, from) in opened.triangle_sources.iter().enumerate() {
            pieces[from.triangle as usize].push(number);
        }
        let source = source.replace("\\\r\n", " ").replace("\\\n", " ");
        let starts = |line: &&str, kind: &str| line.split_whitespace().next() == Some(kind);
        let count = KINDS.map(|kind| source.lines().filter(|line| starts(line, kind)).count());
        Rewriter {
            source,
            count,
            group: "g head".into(),
            material: None,
            bag: String::new(),
            bag_left: opened.triangle_sources.len() - opened.first_inside_triangle,
            old,
            opened,
            lines: Default::default(),
            values: Default::default(),
            added: Default::default(),
            pieces,
        }
    }

    fn text(mut self) -> String {
        let source = std::mem::take(&mut self.source);
        let (mut rest, mut triangle) = (String::new(), 0);
        for line in source.lines() {
            let mut words = line.split_whitespace();
            let word = words.next().unwrap_or("");
            if let Some(kind) = KINDS.iter().position(|k| *k == word) {
                self.lines[kind].push(line.to_owned());
                self.values[kind].push(words.map_while(|w| w.parse().ok()).collect());
            } else if word == "f" {
                let corners = words.take_while(|w| !w.starts_with('#'));
                let corners: Vec<Corner> = corners.map(|w| self.corner(w)).collect();
                triangle = self.add_polygon(&corners, triangle, &mut rest);
            } else {
                match word {
                    "g" => self.group = line.to_owned(),
                    "usemtl" => self.material = Some(line.to_owned()),
                    _ => {}
                }
                rest.push_str(line);
                rest.push('\n');
            }
        }
        let new = &self.opened.mesh.positions[self.old.positions.len()..];
        let mut text = String::new();
        for (kind, lines) in self.lines.iter().enumerate() {
            for line in lines {
                let _ = writeln!(text, "{line}");
            }
            let added = self.added[kind].iter();
            added.for_each(|value| add_numbers(&mut text, KINDS[kind], value));
            if kind == 0 {
                new.iter().for_each(|p| add_numbers(&mut text, "v", p));
            }
        }
        text + &rest
    }

    fn corner(&self, word: &str) -> Corner {
        let mut out = [None; 3];
        for (kind, number) in word.split('/').take(3).enumerate() {
            out[kind] = match number.parse::<i64>() {
                Ok(n) if n > 0 => Some(n as usize - 1),
                Ok(n) => self.lines[kind].len().checked_add_signed(n as isize),
                Err(_) => None,
            };
        }
        out
    }

    /// Writes one polygon, or its pieces if it was cut. `first`: the number of its first triangle.
    /// Returns the number of the next polygon's first triangle.
    fn add_polygon(&mut self, corners: &[Corner], first: usize, text: &mut String) -> usize {
        let polygon: Vec<u32> = corners.iter().map(|c| c[0].unwrap_or(0) as u32).collect();
        let mut triangles = Vec::new();
        triangulate(&self.old.positions, &polygon, &mut triangles);
        let next = first + triangles.len();
        let pieces: Vec<usize> = self.pieces[first..next].iter().flatten().copied().collect();
        let is_skin = |number: usize| number < self.opened.first_lining_triangle;
        let of_skin = pieces.iter().filter(|&&n| is_skin(n));
        let is_whole = of_skin.count() == triangles.len();
        if is_whole {
            let renamed: Vec<Corner> = corners
                .iter()
                .map(|c| self.renamed(c, first..next))
                .collect();
            write_face(text, &renamed);
        }
        for number in pieces {
            let in_bag = number >= self.opened.first_inside_triangle;
            if is_whole && is_skin(number) {
                continue;
            }
            let from = self.opened.triangle_sources[number];
            let around = triangles[from.triangle as usize - first].map(|v| {
                let place = polygon.iter().position(|p| *p == v);
                corners[place.expect("a triangle has corners of its polygon")]
            });
            let mixed: Vec<Corner> = (0..3)
                .map(|k| {
                    let vertex = self.opened.mesh.triangles[number][k] as usize;
                    self.mixed(vertex, &around, from.corners[k])
                })
                .collect();
            if in_bag {
                write_face(&mut self.bag, &mixed)
            } else {
                write_face(text, &mixed)
            }
            self.bag_left -= usize::from(in_bag);
        }
        if self.bag_left == 0 && !self.bag.is_empty() {
            self.add_bag(text);
        }
        next
    }

    /// Writes the bag as a separate group. After it, the previous group and material apply again.
    fn add_bag(&mut self, text: &mut String) {
        let bag = std::mem::take(&mut self.bag);
        let _ = writeln!(text, "g {BAG}");
        if self.material.is_some() {
            let _ = writeln!(text, "usemtl {BAG}");
        }
        let _ = write!(
            text,
            "{bag}{}\n{}",
            self.group,
            self.material.as_deref().unwrap_or("")
        );
        text.push_str(if self.material.is_some() { "\n" } else { "" });
    }

    /// A corner of a polygon that was not cut, with the new number of its vertex.
    fn renamed(&self, corner: &Corner, triangles: std::ops::Range<usize>) -> Corner {
        let corners = triangles.flat_map(|t| {
            let new = self.opened.mesh.triangles[self.pieces[t][0]];
            self.old.triangles[t].into_iter().zip(new)
        });
        let now = corners
            .into_iter()
            .find(|(old, _)| Some(*old as usize) == corner[0]);
        [
            now.map_or(corner[0], |(_, new)| Some(new as usize)),
            corner[1],
            corner[2],
        ]
    }

    /// A corner at these `shares` of a triangle's corners. Unless it is one of them, adds interpolated
    /// texture coordinates and a normal for it.
    fn mixed(&mut self, vertex: usize, around: &[Corner; 3], shares: [f32; 3]) -> Corner {
        let mut out = [Some(vertex), None, None];
        for kind in 1..3 {
            let Some(numbers) = around.iter().map(|c| c[kind]).collect::<Option<Vec<_>>>() else {
                continue;
            };
            if let Some(k) = shares.iter().position(|share| *share == 1.0) {
                out[kind] = Some(numbers[k]);
                continue;
            }
            let size = self.values[kind].get(numbers[0]).map_or(0, Vec::len);
            let mut value = vec![0.0f32; size];
            for (number, share) in numbers.iter().zip(shares) {
                let from = self.values[kind].get(*number).into_iter().flatten();
                value
                    .iter_mut()
                    .zip(from)
                    .for_each(|(to, x)| *to += share * x);
            }
            if kind == 2 {
                let length = value.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-12);
                value.iter_mut().for_each(|x| *x /= length);
            }
            self.added[kind].push(value);
            out[kind] = Some(self.count[kind] + self.added[kind].len() - 1);
        }
        out
    }
}

fn write_face(text: &mut String, corners: &[Corner]) {
    text.push('f');
    for [vertex, texture, normal] in corners {
        let shown = |n: &Option<usize>| n.map_or(String::new(), |n| (n + 1).to_string());
        let _ = match (texture, normal) {
            (None, None) => write!(text, " {}", shown(vertex)),
            (_, None) => write!(text, " {}/{}", shown(vertex), shown(texture)),
            _ => write!(
                text,
                " {}/{}/{}",
                shown(vertex),
                shown(texture),
                shown(normal)
            ),
        };
    }
    text.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{face::TriangleSource, mesh::Landmarks};

    const SOURCE: &str = "mtllib head.mtl
o head
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 2 0 0
vt 0 0
vt 0.4 0
vt 0.8 0
vt 0 1
usemtl skin
f 1/1 2/2 3/3 4/4
f -4/2 -1/3 -3/4
usemtl eyes
f 1/1 2/2 4/3
";

    /// The second face is cut in two at the middle of the edge between vertices 2 and 5, and a bag of
    /// one face is added.
    fn opened() -> (Mesh, OpenedFace) {
        let old = Mesh::parse(SOURCE.as_bytes()).unwrap();
        let whole = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let half = [0.5, 0.5, 0.0];
        let source = |triangle: u32, corners: [[f32; 3]; 3]| TriangleSource { triangle, corners };
        let mut positions = old.positions.clone();
        positions.extend([[1.5, 0.0, 0.0], [1.5, 0.0, -1.0]]);
        let opened = OpenedFace {
            mesh: Mesh {
                positions,
                triangles: vec![
                    [0, 1, 2],
                    [0, 2, 3],
                    [1, 5, 2],
                    [5, 4, 2],
                    [0, 1, 3],
                    [5, 1, 6],
                ],
            },
            landmarks: Landmarks {
                positions: [[0.0; 3]; 68],
                vertices: [0; 68],
                confidence: [1.0; 68],
            },
            vertex_sources: Vec::new(),
            triangle_sources: vec![
                source(0, whole),
                source(1, whole),
                source(2, [whole[0], half, whole[2]]),
                source(2, [half, whole[1], whole[2]]),
                source(3, whole),
                source(2, [half; 3]),
            ],
            first_inside_vertex: 6,
            first_lining_triangle: 5,
            first_inside_triangle: 5,
            upper_rim: Vec::new(),
            lower_rim: Vec::new(),
        };
        (old, opened)
    }

    #[test]
    fn faces_away_from_the_mouth_and_all_other_lines_stay() {
        let (old, opened) = opened();
        let text = Rewriter::new(SOURCE, &old, &opened).text();
        for line in [
            "mtllib head.mtl",
            "o head",
            "f 1/1 2/2 3/3 4/4",
            "f 1/1 2/2 4/3",
        ] {
            assert!(text.lines().any(|l| l == line), "{line} in\n{text}");
        }
        let read = Mesh::parse(text.as_bytes()).unwrap();
        assert_eq!(read.positions, opened.mesh.positions);
        let mut triangles = opened.mesh.triangles.clone();
        triangles.swap(4, 5);
        assert_eq!(read.triangles, triangles);
    }

    #[test]
    fn new_corners_have_texture_coordinates_in_between() {
        let (old, opened) = opened();
        let text = Rewriter::new(SOURCE, &old, &opened).text();
        let values: Vec<&str> = text.lines().filter(|l| l.starts_with("vt ")).collect();
        assert_eq!(values[..4], ["vt 0 0", "vt 0.4 0", "vt 0.8 0", "vt 0 1"]);
        assert!(values[4..].iter().all(|l| *l == "vt 0.6 0"), "{values:?}");
        assert!(text.contains("f 2/2 6/5 3/4"), "{text}");
    }

    #[test]
    fn the_inside_has_a_material_of_its_own_and_the_next_face_its_old_one() {
        let (old, opened) = opened();
        let text = Rewriter::new(SOURCE, &old, &opened).text();
        let at = |line: &str| text.lines().position(|l| l == line).unwrap();
        assert!(at("usemtl skin") < at("usemtl mouth_inside"));
        assert_eq!(at("g mouth_inside") + 1, at("usemtl mouth_inside"));
        let after = text.lines().skip(at("usemtl mouth_inside") + 2);
        assert_eq!(
            after.collect::<Vec<_>>(),
            ["g head", "usemtl skin", "usemtl eyes", "f 1/1 2/2 4/3"]
        );
        let plain = plain(&opened);
        assert_eq!(Mesh::parse(plain.as_bytes()).unwrap(), opened.mesh);
    }
}
