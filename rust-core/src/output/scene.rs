//! What files of scenes show.

use crate::{
    Result,
    mesh::{Mesh, Similarity, canonical_landmarks, ibug::LANDMARKS},
    motion::Life,
};

/// What a file shows beside the moving vertices.
pub(super) struct Scene<'a> {
    pub mesh: &'a Mesh,
    /// At rest, mesh units.
    pub landmarks: &'a [[f32; 3]; LANDMARKS],
    pub life: Option<&'a Life>,
    /// The bytes of the file that the mesh was read from, unchanged.
    pub source: Option<&'a [u8]>,
    /// The name of the sound's file beside this one.
    pub sound: Option<&'a str>,
}

impl<'a> Scene<'a> {
    /// The file that the mesh was read from where that is a GLB, all else of which is to stay.
    pub fn glb(&self) -> Option<&'a [u8]> {
        self.source.filter(|bytes| bytes.starts_with(b"glTF"))
    }
}

/// Whether the mesh's axis nearest to the face's way up is z, as in many programs of modelling, and not y.
///
/// # Errors
/// Those of [`hinges`].
pub(super) fn is_z_up(scene: &Scene<'_>) -> Result<bool> {
    let [_, y, z] = hinges(scene)?.rotate([0.0, 1.0, 0.0]);
    Ok(z.abs() > y.abs())
}

/// From canonical axes, whose origin lies between the jaw's hinges, to the mesh.
///
/// # Errors
/// `Numerics` for landmarks that all lie in one place.
pub(super) fn hinges(scene: &Scene<'_>) -> Result<Similarity> {
    Ok(Similarity::fit(canonical_landmarks(), scene.landmarks, None)?.similarity)
}
