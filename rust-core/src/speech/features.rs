//! Everything that systems learn from one sound.

use std::sync::{Arc, OnceLock};

use ndarray::{Array2, ArrayView2};

use super::{
    FeatureTrack, HeardEmotion, NeutralVoice, PhoneModel, Script, SpeechEncoder, VoiceTrack,
    WhisperEar, at_motion_frames, encoder::frames_of, phones::PhoneInput,
};
use crate::{
    Error, Result,
    audio::{Prosody, Waveform},
    conditions::EmotionCurve,
    job::{Progress, ProgressFn},
};

/// The encoder's share of the progress.
const ENCODED: f32 = 0.7;

/// An analysed sound: speech features, how it was said, and how long it is.
///
/// ```
/// use std::sync::Arc;
/// use anyface::{audio::Waveform, speech::{self, SpeechFeatures, SpeechEncoder}};
///
/// let encoder: Arc<dyn SpeechEncoder> = Arc::new(speech::ear(None)?);
/// let sound = Waveform { samples: (0..16_000).map(|i| (i as f32 * 0.08).sin()).collect() };
/// let heard = SpeechFeatures::of(&sound, &encoder, anyface::job::SILENT)?;
/// assert_eq!(heard.features(30.0).dim(), (heard.frames(30.0), encoder.channels()));
/// # Ok::<(), anyface::Error>(())
/// ```
#[derive(Clone)]
pub struct SpeechFeatures {
    /// Speech features at the encoder's own rate.
    pub track: FeatureTrack,
    /// Loudness, pitch, effort, syllables and pauses.
    pub prosody: Prosody,
    /// Measurements of the voice for an encoder of emotions.
    pub voice: VoiceTrack,
    /// The ear for emotion, if the engine has it.
    pub ear: Option<Arc<WhisperEar>>,
    /// How the speaker sounds to the ear without emotion, if that is known.
    pub neutral_voice: Option<NeutralVoice>,
    /// The emotion by the ear, computed when it is first needed.
    heard_emotion: OnceLock<HeardEmotion>,
    /// The emotion of another recording, which the face is to show.
    other_emotion: Option<HeardEmotion>,
    /// Log-posteriors of the phones `[R, K]`, computed when they are first needed.
    phone_rows: OnceLock<Array2<f32>>,
    /// The model that recognises phones in the features, if the engine has it.
    pub phones: Option<Arc<PhoneModel>>,
    /// Length of the sound in seconds.
    pub duration_s: f64,
    pub(super) encoder: Arc<dyn SpeechEncoder>,
}

impl SpeechFeatures {
    /// Analyses a sound.
    ///
    /// # Errors
    /// Those of [`SpeechEncoder::encode`]; `Cancelled`.
    pub fn of(
        waveform: &Waveform,
        encoder: &Arc<dyn SpeechEncoder>,
        progress: ProgressFn<'_>,
    ) -> Result<SpeechFeatures> {
        let share = |from: f32, to: f32| {
            move |p: Progress| {
                let fraction = from + (to - from) * p.fraction;
                progress(Progress { fraction, ..p })
            }
        };
        Ok(SpeechFeatures {
            track: encoder.encode(waveform, &share(0.0, ENCODED))?,
            prosody: Prosody::of(waveform),
            voice: VoiceTrack::hear(waveform, &share(ENCODED, 1.0))?,
            ear: None,
            neutral_voice: None,
            heard_emotion: OnceLock::new(),
            other_emotion: None,
            phone_rows: OnceLock::new(),
            phones: None,
            duration_s: waveform.duration_s(),
            encoder: Arc::clone(encoder),
        })
    }

