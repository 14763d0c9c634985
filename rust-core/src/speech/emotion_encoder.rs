//! Recognises emotion in the last two seconds of a voice: EmoFace's emotion encoder `E_e`.
//!
//! Twin of `training/systems/emoface/emotion_encoder.py`. It measures 118 numbers of the last two
//! seconds before each instant: pitch, voicing, loudness, tilt, cepstra and how they move. A linear
//! discriminant turns them into six coordinates that separate the emotions of the training data,
//! and into the probability of each emotion. Both together are `F_e`.

mod live;

pub use live::LiveEmotion;

use std::{f64::consts::PI, ops::Range, path::Path};

use ndarray::{Array1, Array2, ArrayView2, Axis, concatenate, s};

use super::log_mel::{BANDS, FRAME, MelAnalyser, cut_frame, frames_of_samples};
use crate::{
    Error, Result,
    audio::{SAMPLE_RATE_HZ, Waveform},
    conditions::EMOTIONS,
    job::{self, ProgressFn, report},
    models::{BuiltIn, Weights},
};

/// Built-in weights of [`EmotionEncoder`].
pub static EMOTION_ENCODER: BuiltIn = BuiltIn::new(&anyface_weights_shared::EMOTION_ENCODER);

/// Number of measurements at an instant.
pub const NUMBERS: usize = 118;
/// Frames of 10 ms in a full window.
const WINDOW: usize = 200;
/// Frames before the first instant.
const LEAST: usize = 80;
/// Frames from one instant to the next.
const STEP: usize = 16;
const FRAMES_HZ: f64 = 100.0;
const PEAK: f32 = 0.9;
const SILENT: f32 = 1e-4;
/// Frames less than this far below the window's loud level are active, nepers.
const ACTIVE_NEPERS: f64 = 4.0;
const LOUD_SHARE: f64 = 0.95;
const FIRST_LAG: usize = SAMPLE_RATE_HZ as usize / 400;
const END_LAG: usize = SAMPLE_RATE_HZ as usize / 65;
/// From the first bin above mains hum up to 1.5 kHz.
const LOW_BIN: usize = 3;
const HIGH_BIN: usize = 48;
const FFT: f64 = 512.0;
const PERIODIC: f64 = 0.6;
const LEAST_OVERLAP: f64 = 0.15;
const LEAST_VOICED: usize = 6;
const NO_PITCH: f64 = 7.0;
/// Largest step of the pitch from frame to frame, octaves. A larger one is another voice or an
/// error.
const LARGEST_STEP: f64 = 0.2;
const CEPSTRA: usize = 20;

/// `config.json` beside the weights.
#[derive(Debug, Clone, PartialEq, serde::Deserialize)]
pub struct EmotionEncoderConfig {
    /// Number of measurements; always `NUMBERS`.
    pub numbers: usize,
    /// Coordinates of the discriminant.
    pub coordinates: usize,
    /// Emotions in its training data, all of [`EMOTIONS`].
    pub emotions: Vec<String>,
}

/// Measurements of a voice in frames of 10 ms, independent of its level.
#[derive(Debug, Clone, PartialEq)]
pub struct VoiceTrack {
    /// `[M, 64]`, log-mel.
    mel: Array2<f64>,
    /// `[M]`, log2 of the pitch in Hz.
    octave: Vec<f64>,
    /// `[M]`, how periodic the sound is; 1 is fully periodic.
    periodic: Vec<f64>,
    /// The sound itself, for encoders that need it.
    sound: Waveform,
}

/// Measurements of a voice in one window of up to two seconds.
pub struct VoiceWindow {
    /// `[T, 64]`, log-mel relative to the loud level.
    pub(super) relative: Array2<f64>,
    /// Level of its loud frames, nepers of power.
    pub(super) loud: f64,
    /// `[T]`, log2 of the pitch in Hz.
    pub(super) octave: Vec<f64>,
    /// `[T]`, how periodic the sound is.
    pub(super) periodic: Vec<f64>,
    /// `[T]`, whether somebody speaks.
    pub(super) active: Vec<bool>,
    /// `[T]`, whether the sound has a pitch.
    pub(super) voiced: Vec<bool>,
    /// The [`NUMBERS`] measurements.
    pub(super) numbers: Vec<f64>,
    /// Frames of 10 ms from the start of the voice.
    pub(super) frames: Range<usize>,
    /// Seconds from the start of the voice.
    pub(super) middle_s: f64,
}

