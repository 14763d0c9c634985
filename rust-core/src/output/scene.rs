//! The contents of a scene file, and how its face is oriented.

use crate::{
    Result,
    mesh::{Mesh, Similarity, canonical_landmarks, ibug::LANDMARKS},
    motion::Life,
};

/// The contents of a scene file other than the motion of the vertices.
pub(super) struct Scene<'a> {
    pub mesh: &'a Mesh,
    /// At rest, mesh units.
    pub landmarks: &'a [[f32; 3]; LANDMARKS],
    pub life: Option<&'a Life>,
    /// The bytes of the file that the mesh was read from, unchanged.
    pub source: Option<&'a [u8]>,
    /// The name of the sound file beside this one.
    pub sound: Option<&'a str>,
}

impl<'a> Scene<'a> {
    /// The file that the mesh was read from, if it is a GLB. The rest of its contents must stay.
    pub fn glb(&self) -> Option<&'a [u8]> {
        self.source.filter(|bytes| bytes.starts_with(b"glTF"))
    }
}

/// Whether the face's up axis in the mesh is nearer to z, as in many modelling programs, than to y.
///
/// # Errors
/// Those of [`hinges`].
pub(super) fn is_z_up(scene: &Scene<'_>) -> Result<bool> {
    let [_, y, z] = hinges(scene)?.rotate([0.0, 1.0, 0.0]);
    Ok(z.abs() > y.abs())
}

/// The transform from canonical axes, whose origin lies between the jaw's hinges, to the mesh.
///
/// # Errors
/// `Numerics` for landmarks that all lie in one place.
pub(super) fn hinges(scene: &Scene<'_>) -> Result<Similarity> {
    Ok(Similarity::fit(canonical_landmarks(), scene.landmarks, None)?.similarity)
}
