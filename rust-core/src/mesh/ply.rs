//! Reads PLY, ascii and binary, with ply-rs-bw.

use ply_rs_bw::{
    parser::{Parser, Reader},
    ply::{
        Encoding, Header, Payload, Property, PropertyAccess, PropertyAccessResult, PropertyType,
        ScalarType,
    },
};

use super::Mesh;
use crate::{Error, Result};

/// Ends one strip in a list of triangle strips.
const STRIP_END: i64 = -1;

/// A vertex, a face or a list of triangle strips, depending on the element in the file.
#[derive(Debug, Default)]
struct Record {
    position: [f32; 3],
    /// Texture coordinates, with 0 at the bottom.
    coordinates: [f32; 2],
    corners: Vec<i64>,
}

impl PropertyAccess for Record {
    fn new() -> Self {
        Record::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let slot = match name {
            "x" => &mut self.position[0],
            "y" => &mut self.position[1],
            "z" => &mut self.position[2],
            "s" | "u" | "texture_u" => return coordinate(&mut self.coordinates[0], property),
            "t" | "v" | "texture_v" => return coordinate(&mut self.coordinates[1], property),
            "vertex_indices" | "vertex_index" => {
                return match integers(property) {
                    Some(corners) => {
                        self.corners = corners;
                        PropertyAccessResult::Set
                    }
                    None => PropertyAccessResult::UnsupportedType,
                };
            }
            _ => return PropertyAccessResult::Ignored,
        };
        match property.to_f32_lossy() {
            Some(value) => {
                *slot = value;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::UnsupportedType,
        }
    }
}

/// Sets a texture coordinate. A value that is not a finite number is ignored, because a mesh does
/// not need texture coordinates.
fn coordinate(slot: &mut f32, property: Property) -> PropertyAccessResult {
    match property.to_f32_lossy().filter(|value| value.is_finite()) {
        Some(value) => {
            *slot = value;
            PropertyAccessResult::Set
        }
        None => PropertyAccessResult::Ignored,
    }
}

/// The values of an integer list, including negative ones.
fn integers(property: Property) -> Option<Vec<i64>> {
    match property {
        Property::ListInt(values) => Some(values.into_iter().map(i64::from).collect()),
        Property::ListShort(values) => Some(values.into_iter().map(i64::from).collect()),
        Property::ListChar(values) => Some(values.into_iter().map(i64::from).collect()),
        other => Some(other.to_u32_list()?.into_iter().map(i64::from).collect()),
    }
}

/// Reads the header, and the records of its elements.
fn read(bytes: &[u8]) -> Result<(Header, Payload<Record>)> {
    let mut source = Reader::new(bytes);
    let parser = Parser::<Record>::new();
    let damaged = |e: &dyn std::fmt::Display| Error::Mesh(format!("damaged PLY: {e}"));
    let header = parser.read_header(&mut source).map_err(|e| damaged(&e))?;
    let vertices = header.elements.get("vertex");
    let axes = ["x", "y", "z"];
    if !vertices.is_some_and(|v| axes.iter().all(|a| v.properties.contains_key(*a))) {
        return Err(Error::Mesh(
            "PLY: expected vertices with x, y and z, got none".into(),
        ));
    }
    check_counts(&header, source.get_ref().len())?;
    let payload = parser
        .read_payload(&mut source, &header)
        .map_err(|e| damaged(&e))?;
    Ok((header, payload))
}

/// Texture coordinates of the vertices, `[V]`, with 0 at the bottom. `None` if the file has none or
/// cannot be read.
pub(super) fn vertex_coordinates(bytes: &[u8]) -> Option<Vec<[f32; 2]>> {
    let (header, payload) = read(bytes).ok()?;
    let has = |name: &str| {
        header
            .elements
            .get("vertex")
            .is_some_and(|v| v.properties.contains_key(name))
    };
    let known = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];
    known
        .iter()
        .find(|pair| pair.iter().all(|name| has(name)))?;
    let vertices = payload.get("vertex")?;
    Some(vertices.iter().map(|r| r.coordinates).collect())
}

/// Parses a PLY file: `vertex`, `face` and `tristrips`. The last are triangle strips in one list,
/// with −1 between them and every other triangle turned, as the Stanford repository writes them.
/// Other elements are skipped.
pub(super) fn parse_ply(bytes: &[u8]) -> Result<Mesh> {
    let (_, payload) = read(bytes)?;
    let records = |name: &str| payload.get(name).map_or(&[][..], Vec::as_slice);
    let mut mesh = Mesh {
        positions: records("vertex").iter().map(|r| r.position).collect(),
        triangles: Vec::with_capacity(2 * records("face").len()),
    };
    for face in records("face") {
        mesh.add_polygon(&vertex_numbers(&face.corners)?)?;
    }
    for strips in records("tristrips") {
        for strip in strips.corners.split(|corner| *corner == STRIP_END) {
            let strip = vertex_numbers(strip)?;
            for (index, corners) in strip.windows(3).enumerate() {
                let [a, b, c] = [corners[0], corners[1], corners[2]];
                // A repeated corner joins two strips and spans no triangle.
                if a != b && b != c && a != c {
                    mesh.add_polygon(&if index % 2 == 0 { [a, b, c] } else { [b, a, c] })?;
                }
            }
        }
    }
    Ok(mesh)
}

