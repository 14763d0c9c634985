//! Everything that is measured side by side: the model, its stream, other systems, the baselines
//! and motion from files.
//!
//! A folder of files holds one folder per predictor, in that one folder per source, and in that
//! `<clip>.npz`, as `anyface motion` and `training` write it: `landmark_displacements`
//! `[T, 68, 3]`, canonical metres from rest, and `fps`, which may be any rate. Frame 0 is the first
//! frame of the clip. In `grid_s1` this is second 0 of the sound. In `facegood_zh` it is the first
//! frame at 30 fps from second ⌊0.85 T⌋ / 25 of the take on, where T is the take's length in frames
//! at 25 fps. `facegood_zh_whole` holds whole takes from second 0 on, for models that were trained
//! without the take or without the source. Clips without a file are left out.

use std::path::{Path, PathBuf};

use ndarray::Array3;

use super::{
    baselines::Baselines,
    clip::{Clip, Corpus, RECORDED},
    speaker::{Speaker, Wish, fitted},
};
use anyface::{Error, Result, motion::LandmarkClip, output::read_landmark_motion};

/// Name of the model in its default style.
pub(super) const MODEL: &str = "model";
/// Name of the model's causal stream.
const STREAM: &str = "stream";
/// Name of the baseline that never moves.
const CONSTANT: &str = "constant";

/// A predictor and its motion for the held-out clips of a corpus.
pub(super) struct Predictor {
    pub name: String,
    /// One per held-out clip, `[T, 68, 3]` metres; `None` where there is no file.
    pub motions: Vec<Option<Array3<f64>>>,
}

impl Predictor {
    /// Predicts the motion of every clip with `speak`.
    fn of_all(
        name: impl Into<String>,
        corpus: &Corpus,
        speak: impl Fn(&Clip) -> Result<Array3<f64>>,
    ) -> Result<Self> {
        let motions = corpus.held_out.iter().map(|clip| speak(clip).map(Some));
        Ok(Predictor {
            name: name.into(),
            motions: motions.collect::<Result<_>>()?,
        })
    }
}

/// Clips, each with its motion.
pub(super) type Pairs<'a> = Vec<(&'a Clip, &'a Array3<f64>)>;

/// A corpus and the motion that all predictors give for it.
pub(super) struct Performed {
    pub corpus: Corpus,
    pub predictors: Vec<Predictor>,
}

impl Performed {
    /// The clips for which a predictor has motion, each with this motion.
    pub(super) fn of<'a>(
        &'a self,
        predictor: &'a Predictor,
    ) -> impl Iterator<Item = (&'a Clip, &'a Array3<f64>)> {
        let both = self.corpus.held_out.iter().zip(&predictor.motions);
        both.filter_map(|(clip, motion)| Some((clip, motion.as_ref()?)))
    }

    /// The recording, where there is one, then all predictors but the constant one, each as pairs
    /// of clip and motion.
    pub(super) fn with_recording(&self) -> Vec<(&str, Pairs<'_>)> {
        let clips = || self.corpus.held_out.iter();
        let recorded = (RECORDED, clips().map(|c| (c, &c.motion)).collect());
        let others = self.predictors.iter().filter(|p| p.name != CONSTANT);
        let others = others.map(|p| (p.name.as_str(), self.of(p).collect()));
        let start = self.corpus.recorded.then_some(recorded);
        start.into_iter().chain(others).collect()
    }

    /// The model's motion for every clip.
    pub(super) fn model(&self) -> Pairs<'_> {
        let model = self.predictors.iter().find(|p| p.name == MODEL);
        model.map(|p| self.of(p).collect()).unwrap_or_default()
    }
}

/// What to evaluate: the model, the request to it, other systems, and a folder of predictors from
/// files.
pub(super) struct Evaluation<'a> {
    pub speaker: &'a Speaker,
    /// Other systems by name.
    pub others: &'a [(String, Speaker)],
    pub wish: &'a Wish,
    /// The styles that the weights know.
    pub styles: &'a [String],
    pub also: Option<&'a Path>,
}

