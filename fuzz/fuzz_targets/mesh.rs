//! OBJ, PLY and GLB: a mesh that is read passes its own check and keeps to the size of its file.
#![no_main]

use anyface::mesh::{Mesh, ObjectNames};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(mesh) = Mesh::parse(bytes) {
        mesh.check().unwrap();
        assert!(mesh.positions.len() <= 8_000_000 + 8 * bytes.len());
        if mesh.positions.len() < 10_000 {
            let _ = mesh.report();
        }
    }
    let names = ObjectNames::of_obj(&String::from_utf8_lossy(bytes));
    assert!(names.of_vertex.len() <= bytes.len());
});
