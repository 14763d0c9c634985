//! Makes every shape of one mesh.

use std::collections::BTreeMap;

use ndarray::{Array2, Array3, ArrayView2, Axis};
use rayon::prelude::*;
use serde::Deserialize;

use super::{
    ARKIT, SHAPES, VISEMES,
    decoded::{Learned, fold, move_jaw},
    lids,
    names::arkit,
    network::{RigConfig, RigNetwork, SkinGeometry},
    parts::{Eyeball, Gaze, TongueFound, eyeballs, tongue},
    visemes::mixtures,
};
use crate::{
    Error, Result,
    face::{Deformer, Face, FaceSurface, Rig, ShapeReport, binding::Follows, eyes::SQUINT_M},
    job::{ProgressFn, SILENT, report},
    mesh::{Similarity, features::Features, ibug::LANDMARKS},
    models::{BuiltIn, Weights},
};

/// The built-in weights of the rig model.
pub static MODEL: BuiltIn = BuiltIn::new(&anyface_weights_shared::RIG);
/// Vertices whose shapes are computed at a time.
const VERTICES_PER_TASK: usize = 1024;
/// Landmarks whose weights one call of the deformer measures.
const LANDMARKS_PER_PROBE: usize = 17;

/// The trained network, and the mixtures of the visemes that all rigs share.
pub struct RigModel {
    network: RigNetwork,
    /// `[15, 52]`.
    visemes: Array2<f32>,
}

#[derive(Deserialize)]
struct Config {
    #[serde(flatten)]
    network: RigConfig,
    visemes: BTreeMap<String, BTreeMap<String, f32>>,
}

impl RigModel {
    /// Opens the built-in model, or the one in `folder/rig`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing, damaged, or does not fit the other.
    pub fn open(folder: Option<&std::path::Path>) -> Result<Self> {
        let files = MODEL.open(folder)?;
        let config: Config = serde_json::from_str(&files.config)
            .map_err(|error| Error::Weights(format!("{}/config.json: {error}", MODEL.name)))?;
        let network = RigNetwork::new(&config.network, &Weights::from_bytes(&files.weights)?)?;
        let unknown = network
            .shapes()
            .iter()
            .find(|name| !ARKIT.contains(&name.as_str()));
        if let Some(name) = unknown {
            return Err(Error::Weights(format!(
                "{}/config.json: no ARKit shape {name}",
                MODEL.name
            )));
        }
        Ok(RigModel {
            network,
            visemes: mixtures(&config.visemes)?,
        })
    }

    /// Makes the shapes of a face. `plain` spreads landmark motion over the face with the
    /// training-free weights that the network was trained with. `learned` folds the forehead.
    ///
    /// # Errors
    /// `Mesh` if the landmarks lie on no usable face, `Cancelled`.
    pub fn make(
        &self,
        face: &Face,
        plain: &dyn Deformer,
        learned: &Learned<'_>,
        progress: ProgressFn<'_>,
    ) -> Result<Rig> {
        report(progress, "shapes", 0.0)?;
        let head = face.surface()?;
        let vertices = head.positions.len();
        let mut deltas = Array3::zeros((SHAPES, vertices, 3));
        let base = landmark_weights(face, plain, progress)?;
        self.move_skin(head, base.view(), &mut deltas);
        fold(face, head, learned, &mut deltas)?;
        leave_out(&face.features(), &mut deltas);
        move_jaw(face, head, plain, &mut deltas)?;
        report(progress, "shapes", 0.8)?;
        lids::meet(&mut deltas, &head.landmarks, &face.landmarks.vertices);
        let squint = (face.openings().can_close(), 100.0 * SQUINT_M);
        lids::rest(
            &mut deltas,
            squint,
            &face.landmarks.vertices,
            &head.positions,
        );
        let parts = &face.parts.connected;
        let eyes = eyeballs(&head.positions, parts, &head.follows, &head.landmarks);
        let tongue = tongue(&head.positions, &face.parts, &head.landmarks);
        turn_eyes(&eyes, &head.positions, &mut deltas);
        if let TongueFound::Own(tongue) = &tongue {
            let mut shape = deltas.index_axis_mut(Axis(0), arkit("tongueOut"));
            for (&v, moved) in tongue.vertices.iter().zip(&tongue.out) {
                shape.row_mut(v as usize).assign(&ndarray::arr1(moved));
            }
        }
        self.mix_visemes(&mut deltas);
        to_mesh(&mut deltas, &face.to_canonical);
        report(progress, "shapes", 1.0)?;
        let scale = face.to_canonical.scale as f32;
        Ok(Rig::new(deltas, scale, &eyes, &tongue).with_notes_of(&face.features()))
    }

