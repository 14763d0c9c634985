//! Converts points between a mesh and the frame of one of its eyes.

use glam::{DVec3, Vec3};

use crate::{face::eyes::EyeFrame, mesh::Similarity};

/// Converts between a mesh and the frame of one of its eyes: across, up and out, in canonical
/// centimetres.
pub(super) struct EyeSpace {
    pub frame: EyeFrame,
    pub to_canonical: Similarity,
}

impl EyeSpace {
    /// A point of the mesh in the eye's frame, whose origin is the centre of the ball.
    pub fn local(&self, p: [f32; 3]) -> Vec3 {
        let cm = self.to_canonical.apply(p).map(|x| 100.0 * x);
        self.frame.local(cm).into()
    }

    /// The same in double precision.
    pub fn local_of(&self, p: DVec3) -> DVec3 {
        self.local(p.as_vec3().into()).as_dvec3()
    }

    /// The inverse of `local`.
    pub fn point(&self, local: Vec3) -> [f32; 3] {
        let [across, up, out] = self.frame.axes.map(Vec3::from);
        let cm = Vec3::from(self.frame.origin) + local.x * across + local.y * up + local.z * out;
        self.to_canonical.inverse().apply((0.01 * cm).into())
    }
}
