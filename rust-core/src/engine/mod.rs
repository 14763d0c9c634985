//! The whole pipeline as one object. It loads the weights once, and any number of jobs share them.

mod causal;
mod events;
mod listen;
mod mouth_reach;
mod open_eyes;
mod open_mouth;
mod perform;
mod performers;
mod sliders;
mod stretches;
mod take_weights;

use std::{
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
};

use ndarray::{Array3, ArrayView3};

use crate::{
    Error, Result,
    audio::Waveform,
    cache::{Cache, CacheKey, CachePolicy},
    conditions::{ControlStage, ControlValues, Controls},
    deform::{self, Creases, LEARNED, StaticWeights},
    face::{Deformer, Face, FaceOptions, Rig, unlike},
    head::{self, COEFFICIENTS, Head, HeadOnMesh, HeadSurface, Reach, check_surface_cells},
    job::{ProgressFn, memory::MemoryNeed, outside::guarded},
    mesh::{self, LandmarkFinder, Mesh, Similarity},
    models::{self, Opened},
    motion::{FaceModes, LandmarkClip, Motion, MotionKind, MotionRequest, WeightClip},
    nn::finite::check_result,
    rig::{self, FieldOfFace, RigModel, ShapeSource},
    speech::{self, EmotionEar, PHONE_MODEL, PhoneModel, SpeechEncoder, WhisperEar},
    spread::{self, FrameSink, Movement, Spread, SpreadReport, WeightedShapes},
    systems::{Description, Registration, SYSTEMS, System, built_in_models},
};
pub use mouth_reach::MouthReach;
pub use perform::Performance;
pub use performers::CapturedTake;
pub use sliders::SliderChange;
pub use stretches::Part;

const MAX_THREADS: usize = 256;
/// The control by which a system replaces the first decoder, which all systems share, with its own.
const DECODER: &str = "decoder";

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
    /// A folder with a HuBERT or wav2vec2 checkpoint in the layout of Hugging Face. It replaces the
    /// built-in speech encoder, so the system's weights must have been trained with it. Without this
    /// option, a system whose config names `hubert` or `wav2vec2` takes the folder of that name
    /// among the models.
    pub speech: Option<PathBuf>,
}

impl Default for EngineOptions {
    fn default() -> Self {
        EngineOptions {
            system: None,
            models: None,
            cache: CachePolicy::UserFolder,
            threads: None,
            speech: None,
        }
    }
}

/// Loaded weights and settings. An engine is `Send + Sync`, and any number of jobs may run on it at
/// once.
///
/// [`Engine::perform`] turns sound into motion, [`Engine::prepare`] turns a mesh into a face, and
/// [`Engine::spread`] spreads the motion over the face into a sink. [`Engine::animate`] does all of
/// it.
///
/// ```
/// use anyface::{CachePolicy, Engine, EngineOptions, MotionRequest, audio::Waveform};
/// use anyface::{face::FaceOptions, mesh::{LandmarkSource, Mesh}, job::SILENT, spread::Collector};
///
/// let head = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
/// let mesh = Mesh::read(head.join("head.obj"))?;
/// let landmarks = Some(LandmarkSource::read(&head.join("landmarks.json"))?);
/// let engine = Engine::new(EngineOptions { cache: CachePolicy::Off, ..Default::default() })?;
/// let face = engine.prepare(&mesh, &FaceOptions { landmarks, ..Default::default() }, SILENT)?;
/// let sound = Waveform { samples: (0..8000).map(|i| (i as f32 * 0.08).sin()).collect() };
/// let request = MotionRequest::default();
/// let clip = Collector::collect(|sink| engine.animate(&face, &sound, &request, sink, SILENT))?;
/// assert_eq!(clip.vertices.displacements.dim(), (15, mesh.positions.len(), 3));
/// # Ok::<(), anyface::Error>(())
/// ```
pub struct Engine {
    registration: &'static Registration,
    system: Box<dyn System>,
    encoder: Opened<Arc<dyn SpeechEncoder>>,
    shared: SharedModels,
    /// Loaded when shapes are first needed.
    rig_model: OnceLock<RigModel>,
    model_folder: Option<PathBuf>,
    cache: Cache,
    pool: Option<rayon::ThreadPool>,
    /// The process that made the engine. A forked copy of it does not have its threads.
    process: u32,
}

