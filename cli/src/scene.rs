//! Options of scene and avatar files, and the sound beside them.

use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    sync::Arc,
};

use anyface::{
    Engine, Error, Face, Result,
    job::{InputKind, Place, ProgressFn, Receipts, copy_file},
    mesh::read_mesh_file,
    output::{ClipFile, Format, MeshTargets, TakeShapes, VrmNames},
    rig::{SHAPES, ShapeSource, eye_looks},
};
use clap::{Args, ValueEnum};

/// Options of scenes and avatars.
#[derive(Args)]
pub struct SceneArgs {
    /// Which shapes a .glb or .usda has: basis, the fewest that reproduce the take at every vertex; arkit, the 52 ARKit
    /// shapes of the mesh with solved weights, of which only those are new that the file of the mesh has not; or own, the
    /// morph targets that the .glb or .vrm of the mesh has already
    #[arg(long, value_enum, value_name = "SHAPES", default_value = "basis")]
    targets: Shapes,
    /// Which expressions a .vrma moves: those of Perfect Sync (ARKit's), those of VRM, or all
    #[arg(long, value_enum, value_name = "NAMES", default_value = "all")]
    expressions: Names,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Shapes {
    Basis,
    Arkit,
    Own,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Names {
    /// Both
    All,
    /// Only the 52 expressions of Perfect Sync. An avatar that has both kinds would otherwise move twice
    PerfectSync,
    /// Only those of VRM
    Vrm,
}

/// The usual path of the sound beside the scene `out`. `None` for other results, and for sound from a pipe, which can be
/// read only once.
pub fn sound_beside(out: &Path, audio: &Path) -> Option<PathBuf> {
    let is_scene = Format::from_path(out).is_ok_and(Format::is_scene);
    let ending = audio.extension().unwrap_or_default();
    (is_scene && audio.is_file()).then(|| out.with_extension(ending))
}

/// The sound file beside a scene, because a scene holds no sound.
pub struct SceneSound {
    pub path: PathBuf,
    /// Whether the sound is there already.
    is_there: bool,
    /// Says why the sound has another name than usual.
    pub warning: Option<String>,
}

impl SceneSound {
    /// The sound beside the scene `out`. If the user has another file of the usual name, it gets the name of the scene
    /// with the ending of the sound behind it.
    pub fn of(out: &Path, audio: &Path, receipts: &Receipts) -> Option<SceneSound> {
        let usual = sound_beside(out, audio)?;
        let is_there = |path: &Path| {
            Place::of(path) == Place::of(audio) || has_content_of(path, audio).unwrap_or(false)
        };
        if is_there(&usual) || receipts.may_replace(&usual) {
            return Some(SceneSound {
                is_there: is_there(&usual),
                path: usual,
                warning: None,
            });
        }
        let ending = audio.extension().unwrap_or("sound".as_ref());
        let mut name = out.as_os_str().to_owned();
        name.push(".");
        name.push(ending);
        let path = PathBuf::from(name);
        let warning = format!(
            "{} is another file and stays: the sound is in {}",
            usual.display(),
            path.display()
        );
        Some(SceneSound {
            is_there: is_there(&path),
            path,
            warning: Some(warning),
        })
    }

    /// The file that is written, if the sound is not there already.
    pub fn output(&self) -> Option<&Path> {
        (!self.is_there).then_some(&self.path)
    }

    /// Copies the sound if it is not there already.
    ///
    /// # Errors
    /// `Audio` or `Io` if it cannot be copied.
    pub fn copy(&self, audio: &Path) -> Result<()> {
        match self.output() {
            Some(path) => copy_file(audio, InputKind::Sound, path),
            None => Ok(()),
        }
    }
}

/// Whether a path is no link and its file has the bytes of another.
fn has_content_of(path: &Path, other: &Path) -> io::Result<bool> {
    let [one, two] = [fs::symlink_metadata(path)?, fs::metadata(other)?];
    if !one.is_file() || one.len() != two.len() {
        return Ok(false);
    }
    let hash = |path| -> io::Result<blake3::Hash> {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(File::open(path)?)?;
        Ok(hasher.finalize())
    };
    Ok(hash(path)? == hash(other)?)
}

impl SceneArgs {
    /// Refuses options that the format of the result does not support.
    ///
    /// # Errors
    /// `InvalidInput` for such options and for an unknown ending.
    pub fn check(&self, out: &Path) -> Result<()> {
        let format = Format::from_path(out)?;
        let is_shown = matches!(format, Format::Glb | Format::Usda);
        let wrong = |option: &str, ending: &str| {
            Err(Error::InvalidInput(format!(
                "{option}: expected a result that ends in {ending}, got {}",
                out.display()
            )))
        };
        match (self.targets, self.expressions) {
            (Shapes::Arkit, _) if !is_shown => wrong("--targets arkit", ".glb or .usda"),
            (Shapes::Own, _) if format != Format::Glb => wrong("--targets own", ".glb or .vrm"),
            (_, Names::All) => Ok(()),
            _ if format != Format::Vrma => wrong("--expressions", ".vrma"),
            _ => Ok(()),
        }
    }

    /// Memory of the shapes of the mesh and of a solve, as a number of frames. The take itself does not
    /// count.
    pub fn count_shape_frames(&self, out: &Path) -> usize {
        let is_avatar = Format::from_path(out).is_ok_and(|format| format == Format::Vrma);
        if is_avatar || self.targets != Shapes::Basis {
            3 * SHAPES
        } else {
            0
        }
    }

    /// Opens the file of a result. A scene names its sound. A GLB keeps everything else of the GLB that the mesh came from.
    ///
    /// # Errors
    /// The errors of reading the mesh's file and of making its rig.
    pub fn file(
        &self,
        out: &Path,
        (mesh, sound): (Option<&Path>, Option<&Path>),
        (engine, face): (&Engine, &Face),
        progress: ProgressFn<'_>,
    ) -> Result<ClipFile> {
        let mut file = ClipFile::new(out)?;
        let format = Format::from_path(out)?;
        // A pipe can be read only once.
        let source = match mesh.filter(|path| format.is_scene() && path.is_file()) {
            Some(mesh) => Some(read_mesh_file(mesh)?),
            None => None,
        };
        if let Some(source) = &source {
            file = file.of_file(source);
        }
        if self.targets == Shapes::Own {
            file = file.with_mesh_targets(MeshTargets::read(
                source.as_deref().unwrap_or_default(),
                face,
            )?);
        } else if self.targets == Shapes::Arkit || format == Format::Vrma {
            let rig = Arc::clone(&engine.rig(face, ShapeSource::Network, progress)?);
            file = file.with_shapes(TakeShapes::new(rig, &face.landmarks.vertices));
        } else if format.is_scene() {
            file = file.with_eyes(eye_looks(face)?);
        }
        let name = sound.and_then(Path::file_name);
        if let Some(name) = name {
            file = file.with_sound(&name.to_string_lossy());
        }
        Ok(file.with_vrm_names(match self.expressions {
            Names::All => VrmNames::All,
            Names::PerfectSync => VrmNames::PerfectSync,
            Names::Vrm => VrmNames::Vrm,
        }))
    }
}
