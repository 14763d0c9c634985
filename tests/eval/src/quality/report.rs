//! The report as Markdown; every number in it comes from [`Results`].

use super::{
    bootstrap::{Estimate, RESAMPLES, number},
    clip::RECORDED,
    closures::{CLOSED_MM, SHUT},
    emotions::{INTENSITIES, OWN_LANDMARKS},
    events,
    facegood::WHOLE_TAKES,
    figures::Figures,
    measures::{measures, pairs},
    page::{Page, cell},
    predictors::MODEL,
    results::{Results, SourceScores},
    sections,
    seeds::SEEDS,
};

/// Measures that the first table shows besides r and slope of the features.
const GLANCE: [&str; 2] = ["lag_ms", "lve_root_mm"];

/// The whole report; pictures are linked under `images`.
pub(super) fn markdown(results: &Results, figures: &Figures, images: &str) -> String {
    let mut page = Page::default();
    header(&mut page, results);
    for source in &results.sources {
        recorded_source(&mut page, source);
        for (title, file) in figures.of_source(&source.source) {
            page.picture(&format!("{title}, {}", source.source), images, file);
        }
    }
    definitions(&mut page);
    closures(&mut page, results);
    sections::vowels(&mut page, results);
    sections::labiodentals(&mut page, results);
    silence(&mut page, results);
    sections::effort(&mut page, results);
    sections::reading(&mut page, results);
    if let Some(file) = &figures.confusion {
        page.picture("Confusion of emotions, all heads together", images, file);
    }
    intensity(&mut page, results);
    if let Some(file) = &figures.intensities {
        page.picture("Displacement, mm, over intensity", images, file);
    }
    sections::life(&mut page, results);
    seeds(&mut page, results);
    if let Some(scores) = &results.events {
        events::section(&mut page, scores);
    }
    seams(&mut page, results);
    steps(&mut page, results);
    timing(&mut page, results);
    sheets(&mut page, figures, images);
    page.text.trim_end().to_owned() + "\n"
}

fn header(page: &mut Page, results: &Results) {
    page.block("# Measured quality");
    page.block("This page is generated; do not edit it. The command, from the repository's root:");
    page.block(format!("```\n{}\n```", results.command));
    page.block(format!(
        "Numbers in brackets are 95 % confidence intervals: percentile bootstrap over clips, \
         {RESAMPLES} resamples, fixed seed. They hold the sampling of clips, not the choice of \
         speakers: each recorded source is one person. Lengths are millimetres on a head of human \
         size. The motion is what the engine makes of speech by itself, without blinks or brow \
         accents."
    ));
    page.block(
        "The truth of grid_s1 is the track of MediaPipe Face Landmarker (Apache-2.0), each frame by \
         itself. Until November 2026 this page used another track of the same video, which measured \
         everything too small: the lips' gap less than half, and lips that never closed. Numbers \
         measured on it, and models trained on it, cannot be compared with these.",
    );
    let weights = results.weights.iter();
    let rows = weights.map(|w| vec![w.name.clone(), format!("`{}`", w.blake3)]);
    page.table(&["weights", "BLAKE3 of the weights"], rows);
    glance(page, results);
}

/// One row for every predictor on every recorded source.
fn glance(page: &mut Page, results: &Results) {
    page.block("## At a glance");
    let others = GLANCE.iter();
    let others: Vec<_> = others
        .filter_map(|k| measures().find(|m| m.key == *k))
        .collect();
    let mut titles = vec!["source", "predictor", "gap", "width", "chin", "protrusion"];
    titles.extend(others.iter().map(|m| m.title));
    let rows = results.sources.iter().flat_map(|source| {
        source.predictors.iter().map(|predictor| {
            let value = |m: &super::measures::Measure| {
                let score = predictor.scores.get(m.key);
                score.map_or("–".into(), |e| number(e.value, m.digits))
            };
            let features = pairs().map(|[r, slope]| format!("{} / {}", value(r), value(slope)));
            let names = [source.source.clone(), predictor.name.clone()];
            let others = others.iter().map(|m| value(m));
            names.into_iter().chain(features).chain(others).collect()
        })
    });
    page.table(&titles, rows.collect::<Vec<_>>());
    page.block(format!(
        "Features as r by clip / slope; a slope of 0.9 means that the motion is 0.9 times as large as \
         the recording's. `{MODEL}` is the model in its default style, as a user gets it; `{MODEL}, style …` is \
         asked for the style of that source; `stream` is its causal twin. `constant` is the mean \
         face of the source's own training clips. `loudness` draws a straight line for every coordinate \
         over the sound's level, fitted to the same clips. The name of a system stands for its motion in the default \
         settings. Every other name is motion from a file."
    ));
    page.block(format!(
        "Held out of grid_s1 is every tenth clip; of facegood_zh the last 15 % of each take, whose \
         beginning training saw. `{WHOLE_TAKES}`, where it is shown, holds whole takes under motion \
         from models that were trained without the take, or without the source, as their names say; \
         a name that leaves out grid_s1 is such a model on that source."
    ));
}

