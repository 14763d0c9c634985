//! `anyface-eval quality` compares the model with baselines on recorded performances that it
//! never saw.
//!
//! The rule of `training/corpus/split.py` decides which stretches are held out: every tenth clip of
//! grid_s1 by name, and the last 15 % of every take of facegood_zh.

mod aligned;
mod baselines;
mod bootstrap;
mod classifier;
mod clip;
mod closures;
mod effort;
mod emotion_plots;
mod emotions;
mod events;
mod facegood;
mod features;
mod figures;
pub(super) mod grid;
mod heads;
mod labiodentals;
mod life;
mod measures;
mod page;
mod phone;
mod predictors;
mod random;
mod reading;
mod report;
mod results;
mod row;
mod scores;
mod seams;
mod sections;
mod seeds;
mod silence;
mod speaker;
mod steps;
mod timing;
mod voices;
mod vowels;

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use crate::{
    arguments::{DataArgs, SharedArgs},
    console::{Console, command_line, write_page},
    face_model::IctLandmarks,
    pictures::Album,
};
use anyface::{Error, Result, systems::built_in_models};
use baselines::Baselines;
use bootstrap::number;
use clip::Corpus;
use figures::Figures;
use heads::Head;
use labiodentals::Mouth;
use measures::{FEATURE_ROWS, Measure, measures, scores};
use predictors::{Evaluation, Performed};
use results::{PredictorScores, Results, SourceScores, WeightsHash};
use scores::ClipScores;
use speaker::{Speaker, Wish};

/// Measure the model on recorded motion that training never saw, beside baselines
#[derive(Args)]
pub(super) struct Quality {
    #[command(flatten)]
    data: DataArgs,
    /// Measure everything and write it as Markdown, with R.json and images/R/ beside it
    #[arg(long, value_name = "R.md")]
    report: Option<PathBuf>,
    /// Folder of sources with phone times, each with phones.jsonl and ID.ogg or ID.wav
    #[arg(long, value_name = "DIR")]
    aligned: Option<PathBuf>,
    /// Folder of further predictors, each with SOURCE/CLIP.npz as `anyface motion` writes them
    #[arg(long, value_name = "DIR")]
    also: Option<PathBuf>,
    /// Name of another system to measure in the same run; may be repeated
    #[arg(long, value_name = "NAME")]
    beside: Vec<String>,
    /// Print only r, slope and amplitude of gap, width, chin and protrusion, which takes seconds;
    /// also for the systems of --beside and the files of --also
    #[arg(long, conflicts_with = "report")]
    quick: bool,
    /// Print only the numbers of one section, as JSON; lip closures, also during events, need
    /// --aligned
    #[arg(long, value_name = "SECTION", conflicts_with_all = ["report", "quick"])]
    only: Option<Section>,
    /// Also time 1, 5 and 20 minutes of sound
    #[arg(long, requires = "report")]
    long: bool,
    /// Head of the contact sheets: head.obj, head.mtl and landmarks.json
    #[arg(
        long,
        value_name = "DIR",
        default_value = "weights/shared/default_head"
    )]
    head: PathBuf,
    /// Use the first N held-out clips of each source only
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
    /// At most N utterances of each source without recorded motion
    #[arg(long, value_name = "N", default_value_t = 40)]
    aligned_limit: usize,
    /// Speaking style for all sources [default: the model's, and besides each source's own if it
    /// has one]
    #[arg(long, value_name = "NAME")]
    style: Option<String>,
    /// Same seed, same motion
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Denoising steps [default: the model's own]
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
}

/// A section that may be measured alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Section {
    Closures,
    Events,
}

/// Prints one section as JSON.
fn print_alone(scores: &impl Serialize, console: &Console) -> Result<()> {
    let text = serde_json::to_string_pretty(scores)
        .map_err(|error| Error::InvalidInput(format!("report: {error}")))?;
    console.value(scores, &(text + "\n"));
    Ok(())
}

