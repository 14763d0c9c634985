//! The whole way as one object: weights loaded once, shared by any number of jobs.

mod causal;
mod events;
mod listen;
mod perform;
mod sliders;

use std::{
    ops::Range,
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
};

use ndarray::{Array2, Array3, ArrayView3};

use crate::{
    Error, Result,
    audio::Waveform,
    cache::{Cache, CacheKey, CachePolicy},
    conditions::{ControlStage, MotionRequest},
    deform::{
        self, Creases, Deformer, LEARNED, StaticWeights, VertexClip,
        compression::{self, VertexBasis},
    },
    face::Face,
    finite::check_result,
    head::{self, COEFFICIENTS, Head, HeadOnMesh, HeadSurface, Reach, check_surface_cells},
    memory::MemoryNeed,
    mesh::{self, FaceOptions, LandmarkFinder, Mesh, Similarity},
    models,
    motion::{CodeClip, FaceModes, LandmarkClip, Motion, WeightClip},
    outside::guarded,
    progress::ProgressFn,
    rig::{self, FieldOfFace, Rig, RigModel, SolveOptions, SolvedWeights},
    speech::{self, EmotionModel, FeelingEncoder, PhoneModel, SpeechEncoder},
    spread::{self, FrameSink, Spread, SpreadReport, WeightedShapes},
    systems::{Registration, System, Windows, built_in_models},
};
pub use perform::Performance;
pub use sliders::SliderChange;

const MAX_THREADS: usize = 256;

/// How an [`Engine`] is set up.
#[derive(Debug, Clone, PartialEq)]
pub struct EngineOptions {
    /// Name of the system, one of [`crate::systems::SYSTEMS`]; `None` takes the default.
    pub system: Option<String>,
    /// A folder of models that override the built-in ones.
    pub models: Option<PathBuf>,
    /// Cache of per-mesh work.
    pub cache: CachePolicy,
    /// Number of worker threads; `None` takes one per core.
    pub threads: Option<usize>,
    /// A folder of a HuBERT or wav2vec2 checkpoint as Hugging Face has it, which replaces the compact
    /// speech encoder; the system's weights must have been trained with it. A folder `hubert` or
    /// `wav2vec2` among the models is found where their config names it.
    pub speech: Option<PathBuf>,
    /// A folder of a classifier of emotions in voices as Hugging Face has it, which hears them instead of the built-in
    /// encoder where the emotion is that of the voice; see [`speech::EmotionModel`].
    pub emotion_model: Option<PathBuf>,
}

impl Default for EngineOptions {
    fn default() -> Self {
        EngineOptions {
            system: None,
            models: None,
            cache: CachePolicy::UserFolder,
            threads: None,
            speech: None,
            emotion_model: None,
        }
    }
}

/// Loaded weights and settings; `Send + Sync`, any number of jobs may run on one engine at once.
///
/// Sound becomes motion ([`Engine::perform`]), a mesh becomes a face ([`Engine::prepare`]), and motion
/// is spread over the face into a sink ([`Engine::spread`]); [`Engine::animate`] is all of it.
///
/// ```
/// use anyface::{CachePolicy, Engine, EngineOptions, MotionRequest, audio::Waveform};
/// use anyface::{mesh::{FaceOptions, LandmarkSource, Mesh}, progress::SILENT, spread::Collector};
///
/// let head = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
/// let mesh = Mesh::read(head.join("head.obj"))?;
/// let landmarks = Some(LandmarkSource::read(&head.join("landmarks.json"))?);
/// let engine = Engine::new(EngineOptions { cache: CachePolicy::Off, ..Default::default() })?;
/// let face = engine.prepare(&mesh, &FaceOptions { landmarks, ..Default::default() }, SILENT)?;
/// let sound = Waveform { samples: (0..8000).map(|i| (i as f32 * 0.08).sin()).collect() };
/// let asked = MotionRequest::default();
/// let clip = Collector::collect(|sink| engine.animate(&face, &sound, &asked, sink, SILENT))?;
/// assert_eq!(clip.vertices.displacements.dim(), (15, mesh.positions.len(), 3));
/// # Ok::<(), anyface::Error>(())
/// ```
pub struct Engine {
    registration: &'static Registration,
    system: Box<dyn System>,
    encoder: Arc<dyn SpeechEncoder>,
    static_weights: StaticWeights,
    creases: Creases,
    finder: LandmarkFinder,
    /// How lids go with eyes that look up and down.
    face_modes: FaceModes,
    /// What of a feeling is heard in a voice.
    feeling: FeelingEncoder,
    /// Another's model that hears emotions instead.
    emotion_model: Option<EmotionModel>,
    /// Loaded where shapes are asked for.
    rig_model: OnceLock<RigModel>,
    /// Loaded where phones or words are asked for.
    phone_model: OnceLock<PhoneModel>,
    model_folder: Option<PathBuf>,
    cache: Cache,
    /// Names the models in what is kept of a mesh.
    key_of_models: CacheKey,
    pool: Option<rayon::ThreadPool>,
    /// The process that made the engine: threads do not live on in a copy of it.
    process: u32,
}

