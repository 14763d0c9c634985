//! Writes a clip into a file while its frames are being made.

use std::{
    borrow::Cow,
    fs::File,
    io::{BufWriter, Seek, Write},
    path::{Path, PathBuf},
    sync::Arc,
};

use ndarray::ArrayView3;

use super::{
    Format,
    cache::write_positions,
    glb::{has_eye_bones, write_glb},
    mdd,
    mesh_targets::{MeshTargets, with_file_targets},
    moved::{MAX_IN_MEMORY, Moved, SOLVED},
    npz::Archive,
    pc2,
    rows::Rows,
    scene::Scene,
    take_shapes::TakeShapes,
    targets::Targets,
    usd::write_usd,
    vrm::{VrmNames, VrmWeights, write_vrm_animation},
};
use crate::{
    Error, Result,
    job::{ProgressFn, SILENT, Unfinished},
    mesh::{Mesh, glb_chunks, ibug::LANDMARKS},
    motion::Life,
    rig::{ARKIT, EyeLook},
    spread::{Animation, ClipStart, FrameBlock, FrameSink},
};

/// A file that takes the frames of a clip. The file appears once it is complete.
///
/// - npz: `displacements` `[T, V, 3]`, `landmarks_neutral` `[68, 3]` and `landmark_displacements`
///   `[T, 68, 3]` as f32 in mesh units, `fps`, and if they are known `head` `[T, 3]`, `gaze`
///   `[T, 2, 2]` and `tongue` `[T, 4]` as in [`Life`]. Of these three, the displacements contain
///   only the motion of the tongue.
/// - pc2 and mdd: positions in mesh units and axes.
/// - GLB and USD: shapes with weights over time, which bring every vertex within 0.01 mm (on a head
///   of human size) of its place, and a node or joint that turns the head. With
///   [`ClipFile::with_shapes`], the shapes of the mesh and solved weights instead.
/// - VRMA: the expressions of avatars, for which it needs the shapes.
///
/// A GLB, USD or VRMA is written once all frames are there. Until then they stay in memory, or beside
/// the file if they are more than ten minutes of 25 per second. The shapes of so long a take are
/// found on some of its frames; all frames are checked.
///
/// Its errors as a [`FrameSink`]: `ShapeMismatch` if number or size of the frames differ from what
/// was announced, `InvalidInput` for a VRMA without shapes, `Io` if the file cannot be written.
pub struct ClipFile {
    path: PathBuf,
    format: Format,
    life: Option<Life>,
    beside: Beside,
    open: Option<Open>,
}

/// The contents of a scene file other than the clip.
#[derive(Default)]
pub(super) struct Beside {
    /// The bytes of the file that the mesh was read from.
    source: Option<Vec<u8>>,
    sound: Option<String>,
    shapes: Option<TakeShapes>,
    mesh_targets: Option<Arc<MeshTargets>>,
    eyes: Vec<EyeLook>,
    names: VrmNames,
}

impl Beside {
    /// The clip as shapes made for it, or as the shapes of its mesh if they are known.
    fn targets(
        &self,
        mut moved: Moved,
        scene: &Scene<'_>,
        progress: ProgressFn<'_>,
    ) -> Result<Targets> {
        if let Some(targets) = &self.mesh_targets {
            return targets.playing(&mut moved, scene.life, progress);
        }
        let Some(shapes) = &self.shapes else {
            let basis = moved.into_basis(Targets::max_error(scene.landmarks), progress)?;
            let targets = Targets::of_basis(basis, scene.landmarks);
            return Ok(match scene.life {
                Some(life) if !scene.glb().is_some_and(has_eye_bones) => {
                    targets.with_looks(&self.eyes, life)
                }
                _ => targets,
            });
        };
        let (rig, file_targets) = with_file_targets(shapes.rig(), scene.source)?;
        let targets = Targets::of_rig(&rig, ARKIT, scene.landmarks).on_file_targets(&file_targets);
        let weights = match rig {
            Cow::Borrowed(_) => shapes.arkit_of(&mut moved, scene.life, progress)?,
            Cow::Owned(rig) => {
                let shapes = shapes.of_rig(rig);
                shapes.arkit_of(&mut moved, scene.life, progress)?
            }
        };
        Ok(targets.playing(&ARKIT, weights.view(), moved.fps()))
    }
}

/// A clip file that is receiving its frames.
struct Open {
    unfinished: Unfinished,
    writer: Writer<BufWriter<File>>,
    /// Landmarks, which follow all frames in the file.
    landmarks: Rows,
}

impl ClipFile {
    /// A file in the format that the extension of `path` names. Does not open it yet.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown extension.
    pub fn new(path: &Path) -> Result<Self> {
        Ok(ClipFile {
            path: path.to_owned(),
            format: Format::from_path(path)?,
            life: None,
            beside: Beside::default(),
            open: None,
        })
    }

    /// The path at which the file will appear.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How many frames are in memory at once while a scene of `frames` frames is written.
    pub fn frames_in_memory(frames: usize) -> usize {
        // The shapes of a short take are computed from all frames, with two copies of them.
        3 * if frames > MAX_IN_MEMORY {
            SOLVED
        } else {
            frames
        }
    }

