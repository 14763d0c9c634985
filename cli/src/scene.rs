//! Options of scene and avatar files, and the sound beside them.

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
    /// Which shapes a .glb or .usda has: basis, the fewest that reproduce the take at every vertex; or arkit, the 52 ARKit
    /// shapes of the mesh with solved weights
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

/// The path of the sound file that lies beside the scene `out`, because a scene holds no sound. `None` for other results,
/// and for sound from a pipe, which can be read only once.
pub fn sound_of_scene(out: &Path, audio: &Path) -> Option<PathBuf> {
    let is_scene = Format::from_path(out).is_ok_and(Format::is_scene);
    let is_scene = is_scene && audio.is_file();
    let ending = audio.extension().unwrap_or_default();
    is_scene.then(|| out.with_extension(ending))
}

/// [`sound_of_scene`], but `None` if that is the sound file itself.
pub fn sound_copy(out: &Path, audio: &Path) -> Option<PathBuf> {
    let sound = sound_of_scene(out, audio);
    sound.filter(|path| Place::of(path) != Place::of(audio))
}

/// Copies the sound beside a scene.
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
            (_, Names::All) => Ok(()),
            _ if format != Format::Vrma => wrong("--expressions", ".vrma"),
            _ => Ok(()),
        }
    }

    /// Memory of the shapes of the mesh and of a solve, as a number of frames. The take itself does not
    /// count.
    pub fn count_shape_frames(&self, out: &Path) -> usize {
        let is_avatar = Format::from_path(out).is_ok_and(|format| format == Format::Vrma);
        if is_avatar || self.targets == Shapes::Arkit {
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