/// The process that made the first engine, and with it the threads that all share.
static FIRST_PROCESS: OnceLock<u32> = OnceLock::new();

impl EngineOptions {
    /// What can be checked of them before anything is loaded.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown system or a number of threads out of range.
    pub fn check(&self) -> Result<()> {
        Registration::find(self.system.as_deref())?;
        match self.threads {
            Some(threads) if !(1..=MAX_THREADS).contains(&threads) => Err(Error::InvalidInput(
                format!("threads: expected 1 to {MAX_THREADS}, got {threads}"),
            )),
            _ => Ok(()),
        }
    }
}

impl Engine {
    /// Loads the built-in models, or those of `options.models`.
    ///
    /// # Errors
    /// `Weights` if a file is missing, truncated or does not fit its config; `InvalidInput` for an
    /// unknown system or a number of threads out of range.
    pub fn new(options: EngineOptions) -> Result<Self> {
        options.check()?;
        let given = [&options.models, &options.speech, &options.emotion_model];
        match given.iter().any(|folder| folder.is_some()) {
            // Files of others: what their sizes lead to is not known before.
            true => guarded(Error::Weights, || Self::load(options)),
            false => Self::load(options),
        }
    }

    fn load(options: EngineOptions) -> Result<Self> {
        let folder = options.models.as_deref();
        if let Some(folder) = folder {
            models::check_folder(folder, built_in_models(), &speech::CHECKPOINTS)?;
        }
        let registration = Registration::find(options.system.as_deref())?;
        let system = (registration.open)(folder)?;
        let checkpoint = options.speech.as_deref();
        let encoder = Arc::from(speech::open(system.speech(), checkpoint, folder)?);
        Ok(Engine {
            registration,
            system,
            encoder,
            static_weights: StaticWeights::open(folder)?,
            creases: Creases::open(folder)?,
            finder: LandmarkFinder::load(folder)?,
            face_modes: FaceModes::open(folder)?,
            feeling: FeelingEncoder::open(folder)?,
            emotion_model: match &options.emotion_model {
                Some(folder) => Some(EmotionModel::load_folder(folder)?),
                None => None,
            },
            rig_model: OnceLock::new(),
            phone_model: OnceLock::new(),
            cache: Cache::new(&options.cache),
            key_of_models: key_of_models(folder)?,
            pool: threads_of_own(options.threads)?,
            process: std::process::id(),
            model_folder: options.models,
        })
    }

