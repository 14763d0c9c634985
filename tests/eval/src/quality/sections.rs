//! Sections of the report, each on one thing that a face does.

use super::{
    bootstrap::number,
    page::{Page, cell},
    results::Results,
};

pub(super) fn vowels(page: &mut Page, results: &Results) {
    if results.vowels.is_empty() {
        return;
    }
    page.block("## Vowels");
    page.block(
        "The model at the middles of i, u and a of at least 40 ms (long and short, ɑ counts as a, no \
         diphthongs): differences of means over all of them. A mouth that speaks is wide in i, comes \
         forward in u and opens in a. mm.",
    );
    page.rows(&results.vowels);
}

pub(super) fn labiodentals(page: &mut Page, results: &Results) {
    if results.labiodentals.is_empty() {
        return;
    }
    page.block("## f and v");
    page.block(
        "On ICT's mean head, in the frame of each f or v (40 ms before it begins to its end) in which \
         the lower lip's inner landmark is nearest to the upper incisors: distance from the nearest \
         vertex of the lower lip to the incisors' edge, and how far the lip's landmarks 66 and 57 lie \
         behind their place at rest. Medians, mm. At rest the distance is 1.3 mm.",
    );
    page.rows(&results.labiodentals);
}

pub(super) fn effort(page: &mut Page, results: &Results) {
    if results.effort.is_empty() {
        return;
    }
    page.block("## Effort");
    page.block(
        "Actors of the Berlin Database of Emotional Speech say one sentence in anger and with another \
         emotion; of recordings of other sources a whisper (noise through their own resonances) and a \
         shout (pitch 1.4 times, resonances 1.15 times as high, 6 dB an octave more above 1 kHz) are \
         made. The model hears the voice and is told no emotion. How far the chin falls, 95 % quantile \
         of a recording: medians in mm, and the geometric mean of the pairs' ratios.",
    );
    page.rows(&results.effort);
}

pub(super) fn reading(page: &mut Page, results: &Results) {
    page.block("## Emotion");
    let Some(reading) = &results.reading else {
        return;
    };
    page.block(format!(
        "Blind reading: a linear discriminant that learned nothing but ICT's own expression modes, \
         mixed at full strength as the Facial Action Coding System describes six emotions and none, \
         over speaking mouths and with 1 mm of noise on every coordinate, sees the heads' motion at the landmarks in stills of the model at \
         intensity 1. Of such mixes, drawn anew, it names {} %; of the model's stills on all heads \
         {} %. Chance is {} %. Anger is what most stills are read as on {} of {} heads, sadness on {}.",
        number(reading.own_percent, 0),
        cell(reading.accuracy_percent.as_ref(), 1),
        number(100.0 / reading.answers.len() as f64, 0),
        reading.heads_read("angry"),
        reading.heads.len(),
        reading.heads_read("sad"),
    ));
    let rows = reading.heads.iter().flat_map(|head| {
        head.confusion
            .iter()
            .zip(&reading.answers[1..])
            .map(|(row, emotion)| {
                let names = [head.head.to_owned(), (*emotion).to_owned()];
                let shares = row.iter().map(|count| match count {
                    0 => String::new(),
                    count => number(100.0 * *count as f64 / head.stills as f64, 0),
                });
                names.into_iter().chain(shares).collect()
            })
    });
    let mut titles = vec!["head", "performed"];
    titles.extend(&reading.answers);
    page.table(&titles, rows.collect::<Vec<_>>());
    page.block("Columns: what was read, % of the stills.");
}

pub(super) fn life(page: &mut Page, results: &Results) {
    page.block("## Head, gaze and blinks");
    page.block(
        "Of each held-out clip of grid_s1, with all controls at their defaults: the tracked speaker's \
         5, 50 and 95 % over clips, and the performance's mean over the same clips. Saccades are \
         turns of the eyes of more than 3° between frames of video while the lids are open; a blink \
         is an opening of the lids under half of the clip's widest. The speaker reads from a screen \
         and looks down at it, so his rates are high.",
    );
    page.rows(&results.life);
}
