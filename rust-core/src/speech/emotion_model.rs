//! A classifier of emotions from a user's Hugging Face folder: `Wav2Vec2ForSequenceClassification`,
//! `HubertForSequenceClassification`, or the same encoders under a regression head.

use std::{collections::BTreeMap, path::Path};

use ndarray::{Array1, Axis, Slice};
use serde::Deserialize;

use super::{shown_emotion::shown, transformer_encoder::TransformerEncoder};
use crate::{
    Error, Result,
    audio::Waveform,
    conditions::{EMOTIONS, Emotion, EmotionCurve},
    job::{InputKind, ProgressFn, read_text},
    models::{Weights, checkpoint},
    nn::{
        elementwise::{softmax, tanh},
        finite::check_result,
        linear::Linear,
    },
};

/// The names that published models give each emotion.
const NAMES: [(&str, &str); 12] = [
    ("neutral", "neutral neu"),
    (
        "happy",
        "happy hap happiness joy joyful glad excited excitement laughter",
    ),
    ("pleased", "pleased amused content"),
    ("calm", "calm boredom bored tired sleepy"),
    ("surprised", "surprised surprise sur"),
    ("sad", "sad sadness"),
    ("upset", "upset frustrated frustration"),
    ("ashamed", "ashamed shame guilt"),
    ("afraid", "afraid fear fearful fea scared"),
    ("angry", "angry ang anger mad"),
    ("disgusted", "disgusted disgust dis"),
    ("contempt", "contempt"),
];
/// Seconds between instants.
const STEP_S: f64 = 0.25;
/// Seconds of sound before and after each instant.
const AROUND_S: f64 = 1.0;
/// A sound shorter than this has no emotion, seconds.
const LEAST_S: f64 = 0.8;
/// Distance from the middle of arousal and valence at which an emotion begins. 1 is the rim of the
/// circle.
const FELT_FROM: f64 = 0.2;
/// Distance at which it shows fully.
const FELT_FULLY: f64 = 0.8;

/// Labels and head in `config.json`.
#[derive(Deserialize)]
struct Config {
    model_type: String,
    #[serde(default)]
    id2label: BTreeMap<String, String>,
    #[serde(default)]
    use_weighted_layer_sum: bool,
    #[serde(default)]
    classifier_proj_size: Option<usize>,
}

/// Recognises emotions by a published model.
///
/// Its categories are mapped to [`EMOTIONS`] by name; other labels count as neutral. Arousal and
/// valence, from 0 to 1, give a direction on Russell's circle (1980): happy, angry (afraid if the
/// model has dominance and it is below the middle), sad, calm.
pub struct EmotionModel {
    encoder: TransformerEncoder,
    inner: Linear,
    /// Whether [`tanh`] stands between the two layers.
    is_regression: bool,
    outer: Linear,
    tells: Tells,
}

/// The meaning of the outputs.
#[derive(Debug, PartialEq)]
enum Tells {
    /// The index in [`EMOTIONS`] of each output.
    Categories(Vec<usize>),
    /// Indices of the outputs.
    Dimensions {
        arousal: usize,
        valence: usize,
        dominance: Option<usize>,
    },
}

impl EmotionModel {
    /// Reads `config.json` with `id2label`, the weights and, if present,
    /// `preprocessor_config.json`.
    ///
    /// # Errors
    /// `Io` if a file cannot be read; `Weights` if one is damaged, they do not fit each other, or no
    /// label is known.
    pub fn load_folder(folder: &Path) -> Result<Self> {
        let path = folder.join("config.json");
        let text = read_text(&path, InputKind::Text)?;
        let bad = |what: String| Error::Weights(format!("{}: {what}", path.display()));
        let config: Config = serde_json::from_str(&text).map_err(|e| bad(e.to_string()))?;
        if !["hubert", "wav2vec2"].contains(&config.model_type.as_str()) {
            let got = &config.model_type;
            return Err(bad(format!(
                "model_type: expected hubert or wav2vec2, got {got}"
            )));
        }
        let labels = config.labels().map_err(bad)?;
        let tells = Tells::of(&labels).map_err(bad)?;
        let weights = checkpoint::read(folder)?;
        let mut encoder =
            TransformerEncoder::load_with(folder, &config.model_type, None, &weights)?;
        if config.use_weighted_layer_sum {
            encoder = encoder.mixed(&weights)?;
        }
        let is_regression = weights.contains("classifier.dense.weight");
        let (inner, outer) = head(&weights, &config, encoder.channels(), labels.len())?;
        Ok(EmotionModel {
            encoder,
            inner,
            is_regression,
            outer,
            tells,
        })
    }

