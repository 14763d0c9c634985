//! Draws the pictures that a report shows.

use std::path::Path;

use ndarray::{Array3, Axis};

use super::{
    clip::{Clip, RECORDED, gap_mm},
    emotions::with_emotion,
    predictors::{MODEL, Performed},
    results::Results,
    scores::SEGMENT,
    speaker::{Speaker, Wish},
};
use crate::metrics::Spectrum;
use crate::pictures::{
    Album,
    lip_plots::Track,
    sheets::{Head, Row},
};
use anyface::{Result, conditions::EMOTIONS};

/// Clips in a plot over time.
const TRACKS: usize = 3;
/// Frames in a row of a contact sheet.
const COLUMNS: usize = 8;

/// The pictures of a report, by file name.
#[derive(Default)]
pub(super) struct Figures {
    /// Source, title and file.
    plots: Vec<(String, &'static str, String)>,
    pub confusion: Option<String>,
    pub intensities: Option<String>,
    /// Title and file.
    pub sheets: Vec<(String, String)>,
}

impl Figures {
    pub(super) fn of_source<'a>(
        &'a self,
        source: &'a str,
    ) -> impl Iterator<Item = (&'static str, &'a str)> {
        let plots = self.plots.iter().filter(move |(of, _, _)| of == source);
        plots.map(|(_, title, file)| (*title, file.as_str()))
    }

    /// Draws everything into `album`. Without a head there are no contact sheets.
    pub(super) fn draw(
        album: &Album,
        performed: &[Performed],
        results: &Results,
        (speaker, wish, head): (&Speaker, &Wish, Option<&Path>),
    ) -> Result<Self> {
        let mut out = Figures::default();
        for source in performed.iter().filter(|p| p.corpus.recorded) {
            out.plots_of(album, source)?;
        }
        if let Some(reading) = &results.reading {
            out.confusion = Some(album.confusion("confusion", reading)?);
        }
        if !results.intensity.is_empty() {
            out.intensities = Some(album.intensities("intensity", &results.intensity)?);
        }
        if let Some(folder) = head {
            let head = Head::read(&speaker.engine, folder)?;
            let recorded = performed.iter().filter(|p| p.corpus.recorded);
            for source in recorded {
                out.speech_sheet(album, (speaker, &head), source)?;
            }
            let first = performed.first().and_then(|p| p.corpus.held_out.first());
            if let Some(clip) = first.filter(|_| speaker.shows_emotion()) {
                out.emotion_sheet(album, (speaker, &head), wish, clip)?;
            }
        }
        Ok(out)
    }

    fn plots_of(&mut self, album: &Album, source: &Performed) -> Result<()> {
        let name = &source.corpus.source;
        let model = source.model();
        let every = model.len().div_ceil(TRACKS).max(1);
        let tracks: Vec<Track<'_>> = model
            .iter()
            .step_by(every)
            .map(|(clip, motion)| track(clip, motion))
            .collect::<Result<_>>()?;
        let mut keep = |title, file| self.plots.push((name.clone(), title, file));
        let file = album.gap_tracks(&format!("gap_{name}"), &tracks)?;
        keep("Lip gap over time", file);
        let mut gaps = Vec::new();
        let mut spectra = Vec::new();
        for (predictor, motions) in source.with_recording() {
            if ![RECORDED, MODEL, "loudness"].contains(&predictor) {
                continue;
            }
            let mut all = Vec::new();
            let mut spectrum = Spectrum::default();
            for (clip, motion) in motions {
                let gap = gap_mm(clip.face(predictor), motion.view())?;
                spectrum.add(&Spectrum::of(&gap, clip.fps, SEGMENT));
                all.extend(gap);
            }
            gaps.push((predictor, all));
            spectra.push((predictor, spectrum));
        }
        let file = album.gap_histogram(&format!("histogram_{name}"), &gaps)?;
        keep("Histogram of the lip gap", file);
        let file = album.spectra(&format!("spectrum_{name}"), &spectra)?;
        keep("Spectrum of the lip gap", file);
        Ok(())
    }

    /// Draws the recording and the model below it over the first three seconds of the first clip.
    fn speech_sheet(
        &mut self,
        album: &Album,
        (speaker, head): (&Speaker, &Head),
        source: &Performed,
    ) -> Result<()> {
        let model = source.model();
        let Some((clip, prediction)) = model.first() else {
            return Ok(());
        };
        let frames = spread(clip.frames().min((3.0 * clip.fps) as usize));
        let at = |t: &usize| format!("{:.2} s", *t as f64 / clip.fps);
        let row = |title: &str, motion: &Array3<f64>| Row {
            title: title.into(),
            motion: motion.select(Axis(0), &frames),
        };
        let name = &source.corpus.source;
        let file = album.sheet(
            &format!("speech_{name}"),
            (&speaker.engine, head),
            &frames.iter().map(at).collect::<Vec<_>>(),
            &[row(RECORDED, &clip.motion), row(MODEL, prediction)],
        )?;
        let title = format!("Speech: {name}, held-out clip {}", clip.name);
        self.sheets.push((title, file));
        Ok(())
    }

    /// Draws every category at intensity 1 on one clip.
    fn emotion_sheet(
        &mut self,
        album: &Album,
        (speaker, head): (&Speaker, &Head),
        wish: &Wish,
        clip: &Clip,
    ) -> Result<()> {
        let frames = spread(clip.frames());
        let rows = EMOTIONS.iter().enumerate().map(|(e, name)| {
            let motion = speaker.speak(clip, &with_emotion(wish, e, 1.0))?;
            Ok(Row {
                title: (*name).into(),
                motion: motion.select(Axis(0), &frames),
            })
        });
        let rows: Vec<Row> = rows.collect::<Result<_>>()?;
        let at = |t: &usize| format!("{:.2} s", *t as f64 / clip.fps);
        let columns: Vec<String> = frames.iter().map(at).collect();
        let file = album.sheet("emotions", (&speaker.engine, head), &columns, &rows)?;
        let title = format!("Emotion at intensity 1, held-out clip {}", clip.name);
        self.sheets.push((title, file));
        Ok(())
    }
}

fn track<'a>(clip: &'a Clip, motion: &Array3<f64>) -> Result<Track<'a>> {
    Ok(Track {
        title: clip.name.clone(),
        waveform: &clip.waveform,
        fps: clip.fps,
        recorded: gap_mm(&clip.speaker, clip.motion.view())?,
        model: gap_mm(&clip.neutral, motion.view())?,
    })
}

/// Evenly spaced frames, none of them at either end of the clip.
fn spread(frames: usize) -> Vec<usize> {
    (1..=COLUMNS).map(|k| k * frames / (COLUMNS + 1)).collect()
}
