//! Recognises the emotion in a voice over time, and how certain it is. All systems use it.
//!
//! Twin of `training/speech/emotion_ear.py`. A small network over log-mels and pitch predicts
//! Whisper's middle layers for the last two seconds. A linear layer turns its outputs and the 118
//! numbers of [`VoiceTrack`] into the logits of the emotions.

mod affect;
mod heard_emotion;
mod layer;
mod live;
mod network;
mod neutral_voice;
mod whisper_ear;

pub use heard_emotion::HeardEmotion;
pub use live::LiveEar;
pub use neutral_voice::NeutralVoice;
pub use whisper_ear::{EMOTION_OF_WHISPER, WhisperEar};

use std::path::Path;

use ndarray::{Array1, Array2, ArrayView2, Axis};

use self::{
    layer::{EVERY, EmotionLayer},
    network::Convolutions,
};
use super::{
    emotion_encoder::{NUMBERS, VoiceTrack, VoiceWindow},
    log_mel::BANDS,
};
use crate::{
    Error, Result,
    models::{BuiltIn, Weights},
    nn::{elementwise::gelu_all, linear::Linear},
};

/// Built-in weights of [`EmotionEar`].
pub static EMOTION_EAR: BuiltIn = BuiltIn::new(&anyface_weights_shared::EMOTION_EAR);

/// Inputs per frame: log-mel relative to the loud level, pitch, and how periodic the sound is.
const INPUTS: usize = BANDS + 2;
const DEEPEST: f32 = -12.0;
const SCALE: f32 = 4.0;
const MIDDLE_OCTAVE: f32 = 7.5;
/// Weight of a frame that is not active.
const LEAST_WEIGHT: f32 = 0.01;
const LEAST_SPREAD: f32 = 1e-5;
const STRIDE: usize = 4;
/// `config.json` beside the weights.
#[derive(Debug, Clone, PartialEq, serde::Deserialize)]
pub struct EmotionEarConfig {
    /// Channels of the convolutions.
    pub channels: usize,
    /// Dilations of the blocks at 50 Hz.
    pub fine_dilations: Vec<usize>,
    /// Dilations of the blocks at 25 Hz.
    pub coarse_dilations: Vec<usize>,
    /// Width of the layer after pooling.
    pub hidden: usize,
    /// Outputs of the network.
    #[serde(rename = "told")]
    pub outputs: usize,
    /// Emotions in its training data, all of `EMOTIONS`, neutral among them.
    pub emotions: Vec<String>,
}

/// The network and the linear layer after it.
pub struct EmotionEar {
    encoder: Convolutions,
    inner: Linear,
    outer: Linear,
    layer: EmotionLayer,
}

impl EmotionEar {
    /// The built-in ear, or the one in `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing or damaged, or the files do not fit each other.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = EMOTION_EAR.open(folder)?;
        Self::load(&Weights::from_bytes(&files.weights)?, &files.config)
    }

    fn load(weights: &Weights, config: &str) -> Result<Self> {
        let config: EmotionEarConfig = serde_json::from_str(config)
            .map_err(|e| Error::Weights(format!("emotion_ear config.json: {e}")))?;
        let numbers = config.outputs + NUMBERS;
        Ok(EmotionEar {
            encoder: Convolutions::load(
                [INPUTS, config.channels],
                [&config.fine_dilations, &config.coarse_dilations],
                &weights.pp("encoder"),
            )?,
            inner: Linear::load(&weights.pp("inner"), 2 * config.channels, config.hidden)?,
            outer: Linear::load(&weights.pp("outer"), config.hidden, config.outputs)?,
            layer: EmotionLayer::load("emotion_ear", weights, &config.emotions, numbers)?,
        })
    }

    /// Emotions in its training data.
    pub fn emotions(&self) -> &[String] {
        &self.layer.emotions
    }

    /// How likely each emotion is in a voice over time. Empty for a sound shorter than 0.8 s.
    ///
    /// `neutral`: how the speaker sounds without emotion, if that is known.
    pub fn heard(&self, voice: &VoiceTrack, neutral: Option<&NeutralVoice>) -> HeardEmotion {
        let windows = voice.windows(EVERY);
        let rows = windows.iter().map(|window| self.row(window));
        self.layer.heard(&windows, rows, neutral)
    }

    /// How a speaker sounds without emotion, from a recording.
    ///
    /// Later, every row of the speaker is shifted by the difference between his mean row in the
    /// recording and that of the training data's readers. The less voice the recording has, the
    /// smaller the shift.
    ///
    /// # Errors
    /// `Audio` if nobody speaks in it.
    pub fn neutral_voice(&self, voice: &VoiceTrack) -> Result<NeutralVoice> {
        let windows = voice.windows(EVERY);
        let rows = windows.iter().map(|window| self.row(window));
        self.layer.neutral_voice(&windows, rows)
    }

    /// The network's outputs for a window, and the window's numbers, `[outputs + 118]`.
    fn row(&self, window: &VoiceWindow) -> Array1<f64> {
        let outputs = self.outputs_of(window).into_iter().map(f64::from);
        outputs.chain(window.numbers.iter().copied()).collect()
    }

    /// The network's outputs for a window, `[outputs]`.
    fn outputs_of(&self, window: &VoiceWindow) -> Vec<f32> {
        let heard = inputs_of(window);
        let x = self.encoder.forward(&heard);
        let pooled = pooled(x.view(), &window.active);
        let mut hidden = self.inner.forward(&pooled.insert_axis(Axis(0)));
        gelu_all(hidden.as_slice_mut().expect("a matrix is contiguous"));
        self.outer.forward(&hidden).into_raw_vec_and_offset().0
    }
}

