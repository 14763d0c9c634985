//! EmoFace live: both encoders have causal twins, and the rest of the model only looks back.

use std::sync::{Arc, OnceLock};

use ndarray::{ArrayView1, ArrayView2, ArrayViewMut2};

use super::{EmoFaceConfig, HeardFrame, Layer, MadeFrame, Model, Progressing};
use crate::{
    Error, Result,
    audio::SAMPLE_RATE_HZ,
    conditions::{EMOTIONS, Emotion},
    mesh::ibug::LANDMARKS,
    motion::{
        Expressions, Follower, LandmarkFrame, LiveClosures, MotionStream, WidthGain, mouth_width,
    },
    speech::{
        CausalModel, CausalSpeech, EmotionEar, EmotionEncoder, LiveEar, LiveEmotion, VoiceGate,
    },
};

/// The parts of a stream, shared by all streams of one system.
pub struct LiveParts {
    /// The causal twin of the content encoder.
    pub content: Arc<CausalModel>,
    /// Hears when the lips are together.
    pub closures: Arc<CausalModel>,
    /// The emotion encoder, which looks back only.
    pub emotion: Arc<EmotionEncoder>,
    /// Recognises the voice's emotion and its intensity.
    pub ear: Arc<EmotionEar>,
    /// How fast each emotion comes and goes.
    pub expressions: Arc<Expressions>,
    /// Both branches and Mesh Attention.
    pub model: Arc<Model>,
    /// Widens the mouth.
    pub width: WidthGain,
    /// The content features of silence, `[C]`, computed for the first stream.
    pub silence: OnceLock<Vec<f32>>,
}

impl LiveParts {
    /// The content features after a second of silence, `[C]`. Computed once, since a host opens a
    /// stream at every jump.
    fn silence(&self) -> &[f32] {
        self.silence.get_or_init(|| {
            let mut speech = CausalSpeech::new(Arc::clone(&self.content));
            speech
                .push(&[0.0; SAMPLE_RATE_HZ as usize])
                .expect("zeros are a sound");
            let mut heard = vec![0.0; self.content.config().outputs];
            while let Some(row) = speech.pull(|_| {}) {
                heard.copy_from_slice(row);
            }
            heard
        })
    }
}

/// Factor on the onset of emotions. Mesh Attention reacts to the middle of a change more steeply than
/// in proportion to it.
pub const EASING: f32 = 2.1;
/// The strength from which an emotion's own features move the face.
const FAINT: f32 = 0.2;

/// A performance in progress, in the default style and starting from rest.
///
/// The emotion comes from the voice, and its level is the ear's intensity, which is low for a
/// neutral voice. If the host sets an emotion with an intensity above 0, that emotion replaces the
/// voice's and the intensity is its level. Emotions come and go as fast as on a face. The lips close
/// where the sound has p, b or m.
pub struct EmoFaceStream {
    parts: Arc<LiveParts>,
    speech: CausalSpeech,
    closures: LiveClosures,
    gate: VoiceGate,
    live_emotion: LiveEmotion,
    ear: LiveEar,
    state: Progressing,
    style: usize,
    /// The emotion that was set. It counts if its intensity is above 0.
    emotion: Emotion,
    /// The strengths that the face shows.
    follower: Follower,
}

impl EmoFaceStream {
    /// Starts with the face at rest, before any sound.
    ///
    /// # Errors
    /// `Weights` for a model whose default style is not among its styles.
    pub fn new(parts: Arc<LiveParts>) -> Result<Self> {
        let config = parts.model.config();
        let style = crate::motion::style_number(None, &config.styles, &config.default_style)?;
        let hearing = parts.content.config();
        Ok(EmoFaceStream {
            gate: VoiceGate::new(hearing.fps, hearing.look_ahead_samples()),
            speech: CausalSpeech::new(Arc::clone(&parts.content)),
            live_emotion: LiveEmotion::new(Arc::clone(&parts.emotion)),
            ear: LiveEar::new(Arc::clone(&parts.ear)),
            state: parts.model.start(None)?,
            style,
            emotion: Emotion::default(),
            closures: LiveClosures::new(Arc::clone(&parts.closures), None),
            follower: Follower::new(EASING),
            parts,
        })
    }
}

impl MotionStream for EmoFaceStream {
    fn push(&mut self, samples: &[f32]) -> Result<()> {
        self.speech.push(samples)?;
        self.closures.push(samples)?;
        self.gate.push(samples);
        Ok(())
    }