impl Quality {
    pub(super) fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        let speaker = Speaker {
            engine: shared.engine()?,
            weights: shared.weights.clone(),
        };
        let others = self.beside.iter().map(|name| {
            let engine = shared.engine_of(Some(name))?;
            let weights = shared.weights.clone();
            Ok((name.clone(), Speaker { engine, weights }))
        });
        let others: Vec<(String, Speaker)> = others.collect::<Result<_>>()?;
        let weights = shared.weights.as_deref();
        let data = self.data.folder()?;
        let ict = IctLandmarks::read(&data)?;
        if self.quick {
            return self.print_quickly(&speaker, &others, (&data, &ict), console);
        }
        if self.only == Some(Section::Events) {
            let mut corpora = vec![grid::read(&data, &ict, self.limit)?];
            if let Some(folder) = &self.aligned {
                aligned::attach(folder, &mut corpora, &ict, self.aligned_limit)?;
            }
            let mouth = Mouth::read(&speaker.engine, &data, &ict)?;
            let scores = events::measure(&speaker, &self.wish(), &mouth, &corpora[0].held_out)?;
            return print_alone(&scores, console);
        }
        let (performed, whole) = self.perform(&speaker, &others, (&data, &ict), console)?;
        if self.only == Some(Section::Closures) {
            return print_alone(&closures::measure(&performed)?, console);
        }
        let recorded = performed.iter().chain(&whole).filter(|p| p.corpus.recorded);
        let sources: Vec<SourceScores> = recorded.map(score).collect::<Result<_>>()?;
        let table: String = sources.iter().map(|s| table(s, measures())).collect();
        let Some(path) = &self.report else {
            console.value(&sources, &table);
            return Ok(());
        };
        let hashes = hashes(weights)?;
        let results = self.measure(
            &speaker,
            &performed,
            (sources, hashes),
            (&data, &ict),
            console,
        )?;
        self.write(path, &results, &performed, &speaker)?;
        console.value(&results, &format!("{table}\n{}", path.display()));
        Ok(())
    }

    /// Prints the features of the model, the other systems and the files on recorded clips.
    fn print_quickly(
        &self,
        speaker: &Speaker,
        others: &[(String, Speaker)],
        (data, ict): (&Path, &IctLandmarks),
        console: &Console,
    ) -> Result<()> {
        let wish = self.wish();
        let run = self.evaluation(speaker, others, &wish);
        let [ends, whole] = facegood::read(data, ict, self.limit)?;
        let mut performed = vec![
            run.perform_plainly(grid::read(data, ict, self.limit)?)?,
            run.perform_plainly(ends)?,
        ];
        performed.extend(run.files_alone(whole)?);
        let sources: Vec<SourceScores> = performed.iter().map(score).collect::<Result<_>>()?;
        let features = || measures().take(FEATURE_ROWS);
        let table: String = sources.iter().map(|s| table(s, features())).collect();
        console.value(&sources, &table);
        Ok(())
    }

    fn evaluation<'a>(
        &'a self,
        speaker: &'a Speaker,
        others: &'a [(String, Speaker)],
        wish: &'a Wish,
    ) -> Evaluation<'a> {
        Evaluation {
            speaker,
            others,
            wish,
            styles: speaker.engine.description().styles,
            also: self.also.as_deref(),
        }
    }

    fn wish(&self) -> Wish {
        Wish {
            seed: self.seed,
            steps: self.steps,
            style: self.style.clone(),
            ..Wish::default()
        }
    }

    /// Runs all predictors on all sources. Whole takes are only for predictors from files, where
    /// there are any.
    fn perform(
        &self,
        speaker: &Speaker,
        others: &[(String, Speaker)],
        (data, ict): (&Path, &IctLandmarks),
        console: &Console,
    ) -> Result<(Vec<Performed>, Option<Performed>)> {
        let [ends, whole] = facegood::read(data, ict, self.limit)?;
        let mut corpora = vec![grid::read(data, ict, self.limit)?, ends];
        let fallback = Baselines::fit(&corpora[0].training)?;
        if let Some(folder) = &self.aligned {
            let limit = self.limit.unwrap_or(self.aligned_limit);
            aligned::attach(folder, &mut corpora, ict, limit)?;
        }
        let wish = self.wish();
        let run = self.evaluation(speaker, others, &wish);
        let count = corpora.len() as f32;
        let each = corpora.into_iter().enumerate();
        let performed = each.map(|(k, corpus): (usize, Corpus)| {
            console.stage("sources", 0.3 * k as f32 / count);
            run.perform(corpus, Some(&fallback))
        });
        Ok((performed.collect::<Result<_>>()?, run.files_alone(whole)?))
    }

    /// Measures what a report holds besides the scores of the sources.
    fn measure(
        &self,
        speaker: &Speaker,
        performed: &[Performed],
        (sources, weights): (Vec<SourceScores>, Vec<WeightsHash>),
        (data, ict): (&Path, &IctLandmarks),
        console: &Console,
    ) -> Result<Results> {
        let wish = self.wish();
        let recorded = || performed.iter().map(|p| &p.corpus).filter(|c| c.recorded);
        // The first source is the one with many short neutral clips.
        let clips = &performed[0].corpus.held_out;
        let stage = |name, fraction| console.stage(name, fraction);
        stage("closures", 0.3);
        let closures = closures::measure(performed)?;
        let vowels = vowels::measure(performed)?;
        stage("labiodentals", 0.4);
        let mouth = Mouth::read(&speaker.engine, data, ict)?;
        let labiodentals = labiodentals::measure(&speaker.engine, &mouth, performed)?;
        stage("effort", 0.5);
        let spoken = performed.iter().map(|p| &p.corpus);
        let spoken = spoken.filter(|c| !c.recorded && !c.is_synthetic());
        let spoken: Vec<_> = spoken.flat_map(|c| &c.held_out).collect();
        let effort = effort::measure(speaker, &wish, (data, &spoken), self.limit)?;
        let life = life::measure(speaker, &wish, data, clips)?;
        stage("emotion", 0.6);
        let reading = if self.head.is_dir() && speaker.shows_emotion() {
            let heads = Head::three(&speaker.engine, data, &self.head)?;
            let speech = &performed[1].corpus.training;
            Some(reading::measure(
                speaker,
                &wish,
                &heads,
                ict,
                (speech, clips),
            )?)
        } else {
            None
        };
        let intensity = if speaker.shows_emotion() {
            emotions::intensity(speaker, &wish, speaker.weights.as_deref(), clips)?
        } else {
            Vec::new()
        };
        stage("seeds", 0.8);
        let seeds = recorded().map(|c| seeds::measure(speaker, &wish, c));
        let seeds = seeds.collect::<Result<_>>()?;
        let sampled = recorded().filter(|_| speaker.has("steps"));
        let steps = sampled.map(|c| steps::measure(speaker, &wish, c));
        let steps: Vec<Vec<_>> = steps.collect::<Result<_>>()?;
        stage("long sounds and pictures", 0.9);
        Ok(Results {
            command: command_line(),
            weights,
            sources,
            closures,
            silence: silence::measure(performed)?,
            digital_silence: Some(silence::nothing(speaker, &wish)?),
            vowels,
            labiodentals,
            effort,
            life,
            reading,
            intensity,
            seeds,
            events: events::measure(speaker, &wish, &mouth, clips)?,
            seams: seams::measure(speaker, &wish, clips)?,
            steps: steps.concat(),
            timing: timing::measure(speaker, &wish, clips, self.long)?,
        })
    }

    /// Writes the page, the numbers beside it as JSON, and the pictures.
    fn write(
        &self,
        path: &Path,
        results: &Results,
        performed: &[Performed],
        speaker: &Speaker,
    ) -> Result<()> {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let images = format!("images/{stem}");
        let album = Album::new(path.with_file_name(&images))?;
        let head = self.head.is_dir().then_some(self.head.as_path());
        let figures = Figures::draw(&album, performed, results, (speaker, &self.wish(), head))?;
        let page = report::markdown(results, &figures, &images);
        write_page(path, &page, results)
    }
}

