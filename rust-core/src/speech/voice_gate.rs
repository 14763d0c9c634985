//! Tells live whether somebody speaks, so that music, keys, breath and fans leave the face at rest.
//!
//! A small network (the crate `earshot`) looks for a voice in every 16 ms of sound. It mistakes
//! music for a voice. The partials of music keep their pitch, whereas those of a voice glide, and
//! [`Tones`] measures this difference. Each frame of the face waits for the sound after it. The
//! gate has heard this sound too, so it is already open when a word begins.

#[cfg(test)]
mod tests;
mod tones;

use std::collections::VecDeque;

use earshot::Detector;

use crate::audio::SAMPLE_RATE_HZ;
use tones::{Tones, WINDOW};

/// Scores above which a window contains a voice: while the gate is shut, and while it is open.
const VOICE: f32 = 0.65;
const VOICE_GOES_ON: f32 = 0.3;
/// This many windows of voice in a row open the gate.
const WINDOWS_TO_OPEN: usize = 2;
/// Steadiness below which a window may open the gate, below which a voice may go on, and above
/// which the gate shuts at once.
const GLIDING: f32 = 0.5;
const STILL_GLIDING: f32 = 0.65;
const STEADY: f32 = 0.7;
/// The gate stays open for this many windows without a voice, 0.45 s, to span pauses between words.
const PAUSE: usize = 28;
/// Seconds that the face takes to wake, and to come to rest.
const WAKE_S: f64 = 0.08;
const REST_S: f64 = 0.3;

/// Hears whether somebody speaks. However the sound is cut into pieces, each frame gets the same
/// result bit for bit.
pub struct VoiceGate {
    detector: Box<Detector>,
    tones: Tones,
    samples: VecDeque<f32>,
    window: [f32; WINDOW],
    /// Number of samples heard so far.
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
    /// Makes a closed gate. `ahead`: how many samples after a frame's instant it waits for.
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

    /// Sets how many samples after a frame's instant the gate waits for. Call it before the first
    /// frame.
    pub fn wait_for(&mut self, ahead: usize) {
        self.ahead = ahead;
    }

    /// Stays open from now on.
    pub fn hear_all(&mut self) {
        self.hears_all = true;
        self.samples = VecDeque::new();
        (self.share, self.closed_s) = (1.0, 0.0);
    }

    /// Strength of the face's speech in frame number `index`, 0 to 1. Frames must come in order.
    /// Zeros stand in for samples after the last one.
    pub fn share(&mut self, index: usize) -> f32 {
        if self.hears_all {
            return 1.0;
        }
        let instant = index as f64 / self.fps * f64::from(SAMPLE_RATE_HZ);
        while self.heard + WINDOW <= instant as usize + self.ahead {
            self.hear();
        }
        let step_s = 1.0 / self.fps;
        let step = if self.is_open {
            step_s / WAKE_S
        } else {
            -step_s / REST_S
        };
        self.share = (self.share + step as f32).clamp(0.0, 1.0);
        if self.share > 0.0 {
            self.closed_s = 0.0
        } else {
            self.closed_s += step_s
        }
        // Slow at both ends.
        self.share * self.share * (3.0 - 2.0 * self.share)
    }

    /// Seconds for which the face had been at rest at the latest frame. Infinite before anybody has
    /// spoken.
    pub fn closed_s(&self) -> f64 {
        self.closed_s
    }

    /// Hears the next window.
    fn hear(&mut self) {
        for to in &mut self.window {
            *to = self.samples.pop_front().unwrap_or(0.0).clamp(-1.0, 1.0);
        }
        self.heard += WINDOW;
        let voice = self.detector.predict_f32(&self.window);
        let steadiness = self.tones.hear(&self.window, voice > VOICE_GOES_ON);
        let (least, most) = if self.is_open {
            (VOICE_GOES_ON, STILL_GLIDING)
        } else {
            (VOICE, GLIDING)
        };
        let is_voice = voice > least && steadiness < most;
        self.voiced = if is_voice { self.voiced + 1 } else { 0 };
        self.pause = if is_voice { 0 } else { self.pause + 1 };
        self.is_open = if self.is_open {
            self.pause <= PAUSE && steadiness <= STEADY
        } else {
            self.voiced >= WINDOWS_TO_OPEN
        };
    }
}
