//! Makes meshes from files and from a host's arrays.

use std::path::Path;

use super::{
    Mesh, ObjectNames,
    foreign_formats::foreign_format,
    gltf::{GlbPart, is_gltf_text, pack, parse_glb},
    obj::{obj_text, parse_obj},
    ply::parse_ply,
    polygons::triangulate,
};
use crate::{
    Error, Result,
    job::{InputKind, outside::guarded, read_file},
};

/// The bytes of a mesh's file. A .gltf and the files beside it become one .glb.
///
/// # Errors
/// `Io` if a file cannot be read; `Mesh` if it is too large, or a .gltf that is damaged.
pub fn read_mesh_file(path: &Path) -> Result<Vec<u8>> {
    let bytes = read_file(path, InputKind::Mesh)?;
    if is_gltf_text(&bytes) {
        pack(&bytes, Some(path.parent().unwrap_or(Path::new("")))).map_err(in_file(path))
    } else {
        Ok(bytes)
    }
}

/// A mesh of a file, with the objects that its vertices belong to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NamedMesh {
    /// As [`Mesh::read`] returns it.
    pub mesh: Mesh,
    /// The names of its objects; none in a PLY.
    pub names: ObjectNames,
}

impl NamedMesh {
    /// Reads a mesh and the names of its objects from a file, once.
    ///
    /// # Errors
    /// As [`Mesh::read`].
    pub fn read(path: impl AsRef<Path>) -> Result<NamedMesh> {
        let path = path.as_ref();
        let bytes = read_mesh_file(path)?;
        NamedMesh::parse(&bytes).map_err(in_file(path))
    }

    fn parse(bytes: &[u8]) -> Result<NamedMesh> {
        let (mesh, parts) = parse(bytes)?;
        mesh.check()?;
        let names = if bytes.starts_with(b"glTF") {
            ObjectNames::of_glb(bytes, parts)?
        } else if bytes.starts_with(b"ply") || bytes.contains(&0) {
            ObjectNames::default()
        } else {
            ObjectNames::of_obj(&obj_text(bytes))
        };
        Ok(NamedMesh { mesh, names })
    }
}

/// The mesh of a file in any format, and the parts of a GLB.
fn parse(bytes: &[u8]) -> Result<(Mesh, Vec<GlbPart>)> {
    let alone = |mesh| (mesh, Vec::new());
    guarded(Error::Mesh, || {
        if bytes.starts_with(b"ply") {
            parse_ply(bytes).map(alone)
        } else if bytes.starts_with(b"glTF") {
            with_triangles(parse_glb(bytes)?)
        } else if is_gltf_text(bytes) {
            with_triangles(parse_glb(&pack(bytes, None)?)?)
        } else if let Some(refusal) = foreign_format(bytes) {
            Err(Error::Mesh(refusal))
        } else {
            parse_obj(bytes).map(alone)
        }
    })
}

/// Refuses a scene that shows no mesh, such as an animation by itself.
fn with_triangles((mesh, parts): (Mesh, Vec<GlbPart>)) -> Result<(Mesh, Vec<GlbPart>)> {
    if mesh.positions.is_empty() {
        let message = "glTF: expected a mesh, got a scene without one, perhaps a .vrma or an animation by itself; give the \
                       file that has the head";
        return Err(Error::Mesh(message.into()));
    }
    Ok((mesh, parts))
}

/// Names the file in an error about a mesh.
fn in_file(path: &Path) -> impl Fn(Error) -> Error {
    move |error| match error {
        Error::Mesh(message) => Error::Mesh(format!("{}: {message}", path.display())),
        other => other,
    }
}

impl Mesh {
    /// Reads an OBJ, PLY (ascii or binary) or glTF file (.glb, or .gltf with the files beside it).
    /// The content decides the format.
    ///
    /// Vertices keep the file's own order and count. Several objects follow one another as in the
    /// file. Polygons are triangulated. Materials, normals and texture coordinates are skipped.
    ///
    /// # Errors
    /// `Io` if the file cannot be read; `Mesh` if it is in none of these formats, is damaged, or
    /// fails [`Mesh::check`].
    pub fn read(path: impl AsRef<Path>) -> Result<Mesh> {
        let path = path.as_ref();
        let bytes = read_mesh_file(path)?;
        Mesh::parse(&bytes).map_err(in_file(path))
    }