    /// The emotion of a voice over time: the mean of the results for the whole sound and for the
    /// second before and after each instant. Categories become expressions by the same rule as those
    /// of the built-in ear.
    ///
    /// # Errors
    /// `Audio` for a sound too short for the encoder; `Numerics` where the weights give numbers
    /// that are not finite; `Cancelled`.
    pub fn emotion(&self, waveform: &Waveform, progress: ProgressFn<'_>) -> Result<EmotionCurve> {
        if waveform.duration_s() < LEAST_S {
            return Ok(EmotionCurve::default());
        }
        let track = self.encoder.encode(waveform, progress)?;
        let frames = track.features.nrows();
        let frame = |time_s: f64| ((time_s - track.first_s) * track.rate_hz).round().max(0.0);
        let pooled = |from: f64, to: f64| {
            let (from, to) = (frame(from) as usize, frame(to) as usize);
            let from = from.min(frames - 1);
            let around = Slice::from(from..to.clamp(from + 1, frames));
            let around = track.features.slice_axis(Axis(0), around);
            self.outputs(&around.mean_axis(Axis(0)).expect("a frame"))
        };
        let whole = pooled(0.0, waveform.duration_s())?;
        let count = (waveform.duration_s() / STEP_S) as usize;
        let key = |k: usize| {
            let time_s = k as f64 * STEP_S;
            let near = pooled(time_s - AROUND_S, time_s + AROUND_S)?;
            let heard = 0.5 * (&whole + &near);
            Ok((time_s, self.tells.emotion(&heard)))
        };
        let keys: Result<_> = (0..=count).map(key).collect();
        Ok(EmotionCurve::Keys(keys?))
    }

    /// Probabilities of the labels, or the dimensions, from the mean feature of some frames, `[C]`.
    fn outputs(&self, pooled: &Array1<f32>) -> Result<Array1<f64>> {
        let mut outputs = self.logits(pooled);
        check_result("emotion of the voice", outputs.view().into_dyn())?;
        if matches!(self.tells, Tells::Categories(_)) {
            softmax(outputs.as_slice_mut().expect("contiguous"));
        }
        Ok(outputs.mapv(f64::from))
    }

    fn logits(&self, pooled: &Array1<f32>) -> Array1<f32> {
        let mut inner = self.inner.forward(&pooled.view().insert_axis(Axis(0)));
        if self.is_regression {
            inner.mapv_inplace(tanh);
        }
        self.outer.forward(&inner).row(0).to_owned()
    }
}

impl Config {
    /// The labels in lower case, in the order of the outputs.
    fn labels(&self) -> std::result::Result<Vec<String>, String> {
        let number = |id: &String| id.parse::<usize>().ok();
        let mut labels = vec![None; self.id2label.len()];
        for (id, label) in &self.id2label {
            let place = number(id).and_then(|id| labels.get_mut(id));
            *place.ok_or_else(|| format!("id2label: expected numbers from 0, got {id:?}"))? =
                Some(label.to_lowercase());
        }
        let labels: Option<Vec<String>> = labels.into_iter().collect();
        labels
            .filter(|labels| labels.len() > 1)
            .ok_or_else(|| "id2label: expected two labels or more, numbered from 0".into())
    }
}

impl Tells {
    fn of(labels: &[String]) -> std::result::Result<Self, String> {
        let place = |name: &str| labels.iter().position(|label| label == name);
        if let (Some(arousal), Some(valence)) = (place("arousal"), place("valence")) {
            let dominance = place("dominance");
            return Ok(Tells::Dimensions {
                arousal,
                valence,
                dominance,
            });
        }
        let known = |label: &String| {
            let words = |names: &str| names.split(' ').any(|name| name == label);
            let (name, _) = NAMES.iter().find(|(_, names)| words(names))?;
            EMOTIONS.iter().position(|emotion| emotion == name)
        };
        let emotions: Vec<usize> = labels.iter().map(|l| known(l).unwrap_or(0)).collect();
        if emotions.iter().any(|emotion| *emotion != 0) {
            Ok(Tells::Categories(emotions))
        } else {
            Err(format!(
                "id2label: expected arousal and valence, or names of emotions such as {}, got {}",
                EMOTIONS.join(", "),
                labels.join(", ")
            ))
        }
    }