/// The discriminant.
pub struct EmotionEncoder {
    config: EmotionEncoderConfig,
    mean: Array1<f64>,
    scale: Array1<f64>,
    /// `[118, 6]`.
    coordinates: Array2<f64>,
    /// `[118, emotions]`.
    weight: Array2<f64>,
    bias: Array1<f64>,
}

/// Frames between two reports of progress: ten seconds of sound.
const REPORTED: usize = 1000;

impl VoiceTrack {
    /// From a sound.
    pub fn of(waveform: &Waveform) -> VoiceTrack {
        VoiceTrack::hear(waveform, job::SILENT).expect("nobody cancels it")
    }

    /// The same for a sound that may be long: reports progress and can be cancelled.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn hear(waveform: &Waveform, progress: ProgressFn<'_>) -> Result<VoiceTrack> {
        let scaled = scaled_samples(waveform);
        let (mut ear, mut stretch) = (Ear::new(), [0.0; FRAME]);
        let frames = frames_of_samples(scaled.len());
        let mut voice = VoiceTrack {
            mel: Array2::zeros((frames, BANDS)),
            octave: Vec::with_capacity(frames),
            periodic: Vec::with_capacity(frames),
            sound: waveform.clone(),
        };
        for t in 0..frames {
            if t % REPORTED == 0 {
                report(progress, "speech", t as f32 / frames as f32)?;
            }
            cut_frame(&scaled, t, &mut stretch);
            let heard = ear.hear(&stretch);
            for (to, from) in voice.mel.row_mut(t).iter_mut().zip(heard.mel) {
                *to = from.into();
            }
            voice.octave.push(heard.octave);
            voice.periodic.push(heard.periodic);
        }
        Ok(voice)
    }

    /// Length in seconds.
    pub fn duration_s(&self) -> f64 {
        self.octave.len() as f64 / FRAMES_HZ
    }

    /// The sound itself.
    pub fn sound(&self) -> &Waveform {
        &self.sound
    }

    /// From a sound whose emotion is requested.
    ///
    /// # Errors
    /// `Audio` if it is silent or too short to show an emotion.
    pub fn checked(waveform: &Waveform) -> Result<VoiceTrack> {
        check_voice("emotion", waveform)?;
        Ok(VoiceTrack::of(waveform))
    }

    /// From a sound without emotion; see [`crate::MotionRequest::neutral_voice`].
    ///
    /// # Errors
    /// `Audio` if it is silent or too short to show an emotion.
    pub fn neutral(waveform: &Waveform) -> Result<VoiceTrack> {
        check_voice("neutral voice", waveform)?;
        Ok(VoiceTrack::of(waveform))
    }

    /// The measurements at each instant, `[I, 118]`. Empty for a sound shorter than 0.8 s.
    pub(super) fn numbers(&self) -> Array2<f64> {
        let frames = self.octave.len();
        let cepstra = self.mel.dot(&cepstral_basis());
        let ends: Vec<usize> = (LEAST..=frames).step_by(STEP).collect();
        let mut out = Array2::zeros((ends.len(), NUMBERS));
        for (end, mut row) in ends.into_iter().zip(out.outer_iter_mut()) {
            let first = end.saturating_sub(WINDOW);
            let cepstra = cepstra.slice(s![first..end, ..]);
            let measured = self.of_window(cepstra, first, end).numbers;
            assert_eq!(measured.len(), NUMBERS);
            row.assign(&Array1::from_vec(measured));
        }
        out
    }

    /// The windows that end at the instants, only one in `every` of them.
    pub(super) fn windows(&self, every: usize) -> Vec<VoiceWindow> {
        let cepstra = self.mel.dot(&cepstral_basis());
        let ends = (LEAST..=self.octave.len()).step_by(STEP * every);
        let window = |end: usize| {
            let first = end.saturating_sub(WINDOW);
            self.of_window(cepstra.slice(s![first..end, ..]), first, end)
        };
        ends.map(window).collect()
    }

    /// Measures the frames from `first` to `end`. `cepstra`: those of these frames, `[T, 20]`.
    fn of_window(&self, cepstra: ArrayView2<'_, f64>, first: usize, end: usize) -> VoiceWindow {
        let mel = self.mel.slice(s![first..end, ..]);
        let level: Vec<f64> = mel
            .outer_iter()
            .map(|row| row.sum() / BANDS as f64)
            .collect();
        let loud = quantile(&level, LOUD_SHARE);
        let active: Vec<bool> = level.iter().map(|x| *x > loud - ACTIVE_NEPERS).collect();
        let periodic = self.periodic[first..end].iter().zip(&active);
        let voiced: Vec<bool> = periodic
            .map(|(x, active)| *x > PERIODIC && *active)
            .collect();
        let relative = mel.mapv(|x| x - loud);
        let spoken = relative.select(Axis(0), &true_places(&active));
        let mut numbers = pitch(&self.octave[first..end], &voiced);
        numbers.extend(loudness(&level, loud, &active));
        numbers.extend(tilt(&spoken));
        numbers.extend(timbre(cepstra, loud, &active));
        let sung = true_places(&voiced);
        let coloured = if sung.len() >= LEAST_VOICED {
            relative.select(Axis(0), &sung)
        } else {
            spoken
        };
        numbers.extend(columns(&coloured, mean).into_iter().step_by(4));
        VoiceWindow {
            relative,
            loud,
            octave: self.octave[first..end].to_vec(),
            periodic: self.periodic[first..end].to_vec(),
            active,
            voiced,
            numbers,
            frames: first..end,
            middle_s: (first + end) as f64 / (2.0 * FRAMES_HZ),
        }
    }
}

