//! Everything known about one mesh: where its face is, and the data that moving it needs.

pub mod binding;
mod box3;
mod deformer;
mod eye_parts;
pub(crate) mod eyes;
mod face_cache;
mod face_options;
mod heads;
mod landmarks;
pub(crate) mod lids;
pub(crate) mod nearest;
mod open_eyes;
mod open_mouth;
mod opened;
mod part_list;
pub mod proxy;
mod role_rules;
mod shapes;
mod skin;
mod surface;

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError},
};

use ndarray::{Array3, ArrayView2, ArrayView3, Axis};

use crate::{
    Error, Result,
    cache::{Cache, CacheKey},
    conditions::Controls,
    job::{ProgressFn, report},
    mesh::{
        self, LandmarkFinder, Landmarks, Mesh, Mouth, Similarity, features::Features,
        ibug::LANDMARKS,
    },
};
pub use deformer::{CodeField, Deformer, FewVertices, Field, ShapeProducts};
pub use eyes::Lids;
use eyes::Openings;
pub use face_options::{DEFAULT_PROXY, FaceOptions};
pub use landmarks::{check_landmarks, locate_landmarks, locate_landmarks_with};
pub(crate) use nearest::PointGrid;
pub use open_eyes::{EyeTrial, open_eyes};
pub use open_mouth::{MouthTrial, open_mouth};
pub use opened::{OpenedFace, TriangleSource};
pub use part_list::PartList;
pub use shapes::{Rig, ShapeReport};
pub use skin::Skin;
pub use surface::FaceSurface;

/// A mesh, its landmarks, its place in the canonical frame and its parts. Everything else is
/// computed once, when it is first needed.
///
/// To its users a face never changes, and any number of threads may share one.
///
/// ```
/// use anyface::{CachePolicy, Engine, EngineOptions, face::FaceOptions, mesh::{LandmarkSource, Mesh}};
/// use anyface::job::SILENT;
///
/// let head = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
/// let mesh = Mesh::read(head.join("head.obj"))?;
/// let engine = Engine::new(EngineOptions { cache: CachePolicy::Off, ..Default::default() })?;
/// let landmarks = Some(LandmarkSource::read(&head.join("landmarks.json"))?);
/// let face = engine.find(&mesh, &FaceOptions { landmarks, ..Default::default() }, SILENT)?;
/// assert_eq!(face.mouth().name(), "slit");
/// assert!((face.metres_per_unit() - 1.0).abs() < 0.2);
/// # Ok::<(), anyface::Error>(())
/// ```
pub struct Face {
    /// The mesh itself.
    pub mesh: Arc<Mesh>,
    /// The 68 landmarks in the mesh's own units.
    pub landmarks: Landmarks,
    /// From the mesh's own frame to the canonical one.
    pub to_canonical: Similarity,
    /// The mesh's parts and what each of them is.
    pub parts: PartList,
    /// The options of the call that made the face.
    pub options: FaceOptions,
    /// Cache key of the mesh and the models.
    key: CacheKey,
    mouth: OnceLock<Mouth>,
    openings: OnceLock<Openings>,
    surface: OnceLock<FaceSurface>,
    deformer: OnceLock<Arc<dyn Deformer>>,
    rig: OnceLock<Arc<Rig>>,
    /// The code fields by the names of their models.
    fields: Mutex<BTreeMap<&'static str, Field>>,
}

impl Face {
    /// Finds the parts of a mesh, and its landmarks where the options have none. `models`: the
    /// cache key of the models, on which the result depends too.
    ///
    /// # Errors
    /// `FaceNotFound`, `Mesh`, `InvalidInput` for impossible landmarks, `Cancelled`.
    pub(crate) fn find(
        mesh: &Mesh,
        options: &FaceOptions,
        finder: &LandmarkFinder,
        cache: &Cache,
        models: &CacheKey,
        progress: ProgressFn<'_>,
    ) -> Result<Face> {
        report(progress, "landmarks", 0.0)?;
        let key = face_cache::key_of(mesh, models);
        let find = || {
            let landmarks = locate_landmarks_with(finder, mesh, options, progress)?;
            let to_canonical = mesh::align_to_canonical(&landmarks)?;
            let parts = PartList::find(mesh, &landmarks, &to_canonical, &options.parts)?;
            Ok((landmarks, parts))
        };
        let (landmarks, parts) = face_cache::landmarks(cache, &key, options, find)?;
        let to_canonical = mesh::align_to_canonical(&landmarks)?;
        report(progress, "landmarks", 1.0)?;
        let place = (landmarks, to_canonical, parts);
        Ok(Face::new(mesh.clone(), place, options.clone(), key))
    }