    /// Like [`Mesh::read`], but from the bytes of a file.
    ///
    /// # Errors
    /// `Mesh`, as [`Mesh::read`].
    pub fn parse(bytes: &[u8]) -> Result<Mesh> {
        let (mesh, _) = parse(bytes)?;
        mesh.check()?;
        Ok(mesh)
    }

    /// A mesh from triangles. `positions`: `[V]`; `triangles`: `[F]`.
    ///
    /// # Errors
    /// `Mesh` if it fails [`Mesh::check`].
    pub fn from_arrays(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Result<Mesh> {
        let mesh = Mesh {
            positions,
            triangles,
        };
        mesh.check()?;
        Ok(mesh)
    }

    /// A mesh from polygons. `positions`: `[V]`; `sizes`: number of corners of each polygon;
    /// `corners`: vertex numbers of all polygons in a row.
    ///
    /// # Errors
    /// `ShapeMismatch` if the sizes do not add up to the corners; `Mesh` if the result fails
    /// [`Mesh::check`].
    pub fn from_polygons(positions: Vec<[f32; 3]>, sizes: &[u32], corners: &[u32]) -> Result<Mesh> {
        let total: u64 = sizes.iter().map(|&s| u64::from(s)).sum();
        if total != corners.len() as u64 {
            return Err(Error::ShapeMismatch {
                what: "polygon corners",
                expected: format!("[{total}]"),
                got: format!("[{}]", corners.len()),
            });
        }
        let mut mesh = Mesh {
            positions,
            triangles: Vec::with_capacity(corners.len().saturating_sub(2 * sizes.len())),
        };
        let mut rest = corners;
        for &size in sizes {
            let (polygon, after) = rest.split_at(size as usize);
            rest = after;
            mesh.add_polygon(polygon)?;
        }
        mesh.check()?;
        Ok(mesh)
    }

    /// Triangulates one polygon and appends it.
    pub(super) fn add_polygon(&mut self, polygon: &[u32]) -> Result<()> {
        let count = self.positions.len();
        if let Some(&v) = polygon.iter().find(|&&v| v as usize >= count) {
            return Err(Error::Mesh(format!(
                "face {}: expected vertex numbers below {count}, got {v}",
                self.triangles.len()
            )));
        }
        triangulate(&self.positions, polygon, &mut self.triangles);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[f32; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

    #[test]
    fn polygons_become_triangles_in_order() {
        let mut positions = SQUARE.to_vec();
        positions.push([0.5, 0.5, 1.0]);
        let sizes = [4, 3, 3, 3];
        let corners = [3, 2, 1, 0, 0, 1, 4, 1, 2, 4, 2, 3, 4];
        let mesh = Mesh::from_polygons(positions.clone(), &sizes, &corners).unwrap();
        assert_eq!(mesh.triangles.len(), 5);
        assert_eq!(mesh.triangles[2..], [[0, 1, 4], [1, 2, 4], [2, 3, 4]]);
        assert!(mesh.face_area_vectors()[0][2] < 0.0);
        let short = Mesh::from_polygons(positions.clone(), &[4, 3], &corners).unwrap_err();
        assert!(matches!(short, Error::ShapeMismatch { .. }));
        let beyond = Mesh::from_polygons(positions, &[3], &[0, 1, 9]).unwrap_err();
        assert!(beyond.to_string().contains("below 5, got 9"), "{beyond}");
    }

    #[test]
    fn files_that_are_no_mesh_are_errors_with_their_name() {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in [
            ("empty.obj", b"".as_slice()),
            ("noise.obj", b"\x00\x01\x02ply"),
            ("text.obj", b"dear reader\n"),
            ("cut.ply", b"ply\nformat ascii 1.0\nelement vertex 9\n"),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let error = Mesh::read(&path).unwrap_err();
            assert!(matches!(error, Error::Mesh(_)), "{error}");
            assert!(error.to_string().contains(name), "{error}");
        }
        let missing = Mesh::read(folder.path().join("missing.obj")).unwrap_err();
        assert!(matches!(missing, Error::Io { .. }));
    }
}
