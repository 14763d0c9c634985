//! Rigs as numpy archives, and as a folder with one OBJ a shape.

use std::{
    fs,
    io::{self, BufWriter, Read, Write},
    path::Path,
};

use ndarray::{Array3, ArrayView2, ArrayView3, Axis};
use ndarray_npy::NpzReader;

use super::{npz::Archive, write_atomically};
use crate::{Error, Result, mesh::Mesh, rig::Rig};

/// Writes `names` `[S]` (text), `deltas` `[S, V, 3]` f32 and `neutral` `[V, 3]` f32, all in mesh
/// units and axes.
///
/// # Errors
/// `ShapeMismatch` if the mesh is not the rig's, `Io` if the file cannot be written.
pub fn write_rig(path: &Path, rig: &Rig, mesh: &Mesh) -> Result<()> {
    check(rig, mesh)?;
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

/// Reads what [`write_rig`] writes; `names` may be any numpy array of text, deltas f32.
///
/// # Errors
/// `Io` if the file cannot be read, `InvalidInput` if it is no such archive, `ShapeMismatch` if
/// names and deltas differ in number.
pub fn read_rig(path: &Path) -> Result<Rig> {
    let open = || fs::File::open(path).map_err(Error::io(path));
    let bad = |e: &dyn std::fmt::Display| Error::InvalidInput(format!("{}: {e}", path.display()));
    let mut npz = NpzReader::new(io::BufReader::new(open()?))
        .map_err(|e| bad(&format!("expected an npz archive ({e})")))?;
    let deltas: Array3<f32> = npz
        .by_name("deltas")
        .map_err(|e| bad(&format!("expected an array deltas [S, V, 3] of f32 ({e})")))?;
    let names = read_names(path)?;
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

/// The array `names` `[S]` of text.
///
/// # Errors
/// `Io` if the file cannot be read, `InvalidInput` if it has no such array.
pub(super) fn read_names(path: &Path) -> Result<Vec<String>> {
    let file = fs::File::open(path).map_err(Error::io(path))?;
    let bad = |e: &dyn std::fmt::Display| Error::InvalidInput(format!("{}: {e}", path.display()));
    let mut archive = zip::ZipArchive::new(io::BufReader::new(file)).map_err(|e| bad(&e))?;
    let mut bytes = Vec::new();
    archive
        .by_name("names.npy")
        .map_err(|e| bad(&format!("expected an array names ({e})")))?
        .read_to_end(&mut bytes)
        .map_err(Error::io(path))?;
    texts(&bytes).ok_or_else(|| bad(&"names: expected an array of text"))
}

/// Writes `neutral.obj` and `NAME.obj` for every shape at strength 1 into `folder`.
///
/// `source`: the bytes of the OBJ the mesh was read from; then everything but the positions stays
/// as it is there (polygons, texture coordinates, groups). Without it the mesh's triangles are
/// written.
///
/// # Errors
/// `ShapeMismatch` if the mesh is not the rig's, `Io` if the folder cannot be written.
pub fn write_rig_folder(
    folder: &Path,
    rig: &Rig,
    mesh: &Mesh,
    source: Option<&[u8]>,
) -> Result<()> {
    check(rig, mesh)?;
    fs::create_dir_all(folder).map_err(Error::io(folder))?;
    let text = source.map(|bytes| {
        let text = String::from_utf8_lossy(bytes);
        text.replace("\\\r\n", " ").replace("\\\n", " ")
    });
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

fn check(rig: &Rig, mesh: &Mesh) -> Result<()> {
    match rig.deltas.dim().1 == mesh.positions.len() {
        true => Ok(()),
        false => Err(Error::ShapeMismatch {
            what: "mesh",
            expected: format!("[{}, 3], the rig's vertices", rig.deltas.dim().1),
            got: format!("[{}, 3]", mesh.positions.len()),
        }),
    }
}

/// The source with other positions; material libraries are left out, they lie elsewhere.
fn rewrite(
    file: &mut BufWriter<fs::File>,
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
    file: &mut BufWriter<fs::File>,
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

/// The strings of a numpy array of Unicode text, `<U…`, UTF-32 padded with zeros.
fn texts(npy: &[u8]) -> Option<Vec<String>> {
    let length = match npy.get(6)? {
        1 => usize::from(u16::from_le_bytes(npy.get(8..10)?.try_into().ok()?)) + 10,
        _ => u32::from_le_bytes(npy.get(8..12)?.try_into().ok()?) as usize + 12,
    };
    let header = std::str::from_utf8(npy.get(10..length)?).ok()?;
    let size: String = header
        .split_once("'<U")?
        .1
        .chars()
        .take_while(char::is_ascii_digit)
        .collect();
    let bytes = 4 * size.parse::<usize>().ok().filter(|size| *size > 0)?;
    let text = |chunk: &[u8]| {
        let codes = chunk
            .chunks_exact(4)
            .map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]]));
        codes
            .take_while(|code| *code != 0)
            .map(char::from_u32)
            .collect()
    };
    npy.get(length..)?.chunks_exact(bytes).map(text).collect()
}

#[cfg(test)]
mod tests {
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