impl Evaluation<'_> {
    /// Runs all predictors on `corpus`. `fallback` holds the baselines for a corpus without
    /// training clips.
    pub(super) fn perform(
        &self,
        corpus: Corpus,
        fallback: Option<&Baselines>,
    ) -> Result<Performed> {
        let mut predictors = vec![self.model(&corpus)?];
        let style = self.styles.iter().find(|style| **style == corpus.source);
        if let (Some(style), None) = (style, &self.wish.style) {
            let wish = Wish {
                style: Some(style.clone()),
                ..self.wish.clone()
            };
            let speak = |clip: &Clip| self.speaker.speak(clip, &wish);
            let name = format!("{MODEL}, style {style}");
            predictors.push(Predictor::of_all(name, &corpus, speak)?);
        }
        if corpus.recorded && self.speaker.engine.stream().is_ok() {
            let speak = |clip: &Clip| self.speaker.stream(clip);
            predictors.push(Predictor::of_all(STREAM, &corpus, speak)?);
        }
        predictors.extend(self.other_systems(&corpus)?);
        let fitted = if corpus.training.is_empty() {
            None
        } else {
            Some(Baselines::fit(&corpus.training)?)
        };
        if let Some(line) = fitted.as_ref().or(fallback) {
            let still = |clip: &Clip| Ok(line.constant(clip));
            predictors.push(Predictor::of_all(CONSTANT, &corpus, still)?);
            let loud = |clip: &Clip| Ok(line.loudness(clip));
            predictors.push(Predictor::of_all("loudness", &corpus, loud)?);
        }
        predictors.extend(self.read_files(&corpus)?);
        Ok(Performed { corpus, predictors })
    }

    /// Runs only the model in the requested style, other systems and predictors from files.
    pub(super) fn perform_plainly(&self, corpus: Corpus) -> Result<Performed> {
        let mut predictors = vec![self.model(&corpus)?];
        predictors.extend(self.other_systems(&corpus)?);
        predictors.extend(self.read_files(&corpus)?);
        Ok(Performed { corpus, predictors })
    }

    /// Runs the model in the requested style.
    fn model(&self, corpus: &Corpus) -> Result<Predictor> {
        Predictor::of_all(MODEL, corpus, |clip| self.speaker.speak(clip, self.wish))
    }

    /// Runs the other systems with the same seed and otherwise their own defaults.
    fn other_systems(&self, corpus: &Corpus) -> Result<Vec<Predictor>> {
        let wish = Wish {
            seed: self.wish.seed,
            ..Wish::default()
        };
        let others = self.others.iter();
        let predictors =
            others.map(|(name, of)| Predictor::of_all(name, corpus, |clip| of.speak(clip, &wish)));
        predictors.collect()
    }

    /// Runs only the predictors from files. `None` where there are no files.
    pub(super) fn files_alone(&self, corpus: Corpus) -> Result<Option<Performed>> {
        let predictors = self.read_files(&corpus)?;
        Ok((!predictors.is_empty()).then_some(Performed { corpus, predictors }))
    }

    /// Reads the predictors that have a file for at least one clip of `corpus`.
    fn read_files(&self, corpus: &Corpus) -> Result<Vec<Predictor>> {
        let mut predictors = Vec::new();
        for folder in self.also.map(sub_folders).transpose()?.unwrap_or_default() {
            let name = folder.file_name().unwrap_or_default().to_string_lossy();
            let motions = from_files(&folder.join(&corpus.source), &corpus.held_out)?;
            predictors.extend(motions.iter().any(Option::is_some).then_some(Predictor {
                name: name.into(),
                motions,
            }));
        }
        Ok(predictors)
    }
}

fn sub_folders(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut folders: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(Error::io(folder))?
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| path.is_dir())
        .collect();
    folders.sort();
    Ok(folders)
}

/// Reads `folder/<clip>.npz` for every clip that has one.
fn from_files(folder: &Path, clips: &[Clip]) -> Result<Vec<Option<Array3<f64>>>> {
    let read = |clip: &Clip| {
        let path = folder.join(format!("{}.npz", clip.name));
        if path.is_file() {
            from_file(&path, clip).map(Some)
        } else {
            Ok(None)
        }
    };
    clips.iter().map(read).collect()
}

/// Reads motion in canonical metres and brings it to the clip's rate and length.
fn from_file(path: &Path, clip: &Clip) -> Result<Array3<f64>> {
    let bad = |what: &str| Error::InvalidInput(format!("{}: {what}", path.display()));
    let file = read_landmark_motion(path)?;
    if file.neutral.is_some() {
        return Err(bad(
            "expected canonical metres, got landmarks_neutral in mesh units",
        ));
    }
    let motion = LandmarkClip {
        fps: file.fps.unwrap_or(clip.fps),
        displacements: file.displacements,
    };
    let motion = if (motion.fps - clip.fps).abs() < 1e-6 {
        motion
    } else {
        motion.at_rate(clip.fps, clip.frames())
    };
    fitted(motion.displacements.mapv(f64::from), clip.frames())
        .ok_or_else(|| bad("expected frames, got none"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::{audio::Waveform, mesh::ibug::LANDMARKS, motion::Motion, output::write_motion};
    use ndarray::Array2;

    fn clip(name: &str) -> Clip {
        Clip {
            name: name.into(),
            waveform: Waveform {
                samples: vec![0.0; 16_000],
            },
            start_s: 0.0,
            motion: Array3::zeros((25, LANDMARKS, 3)),
            speaker: Array2::zeros((LANDMARKS, 3)),
            neutral: Array2::zeros((LANDMARKS, 3)),
            fps: 25.0,
            observed: (0..LANDMARKS).collect(),
            judged: 0..25,
            phones: None,
        }
    }

    #[test]
    fn files_are_read_where_they_are_there() {
        let folder = tempfile::tempdir().unwrap();
        let motion = LandmarkClip {
            displacements: ndarray::Array3::from_elem((60, LANDMARKS, 3), 0.25),
            fps: 50.0,
        };
        let whole = Motion::Landmarks(motion.clone());
        write_motion(&folder.path().join("a.npz"), &whole, &motion, None).unwrap();
        let motions = from_files(folder.path(), &[clip("a"), clip("b")]).unwrap();
        let motion = motions[0].as_ref().unwrap();
        assert_eq!(motion.dim(), (25, LANDMARKS, 3));
        assert!(motion.iter().all(|x| (x - 0.25).abs() < 1e-6));
        assert!(motions[1].is_none());
    }
}
