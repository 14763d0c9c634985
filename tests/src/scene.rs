//! A face and a voice from formulas: small, always the same, free of anybody's rights.

use std::{
    f32::consts::TAU,
    fmt::Write as _,
    fs, io,
    path::{Path, PathBuf},
};

use anyface::mesh::{Mesh, canonical_landmarks};

/// Distance between neighbouring vertices.
const STEP_M: f32 = 0.006;
/// Height of the line between the lips.
const MOUTH_Y_M: f32 = -0.0595;
/// Half the length of the slit between the lips.
const MOUTH_HALF_WIDTH_M: f32 = 0.0225;
/// The head in the files is in centimetres.
const UNITS_PER_M: f32 = 100.0;
/// Where the canonical origin lies in the files, centimetres.
const PLACE: [f32; 3] = [3.0, 150.0, -2.0];

/// Files of a scene.
pub struct Scene {
    /// A mask of a face with a mouth that opens, OBJ, centimetres.
    pub head: PathBuf,
    /// Its 68 landmarks, JSON.
    pub landmarks: PathBuf,
    /// A voice, 16-bit WAV.
    pub voice: PathBuf,
}

impl Scene {
    /// Writes the three files into a folder.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn write(folder: &Path, voice_s: f32) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let scene = Scene {
            head: folder.join("head.obj"),
            landmarks: folder.join("landmarks.json"),
            voice: folder.join("voice.wav"),
        };
        fs::write(&scene.head, obj(&mask()))?;
        let points: Vec<[f32; 3]> = canonical_landmarks().iter().map(|p| to_file(*p)).collect();
        fs::write(&scene.landmarks, format!("{points:?}"))?;
        fs::write(&scene.voice, wav(&voice(voice_s), 16_000))?;
        Ok(scene)
    }
}

fn to_file(p: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| p[axis] * UNITS_PER_M + PLACE[axis])
}

/// A grid over the face with the depth of the landmarks and a slit between the lips, metres.
pub fn mask() -> Mesh {
    let half_columns = (0.084 / STEP_M) as i32;
    let (down, up) = (9, 23);
    let columns = (2 * half_columns + 1) as u32;
    let mut mesh = Mesh::default();
    for row in -down..=up {
        for column in -half_columns..=half_columns {
            let (x, y) = (column as f32 * STEP_M, MOUTH_Y_M + row as f32 * STEP_M);
            mesh.positions.push([x, y, depth(x, y)]);
        }
    }
    // The upper lip has its own vertices along the slit.
    let slit = down as u32 * columns;
    let mut upper_lip: Vec<u32> = (slit..slit + columns).collect();
    for number in &mut upper_lip {
        let place = mesh.positions[*number as usize];
        if place[0].abs() < MOUTH_HALF_WIDTH_M {
            *number = mesh.positions.len() as u32;
            mesh.positions.push(place);
        }
    }
    for row in 0..(down + up) as u32 {
        for column in 0..columns - 1 {
            let lower = row * columns + column;
            let [a, b] = if row == down as u32 {
                [upper_lip[column as usize], upper_lip[column as usize + 1]]
            } else {
                [lower, lower + 1]
            };
            let [c, d] = [lower + columns, lower + columns + 1];
            mesh.triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    mesh
}

/// Depth of the face at a point, interpolated between the landmarks by inverse distance.
fn depth(x: f32, y: f32) -> f32 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for [lx, ly, lz] in canonical_landmarks() {
        let weight = ((lx - x).powi(2) + (ly - y).powi(2) + 1e-6).powi(-2);
        sum += weight * lz;
        weights += weight;
    }
    sum / weights
}

fn obj(mesh: &Mesh) -> String {
    let mut text = String::new();
    for p in &mesh.positions {
        let [x, y, z] = to_file(*p);
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for [a, b, c] in &mesh.triangles {
        let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
    }
    text
}

/// Harmonics of 120 Hz that swell four times a second, at 16 kHz.
fn voice(seconds: f32) -> Vec<f32> {
    let samples = (seconds * 16_000.0) as usize;
    (0..samples)
        .map(|i| {
            let t = i as f32 / 16_000.0;
            let swell = 0.5 - 0.5 * (TAU * 4.0 * t).cos();
            let tone: f32 = (1..20)
                .map(|h| (TAU * 120.0 * h as f32 * t).sin() / h as f32)
                .sum();
            0.3 * swell * tone
        })
        .collect()
}

fn wav(samples: &[f32], rate_hz: u32) -> Vec<u8> {
    let length = 2 * samples.len() as u32;
    let mut bytes = Vec::with_capacity(44 + length as usize);
    bytes.extend(b"RIFF");
    bytes.extend((36 + length).to_le_bytes());
    bytes.extend(b"WAVEfmt ");
    bytes.extend(16u32.to_le_bytes());
    bytes.extend([1u16, 1].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([rate_hz, 2 * rate_hz].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([2u16, 16].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend(b"data");
    bytes.extend(length.to_le_bytes());
    bytes.extend(
        samples
            .iter()
            .flat_map(|x| ((x * 32767.0) as i16).to_le_bytes()),
    );
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::{
        audio::Waveform,
        face::{FaceOptions, locate_landmarks},
        mesh::LandmarkSource,
    };

    #[test]
    fn the_files_can_be_read_back() {
        let folder = tempdir();
        let scene = Scene::write(&folder, 0.5).unwrap();
        let mesh = Mesh::read(&scene.head).unwrap();
        assert_eq!(mesh.positions.len(), mask().positions.len());
        let voice = Waveform::from_file(&scene.voice).unwrap();
        assert!((voice.duration_s() - 0.5).abs() < 1e-3 && !voice.is_silent());
        let options = FaceOptions {
            landmarks: Some(LandmarkSource::read(&scene.landmarks).unwrap()),
            ..FaceOptions::default()
        };
        locate_landmarks(&mesh, &options).unwrap();
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn the_lips_are_apart_and_the_corners_are_not() {
        let report = mask().report();
        // The two holes are the outer border and the slit.
        assert_eq!((report.parts, report.holes), (1, 2));
    }

    fn tempdir() -> PathBuf {
        std::env::temp_dir().join(format!("anyface-scene-{}", std::process::id()))
    }
}
