//! Eyes that look, without the lids about them.

use super::parts::{Gaze, eyeballs};
use crate::{Result, face::Face};

/// What turns with an eye that looks.
#[derive(Debug, Clone, PartialEq)]
pub struct EyeLook {
    /// A name of [`ARKIT`](super::ARKIT).
    pub name: &'static str,
    /// Vertices with their displacements at weight 1, mesh units, in the order of their numbers.
    pub moved: Vec<(u32, [f32; 3])>,
}

/// Names of ways to look, of the right and of the left eye.
const WAYS: [(Gaze, [&str; 2]); 4] = [
    (Gaze::Up, ["eyeLookUpRight", "eyeLookUpLeft"]),
    (Gaze::Down, ["eyeLookDownRight", "eyeLookDownLeft"]),
    (Gaze::In, ["eyeLookInRight", "eyeLookInLeft"]),
    (Gaze::Out, ["eyeLookOutRight", "eyeLookOutLeft"]),
];

/// Each eyeball of a face that turns, in the four ways to look; as the rig of the face turns it.
///
/// # Errors
/// `Mesh` if the landmarks lie on no usable face.
pub fn eye_looks(face: &Face) -> Result<Vec<EyeLook>> {
    let head = face.surface()?;
    let parts = &face.parts.connected;
    let eyes = eyeballs(&head.positions, parts, &head.follows, &head.landmarks);
    let to_mesh = face.to_canonical.inverse();
    let mut looks = Vec::new();
    for eye in &eyes {
        for (gaze, names) in WAYS {
            let moved = eye.vertices.iter().map(|v| {
                let centimetres = eye.look(gaze, head.positions[*v as usize]);
                let metres = to_mesh.rotate(centimetres.map(|x| 0.01 * x));
                (*v, metres.map(|x| to_mesh.scale as f32 * x))
            });
            let mut moved: Vec<_> = moved.collect();
            moved.sort_by_key(|(v, _)| *v);
            looks.push(EyeLook {
                name: names[usize::from(eye.is_left)],
                moved,
            });
        }
    }
    Ok(looks)
}
