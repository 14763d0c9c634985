//! Turns heads at random and checks whether the search finds their landmarks in the right place,
//! refuses them, or finds them in a wrong place.

use std::path::PathBuf;

use anyface::{
    Error, Result,
    diffusion::frame_noise,
    face::locate_landmarks_with,
    job::SILENT,
    mesh::{Axis, LandmarkFinder, LandmarkSource, Landmarks, Mesh, Similarity, align_to_canonical},
};
use clap::Args;
use serde::Serialize;

use crate::{
    arguments::{DataArgs, SharedArgs},
    console::Console,
    gallery::subjects::{self, Subject},
    vertex_motion::distance,
};

/// Search landmarks on heads turned at random, and count those found right, refused or found wrong
#[derive(Args)]
pub(super) struct Turned {
    #[command(flatten)]
    data: DataArgs,
    /// The default head: head.obj and landmarks.json
    #[arg(
        long,
        value_name = "DIR",
        default_value = "weights/shared/default_head"
    )]
    head: PathBuf,
    /// A folder of further meshes; NAME.landmarks.json may hold the true landmarks of NAME.obj
    #[arg(long, value_name = "DIR")]
    also: Vec<PathBuf>,
    /// Number of heads to make as `anyface head` does, from seed 1 on
    #[arg(long = "made", value_name = "N", default_value_t = 3)]
    seeds: u64,
    /// Only heads whose title contains this
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// Rotations of each head
    #[arg(long, value_name = "N", default_value_t = 20)]
    rotations: usize,
    /// Number of the first rotation; rotation 0 is none at all
    #[arg(long, value_name = "K", default_value_t = 1)]
    first: usize,
}

/// Seed of the rotations.
const SEED: u64 = 36;
/// A face within this angle of the true one is right, degrees.
const MAX_TURNED_DEG: f64 = 20.0;
/// A face is wrong if the middle of its mouth lies farther than this from the true one, in widths
/// of the true mouth.
const MAX_ASIDE: f32 = 0.5;

/// Results of one head, by the numbers of the rotations.
#[derive(Serialize)]
struct Row {
    title: String,
    right: usize,
    refused: Vec<usize>,
    wrong: Vec<Wrong>,
}

/// A face that was found in a wrong place or pose.
#[derive(Serialize)]
struct Wrong {
    rotation: usize,
    /// Angle between its pose and the true one, degrees.
    turned_deg: f64,
    /// Distance from the middle of the mouth to the true one, in widths of the true mouth.
    aside: f32,
}

impl Turned {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let finder = LandmarkFinder::load(shared.weights.as_deref())?;
        let mut subjects = vec![subjects::default_head(&self.head)?];
        subjects.extend(subjects::of_seeds(shared.weights.as_deref(), self.seeds)?);
        let mut folders = vec![self.data.folder()?.join("meshes")];
        folders.extend(self.also.iter().cloned());
        for folder in &folders {
            for mut subject in subjects::of_folder(folder)? {
                let beside = folder.join(format!("{}.landmarks.json", subject.title));
                if beside.is_file() {
                    subject.options.landmarks = Some(LandmarkSource::read(&beside)?);
                }
                subjects.push(subject);
            }
        }
        if let Some(text) = &self.only {
            subjects.retain(|subject| subject.title.contains(text));
        }
        let rows = subjects::measured(&subjects, console, |subject| {
            let row = self.row(&finder, subject)?;
            console.stage(&line(&row), 1.0);
            Ok(row)
        })?;
        let mut lines: Vec<String> = rows.iter().map(line).collect();
        let count = |of: &dyn Fn(&Row) -> usize| rows.iter().map(of).sum::<usize>();
        lines.push(format!(
            "all: right {}, refused {}, wrong {}",
            count(&|row| row.right),
            count(&|row| row.refused.len()),
            count(&|row| row.wrong.len())
        ));
        console.value(&rows, &lines.join("\n"));
        Ok(())
    }

    fn row(&self, finder: &LandmarkFinder, subject: &Subject) -> Result<Row> {
        let truth = truth(finder, subject)?;
        let mut row = Row {
            title: subject.title.clone(),
            right: 0,
            refused: Vec::new(),
            wrong: Vec::new(),
        };
        for rotation in self.first..self.first + self.rotations {
            let turn = random_turn(rotation);
            let mesh = Mesh {
                positions: moved(&turn, &subject.mesh.positions),
                triangles: subject.mesh.triangles.clone(),
            };
            match finder.find(&mesh, Axis::PosZ, Axis::PosY, &[], SILENT) {
                Err(Error::FaceNotFound(_)) => row.refused.push(rotation),
                Err(other) => return Err(other),
                Ok(landmarks) => {
                    let (turned_deg, aside) = apart(&truth, &landmarks, &turn)?;
                    if turned_deg > MAX_TURNED_DEG || aside > MAX_ASIDE {
                        row.wrong.push(Wrong {
                            rotation,
                            turned_deg,
                            aside,
                        })
                    } else {
                        row.right += 1
                    }
                }
            }
        }
        Ok(row)
    }
}

