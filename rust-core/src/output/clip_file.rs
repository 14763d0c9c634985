//! Writes a clip into a file while its frames are made.

use std::{
    fs::File,
    io::{BufWriter, Seek, Write},
    path::{Path, PathBuf},
};

use ndarray::{Array3, ArrayView3};

use super::{
    Format,
    cache::write_positions,
    glb::write_glb,
    mdd,
    npz::Archive,
    pc2,
    rows::Rows,
    scene::Scene,
    take_shapes::{TakeShapes, looks},
    targets::Targets,
    usd::write_usd,
    vrm::{VrmNames, write_vrm_animation},
};
use crate::{
    Error, Result,
    deform::VertexClip,
    job::Unfinished,
    mesh::{Mesh, ibug::LANDMARKS},
    motion::Life,
    rig::{ARKIT, EyeLook},
    spread::{Animation, ClipStart, FrameBlock, FrameSink},
};

/// A file that takes the frames of a clip. It appears when the last frame is written, so nobody sees half a file.
///
/// npz: `displacements` `[T, V, 3]`, `landmarks_neutral` `[68, 3]`, `landmark_displacements`
/// `[T, 68, 3]` as f32 in mesh units, `fps`, and where they are known `head` `[T, 3]`, `gaze` `[T, 2, 2]` and `tongue`
/// `[T, 4]` as [`Life`] has them. The displacements hold the tongue alone. pc2 and mdd: positions, mesh units and axes.
/// GLB and USD: shapes whose weights over time bring every vertex within 0.01 mm (on a head of human size) of its place,
/// and the head as a node or a joint that turns; with [`ClipFile::with_shapes`] the shapes of the mesh and solved weights instead.
/// VRMA: the expressions of avatars, which need the shapes. Such files are written when all frames are there, which stay in
/// memory until then.
///
/// Its errors as a [`FrameSink`]: `ShapeMismatch` if the frames are not those that were announced,
/// `Io` if the file cannot be written.
pub struct ClipFile {
    path: PathBuf,
    format: Format,
    life: Option<Life>,
    beside: Beside,
    open: Option<Open>,
}

/// What files of scenes have beside the clip.
#[derive(Default)]
pub(super) struct Beside {
    /// The bytes of the file that the mesh was read from.
    source: Option<Vec<u8>>,
    sound: Option<String>,
    shapes: Option<TakeShapes>,
    eyes: Vec<EyeLook>,
    names: VrmNames,
}

impl Beside {
    /// The clip as shapes of its own, or as those of its mesh.
    fn targets(&self, clip: &VertexClip, scene: &Scene<'_>) -> Result<Targets> {
        let Some(shapes) = &self.shapes else {
            let targets = Targets::of_clip(clip, scene.landmarks)?;
            let weights = looks(clip.displacements.dim().0, scene.life);
            return Ok(targets.with_looks(&self.eyes, weights.view()));
        };
        let weights = shapes.arkit(clip.displacements.view(), scene.life)?;
        let targets = Targets::of_rig(shapes.rig(), ARKIT, scene.landmarks);
        Ok(targets.playing(&ARKIT, weights.view(), clip.fps))
    }
}

/// A clip file whose frames come.
struct Open {
    unfinished: Unfinished,
    writer: Writer<BufWriter<File>>,
    /// Landmarks, which stand behind all frames.
    landmarks: Rows,
}

impl ClipFile {
    /// A file of the format that the extension of `path` names; nothing is opened yet.
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

    /// Where the file is to be.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The bytes of the file that the mesh was read from: of a GLB its materials, bones and all else stay where another one is
    /// written, of an OBJ or PLY the texture coordinates. Other formats hold neither.
    #[must_use]
    pub fn of_file(mut self, bytes: &[u8]) -> Self {
        self.beside.source = (self.format == Format::Glb).then(|| bytes.to_owned());
        self
    }

    /// The shapes of the mesh: scenes have those of [`ARKIT`] and weights that are solved for them, VRMA the expressions
    /// that come of them.
    #[must_use]
    pub fn with_shapes(mut self, shapes: TakeShapes) -> Self {
        self.beside.shapes = Some(shapes);
        self
    }

    /// The eyes of the mesh, which turn where the take has them look: without this a scene leaves them at rest, unless it has
    /// the shapes of the mesh, which turn them too.
    #[must_use]
    pub fn with_eyes(mut self, eyes: Vec<EyeLook>) -> Self {
        self.beside.eyes = eyes;
        self
    }

    /// Which expressions a VRMA has; without this all.
    #[must_use]
    pub fn with_vrm_names(mut self, names: VrmNames) -> Self {
        self.beside.names = names;
        self
    }

    /// The name of the sound's file beside this one, which files of scenes mention.
    #[must_use]
    pub fn with_sound(mut self, name: &str) -> Self {
        self.beside.sound = Some(name.to_owned());
        self
    }

    /// Writes a whole animation.
    ///
    /// # Errors
    /// Those of a [`ClipFile`] as a sink; then nothing is left.
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
        self.finish()
    }

    /// Head, eyes and tongue of the next frames, for formats that hold them; of all frames or of none.
    pub fn add_life(&mut self, life: &Life) {
        match &mut self.life {
            Some(before) => before.append(life),
            None => self.life = Some(life.clone()),
        }
    }

    /// [`FrameSink::take`] of frames that stay with the caller.
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

    fn finish(&mut self) -> Result<()> {
        let Some(open) = self.open.take() else {
            return Ok(());
        };
        open.writer
            .finish(&self.path, open.landmarks, self.life.as_ref(), &self.beside)?;
        open.unfinished.finish()
    }
}

/// What is written, into any file: tests have full disks.
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
    /// Positions at rest, and how numbers are written.
    PointCache(W, Vec<[f32; 3]>, fn(f32) -> [u8; 4]),
    /// All frames, of which shapes are made when the last one is there.
    Shapes(W, Format, Mesh, Vec<f32>),
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
                Body::Shapes(file, format, start.mesh.clone(), Vec::new())
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
            Body::Shapes(.., frames) => {
                frames.extend(block.iter());
                Ok(())
            }
        }
        .map_err(Error::io(path))
    }

    pub(super) fn finish(
        self,
        path: &Path,
        landmarks: Rows,
        life: Option<&Life>,
        beside: &Beside,
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
            Body::Shapes(mut file, format, mesh, frames) => {
                let sizes = (self.frames, self.vertices, 3);
                let displacements = Array3::from_shape_vec(sizes, frames);
                let clip = VertexClip {
                    displacements: displacements.expect("as many numbers as were announced"),
                    fps: self.fps,
                };
                let scene = Scene {
                    mesh: &mesh,
                    landmarks: &self.landmarks,
                    life,
                    source: beside.source.as_deref(),
                    sound: beside.sound.as_deref(),
                };
                let out = (&mut file, path);
                let targets = || beside.targets(&clip, &scene);
                match (format, &beside.shapes) {
                    (Format::Vrma, Some(shapes)) => {
                        write_vrm_animation(out, &scene, &clip, shapes, beside.names)?;
                    }
                    (Format::Usda, _) => write_usd(out, &scene, &targets()?)?,
                    _ => write_glb(out, &scene, &targets()?)?,
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