    /// Sets the bytes of the file that the mesh was read from.
    ///
    /// Only a written GLB uses them: from a GLB it keeps the materials, bones and everything else,
    /// from an OBJ or PLY the texture coordinates.
    #[must_use]
    pub fn of_file(mut self, bytes: &[u8]) -> Self {
        self.beside.source = (self.format == Format::Glb).then(|| bytes.to_owned());
        self
    }

    /// Sets the shapes of the mesh. A GLB or USD then holds those of [`ARKIT`] with solved weights, a
    /// VRMA the expressions derived from them.
    #[must_use]
    pub fn with_shapes(mut self, shapes: TakeShapes) -> Self {
        self.beside.shapes = Some(shapes);
        self
    }

    /// Sets the morph targets that the file of the mesh has. A GLB then gets an animation of those
    /// targets and no new ones.
    #[must_use]
    pub fn with_mesh_targets(mut self, targets: Arc<MeshTargets>) -> Self {
        self.beside.mesh_targets = Some(targets);
        self
    }

    /// The targets of [`ClipFile::with_mesh_targets`].
    pub fn mesh_targets(&self) -> Option<Arc<MeshTargets>> {
        self.beside.mesh_targets.clone()
    }

    /// Sets the eyes of the mesh, so that a scene turns them with the gaze of the take.
    ///
    /// Without them the eyes of a scene stay at rest, unless it has the shapes of the mesh, which
    /// turn the eyes too.
    #[must_use]
    pub fn with_eyes(mut self, eyes: Vec<EyeLook>) -> Self {
        self.beside.eyes = eyes;
        self
    }

    /// Sets which expressions a VRMA has. Without this it has all of them.
    #[must_use]
    pub fn with_vrm_names(mut self, names: VrmNames) -> Self {
        self.beside.names = names;
        self
    }

    /// Sets the name of the sound file beside this one, which scene files mention.
    #[must_use]
    pub fn with_sound(mut self, name: &str) -> Self {
        self.beside.sound = Some(name.to_owned());
        self
    }

    /// Writes a whole animation.
    ///
    /// # Errors
    /// Those of a [`ClipFile`] as a sink. On an error no unfinished file is left.
    pub fn write_whole(
        mut self,
        animation: &Animation,
        life: Option<&Life>,
        mesh: &Mesh,
    ) -> Result<()> {
        let moved = &animation.vertices.displacements;
        life.into_iter().for_each(|life| self.add_life(life));
        self.begin(&ClipStart {
            mesh,
            landmarks: &animation.landmarks_neutral,
            frames: moved.dim().0,
            fps: animation.vertices.fps,
        })?;
        self.write(moved.view(), animation.landmark_displacements.view())?;
        self.finish(SILENT)
    }

    /// Adds head, eyes and tongue of the next frames, for formats that hold them. Call it for all
    /// frames or for none.
    pub fn add_life(&mut self, life: &Life) {
        match &mut self.life {
            Some(before) => before.append(life),
            None => self.life = Some(life.clone()),
        }
    }

    /// [`FrameSink::take`] for frames that the caller keeps.
    fn write(&mut self, block: ArrayView3<'_, f32>, landmarks: ArrayView3<'_, f32>) -> Result<()> {
        let Some(open) = &mut self.open else {
            return Err(Error::InvalidInput(format!(
                "{}: expected the clip's start before its frames",
                self.path.display()
            )));
        };
        open.writer.write(&self.path, block)?;
        open.landmarks.add(landmarks.into_dyn())
    }
}

impl FrameSink for ClipFile {
    fn begin(&mut self, start: &ClipStart<'_>) -> Result<()> {
        if self.format == Format::Vrma && self.beside.shapes.is_none() {
            return Err(Error::InvalidInput(format!(
                "{}: expected the shapes of the mesh beside its motion for a VRM animation, got none",
                self.path.display()
            )));
        }
        let is_avatar = self.path.extension().is_some_and(|ending| ending == "vrm");
        if is_avatar && !self.beside.source.as_deref().is_some_and(is_vrm) {
            return Err(Error::InvalidInput(format!(
                "{}: expected the mesh of a VRM for a VRM, got another mesh; write a .glb, or make an avatar first with \
                 anyface rig",
                self.path.display()
            )));
        }
        let (unfinished, file) = Unfinished::create(&self.path)?;
        let writer = Writer::begin(&self.path, file, self.format, start)?;
        self.open = Some(Open {
            unfinished,
            writer,
            landmarks: Rows::beside(&self.path)?,
        });
        Ok(())
    }

    fn take(&mut self, block: FrameBlock) -> Result<()> {
        self.write(block.displacements.view(), block.landmarks.view())
    }

    fn finish(&mut self, progress: ProgressFn<'_>) -> Result<()> {
        let Some(open) = self.open.take() else {
            return Ok(());
        };
        let life = self.life.as_ref();
        let beside = &self.beside;
        open.writer
            .finish(&self.path, open.landmarks, (life, beside), progress)?;
        open.unfinished.finish()
    }
}

