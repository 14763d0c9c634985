//! Recognises the emotion in a voice over time, and how certain it is. All systems use it.
//!
//! A recording is heard by [`WhisperEar`]. A live voice is heard by [`EmotionEar`], whose network is
//! small enough for a browser: twin of `training/speech/emotion_ear.py`, over log-mels and pitch, it
//! predicts Whisper's middle layers for the last two seconds. A linear layer turns its outputs and the
//! 118 numbers of a [`VoiceWindow`] into the logits of the emotions.

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

use self::{layer::EmotionLayer, network::Convolutions};
use super::{
    emotion_encoder::{NUMBERS, VoiceWindow},
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
    use super::{layer::EVERY, *};
    use crate::{
        audio::Waveform,
        conditions::Emotion,
        nn::golden::{Golden, distance},
        speech::{VoiceTrack, shown_emotion::shown_live},
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
        for (window, expected) in windows.iter().zip(expected.outer_iter()) {
            let logits = ear.layer.logits(ear.row(window), None);
            let apart = distance(&logits.mapv(|x| x as f32), expected);
            assert!(apart < 2e-3, "{apart}");
        }
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
        let windows = voice(&samples).windows(EVERY);
        let rows = windows.iter().map(|window| ear.row(window));
        let heard = ear.layer.heard(&windows, rows, None);
        let last = heard.time_s.len() - 1;
        let whole = f64::from(shown_live(&heard.shares(last)).intensity);
        let apart = (f64::from(emotion.intensity) - whole).abs();
        assert!(apart < 0.2, "{} {whole}", emotion.intensity);
    }
}