    fn emotion(&self, outputs: &Array1<f64>) -> Emotion {
        match self {
            Tells::Categories(emotions) => {
                let mut shares = [0.0; EMOTIONS.len()];
                for (emotion, share) in emotions.iter().zip(outputs) {
                    shares[*emotion] += share;
                }
                shown(&shares)
            }
            Tells::Dimensions {
                arousal,
                valence,
                dominance,
            } => {
                let of = |place: usize| 2.0 * outputs[place].clamp(0.0, 1.0) - 1.0;
                let is_weak = dominance.is_some_and(|place| of(place) < 0.0);
                on_the_circle(of(*arousal), of(*valence), is_weak)
            }
        }
    }
}

/// The emotion for arousal and valence from −1 to 1: a mixture of the two nearest directions.
fn on_the_circle(arousal: f64, valence: f64, is_weak: bool) -> Emotion {
    let far = arousal.hypot(valence);
    let intensity = ((far - FELT_FROM) / (FELT_FULLY - FELT_FROM)).clamp(0.0, 1.0) as f32;
    if intensity == 0.0 {
        return Emotion::default();
    }
    let angry = if is_weak { "afraid" } else { "angry" };
    let around = ["happy", angry, "sad", "calm"];
    // Quarter turns after the first direction, which lies halfway between both axes.
    let turn = arousal.atan2(valence) / std::f64::consts::FRAC_PI_2 - 0.5;
    let turn = turn.rem_euclid(4.0);
    let (first, share) = (turn as usize % 4, turn.fract() as f32);
    let mut mixture = [0.0; EMOTIONS.len()];
    for (name, share) in [
        (around[first], 1.0 - share),
        (around[(first + 1) % 4], share),
    ] {
        let place = EMOTIONS.iter().position(|emotion| *emotion == name);
        mixture[place.expect("one of the fifteen")] = share;
    }
    Emotion { mixture, intensity }
}

