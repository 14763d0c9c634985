//! Writes and reads rigs as numpy archives, and writes them as a folder with one OBJ per shape.

use std::{
    fs::File,
    io::{self, BufWriter, Write},
    path::Path,
};

use ndarray::{Array3, ArrayView2, ArrayView3, Axis};

use super::{npz::Archive, numpy::NumpyArchive};
use crate::{
    Error, Result,
    face::Rig,
    job::{create_folder, write_atomically},
    mesh::{Mesh, obj_text},
};

/// Writes `names` `[S]` (text), `deltas` `[S, V, 3]` f32 and `neutral` `[V, 3]` f32, all in mesh
/// units and axes.
///
/// # Errors
/// `ShapeMismatch` if mesh and rig differ in their number of vertices, `Io` if the file cannot be
/// written.
pub fn write_rig(path: &Path, rig: &Rig, mesh: &Mesh) -> Result<()> {
    rig.check_mesh(mesh)?;
    write_atomically(path, |file| {
        let mut archive = Archive::new(file);
        archive.names(&rig.names)?;
        archive.start("deltas", "<f4", rig.deltas.shape())?;
        archive.values(rig.deltas.view())?;
        let positions = mesh.positions.as_flattened();
        let neutral = ArrayView3::from_shape((1, mesh.positions.len(), 3), positions);
        let neutral = neutral.expect("three numbers a vertex");
        archive.start("neutral", "<f4", &[mesh.positions.len(), 3])?;
        archive.values(neutral)?;
        archive.finish()
    })
}

/// Reads what [`write_rig`] writes. `names` may be any numpy array of Unicode text, `deltas` may be
/// f32, f64 or integers.
///
/// # Errors
/// `Io` if the file cannot be read; `InvalidInput` if it is no such archive or its deltas are not
/// finite; `ShapeMismatch` if `deltas` is not `[S, V, 3]` with one shape for each name.
pub fn read_rig(path: &Path) -> Result<Rig> {
    let bad = |e: &dyn std::fmt::Display| Error::InvalidInput(format!("{}: {e}", path.display()));
    let mut npz = NumpyArchive::open(path)?;
    let deltas: Array3<f32> = npz.array("deltas")?;
    let names = npz.texts("names")?;
    let (shapes, vertices, axes) = deltas.dim();
    if names.len() != shapes || axes != 3 {
        return Err(Error::ShapeMismatch {
            what: "deltas",
            expected: format!("[{}, V, 3], one shape a name", names.len()),
            got: format!("[{shapes}, {vertices}, {axes}]"),
        });
    }
    if deltas.iter().any(|x| !x.is_finite()) {
        return Err(bad(&"deltas: expected finite numbers, got NaN or infinity"));
    }
    Ok(Rig {
        names,
        deltas,
        reports: Vec::new(),
    })
}

/// Writes `neutral.obj` and `NAME.obj` for every shape at strength 1 into `folder`.
///
/// `source`: the bytes of the OBJ that the mesh was read from. Everything in it stays (polygons,
/// texture coordinates, groups) except the positions and the material libraries. Without `source`
/// the triangles of the mesh are written.
///
/// # Errors
/// `ShapeMismatch` if mesh and rig differ in their number of vertices, `Io` if the folder cannot be
/// written.
pub fn write_rig_folder(
    folder: &Path,
    rig: &Rig,
    mesh: &Mesh,
    source: Option<&[u8]>,
) -> Result<()> {
    rig.check_mesh(mesh)?;
    create_folder(folder)?;
    let text = source.map(obj_text);
    let write = |name: &str, delta: Option<ArrayView2<'_, f32>>| {
        let moved = |v: usize| -> [f32; 3] {
            let by = |i: usize| delta.map_or(0.0, |delta| delta[[v, i]]);
            std::array::from_fn(|i| mesh.positions[v][i] + by(i))
        };
        write_atomically(&folder.join(format!("{name}.obj")), |file| match &text {
            Some(text) => rewrite(file, text, moved),
            None => plain(file, mesh, moved),
        })
    };
    write("neutral", None)?;
    for (name, delta) in rig.names.iter().zip(rig.deltas.axis_iter(Axis(0))) {
        write(name, Some(delta))?;
    }
    Ok(())
}

