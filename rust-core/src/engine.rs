//! The whole way as one object: weights loaded once, shared by any number of jobs.

mod causal;
mod found;
mod kept;
mod performance;
mod sliders;

use std::{path::PathBuf, sync::Arc};

use ndarray::Array3;

use crate::{
    Error, Result,
    audio::{Prosody, Waveform},
    conditions::EmotionCurve,
    deform::{Deformer, PartList, VertexClip},
    mesh::{self, FaceOptions, LandmarkFinder, Landmarks, Mesh, Similarity},
    motion::{FaceModes, MotionClip, PerformanceControls},
    operators::{Cache, CacheKey},
    progress::{self, ProgressFn},
    speech::{self, CompactEncoder, SpeechEncoder},
    systems::freetalk::{
        ats::Ats,
        stm::{self, StaticWeights, paper::PaperDecoder},
        stream::StreamModel,
    },
    weights::ModelFiles,
};
pub use causal::StreamOptions;
pub use found::FoundFace;
pub use performance::Performance;
pub use sliders::{Slider, SliderChange};

const ATS_MODEL: &str = "ats_compact";
const STM_MODEL: &str = "stm_static";
const STM_PAPER_MODEL: &str = "stm_paper";
const SPEECH_MODEL: &str = "compact_speech";
const STREAM_MODEL: &str = "stream";
const MIN_FPS: f64 = 1.0;
const MAX_FPS: f64 = 240.0;
const MAX_THREADS: usize = 256;

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
    /// What is done to the sampled motion.
    pub controls: PerformanceControls,
}

impl Default for MotionRequest {
    fn default() -> Self {
        MotionRequest {
            emotion: EmotionCurve::default(),
            fps: 30.0,
            seed: 0,
            steps: None,
            style: None,
            controls: PerformanceControls::default(),
        }
    }
}

/// A mesh with its landmarks, its place in the canonical frame and its deformer.
pub struct PreparedFace {
    /// The 68 landmarks in the mesh's own units.
    pub landmarks: Landmarks,
    /// From the mesh's own frame to the canonical one.
    pub to_canonical: Similarity,
    /// The mesh's parts and what each of them is.
    pub parts: PartList,
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
    speech: Box<dyn SpeechEncoder>,
    ats: Ats,
    stream: Arc<StreamModel>,
    stm: StaticWeights,
    finder: LandmarkFinder,
    modes: FaceModes,
    /// Loaded where the options ask for it.
    paper: Option<Arc<PaperDecoder>>,
    cache: Cache,
    /// Names the models in what is kept of a mesh.
    models: CacheKey,
    pool: Option<rayon::ThreadPool>,
}

impl Engine {
    /// Loads the embedded weights, or those of `options.weights`.
    ///
    /// # Errors
    /// `Weights` if a file is missing, truncated or does not fit its config.
    pub fn new(options: EngineOptions) -> Result<Self> {
        let folder = options.weights.as_deref();
        let files = ModelFiles::open(ATS_MODEL, folder)?;
        let ats = Ats::load(&files.weights, &files.config)?;
        let speech: Box<dyn SpeechEncoder> = match &options.speech {
            Some(folder) => speech::from_folder(folder, None)?,
            None => {
                let files = ModelFiles::open(SPEECH_MODEL, folder)?;
                Box::new(CompactEncoder::load(&files.weights, &files.config)?)
            }
        };
        let files = ModelFiles::open(STM_MODEL, folder)?;
        let stm = StaticWeights::load(&files.weights, &files.config)?;
        let files = ModelFiles::open(STREAM_MODEL, folder)?;
        let stream = Arc::new(StreamModel::load(&files.weights, &files.config)?);
        let finder = LandmarkFinder::load(folder)?;
        let modes = FaceModes::open(folder)?;
        let paper = match options.decoder {
            DecoderKind::Static => None,
            DecoderKind::Paper => {
                let files = ModelFiles::open(STM_PAPER_MODEL, folder)?;
                Some(Arc::new(PaperDecoder::load(&files.weights, &files.config)?))
            }
        };
        let wanted = ats.config().speech.channels;
        if speech.channels() != wanted {
            return Err(Error::Weights(format!(
                "{ATS_MODEL}: expected speech features of {wanted} channels, the encoder gives {}",
                speech.channels()
            )));
        }
        let pool = options.threads.map(thread_pool).transpose()?;
        let cache = Cache::new(&options.cache);
        let models = kept::key_of_models(folder)?;
        Ok(Engine {
            speech,
            ats,
            stream,
            stm,
            finder,
            modes,
            paper,
            cache,
            models,
            pool,
        })
    }

