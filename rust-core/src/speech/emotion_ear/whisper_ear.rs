//! An ear for emotion that uses Whisper base itself, from a user's folder, in place of the small
//! network that imitates it.

use std::path::Path;

use ndarray::{Array1, ArrayView2, Axis, concatenate, s};
use serde::Deserialize;

use super::{
    heard_emotion::HeardEmotion,
    layer::{EVERY, EmotionLayer},
    neutral_voice::NeutralVoice,
};
use crate::{
    Error, Result,
    audio::Waveform,
    job::ProgressFn,
    models::{BuiltIn, Weights},
    nn::finite::check_result,
    speech::{
        SpeechEncoder, VoiceTrack, VoiceWindow,
        emotion_encoder::{NUMBERS, scaled_samples},
        whisper::Whisper,
        whisper_trunk::RATE_HZ,
    },
};

/// Built-in weights of the layer on Whisper's outputs.
pub static EMOTION_OF_WHISPER: BuiltIn = BuiltIn::new(&anyface_weights_shared::EMOTION_OF_WHISPER);

/// Numbers per channel: its mean, its deviation and its change over a window.
const STATISTICS: usize = 3;
/// Frames of 10 ms per feature of Whisper.
const FRAMES: usize = (100.0 / RATE_HZ) as usize;
/// Least number of features in a window: change and deviation need two.
const LEAST_FEATURES: usize = 2;

/// `config.json` beside the weights.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Config {
    /// Channels of Whisper.
    channels: usize,
    /// Whisper's layers in use, ascending; 0 is before the first layer.
    layers: Vec<usize>,
    /// Emotions in the layer's training data.
    emotions: Vec<String>,
}

/// Recognises emotions in a voice from the middle layers of Whisper base.
///
/// It distinguishes emotions much better than [`super::EmotionEar`], whose network is a hundredth
/// of Whisper's size, but it is slower and does not run live.
pub struct WhisperEar {
    whisper: Whisper,
    layers: Vec<usize>,
    layer: EmotionLayer,
}

impl WhisperEar {
    /// Whisper base from its Hugging Face folder, with the built-in layer or the one in `models`.
    ///
    /// # Errors
    /// `Io` if a file cannot be read; `Weights` if one is damaged or the folder holds a different
    /// Whisper.
    pub fn open(folder: &Path, models: Option<&Path>) -> Result<Self> {
        let files = EMOTION_OF_WHISPER.open(models)?;
        let weights = Weights::from_bytes(&files.weights)?;
        Self::load(Whisper::load_folder(folder, None)?, &weights, &files.config).map_err(|error| {
            match error {
                Error::Weights(message) => {
                    Error::Weights(format!("{}: {message}", folder.display()))
                }
                other => other,
            }
        })
    }

    fn load(whisper: Whisper, weights: &Weights, config: &str) -> Result<Self> {
        const MODEL: &str = "emotion_of_whisper";
        let config: Config = serde_json::from_str(config)
            .map_err(|e| Error::Weights(format!("{MODEL} config.json: {e}")))?;
        let same = "expected Whisper base, on which the layer for emotions was trained (openai/whisper-base; not base.en)";
        if whisper.channels() != config.channels {
            let got = whisper.channels();
            return Err(Error::Weights(format!(
                "{same}, with {} channels, got {got}",
                config.channels
            )));
        }
        if !whisper.has_first_bias(&weights.vector("first_bias", config.channels)?) {
            return Err(Error::Weights(format!(
                "{same}, got other weights of its size"
            )));
        }
        let is_ascending = config.layers.windows(2).all(|pair| pair[0] < pair[1]);
        let last = config.layers.last().copied().unwrap_or(usize::MAX);
        if !is_ascending || last > whisper.layers() {
            return Err(Error::Weights(format!(
                "{MODEL} config.json: layers: expected ascending numbers up to {}, got {:?}",
                whisper.layers(),
                config.layers
            )));
        }
        let numbers = STATISTICS * config.channels * config.layers.len() + NUMBERS;
        Ok(WhisperEar {
            whisper,
            layers: config.layers,
            layer: EmotionLayer::load(MODEL, weights, &config.emotions, numbers)?,
        })
    }

    /// How likely each emotion is in a voice over time. Empty for a sound shorter than 0.8 s.
    ///
    /// `neutral`: how the speaker sounds without emotion, if that is known.
    ///
    /// # Errors
    /// `Audio` for a sound shorter than 25 ms; `Numerics` where the weights give numbers that are
    /// not finite; `Cancelled`.
    pub fn heard(
        &self,
        waveform: &Waveform,
        voice: &VoiceTrack,
        neutral: Option<&NeutralVoice>,
        progress: ProgressFn<'_>,
    ) -> Result<HeardEmotion> {
        let windows = voice.windows(EVERY);
        let rows = self.rows(waveform, &windows, progress)?;
        Ok(self.layer.heard(&windows, rows.into_iter(), neutral))
    }

    /// How a speaker sounds without emotion, from a recording; see
    /// [`super::EmotionEar::neutral_voice`].
    ///
    /// # Errors
    /// `Audio` if nobody speaks in it, and those of [`WhisperEar::heard`].
    pub fn neutral_voice(
        &self,
        waveform: &Waveform,
        voice: &VoiceTrack,
        progress: ProgressFn<'_>,
    ) -> Result<NeutralVoice> {
        let windows = voice.windows(EVERY);
        let rows = self.rows(waveform, &windows, progress)?;
        self.layer.neutral_voice(&windows, rows.into_iter())
    }

