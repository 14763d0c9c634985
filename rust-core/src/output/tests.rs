use std::io::{self, Cursor, Seek, SeekFrom, Write};

use ndarray::Array3;
use ndarray_npy::NpzReader;

use super::*;
use super::{
    clip_file::{Beside, Writer},
    rows::Rows,
};

use crate::{
    deform::VertexClip,
    job::SILENT,
    mesh::ibug::LANDMARKS,
    motion::{FaceModes, WeightClip},
    spread::{ClipStart, FrameBlock, FrameSink},
};

/// Writes the sample clip into any file.
fn write_sample(file: impl Write + Seek, format: Format) -> Result<()> {
    let (animation, mesh) = sample();
    let path = Path::new("clip");
    let mut writer = Writer::begin(path, file, format, &start(&mesh, &animation))?;
    let all = animation.vertices.displacements.view();
    writer.write(path, all.slice_axis(ndarray::Axis(0), (..1).into()))?;
    writer.write(path, all.slice_axis(ndarray::Axis(0), (1..).into()))?;
    writer.finish(
        path,
        landmarks(&animation),
        (None, &Beside::default()),
        SILENT,
    )
}

fn start<'a>(mesh: &'a Mesh, animation: &'a Animation) -> ClipStart<'a> {
    ClipStart {
        mesh,
        landmarks: &animation.landmarks_neutral,
        frames: 4,
        fps: 24.0,
    }
}

fn landmarks(animation: &Animation) -> Rows {
    let mut rows = Rows::beside(&std::env::temp_dir().join("clip")).unwrap();
    let displacements = animation.landmark_displacements.view();
    rows.add(displacements.into_dyn()).unwrap();
    rows
}

/// Frames whose landmarks stay at rest.
fn block(displacements: Array3<f32>) -> FrameBlock {
    let landmarks = Array3::zeros((displacements.dim().0, LANDMARKS, 3));
    FrameBlock {
        displacements,
        landmarks,
    }
}

fn bytes_of(format: Format) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    write_sample(&mut file, format).unwrap();
    file.into_inner()
}

fn sample() -> (Animation, Mesh) {
    let displacements = Array3::from_shape_fn((4, 5, 3), |(t, v, i)| (t * 100 + v * 10 + i) as f32);
    let animation = Animation {
        vertices: VertexClip {
            displacements,
            fps: 24.0,
        },
        landmarks_neutral: std::array::from_fn(|n| [n as f32, 0.5, -1.0]),
        landmark_displacements: Array3::from_shape_fn((4, LANDMARKS, 3), |(t, n, i)| {
            (t + n + i) as f32 * 0.25
        }),
    };
    let mesh = Mesh {
        positions: (0..5).map(|v| [v as f32, 1.0, 2.0]).collect(),
        triangles: vec![[0, 1, 2]],
    };
    (animation, mesh)
}

#[test]
fn npz_gives_back_what_was_written() {
    let (animation, mesh) = sample();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.npz");
    write_animation(&path, &animation, None, &mesh).unwrap();
    let mut npz = NpzReader::new(std::fs::File::open(&path).unwrap()).unwrap();
    let displacements: Array3<f32> = npz.by_name("displacements").unwrap();
    assert_eq!(displacements, animation.vertices.displacements);
    let read = read_landmark_motion(&path).unwrap();
    assert_eq!(read.neutral, Some(animation.landmarks_neutral));
    assert_eq!(read.displacements, animation.landmark_displacements);
    assert_eq!(read.fps, Some(24.0));
}

#[test]
fn motion_files_hold_no_neutral_landmarks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.npz");
    let motion = LandmarkClip {
        displacements: Array3::from_elem((2, LANDMARKS, 3), 0.01),
        fps: 30.0,
    };
    let life = Life {
        head: ndarray::array![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]],
        gaze: Array3::from_shape_fn((2, 2, 2), |(t, e, i)| (4 * t + 2 * e + i) as f32),
        tongue: ndarray::array![[0.1, 0.2, 0.3, 0.4], [1.0, 0.0, 0.5, 0.0]],
    };
    let spoken = Motion::Landmarks(motion.clone());
    write_motion(&path, &spoken, &motion, Some(&life)).unwrap();
    let mut npz = NpzReader::new(std::fs::File::open(&path).unwrap()).unwrap();
    let head: ndarray::Array2<f32> = npz.by_name("head").unwrap();
    let gaze: Array3<f32> = npz.by_name("gaze").unwrap();
    let tongue: ndarray::Array2<f32> = npz.by_name("tongue").unwrap();
    assert_eq!(read_life(&path).unwrap(), Some(life.clone()));
    assert_eq!((head, gaze, tongue), (life.head, life.gaze, life.tongue));
    let read = read_landmark_motion(&path).unwrap();
    assert_eq!(read.neutral, None);
    assert_eq!(read.displacements, motion.displacements);
    assert_eq!(read_weights(&path).unwrap(), None);
    for name in ["motion.pc2", "motion.csv"] {
        assert!(write_motion(&folder.path().join(name), &spoken, &motion, None).is_err());
    }
}