/// The true landmarks of a head: from its files, or as the search finds them while it is upright.
///
/// # Errors
/// `FaceNotFound` if there are none in its files and the search refuses the upright head too.
fn truth(finder: &LandmarkFinder, subject: &Subject) -> Result<Landmarks> {
    let landmarks = locate_landmarks_with(finder, &subject.mesh, &subject.options, SILENT);
    landmarks.map_err(|error| match error {
        Error::FaceNotFound(why) => Error::FaceNotFound(format!(
            "{}: left out, since it is refused upright too: {why}",
            subject.title
        )),
        other => other,
    })
}

/// Compares landmarks found on a turned mesh with the true ones: the angle between their poses in
/// degrees, and the distance between the middles of the mouths in widths of the true mouth.
fn apart(truth: &Landmarks, landmarks: &Landmarks, turn: &Similarity) -> Result<(f64, f32)> {
    let step = align_to_canonical(landmarks)?
        .compose(turn)
        .compose(&align_to_canonical(truth)?.inverse());
    let trace: f64 = (0..3).map(|i| step.rotation[i][i]).sum();
    let middle = |landmarks: &Landmarks| -> [f32; 3] {
        let mouth = &landmarks.positions[48..];
        std::array::from_fn(|i| mouth.iter().map(|p| p[i]).sum::<f32>() / mouth.len() as f32)
    };
    let width = distance(truth.positions[48], truth.positions[54]);
    let aside =
        distance(middle(landmarks), turn.apply(middle(truth))) / width.max(f32::MIN_POSITIVE);
    Ok((
        (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos().to_degrees(),
        aside,
    ))
}

/// Rotation number `k`, uniform over all rotations; number 0 is none.
fn random_turn(k: usize) -> Similarity {
    if k == 0 {
        return Similarity::IDENTITY;
    }
    let noise = frame_noise(SEED, k, 1, 4);
    let length = noise.iter().map(|x| x * x).sum::<f32>().sqrt();
    let [w, x, y, z] = std::array::from_fn(|i| f64::from(noise[[0, i]] / length));
    Similarity {
        rotation: [
            [
                1.0 - 2.0 * (y * y + z * z),
                2.0 * (x * y - w * z),
                2.0 * (x * z + w * y),
            ],
            [
                2.0 * (x * y + w * z),
                1.0 - 2.0 * (x * x + z * z),
                2.0 * (y * z - w * x),
            ],
            [
                2.0 * (x * z - w * y),
                2.0 * (y * z + w * x),
                1.0 - 2.0 * (x * x + y * y),
            ],
        ],
        ..Similarity::IDENTITY
    }
}

fn moved(by: &Similarity, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
    positions.iter().map(|p| by.apply(*p)).collect()
}

fn line(row: &Row) -> String {
    let wrong = row.wrong.iter().map(|w| {
        format!(
            "{} ({:.0}°, mouth {:.1} aside)",
            w.rotation, w.turned_deg, w.aside
        )
    });
    format!(
        "{:>26} right {:3}  refused {:?}  wrong {}: {}",
        row.title,
        row.right,
        row.refused,
        row.wrong.len(),
        wrong.collect::<Vec<_>>().join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::mesh::canonical_landmarks;

    fn canonical() -> Landmarks {
        Landmarks {
            positions: *canonical_landmarks(),
            vertices: [0; 68],
            confidence: [1.0; 68],
        }
    }

    #[test]
    fn a_face_found_where_it_is_lies_nowhere_aside_however_it_is_turned() {
        for k in 0..20 {
            let turn = random_turn(k);
            let mut landmarks = canonical();
            landmarks.positions = landmarks.positions.map(|p| turn.apply(p));
            let (degrees, aside) = apart(&canonical(), &landmarks, &turn).unwrap();
            assert!(degrees < 0.1 && aside < 1e-4, "{k}: {degrees} {aside}");
        }
    }

    #[test]
    fn a_face_found_upside_down_is_wrong() {
        let roll = Similarity {
            rotation: [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
            ..Similarity::IDENTITY
        };
        let mut landmarks = canonical();
        landmarks.positions = landmarks.positions.map(|p| roll.apply(p));
        let (degrees, aside) = apart(&canonical(), &landmarks, &Similarity::IDENTITY).unwrap();
        assert!(degrees > 179.0 && aside > MAX_ASIDE, "{degrees} {aside}");
    }
}
