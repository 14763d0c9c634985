//! The whole way as one object: weights loaded once, shared by any number of jobs.

use std::path::PathBuf;

use ndarray::Array3;

use crate::{
    Error, Result,
    audio::Waveform,
    conditions::EmotionCurve,
    deform::{Deformer, VertexClip},
    mesh::{FaceOptions, Landmarks, Mesh, Similarity},
    motion::MotionClip,
    progress::ProgressFn,
};

/// Where per-mesh work is kept between runs.
#[derive(Debug, Clone, PartialEq)]
pub enum CachePolicy {
    /// Nothing is read or written.
    Off,
    /// The user's cache folder.
    UserFolder,
    /// This folder.
    Folder(PathBuf),
}

/// Which decoder spreads landmark motion over a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DecoderKind {
    /// Weights over the landmarks, computed once per mesh; fast and the most accurate.
    #[default]
    Static,
    /// The paper's per-frame decoder.
    Paper,
}

/// How an [`Engine`] is set up.
#[derive(Debug, Clone, PartialEq)]
pub struct EngineOptions {
    /// A folder of model files that override the embedded defaults.
    pub weights: Option<PathBuf>,
    /// Cache of per-mesh work.
    pub cache: CachePolicy,
    /// Number of worker threads; `None` takes one per core.
    pub threads: Option<usize>,
    /// A folder of Hugging Face `config.json` and `model.safetensors` (HuBERT or wav2vec2) that
    /// replaces the compact speech encoder; the denoiser's weights must have been trained with it.
    pub speech: Option<PathBuf>,
    /// Which decoder [`Engine::prepare`] builds.
    pub decoder: DecoderKind,
}

impl Default for EngineOptions {
    fn default() -> Self {
        EngineOptions {
            weights: None,
            cache: CachePolicy::UserFolder,
            threads: None,
            speech: None,
            decoder: DecoderKind::Static,
        }
    }
}

/// What a performance is asked to be.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionRequest {
    /// Emotion and intensity over time.
    pub emotion: EmotionCurve,
    /// Frames per second of the result, 1 to 240.
    pub fps: f64,
    /// Same seed, same motion.
    pub seed: u64,
    /// Denoising steps; `None` takes the model's own default.
    pub steps: Option<usize>,
    /// Speaking style by name; `None` takes the model's default.
    pub style: Option<String>,
}

impl Default for MotionRequest {
    fn default() -> Self {
        MotionRequest {
            emotion: EmotionCurve::default(),
            fps: 30.0,
            seed: 0,
            steps: None,
            style: None,
        }
    }
}

/// A mesh with its landmarks, its place in the canonical frame and its deformer.
pub struct PreparedFace {
    /// The 68 landmarks in the mesh's own units.
    pub landmarks: Landmarks,
    /// From the mesh's own frame to the canonical one.
    pub to_canonical: Similarity,
    /// Spreads landmark motion over this mesh.
    pub deformer: Box<dyn Deformer>,
}

/// A finished performance on one mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Animation {
    /// Displacement of every vertex, mesh units.
    pub vertices: VertexClip,
    /// `[68][3]`, mesh units.
    pub landmarks_neutral: [[f32; 3]; 68],
    /// `[T, 68, 3]`, mesh units.
    pub landmark_displacements: Array3<f32>,
}

/// Loaded weights and settings; `Send + Sync`, any number of jobs may run on one engine at once.
pub struct Engine {
    options: EngineOptions,
}

impl Engine {
    /// Loads the embedded weights, or those of `options.weights`.
    ///
    /// # Errors
    /// `Weights` if a file is missing, truncated or does not fit its config.
    pub fn new(options: EngineOptions) -> Result<Self> {
        Ok(Engine { options })
    }

    /// Speech to landmark motion in canonical metres.
    ///
    /// # Errors
    /// `Audio` for a sound too short to use, `InvalidInput` for a request out of range, `Cancelled`.
    pub fn motion(
        &self,
        waveform: &Waveform,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<MotionClip> {
        let _ = (waveform, request, progress, &self.options);
        Err(Error::Weights("no model is built in yet".into()))
    }

    /// Finds or takes the landmarks of a mesh and computes everything that does not depend on time.
    ///
    /// # Errors
    /// `FaceNotFound`, `Mesh`, `Cancelled`.
    pub fn prepare(
        &self,
        mesh: &Mesh,
        options: &FaceOptions,
        progress: ProgressFn<'_>,
    ) -> Result<PreparedFace> {
        let _ = (mesh, options, progress);
        Err(Error::Weights("no model is built in yet".into()))
    }

    /// Puts landmark motion on a prepared mesh.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn deform(
        &self,
        face: &PreparedFace,
        motion: &MotionClip,
        progress: ProgressFn<'_>,
    ) -> Result<Animation> {
        let landmark_displacements = face
            .to_canonical
            .displacements_to_mesh(motion.displacements.view());
        let displacements = face
            .deformer
            .deform(landmark_displacements.view(), progress)?;
        Ok(Animation {
            vertices: VertexClip {
                displacements,
                fps: motion.fps,
            },
            landmarks_neutral: face.landmarks.positions,
            landmark_displacements,
        })
    }

    /// The whole way: speech and a mesh to vertex displacements.
    ///
    /// # Errors
    /// Those of [`Engine::motion`], [`Engine::prepare`] and [`Engine::deform`].
    pub fn animate(
        &self,
        mesh: &Mesh,
        face: &FaceOptions,
        waveform: &Waveform,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<Animation> {
        let motion = self.motion(waveform, request, progress)?;
        let face = self.prepare(mesh, face, progress)?;
        self.deform(&face, &motion, progress)
    }
}