impl Rig {
    /// Refuses a mesh that the rig does not belong to, by its number of vertices.
    pub(super) fn check_mesh(&self, mesh: &Mesh) -> Result<()> {
        let (vertices, got) = (self.deltas.dim().1, mesh.positions.len());
        if vertices == got {
            Ok(())
        } else {
            Err(Error::ShapeMismatch {
                what: "mesh",
                expected: format!("[{vertices}, 3], the rig's vertices"),
                got: format!("[{got}, 3]"),
            })
        }
    }
}

/// Writes the source with other positions. Leaves out the names of material libraries, because those
/// lie in another folder.
fn rewrite(
    file: &mut BufWriter<File>,
    source: &str,
    position: impl Fn(usize) -> [f32; 3],
) -> io::Result<()> {
    let mut v = 0;
    for line in source.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let [x, y, z] = position(v);
                writeln!(file, "v {x} {y} {z}")?;
                v += 1;
            }
            Some("mtllib") => {}
            _ => writeln!(file, "{line}")?,
        }
    }
    Ok(())
}

fn plain(
    file: &mut BufWriter<File>,
    mesh: &Mesh,
    position: impl Fn(usize) -> [f32; 3],
) -> io::Result<()> {
    for v in 0..mesh.positions.len() {
        let [x, y, z] = position(v);
        writeln!(file, "v {x} {y} {z}")?;
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| v + 1);
        writeln!(file, "f {a} {b} {c}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const SOURCE: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\n\
                          vt 0 0\no part\nf 1/1 2/1 3/1 4/1\nf 2/1 5/1 6/1 3/1\n";

    fn example() -> (Rig, Mesh) {
        let mesh = Mesh::parse(SOURCE.as_bytes()).unwrap();
        let rig = Rig {
            names: vec!["jawOpen".into(), "viseme_aa".into()],
            deltas: Array3::from_shape_fn((2, 6, 3), |(s, v, i)| (s + 2 * v + i) as f32),
            reports: Vec::new(),
        };
        (rig, mesh)
    }

    #[test]
    fn a_rig_comes_back_from_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.npz");
        let (rig, mesh) = example();
        write_rig(&path, &rig, &mesh).unwrap();
        assert_eq!(read_rig(&path).unwrap(), rig);
        fs::write(&path, b"no archive").unwrap();
        assert!(matches!(read_rig(&path), Err(Error::InvalidInput(_))));
    }

    #[test]
    fn a_folder_keeps_polygons_and_moves_vertices() {
        let folder = tempfile::tempdir().unwrap();
        let (rig, mesh) = example();
        write_rig_folder(folder.path(), &rig, &mesh, Some(SOURCE.as_bytes())).unwrap();
        let text = fs::read_to_string(folder.path().join("jawOpen.obj")).unwrap();
        assert!(text.contains("f 1/1 2/1 3/1 4/1") && !text.contains("mtllib"));
        let moved = Mesh::parse(text.as_bytes()).unwrap();
        for v in 0..6 {
            for i in 0..3 {
                let expected = mesh.positions[v][i] + rig.deltas[[0, v, i]];
                assert_eq!(moved.positions[v][i], expected);
            }
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    }

    #[test]
    fn another_mesh_is_refused() {
        let (rig, mut mesh) = example();
        mesh.positions.push([0.0; 3]);
        let folder = tempfile::tempdir().unwrap();
        let error = write_rig_folder(folder.path(), &rig, &mesh, None).unwrap_err();
        assert!(matches!(error, Error::ShapeMismatch { .. }));
    }
}