/// Scales a sound to the level of the training data, so that its own level has no effect.
fn scaled_samples(waveform: &Waveform) -> Vec<f32> {
    let samples = &waveform.samples;
    let peak = samples.iter().fold(0.0f32, |peak, x| peak.max(x.abs()));
    let gain = if peak > SILENT { PEAK / peak } else { 1.0 };
    samples.iter().map(|x| x * gain).collect()
}

/// Checks whether a sound can show an emotion. `what` begins the message.
fn check_voice(what: &str, waveform: &Waveform) -> Result<()> {
    let (least_s, got_s) = (LEAST as f64 / FRAMES_HZ, waveform.duration_s());
    if !waveform.is_silent() && got_s >= least_s {
        return Ok(());
    }
    let got = if waveform.is_silent() {
        "silence".to_owned()
    } else {
        format!("{got_s:.2} s")
    };
    Err(Error::Audio(format!(
        "{what}: expected a voice of at least {least_s} s, got {got}"
    )))
}

impl EmotionEncoder {
    /// The built-in encoder, or the one in `folder`.
    ///
    /// # Errors
    /// `Weights` or `Io` if a file is missing or damaged, or the files do not fit each other.
    pub fn open(folder: Option<&Path>) -> Result<Self> {
        let files = EMOTION_ENCODER.open(folder)?;
        Self::load(&Weights::from_bytes(&files.weights)?, &files.config)
    }

    fn load(weights: &Weights, config: &str) -> Result<Self> {
        let wrong = |message: String| Error::Weights(format!("emotion config.json: {message}"));
        let config: EmotionEncoderConfig =
            serde_json::from_str(config).map_err(|e| wrong(e.to_string()))?;
        let mut names = config.emotions.iter();
        if let Some(name) = names.find(|name| !EMOTIONS.contains(&name.as_str())) {
            return Err(wrong(format!(
                "emotions: expected names of {EMOTIONS:?}, got {name:?}"
            )));
        }
        if config.numbers != NUMBERS {
            return Err(wrong(format!(
                "numbers: expected {NUMBERS}, got {}",
                config.numbers
            )));
        }
        let classes = config.emotions.len();
        let vector = |name: &str, length| -> Result<Array1<f64>> {
            Ok(weights.vector(name, length)?.mapv(f64::from))
        };
        let matrix = |name: &str, columns| -> Result<Array2<f64>> {
            Ok(weights.matrix(name, NUMBERS, columns)?.mapv(f64::from))
        };
        let scale = vector("scale", NUMBERS)?;
        if let Some(value) = scale.iter().find(|value| **value <= 0.0) {
            return Err(Error::Weights(format!(
                "emotion: scale: expected more than 0, got {value}"
            )));
        }
        Ok(EmotionEncoder {
            mean: vector("mean", NUMBERS)?,
            scale,
            coordinates: matrix("coordinates", config.coordinates)?,
            weight: matrix("weight", classes)?,
            bias: vector("bias", classes)?,
            config,
        })
    }

