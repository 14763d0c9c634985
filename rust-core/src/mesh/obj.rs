//! OBJ: reads `v` and `f` lines and skips everything else.
//!
//! This does not use tobj 4. Even with all options off, tobj numbers the vertices of each object in
//! the order in which faces use them and drops unused ones, so that shape keys and caches would
//! move the wrong vertices of a user's mesh. The tests compare with tobj.

use super::{Mesh, polygons::triangulate};
use crate::{Error, Result};

/// The text of an OBJ file with continued lines joined. Names may be in any encoding. A byte-order
/// mark is removed, and lines may end as on old Macs.
pub(crate) fn obj_text(bytes: &[u8]) -> String {
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    let text = String::from_utf8_lossy(bytes);
    let text = if text.contains('\n') {
        text
    } else {
        text.replace('\r', "\n").into()
    };
    text.replace("\\\r\n", " ").replace("\\\n", " ")
}

/// The bytes that some editors put before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

/// Parses an OBJ file.
pub(super) fn parse_obj(bytes: &[u8]) -> Result<Mesh> {
    let text = obj_text(bytes);
    let mut positions = Vec::new();
    let mut polygons: Vec<(usize, Vec<i64>)> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => positions.push(position(words, number + 1)?),
            Some("f") => polygons.push((number + 1, corners(words, positions.len(), number + 1)?)),
            _ => {}
        }
    }
    let mut mesh = Mesh {
        positions,
        triangles: Vec::with_capacity(2 * polygons.len()),
    };
    let count = mesh.positions.len();
    for (line, polygon) in polygons {
        let inside = |&v: &i64| usize::try_from(v).is_ok_and(|v| v < count);
        if let Some(outside) = polygon.iter().find(|v| !inside(v)) {
            return Err(Error::Mesh(format!(
                "line {line}: expected vertices 1 to {count}, got {}",
                outside + 1
            )));
        }
        let polygon: Vec<u32> = polygon.iter().map(|&v| v as u32).collect();
        mesh.add_polygon(&polygon)?;
    }
    Ok(mesh)
}

/// Texture coordinates of each corner of each triangle, `[F, 3]`; 0 where a polygon has none.
/// `None` if the file has none or its faces cannot be read.
pub(super) fn corner_coordinates(text: &str, mesh: &Mesh) -> Option<Vec<[[f32; 2]; 3]>> {
    let mut known: Vec<[f32; 2]> = Vec::new();
    let (mut polygons, mut vertices) = (Vec::new(), 0);
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => vertices += 1,
            Some("vt") => {
                let mut number = || {
                    let number = words.next().and_then(|word| word.parse::<f32>().ok());
                    number.filter(|x| x.is_finite()).unwrap_or(0.0)
                };
                known.push([number(), number()]);
            }
            Some("f") => {
                let numbers = corners(words.clone(), vertices, 0).ok()?;
                let places = words.map(|word| {
                    let number: i64 = word.split('/').nth(1)?.parse().ok()?;
                    let from = if number < 0 { known.len() as i64 } else { -1 };
                    usize::try_from(from + number).ok()
                });
                polygons.push((numbers, places.collect::<Vec<_>>()));
            }
            _ => {}
        }
    }
    if known.is_empty() {
        return None;
    }
    let mut out = Vec::with_capacity(mesh.triangles.len());
    let mut triangles = Vec::new();
    for (numbers, places) in polygons {
        let polygon: Vec<u32> = numbers.iter().map(|v| *v as u32).collect();
        if polygon.iter().any(|v| *v as usize >= mesh.positions.len()) {
            return None;
        }
        triangles.clear();
        triangulate(&mesh.positions, &polygon, &mut triangles);
        let mut placed: Vec<_> = polygon.iter().copied().zip(places).collect();
        placed.sort_by_key(|(vertex, _)| *vertex);
        let place = |vertex: u32| {
            let corner = placed.binary_search_by_key(&vertex, |(v, _)| *v).ok()?;
            known.get(placed[corner].1?).copied()
        };
        let of = |t: &[u32; 3]| t.map(|vertex| place(vertex).unwrap_or_default());
        out.extend(triangles.iter().map(of));
    }
    Some(out)
}

fn position<'a>(words: impl Iterator<Item = &'a str>, line: usize) -> Result<[f32; 3]> {
    let mut out = [0.0; 3];
    let mut count = 0;
    for (slot, word) in out.iter_mut().zip(words) {
        *slot = word
            .parse()
            .map_err(|_| Error::Mesh(format!("line {line}: expected a number, got \"{word}\"")))?;
        count += 1;
    }
    if count < 3 {
        return Err(Error::Mesh(format!(
            "line {line}: expected 3 coordinates, got {count}"
        )));
    }
    Ok(out)
}

