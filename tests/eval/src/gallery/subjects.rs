//! Heads of a gallery: files as artists have them, and faces whose true motion is known.

use std::path::Path;

use ndarray::{Array2, Array3, Axis};

use super::expressions::{Expression, FEELINGS, MOVEMENTS};
use crate::tensors::TensorFile;
use anyface::{
    Error, Result,
    diffusion::frame_noise,
    ibug::LANDMARKS,
    mesh::{FaceOptions, LandmarkSource, Mesh},
};

/// Seed of the identity, which no training drew.
const IDENTITY_SEED: u64 = 20_261;

/// A mesh, and what is known of it.
pub(super) struct Subject {
    pub title: String,
    pub mesh: Mesh,
    pub options: FaceOptions,
    pub truth: Option<Truth>,
}

/// True motion, mesh units.
pub(super) struct Truth {
    /// `[E, V, 3]`, of each expression.
    pub displacements: Array3<f32>,
    /// Vertex of each landmark.
    pub landmarks: [u32; LANDMARKS],
    /// Millimetres of a mesh unit.
    pub mm: f32,
}

/// Every mesh file in a folder, by name.
pub(super) fn of_folder(folder: &Path) -> Result<Vec<Subject>> {
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
        })
    };
    paths.iter().map(subject).collect()
}

/// The default head with its own landmarks.
pub(super) fn default_head(folder: &Path) -> Result<Subject> {
    Ok(Subject {
        title: "default head".into(),
        mesh: Mesh::read(folder.join("head.obj"))?,
        options: FaceOptions {
            landmarks: Some(LandmarkSource::read(&folder.join("landmarks.json"))?),
            ..FaceOptions::default()
        },
        truth: None,
    })
}

/// An ICT identity that no training drew and MakeHuman's head; each with its own landmarks and
/// with landmarks that are found.
pub(super) fn of_known_faces(data: &Path) -> Result<Vec<Subject>> {
    let faces = [
        ("ICT, unseen identity", ict(data, &MOVEMENTS)?),
        ("MakeHuman", makehuman(data, &MOVEMENTS)?),
    ];
    let twice = faces.into_iter().flat_map(|(name, (mesh, truth))| {
        [true, false].map(|given| Subject {
            title: format!(
                "{name}, landmarks {}",
                if given { "given" } else { "found" }
            ),
            mesh: mesh.clone(),
            options: FaceOptions {
                landmarks: given.then(|| LandmarkSource::Vertices(truth.landmarks.to_vec())),
                ..FaceOptions::default()
            },
            truth: Some(Truth {
                displacements: truth.displacements.clone(),
                ..truth
            }),
        })
    });
    Ok(twice.collect())
}

/// The same two with six feelings, each with its own landmarks.
pub(super) fn with_feelings(data: &Path) -> Result<Vec<Subject>> {
    let faces = [
        ("ICT, unseen identity", ict(data, &FEELINGS)?),
        ("MakeHuman", makehuman(data, &FEELINGS)?),
    ];
    let subjects = faces.into_iter().map(|(name, (mesh, truth))| Subject {
        title: name.into(),
        mesh,
        options: FaceOptions {
            landmarks: Some(LandmarkSource::Vertices(truth.landmarks.to_vec())),
            ..FaceOptions::default()
        },
        truth: Some(truth),
    });
    Ok(subjects.collect())
}

fn ict(data: &Path, expressions: &[Expression]) -> Result<(Mesh, Truth)> {
    let file = TensorFile::read(&data.join("faces/ict_facekit.safetensors"))?;
    let (mut neutral, shape) = file.floats("neutral")?;
    let (identity, people) = file.floats("identity")?;
    let coefficients = frame_noise(IDENTITY_SEED, 0, 1, people[0]);
    for (mode, amount) in identity.chunks(3 * shape[0]).zip(&coefficients) {
        for (x, offset) in neutral.iter_mut().zip(mode) {
            *x += amount * offset;
        }
    }
    let names = file.words("expression_names")?;
    let (modes, _) = file.floats("expression")?;
    let number = |name: &str| names.iter().position(|n| n == name);
    let key = |name: &str| -> Vec<usize> {
        let sided = name.replace("Left", "_L").replace("Right", "_R");
        if let Some(one) = number(name).or_else(|| number(&sided)) {
            return vec![one];
        }
        // A name without a side, such as `browInnerUp`, is both sides together.
        let sides = ["_L", "_R"].into_iter();
        sides
            .filter_map(|side| number(&format!("{name}{side}")))
            .collect()
    };
    face(&file, (neutral, &modes), expressions, &key, 10.0)
}

fn makehuman(data: &Path, expressions: &[Expression]) -> Result<(Mesh, Truth)> {
    let file = TensorFile::read(&data.join("faces/makehuman_head.safetensors"))?;
    let (neutral, _) = file.floats("neutral")?;
    let names = file.words("names")?;
    let (modes, _) = file.floats("deltas")?;
    let key = |name: &str| names.iter().position(|n| n == name).into_iter().collect();
    face(&file, (neutral, &modes), expressions, &key, 100.0)
}

/// `key`: the numbers of a channel's modes. `mm`: of the file's unit.
fn face(
    file: &TensorFile,
    (neutral, modes): (Vec<f32>, &[f32]),
    expressions: &[Expression],
    key: &dyn Fn(&str) -> Vec<usize>,
    mm: f32,
) -> Result<(Mesh, Truth)> {
    let (triangles, _) = file.floats("triangles")?;
    let (landmarks, _) = file.floats("landmarks68")?;
    let whole: Vec<u32> = triangles.iter().map(|x| *x as u32).collect();
    let mesh = Mesh::from_arrays(
        neutral
            .chunks_exact(3)
            .map(|p| [p[0], p[1], p[2]])
            .collect(),
        whole.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    )?;
    let vertices = mesh.positions.len();
    let mut displacements = Array3::zeros((expressions.len(), vertices, 3));
    for (e, expression) in expressions.iter().enumerate() {
        for (channel, weight) in expression.channels {
            let found = key(channel);
            if found.is_empty() {
                return Err(file.bad(&format!("expected a mode {channel}, got none")));
            }
            for mode in found {
                let values = &modes[mode * 3 * vertices..(mode + 1) * 3 * vertices];
                let values = Array2::from_shape_fn((vertices, 3), |(v, i)| values[3 * v + i]);
                displacements
                    .index_axis_mut(Axis(0), e)
                    .scaled_add(*weight, &values);
            }
        }
    }
    let landmarks = landmarks.iter().map(|x| *x as u32).collect::<Vec<_>>();
    let truth = Truth {
        displacements,
        landmarks: landmarks
            .try_into()
            .map_err(|_| file.bad("expected 68 landmarks"))?,
        mm,
    };
    Ok((mesh, truth))
}