    /// Channels `E` of the features: coordinates, then probabilities.
    pub fn channels(&self) -> usize {
        self.config.coordinates + self.config.emotions.len()
    }

    /// Emotions in its training data.
    pub fn emotions(&self) -> &[String] {
        &self.config.emotions
    }

    /// `F_e` at motion frames, `[frames, E]`. Each frame depends on the sound up to 160 ms after it,
    /// the first ones on the first 0.8 s.
    ///
    /// A sound shorter than 0.8 s gets the mean of the training data.
    pub fn at_frames(&self, voice: &VoiceTrack, frames: usize, fps: f64) -> Array2<f32> {
        let frame = |t: usize| t as f64 * (FRAMES_HZ / fps);
        self.sampled(voice, frames, frame)
    }

    /// `F_e` of a whole voice, stretched over `frames` frames, `[frames, E]`.
    pub fn over(&self, voice: &VoiceTrack, frames: usize) -> Array2<f32> {
        let end = voice.octave.len() as f64;
        let first = (LEAST as f64).min(end);
        let pace = (end - first) / frames.saturating_sub(1).max(1) as f64;
        self.sampled(voice, frames, |t| first + t as f64 * pace)
    }

    fn sampled(
        &self,
        voice: &VoiceTrack,
        frames: usize,
        frame: impl Fn(usize) -> f64,
    ) -> Array2<f32> {
        let mut numbers = voice.numbers();
        if numbers.nrows() == 0 {
            numbers = self.mean.clone().insert_axis(Axis(0));
        }
        let heard = self.of_numbers(&numbers);
        let last = heard.nrows() - 1;
        let mut out = Array2::zeros((frames, heard.ncols()));
        for (t, mut row) in out.outer_iter_mut().enumerate() {
            let at = ((frame(t) - LEAST as f64) / STEP as f64).clamp(0.0, last as f64);
            let below = (at as usize).min(last.saturating_sub(1));
            let share = at - below as f64;
            let mixed =
                &heard.row(below) * (1.0 - share) + &heard.row((below + 1).min(last)) * share;
            row.assign(&mixed.mapv(|x| x as f32));
        }
        out
    }

    /// `[I, 118]` → `[I, E]`.
    pub(super) fn of_numbers(&self, numbers: &Array2<f64>) -> Array2<f64> {
        let x = (numbers - &self.mean) / &self.scale;
        let mut shares = x.dot(&self.weight) + &self.bias;
        for mut row in shares.rows_mut() {
            let largest = row.fold(f64::NEG_INFINITY, |a, b| a.max(*b));
            row.mapv_inplace(|logit| (logit - largest).exp());
            row /= row.sum();
        }
        let coordinates = x.dot(&self.coordinates);
        concatenate(Axis(1), &[coordinates.view(), shares.view()]).expect("equal rows")
    }
}

/// Measurements of one frame of 10 ms.
struct HeardFrame {
    mel: [f32; BANDS],
    /// log2 of the pitch in Hz.
    octave: f64,
    periodic: f64,
}

/// Measures one frame after another.
struct Ear {
    analyser: MelAnalyser,
    cosines: Array2<f64>,
    overlap: Array1<f64>,
}

impl Ear {
    fn new() -> Ear {
        Ear {
            analyser: MelAnalyser::new(),
            cosines: cosines(),
            overlap: overlap(),
        }
    }

    fn hear(&mut self, stretch: &[f32; FRAME]) -> HeardFrame {
        let mut mel = [0.0; BANDS];
        self.analyser.frame(stretch, &mut mel);
        let bins = self.analyser.power().skip(LOW_BIN).take(HIGH_BIN - LOW_BIN);
        let power = Array1::from_iter(bins);
        let share = power.dot(&self.cosines) / power.sum().max(1e-9) / &self.overlap;
        let best = (0..share.len()).fold(
            0,
            |best, lag| if share[lag] > share[best] { lag } else { best },
        );
        let hertz = f64::from(SAMPLE_RATE_HZ) / (FIRST_LAG + best) as f64;
        HeardFrame {
            mel,
            octave: hertz.log2(),
            periodic: share[best],
        }
    }
}