    /// What the registry says of the system that performs here.
    pub fn system(&self) -> &'static Registration {
        self.registration
    }

    /// Names of the speaking styles that the loaded models know.
    pub fn styles(&self) -> &[String] {
        self.system.styles()
    }

    /// In which pieces a long sound is performed; `None` where any length is performed at once.
    pub fn windows(&self) -> Option<Windows> {
        self.system.windows()
    }

    /// What motion on a mesh of so many `vertices` takes of memory, of which so many `frames` are kept at once.
    pub fn memory_need(&self, vertices: usize, frames: usize) -> MemoryNeed {
        MemoryNeed {
            vertices,
            shapes: match self.system.moves_by_shapes() {
                true => rig::SHAPES,
                false => 0,
            },
            frames: frames.saturating_mul(self.system.copies_of_frames()),
        }
    }

    /// Finds or takes the landmarks of a mesh, without what moving it needs.
    ///
    /// # Errors
    /// `FaceNotFound`, `Mesh`, `InvalidInput` for landmarks that cannot be, `Cancelled`; `OutOfMemory` for a mesh whose
    /// work does not fit into what the system has left, before it is done.
    pub fn find(
        &self,
        mesh: &Mesh,
        options: &FaceOptions,
        progress: ProgressFn<'_>,
    ) -> Result<Face> {
        let known = self.registration.controls();
        options.controls.check(known, ControlStage::Face)?;
        self.memory_need(mesh.positions.len(), 0).check()?;
        let mut options = options.clone();
        if self.system.works_on_every_vertex(&options.controls) {
            options.proxy = None;
        }
        self.threads(|| {
            let (cache, models) = (&self.cache, &self.key_of_models);
            Face::find(mesh, &options, &self.finder, cache, models, progress)
        })
    }

    /// [`Engine::find`], and everything that spreading landmark motion needs and that does not depend
    /// on time.
    ///
    /// # Errors
    /// Those of [`Engine::find`].
    pub fn prepare(
        &self,
        mesh: &Mesh,
        options: &FaceOptions,
        progress: ProgressFn<'_>,
    ) -> Result<Face> {
        let face = self.find(mesh, options, progress)?;
        self.threads(|| self.deformer(&face, progress).map(drop))?;
        Ok(face)
    }

    /// What spreads landmark motion over a face, mesh units and axes; made once for each face.
    fn deformer<'a>(
        &self,
        face: &'a Face,
        progress: ProgressFn<'_>,
    ) -> Result<&'a Arc<dyn Deformer>> {
        face.deformer(|| {
            if let Some(own) = self.system.deformer(face, &self.cache, progress)? {
                return Ok(own);
            }
            let learned = LEARNED.value(&face.options.controls);
            self.static_deformer(face, learned, progress)
        })
    }

    fn static_deformer(
        &self,
        face: &Face,
        learned: f32,
        progress: ProgressFn<'_>,
    ) -> Result<Arc<dyn Deformer>> {
        let models = (&self.static_weights, &self.creases);
        let made = deform::static_deformer(models, face, learned, &self.cache, progress)?;
        Ok(Arc::new(made))
    }

    /// The ARKit shapes and visemes of a face; made once for each face.
    ///
    /// # Errors
    /// `Weights` or `Io` if the engine's folder of models holds a rig that cannot be used, `Mesh`,
    /// `Cancelled`.
    pub fn rig(&self, face: &Face, progress: ProgressFn<'_>) -> Result<Arc<Rig>> {
        let make = || {
            let model = self.rig_model()?;
            let plain = self.static_deformer(face, 0.0, progress)?;
            let learned = self.static_deformer(face, 1.0, progress)?;
            let (_, landmarks) = face.surface()?.decimetres();
            let learned = rig::Learned {
                deformer: learned.as_ref(),
                share: self.static_weights.known(&landmarks),
            };
            let rig = model.make(face, plain.as_ref(), &learned, progress)?;
            check_result("rig", rig.deltas.view().into_dyn())?;
            Ok(Arc::new(rig))
        };
        self.threads(|| face.rig(make).map(Arc::clone))
    }

    fn rig_model(&self) -> Result<&RigModel> {
        match self.rig_model.get() {
            Some(model) => Ok(model),
            None => {
                let model = RigModel::open(self.model_folder.as_deref())?;
                Ok(self.rig_model.get_or_init(|| model))
            }
        }
    }

    /// The shapes of [`Engine::rig`] with the skin moved by the field of the parametric head that is like the face; see
    /// [`RigModel::by_field`].
    ///
    /// # Errors
    /// `InvalidInput` where no head of the model is like the face; those of [`Engine::rig`].
    pub fn rig_by_field(
        &self,
        face: &Face,
        in_betweens: bool,
        progress: ProgressFn<'_>,
    ) -> Result<Rig> {
        let linear = self.rig(face, progress)?;
        let head = match self.system.head() {
            Some(head) => Arc::clone(head),
            None => Arc::new(Head::open(self.model_folder.as_deref())?),
        };
        self.threads(|| {
            let reach = Reach::default();
            let field = HeadOnMesh::new(Arc::clone(&head), face, reach, &self.cache, progress)?;
            let field = field.map_err(|complaint| {
                let expected = "rig: expected a face that a head of the model is like, by whose field it moves";
                Error::InvalidInput(format!("{expected}: {complaint}"))
            })?;
            let deformer = self.static_deformer(face, 1.0, progress)?;
            let by = FieldOfFace {
                head: &head,
                field: &field,
                deformer: deformer.as_ref(),
            };
            let rig = self
                .rig_model()?
                .by_field(face, &linear, &by, in_betweens, progress)?;
            check_result("rig", rig.deltas.view().into_dyn())?;
            Ok(rig)
        })
    }

    /// Puts motion of any kind on a face and hands the frames to `sink`, block by block.
    ///
    /// What the face lacks for this kind of motion is made first and stays with it.
    ///
    /// # Errors
    /// `InvalidInput` for a kind of motion that nothing puts on a mesh yet; those of the sink;
    /// `Cancelled`.
    pub fn spread(
        &self,
        face: &Face,
        motion: &Motion,
        sink: &mut dyn FrameSink,
        progress: ProgressFn<'_>,
    ) -> Result<SpreadReport> {
        match motion {
            Motion::Landmarks(clip) => {
                if let Some(codes) = self.threads(|| self.system.codes_of(clip, progress))? {
                    return self.spread(face, &Motion::Codes(codes), sink, progress);
                }
                let own = face.own_motion(clip.displacements.view());
                self.spread_own(face, own, clip.fps, sink, progress)
            }
            Motion::Weights(clip) => {
                let rig = self.rig(face, progress)?;
                self.threads(|| {
                    let shapes = WeightedShapes {
                        rig: &rig,
                        clip: &spread::closed_on(face, &rig, clip),
                        deformer: self.deformer(face, progress)?.as_ref(),
                        landmarks: self.asked_of(face, clip)?,
                    };
                    spread::into_sink(&Spread::of_weights(face, shapes), sink, progress)
                })
            }
            Motion::Codes(_) => self.threads(|| {
                let spread = self.spread_of(face, motion, progress)?;
                let mut made = spread::into_sink(&spread, sink, progress)?;
                made.notes.extend(self.field_note(face));
                Ok(made)
            }),
            Motion::Template(_) => Err(spread::not_yet(motion)),
        }
    }

    /// Why vertices of a face did not follow the field of the system's own head when motion was put on it.
    pub fn field_note(&self, face: &Face) -> Option<String> {
        let complaint = face.known_field()?.as_ref().err()?;
        Some(unlike("landmarks alone move the mesh", complaint))
    }

    /// The parametric head whose codes the system's motion has.
    ///
    /// # Errors
    /// `InvalidInput` for a system whose motion has none.
    pub fn head(&self) -> Result<&Arc<Head>> {
        self.system.head().ok_or_else(|| {
            let expected = "surface: expected a system whose motion moves a head of its own";
            let name = self.registration.name;
            Error::InvalidInput(format!("{expected} (facetalk), got {name}"))
        })
    }

    /// Codes under which the head of the system moves as landmarks of the mean face do, metres, whatever made these.
    ///
    /// # Errors
    /// `InvalidInput` for a system without a head, or a model of it that landmarks cannot lead; `Cancelled`.
    pub fn codes_of(&self, clip: &LandmarkClip, progress: ProgressFn<'_>) -> Result<CodeClip> {
        self.head()?;
        let made = self.threads(|| self.system.codes_of(clip, progress))?;
        made.ok_or_else(|| {
            Error::InvalidInput(
                "surface: expected a model with landmark_motion, which goes by landmarks, got one without".into(),
            )
        })
    }

    /// The surface of the head that is like a face, where the face is, for poses by the codes of the system's motion;
    /// where none is like it that of the mean head, and why. `cells`: along the longest side of the grid.
    ///
    /// # Errors
    /// `InvalidInput` for a system without a head, those of [`HeadSurface::new`]; `Mesh` if the landmarks lie on no
    /// usable face.
    pub fn head_surface(
        &self,
        face: &Face,
        cells: usize,
        progress: ProgressFn<'_>,
    ) -> Result<(HeadSurface, Option<String>)> {
        check_surface_cells(cells)?;
        let head = self.head()?;
        self.threads(|| {
            let made = |coefficients: &[f32], to_head: &Similarity| {
                let to_mesh = to_head.inverse();
                HeadSurface::new(Arc::clone(head), coefficients, to_mesh, cells, progress)
            };
            Ok(match head::fit_face(head, face, &self.cache, progress)? {
                Ok(fit) => (made(&fit.coefficients, &fit.to_head)?, None),
                Err(complaint) => {
                    let mean = made(&[0.0; COEFFICIENTS], &face.to_canonical)?;
                    (
                        mean,
                        Some(unlike("the surface is that of the mean head", &complaint)),
                    )
                }
            })
        })
    }

    /// Two motions of one length on a face, each vertex by its shares `[V]` of both, such as what is said and how
    /// it is felt under a painted mask.
    ///
    /// # Errors
    /// `InvalidInput` for motion that is not of landmarks, `ShapeMismatch` for motions of other lengths or shares of
    /// another mesh; else those of [`Engine::spread`].
    pub fn spread_mixed(
        &self,
        face: &Face,
        parts: [(&Motion, Vec<f32>); 2],
        sink: &mut dyn FrameSink,
        progress: ProgressFn<'_>,
    ) -> Result<SpreadReport> {
        self.threads(|| {
            let [(one, first), (other, second)] = parts;
            let one = self.spread_of(face, one, progress)?;
            let other = self.spread_of(face, other, progress)?;
            let mixed = Spread::mixed([(one, first), (other, second)])?;
            spread::into_sink(&mixed, sink, progress)
        })
    }

    /// The way of landmarks to a face.
    fn spread_of<'a>(
        &self,
        face: &'a Face,
        motion: &Motion,
        progress: ProgressFn<'_>,
    ) -> Result<Spread<'a>> {
        let clip = motion.landmarks().ok_or_else(|| {
            let got = motion.kind();
            Error::InvalidInput(format!("layers: expected motion of landmarks, got {got}"))
        })?;
        let own = face.own_motion(clip.displacements.view());
        let deformer = self.deformer(face, progress)?.as_ref();
        if let Motion::Codes(CodeClip { codes, .. }) = motion
            && let Some(field) = self.system.field(face, &self.cache, progress)?
        {
            return Spread::of_field(face, deformer, own, clip.fps, (field, codes.view()));
        }
        Ok(Spread::of_landmarks(face, deformer, own, clip.fps))
    }

    /// How far feeling is believed beside what is said in some frames of a performance, for each vertex of a face,
    /// `[V, t]` from 0 to 1: `w` of EmoFace's Mesh Attention.
    ///
    /// # Errors
    /// `InvalidInput` for a system that does not tell them apart, or frames that the performance lacks; `Mesh` if
    /// the landmarks of the face lie on no usable face.
    pub fn believed(
        &self,
        face: &Face,
        performance: &Performance,
        frames: Range<usize>,
    ) -> Result<Array2<f32>> {
        let count = performance.motion.frames();
        if frames.start > frames.end || frames.end > count {
            return Err(Error::InvalidInput(format!(
                "frames: expected some of {count}, got {frames:?}"
            )));
        }
        self.threads(|| {
            let made = self
                .system
                .believed(&performance.heard, &performance.request)?;
            let mask = made.ok_or_else(|| {
                let name = self.registration.name;
                let expected = "mask: expected a system that tells what is felt from what is said";
                Error::InvalidInput(format!("{expected} (emoface), got {name}"))
            })?;
            let shares = mask.at(frames, performance.motion.fps());
            spread::on_face(face, &mask.template, shares.view())
        })
    }

    /// What weights of ARKit's shapes ask of a face's landmarks, `[T, 68, 3]`, mesh units and axes.
    pub(crate) fn asked_of(&self, face: &Face, clip: &WeightClip) -> Result<Array3<f32>> {
        let landmarks = clip.of_arkit().landmarks(&self.face_modes)?;
        Ok(face.own_motion(landmarks.displacements.view()))
    }

    /// The landmarks of the mean face under motion of any kind: what it looks like before any mesh is known.
    ///
    /// # Errors
    /// `InvalidInput` for a kind of motion that nothing puts on a face yet.
    pub fn landmarks_of(&self, motion: &Motion) -> Result<LandmarkClip> {
        match motion {
            Motion::Landmarks(clip) => Ok(clip.clone()),
            Motion::Weights(clip) => clip.landmarks(&self.face_modes),
            Motion::Codes(clip) => Ok(clip.landmarks.clone()),
            Motion::Template(_) => Err(spread::not_yet(motion)),
        }
    }

    /// As [`Engine::spread`] for landmark motion `[T, 68, 3]` that is in the mesh's own units and axes.
    ///
    /// # Errors
    /// Those of [`Engine::spread`].
    pub fn spread_own(
        &self,
        face: &Face,
        landmarks: Array3<f32>,
        fps: f64,
        sink: &mut dyn FrameSink,
        progress: ProgressFn<'_>,
    ) -> Result<SpreadReport> {
        self.threads(|| {
            let deformer = self.deformer(face, progress)?;
            let spread = Spread::of_landmarks(face, deformer.as_ref(), landmarks, fps);
            spread::into_sink(&spread, sink, progress)
        })
    }

    /// By which share each vertex attends to each landmark, `[T, V, 68]`, for landmark motion `[T, 68, 3]` in
    /// the mesh's own units and axes. FreeTalk's figure 7 shows a landmark's column.
    ///
    /// # Errors
    /// `InvalidInput` for a face whose decoder has no attention, otherwise those of [`Engine::spread`].
    pub fn attention(
        &self,
        face: &Face,
        landmarks: ArrayView3<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let shares = self.threads(|| Ok(self.deformer(face, progress)?.attention(landmarks)))?;
        let shares = shares.ok_or_else(|| {
            let message = "attention: expected a decoder that has one (paper), got one without";
            Error::InvalidInput(message.into())
        })?;
        check_result("attention", shares.view().into_dyn())?;
        Ok(shares)
    }

    /// The whole way: sound and a face to frames in `sink`.
    ///
    /// # Errors
    /// Those of [`Engine::perform`] and [`Engine::spread`].
    pub fn animate(
        &self,
        face: &Face,
        waveform: &Waveform,
        request: &MotionRequest,
        sink: &mut dyn FrameSink,
        progress: ProgressFn<'_>,
    ) -> Result<SpreadReport> {
        let performance = self.perform(waveform, request, progress)?;
        self.spread(face, &performance.motion, sink, progress)
    }

    /// The fewest shapes that show a clip; see [`compression::compress`].
    ///
    /// # Errors
    /// Those of [`compression::compress`].
    pub fn compress(
        &self,
        clip: &VertexClip,
        max_error: f32,
        max_shapes: usize,
        progress: ProgressFn<'_>,
    ) -> Result<VertexBasis> {
        self.threads(|| compression::compress(clip, max_error, max_shapes, progress))
    }

    /// Weights of the first `shapes` shapes of a rig from motion of its vertices; see [`rig::solve`].
    ///
    /// # Errors
    /// Those of [`rig::solve`].
    pub fn solve(
        &self,
        rig: &Rig,
        shapes: usize,
        displacements: ArrayView3<'_, f32>,
        options: &SolveOptions,
        progress: ProgressFn<'_>,
    ) -> Result<SolvedWeights> {
        self.threads(|| rig::solve(rig, shapes, displacements, options, progress))
    }

    /// Runs `work` on the engine's own threads, if it has any.
    ///
    /// # Errors
    /// `InvalidInput` in a copy of the process that made the engine, where nobody would do the work;
    /// otherwise those of `work`.
    fn threads<T: Send>(&self, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
        let here = std::process::id();
        if here != self.process {
            return Err(Error::InvalidInput(format!(
                "engine: expected the process that made it ({}), got {here}: threads do not live on after \
                 fork(); make an engine in the new process",
                self.process
            )));
        }
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }
}