/// Whether the bytes of a GLB hold an avatar.
fn is_vrm(bytes: &[u8]) -> bool {
    let document = glb_chunks(bytes).ok();
    let document: Option<serde_json::Value> =
        document.and_then(|(json, _)| serde_json::from_slice(json).ok());
    document.is_some_and(|document| {
        ["VRM", "VRMC_vrm"]
            .iter()
            .any(|name| document["extensions"][name].is_object())
    })
}

/// Writes the contents into any writer, so that tests can simulate a full disk.
pub(super) struct Writer<W: Write + Seek> {
    body: Body<W>,
    landmarks: [[f32; 3]; LANDMARKS],
    frames: usize,
    vertices: usize,
    fps: f64,
    frames_written: usize,
}

enum Body<W: Write + Seek> {
    Npz(Box<Archive<W>>),
    /// The file, the rest positions, and the encoding of numbers.
    PointCache(W, Vec<[f32; 3]>, fn(f32) -> [u8; 4]),
    /// The shapes are made from all frames after the last one.
    Shapes(W, Format, Mesh, Moved),
}

impl<W: Write + Seek> Writer<W> {
    pub(super) fn begin(
        path: &Path,
        mut file: W,
        format: Format,
        start: &ClipStart<'_>,
    ) -> Result<Self> {
        let io = || Error::io(path);
        let rest = || start.mesh.positions.clone();
        let vertices = start.mesh.positions.len();
        let body = match format {
            Format::Npz => {
                let mut archive = Archive::new(file);
                let sizes = [start.frames, vertices, 3];
                archive
                    .start("displacements", "<f4", &sizes)
                    .map_err(io())?;
                Body::Npz(Box::new(archive))
            }
            Format::Pc2 => {
                pc2::write_header(&mut file, start).map_err(io())?;
                Body::PointCache(file, rest(), f32::to_le_bytes)
            }
            Format::Mdd => {
                mdd::write_header(&mut file, start).map_err(io())?;
                Body::PointCache(file, rest(), f32::to_be_bytes)
            }
            Format::Glb | Format::Usda | Format::Vrma => {
                let moved = Moved::begin(path, start)?;
                Body::Shapes(file, format, start.mesh.clone(), moved)
            }
        };
        Ok(Writer {
            body,
            landmarks: *start.landmarks,
            frames: start.frames,
            vertices,
            fps: start.fps,
            frames_written: 0,
        })
    }

    /// Appends frames, and checks their number and sizes against the header.
    pub(super) fn write(&mut self, path: &Path, block: ArrayView3<'_, f32>) -> Result<()> {
        let (frames, vertices, axes) = block.dim();
        self.frames_written += frames;
        if vertices != self.vertices || axes != 3 || self.frames_written > self.frames {
            return Err(self.mismatch(vertices));
        }
        match &mut self.body {
            Body::Npz(archive) => archive.values(block),
            Body::PointCache(file, rest, encode) => write_positions(file, block, rest, *encode),
            Body::Shapes(.., moved) => return moved.add(block),
        }
        .map_err(Error::io(path))
    }

    pub(super) fn finish(
        self,
        path: &Path,
        landmarks: Rows,
        (life, beside): (Option<&Life>, &Beside),
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        if self.frames_written != self.frames {
            return Err(self.mismatch(self.vertices));
        }
        let end = match self.body {
            Body::Npz(mut archive) => archive
                .neutral(&self.landmarks)
                .and_then(|()| archive.rows("landmark_displacements", landmarks))
                .and_then(|()| life.map_or(Ok(()), |life| archive.life(life)))
                .and_then(|()| archive.number("fps", self.fps))
                .and_then(|()| archive.finish()),
            Body::PointCache(mut file, ..) => file.flush(),
            Body::Shapes(mut file, format, mesh, mut moved) => {
                let scene = Scene {
                    mesh: &mesh,
                    landmarks: &self.landmarks,
                    life,
                    source: beside.source.as_deref(),
                    sound: beside.sound.as_deref(),
                };
                let out = (&mut file, path);
                match (format, &beside.shapes) {
                    (Format::Vrma, Some(shapes)) => {
                        let names = beside.names;
                        let weights = VrmWeights::solve(&mut moved, life, shapes, names, progress)?;
                        write_vrm_animation(out, &scene, &weights, names)?;
                    }
                    (Format::Usda, _) => {
                        write_usd(out, &scene, &beside.targets(moved, &scene, progress)?)?;
                    }
                    _ => write_glb(out, &scene, &beside.targets(moved, &scene, progress)?)?,
                }
                file.flush()
            }
        };
        end.map_err(Error::io(path))
    }

    fn mismatch(&self, vertices: usize) -> Error {
        Error::ShapeMismatch {
            what: "displacements",
            expected: format!("[{}, {}, 3]", self.frames, self.vertices),
            got: format!("[{}, {vertices}, 3]", self.frames_written),
        }
    }
}