#[test]
fn motion_of_weights_is_written_with_its_names_and_as_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let modes = FaceModes::open(None).unwrap();
    let clip = WeightClip {
        names: ["jawOpen", "mouthSmileLeft"].map(str::to_owned).to_vec(),
        weights: ndarray::array![[0.0, 0.5], [0.25, 1.0], [0.5, 0.0]],
        fps: 25.0,
        together: vec![0.0, 1.0, 0.5],
    };
    let (motion, npz) = (Motion::Weights(clip.clone()), folder.path().join("m.npz"));
    let marks = motion.on_mean_face(&modes).unwrap();
    write_motion(&npz, &motion, &marks, None).unwrap();
    assert_eq!(read_weights(&npz).unwrap(), Some(clip.clone()));
    let landmarks = read_landmark_motion(&npz).unwrap();
    assert_eq!(
        landmarks.displacements,
        clip.landmarks(&modes).unwrap().displacements
    );
    let table = folder.path().join("m.csv");
    write_motion(&table, &motion, &marks, None).unwrap();
    let text = std::fs::read_to_string(&table).unwrap();
    assert_eq!(text.lines().count(), 4);
    let error = write_motion(&folder.path().join("m.mdd"), &motion, &marks, None).unwrap_err();
    assert!(
        error
            .to_string()
            .contains(".npz, .csv, .json for motion of weights"),
        "{error}"
    );
}

#[test]
fn pc2_holds_positions_little_endian() {
    let bytes = bytes_of(Format::Pc2);
    assert_eq!(bytes.len(), 32 + 4 * 5 * 3 * 4);
    assert_eq!(&bytes[..12], b"POINTCACHE2\0");
    let int = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!((int(12), int(16), int(28)), (1, 5, 4));
    assert_eq!((float(20), float(24)), (0.0, 1.0));
    // Frame 2, vertex 3, y: 1 + (200 + 30 + 1).
    assert_eq!(float(32 + ((2 * 5 + 3) * 3 + 1) * 4), 232.0);
}

#[test]
fn mdd_holds_times_and_positions_big_endian() {
    let bytes = bytes_of(Format::Mdd);
    assert_eq!(bytes.len(), 8 + 4 * 4 + 4 * 5 * 3 * 4);
    let int = |at: usize| i32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    let float = |at: usize| f32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!((int(0), int(4)), (4, 5));
    assert_eq!(float(8 + 3 * 4), 0.125);
    assert_eq!(float(24 + ((2 * 5 + 3) * 3 + 1) * 4), 232.0);
}

#[test]
fn unknown_extensions_and_foreign_meshes_are_refused() {
    let (animation, mut mesh) = sample();
    let folder = tempfile::tempdir().unwrap();
    let error =
        write_animation(&folder.path().join("clip.abc"), &animation, None, &mesh).unwrap_err();
    assert!(
        error
            .to_string()
            .contains(".npz, .pc2, .mdd, .glb, .vrm, .usda or .vrma"),
        "{error}"
    );
    mesh.positions.pop();
    let error =
        write_animation(&folder.path().join("clip.pc2"), &animation, None, &mesh).unwrap_err();
    assert_eq!(
        error.to_string(),
        "displacements: expected [4, 4, 3], got [4, 5, 3]"
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// A disk with room for `room` bytes.
struct SmallDisk {
    inner: Cursor<Vec<u8>>,
    room: usize,
}

impl Write for SmallDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.inner.position() as usize + bytes.len() > self.room {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.inner.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for SmallDisk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

#[test]
fn a_full_disk_is_reported_wherever_it_strikes() {
    for format in [Format::Npz, Format::Pc2, Format::Mdd] {
        let length = bytes_of(format).len();
        for room in (0..length).step_by(61) {
            let inner = Cursor::new(Vec::new());
            match write_sample(SmallDisk { inner, room }, format) {
                Err(Error::Io { source, .. }) => {
                    assert_eq!(
                        source.kind(),
                        io::ErrorKind::StorageFull,
                        "{format:?} {room}"
                    );
                }
                other => panic!("{format:?} with room for {room}: {other:?}"),
            }
        }
    }
}

#[test]
fn frames_are_held_to_the_announced_shape_and_failures_leave_nothing() {
    let (animation, mesh) = sample();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.npz");
    let all = animation.vertices.displacements.view();
    let write = |frames: usize| {
        let mut file = ClipFile::new(&path)?;
        file.begin(&start(&mesh, &animation))?;
        let first = all.slice_axis(ndarray::Axis(0), (..frames).into());
        file.take(block(first.to_owned()))?;
        file.take(block(Array3::zeros((1, 5, 3))))?;
        file.finish(SILENT)
    };
    for frames in [2, 4] {
        assert!(matches!(write(frames), Err(Error::ShapeMismatch { .. })));
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    write(3).unwrap();
    std::fs::remove_file(&path).unwrap();
    let mut abandoned = ClipFile::new(&path).unwrap();
    abandoned.begin(&start(&mesh, &animation)).unwrap();
    abandoned.take(block(all.to_owned())).unwrap();
    drop(abandoned);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn motion_files_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.npz");
    let message = || read_landmark_motion(&path).unwrap_err().to_string();
    assert!(message().contains("motion.npz"));
    std::fs::write(&path, b"no archive").unwrap();
    assert!(message().contains("expected an npz"));
    let write = |name: &str, array: Array3<f64>| {
        let mut npz = ndarray_npy::NpzWriter::new(std::fs::File::create(&path).unwrap());
        npz.add_array(name, &array).unwrap();
        npz.finish().unwrap();
    };
    write("something", Array3::zeros((2, LANDMARKS, 3)));
    assert!(message().contains("expected an array landmark_displacements, got something"));
    write("landmark_displacements", Array3::zeros((2, 67, 3)));
    assert!(message().contains("expected [2, 68, 3], got [2, 67, 3]"));
    write(
        "landmark_displacements",
        Array3::from_elem((2, LANDMARKS, 3), f64::NAN),
    );
    assert!(message().contains("NaN or infinity in frame 0"));
    write("landmark_displacements", Array3::ones((2, LANDMARKS, 3)));
    assert_eq!(read_landmark_motion(&path).unwrap().fps, None);
}