    /// Moves the skin and what follows it, centimetres. `base`: landmark weights `[V, 68]`.
    fn move_skin(&self, head: &FaceSurface, base: ArrayView2<'_, f32>, deltas: &mut Array3<f32>) {
        let skin = head.followed();
        let landmarks = head.landmarks.map(|p| p.map(|x| 0.1 * x));
        let pieces: Vec<Array2<f32>> = skin
            .par_chunks(VERTICES_PER_TASK)
            .map(|vertices| {
                let positions: Vec<[f32; 3]> = vertices
                    .iter()
                    .map(|&v| head.positions[v as usize].map(|x| 0.1 * x))
                    .collect();
                let rows: Vec<usize> = vertices.iter().map(|&v| v as usize).collect();
                self.network.forward(SkinGeometry {
                    positions: &positions,
                    landmarks: &landmarks,
                    base: base.select(Axis(0), &rows).view(),
                })
            })
            .collect();
        let mut row_of_vertex = vec![usize::MAX; head.positions.len()];
        skin.iter()
            .enumerate()
            .for_each(|(row, &v)| row_of_vertex[v as usize] = row);
        let place: Vec<usize> = self
            .network
            .shapes()
            .iter()
            .map(|name| arkit(name))
            .collect();
        for (v, follows) in head.follows.iter().enumerate() {
            let Follows::Skin(corners) = *follows else {
                continue;
            };
            for (of, share) in corners.into_iter().filter(|(_, share)| *share != 0.0) {
                let row = row_of_vertex[of as usize];
                let moved = pieces[row / VERTICES_PER_TASK].row(row % VERTICES_PER_TASK);
                for (s, &shape) in place.iter().enumerate() {
                    for axis in 0..3 {
                        deltas[[shape, v, axis]] += 10.0 * share * moved[3 * s + axis];
                    }
                }
            }
        }
    }

    /// Weight of each ARKit shape in each viseme, `[15, 52]`.
    pub(crate) fn visemes(&self) -> &Array2<f32> {
        &self.visemes
    }

    fn mix_visemes(&self, deltas: &mut Array3<f32>) {
        let (arkit, mut visemes) = deltas.view_mut().split_at(Axis(0), ARKIT.len());
        for (mixture, mut viseme) in self
            .visemes
            .rows()
            .into_iter()
            .zip(visemes.outer_iter_mut())
        {
            for (&weight, shape) in mixture.iter().zip(arkit.outer_iter()) {
                if weight != 0.0 {
                    viseme.scaled_add(weight, &shape);
                }
            }
        }
    }
}

impl Rig {
    fn new(deltas: Array3<f32>, scale: f32, eyes: &[Eyeball], tongue: &TongueFound) -> Rig {
        let names: Vec<String> = ARKIT
            .iter()
            .chain(&VISEMES)
            .map(|n| (*n).to_owned())
            .collect();
        let reports = names.iter().zip(deltas.outer_iter()).map(|(name, shape)| {
            let note_of = |present| note(name, present, eyes, tongue).map(str::to_owned);
            ShapeReport::of(name, shape, scale, note_of)
        });
        Rig {
            reports: reports.collect(),
            names,
            deltas,
        }
    }

    /// Adds a note to each shape that does not move because its feature was not found on the face.
    fn with_notes_of(mut self, features: &Features) -> Rig {
        for report in &mut self.reports {
            if !report.present && features.of_shape(&report.name) == 0.0 {
                report.note = Some("what it moves was not found on this face".into());
            }
        }
        self
    }
}

/// Scales down the shapes of features that the face lacks, in place.
fn leave_out(features: &Features, deltas: &mut Array3<f32>) {
    for (name, mut shape) in ARKIT.iter().zip(deltas.outer_iter_mut()) {
        let share = features.of_shape(name);
        if share < 1.0 {
            shape.mapv_inplace(|x| share * x);
        }
    }
}

/// Why a shape does not move, or which of its parts do not.
fn note(name: &str, present: bool, eyes: &[Eyeball], tongue: &TongueFound) -> Option<&'static str> {
    let has_eye = |is_left| eyes.iter().any(|eye| eye.is_left == is_left);
    match (name, tongue) {
        ("viseme_sil", _) => Some("silence is the neutral face"),
        ("tongueOut", tongue) if tongue.complaint().is_some() => tongue.complaint(),
        _ if name.starts_with("eyeLook") && !has_eye(name.ends_with("Left")) => {
            Some("no eyeball was found on this side: only the lids move")
        }
        _ if !present => Some("too little of the face lies near these landmarks"),
        _ => None,
    }
}