    fn pull(&mut self) -> Option<LandmarkFrame> {
        if !self.closures.is_ready() {
            return None;
        }
        let index = self.speech.next_row();
        let (live, ear) = (&mut self.live_emotion, &mut self.ear);
        let content = self.speech.pull(|stretch| {
            if let Some(window) = live.hear(stretch) {
                ear.hear(&window);
            }
        })?;
        let spoken = self.gate.share(index);
        let content: Vec<f32> = content
            .iter()
            .zip(self.parts.silence())
            .map(|(said, silent)| spoken * said + (1.0 - spoken) * silent)
            .collect();
        let mut feeling = ear.emotion();
        feeling.intensity *= spoken;
        let config = self.parts.model.config();
        let is_set = self.emotion.intensity > 0.0;
        let shown = if is_set { self.emotion } else { feeling };
        let targets = known(config, &shown.mixture).map(|share| share * shown.intensity);
        let strengths = self
            .follower
            .step(&targets, &self.parts.expressions, config.fps);
        let level: f32 = strengths.iter().sum();
        let emotion = if is_set || config.emotion_ear {
            let mixture = if level > 0.0 {
                strengths.map(|strength| strength / level)
            } else {
                Emotion::default().mixture
            };
            faded_features(&self.parts.model, &mixture, level).ok()?
        } else {
            live.at_frame(index, config.fps)
        };
        let heard = HeardFrame {
            content: ArrayView1::from(&content),
            emotion: ArrayView1::from(&emotion),
            style: self.style,
            level,
        };
        let frame = self.parts.model.step(heard, Layer::Both, &mut self.state);
        let said = said_width(config, &frame);
        let mut frame = LandmarkFrame {
            index,
            displacements: landmarks(config, frame.layer(Layer::Both)),
        };
        let mut face = ArrayViewMut2::from(&mut frame.displacements);
        self.parts.width.widen(&mut face, said);
        self.closures.close(&mut frame, spoken);
        Some(frame)
    }

    fn finish(&mut self) -> Result<()> {
        self.speech.finish()?;
        self.closures.finish()
    }

    fn set_emotion(&mut self, emotion: &Emotion) -> Result<()> {
        if *emotion == self.emotion {
            return Ok(());
        }
        emotion.check_finite()?;
        if emotion.intensity > 0.0 {
            prototype(&self.parts.model, &emotion.mixture)?;
        }
        self.emotion = *emotion;
        Ok(())
    }

    fn set_onset(&mut self, onset: f32) {
        self.follower.onset = EASING * onset;
    }

    fn hear_all(&mut self) {
        self.gate.hear_all();
    }

    fn latency_s(&self) -> f64 {
        self.speech.config().look_ahead_s()
    }

    fn next_frame(&self) -> usize {
        self.speech.next_row()
    }

    fn fps(&self) -> f64 {
        self.speech.config().fps
    }
}

/// Features for the emotion branch, `[E]`: those of the emotions that it knows in a mixture. Below the
/// strength [`FAINT`] they fade to those of neutral, because Mesh Attention gives the mouth to the emotion
/// branch even where the emotion has no strength.
pub fn faded_features(model: &Model, mixture: &[f32], strength: f32) -> Result<Vec<f32>> {
    let x = (strength / FAINT).clamp(0.0, 1.0);
    let share = x * x * (3.0 - 2.0 * x);
    let neutral = Emotion::default().mixture;
    let mut faded = [0.0; EMOTIONS.len()];
    for ((to, of), rest) in faded.iter_mut().zip(mixture).zip(neutral) {
        *to = share * of + (1.0 - share) * rest;
    }
    prototype(model, &known(model.config(), &faded))
}

/// The mean features of a mixture of the fifteen emotions, `[E]`.
///
/// # Errors
/// `InvalidInput` for an emotion that the branch does not know.
pub fn prototype(model: &Model, mixture: &[f32]) -> Result<Vec<f32>> {
    let emotions = &model.config().emotions;
    let mut shares = vec![0.0; emotions.len()];
    for (name, share) in EMOTIONS.iter().zip(mixture) {
        match emotions.iter().position(|known| known == name) {
            Some(place) => shares[place] = *share,
            None if *share == 0.0 => {}
            None => {
                return Err(Error::InvalidInput(format!(
                    "emotion: expected one that the emotion branch knows ({}), got {name}",
                    emotions.join(", ")
                )));
            }
        }
    }
    Ok(model.prototype(&shares).to_vec())
}

/// A mixture of the fifteen emotions with 0 for those that the emotion branch does not know.
pub fn known(config: &EmoFaceConfig, mixture: &[f32]) -> [f32; EMOTIONS.len()] {
    std::array::from_fn(|e| {
        let is_known = config.emotions.iter().any(|name| name == EMOTIONS[e]);
        if is_known { mixture[e] } else { 0.0 }
    })
}