    /// For every window of the voice, statistics of the layers and the window's 118 numbers, `[R]`.
    fn rows(
        &self,
        waveform: &Waveform,
        windows: &[VoiceWindow],
        progress: ProgressFn<'_>,
    ) -> Result<Vec<Array1<f64>>> {
        if windows.is_empty() {
            return Ok(Vec::new());
        }
        let scaled = Waveform {
            samples: scaled_samples(waveform),
        };
        let outputs = self.whisper.hear(&scaled, &self.layers, progress)?;
        for output in &outputs {
            check_result("emotion of the voice", output.view().into_dyn())?;
        }
        let row = |window: &VoiceWindow| {
            let total = outputs[0].nrows();
            let end = (window.frames.end / FRAMES).clamp(LEAST_FEATURES.min(total), total);
            let first = (window.frames.start / FRAMES).min(end.saturating_sub(LEAST_FEATURES));
            let statistics = outputs
                .iter()
                .flat_map(|output| statistics(output.slice(s![first..end, ..])));
            statistics.chain(window.numbers.iter().copied()).collect()
        };
        Ok(windows.iter().map(row).collect())
    }
}

/// Mean, deviation and mean absolute change of rows `[T, C]` over time, `[3 C]`.
fn statistics(x: ArrayView2<'_, f32>) -> Array1<f64> {
    let x = x.mapv(f64::from);
    let mean = x.mean_axis(Axis(0)).expect("a row");
    let deviation = x.std_axis(Axis(0), 1.0);
    let change = &x.slice(s![1.., ..]) - &x.slice(s![..-1, ..]);
    let change = change.mapv(f64::abs).mean_axis(Axis(0)).expect("two rows");
    concatenate![Axis(0), mean, deviation, change]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        job::SILENT,
        nn::golden::{Golden, distance},
    };

    const GOLDEN: &str = "emotion_of_whisper_debug";

    /// The golden's Whisper as a Hugging Face folder, with `edit` applied to its first bias.
    fn folder(golden: &Golden, edit: fn(f32) -> f32) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(
            folder.path().join("config.json"),
            golden.metadata("whisper"),
        )
        .unwrap();
        let path = folder.path().join("model.safetensors");
        golden.write_arrays("whisper.", &path, |(name, shape, values)| {
            let is_first = name.ends_with("conv1.bias");
            let edited = values.iter().map(|x| if is_first { edit(*x) } else { *x });
            (name, shape, edited.collect())
        });
        folder
    }

    fn load(golden: &Golden, folder: &Path) -> Result<WhisperEar> {
        let whisper = Whisper::load_folder(folder, None).unwrap();
        WhisperEar::load(whisper, &golden.weights(), &golden.metadata("config"))
    }

    /// The golden's ear, its sound, and the voice in it.
    fn heard(golden: &Golden) -> (WhisperEar, Waveform, VoiceTrack) {
        let ear = load(golden, folder(golden, |x| x).path()).unwrap();
        let sound = Waveform {
            samples: golden.values("samples"),
        };
        let voice = VoiceTrack::of(&sound);
        (ear, sound, voice)
    }

    #[test]
    fn agrees_with_python() {
        let golden = Golden::open(GOLDEN);
        let (ear, sound, voice) = heard(&golden);
        let rows = ear.rows(&sound, &voice.windows(EVERY), SILENT).unwrap();
        let expected = golden.matrix("logits");
        assert_eq!(rows.len(), expected.nrows());
        for (row, expected) in rows.into_iter().zip(expected.outer_iter()) {
            let logits = ear.layer.logits(row, None).mapv(|x| x as f32);
            let apart = distance(&logits, expected);
            assert!(apart < 2e-3, "{apart}");
        }
    }

    #[test]
    fn its_own_neutral_voice_moves_what_is_heard_towards_readers() {
        let golden = Golden::open(GOLDEN);
        let (ear, sound, voice) = heard(&golden);
        let neutral = ear.neutral_voice(&sound, &voice, SILENT).unwrap();
        let plain = ear.heard(&sound, &voice, None, SILENT).unwrap();
        let relative = ear.heard(&sound, &voice, Some(&neutral), SILENT).unwrap();
        assert_eq!(plain.time_s, relative.time_s);
        assert_ne!(plain.probability, relative.probability);
        let short = Waveform {
            samples: sound.samples[..8_000].to_vec(),
        };
        let heard = ear
            .heard(&short, &VoiceTrack::of(&short), None, SILENT)
            .unwrap();
        assert_eq!(heard.time_s.len(), 0);
    }

    #[test]
    fn another_whisper_is_refused() {
        let golden = Golden::open(GOLDEN);
        let other = folder(&golden, |x| x + 0.1);
        let error = load(&golden, other.path())
            .err()
            .expect("refused")
            .to_string();
        assert!(error.contains("other weights of its size"), "{error}");
        let error = WhisperEar::open(folder(&golden, |x| x).path(), None)
            .err()
            .expect("refused")
            .to_string();
        assert!(
            error.contains("with 512 channels, got 16") && error.contains("whisper-base"),
            "{error}"
        );
    }
}
