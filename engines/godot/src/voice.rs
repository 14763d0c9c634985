//! A sound and the frames of the face that are computed from it.

use anyface::{
    Engine, Result,
    audio::SAMPLE_RATE_HZ,
    conditions::Emotion,
    motion::{WeightFrame, WeightStream},
};

/// Computes the frames of a sound, only as far as they are shown.
pub struct Voice {
    stream: WeightStream,
    samples: Vec<f32>,
    pushed: usize,
    /// All frames computed so far, from the first on.
    frames: Vec<WeightFrame>,
    /// The node's emotion text that the stream was last set to.
    emotion: String,
    is_over: bool,
}

/// The emotion text that asks for the emotion heard in the voice.
const HEARD: &str = "auto";

impl Voice {
    /// `samples`: all of the sound, mono at 16 kHz.
    pub fn new(engine: &Engine, samples: Vec<f32>, any_sound: bool) -> Result<Voice> {
        let mut stream = engine.weight_stream()?;
        if any_sound {
            stream.hear_all();
        }
        Ok(Voice {
            stream,
            samples,
            pushed: 0,
            frames: Vec::new(),
            emotion: String::new(),
            is_over: false,
        })
    }

    /// The face at a time of the sound, in seconds. Outside the sound the face is at rest.
    pub fn at(&mut self, seconds: f64, emotion: &str) -> Result<WeightFrame> {
        self.feel(emotion)?;
        let place = seconds * self.stream.fps();
        let number = place.floor().max(0.0) as usize;
        while self.frames.len() < number + 2 && !self.is_over {
            let end = self.samples.len().min(self.pushed + SAMPLES);
            self.stream.push(&self.samples[self.pushed..end])?;
            self.pushed = end;
            if end == self.samples.len() {
                self.stream.finish()?;
                self.is_over = true;
            }
            self.frames
                .extend(std::iter::from_fn(|| self.stream.pull()));
        }
        Ok(
            match (self.frames.get(number), self.frames.get(number + 1)) {
                (Some(one), Some(other)) if place >= 0.0 => {
                    between(one, other, place.fract() as f32)
                }
                (Some(one), None) if place >= 0.0 => one.clone(),
                _ => at_rest(),
            },
        )
    }

    fn feel(&mut self, emotion: &str) -> Result<()> {
        if emotion == self.emotion {
            return Ok(());
        }
        if emotion == HEARD {
            self.stream.hear_emotion();
        } else {
            self.stream.set_emotion(&Emotion::parse(emotion)?)?;
        }
        self.emotion = emotion.to_owned();
        Ok(())
    }
}

/// Samples that are pushed at once: one frame at 25 frames a second.
const SAMPLES: usize = SAMPLE_RATE_HZ as usize / 25;

/// Interpolates linearly between two frames.
fn between(one: &WeightFrame, other: &WeightFrame, share: f32) -> WeightFrame {
    let mix = |a: f32, b: f32| a + share * (b - a);
    WeightFrame {
        shapes: std::array::from_fn(|i| mix(one.shapes[i], other.shapes[i])),
        visemes: std::array::from_fn(|i| mix(one.visemes[i], other.visemes[i])),
        head: std::array::from_fn(|i| mix(one.head[i], other.head[i])),
        ..one.clone()
    }
}

fn at_rest() -> WeightFrame {
    WeightFrame {
        index: 0,
        shapes: [0.0; 52],
        visemes: [0.0; 15],
        emotion: Emotion::default(),
        head: [0.0; 3],
    }
}
