//! The template whose vertices the branches move, and what is handed on of their motion.
//!
//! Twin of `training/systems/emoface/between.py`.

use std::sync::Arc;

use ndarray::{Array2, ArrayView1, ArrayViewMut1, ArrayViewMut2};

use super::EmoFaceConfig;
use crate::{Error, Result, deform::ReferencePoints, mesh::Mesh, motion::Template, nn::Weights};

/// A template, and how its motion is read.
pub struct ReadTemplate {
    template: Arc<Template>,
    /// `[K, 3 R]`: displacements of the first vertices to weights of the shapes between the landmarks.
    read: Array2<f32>,
}

impl ReadTemplate {
    /// From the arrays of a model.
    ///
    /// # Errors
    /// `Weights` if an array is missing, has another shape, or is no face.
    pub fn load(weights: &Weights, config: &EmoFaceConfig) -> Result<Self> {
        let EmoFaceConfig {
            vertices,
            triangles,
            between,
            between_read,
            ..
        } = *config;
        let wrong = |told: String| Error::Weights(format!("emoface: template: {told}"));
        let corner = |x: f32| match (0.0..vertices as f32).contains(&x) {
            true => Ok(x as u32),
            false => Err(wrong(format!("expected corners below {vertices}, got {x}"))),
        };
        let corners = weights.values("triangles", &[triangles, 3])?.into_iter();
        let corners = corners.map(corner).collect::<Result<Vec<u32>>>()?;
        let positions = weights.values("vertices", &[vertices, 3])?;
        let shapes = weights.pp("between");
        let (shapes, read) = match between {
            0 => (vec![0.0; 0], Array2::zeros((0, 0))),
            _ => (
                shapes.values("shapes", &[vertices, 3, between])?,
                shapes.matrix("read", between, 3 * between_read)?,
            ),
        };
        let template = Template {
            name: config.template.clone(),
            mesh: Mesh {
                positions: positions.as_chunks::<3>().0.to_vec(),
                triangles: corners.as_chunks::<3>().0.to_vec(),
            },
            landmarks: std::array::from_fn(|n| config.landmarks[n]),
            between: Array2::from_shape_vec((vertices, 3 * between), shapes)
                .expect("checked by the reader"),
        };
        let reference = ReferencePoints {
            points: Vec::new(),
            normals: Vec::new(),
            landmarks: template.landmark_positions(),
        };
        match reference.coinciding() {
            Some([one, other]) if between > 0 => Err(wrong(format!(
                "expected landmarks at 68 places, {one} is {other}"
            ))),
            _ => Ok(ReadTemplate {
                template: Arc::new(template),
                read,
            }),
        }
    }

    /// The template itself.
    pub fn template(&self) -> &Arc<Template> {
        &self.template
    }

    /// Of displacements `[3 V]`, metres, the landmarks, `[68, 3]`, and the skin between them, `[K]` metres.
    pub fn read(
        &self,
        moved: &[f32],
        mut landmarks: ArrayViewMut2<'_, f32>,
        mut between: ArrayViewMut1<'_, f32>,
    ) {
        for (mut row, &v) in landmarks.outer_iter_mut().zip(&self.template.landmarks) {
            (0..3).for_each(|axis| row[axis] = moved[3 * v + axis]);
        }
        let first = ArrayView1::from(&moved[..self.read.ncols()]);
        between.assign(&self.read.dot(&first));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::Golden;

    #[test]
    fn the_skin_of_the_golden_is_read_as_in_python() {
        let golden = Golden::open("emoface_debug");
        let config = EmoFaceConfig::from_json(&golden.metadata("config")).unwrap();
        let read = ReadTemplate::load(&golden.weights(), &config).unwrap();
        let expected = golden.matrix("between");
        assert_eq!(read.template().shapes(), expected.ncols());
        let motion = golden.matrix("motion");
        for (moved, expected) in motion.outer_iter().zip(expected.outer_iter()) {
            let mut landmarks = Array2::zeros((68, 3));
            let mut between = ndarray::Array1::zeros(expected.len());
            let moved = moved.to_vec();
            read.read(&moved, landmarks.view_mut(), between.view_mut());
            assert!((&between - &expected).iter().all(|x| x.abs() < 1e-6));
            let v = config.landmarks[30];
            assert_eq!(landmarks.row(30).to_vec(), moved[3 * v..3 * v + 3]);
        }
    }

    #[test]
    fn a_template_that_is_no_face_is_refused() {
        let golden = Golden::open("emoface_debug");
        let mut config = EmoFaceConfig::from_json(&golden.metadata("config")).unwrap();
        config.landmarks[3] = config.landmarks[40];
        let refused = ReadTemplate::load(&golden.weights(), &config)
            .err()
            .unwrap();
        assert!(
            refused.to_string().contains("68 places, 3 is 40"),
            "{refused}"
        );
        config.between = 5;
        let refused = ReadTemplate::load(&golden.weights(), &config)
            .err()
            .unwrap();
        assert!(refused.to_string().contains("between.shapes"), "{refused}");
    }
}
