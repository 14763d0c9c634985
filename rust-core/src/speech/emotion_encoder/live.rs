//! `F_e` of a live voice.

use std::{collections::VecDeque, sync::Arc};

use ndarray::{Array1, Array2, Axis};

use super::{
    BANDS, Ear, EmotionEncoder, FRAME, FRAMES_HZ, HeardFrame, LEAST, PEAK, SILENT, STEP,
    VoiceTrack, VoiceWindow, WINDOW, Waveform, cepstral_basis,
};

/// Number of stored instants: one after the frame, one before it, one that came early.
const INSTANTS: usize = 3;

/// Gives the same as [`EmotionEncoder::at_frames`] does for the whole voice, with two differences.
/// The level is that of the voice so far, and the first 0.8 s get the mean of the training data.
pub struct LiveEmotion {
    encoder: Arc<EmotionEncoder>,
    ear: Ear,
    /// Loudest sample so far.
    peak: f32,
    /// The last two seconds.
    frames: VecDeque<HeardFrame>,
    /// Number of frames of 10 ms so far.
    heard: usize,
    /// Instants and their features, the newest last. An instant is given as the number of frames
    /// before it.
    instants: VecDeque<(usize, Array1<f64>)>,
}

impl LiveEmotion {
    /// Before any sound.
    pub fn new(encoder: Arc<EmotionEncoder>) -> LiveEmotion {
        let mean = encoder.mean.clone().insert_axis(Axis(0));
        let mean = encoder.of_numbers(&mean).row(0).to_owned();
        LiveEmotion {
            ear: Ear::new(),
            peak: 0.0,
            frames: VecDeque::with_capacity(WINDOW),
            heard: 0,
            instants: VecDeque::from([(LEAST - STEP, mean)]),
            encoder,
        }
    }

    /// Adds the samples around the next 10 ms. At an instant, returns the window of the last two
    /// seconds.
    pub fn hear(&mut self, stretch: &[f32; FRAME]) -> Option<VoiceWindow> {
        let loudest = stretch.iter().fold(self.peak, |peak, x| peak.max(x.abs()));
        let gain = |peak: f32| if peak > SILENT { PEAK / peak } else { 1.0 };
        let (before, now) = (gain(self.peak), gain(loudest));
        if before != now {
            // Change the earlier frames as if this gain had applied from the start. Log-mel is of
            // power, hence the factor 2.
            let shift = 2.0 * (now / before).ln();
            let mel = self.frames.iter_mut().flat_map(|frame| &mut frame.mel);
            mel.for_each(|x| *x += shift);
        }
        self.peak = loudest;
        if self.frames.len() == WINDOW {
            self.frames.pop_front();
        }
        let scaled = stretch.map(|x| now * x);
        self.frames.push_back(self.ear.hear(&scaled));
        self.heard += 1;
        if self.heard >= LEAST && (self.heard - LEAST).is_multiple_of(STEP) {
            let window = self.window();
            let numbers = Array1::from_vec(window.numbers.clone()).insert_axis(Axis(0));
            let emotion = self.encoder.of_numbers(&numbers).row(0).to_owned();
            if self.instants.len() == INSTANTS {
                self.instants.pop_front();
            }
            self.instants.push_back((self.heard, emotion));
            return Some(window);
        }
        None
    }

    /// `F_e` at motion frame `frame`, `[E]`. It depends on up to 160 ms after the frame.
    pub fn at_frame(&self, frame: usize, fps: f64) -> Vec<f32> {
        let at = frame as f64 * (FRAMES_HZ / fps);
        let known = self.instants.iter().rposition(|(end, _)| *end as f64 <= at);
        let below = known.unwrap_or(0);
        let above = (below + 1).min(self.instants.len() - 1);
        let share = ((at - self.instants[below].0 as f64) / STEP as f64).clamp(0.0, 1.0);
        let pairs = self.instants[below].1.iter().zip(&self.instants[above].1);
        let mixed = pairs.map(|(a, b)| (a * (1.0 - share) + b * share) as f32);
        mixed.collect()
    }

    /// The window of the stored frames.
    fn window(&self) -> VoiceWindow {
        let rows = self.frames.len();
        let voice = VoiceTrack {
            mel: Array2::from_shape_fn((rows, BANDS), |(t, band)| self.frames[t].mel[band].into()),
            octave: self.frames.iter().map(|frame| frame.octave).collect(),
            periodic: self.frames.iter().map(|frame| frame.periodic).collect(),
            sound: Waveform { samples: vec![] },
        };
        let cepstra = voice.mel.dot(&cepstral_basis());
        voice.of_window(cepstra.view(), 0, rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        audio::Waveform,
        nn::golden::{Golden, distance},
        speech::{HOP, log_mel::cut_frame},
    };

    #[test]
    fn a_voice_that_was_heard_for_a_while_feels_as_it_does_heard_whole() {
        let golden = Golden::open("emotion_encoder_debug");
        let weights = golden.weights();
        let encoder = EmotionEncoder::load(&weights, &golden.metadata("config")).unwrap();
        let encoder = Arc::new(encoder);
        let mut samples = golden.values("samples");
        // The loudest sample comes first, so that the level is known from the start.
        samples[20] = 1.0;
        let whole = VoiceTrack::of(&Waveform {
            samples: samples.clone(),
        });
        let whole = encoder.at_frames(&whole, 75, 25.0);
        let mut live = LiveEmotion::new(Arc::clone(&encoder));
        let mut stretch = [0.0; FRAME];
        let mut frames = 0;
        let mut largest = 0.0f32;
        for mel in 0..samples.len() / HOP {
            cut_frame(&samples, mel, &mut stretch);
            live.hear(&stretch);
            // A frame is requested when 18 more frames of 10 ms have arrived.
            if mel >= 18 && (mel - 18).is_multiple_of(4) && frames < 75 {
                let emotion = live.at_frame(frames, 25.0);
                if frames * 4 >= LEAST {
                    largest = largest.max(distance(&emotion, whole.row(frames)));
                }
                frames += 1;
            }
        }
        assert!(frames > 60 && largest < 1e-4, "{frames} {largest}");
    }

    #[test]
    fn a_voice_that_grows_louder_is_heard_as_if_it_had_been_scaled_from_the_start() {
        let golden = Golden::open("emotion_encoder_debug");
        let encoder = EmotionEncoder::load(&golden.weights(), &golden.metadata("config")).unwrap();
        let encoder = Arc::new(encoder);
        let samples = golden.values("samples");
        let emotion_of = |samples: &[f32]| {
            let mut live = LiveEmotion::new(Arc::clone(&encoder));
            let mut stretch = [0.0; FRAME];
            for mel in 0..samples.len() / HOP {
                cut_frame(samples, mel, &mut stretch);
                live.hear(&stretch);
            }
            live.at_frame(70, 25.0)
        };
        let quiet: Vec<f32> = samples.iter().map(|x| 0.1 * x).collect();
        assert!(distance(&emotion_of(&samples), &emotion_of(&quiet)) < 1e-3);
        assert!(emotion_of(&[]).iter().all(|x| x.is_finite()));
    }
}