/// `[45, lags]`: each bin's contribution to the autocorrelation.
fn cosines() -> Array2<f64> {
    Array2::from_shape_fn((HIGH_BIN - LOW_BIN, END_LAG - FIRST_LAG), |(bin, lag)| {
        let turns = ((LOW_BIN + bin) * (FIRST_LAG + lag)) as f64 / FFT;
        (2.0 * PI * turns).cos()
    })
}

/// Autocorrelation of the Hann window at the lags, relative to lag 0.
fn overlap() -> Array1<f64> {
    let window: [f64; FRAME] =
        std::array::from_fn(|k| 0.5 - 0.5 * (2.0 * PI * k as f64 / FRAME as f64).cos());
    let at = |lag: usize| -> f64 {
        let pairs = window[lag..].iter().zip(&window);
        pairs.map(|(a, b)| a * b).sum()
    };
    (FIRST_LAG..END_LAG)
        .map(|lag| (at(lag) / at(0)).max(LEAST_OVERLAP))
        .collect()
}

/// Orthonormal DCT-II of the bands, `[64, 20]`.
fn cepstral_basis() -> Array2<f64> {
    let bands = BANDS as f64;
    Array2::from_shape_fn((BANDS, CEPSTRA), |(band, k)| {
        let norm = if k == 0 { 1.0 } else { 2.0 };
        (PI * (band as f64 + 0.5) * k as f64 / bands).cos() * (norm / bands).sqrt()
    })
}

/// Pitch and voicing of a window, 13 numbers.
fn pitch(octave: &[f64], voiced: &[bool]) -> Vec<f64> {
    let mut runs: Vec<f64> = Vec::new();
    let mut before = false;
    for now in voiced {
        match (before, *now) {
            (false, true) => runs.push(1.0),
            (true, true) => *runs.last_mut().expect("a run has begun") += 1.0,
            _ => {}
        }
        before = *now;
    }
    let frames = voiced.len() as f64;
    let spoken: Vec<f64> = octave
        .iter()
        .zip(voiced)
        .filter(|(_, v)| **v)
        .map(|(x, _)| *x)
        .collect();
    let rate = [
        spoken.len() as f64 / frames,
        100.0 * runs.len() as f64 / frames,
        mean(&runs),
        deviation(&runs),
    ];
    let mut out = vec![NO_PITCH, 0.0];
    if spoken.len() < LEAST_VOICED {
        out.extend([NO_PITCH; 5]);
        out.extend([0.0, 0.0]);
    } else {
        let steps = spoken.windows(2).map(|pair| pair[1] - pair[0]);
        let steps: Vec<f64> = steps.filter(|step| step.abs() < LARGEST_STEP).collect();
        let sizes: Vec<f64> = steps.iter().map(|step| step.abs()).collect();
        out = vec![mean(&spoken), deviation(&spoken)];
        out.extend([0.05, 0.25, 0.5, 0.75, 0.95].map(|share| quantile(&spoken, share)));
        out.extend([mean(&sizes), mean(&steps)]);
    }
    out.extend(rate);
    out
}

/// How the level of a window `[T]` varies below its `loud` level, 7 numbers.
fn loudness(level: &[f64], loud: f64, active: &[bool]) -> Vec<f64> {
    let heard: Vec<f64> = true_places(active).iter().map(|t| level[*t]).collect();
    let under: Vec<f64> = level.iter().map(|x| x - loud).collect();
    let steps = level.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let mut out = vec![deviation(&heard), heard.len() as f64 / level.len() as f64];
    out.extend([0.1, 0.25, 0.5, 0.75].map(|share| quantile(&under, share)));
    out.push(mean(&steps.collect::<Vec<_>>()));
    out
}

/// How much louder the high bands are than the low ones in frames `[T, 64]`: for the halves, then
/// for the outer quarters.
fn tilt(spoken: &Array2<f64>) -> [f64; 2] {
    let part = |from: usize, to: usize| {
        let part = spoken.slice(s![.., from..to]);
        part.sum() / part.len().max(1) as f64
    };
    [
        part(BANDS / 2, BANDS) - part(0, BANDS / 2),
        part(BANDS - BANDS / 4, BANDS) - part(0, BANDS / 4),
    ]
}