/// That no head is like a face, and what happens instead.
fn unlike(instead: &str, complaint: &str) -> String {
    format!("no head of the model is like this face, {instead}: {complaint}")
}

/// Names the code and the models that per-mesh work depends on.
fn key_of_models(folder: Option<&Path>) -> Result<CacheKey> {
    let mut key = CacheKey::new("prepared", 1).text(env!("ANYFACE_SOURCES"));
    let of_meshes = [
        &deform::static_weights::MODEL,
        &deform::creases::MODEL,
        &mesh::LANDMARK_MODEL,
        &head::MODEL,
    ];
    for model in of_meshes {
        key = model.add_to(key, folder)?;
    }
    Ok(key)
}

/// The threads that were asked for. In a copy of the process the shared ones are gone, so that an engine
/// that is made there has its own.
fn threads_of_own(asked: Option<usize>) -> Result<Option<rayon::ThreadPool>> {
    let here = std::process::id();
    let is_copy = *FIRST_PROCESS.get_or_init(|| here) != here;
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let wanted = asked.or_else(|| is_copy.then(|| cores().min(MAX_THREADS)));
    wanted.map(thread_pool).transpose()
}

fn thread_pool(threads: usize) -> Result<rayon::ThreadPool> {
    let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
    builder
        .build()
        .map_err(|error| Error::InvalidInput(format!("threads: {error}")))
}
