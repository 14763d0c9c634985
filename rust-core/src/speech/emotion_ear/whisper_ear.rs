//! Hears the emotion of a whole recording, by the first layers of Whisper that the library carries.
//!
//! Twin of `training/speech/train_emotion_of_whisper.py`. The layers are those of the
//! [`super::super::Ear`], and their log-mel is its own.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, OnceLock},
};

use ndarray::{Array1, ArrayView2, Axis, concatenate, s};
use serde::Deserialize;

use super::{
    heard_emotion::HeardEmotion,
    layer::{EVERY, EmotionLayer},
    neutral_voice::NeutralVoice,
};
use crate::{
    Error, Result,
    job::ProgressFn,
    models::{BuiltIn, Weights},
    nn::finite::check_result,
    speech::{
        VoiceTrack, VoiceWindow, ear::ear_mel, emotion_encoder::NUMBERS, whisper_trunk::RATE_HZ,
        whisper_trunk::WhisperTrunk,
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
const MODEL: &str = "emotion_of_whisper";

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

/// Recognises emotions in a recorded voice. A live voice has [`super::LiveEar`].
pub struct WhisperEar {
    /// Loaded when it is first needed: by then the engine's ear usually holds it.
    trunk: OnceLock<Arc<WhisperTrunk>>,
    folder: Option<PathBuf>,
    config: Config,
    layer: EmotionLayer,
}

impl WhisperEar {
    /// The built-in ear, or the one in `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing or damaged, or the files do not fit each other.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = EMOTION_OF_WHISPER.open(folder)?;
        let ear = Self::load(&Weights::from_bytes(&files.weights)?, &files.config)?;
        Ok(WhisperEar {
            folder: folder.map(Path::to_path_buf),
            ..ear
        })
    }

    fn load(weights: &Weights, config: &str) -> Result<Self> {
        let config: Config = serde_json::from_str(config)
            .map_err(|e| Error::Weights(format!("{MODEL} config.json: {e}")))?;
        let numbers = STATISTICS * config.channels * config.layers.len() + NUMBERS;
        Ok(WhisperEar {
            trunk: OnceLock::new(),
            folder: None,
            layer: EmotionLayer::load(MODEL, weights, &config.emotions, numbers)?,
            config,
        })
    }

    /// Whisper's layers.
    fn trunk(&self) -> Result<&Arc<WhisperTrunk>> {
        if self.trunk.get().is_none() {
            let trunk = WhisperTrunk::open(self.folder.as_deref())?;
            self.config.check(&trunk)?;
            let _ = self.trunk.set(trunk);
        }
        Ok(self.trunk.get().expect("set above"))
    }

    /// Emotions in its training data.
    pub fn emotions(&self) -> &[String] {
        &self.layer.emotions
    }

    /// How likely each emotion is in a voice over time. Empty for a sound shorter than 0.8 s.
    ///
    /// `neutral`: how the speaker sounds without emotion, if that is known.
    ///
    /// # Errors
    /// `Weights` where Whisper's layers are damaged or others than those of the training; `Numerics`
    /// where the weights give numbers that are not finite; `Cancelled`.
    pub fn heard(
        &self,
        voice: &VoiceTrack,
        neutral: Option<&NeutralVoice>,
        progress: ProgressFn<'_>,
    ) -> Result<HeardEmotion> {
        let windows = voice.windows(EVERY);
        let rows = self.rows(voice, &windows, progress)?;
        Ok(self.layer.heard(&windows, rows.into_iter(), neutral))
    }

    /// How a speaker sounds without emotion, from a recording.
    ///
    /// Later, every row of the speaker is shifted by the difference between his mean row in the
    /// recording and that of the training data's readers. The less voice the recording has, the
    /// smaller the shift.
    ///
    /// # Errors
    /// `Audio` if nobody speaks in it, and those of [`WhisperEar::heard`].
    pub fn neutral_voice(
        &self,
        voice: &VoiceTrack,
        progress: ProgressFn<'_>,
    ) -> Result<NeutralVoice> {
        let windows = voice.windows(EVERY);
        let rows = self.rows(voice, &windows, progress)?;
        self.layer.neutral_voice(&windows, rows.into_iter())
    }

    /// For every window of the voice, statistics of the layers and the window's 118 numbers, `[R]`.
    fn rows(
        &self,
        voice: &VoiceTrack,
        windows: &[VoiceWindow],
        progress: ProgressFn<'_>,
    ) -> Result<Vec<Array1<f64>>> {
        if windows.is_empty() {
            return Ok(Vec::new());
        }
        let mel = ear_mel(&voice.sound().samples);
        let layers = &self.config.layers;
        let outputs = self.trunk()?.hear_whole(&mel, layers, progress)?;
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

impl Config {
    /// Checks that `trunk` has these channels and layers.
    fn check(&self, trunk: &WhisperTrunk) -> Result<()> {
        let is_ascending = self.layers.windows(2).all(|pair| pair[0] < pair[1]);
        let last = self.layers.last().copied().unwrap_or(usize::MAX);
        if is_ascending && last <= trunk.layers() && self.channels == trunk.channels() {
            return Ok(());
        }
        Err(Error::Weights(format!(
            "{MODEL} config.json: expected {} channels and ascending layers up to {}, as whisper_trunk has them, got {} \
             and {:?}",
            trunk.channels(),
            trunk.layers(),
            self.channels,
            self.layers
        )))
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
        audio::Waveform,
        conditions::EmotionCurve,
        job::SILENT,
        nn::golden::{Golden, distance},
        speech::emotion_ear::affect,
    };

    /// The golden's ear with the layers of `config`, and the voice in the golden.
    fn golden_ear(config: fn(String) -> String) -> (Golden, Result<WhisperEar>, VoiceTrack) {
        let golden = Golden::open("emotion_of_whisper_debug");
        let trunk = golden.weights().pp("trunk");
        let trunk = WhisperTrunk::load(&trunk, &golden.metadata("trunk_config")).unwrap();
        let config = config(golden.metadata("config"));
        let ear = WhisperEar::load(&golden.weights(), &config).and_then(|ear| {
            ear.config.check(&trunk)?;
            let _ = ear.trunk.set(Arc::new(trunk));
            Ok(ear)
        });
        let voice = VoiceTrack::of(&Waveform {
            samples: golden.values("samples"),
        });
        (golden, ear, voice)
    }

    fn voice(samples: &[f32]) -> VoiceTrack {
        VoiceTrack::of(&Waveform {
            samples: samples.to_vec(),
        })
    }

    #[test]
    fn agrees_with_python() {
        let (golden, ear, voice) = golden_ear(|config| config);
        let ear = ear.unwrap();
        let rows = ear.rows(&voice, &voice.windows(EVERY), SILENT).unwrap();
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
        let (golden, ear, voice) = golden_ear(|config| config);
        let ear = ear.unwrap();
        let neutral = ear.neutral_voice(&voice, SILENT).unwrap();
        let plain = ear.heard(&voice, None, SILENT).unwrap();
        let relative = ear.heard(&voice, Some(&neutral), SILENT).unwrap();
        assert_eq!(plain.time_s, relative.time_s);
        assert_ne!(plain.probability, relative.probability);
        let often = golden.values("samples").repeat(6);
        let often = ear.neutral_voice(&self::voice(&often), SILENT).unwrap();
        let length = |neutral: &NeutralVoice| neutral.offset.dot(&neutral.offset);
        assert!(length(&often) > length(&neutral));
    }

    #[test]
    fn layers_that_the_trunk_lacks_are_refused() {
        let (_, ear, _) = golden_ear(|config| config.replace("[1, 2]", "[2, 3]"));
        let error = ear.err().expect("refused").to_string();
        assert!(error.contains("ascending layers up to 2"), "{error}");
    }

    #[test]
    fn a_recording_without_a_voice_is_no_neutral_voice() {
        let ear = WhisperEar::open(None).unwrap();
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as f32 / 65_536.0 - 0.5
        };
        let noise: Vec<f32> = (0..48_000).map(|_| noise()).collect();
        for samples in [vec![0.0; 48_000], noise] {
            let error = ear.neutral_voice(&voice(&samples), SILENT).unwrap_err();
            assert!(error.to_string().contains("without a voice"), "{error}");
        }
        let short = Waveform {
            samples: vec![0.1; 8_000],
        };
        let error = VoiceTrack::neutral(&short).unwrap_err().to_string();
        assert!(
            error.contains("neutral voice") && error.contains("0.50 s"),
            "{error}"
        );
    }

    #[test]
    fn silence_and_short_sounds_are_neutral() {
        let ear = WhisperEar::open(None).unwrap();
        let short: Vec<f32> = (0..8_000).map(|i| (i as f32 * 0.08).sin()).collect();
        let heard = ear.heard(&voice(&short), None, SILENT).unwrap();
        assert_eq!(heard.curve(), EmotionCurve::default());
        let silent = ear.heard(&voice(&[0.0; 48_000]), None, SILENT).unwrap();
        assert!(silent.intensity.iter().all(|x| *x == 0.0), "{silent:?}");
    }

    #[test]
    fn loud_and_quiet_copies_of_a_voice_feel_alike() {
        let (golden, ear, _) = golden_ear(|config| config);
        let ear = ear.unwrap();
        let heard = |gain: f32| {
            let samples: Vec<f32> = golden.values("samples").iter().map(|x| gain * x).collect();
            ear.heard(&voice(&samples), None, SILENT).unwrap()
        };
        assert_eq!(heard(1.0).probability, heard(0.2).probability);
    }

    #[test]
    fn probabilities_are_told_over_time() {
        let (_, ear, voice) = golden_ear(|config| config);
        let ear = ear.unwrap();
        let heard = ear.heard(&voice, None, SILENT).unwrap();
        assert_eq!(heard.probability.len(), ear.emotions().len());
        assert!(heard.time_s.is_sorted() && heard.time_s.len() == heard.intensity.len());
        for k in 0..heard.time_s.len() {
            let sum: f64 = heard.probability.values().map(|of| of[k]).sum();
            assert!((sum - 1.0).abs() < 0.01, "{sum}");
            let [valence, arousal] = affect::valence_and_arousal(&heard.shares(k));
            assert!((heard.valence[k] - valence).abs() < 0.01, "{valence}");
            assert!((heard.arousal[k] - arousal).abs() < 0.01, "{arousal}");
        }
        let mut twice = heard.between(0.0..1.5);
        let first = twice.time_s.len();
        twice.extend(heard.between(1.5..9.0).later(1.0));
        assert_eq!(twice.valence, heard.valence);
        assert_eq!(twice.arousal, heard.arousal);
        assert_eq!(twice.time_s[..first], heard.time_s[..first]);
        let EmotionCurve::Keys(keys) = heard.curve() else {
            panic!("expected keys")
        };
        assert_eq!(keys.len(), heard.time_s.len());
    }
}
