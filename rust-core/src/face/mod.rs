//! Everything known of one mesh: where its face is, and what moving it needs.

pub mod binding;
mod box3;
mod deformer;
mod eye_parts;
pub(crate) mod eyes;
mod face_cache;
mod face_options;
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
pub use landmarks::{locate_landmarks, locate_landmarks_with};
pub(crate) use nearest::PointGrid;
pub use open_eyes::{EyeTrial, open_eyes};
pub use open_mouth::{MouthTrial, open_mouth};
pub use opened::{OpenedFace, TriangleSource};
pub use part_list::PartList;
pub use shapes::{Rig, ShapeReport};
pub use skin::Skin;
pub use surface::FaceSurface;

/// A mesh, its landmarks, its place in the canonical frame, its parts, and what was computed of it
/// since: each piece once, when it is first needed.
///
/// Never changes for those who look at it; any number of threads may use one face.
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
    /// How the face was asked for.
    pub options: FaceOptions,
    /// Names the mesh and the models in what is kept of it.
    key: CacheKey,
    mouth: OnceLock<Mouth>,
    openings: OnceLock<Openings>,
    surface: OnceLock<FaceSurface>,
    deformer: OnceLock<Arc<dyn Deformer>>,
    rig: OnceLock<Arc<Rig>>,
    /// By the names of their models.
    fields: Mutex<BTreeMap<&'static str, Field>>,
}

impl Face {
    /// Finds or takes the landmarks of a mesh, and what its parts are. `models` names what else the
    /// result depends on.
    ///
    /// # Errors
    /// `FaceNotFound`, `Mesh`, `InvalidInput` for landmarks that cannot be, `Cancelled`.
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

    /// A face whose place is known.
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

    /// Which of brows, eyes and nose were found: what the face lacks rests.
    pub(crate) fn features(&self) -> Features {
        let features = Features::of(&self.landmarks);
        match self.openings().is_one() {
            true => features.of_one_eye(),
            false => features,
        }
    }

    /// In words what of the face was not found, or hardly, and so rests or is weaker; `None` where nothing
    /// is.
    pub fn at_rest(&self) -> Option<String> {
        self.features().sentence()
    }

    /// What the lids of the subject's right and left eye can do. The eye of a cyclops is both.
    pub fn lids(&self) -> [Lids; 2] {
        self.openings().lids()
    }

    /// Canonical motion of landmarks `[T, 68, 3]`, metres, as motion of this face's own, in the mesh's
    /// units and axes: lids travel by the share that is asked for of as far as its eyes are open.
    pub fn own_motion(&self, landmarks: ArrayView3<'_, f32>) -> Array3<f32> {
        let mut own = landmarks.to_owned();
        self.openings().to_own(&mut own);
        self.to_canonical.displacements_to_mesh(own.view())
    }

    /// This face under codes `[t, X]`: displacements `[t, V, 3]`, mesh units and axes. `deformer` moves what does not
    /// follow the codes, and adds what `landmarks` `[t, 68, 3]`, in mesh units, do beside them.
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
        let base = self.own_motion(field.landmarks(codes)?.view());
        let base = deformer.deform_freely(base.view(), progress)?;
        let beside = field.beyond(codes, &base)?;
        deformer.deform_beside(landmarks, &beside, progress)
    }

    /// The canonical pose of the landmarks, `[68][3]` metres, in which the vertices of this mesh are displaced by
    /// `moved` `[V, 3]`, mesh units and axes: a pose that a motion may start from.
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
        let own = moved.select(Axis(0), &marks).insert_axis(Axis(0));
        let mut pose = self.to_canonical.displacements_to_canonical(own.view());
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

    /// Size of the mesh's unit on a head of human size.
    pub fn metres_per_unit(&self) -> f64 {
        self.to_canonical.scale
    }

    /// The skin and what follows it.
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

    /// What spreads landmark motion over this mesh, where that is known.
    pub(crate) fn known_deformer(&self) -> Option<&dyn Deformer> {
        self.deformer.get().map(AsRef::as_ref)
    }

    /// What spreads landmark motion over this mesh; `make` is called where there is none yet.
    pub(crate) fn deformer(
        &self,
        make: impl FnOnce() -> Result<Arc<dyn Deformer>>,
    ) -> Result<&Arc<dyn Deformer>> {
        once(&self.deformer, make)
    }

    /// The shapes of this mesh; `make` is called where there are none yet.
    pub(crate) fn rig(&self, make: impl FnOnce() -> Result<Arc<Rig>>) -> Result<&Arc<Rig>> {
        once(&self.rig, make)
    }

    /// The field of a model on this mesh, or why there is none; `make` is called where that is not known.
    pub(crate) fn field(
        &self,
        model: &'static str,
        make: impl FnOnce() -> Result<Field>,
    ) -> Result<Field> {
        let known = self.fields().get(model).cloned();
        let field = known.map_or_else(make, Ok)?;
        Ok(self.fields().entry(model).or_insert(field).clone())
    }

    /// Why vertices did not follow the field of a head when motion of codes was put on this face, where they did not.
    pub fn field_note(&self) -> Option<String> {
        let fields = self.fields();
        let complaint = fields.values().find_map(|field| field.as_ref().err())?;
        Some(unlike("landmarks alone move the mesh", complaint))
    }

    fn fields(&self) -> MutexGuard<'_, BTreeMap<&'static str, Field>> {
        self.fields.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Names this face in what is kept of it and no control changes.
    pub(crate) fn cache_key_of_mesh(&self) -> CacheKey {
        let options = FaceOptions {
            controls: Controls::default(),
            ..self.options.clone()
        };
        face_cache::key_of_face(&self.key, &options, &self.landmarks)
    }

    /// Names this face in what is kept of it.
    pub(crate) fn cache_key(&self) -> CacheKey {
        face_cache::key_of_face(&self.key, &self.options, &self.landmarks)
    }
}

/// That no head is like a face, and what happens instead.
pub(crate) fn unlike(instead: &str, complaint: &str) -> String {
    format!("no head of the model is like this face, {instead}: {complaint}")
}

/// What is in `cell`, or what `make` makes. Two threads at once may both make it; one result stays.
fn once<T>(cell: &OnceLock<T>, make: impl FnOnce() -> Result<T>) -> Result<&T> {
    match cell.get() {
        Some(made) => Ok(made),
        None => {
            let made = make()?;
            Ok(cell.get_or_init(|| made))
        }
    }
}