/// The network's inputs for a window, `[T, 66]`.
fn inputs_of(window: &VoiceWindow) -> Array2<f32> {
    let rows = window.octave.len();
    Array2::from_shape_fn((rows, INPUTS), |(t, k)| match k {
        BANDS if window.voiced[t] => window.octave[t] as f32 - MIDDLE_OCTAVE,
        BANDS => 0.0,
        k if k > BANDS => window.periodic[t] as f32,
        band => (window.relative[[t, band]] as f32).max(DEEPEST) / SCALE,
    })
}

/// Mean and deviation of rows `[T / 4, C]` over time, weighted by which frames are active; `[2 C]`.
fn pooled(x: ArrayView2<'_, f32>, active: &[bool]) -> Array1<f32> {
    let weight = active.iter().step_by(STRIDE);
    let weight = weight.map(|active| f32::from(u8::from(*active)) + LEAST_WEIGHT);
    let weight = Array1::from_iter(weight);
    let weight = &weight / weight.sum();
    let mean = weight.dot(&x);
    let spread = weight.dot(&(&x - &mean).mapv(|x| x * x));
    let spread = spread.mapv(|x| (x + LEAST_SPREAD).sqrt());
    ndarray::concatenate![Axis(0), mean, spread]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        audio::Waveform,
        conditions::{Emotion, EmotionCurve},
        nn::golden::{Golden, distance},
    };

    fn voice(samples: &[f32]) -> VoiceTrack {
        VoiceTrack::of(&Waveform {
            samples: samples.to_vec(),
        })
    }

    #[test]
    fn agrees_with_python() {
        let golden = Golden::open("emotion_ear_debug");
        let ear = EmotionEar::load(&golden.weights(), &golden.metadata("config")).unwrap();
        let windows = voice(&golden.values("samples")).windows(1);
        let expected = golden.matrix("logits");
        assert_eq!(windows.len(), expected.nrows());
        let speaker = voice(&golden.values("neutral"));
        let neutral = ear.neutral_voice(&speaker).unwrap();
        let relative = golden.matrix("relative_logits");
        let expected = expected.outer_iter().zip(relative.outer_iter());
        for (window, (expected, relative)) in windows.iter().zip(expected) {
            let logits = |neutral| {
                ear.layer
                    .logits(ear.row(window), neutral)
                    .mapv(|x| x as f32)
            };
            let apart = distance(&logits(None), expected);
            assert!(apart < 2e-3, "{apart}");
            let apart = distance(&logits(Some(&neutral)), relative);
            assert!(apart < 2e-3, "{apart}");
        }
    }

    #[test]
    fn a_recording_without_a_voice_is_no_neutral_voice() {
        let ear = EmotionEar::open(None).unwrap();
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as f32 / 65_536.0 - 0.5
        };
        let noise: Vec<f32> = (0..48_000).map(|_| noise()).collect();
        for samples in [vec![0.0; 48_000], noise] {
            let error = ear.neutral_voice(&voice(&samples)).unwrap_err();
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
    fn more_of_a_neutral_voice_is_believed_more() {
        let ear = EmotionEar::open(None).unwrap();
        let samples = Golden::open("emotion_ear_debug").values("samples");
        let once = ear.neutral_voice(&voice(&samples)).unwrap();
        let often = ear.neutral_voice(&voice(&samples.repeat(6))).unwrap();
        let length = |neutral: &NeutralVoice| neutral.offset.dot(&neutral.offset);
        assert!(length(&often) > length(&once));
    }

    #[test]
    fn silence_and_short_sounds_are_neutral() {
        let ear = EmotionEar::open(None).unwrap();
        let short: Vec<f32> = (0..8_000).map(|i| (i as f32 * 0.08).sin()).collect();
        assert_eq!(
            ear.heard(&voice(&short), None).curve(),
            EmotionCurve::default()
        );
        let silent = ear.heard(&voice(&[0.0; 48_000]), None);
        assert!(silent.intensity.iter().all(|x| *x == 0.0), "{silent:?}");
    }

    #[test]
    fn probabilities_are_told_over_time() {
        let ear = EmotionEar::open(None).unwrap();
        let samples = Golden::open("emotion_ear_debug").values("samples");
        let heard = ear.heard(&voice(&samples), None);
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

    #[test]
    fn a_voice_that_is_still_heard_feels_as_what_was_heard_of_it() {
        let ear = std::sync::Arc::new(EmotionEar::open(None).unwrap());
        let samples = Golden::open("emotion_ear_debug").values("samples");
        let mut live = LiveEar::new(std::sync::Arc::clone(&ear));
        assert_eq!(live.emotion(), Emotion::default());
        let windows = voice(&samples).windows(1);
        windows.iter().for_each(|window| live.hear(window));
        let emotion = live.emotion();
        assert!((0.0..=1.0).contains(&emotion.intensity));
        let heard = ear.heard(&voice(&samples), None);
        let whole = *heard.intensity.last().unwrap();
        let apart = (f64::from(emotion.intensity) - whole).abs();
        assert!(apart < 0.2, "{} {whole}", emotion.intensity);
    }
}
