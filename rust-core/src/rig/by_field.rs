//! Makes the shapes of a face with the field of the head most like it. Each shape is the motion
//! under the code of its weight, and this motion is not linear in the weight. So shapes at half the
//! weight can be made as well.

use ndarray::{Array2, Array3, Axis, s};

use super::{ARKIT, RigModel, VISEMES, names::arkit};
use crate::{
    Result,
    face::{CodeField, Deformer, Face, Rig, ShapeReport, binding::Follows},
    head::{Head, HeadOnMesh},
    job::{ProgressFn, SILENT, report},
};

/// Ending of the name of a shape at half its weight.
const HALF: &str = "_half";
/// Shapes made at a time.
const AT_ONCE: usize = 16;

/// What makes the shapes of a face.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShapeSource {
    /// The network, from the face alone.
    Network,
    /// The field of the parametric head most like the face moves the skin; see
    /// [`RigModel::by_field`].
    Field {
        /// Whether ARKit's shapes at half their weight are made as well.
        in_betweens: bool,
    },
}

/// The head most like a face, and the deformer that spreads the motion of its landmarks.
pub struct FieldOfFace<'a> {
    /// The model of heads.
    pub head: &'a Head,
    /// Its field on the face.
    pub field: &'a HeadOnMesh,
    /// Moves what the field does not reach.
    pub deformer: &'a dyn Deformer,
}

impl RigModel {
    /// The shapes of `linear`, with the skin moved by the field. ARKit's shapes that have a code
    /// come from the field, and so do the visemes, which are mixtures of them. Teeth, tongue,
    /// eyeballs and `tongueOut` stay as they are in `linear`. With `in_betweens`, one more shape
    /// `NAME_half` for each of ARKit's shapes follows at the end: the face at weight 0.5.
    ///
    /// As ARKit defines it, `mouthClose` is what closing the lips adds to an open jaw.
    ///
    /// # Errors
    /// `Mesh` if the landmarks lie on no usable face, `Cancelled`.
    pub fn by_field(
        &self,
        face: &Face,
        linear: &Rig,
        by: &FieldOfFace<'_>,
        in_betweens: bool,
        progress: ProgressFn<'_>,
    ) -> Result<Rig> {
        let (shapes, vertices) = (ARKIT.len() + VISEMES.len(), face.mesh.positions.len());
        let weights = self.weights(in_betweens);
        let mut deltas = by.moved(face, &weights, progress)?;
        let close = arkit("mouthClose");
        let closed = std::iter::once(close).chain(in_betweens.then_some(shapes + close));
        for row in closed {
            let open = deltas.index_axis(Axis(0), row - close + arkit("jawOpen"));
            let added = &deltas.index_axis(Axis(0), row) - &open;
            deltas.index_axis_mut(Axis(0), row).assign(&added);
        }
        let features = face.features();
        let follows = &face.surface()?.follows;
        for (row, mut shape_deltas) in deltas.outer_iter_mut().enumerate() {
            let (shape, weight) = if row < shapes {
                (row, 1.0)
            } else {
                (row - shapes, 0.5)
            };
            let known = weights.row(row).iter().any(|w| *w != 0.0);
            let share = ARKIT.get(shape).map_or(1.0, |name| features.of_shape(name));
            let straight = linear.deltas.index_axis(Axis(0), shape);
            for v in 0..vertices {
                let is_skin = matches!(follows[v], Follows::Skin(_));
                for axis in 0..3 {
                    let by_field = share * shape_deltas[[v, axis]];
                    let plain = weight * straight[[v, axis]];
                    shape_deltas[[v, axis]] = if known && is_skin { by_field } else { plain };
                }
            }
        }
        let scale = face.metres_per_unit() as f32;
        Ok(reported(linear, deltas, scale))
    }

    /// The weights of ARKit's shapes for every shape of the result, `[S, 52]`.
    fn weights(&self, in_betweens: bool) -> Array2<f32> {
        let mut whole = Array2::eye(ARKIT.len());
        whole[[arkit("mouthClose"), arkit("jawOpen")]] = 1.0;
        let mut all = vec![whole.view(), self.visemes().view()];
        let half = 0.5 * &whole;
        all.extend(in_betweens.then_some(half.view()));
        let mut all = ndarray::concatenate(Axis(0), &all).expect("52 columns each");
        all.column_mut(arkit("tongueOut")).fill(0.0);
        all
    }
}

impl FieldOfFace<'_> {
    /// Displacements `[S, V, 3]` of the face under weights `[S, 52]`, mesh units and axes.
    fn moved(
        &self,
        face: &Face,
        weights: &Array2<f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let (shapes, vertices) = (weights.nrows(), face.mesh.positions.len());
        let mut out = Array3::zeros((shapes, vertices, 3));
        for first in (0..shapes).step_by(AT_ONCE) {
            report(progress, "field", first as f32 / shapes as f32)?;
            let some = first..(first + AT_ONCE).min(shapes);
            let codes = self.codes(&weights.slice(s![some.clone(), ..]).to_owned())?;
            let marks = self.field.landmarks(codes.view())?;
            let motion = face.motion_on_mesh(marks.view());
            let moved = face.under_codes(
                (self.field, self.deformer),
                motion.view(),
                codes.view(),
                SILENT,
            )?;
            out.slice_mut(s![some, .., ..]).assign(&moved);
        }
        report(progress, "field", 1.0)?;
        Ok(out)
    }

    fn codes(&self, weights: &Array2<f32>) -> Result<Array2<f32>> {
        let config = self.head.config();
        let mut codes = Array2::zeros((weights.nrows(), config.expression_code));
        for (row, mut code) in weights.rows().into_iter().zip(codes.rows_mut()) {
            let of = |name: &String| ARKIT.iter().position(|known| known == name);
            let channels = config.channels.iter();
            let channels: Vec<f32> = channels
                .map(|name| of(name).map_or(0.0, |n| row[n]))
                .collect();
            code.assign(&ndarray::aview1(&self.head.expression_code(&channels)?));
        }
        Ok(codes)
    }
}

/// Makes a rig with names and reports. A shape by the field, whole or half, keeps the note that it
/// has in `linear`.
fn reported(linear: &Rig, deltas: Array3<f32>, scale: f32) -> Rig {
    let shapes = linear.names.len();
    let halves = ARKIT.iter().map(|name| format!("{name}{HALF}"));
    let names = linear.names.iter().cloned().chain(halves);
    let names: Vec<String> = names.take(deltas.len_of(Axis(0))).collect();
    let note_of = |row: usize| {
        linear
            .reports
            .get(row % shapes)
            .and_then(|report| report.note.clone())
    };
    let rows = names.iter().zip(deltas.outer_iter()).enumerate();
    let reports = rows
        .map(|(row, (name, shape))| ShapeReport::of(name, shape, scale, |_| note_of(row)))
        .collect();
    Rig {
        names,
        deltas,
        reports,
    }
}
