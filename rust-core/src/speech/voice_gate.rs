//! How far somebody speaks, while it is heard: music, keys, breath and fans leave a face at rest.
//!
//! A small network (the crate `earshot`) hears a voice in every 16 ms. It takes music for one, whose partials stand
//! still where those of a voice glide: that is what [`Tones`] measures. Both decide ahead of the face, whose frames wait
//! for the sound after them, so that the gate is open when a word begins.

#[cfg(test)]
mod tests;
mod tones;

use std::collections::VecDeque;

use earshot::Detector;

use crate::audio::SAMPLE_RATE_HZ;
use tones::{Tones, WINDOW};

/// A window scored so high has a voice in it, and one that goes on.
const VOICE: f32 = 0.65;
const VOICE_GOES_ON: f32 = 0.3;
/// So many windows of voice in a row open the gate.
const WINDOWS_TO_OPEN: usize = 2;
/// Steadiness below which the gate opens, below which a voice goes on, and above which it shuts at once.
const GLIDING: f32 = 0.5;
const STILL_GLIDING: f32 = 0.65;
const STEADY: f32 = 0.7;
/// The gate stays open for so many windows without a voice, 0.45 s: pauses between words.
const PAUSE: usize = 28;
/// How long the face takes to wake and to come to rest, seconds.
const WAKE_S: f64 = 0.08;
const REST_S: f64 = 0.3;

/// Hears whether somebody speaks. What it says of a frame is the same bit for bit however the sound was cut.
pub struct VoiceGate {
    detector: Box<Detector>,
    tones: Tones,
    samples: VecDeque<f32>,
    window: [f32; WINDOW],
    /// Samples that were heard.
    heard: usize,
    is_open: bool,
    /// Windows of voice in a row.
    voiced: usize,
    /// Windows since the last voice.
    pause: usize,
    share: f32,
    closed_s: f64,
    hears_all: bool,
    fps: f64,
    ahead: usize,
}

impl VoiceGate {
    /// Closed. `ahead`: samples after a frame's instant that it waits for.
    pub fn new(fps: f64, ahead: usize) -> VoiceGate {
        VoiceGate {
            detector: Detector::default_boxed(),
            tones: Tones::new(),
            samples: VecDeque::new(),
            window: [0.0; WINDOW],
            heard: 0,
            is_open: false,
            voiced: 0,
            pause: 0,
            share: 0.0,
            closed_s: f64::INFINITY,
            hears_all: false,
            fps,
            ahead,
        }
    }

    /// Takes samples `[S]`, finite, mono at 16 kHz.
    pub fn push(&mut self, samples: &[f32]) {
        if !self.hears_all {
            self.samples.extend(samples);
        }
    }

    /// Waits for so many samples after a frame's instant from the first frame on.
    pub fn wait_for(&mut self, ahead: usize) {
        self.ahead = ahead;
    }

    /// Stays open from now on.
    pub fn hear_all(&mut self) {
        self.hears_all = true;
        self.samples = VecDeque::new();
        (self.share, self.closed_s) = (1.0, 0.0);
    }

    /// How far the face speaks in frame number `index`, 0 to 1. Frames come in order; zeros follow the last sample.
    pub fn share(&mut self, index: usize) -> f32 {
        if self.hears_all {
            return 1.0;
        }
        let instant = index as f64 / self.fps * f64::from(SAMPLE_RATE_HZ);
        while self.heard + WINDOW <= instant as usize + self.ahead {
            self.hear();
        }
        let step_s = 1.0 / self.fps;
        let step = match self.is_open {
            true => step_s / WAKE_S,
            false => -step_s / REST_S,
        };
        self.share = (self.share + step as f32).clamp(0.0, 1.0);
        match self.share > 0.0 {
            true => self.closed_s = 0.0,
            false => self.closed_s += step_s,
        }
        // Slow at both ends.
        self.share * self.share * (3.0 - 2.0 * self.share)
    }

    /// How long nobody has spoken at the last frame, seconds; infinite before anybody did.
    pub fn closed_s(&self) -> f64 {
        self.closed_s
    }

    /// Hears one window more.
    fn hear(&mut self) {
        for to in &mut self.window {
            *to = self.samples.pop_front().unwrap_or(0.0).clamp(-1.0, 1.0);
        }
        self.heard += WINDOW;
        let voice = self.detector.predict_f32(&self.window);
        let steadiness = self.tones.hear(&self.window, voice > VOICE_GOES_ON);
        let (least, most) = match self.is_open {
            true => (VOICE_GOES_ON, STILL_GLIDING),
            false => (VOICE, GLIDING),
        };
        let is_voice = voice > least && steadiness < most;
        self.voiced = if is_voice { self.voiced + 1 } else { 0 };
        self.pause = if is_voice { 0 } else { self.pause + 1 };
        self.is_open = match self.is_open {
            true => self.pause <= PAUSE && steadiness <= STEADY,
            false => self.voiced >= WINDOWS_TO_OPEN,
        };
    }
}