/// Hashes the weights of every model. Files in the folder `weights` override the built-in ones.
fn hashes(weights: Option<&Path>) -> Result<Vec<WeightsHash>> {
    let models = built_in_models().map(|model| {
        let files = model.open(weights)?;
        let hash = blake3::hash(&files.weights).to_hex();
        Ok(WeightsHash {
            name: model.name.into(),
            blake3: hash[..16].into(),
        })
    });
    models.collect()
}

fn score(performed: &Performed) -> Result<SourceScores> {
    let corpus = &performed.corpus;
    let predictors = performed.predictors.iter().map(|predictor| {
        let clips = performed.of(predictor);
        let clips: Vec<ClipScores> = clips
            .map(|(clip, motion)| ClipScores::new(clip, motion.view()))
            .collect::<Result<_>>()?;
        Ok(PredictorScores {
            name: predictor.name.clone(),
            scores: scores(&clips),
        })
    });
    Ok(SourceScores {
        source: corpus.source.clone(),
        clips: corpus.held_out.len(),
        frames: corpus.held_out.iter().map(|clip| clip.judged.len()).sum(),
        predictors: predictors.collect::<Result<_>>()?,
    })
}

/// One source as an aligned table: a row for each measure, a column for each predictor.
fn table(result: &SourceScores, rows: impl Iterator<Item = &'static Measure>) -> String {
    let mut text = format!(
        "{}: {} held-out clips, {} frames\n{:<24}",
        result.source, result.clips, result.frames, ""
    );
    for predictor in &result.predictors {
        text += &format!("{:>26}", predictor.name);
    }
    for measure in rows {
        text += &format!("\n{:<24}", measure.title);
        for predictor in &result.predictors {
            let cell = predictor.scores.get(measure.key);
            let cell = cell.map_or("–".into(), |e| number(e.value, measure.digits));
            text += &format!("{cell:>26}");
        }
    }
    text + "\n\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Correlation r of the lip gap that the loudness baseline reaches.
    fn loudness_r(corpus: &Corpus) -> f64 {
        let baselines = Baselines::fit(&corpus.training).unwrap();
        let clips: Vec<ClipScores> = corpus
            .held_out
            .iter()
            .map(|clip| ClipScores::new(clip, baselines.loudness(clip).view()).unwrap())
            .collect();
        let all_scores = scores(&clips);
        let error = all_scores["lve_root_mm"].value;
        assert!(error > 0.5 && error < 10.0, "{error}");
        all_scores["gap_r"].value
    }

    #[test]
    #[ignore = "needs ../shared"]
    fn loudness_alone_reaches_what_is_known_of_it() {
        let shared = std::env::var("ANYFACE_SHARED")
            .unwrap_or_else(|_| format!("{}/../../../shared", env!("CARGO_MANIFEST_DIR")));
        let data = PathBuf::from(shared).join("data");
        let ict = IctLandmarks::read(&data).unwrap();
        let grid = grid::read(&data, &ict, None).unwrap();
        assert_eq!(grid.held_out.len(), 91);
        let r = loudness_r(&grid);
        assert!((0.55..0.75).contains(&r), "grid_s1: {r}");
        let [ends, whole] = facegood::read(&data, &ict, None).unwrap();
        assert_eq!((ends.held_out.len(), whole.held_out.len()), (5, 5));
        let r = loudness_r(&ends);
        assert!((0.7..0.9).contains(&r), "facegood_zh: {r}");
    }
}
