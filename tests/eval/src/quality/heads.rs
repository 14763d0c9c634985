//! Heads from three sources, to measure how landmark motion moves a mesh.

use std::path::Path;

use ndarray::{Array3, Axis};

use crate::{face_model::FaceModel, vertex_motion::vertex_motion};
use anyface::{
    Engine, Face, Result,
    face::FaceOptions,
    job::SILENT,
    mesh::{LandmarkSource, Mesh, ibug::LANDMARKS},
    motion::LandmarkClip,
};

const MM: f64 = 1000.0;

/// A prepared head.
pub(super) struct Head {
    pub title: &'static str,
    face: Face,
}

impl Head {
    /// ICT's mean head, MakeHuman's, and the default head in `folder`.
    pub(super) fn three(engine: &Engine, data: &Path, folder: &Path) -> Result<Vec<Self>> {
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::read(&folder.join("landmarks.json"))?),
            ..FaceOptions::default()
        };
        let mesh = Mesh::read(folder.join("head.obj"))?;
        Ok(vec![
            Self::of_model(engine, "ICT", &FaceModel::ict(data)?)?,
            Self::of_model(engine, "MakeHuman", &FaceModel::makehuman(data)?)?,
            Head {
                title: "default head",
                face: engine.prepare(&mesh, &options, SILENT)?,
            },
        ])
    }

    /// A head with its own landmarks.
    pub(super) fn of_model(
        engine: &Engine,
        title: &'static str,
        model: &FaceModel,
    ) -> Result<Self> {
        Ok(Head {
            title,
            face: engine.prepare(&model.mesh(&[])?, &model.options(), SILENT)?,
        })
    }

    /// Vertex displacements `[T, V, 3]` in mesh units under landmark motion `[T, 68, 3]` in metres.
    pub(super) fn moved(&self, engine: &Engine, motion: &Array3<f64>) -> Result<Array3<f32>> {
        let motion = LandmarkClip {
            displacements: motion.mapv(|x| x as f32),
            fps: 1.0,
        };
        let motion = engine.follow(&motion, &self.face.options.controls, SILENT)?;
        vertex_motion(engine, &self.face, &motion)
    }

    /// How the mesh itself moves at its landmarks under landmark motion `[T, 68, 3]` in metres.
    ///
    /// Returns `[T, 68, 3]`, millimetres along the canonical axes on a head of human size.
    pub(super) fn landmarks(&self, engine: &Engine, motion: &Array3<f64>) -> Result<Array3<f64>> {
        let vertices = self.face.landmarks.vertices.map(|v| v as usize);
        let moved = self.moved(engine, motion)?.select(Axis(1), &vertices);
        let (turn, scale) = (
            self.face.to_canonical.rotation,
            self.face.to_canonical.scale,
        );
        Ok(Array3::from_shape_fn(moved.dim(), |(t, n, i)| {
            let along = (0..3).map(|j| turn[i][j] * f64::from(moved[[t, n, j]]));
            MM * scale * along.sum::<f64>()
        }))
    }
}

/// Stacks frames `[68, 3]` into one clip, `[T, 68, 3]`.
pub(super) fn stacked(frames: &[ndarray::ArrayView2<'_, f64>]) -> Array3<f64> {
    let mut out = Array3::zeros((frames.len(), LANDMARKS, 3));
    for (from, mut to) in frames.iter().zip(out.outer_iter_mut()) {
        to.assign(from);
    }
    out
}
