//! The faces of ICT and MakeHuman, whose true motion is known: a neutral face with a mode for each
//! expression.

use std::path::Path;

use anyface::{
    Error, Result,
    face::FaceOptions,
    mesh::{LandmarkSource, Mesh, ibug::LANDMARKS},
};
use ndarray::{Array2, Array3, ArrayView2, ArrayViewMut2, Axis};

use crate::tensors::TensorFile;

const METRES_PER_CM: f64 = 0.01;

/// A face model. Lengths are in the unit of its file.
pub(crate) struct FaceModel {
    /// Millimetres per unit.
    pub mm: f32,
    /// Vertex of each landmark.
    pub landmarks: [u32; LANDMARKS],
    /// `[V, 3]`
    pub neutral: Array2<f32>,
    /// The name of each expression mode.
    pub names: Vec<String>,
    triangles: Vec<[u32; 3]>,
    /// `[M, V, 3]`
    expressions: Array3<f32>,
    /// `[P, V, 3]`, empty for MakeHuman.
    identities: Array3<f32>,
}

impl FaceModel {
    pub(crate) fn ict(data: &Path) -> Result<Self> {
        let file = TensorFile::read(&data.join("faces/ict_facekit.safetensors"))?;
        let mut face = Self::of_file(&file, ["expression_names", "expression"], 10.0)?;
        face.identities = face.modes(&file, "identity")?;
        Ok(face)
    }

    pub(crate) fn makehuman(data: &Path) -> Result<Self> {
        let file = TensorFile::read(&data.join("faces/makehuman_head.safetensors"))?;
        Self::of_file(&file, ["names", "deltas"], 100.0)
    }

    fn of_file(file: &TensorFile, [names, modes]: [&str; 2], mm: f32) -> Result<Self> {
        let numbers = |name: &str| -> Result<Vec<u32>> {
            let (values, _) = file.floats(name)?;
            Ok(values.iter().map(|x| *x as u32).collect())
        };
        let (neutral, shape) = file.floats("neutral")?;
        let neutral = Array2::from_shape_vec((shape[0], 3), neutral);
        let landmarks = numbers("landmarks68")?.try_into();
        let mut face = FaceModel {
            mm,
            landmarks: landmarks.map_err(|_| file.bad("expected 68 landmarks"))?,
            neutral: neutral.map_err(|_| file.bad("neutral: expected [V, 3]"))?,
            names: file.words(names)?,
            triangles: numbers("triangles")?.as_chunks::<3>().0.to_vec(),
            expressions: Array3::zeros((0, 0, 3)),
            identities: Array3::zeros((0, 0, 3)),
        };
        face.expressions = face.modes(file, modes)?;
        if face.expressions.len_of(Axis(0)) == face.names.len() {
            Ok(face)
        } else {
            Err(file.bad("expected one expression mode per name"))
        }
    }

    fn modes(&self, file: &TensorFile, name: &str) -> Result<Array3<f32>> {
        let (values, _) = file.floats(name)?;
        let vertices = self.neutral.nrows();
        Array3::from_shape_vec((values.len() / (3 * vertices), vertices, 3), values)
            .map_err(|_| file.bad(&format!("{name}: expected [M, V, 3]")))
    }

    /// The number of identity modes that can be mixed into a head.
    pub(crate) fn identities(&self) -> usize {
        self.identities.len_of(Axis(0))
    }

    /// The head of an identity. Without coefficients it is the mean head.
    pub(crate) fn mesh(&self, coefficients: &[f32]) -> Result<Mesh> {
        let mut neutral = self.neutral.clone();
        for (mode, c) in self.identities.outer_iter().zip(coefficients) {
            neutral.scaled_add(*c, &mode);
        }
        let positions = neutral.outer_iter().map(|p| [p[0], p[1], p[2]]);
        Mesh::from_arrays(positions.collect(), self.triangles.clone())
    }