    /// Speech to landmark motion in canonical metres: [`Engine::sample`], then [`Engine::perform`].
    ///
    /// # Errors
    /// `Audio` for a sound too short to use, `InvalidInput` for a request out of range, `Cancelled`.
    pub fn motion(
        &self,
        waveform: &Waveform,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<MotionClip> {
        Ok(self.performance(waveform, request, progress)?.motion)
    }

    /// Puts the controls of `request` on a clip of [`Engine::sample`], without sampling again.
    ///
    /// `waveform` and the request's emotion are those that were sampled; its seed draws blinks and
    /// accents, its other fields have no effect here.
    ///
    /// # Errors
    /// `InvalidInput` for a control out of range.
    pub fn perform(
        &self,
        sampled: &MotionClip,
        waveform: &Waveform,
        request: &MotionRequest,
    ) -> Result<MotionClip> {
        self.perform_heard(sampled, &Prosody::of(waveform), request, &request.emotion)
    }

    /// Speech to landmark motion as the model makes it, in canonical metres.
    ///
    /// The clip has one frame for every started `1 / fps` seconds of sound, at least one.
    ///
    /// # Errors
    /// Those of [`Engine::motion`].
    pub fn sample(
        &self,
        waveform: &Waveform,
        request: &MotionRequest,
        progress: ProgressFn<'_>,
    ) -> Result<MotionClip> {
        check_fps(request.fps)?;
        let heard = request.emotion.heard(&Prosody::of(waveform)).into_owned();
        let request = MotionRequest {
            emotion: heard,
            ..request.clone()
        };
        self.threads(|| {
            let features = self.hear(waveform, progress)?;
            let frames = frames_of(waveform, request.fps);
            self.sample_heard(features.view(), frames, &request, progress)
        })
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
        self.threads(|| {
            progress::report(progress, "landmarks", 0.0)?;
            let key = kept::key_of(mesh, &self.models);
            let (landmarks, parts) = self.kept_landmarks(&key, mesh, options, progress)?;
            let to_canonical = mesh::align_to_canonical(&landmarks)?;
            progress::report(progress, "landmarks", 1.0)?;
            let deformer: Box<dyn Deformer> = match &self.paper {
                None => {
                    let place = (&landmarks, &to_canonical, &parts);
                    Box::new(self.kept_weights(&key, mesh, place, options, progress)?)
                }
                Some(paper) => Box::new(stm::prepare_paper(
                    Arc::clone(paper),
                    mesh,
                    &landmarks,
                    &to_canonical,
                    &parts,
                    &self.cache,
                    progress,
                )?),
            };
            Ok(PreparedFace {
                landmarks,
                to_canonical,
                parts,
                deformer,
            })
        })
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

    /// Runs `work` on the engine's own threads, if it has any.
    fn threads<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }
}

fn thread_pool(threads: usize) -> Result<rayon::ThreadPool> {
    let wrong = |why: String| Error::InvalidInput(format!("threads: {why}"));
    if !(1..=MAX_THREADS).contains(&threads) {
        return Err(wrong(format!("expected 1 to {MAX_THREADS}, got {threads}")));
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| wrong(error.to_string()))
}

fn check_fps(fps: f64) -> Result<()> {
    match (MIN_FPS..=MAX_FPS).contains(&fps) {
        true => Ok(()),
        false => Err(Error::InvalidInput(format!(
            "fps: expected {MIN_FPS} to {MAX_FPS}, got {fps}"
        ))),
    }
}

/// One frame for every started `1 / fps` seconds, at least one.
fn frames_of(waveform: &Waveform, fps: f64) -> usize {
    // A millionth of a frame is rounding, not sound.
    (waveform.duration_s() * fps - 1e-6).ceil().max(1.0) as usize
}
