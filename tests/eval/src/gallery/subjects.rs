//! The heads of a gallery: mesh files as artists make them, and faces whose true motion is known.

use std::{ops::Range, path::Path};

use ndarray::{Array3, Axis};

use super::expressions::{BLINK, Expression, HEARD_EMOTIONS, MOVEMENTS};
use crate::{console::Console, face_model::FaceModel};
use anyface::{
    Error, Result,
    diffusion::frame_noise,
    face::FaceOptions,
    head::HeadMaker,
    mesh::{LandmarkSource, Mesh, ibug::LANDMARKS},
};

/// Seed of the ICT identity, which was not drawn in any training.
const IDENTITY_SEED: u64 = 20_261;

/// A mesh, and what is known about it.
pub(crate) struct Subject {
    pub title: String,
    pub mesh: Mesh,
    pub options: FaceOptions,
    pub truth: Option<Truth>,
    /// Numbers of its vertices, where they are known.
    pub tongue: Range<usize>,
}

/// True motion, mesh units.
#[derive(Clone)]
pub(crate) struct Truth {
    /// `[E, V, 3]`, for each expression.
    pub displacements: Array3<f32>,
    /// Vertex of each landmark.
    pub landmarks: [u32; LANDMARKS],
    /// Millimetres per mesh unit.
    pub mm: f32,
}

impl Truth {
    /// `[E, 68, 3]`, the true motion of the landmarks.
    pub(crate) fn of_landmarks(&self) -> Array3<f32> {
        let rows = self.landmarks.map(|v| v as usize);
        self.displacements.select(Axis(1), &rows)
    }
}

/// The heads that `anyface head` makes from the seeds 1 to `count`, with the models of the folder
/// `weights` if one is given.
pub(crate) fn of_seeds(weights: Option<&Path>, count: u64) -> Result<Vec<Subject>> {
    let maker = HeadMaker::open(weights)?;
    let subject = |seed| {
        let head = maker.mesh(&maker.random(seed), true)?;
        let tongue = head.objects.iter().find(|(name, _)| name == "tongue");
        Ok(Subject {
            title: format!("seed {seed}"),
            mesh: head.mesh,
            options: FaceOptions {
                landmarks: Some(LandmarkSource::Positions(head.landmarks.positions.to_vec())),
                ..FaceOptions::default()
            },
            truth: None,
            tongue: tongue.map_or(0..0, |(_, vertices)| vertices.clone()),
        })
    };
    (1..=count).map(subject).collect()
}

/// The results of `measure` for each subject. If a subject's face is not found, the reason is
/// reported and the subject left out.
pub(crate) fn measured<T>(
    subjects: &[Subject],
    console: &Console,
    measure: impl Fn(&Subject) -> Result<T>,
) -> Result<Vec<T>> {
    let mut rows = Vec::new();
    for (k, subject) in subjects.iter().enumerate() {
        console.stage(&subject.title, k as f32 / subjects.len() as f32);
        match measure(subject) {
            Ok(row) => rows.push(row),
            Err(Error::FaceNotFound(why)) => console.stage(&why, 1.0),
            Err(other) => return Err(other),
        }
    }
    Ok(rows)
}

/// Every mesh file in a folder, sorted by name.
pub(crate) fn of_folder(folder: &Path) -> Result<Vec<Subject>> {
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let mut paths: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    paths.retain(|path| {
        path.extension()
            .is_some_and(|e| e == "obj" || e == "ply" || e == "glb")
    });
    paths.sort();
    let subject = |path: &std::path::PathBuf| {
        Ok(Subject {
            title: path
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            mesh: Mesh::read(path)?,
            options: FaceOptions::default(),
            truth: None,
            tongue: 0..0,
        })
    };
    paths.iter().map(subject).collect()
}

/// The default head with its own landmarks.
pub(crate) fn default_head(folder: &Path) -> Result<Subject> {
    Ok(Subject {
        title: "default head".into(),
        mesh: Mesh::read(folder.join("head.obj"))?,
        options: FaceOptions {
            landmarks: Some(LandmarkSource::read(&folder.join("landmarks.json"))?),
            ..FaceOptions::default()
        },
        truth: None,
        tongue: 0..0,
    })
}

/// An ICT identity that was not drawn in any training, and MakeHuman's head. Each comes twice: with
/// its own landmarks, and with landmarks that are searched for.
pub(crate) fn of_known_faces(data: &Path) -> Result<Vec<Subject>> {
    let twice = known_faces(data, &MOVEMENTS)?.into_iter().flat_map(|face| {
        let title = |landmarks: &str| format!("{}, landmarks {landmarks}", face.title);
        let searched = Subject {
            title: title("found"),
            mesh: face.mesh.clone(),
            options: FaceOptions::default(),
            truth: face.truth.clone(),
            tongue: 0..0,
        };
        let known = Subject {
            title: title("given"),
            ..face
        };
        [known, searched]
    });
    Ok(twice.collect())
}

/// The same two heads under six emotions, each with its own landmarks.
pub(crate) fn with_emotions(data: &Path) -> Result<Vec<Subject>> {
    known_faces(data, &HEARD_EMOTIONS)
}

/// The same two heads under their artists' own shapes: a blink, then the six emotions.
pub(crate) fn with_blink_and_emotions(data: &Path) -> Result<Vec<Subject>> {
    let expressions: Vec<_> = std::iter::once(BLINK).chain(HEARD_EMOTIONS).collect();
    known_faces(data, &expressions)
}

fn known_faces(data: &Path, expressions: &[Expression]) -> Result<Vec<Subject>> {
    let (ict, makehuman) = (FaceModel::ict(data)?, FaceModel::makehuman(data)?);
    let identity = frame_noise(IDENTITY_SEED, 0, 1, ict.identities())
        .into_iter()
        .collect();
    let faces = [
        ("ICT, unseen identity", ict, identity),
        ("MakeHuman", makehuman, Vec::new()),
    ];
    let subjects = faces.into_iter().map(|(title, face, identity)| {
        Ok(Subject {
            title: title.into(),
            mesh: face.mesh(&identity)?,
            options: face.options(),
            truth: Some(truth(&face, expressions)?),
            tongue: 0..0,
        })
    });
    subjects.collect()
}

fn truth(face: &FaceModel, expressions: &[Expression]) -> Result<Truth> {
    let mut displacements = Array3::zeros((expressions.len(), face.neutral.nrows(), 3));
    for (expression, mut frame) in expressions.iter().zip(displacements.outer_iter_mut()) {
        for (channel, weight) in expression.channels {
            face.add(channel, *weight, frame.view_mut())?;
        }
    }
    Ok(Truth {
        displacements,
        landmarks: face.landmarks,
        mm: face.mm,
    })
}