/// What all systems have in common, besides the speech encoder.
struct SharedModels {
    static_weights: StaticWeights,
    creases: Creases,
    finder: LandmarkFinder,
    /// Moves the lids when the eyes look up or down.
    face_modes: FaceModes,
    /// Hears emotions in a live voice.
    ear: Opened<Arc<EmotionEar>>,
    /// Hears emotions in a recording.
    whisper_ear: Opened<Arc<WhisperEar>>,
    /// Hears phones, which say when lips touch.
    phone_model: Opened<Arc<PhoneModel>>,
    /// Identifies the models in the cache entries of a mesh.
    key: CacheKey,
}

impl SharedModels {
    fn open(folder: Option<&Path>) -> Result<Self> {
        Ok(SharedModels {
            static_weights: StaticWeights::open(folder)?,
            creases: Creases::open(folder)?,
            finder: LandmarkFinder::load(folder)?,
            face_modes: FaceModes::open(folder)?,
            ear: Opened::of(&speech::EMOTION_EAR, folder, || {
                EmotionEar::open(folder).map(Arc::new)
            })?,
            whisper_ear: Opened::of(&speech::EMOTION_OF_WHISPER, folder, || {
                WhisperEar::open(folder).map(Arc::new)
            })?,
            phone_model: Opened::of(&PHONE_MODEL, folder, || {
                PhoneModel::open(folder).map(Arc::new)
            })?,
            key: key_of_models(folder)?,
        })
    }
}

/// The process that made the first engine, and so started the threads that all engines share.
static FIRST_PROCESS: OnceLock<u32> = OnceLock::new();

impl EngineOptions {
    /// Checks what can be checked before anything is loaded.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown system, a number of threads out of range, or a cache folder that
    /// holds files of others.
    pub fn check(&self) -> Result<()> {
        Registration::find(self.system.as_deref())?;
        self.cache.check()?;
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
    /// unknown system, a number of threads out of range, or a cache folder that holds files of others.
    pub fn new(options: EngineOptions) -> Result<Self> {
        options.check()?;
        let folders = [&options.models, &options.speech];
        if folders.iter().any(|folder| folder.is_some()) {
            // Nobody has checked files from elsewhere. Their sizes may cause anything, even a
            // panic.
            guarded(Error::Weights, || Self::load(options))
        } else {
            Self::load(options)
        }
    }

    /// Loads on the threads on which the engine will work.
    fn load(options: EngineOptions) -> Result<Self> {
        match private_pool(options.threads)? {
            Some(pool) => {
                let engine = pool.install(|| Self::open(options))?;
                Ok(Engine {
                    pool: Some(pool),
                    ..engine
                })
            }
            None => Self::open(options),
        }
    }

    fn open(options: EngineOptions) -> Result<Self> {
        let folder = options.models.as_deref();
        if let Some(folder) = folder {
            models::check_folder(folder, built_in_models(), &speech::CHECKPOINTS)?;
        }
        let registration = Registration::find(options.system.as_deref())?;
        let checkpoint = options.speech.as_deref();
        // The ear takes as long as everything else: most of it goes into gzip, on one thread a file.
        let (ear, (system, shared)) = rayon::join(
            || checkpoint.is_none().then(|| speech::ear(folder)),
            || {
                let shared = || SharedModels::open(folder);
                rayon::join(|| (registration.open)(folder), shared)
            },
        );
        let system = system?;
        let required = system.description().speech;
        let encoder = Opened::of(&speech::EAR_MODEL, folder, || {
            let ear = || ear.unwrap_or_else(|| speech::ear(folder));
            Ok(Arc::from(speech::open(required, checkpoint, folder, ear)?))
        })?;
        Ok(Engine {
            registration,
            system,
            encoder,
            shared: shared?,
            rig_model: OnceLock::new(),
            cache: Cache::new(&options.cache),
            pool: None,
            process: process_here(),
            model_folder: options.models,
        })
    }

    /// The registry's entry for the system that performs here.
    pub fn system(&self) -> &'static Registration {
        self.registration
    }

