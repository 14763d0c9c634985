//! Splits a performance into the layers of speech and emotion, blends them with the user's mask,
//! and writes the mask that the model computes.

use std::path::{Path, PathBuf};

use anyface::{
    Engine, Error, Face, Performance, Result,
    job::{InputKind, ProgressFn, read_text},
    mesh::Mesh,
    output::{ClipFile, Format, Report, write_mask},
    spread::{self, FrameSink, Movement},
};
use clap::{Args, ValueEnum};

use crate::paths::{InputPath, OutputPath};
use crate::stages::spread_into;

/// Options of layers.
#[derive(Args)]
pub struct LayerArgs {
    /// Where emotion acts (emoface): a JSON list with a share from 0 to 1 for each vertex. Where the share is 0, speech
    /// alone moves the face
    #[arg(long, value_name = "M.json", conflicts_with = "redo")]
    mask: Option<InputPath>,
    /// Also write layers (emoface): content is the motion of speech alone, emotion is the motion
    /// that emotion adds. Their files are written beside the result, with _content and _emotion in
    /// their names
    #[arg(
        long,
        value_name = "LAYERS",
        value_delimiter = ',',
        conflicts_with = "redo"
    )]
    layers: Vec<Layer>,
    /// Also write how strongly the model lets emotion act in each frame at each vertex (emoface):
    /// .npz with mask [T, V]
    #[arg(long, value_name = "W.npz", conflicts_with = "redo")]
    mask_out: Option<OutputPath>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Layer {
    Content,
    Emotion,
}

/// A performance, and beside it the layer of speech alone.
pub struct Layered<'a> {
    pub engine: &'a Engine,
    pub face: &'a Face,
    pub performance: &'a Performance,
    /// The layer of speech alone, where an option needs it.
    content: Option<Performance>,
    /// The share of emotion for each vertex, `[V]`. All are 1 if the user gives no mask.
    mask: Vec<f32>,
}

impl LayerArgs {
    /// Runs the cheap checks before any work starts.
    pub fn check(&self, out: &Path) -> Result<()> {
        if !self.layers.is_empty() && Format::from_path(out)? == Format::Vrma {
            return Err(Error::InvalidInput(
                "--layers: expected a result with vertices, such as .npz, got .vrma, whose expressions have no layers"
                    .to_owned(),
            ));
        }
        match &self.mask_out {
            Some(path) if Format::from_path(path)? != Format::Npz => {
                Err(Error::InvalidInput(format!(
                    "{}: expected a name that ends in .npz for a mask",
                    path.display()
                )))
            }
            _ => Ok(()),
        }
    }

    /// The files of the layers.
    pub fn outputs_beside(&self, out: &Path) -> Vec<PathBuf> {
        self.layers
            .iter()
            .map(|layer| beside(out, *layer))
            .collect()
    }

    /// Whether any option needs the whole performance at once.
    pub fn are_asked(&self) -> bool {
        self.needs_content() || self.mask_out.is_some()
    }

    /// The frames that are in memory at once: at most two blocks, and the mask. A frame of the mask
    /// is a third of a frame of motion, because it has one number a vertex instead of three.
    pub fn count_frames_in_memory(&self, frames: usize, mesh: &Mesh) -> usize {
        let mask = match self.mask_out {
            Some(_) => frames / 3,
            None => 0,
        };
        mask + frames.min(2 * spread::frames_at_once(mesh))
    }

    /// Whether an option needs the layer of speech alone.
    fn needs_content(&self) -> bool {
        self.mask.is_some() || !self.layers.is_empty()
    }

    /// The performance, and beside it the layer of speech alone where an option needs it.
    pub fn of<'a>(
        &self,
        engine: &'a Engine,
        face: &'a Face,
        performance: &'a Performance,
        progress: ProgressFn<'_>,
    ) -> Result<Layered<'a>> {
        let vertices = face.mesh.positions.len();
        let mask = match &self.mask {
            Some(path) => read_mask(path, vertices)?,
            None => vec![1.0; vertices],
        };
        let content = if self.needs_content() {
            Some(performance.content(engine, progress)?)
        } else {
            None
        };
        Ok(Layered {
            engine,
            face,
            performance,
            content,
            mask,
        })
    }

    /// Writes the result, the `file` at `out`, and the layers beside it.
    pub fn write(
        &self,
        layered: &Layered<'_>,
        (out, file): (&Path, ClipFile),
        report: &mut Report,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        let Layered {
            engine,
            face,
            performance,
            ..
        } = *layered;
        if let Some(path) = &self.mask_out {
            let frames = 0..performance.motion.frames();
            write_mask(path, performance.emotion_mask(engine, face, frames)?.view())?;
        }
        for layer in &self.layers {
            layered.write_layer(*layer, &beside(out, *layer), progress)?;
        }
        let (fps, articulation) = (performance.motion.fps(), performance.articulation());
        let life = Some(&performance.life);
        let spread = |sink: &mut dyn FrameSink| layered.spread(sink, progress);
        spread_into(file, face, fps, articulation, life, report, spread)
    }
}