    /// The phone model, and the log-posteriors `[R, K]` that it gives the sound, computed once for lips
    /// and tongue. `None` if the engine has no such model, or none for the encoder's features.
    pub(super) fn phone_rows(&self) -> Option<(&PhoneModel, ArrayView2<'_, f32>)> {
        let phones = self.phones.as_ref()?;
        if !phones.hears(&self.track, self.encoder_name()) {
            return None;
        }
        let read = || phones.log_posteriors(self.track.features.view());
        Some((phones, self.phone_rows.get_or_init(read).view()))
    }

    /// What the phone model reads.
    pub(crate) fn phone_input(&self) -> PhoneInput<'_> {
        PhoneInput {
            track: &self.track,
            encoder: self.encoder_name(),
            prosody: &self.prosody,
            duration_s: self.duration_s,
        }
    }

    /// Sets the log-posteriors `[R, K]` of the phones.
    pub(crate) fn set_phone_rows(&mut self, rows: Array2<f32>) {
        self.phone_rows = OnceLock::from(rows);
    }

    /// Takes the phones from a script instead of the sound alone, for lips, tongue and shapes.
    ///
    /// # Errors
    /// `Weights` if the phone model does not know this encoder's features; `InvalidInput` for a text
    /// without a letter, or one too long for the sound.
    pub(crate) fn follow(&mut self, script: &Script) -> Result<()> {
        let phones = self.phones.as_ref().ok_or_else(|| {
            Error::InvalidInput("script: expected an engine that hears phones, got none".into())
        })?;
        let rows = phones.told(self.phone_input(), script)?;
        self.set_phone_rows(rows);
        Ok(())
    }

    /// How likely each emotion is over time, by the ear. `None` if the engine has no ear. It is heard
    /// when this is first called.
    ///
    /// # Errors
    /// Those of [`WhisperEar::heard`].
    pub fn heard_emotion(&self, progress: ProgressFn<'_>) -> Result<Option<&HeardEmotion>> {
        let Some(ear) = &self.ear else {
            return Ok(None);
        };
        if self.heard_emotion.get().is_none() {
            let heard = ear.heard(&self.voice, self.neutral_voice.as_ref(), progress)?;
            let _ = self.heard_emotion.set(heard);
        }
        Ok(self.heard_emotion.get())
    }

    /// Hears the emotion of another recording, which the face is to show. Its intensity is that of a
    /// recording that was chosen for its emotion.
    ///
    /// # Errors
    /// Those of [`WhisperEar::heard`].
    pub(crate) fn hear_other(
        &mut self,
        other: &VoiceTrack,
        progress: ProgressFn<'_>,
    ) -> Result<()> {
        if let Some(ear) = &self.ear {
            self.other_emotion = Some(ear.heard(other, None, progress)?.on_purpose());
        }
        Ok(())
    }

    /// The emotion of [`SpeechFeatures::hear_other`].
    pub(crate) fn other_emotion(&self) -> Option<&HeardEmotion> {
        self.other_emotion.as_ref()
    }

    /// The emotion that was heard so far: in the other recording or, without one, in the voice.
    pub(crate) fn heard_before(&self) -> Option<&HeardEmotion> {
        self.other_emotion().or(self.heard_emotion.get())
    }

    /// The emotion in the voice by the ear; neutral if the engine has no ear.
    ///
    /// # Errors
    /// Those of [`WhisperEar::heard`].
    pub fn emotion_curve(&self, progress: ProgressFn<'_>) -> Result<EmotionCurve> {
        let heard = self.heard_emotion(progress)?;
        Ok(heard.map(HeardEmotion::curve).unwrap_or_default())
    }

    /// The name of the encoder of the features.
    pub fn encoder_name(&self) -> &'static str {
        self.encoder.name()
    }

    /// Number of motion frames: one for every started `1 / fps` seconds, at least one.
    pub fn frames(&self, fps: f64) -> usize {
        frames_of(self.duration_s, fps)
    }

    /// Speech features at the times of motion frames, `[T, C]`.
    pub fn features(&self, fps: f64) -> Array2<f32> {
        at_motion_frames(&self.track, self.frames(fps), fps)
    }
}
