//! Shapes that turn only the eyeballs, without the lids around them.

use super::parts::{Gaze, eyeballs};
use crate::{Result, face::Face};

/// A shape that turns one eye in one direction.
#[derive(Debug, Clone, PartialEq)]
pub struct EyeLook {
    /// A name of [`ARKIT`](super::ARKIT).
    pub name: &'static str,
    /// Vertices with their displacements at weight 1, mesh units, ordered by vertex number.
    pub moved: Vec<(u32, [f32; 3])>,
}

/// Names of the shapes that look each way, for the right and the left eye.
const WAYS: [(Gaze, [&str; 2]); 4] = [
    (Gaze::Up, ["eyeLookUpRight", "eyeLookUpLeft"]),
    (Gaze::Down, ["eyeLookDownRight", "eyeLookDownLeft"]),
    (Gaze::In, ["eyeLookInRight", "eyeLookInLeft"]),
    (Gaze::Out, ["eyeLookOutRight", "eyeLookOutLeft"]),
];

/// Each eyeball of a face in each of the four directions, turned as in the rig of the face.
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
