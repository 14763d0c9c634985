//! Motion over time as a system produces it, before any mesh is known.
//!
//! [`Motion`] has a case for each kind of motion that a system may produce. This folder has the
//! tools for landmarks: resampling, smoothing, and an artist's controls over a sampled clip.

mod apply_controls;
mod articulation;
mod blinks;
pub mod bounds;
mod breath;
mod brow_accents;
mod chance;
mod contacts;
mod controls;
mod effort;
mod expression;
mod face_modes;
mod frame_stream;
mod gaze;
mod gestures;
mod head;
mod idle;
mod join;
mod life;
mod live_closures;
mod liveliness;
mod mood;
pub mod performer;
mod phrases;
mod redo;
mod request;
mod resample;
mod shape_fit;
#[cfg(feature = "emoface")]
mod silence;
mod slow_noise;
mod smooth;
mod template;
mod upper_face;
mod variety;
mod visibility;
mod weight_stream;
mod weights;

use std::{fmt, sync::Arc};

use ndarray::{Array2, Array3, ArrayD, ArrayViewD};

use crate::{Result, deform::CodeSpace};

pub use apply_controls::{Cues, LandmarkController};
pub use blinks::{Blink, blinks};
pub use brow_accents::{BrowAccent, brow_accents};
pub use contacts::WidthGain;
pub(crate) use contacts::{Parting, narrow, opening, width as mouth_width};
#[cfg(feature = "cafe-talk")]
pub(crate) use controls::control_named;
pub(crate) use controls::{ARTICULATION, BESIDE_THE_FACE, BREATH, GAZE, HEAD, ONSET, TONGUE};
pub use controls::{PERFORMANCE_CONTROLS, PerformanceControls};
pub use effort::effort_gain;
#[cfg(feature = "emoface")]
pub(crate) use expression::Follower;
pub use expression::{CausalExpression, EmotionOrigin, Expressions, MODEL as EXPRESSIONS_MODEL};
pub use face_modes::{FaceModes, MODEL as FACE_MODES_MODEL};
pub(crate) use frame_stream::too_short;
pub use frame_stream::{LandmarkFrame, MotionStream, stream_whole};
pub use idle::{Idle, IdleMotion};
pub use join::Pose;
pub(crate) use join::{begin_in, begin_tongue_in};
pub use life::{Life, LifeStrengths};
pub use live_closures::{CLOSURES_MODEL, LiveClosures};
pub use performer::Performer;
pub use redo::Stretch;
pub use request::{FPS, MotionRequest, check_closures, check_fps, style_number};
pub(crate) use resample::at_rate;
#[cfg(feature = "cafe-talk")]
pub(crate) use smooth::smoothed;
pub use template::{Template, TemplateMask};
pub use visibility::{Extent, SPOKEN_MM, VISIBLE_MM, Visibility, lip_travel};
pub(crate) use weight_stream::Ears;
pub use weight_stream::{WeightFrame, WeightStream};
pub use weights::{LipGaps, LowerLip, MouthLengths, WeightCues};

/// The output of a system: motion of one of the kinds that [`crate::spread`] can put on a mesh.
///
/// ```
/// use anyface::motion::{LandmarkClip, Motion, MotionKind};
///
/// let still = LandmarkClip { displacements: ndarray::Array3::zeros((25, 68, 3)), fps: 25.0 };
/// let motion = Motion::Landmarks(still);
/// assert_eq!((motion.frames(), motion.fps(), motion.kind()), (25, 25.0, MotionKind::Landmarks));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// Displacements of the 68 landmarks.
    Landmarks(LandmarkClip),
    /// Weights of named shapes, such as ARKit's.
    Weights(WeightClip),
    /// Codes of a parametric head, or of a model that moves a template.
    Codes(CodeClip),
}

/// The kind of a motion: the things that it moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionKind {
    /// The 68 landmarks. A deformer spreads their motion over a mesh.
    Landmarks,
    /// Shapes of the mesh.
    Weights,
    /// The vertices, by a field of codes, and the landmarks as well.
    Codes,
}

impl fmt::Display for MotionKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            MotionKind::Landmarks => "landmarks",
            MotionKind::Weights => "weights",
            MotionKind::Codes => "codes",
        })
    }
}

/// Landmark displacements from the neutral face.
#[derive(Debug, Clone, PartialEq)]
pub struct LandmarkClip {
    /// `[T, 68, 3]`, canonical metres: +x to the subject's left, +y up, +z out of the face.
    pub displacements: Array3<f32>,
    /// Frames per second.
    pub fps: f64,
}