fn recorded_source(page: &mut Page, source: &SourceScores) {
    page.block(format!("## {}", source.source));
    page.block(format!(
        "{} held-out clips, {} frames.",
        source.clips, source.frames
    ));
    let mut titles = vec!["measure"];
    titles.extend(source.predictors.iter().map(|p| p.name.as_str()));
    let rows = measures().map(|measure| {
        let cells = source.predictors.iter();
        let cells = cells.map(|p| match (measure.key, p.scores.get(measure.key)) {
            ("clips", Some(count)) => number(count.value, 0),
            (_, score) => cell(score, measure.digits),
        });
        [measure.title.to_owned()]
            .into_iter()
            .chain(cells)
            .collect()
    });
    page.table(&titles, rows.collect::<Vec<_>>());
}

fn definitions(page: &mut Page) {
    page.block("## Definitions");
    page.block(
        "Landmarks are numbered as iBUG-68. Only landmarks and frames that the recording saw are \
         judged; lids of grid_s1, which blink and read, are not. Distances compare displacements from \
         rest; features are those of the recording on its speaker's face, of a prediction on the one \
         that models move. Means over clips are weighted by frames.",
    );
    let rows = measures().map(|m| vec![m.title.to_owned(), m.definition.to_owned()]);
    page.table(&["measure", "what it is"], rows.collect::<Vec<_>>());
}

fn closures(page: &mut Page, results: &Results) {
    if results.closures.is_empty() {
        return;
    }
    page.block("## Lip closure on p, b, m");
    page.block(format!(
        "Closed: somewhere between half of the phone before (40 to 120 ms) and the phone's end the \
         inner-lip gap comes within {CLOSED_MM} mm of the neutral face's own. By share: there it \
         falls under {:.0} % of the clip's 95 % quantile. Gap: the smallest in that window above the \
         neutral face's, median. Timing: distance of the gap's minimum, up to 100 ms outside that \
         window, from the window's middle, median. Closed at any time: share of all frames, what a \
         mouth would reach by chance. Sources without recorded motion use ICT's neutral face; \
         `espeak_…` are spoken by espeak-ng, and fi, hu and el are languages that no training \
         heard.",
        100.0 * SHUT
    ));
    page.rows(results.closures.iter().flat_map(|source| &source.rows));
}

fn silence(page: &mut Page, results: &Results) {
    page.block("## Pauses");
    page.block(
        "Root mean square of the lips' speed (landmarks 48 to 67) in pauses and in speech. Pauses \
         are gaps between phones where these are known, else stretches within 6 dB of the clip's \
         quiet level (10 % quantile), at least 25 and at most 35 dB under its loud level (95 %); at \
         least 0.3 s long, without 0.1 s at either end. Gap: median inner-lip gap in pauses above \
         the neutral face's own.",
    );
    page.rows(&results.silence);
    if let Some(nothing) = &results.digital_silence {
        page.block(format!(
            "In digital silence (the middle of 4 s of zeros) the lips move at {} mm/s and stand {} \
             mm from the neutral face.",
            number(nothing.mm_per_s, 2),
            number(nothing.offset_mm, 2)
        ));
    }
}

