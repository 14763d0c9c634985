//! The file formats of an animation.

use std::path::Path;

use crate::{Error, Result};

/// A file format for an animation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Arrays for numpy: displacements, landmarks, frame rate.
    Npz,
    /// Point cache 2: positions at every frame; Blender, 3ds Max, Maya.
    Pc2,
    /// Lightwave point cache: times and positions, big-endian; Blender, Cinema 4D, Houdini.
    Mdd,
    /// Binary glTF: morph targets and their weights over time; browsers, engines, Blender. A VRM is one
    /// too.
    Glb,
    /// USD as text: blend shapes and their weights over time; Blender, Houdini, Maya, Unreal.
    Usda,
    /// VRM animation: expressions, head rotation and gaze over time, for avatars.
    Vrma,
}

impl Format {
    /// Whether the format is a scene, which is written once all frames are there.
    pub fn is_scene(self) -> bool {
        matches!(self, Format::Glb | Format::Usda | Format::Vrma)
    }
}

impl Format {
    /// The format that the extension of a file name stands for.
    ///
    /// # Errors
    /// `InvalidInput` for any other extension.
    pub fn from_path(path: &Path) -> Result<Self> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        match extension.to_ascii_lowercase().as_str() {
            "npz" => Ok(Format::Npz),
            "pc2" => Ok(Format::Pc2),
            "mdd" => Ok(Format::Mdd),
            "glb" | "vrm" => Ok(Format::Glb),
            "usda" => Ok(Format::Usda),
            "vrma" => Ok(Format::Vrma),
            _ => Err(Error::InvalidInput(format!(
                "{}: expected a name that ends in .npz, .pc2, .mdd, .glb, .vrm, .usda or .vrma, got {extension:?}",
                path.display()
            ))),
        }
    }
}
