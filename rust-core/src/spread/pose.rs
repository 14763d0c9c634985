//! Finds the pose of a face from its vertices.

use ndarray::{ArrayView2, Axis};

use super::FaceTongue;
use crate::{Result, face::Face, job::SILENT, motion::Pose};

/// The pose of a face whose vertices are displaced by `moved` `[V, 3]`, mesh units and axes. A
/// motion may start from it. If the face was prepared, the pose includes what the tongue does in
/// addition to the jaw. On other faces the tongue rests.
///
/// # Errors
/// Those of [`Face::pose_of`].
pub fn pose_on(face: &Face, moved: ArrayView2<'_, f32>) -> Result<Pose> {
    let mut pose = Pose::from(face.pose_of(moved)?);
    if let (Some(deformer), Ok(tongue)) = (face.known_deformer(), FaceTongue::find(face)) {
        let landmarks = ArrayView2::from(&pose.landmarks).insert_axis(Axis(0));
        let motion = face.motion_on_mesh(landmarks);
        let jaw = deformer.deform(motion.view(), SILENT)?;
        pose.tongue = tongue.shares_of(moved, jaw.index_axis(Axis(0), 0));
    }
    Ok(pose)
}