/// Weights of named shapes over time.
#[derive(Debug, Clone, PartialEq)]
pub struct WeightClip {
    /// `[S]`, such as `jawOpen`.
    pub names: Vec<String>,
    /// `[T, S]`; 0 is rest, 1 the whole shape.
    pub weights: Array2<f32>,
    /// Frames per second.
    pub fps: f64,
    /// `[T]`, how far the lips have to come together on any head that shows the clip, 0 to 1. Empty
    /// if this is unknown.
    pub together: Vec<f32>,
}

/// Codes of a parametric head, or of a model that moves a template, and landmarks. The landmarks
/// also hold what the codes cannot express: emotions, blinks, closed lips. The codes move a mesh,
/// and the landmarks add what they do beyond the codes. If the mesh is too unlike the head, only
/// the landmarks move it.
#[derive(Debug, Clone)]
pub struct CodeClip {
    /// How the codes move the vertices of a face.
    pub space: Arc<dyn CodeSpace>,
    /// `[T, C]`, unitless.
    pub codes: Array2<f32>,
    /// The landmarks of the mean head or template, with the same number of frames.
    pub landmarks: LandmarkClip,
}

impl PartialEq for CodeClip {
    fn eq(&self, other: &CodeClip) -> bool {
        (self.space.name(), &self.codes, &self.landmarks)
            == (other.space.name(), &other.codes, &other.landmarks)
    }
}

impl Motion {
    /// The kind of this motion.
    pub fn kind(&self) -> MotionKind {
        match self {
            Motion::Landmarks(_) => MotionKind::Landmarks,
            Motion::Weights(_) => MotionKind::Weights,
            Motion::Codes(_) => MotionKind::Codes,
        }
    }

    /// Frames per second.
    pub fn fps(&self) -> f64 {
        match self {
            Motion::Landmarks(clip) => clip.fps,
            Motion::Weights(clip) => clip.fps,
            Motion::Codes(clip) => clip.landmarks.fps,
        }
    }

    /// Number of frames `T`.
    pub fn frames(&self) -> usize {
        self.values().shape()[0]
    }

    /// The landmarks, if the motion has them.
    pub fn landmarks(&self) -> Option<&LandmarkClip> {
        match self {
            Motion::Landmarks(clip) => Some(clip),
            Motion::Codes(clip) => Some(&clip.landmarks),
            Motion::Weights(_) => None,
        }
    }

    /// This motion on the landmarks of the mean face, which needs no mesh.
    ///
    /// # Errors
    /// Those of [`WeightClip::landmarks`].
    pub fn on_mean_face(&self, modes: &FaceModes) -> Result<LandmarkClip> {
        match self {
            Motion::Landmarks(clip) => Ok(clip.clone()),
            Motion::Weights(clip) => clip.landmarks(modes),
            Motion::Codes(clip) => Ok(clip.landmarks.clone()),
        }
    }

    /// The landmarks, mutable, if the motion has them.
    pub(crate) fn landmarks_mut(&mut self) -> Option<&mut LandmarkClip> {
        match self {
            Motion::Landmarks(clip) => Some(clip),
            Motion::Codes(clip) => Some(&mut clip.landmarks),
            Motion::Weights(_) => None,
        }
    }

    /// The values of the motion, the frames as the first axis. For codes these are the landmarks.
    pub fn values(&self) -> ArrayViewD<'_, f32> {
        match self {
            Motion::Landmarks(clip) => clip.displacements.view().into_dyn(),
            Motion::Weights(clip) => clip.weights.view().into_dyn(),
            Motion::Codes(clip) => clip.landmarks.displacements.view().into_dyn(),
        }
    }

    /// The same kind of motion with other values. They may have any number of frames, but for codes
    /// the number has to stay the same.
    ///
    /// # Panics
    /// If a frame of `values` has another shape than one of this motion.
    #[must_use]
    pub fn with_values(&self, values: ArrayD<f32>) -> Motion {
        const FITS: &str = "a frame has the shape of the motion's own";
        assert_eq!(values.shape()[1..], self.values().shape()[1..], "{FITS}");
        let mut out = self.clone();
        match &mut out {
            Motion::Landmarks(clip) => {
                clip.displacements = values.into_dimensionality().expect(FITS)
            }
            Motion::Weights(clip) => clip.weights = values.into_dimensionality().expect(FITS),
            Motion::Codes(clip) => {
                clip.landmarks.displacements = values.into_dimensionality().expect(FITS)
            }
        }
        out
    }
}
