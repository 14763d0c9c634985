//! Whether the mouth opens wider when the voice makes more effort.
//!
//! Compares the same actor saying the same sentence with different emotions (Berlin Database of
//! Emotional Speech, Burkhardt et al. 2005, CC0), and a whisper and a shout made from one
//! recording.

use std::{collections::BTreeMap, path::Path};

use super::{
    bootstrap::{estimate, mean, median},
    clip::{Clip, spaced},
    row::Row,
    speaker::{Speaker, Wish},
    voices::{shouted, whispered},
};
use crate::metrics::quantile;
use anyface::{Error, Result, audio::Waveform};

/// The loud emotion, and the softer ones to compare it with.
const LOUD: &str = "anger";
const SOFT: [&str; 3] = ["sadness", "boredom", "neutral"];
/// The most recordings to turn into a whisper and a shout.
const SYNTHETIC_PAIRS: usize = 16;
const FPS: f64 = 25.0;
const CHIN: usize = 8;
const WIDE: f64 = 0.95;
const MM: f64 = 1000.0;

/// A line of `clips.tsv`.
struct Recording {
    name: String,
    emotion: String,
    /// Actor and sentence.
    key: (String, String),
}

/// Measures both comparisons. The emotion setting stays neutral, so only the voice differs.
///
/// `spoken`: clips to turn into whispers and shouts; `limit`: the most pairs of actor and sentence.
pub(super) fn measure(
    speaker: &Speaker,
    wish: &Wish,
    (data, spoken): (&Path, &[&Clip]),
    limit: Option<usize>,
) -> Result<Vec<Row>> {
    let wish = Wish {
        default_controls: true,
        ..wish.clone()
    };
    let mut out = score_acted(speaker, &wish, data, limit)?;
    out.push(score_synthetic(speaker, &wish, spoken)?);
    Ok(out)
}

/// Scores shouts against whispers that are synthesised from the same recordings.
fn score_synthetic(speaker: &Speaker, wish: &Wish, spoken: &[&Clip]) -> Result<Row> {
    let pairs = spaced(spoken, SYNTHETIC_PAIRS).map(|clip| {
        let loud = fall_mm(speaker, wish, &shouted(&clip.waveform))?;
        Ok([loud, fall_mm(speaker, wish, &whispered(&clip.waveform))?])
    });
    let pairs: Vec<[f64; 2]> = pairs.collect::<Result<_>>()?;
    Ok(score("a made shout against a made whisper".into(), &pairs))
}

/// Scores acted anger against the other emotions.
fn score_acted(
    speaker: &Speaker,
    wish: &Wish,
    data: &Path,
    limit: Option<usize>,
) -> Result<Vec<Row>> {
    let folder = data.join("speech/emodb_de");
    let said = by_actor_and_sentence(read(&folder.join("clips.tsv"))?);
    let mut falls: BTreeMap<&'static str, Vec<[f64; 2]>> = BTreeMap::new();
    for emotions in said.values().take(limit.unwrap_or(usize::MAX)) {
        let fall = |emotion: &str| -> Result<Option<f64>> {
            let matching = emotions.iter().find(|r| r.emotion == emotion);
            let measured = matching.map(|r| {
                let sound = Waveform::from_file(&folder.join(format!("{}.ogg", r.name)))?;
                fall_mm(speaker, wish, &sound)
            });
            measured.transpose()
        };
        let Some(loud) = fall(LOUD)? else { continue };
        for against in SOFT {
            let pair = fall(against)?.map(|soft| [loud, soft]);
            falls.entry(against).or_default().extend(pair);
        }
    }
    let rows = SOFT.map(|against| {
        let pairs = falls.get(against).map_or(&[][..], Vec::as_slice);
        score(format!("{LOUD} against {against}"), pairs)
    });
    Ok(rows.into())
}

/// 95 % quantile of how far the chin drops, millimetres.
fn fall_mm(speaker: &Speaker, wish: &Wish, sound: &Waveform) -> Result<f64> {
    let motion = speaker.perform(sound, FPS, wish)?;
    let falls: Vec<f64> = motion
        .outer_iter()
        .map(|frame| -MM * frame[[CHIN, 1]])
        .collect();
    Ok(quantile(&falls, WIDE))
}

fn score(pair: String, pairs: &[[f64; 2]]) -> Row {
    let middle = |k: usize| estimate(pairs, move |of| median(of.iter().map(|pair| pair[k])));
    let ratio = |of: &[&[f64; 2]]| {
        let ratios = of.iter().map(|[loud, soft]| (loud / soft).ln());
        mean(ratios).map(f64::exp)
    };
    Row::default()
        .with("pair", "", 0, pair)
        .with("pairs", "pairs", 0, pairs.len())
        .with("loud_mm", "loud, mm", 1, middle(0))
        .with("soft_mm", "soft, mm", 1, middle(1))
        .with("ratio", "ratio", 2, estimate(pairs, ratio))
}

fn by_actor_and_sentence(recordings: Vec<Recording>) -> BTreeMap<(String, String), Vec<Recording>> {
    let mut out: BTreeMap<_, Vec<Recording>> = BTreeMap::new();
    for recording in recordings {
        out.entry(recording.key.clone())
            .or_default()
            .push(recording);
    }
    out
}

/// Reads `clips.tsv`, finding the columns by their titles.
fn read(path: &Path) -> Result<Vec<Recording>> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let mut lines = text
        .lines()
        .map(|line| line.split('\t').collect::<Vec<_>>());
    let titles = lines.next().unwrap_or_default();
    let place = |title: &str| {
        titles.iter().position(|t| *t == title).ok_or_else(|| {
            Error::InvalidInput(format!(
                "{}: expected a column {title}, got {titles:?}",
                path.display()
            ))
        })
    };
    let columns = [
        place("clip")?,
        place("feeling")?,
        place("actor")?,
        place("sentence")?,
    ];
    let rows = lines.filter(|cells| cells.len() == titles.len());
    let recording = |cells: Vec<&str>| {
        let [name, emotion, actor, sentence] = columns.map(|column| cells[column].to_owned());
        Recording {
            name,
            emotion,
            key: (actor, sentence),
        }
    };
    Ok(rows.map(recording).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_averaged_as_ratios() {
        let result = score("".into(), &[[2.0, 1.0], [4.0, 8.0], [8.0, 1.0]]);
        assert!((result.estimate("ratio").unwrap().value - 2.0).abs() < 1e-12);
        assert_eq!(result.estimate("loud_mm").unwrap().value, 4.0);
        assert_eq!(score("".into(), &[]).estimate("ratio"), None);
    }

    #[test]
    fn recordings_are_matched_by_actor_and_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clips.tsv");
        let text = "clip\tactor\tsentence\tfeeling\na\t03\tb01\tanger\nb\t03\tb01\tsadness\nc\t08\tb01\tanger\n";
        std::fs::write(&path, text).unwrap();
        let recordings = by_actor_and_sentence(read(&path).unwrap());
        assert_eq!(recordings.len(), 2);
        assert_eq!(recordings[&("03".to_owned(), "b01".to_owned())].len(), 2);
        std::fs::write(&path, "clip\tactor\n").unwrap();
        assert!(read(&path).is_err());
    }
}
