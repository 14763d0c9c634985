//! Reads speech with phone times from folders of sound files with a `phones.jsonl`.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use ndarray::Array3;
use serde::Deserialize;

use super::{
    clip::{Clip, Corpus},
    phone::Phone,
};
use crate::face_model::IctLandmarks;
use anyface::{Error, Result, audio::Waveform, mesh::ibug::LANDMARKS};

/// Frame rate for speech without recorded motion.
const FPS: f64 = 25.0;

#[derive(Deserialize)]
struct Line {
    id: String,
    words: Vec<Word>,
}

#[derive(Deserialize)]
struct Word {
    phones: Vec<TimedPhone>,
}

#[derive(Deserialize)]
struct TimedPhone {
    start: f64,
    duration: f64,
    phone: String,
}

/// One folder, with the phones of its utterances in the order of the file.
struct Folder {
    name: String,
    path: PathBuf,
    utterances: Vec<(String, Vec<Phone>)>,
}

/// Adds phones to the clips of `corpora`, and adds a corpus for every other folder in `aligned`.
///
/// An added corpus has at most `limit` utterances, spaced evenly over the folder's.
pub(super) fn attach(
    aligned: &Path,
    corpora: &mut Vec<Corpus>,
    ict: &IctLandmarks,
    limit: usize,
) -> Result<()> {
    for folder in folders(aligned)? {
        match corpora.iter_mut().find(|c| c.source == folder.name) {
            Some(corpus) => give_phones(corpus, folder),
            None => corpora.push(speech_only(folder, ict, limit)?),
        }
    }
    Ok(())
}

fn folders(aligned: &Path) -> Result<Vec<Folder>> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(aligned)
        .map_err(Error::io(aligned))?
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| path.join("phones.jsonl").is_file())
        .collect();
    paths.sort();
    if paths.is_empty() {
        return Err(Error::InvalidInput(format!(
            "{}: expected sub-folders with phones.jsonl, got none",
            aligned.display()
        )));
    }
    paths.into_iter().map(read_folder).collect()
}

fn read_folder(path: PathBuf) -> Result<Folder> {
    let file = path.join("phones.jsonl");
    let text = std::fs::read_to_string(&file).map_err(Error::io(&file))?;
    let lines = text
        .lines()
        .enumerate()
        .filter(|(_, l)| !l.trim().is_empty());
    let utterances = lines.map(|(number, line)| {
        utterance(line).map_err(|e| {
            Error::InvalidInput(format!("{}, line {}: {e}", file.display(), number + 1))
        })
    });
    Ok(Folder {
        name: path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into(),
        utterances: utterances.collect::<Result<_>>()?,
        path,
    })
}

/// Reads an utterance's identifier and its phones, including silences, in order of time.
fn utterance(line: &str) -> std::result::Result<(String, Vec<Phone>), serde_json::Error> {
    let line: Line = serde_json::from_str(line)?;
    let timed = line.words.into_iter().flat_map(|word| word.phones);
    let mut phones: Vec<Phone> = timed
        .map(|p| Phone {
            from_s: p.start,
            to_s: p.start + p.duration,
            name: p.phone,
        })
        .collect();
    phones.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    Ok((line.id, phones))
}

fn give_phones(corpus: &mut Corpus, folder: Folder) {
    let mut by_name: HashMap<String, Vec<Phone>> = folder.utterances.into_iter().collect();
    for clip in &mut corpus.held_out {
        clip.phones = by_name.remove(&clip.name).map(|phones| {
            let moved = phones.into_iter().map(|p| Phone {
                from_s: p.from_s - clip.start_s,
                to_s: p.to_s - clip.start_s,
                name: p.name,
            });
            moved.collect()
        });
    }
}

fn speech_only(folder: Folder, ict: &IctLandmarks, limit: usize) -> Result<Corpus> {
    let count = folder.utterances.len();
    let every = count.div_ceil(limit.max(1)).max(1);
    let chosen = folder.utterances.into_iter().step_by(every);
    let held_out = chosen.map(|(name, phones)| {
        let waveform = Waveform::from_file(&sound_of(&folder.path, &name)?)?;
        let frames = (waveform.duration_s() * FPS).ceil().max(1.0) as usize;
        Ok(Clip {
            name,
            waveform,
            start_s: 0.0,
            motion: Array3::zeros((frames, LANDMARKS, 3)),
            speaker: ict.neutral.clone(),
            neutral: ict.neutral.clone(),
            fps: FPS,
            observed: Vec::new(),
            judged: 0..frames,
            phones: Some(phones),
        })
    });
    Ok(Corpus {
        source: folder.name,
        recorded: false,
        held_out: held_out.collect::<Result<_>>()?,
        training: Vec::new(),
    })
}

fn sound_of(folder: &Path, name: &str) -> Result<PathBuf> {
    let candidates = ["ogg", "wav"].map(|ending| folder.join(format!("{name}.{ending}")));
    candidates
        .into_iter()
        .find(|path| path.is_file())
        .ok_or_else(|| {
            Error::InvalidInput(format!(
                "{}: expected {name}.ogg or {name}.wav",
                folder.display()
            ))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn phone(name: &str) -> Phone {
        Phone {
            from_s: 0.0,
            to_s: 0.1,
            name: name.into(),
        }
    }

    #[test]
    fn lips_close_on_p_b_and_m_in_every_notation() {
        for name in ["p", "ˈb", "ˌm", "pʰ", "bʱ", "mʲ", "mː", "P", "B", "M"] {
            assert!(phone(name).closes_the_lips(), "{name}");
        }
        for name in ["t", "ˈn", "F", "AH0", "SIL", "pau", "sp", "ɸ", ""] {
            assert!(!phone(name).closes_the_lips(), "{name}");
        }
    }

    #[test]
    fn vowels_and_labiodentals_are_told_from_the_rest() {
        let vowels = ["ˈiː", "i", "u", "ˌɑː", "aɪ", "ɪ", "y", "IY1"];
        let result = vowels.map(|name| phone(name).plain_vowel());
        let expected = [
            Some('i'),
            Some('i'),
            Some('u'),
            Some('a'),
            None,
            None,
            None,
            None,
        ];
        assert_eq!(result, expected);
        assert!(
            ["f", "v", "ʋ", "F", "fː"]
                .iter()
                .all(|n| phone(n).is_labiodental())
        );
        assert!(
            ["w", "θ", "β", "ɸ", ""]
                .iter()
                .all(|n| !phone(n).is_labiodental())
        );
    }

    #[test]
    fn a_line_is_read_in_order_of_time() {
        let line = r#"{"id": "a", "words": [
            {"word": "up", "phones": [{"start": 0.5, "duration": 0.25, "phone": "p"}]},
            {"word": "", "phones": [{"start": 0.0, "duration": 0.5, "phone": "SIL"}]}]}"#;
        let (name, phones) = utterance(line).unwrap();
        assert_eq!(name, "a");
        assert!(phones[0].is_silence());
        assert_eq!((phones[1].from_s, phones[1].to_s), (0.5, 0.75));
        assert!(utterance("{}").is_err());
    }
}
