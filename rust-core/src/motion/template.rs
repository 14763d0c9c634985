//! Motion of a template: its landmarks, and what its skin does between them.

use std::{ops::Range, sync::Arc};

use ndarray::{Array2, ArrayView2, Axis, Slice};

use super::LandmarkClip;
use crate::{
    Error, Result,
    ibug::{self, LANDMARKS},
    mesh::Mesh,
};

/// Between landmarks that are asked to move so much more the skin moves at most so much more.
const MOST: f32 = 2.0;
/// Sum of squares, m², under which landmarks count as still.
const STILL: f32 = 1e-10;

/// A face whose vertices a system moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Template {
    /// How it is called.
    pub name: String,
    /// Canonical metres.
    pub mesh: Mesh,
    /// Vertex of each landmark.
    pub landmarks: [usize; LANDMARKS],
    /// `[V, 3 K]`, axis by axis: what the skin does that no landmark tells of, as `K` shapes that are 1 where
    /// they move most. Systems whose template has none leave all to the landmarks.
    pub between: Array2<f32>,
}

impl Template {
    /// Number `K` of shapes.
    pub fn shapes(&self) -> usize {
        self.between.ncols() / 3
    }

    /// Where the landmarks are, canonical metres.
    pub fn landmark_positions(&self) -> [[f32; 3]; LANDMARKS] {
        self.landmarks.map(|v| self.mesh.positions[v])
    }
}

/// Motion of a template over time.
#[derive(Debug, Clone, PartialEq)]
pub struct TemplateClip {
    /// Whose motion it is.
    pub template: Arc<Template>,
    /// Its landmarks.
    pub landmarks: LandmarkClip,
    /// `[T, K]`, metres: how far each shape of the skin between the landmarks shows.
    pub between: Array2<f32>,
}

/// A share for each vertex of a template over time.
#[derive(Debug, Clone, PartialEq)]
pub struct TemplateMask {
    /// Whose vertices.
    pub template: Arc<Template>,
    /// `[T, V]`, 0 to 1.
    pub shares: Array2<f32>,
    /// Frames per second.
    pub fps: f64,
}

impl TemplateMask {
    /// `[V, t]`: the shares at some frames of motion at `fps`, those of the nearest frames.
    pub fn at(&self, frames: Range<usize>, fps: f64) -> Array2<f32> {
        let last = self.shares.nrows().saturating_sub(1);
        let nearest = |t: usize| ((t as f64 * self.fps / fps).round() as usize).min(last);
        let rows: Vec<usize> = frames.map(nearest).collect();
        self.shares.select(Axis(0), &rows).reversed_axes()
    }
}

impl TemplateClip {
    /// From its parts.
    ///
    /// # Errors
    /// `ShapeMismatch` where `between` has other frames or another number of shapes.
    pub fn new(
        template: Arc<Template>,
        landmarks: LandmarkClip,
        between: Array2<f32>,
    ) -> Result<TemplateClip> {
        let expected = (landmarks.displacements.dim().0, template.shapes());
        match between.dim() == expected {
            true => Ok(TemplateClip {
                template,
                landmarks,
                between,
            }),
            false => Err(Error::ShapeMismatch {
                what: "skin between the landmarks",
                expected: format!("[{}, {}]", expected.0, expected.1),
                got: format!("{:?}", between.shape()),
            }),
        }
    }

    /// The same motion with its landmarks as they were performed; the skin follows as far as they do.
    ///
    /// Lids do not count: blinks pull at no cheek.
    #[must_use]
    pub fn performed(&self, landmarks: LandmarkClip) -> TemplateClip {
        let mut between = self.between.clone();
        let frames = self.landmarks.displacements.outer_iter();
        let pairs = frames.zip(landmarks.displacements.outer_iter());
        for (mut row, (was, is)) in between.outer_iter_mut().zip(pairs) {
            let share = follows(was, is);
            row.mapv_inplace(|x| share * x);
        }
        TemplateClip {
            template: Arc::clone(&self.template),
            landmarks,
            between,
        }
    }

    /// Some frames of it.
    ///
    /// # Panics
    /// If it has fewer.
    #[must_use]
    pub fn rows(&self, frames: &[usize]) -> TemplateClip {
        TemplateClip {
            template: Arc::clone(&self.template),
            landmarks: LandmarkClip {
                displacements: self.landmarks.displacements.select(Axis(0), frames),
                fps: self.landmarks.fps,
            },
            between: self.between.select(Axis(0), frames),
        }
    }
}

/// By which factor landmarks `[68, 3]` moved on along their own way, 0 to [`MOST`].
fn follows(was: ArrayView2<'_, f32>, is: ArrayView2<'_, f32>) -> f32 {
    let lids = ibug::LIDS;
    let but_lids = [Slice::from(..lids.start), Slice::from(lids.end..)];
    let (mut along, mut own) = (0.0f32, 0.0f32);
    for part in but_lids {
        let (was, is) = (was.slice_axis(Axis(0), part), is.slice_axis(Axis(0), part));
        along += was.iter().zip(&is).map(|(a, b)| a * b).sum::<f32>();
        own += was.iter().map(|a| a * a).sum::<f32>();
    }
    match own > STILL {
        true => (along / own).clamp(0.0, MOST),
        false => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    fn clip(frames: usize) -> TemplateClip {
        let template = Template {
            name: "debug".into(),
            mesh: Mesh {
                positions: vec![[0.0; 3]; 68],
                triangles: Vec::new(),
            },
            landmarks: std::array::from_fn(|n| n),
            between: Array2::ones((68, 6)),
        };
        let at = |(t, n, i): (usize, usize, usize)| 1e-3 * ((t + n + i) as f32).sin();
        TemplateClip {
            template: Arc::new(template),
            landmarks: LandmarkClip {
                displacements: Array3::from_shape_fn((frames, LANDMARKS, 3), at),
                fps: 25.0,
            },
            between: Array2::from_shape_fn((frames, 2), |(t, k)| 1e-3 * (1 + t + k) as f32),
        }
    }

    #[test]
    fn skin_follows_as_far_as_the_landmarks_and_blinks_leave_it() {
        let clip = clip(4);
        let scaled = |by: f32| {
            let mut landmarks = clip.landmarks.clone();
            landmarks.displacements *= by;
            clip.performed(landmarks)
        };
        for (by, expected) in [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (5.0, 2.0), (-1.0, 0.0)] {
            let made = scaled(by).between;
            let largest = (&made - &(expected * &clip.between))
                .iter()
                .fold(0.0f32, |most, x| most.max(x.abs()));
            assert!(largest < 1e-8, "{by}: {largest}");
        }
        let mut blinking = clip.landmarks.clone();
        for n in 36..48 {
            blinking.displacements[[2, n, 1]] -= 0.01;
        }
        assert_eq!(clip.performed(blinking).between, scaled(1.0).between);
    }

    #[test]
    fn skin_moves_on_where_no_landmark_does() {
        let mut clip = clip(2);
        clip.landmarks.displacements.fill(0.0);
        assert_eq!(clip.performed(clip.landmarks.clone()), clip);
        assert_eq!(clip.rows(&[1]).between.row(0), clip.between.row(1));
    }
}