    /// Options with the model's own landmarks, for a head of any identity.
    pub(crate) fn options(&self) -> FaceOptions {
        FaceOptions {
            landmarks: Some(LandmarkSource::Vertices(self.landmarks.to_vec())),
            ..FaceOptions::default()
        }
    }

    /// The modes of an ARKit channel. `mouthSmileLeft` is ICT's `mouthSmile_L`. A name without a
    /// side, such as `browInnerUp` or `cheekSquint`, gives the modes of both sides. Empty if the
    /// face cannot do it.
    fn modes_of(&self, channel: &str) -> Vec<ArrayView2<'_, f32>> {
        let number = |name: &str| self.names.iter().position(|known| known == name);
        let sided = channel.replace("Left", "_L").replace("Right", "_R");
        // `mouthLeft` and `jawLeft` are modes of their own.
        let numbers = match number(channel).or_else(|| number(&sided)) {
            Some(one) => vec![one],
            None => {
                let sides = ["_L", "_R", "Left", "Right"].into_iter();
                sides
                    .filter_map(|side| number(&format!("{channel}{side}")))
                    .collect()
            }
        };
        let modes = numbers.into_iter();
        modes
            .map(|number| self.expressions.index_axis(Axis(0), number))
            .collect()
    }

    /// Adds a channel to a frame `[V, 3]`.
    ///
    /// # Errors
    /// `InvalidInput` if the face has no such mode.
    pub(crate) fn add(
        &self,
        channel: &str,
        weight: f32,
        mut frame: ArrayViewMut2<'_, f32>,
    ) -> Result<()> {
        let modes = self.modes_of(channel);
        for mode in &modes {
            frame.scaled_add(weight, mode);
        }
        if modes.is_empty() {
            Err(Error::InvalidInput(format!(
                "the face has no expression mode {channel}"
            )))
        } else {
            Ok(())
        }
    }

    /// Displacements `[T, V, 3]` of the face under weights `[T, M]`. A channel that the face lacks
    /// moves nothing.
    pub(crate) fn moved(&self, channels: &[String], weights: &Array2<f32>) -> Array3<f32> {
        let mut out = Array3::zeros((weights.nrows(), self.neutral.nrows(), 3));
        for (channel, weights) in channels.iter().zip(weights.columns()) {
            let modes = self.modes_of(channel);
            let frames = weights.iter().zip(out.outer_iter_mut());
            for (weight, mut frame) in frames.filter(|(weight, _)| **weight != 0.0) {
                modes
                    .iter()
                    .for_each(|mode| frame.scaled_add(*weight, mode));
            }
        }
        out
    }
}

/// ICT's mean face at its 68 landmarks, `[68, 3]`, in metres and canonical axes.
pub(crate) struct IctLandmarks {
    pub neutral: Array2<f64>,
    face: FaceModel,
}

impl IctLandmarks {
    pub(crate) fn read(data: &Path) -> Result<Self> {
        let face = FaceModel::ict(data)?;
        let neutral = Self::metres(&face, face.neutral.view());
        Ok(IctLandmarks { neutral, face })
    }

    /// The mode of an ARKit channel at the landmarks, summed over both sides if the channel names
    /// none.
    pub(crate) fn mode(&self, channel: &str) -> Result<Array2<f64>> {
        let modes = self.face.modes_of(channel).into_iter();
        let modes = modes.map(|mode| Self::metres(&self.face, mode));
        let sum = modes.reduce(|left, right| left + right);
        sum.ok_or_else(|| Error::InvalidInput(format!("ICT has no expression mode {channel}")))
    }

    fn metres(face: &FaceModel, vertices: ArrayView2<'_, f32>) -> Array2<f64> {
        let rows = face.landmarks.map(|v| v as usize);
        let marks = vertices.select(Axis(0), &rows);
        marks.mapv(|x| f64::from(x) * METRES_PER_CM)
    }
}