    /// A face whose landmarks, alignment and parts are known.
    pub(crate) fn new(
        mesh: Mesh,
        (landmarks, to_canonical, parts): (Landmarks, Similarity, PartList),
        options: FaceOptions,
        key: CacheKey,
    ) -> Face {
        Face {
            mesh: Arc::new(mesh),
            landmarks,
            to_canonical,
            parts,
            options,
            key,
            mouth: OnceLock::new(),
            openings: OnceLock::new(),
            surface: OnceLock::new(),
            deformer: OnceLock::new(),
            rig: OnceLock::new(),
            fields: Mutex::default(),
        }
    }

    /// How the lips meet.
    pub fn mouth(&self) -> Mouth {
        let find = || Mouth::of(&self.mesh, &self.landmarks);
        *self.mouth.get_or_init(find)
    }

    /// Which of brows, eyes and nose the finder saw. Features that the face lacks do not move.
    pub(crate) fn features(&self) -> Features {
        let features = Features::of(&self.landmarks);
        if self.openings().is_one() {
            features.of_one_eye()
        } else {
            features
        }
    }

    /// Names the features that were not found and do not move, and those that were hardly found and
    /// move less. `None` where all were found.
    pub fn at_rest(&self) -> Option<String> {
        self.features().sentence()
    }

    /// What the lids of the subject's right and left eye can do. The eye of a cyclops counts as
    /// both.
    pub fn lids(&self) -> [Lids; 2] {
        self.openings().lids()
    }

    /// Converts the canonical landmark motion `[T, 68, 3]`, metres, to motion of this face, in the
    /// mesh's units and axes. A lid that closes by some share travels this share of the height of
    /// its own eye's opening.
    pub fn motion_on_mesh(&self, landmarks: ArrayView3<'_, f32>) -> Array3<f32> {
        let mut motion = landmarks.to_owned();
        self.openings().to_face(&mut motion);
        self.to_canonical.displacements_to_mesh(motion.view())
    }

    /// Displacements `[t, V, 3]` of this face under codes `[t, X]`, mesh units and axes. `deformer`
    /// moves the vertices that do not follow the codes. It also adds the motion of `landmarks`
    /// `[t, 68, 3]`, in mesh units, which the codes do not contain.
    ///
    /// # Errors
    /// Those of [`CodeField::landmarks`] and of the deformer.
    pub(crate) fn under_codes(
        &self,
        (field, deformer): (&dyn CodeField, &dyn Deformer),
        landmarks: ArrayView3<'_, f32>,
        codes: ArrayView2<'_, f32>,
        progress: ProgressFn<'_>,
    ) -> Result<Array3<f32>> {
        let base = self.motion_on_mesh(field.landmarks(codes)?.view());
        let base = deformer.deform_freely(base.view(), progress)?;
        let beside = field.beyond(codes, &base)?;
        deformer.deform_beside(landmarks, &beside, progress)
    }

    /// The canonical pose of the landmarks, `[68][3]` metres, for displacements `moved` `[V, 3]` of
    /// this mesh's vertices, mesh units and axes. A motion may start from this pose.
    ///
    /// # Errors
    /// `ShapeMismatch` for another number of vertices, `InvalidInput` for displacements that are not finite.
    pub fn pose_of(&self, moved: ArrayView2<'_, f32>) -> Result<[[f32; 3]; LANDMARKS]> {
        let vertices = self.mesh.positions.len();
        if moved.dim() != (vertices, 3) {
            return Err(Error::ShapeMismatch {
                what: "displacements of a pose",
                expected: format!("[{vertices}, 3]"),
                got: format!("{:?}", moved.dim()),
            });
        }
        if let Some(((vertex, _), x)) = moved.indexed_iter().find(|(_, x)| !x.is_finite()) {
            return Err(Error::InvalidInput(format!(
                "displacements of a pose: expected finite numbers, got {x} at vertex {vertex}"
            )));
        }
        let marks = self.landmarks.vertices.map(|v| v as usize);
        let at_landmarks = moved.select(Axis(0), &marks).insert_axis(Axis(0));
        let mut pose = self
            .to_canonical
            .displacements_to_canonical(at_landmarks.view());
        self.openings().to_canonical(&mut pose);
        Ok(std::array::from_fn(|n| {
            std::array::from_fn(|axis| pose[[0, n, axis]])
        }))
    }

