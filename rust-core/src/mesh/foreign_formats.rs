//! Names the formats that Anyface does not read, so that an error can say how to go on.

use std::str::from_utf8;

/// What the files of a format begin with, and its name.
const BEGINNINGS: [(&[u8], &str); 19] = [
    (b"Kaydara FBX Binary", "FBX"),
    (b"; FBX", "FBX as text"),
    (b"BLENDER", "a .blend file"),
    (b"\x28\xB5\x2F\xFD", "a packed file, perhaps a .blend"),
    (b"\x1F\x8B", "a packed file, perhaps a .blend"),
    (b"#usda", "USD as text (.usda)"),
    (b"PXR-USDC", "USD (.usdc)"),
    (b"PK\x03\x04", "a ZIP archive, perhaps USDZ or 3MF"),
    (b"PMX ", "an MMD model (.pmx)"),
    (b"Pmd", "an MMD model (.pmd)"),
    (b"Ogawa", "Alembic (.abc)"),
    (b"\x89HDF", "HDF5, perhaps Alembic"),
    (b"solid", "STL as text"),
    (b"#VRML", "VRML (.wrl)"),
    (b"OFF", "OFF"),
    (b"//Maya", "a Maya scene (.ma)"),
    (b"FOR4", "a Maya scene (.mb)"),
    (b"FOR8", "a Maya scene (.mb)"),
    (b"QC4DC4D", "a Cinema 4D scene (.c4d)"),
];
/// What the beginning of an XML file contains, and the name of its format.
const XML: [(&str, &str); 3] = [
    ("<COLLADA", "COLLADA (.dae)"),
    ("<X3D", "X3D"),
    ("<?xml", "XML"),
];
/// How much of an XML file is searched for its format, bytes.
const HEAD: usize = 4096;
/// Bytes of a binary STL before its triangles, and of a triangle.
const STL: (usize, usize) = (84, 50);

/// The refusal of a file of another format; `None` if the file may be an OBJ.
pub(super) fn foreign_format(bytes: &[u8]) -> Option<String> {
    let known = BEGINNINGS
        .iter()
        .find(|(begin, _)| bytes.starts_with(begin));
    let name = match known {
        Some((_, name)) => name,
        None => xml(bytes).or_else(|| stl(bytes)).or_else(|| {
            // An OBJ is text.
            bytes.contains(&0).then_some("unknown binary data")
        })?,
    };
    Some(format!(
        "expected an OBJ, PLY, GLB or glTF file, got {name}; open or import it in Blender and write it by File → Export → \
         glTF 2.0 as .glb"
    ))
}

fn xml(bytes: &[u8]) -> Option<&'static str> {
    let head = &bytes[..bytes.len().min(HEAD)];
    let head =
        from_utf8(head).unwrap_or_else(|e| from_utf8(&head[..e.valid_up_to()]).unwrap_or(""));
    let head = head.trim_start_matches('\u{FEFF}').trim_start();
    let found = XML.iter().find(|(mark, _)| head.contains(mark));
    found
        .filter(|_| head.starts_with('<'))
        .map(|(_, name)| *name)
}

/// A binary STL says at its end of the header how many triangles follow.
fn stl(bytes: &[u8]) -> Option<&'static str> {
    let count = bytes.get(STL.0 - 4..STL.0)?;
    let count = u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize;
    let length = count.checked_mul(STL.1)?.checked_add(STL.0)?;
    (bytes.len() == length).then_some("STL")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_named_with_the_way_out() {
        let stl = [&[0; 80][..], &1u32.to_le_bytes(), &[0; 50]].concat();
        for (bytes, name) in [
            (&b"Kaydara FBX Binary  \x00\x1a"[..], "FBX"),
            (
                b"\xEF\xBB\xBF<?xml version=\"1.0\"?>\n<COLLADA>",
                "COLLADA (.dae)",
            ),
            (b"<?xml version=\"1.0\"?><X3D>", "X3D"),
            (b"#usda 1.0\n", "USD as text (.usda)"),
            (b"PMX \x00", "MMD model (.pmx)"),
            (b"solid head\nfacet", "STL as text"),
            (&stl, "STL;"),
            (b"\x00\x01", "unknown binary data"),
        ] {
            let message = foreign_format(bytes).unwrap();
            assert!(message.contains(name), "{message}");
            assert!(message.contains("Blender"), "{message}");
        }
        assert_eq!(foreign_format(b"# solid\nv 0 0 0\n"), None);
        assert_eq!(foreign_format(b""), None);
    }
}
