use std::{collections::HashMap, sync::Arc};

use safetensors::{SafeTensors, tensor::TensorView};

use super::{super::SpeechFeatures, *};
use crate::{audio::Waveform, job::SILENT, speech::SpeechEncoder};

fn floats(view: &TensorView<'_>) -> Vec<f32> {
    let bytes = view.data().chunks_exact(4);
    bytes
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

fn array(file: &SafeTensors<'_>, name: &str) -> Array2<f32> {
    let view = file.tensor(name).unwrap();
    Array2::from_shape_vec((view.shape()[0], view.shape()[1]), floats(&view)).unwrap()
}

/// The model in the golden file, the file's bytes, and its text.
fn debug_model() -> (PhoneModel, Vec<u8>, String) {
    let path = "/../tests/goldens/phones_debug.safetensors";
    let bytes = std::fs::read(format!("{}{path}", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let (_, metadata) = SafeTensors::read_metadata(&bytes).unwrap();
    let metadata = metadata.metadata().as_ref().unwrap().clone();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let weights: HashMap<String, TensorView<'_>> = file
        .tensors()
        .into_iter()
        .filter_map(|(name, view)| Some((name.strip_prefix("weights.")?.to_owned(), view)))
        .collect();
    let weights = safetensors::serialize(&weights, None).unwrap();
    let model = PhoneModel::load(&weights, &metadata["config"]).unwrap();
    (model, bytes, metadata["text"].clone())
}

#[test]
fn posteriors_match_the_training_code() {
    let (model, bytes, _) = debug_model();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let output = model.log_posteriors(array(&file, "input").view());
    let known = array(&file, "output");
    assert_eq!(output.dim(), known.dim());
    let most = output.iter().zip(&known).map(|(a, b)| (a - b).abs());
    assert!(most.fold(0.0, f32::max) < 1e-4);
}

#[test]
fn the_path_through_a_text_matches_the_training_code() {
    let (model, bytes, text) = debug_model();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let mut likelihood = model.log_posteriors(array(&file, "input").view());
    likelihood -= &(PRIOR_POWER * &model.log_prior);
    let words = text.split_whitespace();
    let words: Vec<Word> = words.map(|w| Word::read(w, &model.config.units)).collect();
    let states = states_of(&words, model.config.units.len());
    let (path, _) = best_path(&model.emissions(&likelihood), &states).unwrap();
    let unit = |state: &usize| {
        states[*state]
            .word
            .map_or(-1.0, |_| states[*state].column as f32)
    };
    let said: Vec<f32> = path.iter().map(unit).collect();
    assert_eq!(said, floats(&file.tensor("said").unwrap()));
}

/// A second of noise in two bursts, [16000].
fn bursts() -> Vec<f32> {
    let mut state = 1u32;
    let samples = (0..16_000).map(|i| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let loud = (i as f32 / 16_000.0 * 9.0).sin().max(0.0);
        loud * ((state >> 8) as f32 / (1 << 24) as f32 - 0.5)
    });
    samples.collect()
}

/// A sound, encoded by the built-in encoder.
fn heard(samples: Vec<f32>) -> SpeechFeatures {
    let encoder: Arc<dyn SpeechEncoder> = Arc::new(crate::speech::ear(None).unwrap());
    SpeechFeatures::of(&Waveform { samples }, &encoder, SILENT).unwrap()
}

#[test]
fn words_stand_in_their_order_within_the_sound() {
    let model = PhoneModel::open(None).unwrap();
    let text = "— see, \"shoes\" !";
    let (said, _) = model
        .said(heard(bursts()).phone_input(), Some(text))
        .unwrap();
    let labels: Vec<&str> = said.words.iter().map(|word| word.label.as_str()).collect();
    assert_eq!(labels, ["see", "shoes"]);
    for tier in [&said.words, &said.phones] {
        assert!(
            tier.iter()
                .all(|i| 0.0 <= i.start_s && i.start_s < i.end_s && i.end_s <= 1.0)
        );
        assert!(tier.windows(2).all(|pair| pair[0].end_s <= pair[1].start_s));
    }
    let (said, _) = model.said(heard(bursts()).phone_input(), None).unwrap();
    assert!(said.words.is_empty());
}

/// A word, silence and the word again: neither lasts into the silence.
#[test]
fn words_end_where_silence_begins() {
    let heard = heard([bursts(), vec![0.0; 16_000], bursts()].concat());
    let model = PhoneModel::open(None).unwrap();
    let (said, _) = model
        .said(heard.phone_input(), Some("see shoes see shoes"))
        .unwrap();
    let gaps = said
        .words
        .windows(2)
        .map(|pair| pair[1].start_s - pair[0].end_s);
    let longest = gaps.fold(0.0, f64::max);
    assert!(longest > 0.9, "{:?}", said.words);
}

/// What the level says about pauses: for them in silence, against them in speech, little in noise.
#[test]
fn silence_speaks_for_a_pause() {
    let tone = |gain: f32| (0..8000).map(move |i| gain * (i as f32 * 0.3).sin());
    let clock = Clock {
        rate_hz: 100.0,
        duration_s: 1.0,
    };
    let at = |quiet: f32| {
        let samples = tone(0.5).chain(tone(quiet)).collect();
        let of = silences(&Prosody::of(&Waveform { samples }), clock, 100);
        (of[25], of[75])
    };
    assert_eq!(at(1e-4), (-SILENCE_POWER, SILENCE_POWER));
    let (_, in_noise) = at(0.3);
    assert!(
        0.0 < in_noise && in_noise < 0.7 * SILENCE_POWER,
        "{in_noise}"
    );
    let none = Prosody::of(&Waveform {
        samples: Vec::new(),
    });
    assert_eq!(silences(&none, clock, 3), [0.0; 3]);
}

#[test]
fn english_words_are_read_by_their_phones_and_others_letter_by_letter() {
    let model = PhoneModel::open(None).unwrap();
    let read = |words: &[&'static str]| {
        let spoken: Vec<(&str, _)> = words.iter().map(|word| (*word, None)).collect();
        let letters = words
            .iter()
            .map(|word| Word::read(word, &model.config.units));
        let letters: Vec<Word> = letters.collect();
        (model.english(&spoken, &letters).unwrap(), letters)
    };
    let (english, letters) = read(&["“What”", "xyzzy", "well-known"]);
    let english = english.unwrap();
    let sounds = |word: &Word| -> String {
        let names = word
            .units
            .iter()
            .map(|unit| model.config.units[*unit].as_str());
        names.collect()
    };
    assert_eq!(sounds(&english[0]), "/w/ʌ/t");
    assert_eq!(sounds(&english[2]), "/w/ɛ/l/n/o/ʊ/n");
    assert_eq!(english[1], letters[1]);
    assert!(read(&["xyzzy"]).0.is_none());
}

#[test]
fn texts_that_cannot_be_are_refused() {
    let (model, heard) = (PhoneModel::open(None).unwrap(), heard(bursts()));
    for text in ["", " – … ", &"word ".repeat(200)] {
        assert!(
            matches!(
                model.said(heard.phone_input(), Some(text)),
                Err(Error::InvalidInput(_))
            ),
            "{text}"
        );
    }
    let (other, ..) = debug_model();
    assert!(matches!(
        other.said(heard.phone_input(), None),
        Err(Error::Weights(_))
    ));
}

#[test]
fn a_change_of_phone_costs() {
    // One row in which another phone is a little likelier changes nothing. Six rows do.
    let row = |class: usize| if class == 0 { [0.0, -2.0] } else { [-2.0, 0.0] };
    let rows = |classes: &[usize]| {
        let values: Vec<f32> = classes.iter().flat_map(|class| row(*class)).collect();
        Array2::from_shape_vec((classes.len(), 2), values).unwrap()
    };
    assert_eq!(decode(rows(&[0, 0, 1, 0, 0]).view()), [0; 5]);
    let clear = [0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0];
    assert_eq!(decode(rows(&clear).view()), clear);
    assert!(decode(Array2::zeros((0, 2)).view()).is_empty());
}

#[test]
fn hiss_brings_no_lip_to_the_teeth() {
    let encoder = crate::speech::ear(None).unwrap();
    let mut state = 1u32;
    let samples = (0..48_000).map(|_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        0.1 * ((state >> 8) as f32 / (1 << 24) as f32 - 0.5)
    });
    let sound = Waveform {
        samples: samples.collect(),
    };
    let features = encoder.encode(&sound, SILENT).unwrap().features;
    let model = PhoneModel::open(None).unwrap();
    let at_teeth = model
        .contacts(model.log_posteriors(features.view()).view(), 25.0)
        .at_teeth;
    assert!(at_teeth.iter().all(|p| *p < 0.2));
}