impl Layered<'_> {
    /// Moves the face by both layers, emotion scaled by the mask.
    fn spread(
        &self,
        sink: &mut dyn FrameSink,
        progress: ProgressFn<'_>,
    ) -> Result<anyface::spread::SpreadReport> {
        let whole = self.performance;
        match &self.content {
            Some(content) if self.mask.iter().any(|share| *share != 1.0) => {
                let rest = self.mask.iter().map(|share| 1.0 - share).collect();
                let parts = [(&content.motion, rest), (&whole.motion, self.mask.clone())];
                let mixed = Movement::Mixed(parts).with_tongue(&whole.life);
                self.engine.spread(self.face, mixed, sink, progress)
            }
            _ => self.engine.spread(self.face, whole, sink, progress),
        }
    }

    /// Writes one layer to the file `out`.
    fn write_layer(&self, layer: Layer, out: &Path, progress: ProgressFn<'_>) -> Result<()> {
        let content = self.content.as_ref().unwrap_or(self.performance);
        let negative = self.mask.iter().map(|share| -share).collect();
        let spread = |sink: &mut dyn FrameSink| match layer {
            Layer::Content => self.engine.spread(self.face, content, sink, progress),
            Layer::Emotion => {
                let whole = (&self.performance.motion, self.mask.clone());
                let parts = [(&content.motion, negative), whole];
                let mixed = Movement::Mixed(parts).with_tongue(&content.life);
                self.engine.spread(self.face, mixed, sink, progress)
            }
        };
        let fps = content.motion.fps();
        let mut report = crate::stages::new_report();
        let file = ClipFile::new(out)?;
        spread_into(file, self.face, fps, 0.0, None, &mut report, spread)
    }
}

/// `talk.npz` → `talk_content.npz`.
fn beside(out: &Path, layer: Layer) -> PathBuf {
    let word = match layer {
        Layer::Content => "content",
        Layer::Emotion => "emotion",
    };
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    let ending = out.extension().unwrap_or_default().to_string_lossy();
    out.with_file_name(format!("{stem}_{word}.{ending}"))
}

/// The shares of a mask.
fn read_mask(path: &Path, vertices: usize) -> Result<Vec<f32>> {
    let wrong = |message: String| Error::InvalidInput(format!("{}: {message}", path.display()));
    let text = read_text(path, InputKind::Numbers)?;
    let mask: Vec<f32> = serde_json::from_str(&text)
        .map_err(|error| wrong(format!("mask: expected a list of numbers: {error}")))?;
    if mask.len() != vertices {
        let got = mask.len();
        return Err(wrong(format!(
            "mask: expected a share for each of {vertices} vertices, got {got}"
        )));
    }
    match mask.iter().position(|share| !(0.0..=1.0).contains(share)) {
        Some(v) => Err(wrong(format!(
            "mask: expected shares from 0 to 1, got {} at vertex {v}",
            mask[v]
        ))),
        None => Ok(mask),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_of_another_mesh_and_beyond_one_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mask.json");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_mask(&path, 3)
        };
        assert_eq!(read("[0, 0.5, 1]").unwrap(), [0.0, 0.5, 1.0]);
        for (text, words) in [
            ("[0, 1]", "each of 3 vertices, got 2"),
            ("[0, 1.5, 1]", "got 1.5 at vertex 1"),
            ("[0, -0.1, 1]", "got -0.1 at vertex 1"),
            ("{}", "expected a list of numbers"),
            ("[0, null, 1]", "expected a list of numbers"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains(words), "{text}: {message}");
        }
    }

    #[test]
    fn layers_stand_beside_the_result() {
        let out = beside(Path::new("/tmp/a/talk.pc2"), Layer::Emotion);
        assert_eq!(out, Path::new("/tmp/a/talk_emotion.pc2"));
    }
}
