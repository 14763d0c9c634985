//! Reads texture coordinates, which a mesh itself does not hold, from the mesh's file.

use super::{
    Mesh,
    obj::{corner_coordinates, obj_text},
    ply::vertex_coordinates,
};

/// Texture coordinates of each corner of each triangle, `[F, 3]`, with 0 at the bottom. They are
/// the `vt` of an OBJ, or properties of the vertices of a PLY (`s` and `t`, `u` and `v`,
/// `texture_u` and `texture_v`).
///
/// `None` if the file has none, is a glTF file, or does not fit the mesh.
pub(crate) fn texture_coordinates(bytes: &[u8], mesh: &Mesh) -> Option<Vec<[[f32; 2]; 3]>> {
    let corners = match bytes {
        _ if bytes.starts_with(b"glTF") => None,
        _ if bytes.starts_with(b"ply") => {
            let of_vertices = vertex_coordinates(bytes)?;
            let at = |v: u32| of_vertices.get(v as usize).copied();
            let corners = mesh.triangles.iter().map(|[a, b, c]| {
                let corners = [at(*a)?, at(*b)?, at(*c)?];
                Some(corners)
            });
            corners.collect::<Option<Vec<_>>>()
        }
        _ => corner_coordinates(&obj_text(bytes), mesh),
    };
    corners.filter(|corners| corners.len() == mesh.triangles.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{obj::parse_obj, ply::parse_ply};

    #[test]
    fn corners_of_polygons_keep_their_places() {
        let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nvt 0 0\nvt .5 0\nvt .5 1\nvt 0 1\nvt 1 .25\n\
                    f 1/1 2/2 3/3 4/4\nf 2/-4 5/5 3/3\nf 1 2 5\n";
        let mesh = parse_obj(text.as_bytes()).unwrap();
        let corners = texture_coordinates(text.as_bytes(), &mesh).unwrap();
        let place =
            |v: u32| [[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [0.0, 1.0], [1.0, 0.25]][v as usize];
        for (triangle, places) in mesh.triangles.iter().zip(&corners).take(3) {
            assert_eq!(*places, triangle.map(place));
        }
        assert_eq!(corners[3], [[0.0; 2]; 3]);
        let plain = "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n".as_bytes();
        assert_eq!(texture_coordinates(plain, &parse_obj(plain).unwrap()), None);
    }

    #[test]
    fn vertices_of_a_ply_have_places() {
        let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                    property float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\n\
                    end_header\n0 0 0 0 0.5\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n";
        let mesh = parse_ply(text.as_bytes()).unwrap();
        let corners = texture_coordinates(text.as_bytes(), &mesh).unwrap();
        assert_eq!(corners, [[[0.0, 0.5], [1.0, 0.0], [0.0, 1.0]]]);
        let without = text.replace("float s", "float quality");
        assert_eq!(texture_coordinates(without.as_bytes(), &mesh), None);
    }
}