/// `W`: how much each vertex moves along with each landmark, `[V, 68]`, measured with the deformer.
fn landmark_weights(
    face: &Face,
    plain: &dyn Deformer,
    progress: ProgressFn<'_>,
) -> Result<Array2<f32>> {
    // A millimetre on a human head: small enough for a deformer that bends with large motion.
    let step = (1e-3 / face.to_canonical.scale) as f32;
    let mut out = Array2::zeros((face.mesh.positions.len(), LANDMARKS));
    for first in (0..LANDMARKS).step_by(LANDMARKS_PER_PROBE) {
        let mut probe = Array3::zeros((LANDMARKS_PER_PROBE, LANDMARKS, 3));
        (0..LANDMARKS_PER_PROBE).for_each(|i| probe[[i, first + i, 0]] = step);
        let moved = plain.deform_freely(probe.view(), SILENT)?;
        for (i, frame) in moved.outer_iter().enumerate() {
            let column = frame.index_axis(Axis(1), 0).mapv(|x| x / step);
            out.column_mut(first + i).assign(&column);
        }
        let done = (first + LANDMARKS_PER_PROBE) as f32 / LANDMARKS as f32;
        report(progress, "shapes", 0.2 + 0.2 * done)?;
    }
    Ok(out)
}

/// Turns each eye in its four directions; centimetres.
fn turn_eyes(eyes: &[Eyeball], positions: &[[f32; 3]], deltas: &mut Array3<f32>) {
    for eye in eyes {
        let side = if eye.is_left { "Left" } else { "Right" };
        for (gaze, name) in [
            (Gaze::Up, "Up"),
            (Gaze::Down, "Down"),
            (Gaze::In, "In"),
            (Gaze::Out, "Out"),
        ] {
            let mut shape = deltas.index_axis_mut(Axis(0), arkit(&format!("eyeLook{name}{side}")));
            for &v in &eye.vertices {
                let moved = eye.look(gaze, positions[v as usize]);
                shape.row_mut(v as usize).assign(&ndarray::arr1(&moved));
            }
        }
    }
}