    /// A description of the system's loaded models.
    pub fn description(&self) -> Description<'_> {
        self.system.description()
    }

    /// Estimates the memory that motion on a mesh needs. The mesh has `vertices`, `frames` are kept
    /// at once, and `sound_s` seconds of sound are performed at once
    /// ([`Engine::longest_stretch_s`]).
    pub fn memory_need(&self, vertices: usize, frames: usize, sound_s: f64) -> MemoryNeed {
        let (shapes, copies) = match self.registration.motion {
            MotionKind::Landmarks => (0, 1),
            MotionKind::Weights => (rig::SHAPES, 1),
            // Besides the frames, memory holds what the codes' landmarks and the field contribute
            // to them.
            MotionKind::Codes => (0, 3),
        };
        MemoryNeed {
            vertices,
            shapes,
            frames: frames.saturating_mul(copies),
            speech: (sound_s * self.registration.second_bytes as f64) as u64,
            models: match self.system.description().speech {
                Some(input) if input.encoder == speech::EAR_MODEL.name => speech::EAR_BYTES,
                _ => 0,
            },
        }
    }

    /// Finds the landmarks of a mesh, or takes them from `options`. Prepares nothing that only
    /// motion needs.
    ///
    /// # Errors
    /// `FaceNotFound`, `Mesh`, `InvalidInput` for impossible landmarks, `Cancelled`; `OutOfMemory`,
    /// before any work begins, if the work on the mesh surely does not fit into the free memory.
    pub fn find(
        &self,
        mesh: &Mesh,
        options: &FaceOptions,
        progress: ProgressFn<'_>,
    ) -> Result<Face> {
        let known = self.registration.controls();
        options.controls.check(known, ControlStage::Face)?;
        self.memory_need(mesh.positions.len(), 0, 0.0).check()?;
        let mut options = options.clone();
        if self.system.decoder(&options.controls).is_some() {
            options.proxy = None;
        }
        self.threads(|| {
            let (cache, models) = (&self.cache, &self.shared.key);
            Face::find(mesh, &options, &self.shared.finder, cache, models, progress)
        })
    }

    /// Does [`Engine::find`], and makes everything else that spreading landmark motion needs and
    /// that does not depend on time.
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

    /// The deformer of a face, in mesh units and axes. It is made once for each face.
    fn deformer<'a>(
        &self,
        face: &'a Face,
        progress: ProgressFn<'_>,
    ) -> Result<&'a Arc<dyn Deformer>> {
        face.deformer(|| match self.system.decoder(&face.options.controls) {
            Some(decoder) => decoder.prepare(face, &self.cache, progress),
            None => {
                let learned = LEARNED.value(&face.options.controls);
                self.static_deformer(face, learned, progress)
            }
        })
    }

    fn static_deformer(
        &self,
        face: &Face,
        learned: f32,
        progress: ProgressFn<'_>,
    ) -> Result<Arc<dyn Deformer>> {
        let models = (&self.shared.static_weights, &self.shared.creases);
        let deformer = deform::static_deformer(models, face, learned, &self.cache, progress)?;
        Ok(Arc::new(deformer))
    }

    /// The ARKit shapes and visemes of a face. The network's shapes are made once for each face.
    ///
    /// # Errors
    /// `Weights` or `Io` if the engine's folder of models holds a rig that cannot be used, `Mesh`,
    /// `Cancelled`; `InvalidInput` if the shapes should come from the parametric head and no
    /// head fits the face.
    pub fn rig(
        &self,
        face: &Face,
        source: ShapeSource,
        progress: ProgressFn<'_>,
    ) -> Result<Arc<Rig>> {
        let make = || {
            let model = self.rig_model()?;
            let plain = self.static_deformer(face, 0.0, progress)?;
            let learned = self.static_deformer(face, 1.0, progress)?;
            let (_, landmarks) = face.surface()?.decimetres();
            let learned = rig::Learned {
                deformer: learned.as_ref(),
                share: self.shared.static_weights.known(&landmarks),
            };
            let rig = model.make(face, plain.as_ref(), &learned, progress)?;
            check_result("rig", rig.deltas.view().into_dyn())?;
            Ok(Arc::new(rig))
        };
        self.threads(|| {
            let linear = face.rig(make)?;
            match source {
                ShapeSource::Network => Ok(Arc::clone(linear)),
                ShapeSource::Field { in_betweens } => {
                    let rig = self.rig_by_field(face, linear, in_betweens, progress)?;
                    Ok(Arc::new(rig))
                }
            }
        })
    }

    fn rig_by_field(
        &self,
        face: &Face,
        linear: &Rig,
        in_betweens: bool,
        progress: ProgressFn<'_>,
    ) -> Result<Rig> {
        let head = Arc::new(self.head()?);
        let reach = Reach::default();
        let field = HeadOnMesh::new(Arc::clone(&head), face, reach, &self.cache, progress)?;
        let field = field.map_err(|complaint| {
            let expected =
                "rig: expected a face that is like a head of the model, whose field makes the shapes";
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
            .by_field(face, linear, &by, in_betweens, progress)?;
        check_result("rig", rig.deltas.view().into_dyn())?;
        Ok(rig)
    }

    /// The parametric head of the loaded models.
    fn head(&self) -> Result<Head> {
        Head::open(self.model_folder.as_deref())
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

    /// Puts motion on a face and hands the frames to `sink`, block by block.
    ///
    /// If the face still lacks something that this kind of motion needs, it is made first and kept
    /// with the face.
    ///
    /// # Errors
    /// `ShapeMismatch` for a mixture of motions whose lengths differ, or with shares for another
    /// mesh; the errors of the sink; `Cancelled`.
    pub fn spread<'a>(
        &self,
        face: &Face,
        movement: impl Into<Movement<'a>>,
        sink: &mut dyn FrameSink,
        progress: ProgressFn<'_>,
    ) -> Result<SpreadReport> {
        let movement = movement.into();
        self.threads(|| {
            let spread = self.on_its_way(face, movement, progress)?;
            spread.into_sink(sink, progress)
        })
    }

    /// Like [`Engine::spread`], for one part of a longer movement. The sink has already begun, and
    /// receives only the frames of this part.
    ///
    /// # Errors
    /// Those of [`Engine::spread`].
    pub fn spread_part<'a>(
        &self,
        face: &Face,
        movement: impl Into<Movement<'a>>,
        sink: &mut dyn FrameSink,
        progress: ProgressFn<'_>,
    ) -> Result<SpreadReport> {
        let movement = movement.into();
        self.threads(|| {
            let spread = self.on_its_way(face, movement, progress)?;
            spread.part_into_sink(sink, progress)
        })
    }

    /// Prepares a movement for a face.
    fn on_its_way<'a>(
        &self,
        face: &'a Face,
        movement: Movement<'a>,
        progress: ProgressFn<'_>,
    ) -> Result<Spread<'a>> {
        match movement {
            Movement::Motion(motion) => self.on_face(face, motion, progress),
            Movement::Own { landmarks, fps } => {
                let deformer = self.deformer(face, progress)?.as_ref();
                Ok(Spread::of_landmarks(face, deformer, landmarks, fps))
            }
            Movement::Mixed([(one, first), (other, second)]) => {
                let one = self.on_face(face, one, progress)?;
                let other = self.on_face(face, other, progress)?;
                Spread::mixed([(one, first), (other, second)])
            }
            Movement::WithTongue(movement, tongue) => {
                let spread = self.on_its_way(face, *movement, progress)?;
                spread.with_tongue(tongue.view())
            }
        }
    }

    /// Prepares a motion for a face.
    fn on_face<'a>(
        &self,
        face: &'a Face,
        motion: &'a Motion,
        progress: ProgressFn<'_>,
    ) -> Result<Spread<'a>> {
        let deformer = || Ok(self.deformer(face, progress)?.as_ref());
        match motion {
            Motion::Landmarks(clip) => {
                let landmarks = face.motion_on_mesh(clip.displacements.view());
                Ok(Spread::of_landmarks(face, deformer()?, landmarks, clip.fps))
            }
            Motion::Weights(clip) => {
                let rig = self.rig(face, ShapeSource::Network, progress)?;
                let shapes = WeightedShapes {
                    clip: spread::closed_on(face, &rig, clip),
                    rig,
                    deformer: deformer()?,
                    landmarks: self.landmarks_of_weights(face, clip)?,
                };
                Ok(Spread::of_weights(face, shapes))
            }
            Motion::Codes(clip) => {
                let deformer = deformer()?;
                let field = clip.space.field(face, &self.cache, progress)?;
                Spread::of_codes(face, deformer, clip, field)
            }
        }
    }

    /// The motion with which the system follows landmarks of the mean face, metres, from any
    /// source. `controls`: those of the face. A system without a model for this returns the
    /// landmarks themselves.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn follow(
        &self,
        landmarks: &LandmarkClip,
        controls: &Controls,
        progress: ProgressFn<'_>,
    ) -> Result<Motion> {
        self.threads(|| self.system.follow(landmarks, controls, progress))
    }

    /// The surface of the parametric head fitted to a face, placed where the face is, for poses
    /// given by codes. If no head fits, returns the surface of the mean head and the reason.
    /// `cells`: number of cells along the longest side of the grid.
    ///
    /// # Errors
    /// Those of [`HeadSurface::new`]; `Mesh` if the landmarks lie on no usable face.
    pub fn head_surface(
        &self,
        face: &Face,
        cells: usize,
        progress: ProgressFn<'_>,
    ) -> Result<(HeadSurface, Option<String>)> {
        check_surface_cells(cells)?;
        let head = Arc::new(self.head()?);
        self.threads(|| {
            let surface_of = |coefficients: &[f32], to_head: &Similarity| {
                let to_mesh = to_head.inverse();
                HeadSurface::new(Arc::clone(&head), coefficients, to_mesh, cells, progress)
            };
            Ok(match head::fit_face(&head, face, &self.cache, progress)? {
                Ok(fit) => (surface_of(&fit.coefficients, &fit.to_head)?, None),
                Err(complaint) => {
                    let mean = surface_of(&[0.0; COEFFICIENTS], &face.to_canonical)?;
                    (
                        mean,
                        Some(unlike("the surface is that of the mean head", &complaint)),
                    )
                }
            })
        })
    }

    /// The landmark motion `[T, 68, 3]` that weights of ARKit's shapes give a face, mesh units and
    /// axes.
    fn landmarks_of_weights(&self, face: &Face, clip: &WeightClip) -> Result<Array3<f32>> {
        let landmarks = clip.of_arkit().landmarks(&self.shared.face_modes)?;
        Ok(face.motion_on_mesh(landmarks.displacements.view()))
    }

    /// The landmarks of the mean face for motion of any kind; see [`Motion::on_mean_face`].
    ///
    /// # Errors
    /// Those of [`Motion::on_mean_face`].
    pub fn landmarks_of(&self, motion: &Motion) -> Result<LandmarkClip> {
        motion.on_mean_face(&self.shared.face_modes)
    }

    /// The share by which each vertex attends to each landmark, `[T, V, 68]`, for landmark motion
    /// `[T, 68, 3]` in the mesh's own units and axes. Figure 7 of the FreeTalk paper shows the
    /// column of one landmark.
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
            let known = SYSTEMS.iter().flat_map(|system| system.controls());
            let decoders = known.filter(|control| control.name == DECODER);
            let names = decoders.flat_map(|control| match control.values {
                ControlValues::Choice(names) => &names[1..],
                _ => &[],
            });
            let names: Vec<&str> = names.copied().collect();
            let names = names.join(", ");
            let message =
                format!("attention: expected a decoder with attention ({names}), got one without");
            Error::InvalidInput(message)
        })?;
        check_result("attention", shares.view().into_dyn())?;
        Ok(shares)
    }

    /// Makes a face speak a sound: [`Engine::perform`], then [`Engine::spread`] into `sink`.
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
        self.spread(face, &performance, sink, progress)
    }

    /// Runs `work` on the engine's own threads, if it has any. Functions beside the engine, such as
    /// [`crate::deform::compression::compress`] and [`rig::solve`], then use no more threads than the engine.
    ///
    /// # Errors
    /// `InvalidInput` in a forked copy of the process that made the engine, because the copy has no
    /// threads to do the work; otherwise those of `work`.
    pub fn threads<T: Send>(&self, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
        let here = process_here();
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

/// A cache key that identifies the code and the models on which the work for a mesh depends.
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

/// The ID of this process. In a browser there is only one, without an ID, so this returns 0.
fn process_here() -> u32 {
    if cfg!(target_family = "wasm") {
        0
    } else {
        std::process::id()
    }
}

/// A pool of `threads` threads, or `None` if the engine uses the threads that the process shares.
///
/// A forked copy of the process has lost the shared threads, so an engine made in a copy always
/// gets a pool.
fn private_pool(threads: Option<usize>) -> Result<Option<rayon::ThreadPool>> {
    let here = process_here();
    let is_copy = *FIRST_PROCESS.get_or_init(|| here) != here;
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = threads.or_else(|| is_copy.then(|| cores().min(MAX_THREADS)));
    threads.map(thread_pool).transpose()
}

fn thread_pool(threads: usize) -> Result<rayon::ThreadPool> {
    let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
    builder.build().map_err(|error| {
        Error::OutOfMemory(format!(
            "expected room for the stacks of {threads} threads, got none ({error}); ask for fewer or free memory"
        ))
    })
}