fn intensity(page: &mut Page, results: &Results) {
    if results.intensity.is_empty() {
        return;
    }
    page.block(format!(
        "Intensity: mean displacement, from the performance at intensity 0, of the \
         {OWN_LANDMARKS} landmarks that the category moves most (chosen on other clips), averaged \
         over time first. mm. Of the prototype: the performed expression at intensity 1, projected on \
         what the table of expressions says, as a share of it."
    ));
    let levels: Vec<String> = INTENSITIES.iter().map(f32::to_string).collect();
    let mut titles = vec!["category"];
    titles.extend(levels.iter().map(String::as_str));
    titles.extend(["grows at every step", "of the prototype, %"]);
    let rows = results.intensity.iter().map(|curve| {
        let values = curve.mm.iter().skip(1).map(|mm| number(*mm, 2));
        let verdict = if curve.grows { "yes" } else { "no" };
        let name = [curve.emotion.to_owned()].into_iter();
        let share = number(curve.projection_percent, 0);
        name.chain(values)
            .chain([verdict.to_owned(), share])
            .collect()
    });
    page.table(&titles, rows.collect::<Vec<_>>());
}

fn seeds(page: &mut Page, results: &Results) {
    page.block("## Seeds");
    page.block(format!(
        "{SEEDS} seeds on each clip, with all controls at their defaults: standard deviation of a \
         landmark's place between seeds, mean over frames and landmarks; Pearson r of the lip gap \
         between seeds; and the largest difference that the seed makes to the smallest gap of any p, \
         b or m."
    ));
    page.rows(&results.seeds);
}

fn seams(page: &mut Page, results: &Results) {
    let Some(seams) = &results.seams else {
        return;
    };
    page.block("## Long sounds");
    page.block(format!(
        "{} s of held-out clips in a row, in windows of {} frames that share {}: root mean square \
         over all landmarks in the shared frames against the rest, and against the same frames of \
         the same sound performed half a stride later, where windows meet elsewhere. 1: a seam \
         cannot be told. {} seams; intervals over seams.",
        number(seams.seconds, 0),
        seams.window_frames,
        seams.overlap_frames,
        seams.seams
    ));
    let row = |name: &str, rest: &Option<Estimate>, paired: &Option<Estimate>| {
        vec![
            name.into(),
            cell(rest.as_ref(), 3),
            cell(paired.as_ref(), 3),
        ]
    };
    let rows = [
        row("speed", &seams.speed, &seams.paired_speed),
        row(
            "acceleration",
            &seams.acceleration,
            &seams.paired_acceleration,
        ),
    ];
    page.table(&["", "over the rest", "over the same frames"], rows);
}

fn steps(page: &mut Page, results: &Results) {
    if results.steps.is_empty() {
        return;
    }
    page.block("## Denoising steps");
    page.block("Work is processor time where the system tells it, else time that passed.");
    page.rows(&results.steps);
}

fn timing(page: &mut Page, results: &Results) {
    page.block("## Time and memory");
    let timing = &results.timing;
    page.block(format!(
        "Speech to landmark motion at 30 fps, encoder and denoiser, on {} thread{}. Work is the \
         processor time of all threads where the system tells it, elapsed the time that passed on \
         a machine that may have been busy; the shortest sound was run five times (mean and \
         median). Memory is the whole process's peak, the data of this report included.",
        timing.threads,
        if timing.threads == 1 { "" } else { "s" }
    ));
    let rows = timing.runs.iter().map(|run| {
        vec![
            number(run.sound_s, 0),
            number(run.work_s, 2),
            number(run.elapsed_s, 2),
            run.peak_mib.map_or("–".into(), |mib| number(mib, 0)),
        ]
    });
    let titles = ["sound, s", "work, s", "elapsed, s", "peak memory, MiB"];
    page.table(&titles, rows.collect::<Vec<_>>());
    if let Some([slope, offset]) = timing.line {
        page.block(format!(
            "Least-squares line: {} s of work to 1 s of sound, and {} s.",
            number(slope, 4),
            number(offset, 2)
        ));
    }
}

fn sheets(page: &mut Page, figures: &Figures, images: &str) {
    if figures.sheets.is_empty() {
        return;
    }
    page.block("## Contact sheets");
    page.block(format!(
        "The default head under the model's motion, and under the `{RECORDED}` motion where it \
         says so."
    ));
    for (title, file) in &figures.sheets {
        page.block(title);
        page.picture(title, images, file);
    }
}
