//! The encoder of the emotion branch: the built-in one or, as in the paper, a second checkpoint
//! that the user provides.

use std::{path::Path, sync::Arc};

use ndarray::Array2;

use super::EmoFaceConfig;
use crate::{
    Error, Result,
    job::ProgressFn,
    speech::{self, EmotionEncoder, SpeechEncoder, VoiceTrack, at_motion_frames},
};

/// `E_e`.
pub(super) enum EmotionSource {
    /// The built-in encoder, or the one in the folder of models.
    BuiltIn(Arc<EmotionEncoder>),
    /// A checkpoint that the user provides, as in the paper.
    Checkpoint(Box<dyn SpeechEncoder>),
}

impl EmotionSource {
    /// Opens the encoder that `config` names. `folder`: the engine's folder of models.
    ///
    /// # Errors
    /// `Weights` or `Io` if the encoder is missing or damaged, or if the model was trained with
    /// another one.
    pub fn open(folder: Option<&Path>, config: &EmoFaceConfig) -> Result<EmotionSource> {
        if let Some(checkpoint) = &config.emotion {
            return Ok(EmotionSource::Checkpoint(speech::open_emotion(
                checkpoint, folder,
            )?));
        }
        let encoder = EmotionEncoder::open(folder)?;
        let (expected, actual) = (config.emotion_channels, encoder.channels());
        if expected != actual {
            return Err(Error::Weights(format!(
                "emoface: expected an emotion encoder of {expected} features, got one of {actual}"
            )));
        }
        Ok(EmotionSource::BuiltIn(Arc::new(encoder)))
    }

    /// `F_e` of a voice at motion frames, `[frames, E]`.
    ///
    /// # Errors
    /// `Audio` for a sound that is too short for a checkpoint.
    pub fn at_frames(
        &self,
        voice: &VoiceTrack,
        frames: usize,
        fps: f64,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        match self {
            EmotionSource::BuiltIn(encoder) => Ok(encoder.at_frames(voice, frames, fps)),
            EmotionSource::Checkpoint(encoder) => {
                let track = encoder.encode(voice.sound(), progress)?;
                Ok(at_motion_frames(&track, frames, fps))
            }
        }
    }

    /// `F_e` of a whole voice, stretched over `frames` frames.
    ///
    /// # Errors
    /// Those of [`EmotionSource::at_frames`].
    pub fn over(
        &self,
        voice: &VoiceTrack,
        frames: usize,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        match self {
            EmotionSource::BuiltIn(encoder) => Ok(encoder.over(voice, frames)),
            EmotionSource::Checkpoint(encoder) => {
                let sound = voice.sound();
                let pace = frames.saturating_sub(1).max(1) as f64 / sound.duration_s();
                Ok(at_motion_frames(
                    &encoder.encode(sound, progress)?,
                    frames,
                    pace,
                ))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        audio::Waveform,
        job::SILENT,
        nn::golden::{Golden, distance},
        speech::{SpeechInput, from_folder},
    };

    const FPS: f64 = 25.0;

    /// A model that uses the golden's emotion encoder, and a folder of models with that encoder.
    fn heard_by(golden: &Golden, channels: usize) -> (EmoFaceConfig, tempfile::TempDir) {
        let models = tempfile::tempdir().unwrap();
        let folder = models.path().join("emotion_wav2vec2");
        std::fs::create_dir(&folder).unwrap();
        golden.write_arrays("weights.", &folder.join("model.safetensors"), |all| all);
        std::fs::write(folder.join("config.json"), golden.metadata("config")).unwrap();
        let debug = Golden::open("emoface_debug").metadata("config");
        let mut config = EmoFaceConfig::from_json(&debug).unwrap();
        config.emotion_channels = channels;
        config.emotion = Some(SpeechInput {
            encoder: "wav2vec2".into(),
            channels,
            transformer_fps: Some(FPS),
        });
        (config, models)
    }

    #[test]
    fn a_checkpoint_beside_the_model_hears_emotion() {
        let golden = Golden::open("wav2vec2_tiny");
        let sound = Waveform {
            samples: golden.values("input"),
        };
        let (config, models) = heard_by(&golden, 32);
        let source = EmotionSource::open(Some(models.path()), &config).unwrap();
        let voice = VoiceTrack::of(&sound);
        let frames = speech::frames_of(sound.duration_s(), FPS);
        let heard = source.at_frames(&voice, frames, FPS, SILENT).unwrap();
        let folder = models.path().join("emotion_wav2vec2");
        let encoder = from_folder(&folder, None, Some(FPS)).unwrap();
        let whole = encoder.encode(&sound, SILENT).unwrap().features;
        assert_eq!(heard, whole);

        // Twice as many frames: the first and the last of them get the start and the end of the
        // voice.
        let long = source.over(&voice, 2 * frames, SILENT).unwrap();
        assert!(distance(long.row(0), whole.row(0)) < 1e-6);
        assert!(distance(long.row(2 * frames - 1), whole.row(frames - 1)) < 1e-6);
        assert!(
            distance(long.row(frames), whole.row(frames / 2))
                < distance(long.row(frames), whole.row(0))
        );
        assert_eq!(source.over(&voice, 1, SILENT).unwrap().nrows(), 1);
    }

    #[test]
    fn what_cannot_be_heard_by_it_is_told() {
        let golden = Golden::open("wav2vec2_tiny");
        let message_of = |models: Option<&Path>, config: &EmoFaceConfig| match EmotionSource::open(
            models, config,
        ) {
            Err(error) => error.to_string(),
            Ok(_) => panic!("expected an error"),
        };
        let (config, models) = heard_by(&golden, 32);
        let empty = tempfile::tempdir().unwrap();
        for nowhere in [None, Some(empty.path())] {
            let text = message_of(nowhere, &config);
            assert!(text.contains("as the folder emotion_wav2vec2"), "{text}");
        }
        let (others, _) = heard_by(&golden, 48);
        let text = message_of(Some(models.path()), &others);
        assert!(
            text.contains("48 features of wav2vec2") && text.contains("gives 32"),
            "{text}"
        );
    }

    #[test]
    fn channels_of_the_config_have_to_agree() {
        let text = Golden::open("emoface_debug").metadata("config");
        let mut config: serde_json::Value = serde_json::from_str(&text).unwrap();
        config["emotion"] = serde_json::json!({"encoder": "hubert", "channels": 32});
        let refused = EmoFaceConfig::from_json(&config.to_string())
            .unwrap_err()
            .to_string();
        assert!(
            refused.contains("expected the 8 channels of emotion_channels, got 32"),
            "{refused}"
        );
    }
}
