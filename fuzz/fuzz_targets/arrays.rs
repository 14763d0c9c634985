//! npz, pc2 and mdd: the first byte chooses the reader; what is read is finite.
#![no_main]

use anyface::{
    mesh::Mesh,
    output::{read_landmark_motion, read_life, read_rig, read_vertex_motion, read_weights},
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((choice, bytes)) = bytes.split_first() else {
        return;
    };
    let ending = ["npz", "pc2", "mdd"][usize::from(choice % 3)];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("a.{ending}"));
    std::fs::write(&path, bytes).unwrap();
    let mesh = Mesh {
        positions: vec![[0.0; 3]; 4],
        triangles: vec![[0, 1, 2]],
    };
    if let Ok(motion) = read_vertex_motion(&path, &mesh) {
        assert!(motion.displacements.iter().all(|x| x.is_finite()));
    }
    if ending == "npz" {
        if let Ok(motion) = read_landmark_motion(&path) {
            assert!(motion.displacements.iter().all(|x| x.is_finite()));
        }
        if let Ok(rig) = read_rig(&path) {
            assert!(rig.deltas.iter().all(|x| x.is_finite()));
        }
        let _ = (read_life(&path), read_weights(&path));
    }
});
