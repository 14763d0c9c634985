//! What files of scenes and avatars hold of a take: shapes, expressions and the sound beside them.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use anyface::{
    Engine, Error, Face, Result,
    job::{InputKind, Place, ProgressFn, copy_file, read_file},
    output::{ClipFile, Format, TakeShapes, VrmNames},
    rig::{SHAPES, ShapeSource, eye_looks},
};
use clap::{Args, ValueEnum};

/// Options of scenes and avatars.
#[derive(Args)]
pub struct SceneArgs {
    /// Shapes of a .glb or .usda: basis has as few as reproduce the take, arkit has the mesh's 52 ARKit shapes with
    /// solved weights
    #[arg(long, value_enum, value_name = "SHAPES", default_value = "basis")]
    targets: Shapes,
    /// Which expressions a .vrma moves: those of Perfect Sync (ARKit's), of VRM, or all
    #[arg(long, value_enum, value_name = "NAMES", default_value = "all")]
    expressions: Names,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Shapes {
    Basis,
    Arkit,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Names {
    /// Both
    All,
    /// The 52 of Perfect Sync alone: an avatar that also has those of VRM would move twice
    PerfectSync,
    /// Those of VRM alone
    Vrm,
}

/// Path of the sound beside the scene `out`, because a scene holds no sound itself.
///
/// `None` if `out` is no scene, or if `audio` is a pipe, which can be read only once.
pub fn sound_of_scene(out: &Path, audio: &Path) -> Option<PathBuf> {
    let is_scene = Format::from_path(out).is_ok_and(Format::is_scene);
    let is_scene = is_scene && audio.is_file();
    let ending = audio.extension().unwrap_or_default();
    is_scene.then(|| out.with_extension(ending))
}

/// The same path, if it is another file than `audio`.
pub fn sound_copy(out: &Path, audio: &Path) -> Option<PathBuf> {
    let sound = sound_of_scene(out, audio);
    sound.filter(|path| Place::of(path) != Place::of(audio))
}

/// Puts the sound beside a scene.
///
/// # Errors
/// `Audio` or `Io` if it cannot be copied.
pub fn copy_sound(out: &Path, audio: &Path) -> Result<()> {
    match sound_copy(out, audio) {
        Some(path) => copy_file(audio, InputKind::Sound, &path),
        None => Ok(()),
    }
}

impl SceneArgs {
    /// Refuses options that do not apply to the format of the result.
    ///
    /// # Errors
    /// `InvalidInput` for such an option, and for an unknown ending.
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
            (_, Names::All) => Ok(()),
            _ if format != Format::Vrma => wrong("--expressions", ".vrma"),
            _ => Ok(()),
        }
    }

    /// How much memory the shapes take beside the take, in frames: the shapes of the mesh, and those of a solve.
    pub fn kept(&self, out: &Path) -> usize {
        let is_avatar = Format::from_path(out).is_ok_and(|format| format == Format::Vrma);
        match is_avatar || self.targets == Shapes::Arkit {
            true => 3 * SHAPES,
            false => 0,
        }
    }

    /// The file of a result. A scene names its sound. A GLB keeps everything else of the GLB that the mesh came from.
    ///
    /// # Errors
    /// Those of the mesh's file and of its rig.
    pub fn file(
        &self,
        out: &Path,
        (mesh, sound): (Option<&Path>, Option<&Path>),
        (engine, face): (&Engine, &Face),
        progress: ProgressFn<'_>,
    ) -> Result<ClipFile> {
        let mut file = ClipFile::new(out)?;
        let format = Format::from_path(out)?;
        // A pipe can be read only once, and the mesh was read from it.
        if let Some(mesh) = mesh.filter(|path| format.is_scene() && path.is_file()) {
            file = file.of_file(&read_file(mesh, InputKind::Mesh)?);
        }
        if self.targets == Shapes::Arkit || format == Format::Vrma {
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