/// How far the content branch alone widens the mouth in a frame, metres.
pub fn said_width(config: &EmoFaceConfig, frame: &MadeFrame) -> f32 {
    mouth_width(ArrayView2::from(&landmarks(
        config,
        frame.layer(Layer::Content),
    )))
}

/// Picks the landmarks from a layer's vertices `values`, `[3 V]` metres.
pub fn landmarks(config: &EmoFaceConfig, values: &[f32]) -> [[f32; 3]; LANDMARKS] {
    let at = &config.landmarks;
    std::array::from_fn(|n| std::array::from_fn(|axis| values[3 * at[n] + axis]))
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::{
        conditions::EmotionCurve,
        job::SILENT,
        motion::stream_whole,
        systems::{System, emoface::EmoFace},
    };

    /// A stream that moves to every sound, so that the syllables need not resemble a voice.
    fn stream() -> Box<dyn MotionStream> {
        let mut stream = EmoFace::open(None).unwrap().stream().unwrap();
        stream.hear_all();
        stream
    }

    /// Syllables with a falling pitch.
    fn voice(samples: usize) -> Vec<f32> {
        let sample = |i: usize| {
            let t = i as f32 / 16_000.0;
            let pitch = 2.0 * std::f32::consts::PI * (180.0 - 20.0 * t) * t;
            let tone: f32 = (1..12).map(|k| (k as f32 * pitch).sin() / k as f32).sum();
            0.2 * tone * (0.5 + 0.5 * (25.0 * t).sin())
        };
        (0..samples).map(sample).collect()
    }

    fn whole(samples: &[f32], emotion: &EmotionCurve) -> Array3<f32> {
        stream_whole(stream().as_mut(), samples, emotion, SILENT)
            .unwrap()
            .displacements
    }

    #[test]
    fn pieces_of_any_size_give_the_same_bits() {
        let samples = voice(40_000);
        let expected = whole(&samples, &EmotionCurve::Off);
        assert_eq!(expected.dim(), (63, LANDMARKS, 3));
        for size in [1, 160, 7_777] {
            let mut stream = stream();
            let mut frames = Vec::new();
            for piece in samples.chunks(size) {
                stream.push(piece).unwrap();
                frames.extend(stream.drain());
            }
            stream.finish().unwrap();
            frames.extend(stream.drain());
            let values: Vec<f32> = frames
                .iter()
                .flat_map(|frame| frame.displacements.as_flattened().to_vec())
                .collect();
            assert_eq!(values, expected.as_slice().unwrap());
        }
    }

    #[test]
    fn nothing_after_the_look_ahead_matters() {
        let samples = voice(32_000);
        let mut other = samples.clone();
        other[20_000..].fill(0.9);
        let frames = (20_000 - 3_200) / 640;
        let (a, b) = (
            whole(&samples, &EmotionCurve::Off),
            whole(&other, &EmotionCurve::Off),
        );
        let begun = |x: &Array3<f32>| x.slice(ndarray::s![..frames, .., ..]).to_owned();
        assert_eq!(begun(&a), begun(&b));
        assert_ne!(a, b);
    }

    #[test]
    fn an_emotion_that_is_set_is_felt_and_one_that_was_not_taught_is_refused() {
        let samples = voice(32_000);
        let happy = Emotion::parse("happy:1").unwrap();
        let expressive = whole(&samples, &EmotionCurve::Constant(happy));
        let corner = |x: &Array3<f32>| {
            let frames = x.outer_iter().skip(25);
            frames
                .map(|frame| frame[[54, 0]] - frame[[48, 0]])
                .sum::<f32>()
                / 25.0
        };
        assert!(corner(&expressive) > corner(&whole(&samples, &EmotionCurve::Off)) + 1e-3);
        let mut stream = stream();
        let contempt = Emotion::parse("contempt:1").unwrap();
        let refused = stream.set_emotion(&contempt).unwrap_err().to_string();
        assert!(refused.contains("branch knows"), "{refused}");
    }

    #[test]
    fn silence_and_bad_samples_leave_a_sane_face() {
        let mut stream = stream();
        let refused = stream.push(&[0.0, f32::NAN]).unwrap_err().to_string();
        assert!(refused.contains("1 of 2 that are NaN"), "{refused}");
        let still = whole(&[0.0; 48_000], &EmotionCurve::Off);
        let largest = still.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        assert!(largest < 6e-3, "{largest} m");
    }
}
