//! Shapes, or parts of shapes, that a decoder makes from the shape's own landmark motion.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis};

use super::names::arkit;
use crate::{
    Result,
    face::{Deformer, Face, FaceSurface, binding::Follows},
    job::SILENT,
    mesh::ibug::LANDMARKS,
};

/// Shapes whose folds lie between the landmarks. In these shapes the learned decoder, which makes
/// creases, is nearer to the truth than the network. This was measured on unseen faces of both
/// kinds that the decoder was trained on.
const FOLDING: [&str; 5] = [
    "browDownLeft",
    "browDownRight",
    "browInnerUp",
    "browOuterUpLeft",
    "browOuterUpRight",
];
/// Shapes in which the jaw moves.
const JAW: [&str; 4] = ["jawOpen", "jawForward", "jawLeft", "jawRight"];

/// The decoder of landmark motion with its learned part.
pub struct Learned<'a> {
    /// Moves the face.
    pub deformer: &'a dyn Deformer,
    /// How far to rely on it for this face, 0 to 1.
    pub share: f32,
}

/// Moves the skin in the folding shapes towards the motion of the learned decoder, by its share.
/// `deltas`: `[S, V, 3]`, centimetres.
pub(super) fn fold(
    face: &Face,
    head: &FaceSurface,
    learned: &Learned<'_>,
    deltas: &mut Array3<f32>,
) -> Result<()> {
    if learned.share == 0.0 {
        return Ok(());
    }
    let deform = |motion: ArrayView3<'_, f32>| learned.deformer.deform_freely(motion, SILENT);
    for name in FOLDING {
        let mut shape = deltas.index_axis_mut(Axis(0), arkit(name));
        let moved = decoded(face, shape.view(), deform)?;
        for (v, follows) in head.follows.iter().enumerate() {
            if matches!(follows, Follows::Skin(_)) {
                (0..3).for_each(|i| {
                    shape[[v, i]] += learned.share * (moved[[v, i]] - shape[[v, i]]);
                });
            }
        }
    }
    Ok(())
}

/// In the four shapes of the jaw, moves the parts that follow the jaw as the face's own deformer
/// does for the skin's landmarks. In other shapes the chin's skin moves over a jaw at rest.
/// `deltas`: centimetres.
pub(super) fn move_jaw(
    face: &Face,
    head: &FaceSurface,
    plain: &dyn Deformer,
    deltas: &mut Array3<f32>,
) -> Result<()> {
    for name in JAW {
        let mut shape = deltas.index_axis_mut(Axis(0), arkit(name));
        let moved = decoded(face, shape.view(), |motion| plain.deform(motion, SILENT))?;
        for (v, follows) in head.follows.iter().enumerate() {
            if matches!(follows, Follows::Jaw(_)) {
                shape.row_mut(v).assign(&moved.row(v));
            }
        }
    }
    Ok(())
}

/// The motion that `deform` makes from the landmarks of one shape, `[V, 3]`, centimetres. `deform`
/// takes and returns mesh units.
fn decoded(
    face: &Face,
    shape: ArrayView2<'_, f32>,
    deform: impl Fn(ArrayView3<'_, f32>) -> Result<Array3<f32>>,
) -> Result<Array2<f32>> {
    let motion = Array3::from_shape_fn((1, LANDMARKS, 3), |(_, n, i)| {
        0.01 * shape[[face.landmarks.vertices[n] as usize, i]]
    });
    let motion = face.to_canonical.displacements_to_mesh(motion.view());
    let mut moved = deform(motion.view())?.index_axis_move(Axis(0), 0);
    let to_cm = 100.0 * face.to_canonical.scale as f32;
    for mut row in moved.rows_mut() {
        let canonical = face.to_canonical.rotate([row[0], row[1], row[2]]);
        (0..3).for_each(|i| row[i] = to_cm * canonical[i]);
    }
    Ok(moved)
}