/// The two layers: `projector` and `classifier` of Hugging Face's own classes, or
/// `classifier.dense` and `classifier.out_proj` (`output`) of published regression heads.
fn head(
    weights: &Weights,
    config: &Config,
    channels: usize,
    labels: usize,
) -> Result<(Linear, Linear)> {
    let classifier = weights.pp("classifier");
    if classifier.contains("dense.weight") {
        let last = if classifier.contains("output.weight") {
            "output"
        } else {
            "out_proj"
        };
        let dense = Linear::load(&classifier.pp("dense"), channels, channels)?;
        return Ok((dense, Linear::load(&classifier.pp(last), channels, labels)?));
    }
    let width = config.classifier_proj_size.unwrap_or(256);
    let projector = Linear::load(&weights.pp("projector"), channels, width)?;
    Ok((projector, Linear::load(&classifier, width, labels)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        job::SILENT,
        nn::golden::{Golden, damage, distance, seeds},
    };

    /// One of the golden's models as a Hugging Face folder.
    fn folder(golden: &Golden, name: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let config = golden.metadata(&format!("{name}.config"));
        std::fs::write(folder.path().join("config.json"), config).unwrap();
        let path = folder.path().join("model.safetensors");
        golden.write_arrays(&format!("{name}.weights."), &path, |all| all);
        folder
    }

    fn sound(golden: &Golden) -> Waveform {
        Waveform {
            samples: golden.values("input"),
        }
    }

    #[test]
    fn outputs_equal_those_of_hugging_face() {
        let golden = Golden::open("emotion_model_debug");
        for name in ["wav2vec2", "hubert", "regression"] {
            let model = EmotionModel::load_folder(folder(&golden, name).path()).unwrap();
            let track = model.encoder.encode(&sound(&golden), SILENT).unwrap();
            let pooled = track.features.mean_axis(Axis(0)).unwrap();
            let expected = golden.values(&format!("{name}.logits"));
            assert!(distance(&model.logits(&pooled), &expected) < 1e-4, "{name}");
        }
    }

    #[test]
    fn a_sound_is_keys_from_its_start_to_its_end() {
        let golden = Golden::open("emotion_model_debug");
        let model = EmotionModel::load_folder(folder(&golden, "hubert").path()).unwrap();
        let sound = sound(&golden);
        let EmotionCurve::Keys(keys) = model.emotion(&sound, SILENT).unwrap() else {
            panic!("expected keys")
        };
        assert_eq!(keys[0].0, 0.0);
        assert!(keys.last().unwrap().0 > sound.duration_s() - STEP_S);
        let short = Waveform {
            samples: sound.samples[..12_000].to_vec(),
        };
        assert_eq!(
            model.emotion(&short, SILENT).unwrap(),
            EmotionCurve::default()
        );
    }

    #[test]
    fn damaged_folders_are_refused_or_tell_finite_emotions() {
        let golden = Golden::open("emotion_model_debug");
        for seed in seeds() {
            for name in ["wav2vec2", "hubert", "regression"] {
                for file in ["config.json", "model.safetensors"] {
                    let folder = folder(&golden, name);
                    damage(&folder.path().join(file), seed);
                    let model = EmotionModel::load_folder(folder.path());
                    let heard = model.and_then(|model| model.emotion(&sound(&golden), SILENT));
                    if let Ok(EmotionCurve::Keys(keys)) = heard {
                        let mut numbers = keys.iter().flat_map(|(_, emotion)| {
                            emotion.mixture.into_iter().chain([emotion.intensity])
                        });
                        assert!(numbers.all(f32::is_finite));
                    }
                }
            }
        }
    }

    fn strongest(emotion: &Emotion) -> &'static str {
        let named = emotion.mixture.iter().zip(EMOTIONS);
        let most = named.reduce(|a, b| if b.0 > a.0 { b } else { a });
        most.unwrap().1
    }

    #[test]
    fn labels_are_emotions_under_many_names() {
        let tells_of = |labels: &[&str]| {
            Tells::of(&labels.iter().map(|l| (*l).to_owned()).collect::<Vec<_>>())
        };
        let tells = tells_of(&["neu", "hap", "ang", "sad", "other"]).unwrap();
        assert_eq!(tells, Tells::Categories(vec![0, 1, 9, 5, 0]));
        let angry = tells.emotion(&Array1::from(vec![0.02, 0.01, 0.95, 0.01, 0.01]));
        assert!(strongest(&angry) == "angry" && angry.intensity > 0.7);
        let unsure = tells.emotion(&Array1::from(vec![0.3, 0.2, 0.3, 0.1, 0.1]));
        assert_eq!(unsure, Emotion::default());
        let message = tells_of(&["label_0", "label_1"]).unwrap_err();
        assert!(
            message.contains("label_1") && message.contains("angry"),
            "{message}"
        );
    }

    #[test]
    fn arousal_and_valence_are_directions_of_a_circle() {
        let all = ["arousal", "dominance", "valence"].map(str::to_owned);
        let tells = Tells::of(&all).unwrap();
        let of = |arousal, dominance, valence| {
            tells.emotion(&Array1::from(vec![arousal, dominance, valence]))
        };
        assert_eq!(of(0.5, 0.5, 0.55), Emotion::default());
        for ((arousal, dominance, valence), expected) in [
            ((0.9, 0.5, 0.9), "happy"),
            ((0.9, 0.8, 0.1), "angry"),
            ((0.9, 0.2, 0.1), "afraid"),
            ((0.1, 0.5, 0.1), "sad"),
            ((0.1, 0.5, 0.9), "calm"),
        ] {
            let emotion = of(arousal, dominance, valence);
            assert_eq!(strongest(&emotion), expected);
            assert!((emotion.mixture.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            assert_eq!(emotion.intensity, 1.0);
        }
        let half = of(0.5, 0.5, 1.0).mixture;
        assert!((half[1] - 0.5).abs() < 1e-6 && (half[3] - 0.5).abs() < 1e-6);
    }

    #[test]
    fn folders_of_other_models_are_refused() {
        let golden = Golden::open("emotion_model_debug");
        let config = golden.metadata("hubert.config");
        for (from, to, expected) in [
            (
                "\"hubert\"",
                "\"whisper\"",
                "model_type: expected hubert or wav2vec2, got whisper",
            ),
            (
                "\"classifier_proj_size\": 12",
                "\"classifier_proj_size\": 13",
                "projector",
            ),
        ] {
            assert!(config.contains(from), "{from}");
            let folder = folder(&golden, "hubert");
            let path = folder.path().join("config.json");
            std::fs::write(path, config.replace(from, to)).unwrap();
            let error = EmotionModel::load_folder(folder.path()).err().unwrap();
            assert!(error.to_string().contains(expected), "{error}");
        }
    }
}