    pub(crate) fn openings(&self) -> &Openings {
        let (to_canonical, parts) = (&self.to_canonical, &self.parts);
        let find = || Openings::of(&self.mesh, &self.landmarks, to_canonical, parts);
        self.openings.get_or_init(find)
    }

    /// Metres per unit of the mesh, if the head has human size.
    pub fn metres_per_unit(&self) -> f64 {
        self.to_canonical.scale
    }

    /// The skin and the parts that follow it.
    ///
    /// # Errors
    /// `Mesh` if the landmarks lie on no usable face.
    pub fn surface(&self) -> Result<&FaceSurface> {
        once(&self.surface, || {
            let (landmarks, to_canonical) = (&self.landmarks, &self.to_canonical);
            let proxy = self.options.proxy;
            FaceSurface::find(&self.mesh, landmarks, to_canonical, &self.parts, proxy)
        })
    }

    /// The deformer of this mesh, if one was made.
    pub(crate) fn known_deformer(&self) -> Option<&dyn Deformer> {
        self.deformer.get().map(AsRef::as_ref)
    }

    /// The deformer of this mesh. Calls `make` for the first one.
    pub(crate) fn deformer(
        &self,
        make: impl FnOnce() -> Result<Arc<dyn Deformer>>,
    ) -> Result<&Arc<dyn Deformer>> {
        once(&self.deformer, make)
    }

    /// The shapes of this mesh. Calls `make` for the first ones.
    pub(crate) fn rig(&self, make: impl FnOnce() -> Result<Arc<Rig>>) -> Result<&Arc<Rig>> {
        once(&self.rig, make)
    }

    /// The field of a model on this mesh, or why there is none. Calls `make` the first time.
    #[cfg(any(feature = "emoface", feature = "facetalk"))]
    pub(crate) fn field(
        &self,
        model: &'static str,
        make: impl FnOnce() -> Result<Field>,
    ) -> Result<Field> {
        let known = self.fields().get(model).cloned();
        let field = known.map_or_else(make, Ok)?;
        Ok(self.fields().entry(model).or_insert(field).clone())
    }

    /// Why the landmarks alone move the mesh under codes: no head of a model is like this face.
    /// `None` where every field that was asked for fits.
    pub fn field_note(&self) -> Option<String> {
        let fields = self.fields();
        let complaint = fields.values().find_map(|field| field.as_ref().err())?;
        Some(unlike("landmarks alone move the mesh", complaint))
    }

    fn fields(&self) -> MutexGuard<'_, BTreeMap<&'static str, Field>> {
        self.fields.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Cache key of this face for results that no control changes.
    pub(crate) fn cache_key_of_mesh(&self) -> CacheKey {
        let options = FaceOptions {
            controls: Controls::default(),
            ..self.options.clone()
        };
        face_cache::key_of_face(&self.key, &options, &self.landmarks)
    }

    /// Cache key of this face.
    pub(crate) fn cache_key(&self) -> CacheKey {
        face_cache::key_of_face(&self.key, &self.options, &self.landmarks)
    }
}

/// Says that no head of the model is like this face, and what happens instead.
pub(crate) fn unlike(instead: &str, complaint: &str) -> String {
    format!("no head of the model is like this face, {instead}: {complaint}")
}

/// The value in `cell`. `make` makes it the first time. Two threads may both make it at once. The
/// first result that is stored stays.
fn once<T>(cell: &OnceLock<T>, make: impl FnOnce() -> Result<T>) -> Result<&T> {
    match cell.get() {
        Some(value) => Ok(value),
        None => {
            let value = make()?;
            Ok(cell.get_or_init(|| value))
        }
    }
}