/// Checks the counts that a header claims against the number of bytes that follow it. A record
/// takes at least the bytes of its numbers and of the counts of its lists, or one byte if it has
/// neither.
fn check_counts(header: &Header, left: usize) -> Result<()> {
    let mut needed = 0usize;
    for element in header.elements.values() {
        let smallest = |kind: &PropertyType| match (header.encoding, kind) {
            // A digit and a space.
            (Encoding::Ascii, _) => 2,
            (_, PropertyType::Scalar(kind) | PropertyType::List(kind, _)) => size(kind),
        };
        let record: usize = element
            .properties
            .values()
            .map(|property| smallest(&property.data_type))
            .sum();
        needed = needed.saturating_add(element.count.saturating_mul(record.max(1)));
        // The last line may lack its line break.
        if needed > left.saturating_add(1) {
            return Err(Error::Mesh(format!(
                "damaged PLY: expected {} of {:?} in at least {needed} bytes, got {left}",
                element.count, element.name
            )));
        }
    }
    Ok(())
}

fn size(kind: &ScalarType) -> usize {
    match kind {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

fn vertex_numbers(corners: &[i64]) -> Result<Vec<u32>> {
    let number = |&corner| {
        u32::try_from(corner)
            .map_err(|_| Error::Mesh(format!("PLY: expected vertex numbers from 0, got {corner}")))
    };
    corners.iter().map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "element vertex 4
property float x
property double y
property uchar red
property short z
element face 2
property list uchar int vertex_indices
property uchar flags
end_header
";

    #[test]
    fn ascii_and_binary_say_the_same() {
        let ascii = format!(
            "ply\nformat ascii 1.0\ncomment by hand\n{HEADER}0 0 255 0\n1 0 0 0\n1 1.5 0 0\n0 1 0 7\n3 0 1 2 0\n4 0 1 2 3 9\n"
        );
        let mut binary = format!("ply\nformat binary_little_endian 1.0\n{HEADER}").into_bytes();
        let vertices = [
            (0f32, 0f64, 0i16),
            (1.0, 0.0, 0),
            (1.0, 1.5, 0),
            (0.0, 1.0, 7),
        ];
        for (x, y, z) in vertices {
            binary.extend(x.to_le_bytes());
            binary.extend(y.to_le_bytes());
            binary.push(3);
            binary.extend(z.to_le_bytes());
        }
        for face in [&[0i32, 1, 2][..], &[0, 1, 2, 3]] {
            binary.push(face.len() as u8);
            face.iter().for_each(|v| binary.extend(v.to_le_bytes()));
            binary.push(0);
        }
        let a = parse_ply(ascii.as_bytes()).unwrap();
        assert_eq!(a.positions[3], [0.0, 1.0, 7.0]);
        assert_eq!(a.triangles.len(), 3);
        assert_eq!(a, parse_ply(&binary).unwrap());
        assert!(parse_ply(&binary[..binary.len() - 3]).is_err());
    }

    #[test]
    fn strips_and_lists_counted_in_integers_are_read() {
        let ascii = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n\
            property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n\
            0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 1 0\n9 0 1 2 3 -1 1 4 3 3\n";
        let mesh = parse_ply(ascii.as_bytes()).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [1, 4, 3]]);
        let wrong = ascii.replace("9 0 1 2 3 -1", "9 0 1 2 3 -7");
        let message = parse_ply(wrong.as_bytes()).unwrap_err().to_string();
        assert!(message.contains("got -7"), "{message}");
    }

    #[test]
    fn counts_are_held_against_the_bytes() {
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            for count in ["4000000000", "1000000000000000000"] {
                let bare = format!(
                    "ply\nformat {format} 1.0\nelement ghost {count}\n{HEADER}{}",
                    "0 0 0 0\n".repeat(4)
                );
                let error = parse_ply(bare.as_bytes()).unwrap_err().to_string();
                assert!(error.contains(count) && error.contains("ghost"), "{error}");
                let many = format!("ply\nformat {format} 1.0\n{HEADER}0 0 255 0\n")
                    .replace("vertex 4", &format!("vertex {count}"));
                let error = parse_ply(many.as_bytes()).unwrap_err().to_string();
                assert!(error.contains(count) && error.contains("vertex"), "{error}");
            }
        }
    }

    #[test]
    fn vertices_without_places_and_negative_corners_are_errors() {
        let flat = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n";
        assert!(
            parse_ply(flat.as_bytes())
                .unwrap_err()
                .to_string()
                .contains("x, y and z")
        );
        let negative = format!(
            "ply\nformat ascii 1.0\n{HEADER}{}3 0 1 -2 0\n3 0 1 2 0\n",
            "0 0 0 0\n".repeat(4)
        );
        assert!(matches!(
            parse_ply(negative.as_bytes()),
            Err(Error::Mesh(_))
        ));
    }
}