/// Means and deviations of the cepstra `[T, 20]` of a window and of their changes from frame to
/// frame, 80 numbers. The first cepstrum is relative to the `loud` level.
fn timbre(cepstra: ArrayView2<'_, f64>, loud: f64, active: &[bool]) -> Vec<f64> {
    let mut cepstra = cepstra.to_owned();
    cepstra
        .column_mut(0)
        .mapv_inplace(|x| x - loud * (BANDS as f64).sqrt());
    let change = &cepstra.slice(s![1.., ..]) - &cepstra.slice(s![..-1, ..]);
    let heard = cepstra.select(Axis(0), &true_places(active));
    let heard_change = change.select(Axis(0), &true_places(&active[1..]));
    [
        columns(&heard, mean),
        columns(&heard, deviation),
        columns(&change.mapv(f64::abs), mean),
        columns(&heard_change, deviation),
    ]
    .concat()
}

/// One number for each column.
fn columns(x: &Array2<f64>, of: fn(&[f64]) -> f64) -> Vec<f64> {
    let columns = x.columns().into_iter();
    columns.map(|column| of(&column.to_vec())).collect()
}

fn true_places(values: &[bool]) -> Vec<usize> {
    (0..values.len()).filter(|t| values[*t]).collect()
}

/// The mean; 0 without values.
fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn deviation(values: &[f64]) -> f64 {
    let middle = mean(values);
    let squares: Vec<f64> = values.iter().map(|x| (x - middle).powi(2)).collect();
    mean(&squares).sqrt()
}

/// The `q` quantile of `values`, with linear interpolation between order statistics as in numpy;
/// NaN without values.
fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let position = q * last as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (sorted[above] - sorted[below]) * (position - below as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::golden::{Golden, distance};

    fn encoder(golden: &Golden) -> EmotionEncoder {
        EmotionEncoder::load(&golden.weights(), &golden.metadata("config")).unwrap()
    }

    fn voice(samples: &[f32]) -> VoiceTrack {
        VoiceTrack::of(&Waveform {
            samples: samples.to_vec(),
        })
    }

    #[test]
    fn agrees_with_python() {
        let golden = Golden::open("emotion_encoder_debug");
        let (encoder, samples) = (encoder(&golden), golden.values("samples"));
        let numbers = voice(&samples).numbers().mapv(|x| x as f32);
        let apart = distance(&numbers, &golden.matrix("numbers"));
        assert!(apart < 1e-3, "{apart}");
        let track = encoder.at_frames(&voice(&samples), 75, 25.0);
        let apart = distance(&track, &golden.matrix("track"));
        assert!(apart < 1e-3, "{apart}");
        let short = encoder.at_frames(&voice(&samples[..3000]), 5, 25.0);
        assert!(distance(&short, &golden.matrix("short")) < 1e-4);
    }

    #[test]
    fn level_changes_nothing_and_neither_does_what_comes_later() {
        let golden = Golden::open("emotion_encoder_debug");
        let (encoder, samples) = (encoder(&golden), golden.values("samples"));
        let whole = encoder.at_frames(&voice(&samples), 75, 25.0);
        let quiet: Vec<f32> = samples.iter().map(|x| 0.125 * x).collect();
        assert!(distance(&whole, &encoder.at_frames(&voice(&quiet), 75, 25.0)) < 1e-3);
        let begun = encoder.at_frames(&voice(&samples[..40_000]), 60, 25.0);
        let known = whole.slice(s![..60, ..]).to_owned();
        assert!(distance(&begun, &known) < 1e-3);
    }

    #[test]
    fn a_voice_is_stretched_over_any_number_of_frames() {
        let golden = Golden::open("emotion_encoder_debug");
        let (encoder, samples) = (encoder(&golden), golden.values("samples"));
        let voice = voice(&samples);
        let whole = encoder.at_frames(&voice, 76, 25.0);
        let over = encoder.over(&voice, 300);
        assert!(distance(over.row(0), whole.row(0)) < 1e-6);
        assert_eq!(encoder.over(&voice, 1).dim(), (1, encoder.channels()));
        let silent = VoiceTrack::of(&Waveform {
            samples: vec![0.0; 32_000],
        });
        assert!(encoder.over(&silent, 10).iter().all(|x| x.is_finite()));
    }
}