/// Vertex numbers of a face, counted from 0. Negative numbers in the file count back from the
/// latest vertex.
fn corners<'a>(
    words: impl Iterator<Item = &'a str>,
    so_far: usize,
    line: usize,
) -> Result<Vec<i64>> {
    let corner = |word: &str| -> Result<i64> {
        let number = word.split('/').next().unwrap_or_default();
        match number.parse::<i64>() {
            Ok(n) if n > 0 => Ok(n - 1),
            Ok(n) if n < 0 && n >= -(so_far as i64) => Ok(so_far as i64 + n),
            _ => Err(Error::Mesh(format!(
                "line {line}: expected a vertex number, got \"{word}\" after {so_far} vertices"
            ))),
        }
    };
    words
        .take_while(|w| !w.starts_with('#'))
        .map(corner)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO_OBJECTS: &str = "# two objects, the first uses its vertices backwards
mtllib a.mtl
o first
v 9 9 9
v 0 1 0
v 1 0 0 1.0
v 0 0 0 0.5 0.5 0.5
vt 0 0
vn 0 0 1
f 4/1/1 3/1/1 2/1/1
o second
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
s off
f -4//1 -3//1 \\
  -2//1 -1//1
l 1 2
";

    #[test]
    fn vertices_keep_their_order_and_count() {
        let mesh = parse_obj(TWO_OBJECTS.as_bytes()).unwrap();
        assert_eq!(mesh.positions.len(), 8);
        assert_eq!(mesh.positions[0], [9.0; 3]);
        assert_eq!(mesh.triangles, [[3, 2, 1], [4, 5, 6], [4, 6, 7]]);
    }

    #[test]
    fn a_byte_order_mark_and_ends_of_old_macs_lose_no_vertex() {
        let plain = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n";
        let expected = parse_obj(plain.as_bytes()).unwrap();
        let marked = [BYTE_ORDER_MARK, plain.as_bytes()].concat();
        assert_eq!(parse_obj(&marked).unwrap(), expected);
        let old = plain.replace('\n', "\r");
        assert_eq!(parse_obj(old.as_bytes()).unwrap(), expected);
    }

    #[test]
    fn faces_lie_where_tobj_puts_them() {
        let options = tobj::LoadOptions {
            triangulate: true,
            ignore_lines: true,
            ..Default::default()
        };
        // tobj accepts colours only on all vertices or on none, and it accepts no weights.
        let text = TWO_OBJECTS
            .replace("\\\n", "")
            .replace(" 0.5 0.5 0.5", "")
            .replace(" 1.0\n", "\n");
        let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| {
            Ok((Vec::new(), Default::default()))
        })
        .unwrap();
        let mut expected = Vec::new();
        for model in &models {
            let place = |&i: &u32| -> [f32; 3] {
                std::array::from_fn(|axis| model.mesh.positions[3 * i as usize + axis])
            };
            expected.extend(model.mesh.indices.iter().map(place));
        }
        let mesh = parse_obj(TWO_OBJECTS.as_bytes()).unwrap();
        let corners = mesh.triangles.iter().flatten();
        let got: Vec<_> = corners.map(|&v| mesh.positions[v as usize]).collect();
        assert_eq!(got, expected);
    }

    #[test]
    #[ignore = "needs ../shared"]
    fn real_heads_have_as_many_vertices_as_their_files() {
        let beside = std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
        let shared = std::env::var_os("ANYFACE_SHARED").map_or(beside, Into::into);
        for name in [
            "goathead",
            "koala",
            "lee_perry_smith",
            "makehuman_body",
            "mediapipe_canonical_face",
        ] {
            let path = shared.join("data/meshes").join(name).with_extension("obj");
            let text = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
            let mesh = Mesh::read(&path).unwrap();
            let lines = |start: &str| text.lines().filter(|l| l.starts_with(start)).count();
            assert_eq!(mesh.positions.len(), lines("v "), "{name}");
            assert!(mesh.triangles.len() >= lines("f "), "{name}");
            assert!(mesh.report().parts >= 1, "{name}");
        }
    }

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("v 0 0 0\nv 1 0\n", "line 2: expected 3 coordinates, got 2"),
            ("v 0 0 zero\n", "line 1: expected a number, got \"zero\""),
            (
                "v 0 0 0\nf 1 2 3\n",
                "line 2: expected vertices 1 to 1, got 2",
            ),
            (
                "v 0 0 0\nf 0 0 0\n",
                "line 2: expected a vertex number, got \"0\"",
            ),
            (
                "v 0 0 0\nf -2 1 1\n",
                "line 2: expected a vertex number, got \"-2\"",
            ),
        ] {
            let error = parse_obj(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