/// Converts canonical centimetres to the mesh's own units and axes, in place.
fn to_mesh(deltas: &mut Array3<f32>, to_canonical: &Similarity) {
    for mut shape in deltas.outer_iter_mut() {
        let metres = shape.mapv(|x| 0.01 * x).insert_axis(Axis(0));
        let mesh_deltas = to_canonical.displacements_to_mesh(metres.view());
        shape.assign(&mesh_deltas.index_axis(Axis(0), 0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        CachePolicy, Engine, EngineOptions,
        face::FaceOptions,
        job::SILENT,
        mesh::{LandmarkSource, Mesh, ibug::MIRROR},
        rig::{ShapeSource, mirrored_name},
        spread::{Collector, Movement},
    };
    use std::path::Path;

    /// The default head and its landmarks.
    fn head() -> (Mesh, Vec<[f32; 3]>) {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head");
        let mesh = Mesh::read(folder.join("head.obj")).unwrap();
        let landmarks = match LandmarkSource::read(&folder.join("landmarks.json")).unwrap() {
            LandmarkSource::Positions(positions) => positions,
            LandmarkSource::Vertices(vertices) => vertices
                .iter()
                .map(|&v| mesh.positions[v as usize])
                .collect(),
            LandmarkSource::Known(known) => {
                known.iter().map(|landmark| landmark.position).collect()
            }
        };
        (mesh, landmarks)
    }

    fn make(mesh: &Mesh, landmarks: Vec<[f32; 3]>) -> Rig {
        let (engine, face) = prepared(mesh, landmarks);
        Rig::clone(&engine.rig(&face, ShapeSource::Network, SILENT).unwrap())
    }

    fn prepared(mesh: &Mesh, landmarks: Vec<[f32; 3]>) -> (Engine, Face) {
        let engine = Engine::new(EngineOptions {
            cache: CachePolicy::Off,
            ..EngineOptions::default()
        });
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::Positions(landmarks)),
            ..FaceOptions::default()
        };
        let engine = engine.unwrap();
        let face = engine.find(mesh, &options, SILENT).unwrap();
        (engine, face)
    }

    #[test]
    fn raised_and_lowered_brows_fold_the_forehead_as_the_decoder_does() {
        let (mesh, landmarks) = head();
        let (engine, face) = prepared(&mesh, landmarks.clone());
        let rig = engine.rig(&face, ShapeSource::Network, SILENT).unwrap();
        for name in ["browInnerUp", "browDownLeft", "browDownRight"] {
            let shape = rig.deltas.index_axis(Axis(0), arkit(name));
            folds_as_decoded(name, shape, &engine, &face, landmarks[21][1]);
        }
    }

    /// Checks that above `height` the shape equals the decoder's motion for its landmarks.
    fn folds_as_decoded(
        name: &str,
        shape: ArrayView2<'_, f32>,
        engine: &Engine,
        face: &Face,
        height: f32,
    ) {
        let motion = Array3::from_shape_fn((1, LANDMARKS, 3), |(_, n, i)| {
            shape[[face.landmarks.vertices[n] as usize, i]]
        });
        let collected = Collector::collect(|sink| {
            engine.spread(
                face,
                Movement::Own {
                    landmarks: motion,
                    fps: 1.0,
                },
                sink,
                SILENT,
            )
        });
        let decoded = collected.unwrap().vertices.displacements;
        let mm = 1000.0 * face.to_canonical.scale as f32;
        let positions = &face.mesh.positions;
        let forehead = (0..positions.len()).filter(|&v| positions[v][1] > height);
        let off = forehead.filter_map(|v| {
            let length = |x: [f32; 3]| mm * x.iter().map(|x| x * x).sum::<f32>().sqrt();
            let rig = [0, 1, 2].map(|i| shape[[v, i]]);
            let apart = [0, 1, 2].map(|i| rig[i] - decoded[[0, v, i]]);
            (length(rig) > 0.5).then(|| length(apart))
        });
        let off = Vec::from_iter(off);
        let mean = off.iter().sum::<f32>() / off.len() as f32;
        assert!(
            off.len() > 100 && mean < 0.1,
            "{name}: {mean} mm at {} vertices",
            off.len()
        );
    }

    #[test]
    fn every_shape_of_the_default_head_moves_and_its_mirror_image_moves_alike() {
        let (mesh, landmarks) = head();
        let rig = make(&mesh, landmarks.clone());
        for report in rig.reports.iter().filter(|r| r.name != "viseme_sil") {
            assert!(report.largest_mm > 2.0 && report.present, "{report:?}");
        }
        let flip = |p: [f32; 3]| [-p[0], p[1], p[2]];
        let reflected = Mesh {
            positions: mesh.positions.iter().map(|&p| flip(p)).collect(),
            triangles: mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(),
        };
        let mirrored = make(
            &reflected,
            (0..LANDMARKS).map(|n| flip(landmarks[MIRROR[n]])).collect(),
        );
        for (s, name) in rig.names.iter().enumerate() {
            let other = rig
                .names
                .iter()
                .position(|n| *n == mirrored_name(name))
                .unwrap();
            let largest = rig.reports[s].largest.max(1e-6);
            for v in (0..mesh.positions.len()).step_by(7) {
                for axis in 0..3 {
                    let side = if axis == 0 { -1.0 } else { 1.0 };
                    let off = rig.deltas[[s, v, axis]] - side * mirrored.deltas[[other, v, axis]];
                    assert!(off.abs() < 0.05 * largest, "{name} {v}: {off} of {largest}");
                }
            }
        }
    }

    #[test]
    fn teeth_follow_the_jaw_eyes_turn_and_the_tongue_comes_out() {
        let (mesh, landmarks) = head();
        let rig = make(&mesh, landmarks);
        let centimetre = 0.01 / (rig.reports[0].largest_mm * 1e-3 / rig.reports[0].largest);
        let moved = |name: &str, range: std::ops::Range<usize>, axis: usize| {
            let shape = rig.deltas.index_axis(Axis(0), arkit(name));
            let sum: f32 = range.clone().map(|v| shape[[v, axis]]).sum();
            sum / range.len() as f32 / centimetre
        };
        let objects = parts_of_default_head();
        let (lower, upper) = (
            objects["teeth_lower"].clone(),
            objects["teeth_upper"].clone(),
        );
        assert!(moved("jawOpen", lower, 1) < -1.0 && moved("jawOpen", upper, 1) == 0.0);
        assert!(moved("tongueOut", objects["tongue"].clone(), 2) > 0.5);
        let eye = objects["eye_left"].clone();
        assert!(moved("eyeLookUpLeft", eye.clone(), 2).abs() < 0.3);
        let front = eye
            .clone()
            .max_by(|&a, &b| mesh.positions[a][2].total_cmp(&mesh.positions[b][2]));
        let front = front.unwrap();
        assert!(moved("eyeLookUpLeft", front..front + 1, 1) > 0.3);
        assert!(moved("eyeLookOutLeft", front..front + 1, 0) > 0.3);
        assert_eq!(moved("eyeBlinkLeft", eye, 1), 0.0);
    }

    /// The range of vertices of each object in the file.
    fn parts_of_default_head() -> BTreeMap<String, std::ops::Range<usize>> {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/shared/default_head/head.obj");
        let text = std::fs::read_to_string(path).unwrap();
        let (mut parts, mut count) = (BTreeMap::new(), 0);
        let mut name = String::new();
        for line in text.lines() {
            if let Some(object) = line.strip_prefix("o ") {
                name = object.to_owned();
                parts.insert(name.clone(), count..count);
            } else if line.starts_with("v ") {
                count += 1;
                parts.get_mut(&name).unwrap().end = count;
            }
        }
        parts
    }
}
