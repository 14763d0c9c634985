//! `anyface live`: sends the face to other programs while the sound arrives.

mod address;
mod frame;
mod input;
mod live_link;
mod meter;
mod osc;
mod output;
mod pace;
mod sound_devices;
mod sound_library;
mod targets;
mod udp;
mod websocket;

use std::{
    collections::VecDeque,
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};

use anyface::{
    Error, Result,
    audio::SAMPLE_RATE_HZ,
    conditions::{ControlStage, EMOTIONS, Emotion, EmotionCurve},
    motion::{PERFORMANCE_CONTROLS, PerformanceControls, Performer, WeightStream, check_fps},
};
use clap::Args;

use crate::{
    arguments::{SharedArgs, SoundArgs},
    console::Console,
    controls::{EmotionArgs, LiveControls},
    paths::InputPath,
    signals,
    stages::{new_report, read_sound},
};
use frame::{Feelings, Frame};
use input::{Arrival, Input};
use meter::Meter;
use pace::{Pace, Paced, Weights};
use sound_devices::{DeviceArgs, print_devices};
use sound_library::Monitor;
use targets::{TargetArgs, Targets};

/// Rates at which programs pipe sound.
const RATES: [&str; 11] = [
    "8000", "11025", "12000", "16000", "22050", "24000", "32000", "44100", "48000", "88200",
    "96000",
];
/// The longest wait before sound and signals are checked again.
const PATIENCE: Duration = Duration::from_millis(20);

/// Send a speaking face to other programs: avatars (VMC), Unreal Engine (Live Link), OSC, WebSocket or lines of JSON
/// (--json). The sound comes from a microphone, or from a file at playback speed
#[derive(Args)]
pub struct Live {
    /// Sound file instead of a microphone: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF. - reads raw samples from
    /// standard input: 16 bit little-endian, mono, 16 kHz or --rate, as ffmpeg … -f s16le -ar 16000 -ac 1 - writes them
    #[arg(long, value_name = "FILE", allow_hyphen_values = true)]
    input: Option<InputPath>,
    /// Rate of the raw samples on standard input
    #[arg(
        long,
        value_name = "HZ",
        default_value = "16000",
        value_parser = RATES,
        requires = "input"
    )]
    rate: String,
    /// Loudness added to the sound, dB, for microphones that are too quiet or too loud
    #[arg(
        long,
        value_name = "DB",
        default_value_t = 0.0,
        value_parser = decibels,
        allow_negative_numbers = true
    )]
    gain: f32,
    /// Play a file as fast as the computer can, not at playback speed
    #[arg(long, requires = "input")]
    fast: bool,
    /// Let any sound move the face, including singing, music and noise. Otherwise the face rests while
    /// nobody speaks
    #[arg(long)]
    any_sound: bool,
    /// The most seconds of later sound that a frame waits for: 0.19, 0.07 or 0 with freetalk. A shorter
    /// wait shows the face sooner, but less accurately
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    look_ahead: Option<f64>,
    /// Let the face move as this performer does, learned with freetalk (`anyface performer learn`)
    #[arg(long, value_name = "P.performer")]
    performer: Option<InputPath>,
    /// How much of the performer the face shows: 1 is as that person speaks, 0 as without
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    performer_strength: f64,
    #[command(flatten)]
    devices: DeviceArgs,
    /// Frames per second. Any rate other than the stream's is interpolated, which delays the face by one
    /// frame of the stream [default: the stream's 25]
    #[arg(long)]
    fps: Option<f64>,
    #[command(flatten)]
    targets: TargetArgs,
    #[command(flatten)]
    emotion: EmotionArgs,
    #[command(flatten)]
    controls: LiveControls,
    #[command(flatten)]
    sound: SoundArgs,
}

fn decibels(text: &str) -> std::result::Result<f32, String> {
    let gain = text.parse().ok().filter(|gain: &f32| gain.abs() <= 60.0);
    gain.ok_or_else(|| format!("expected -60 to 60 dB, got {text:?}"))
}

impl Live {
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<()> {
        if self.devices.are_to_be_listed() {
            return print_devices(console);
        }
        // Cheap checks come before slow work.
        self.targets.check(shared.json)?;
        self.fps.map_or(Ok(()), check_fps)?;
        let emotion = self.emotion.curve(false, shared.weights())?;
        if matches!(emotion, EmotionCurve::Arousal) {
            return Err(Error::InvalidInput(
                "live: expected an emotion that is named, as in happy:0.5, or auto, got auto-arousal, which needs the \
                 whole sound"
                    .into(),
            ));
        }
        let rate_hz: u32 = self.rate.parse().unwrap_or(SAMPLE_RATE_HZ);
        if rate_hz != SAMPLE_RATE_HZ && !self.input.as_ref().is_some_and(is_pipe) {
            return Err(Error::InvalidInput(
                "--rate: expected raw samples on standard input (--input -), got a sound that states its own rate; leave \
                 --rate away"
                    .into(),
            ));
        }
        let controls = self.controls.controls()?;
        controls.check(PERFORMANCE_CONTROLS, ControlStage::Motion)?;
        let samples = match &self.input {
            Some(input) if !is_pipe(input) => Some(self.read(input, console)?),
            _ => None,
        };
        let performer = self.performer()?;
        let mut stream = shared.engine()?.weight_stream()?;
        if matches!(emotion, EmotionCurve::Auto) {
            stream.hear_emotion();
        }
        if let Some(seconds) = self.look_ahead {
            stream.look_ahead(seconds)?;
        }
        stream.set_performer(performer, self.performer_strength as f32)?;
        if self.any_sound {
            stream.hear_all();
        }
        stream.control(PerformanceControls::from(&controls));
        let fps = self.fps.unwrap_or(stream.fps());
        let targets = self.targets.open(fps, shared.json)?;
        targets.introduce(console);
        let input = match (samples, &self.input) {
            (Some(samples), _) => Input::of_samples(samples, self.fast),
            (None, Some(_)) => Input::of_standard_input(rate_hz)?,
            (None, None) => Input::of_microphone(self.devices.open(console)?),
        };
        let lag_s = if fps == stream.fps() {
            stream.latency_s()
        } else {
            stream.latency_s() + 1.0 / stream.fps()
        };
        let monitor = self.devices.monitor(lag_s, console)?;
        let mut show = Show {
            pace: Pace::new(stream.fps(), fps),
            stream,
            next: 0,
            emotion,
            shown_emotion: Emotion::default(),
            waiting: VecDeque::new(),
            is_fast: self.fast,
            gain: 10f32.powf(self.gain / 20.0),
            targets,
            monitor,
            meter: Meter::new(shared.json),
            console,
        };
        let result = show.run(input).and_then(|()| show.targets.finish());
        show.meter.clear();
        result
    }

    fn performer(&self) -> Result<Option<Arc<Performer>>> {
        if !(0.0..=2.0).contains(&self.performer_strength) {
            return Err(Error::InvalidInput(format!(
                "--performer-strength: expected 0 to 2, got {}",
                self.performer_strength
            )));
        }
        let read = |path: &InputPath| Performer::read(path.as_ref()).map(Arc::new);
        self.performer.as_ref().map(read).transpose()
    }

    /// Reads the samples of the file `input`.
    fn read(&self, input: &InputPath, console: &Console) -> Result<Vec<f32>> {
        let progress = &|p| console.progress(p);
        let mut report = new_report();
        let sound = read_sound(&mut report, input, &self.sound, progress)?;
        console.warn(&report.warnings);
        Ok(sound.whole(progress)?.samples)
    }
}

fn is_pipe(input: &InputPath) -> bool {
    AsRef::<Path>::as_ref(input) == Path::new("-")
}

/// A live performance in progress.
struct Show<'a> {
    stream: WeightStream,
    /// Index of the stream's next frame.
    next: usize,
    emotion: EmotionCurve,
    /// Emotion of the newest frame.
    shown_emotion: Emotion,
    pace: Pace,
    /// Frames that are not due yet.
    waiting: VecDeque<Paced>,
    is_fast: bool,
    /// Factor of the samples.
    gain: f32,
    targets: Targets,
    /// Plays the sound with a delay that matches the face, or with that of `--delay`.
    monitor: Option<Monitor>,
    meter: Meter,
    console: &'a Console,
}

impl Show<'_> {
    fn run(&mut self, mut input: Input) -> Result<()> {
        let mut has_ended = false;
        loop {
            self.send_due()?;
            let is_heard = self.monitor.as_ref().is_none_or(|m| !m.is_playing());
            if self.targets.are_gone() || (has_ended && self.waiting.is_empty() && is_heard) {
                return Ok(());
            }
            let next = self.waiting.front().map(|paced| paced.due);
            let until_due = next.map(|due| due.saturating_duration_since(Instant::now()));
            let patience = until_due.map_or(PATIENCE, |wait| wait.min(PATIENCE));
            if has_ended {
                std::thread::sleep(patience);
                continue;
            }
            match input.next(patience)? {
                Arrival::Samples(mut samples) => {
                    samples.iter_mut().for_each(|sample| *sample *= self.gain);
                    self.meter.hear(&samples);
                    if let Some(monitor) = &mut self.monitor {
                        monitor.push(&samples);
                    }
                    self.stream.push(&samples)?;
                }
                Arrival::Nothing => continue,
                Arrival::Change(text) => {
                    self.meter.clear();
                    self.console.note(&text);
                    continue;
                }
                Arrival::End => {
                    self.stream.finish()?;
                    has_ended = true;
                }
            }
            self.pull()?;
        }
    }

    /// Pulls all frames that the stream has ready.
    fn pull(&mut self) -> Result<()> {
        loop {
            if !matches!(self.emotion, EmotionCurve::Auto) {
                let emotion = self.emotion.at(self.next as f64 / self.stream.fps());
                self.stream.set_emotion(&emotion)?;
            }
            let Some(frame) = self.stream.pull() else {
                return Ok(());
            };
            (self.next, self.shown_emotion) = (frame.index + 1, frame.emotion);
            let weights = Weights {
                shapes: frame.shapes,
                visemes: frame.visemes,
                head: frame.head,
            };
            let paced = self.pace.take(frame.index, weights, Instant::now());
            self.waiting.extend(paced);
            self.send_due()?;
        }
    }

    /// Sends the frames that are due.
    fn send_due(&mut self) -> Result<()> {
        let now = Instant::now();
        while let Some(paced) = self.waiting.front().copied() {
            if !self.is_fast && paced.due > now {
                break;
            }
            self.waiting.pop_front();
            if signals::are_to_end() {
                return Err(Error::Cancelled);
            }
            let frame = Frame {
                number: paced.number,
                time_s: paced.time_s,
                shapes: paced.weights.shapes,
                visemes: paced.weights.visemes,
                head: paced.weights.head,
                feelings: feelings(&self.shown_emotion),
            };
            self.targets.send(&frame, self.console)?;
            self.meter.show(&frame);
        }
        if signals::are_to_end() {
            Err(Error::Cancelled)
        } else {
            Ok(())
        }
    }
}

/// Converts an emotion into the five feelings of VRM, each 0 to 1.
fn feelings(emotion: &Emotion) -> Feelings {
    let of = |names: &[&str]| {
        let all = EMOTIONS.iter().zip(emotion.mixture);
        let share: f32 = all
            .filter(|(name, _)| names.contains(name))
            .map(|(_, share)| share)
            .sum();
        (share * emotion.intensity).min(1.0)
    };
    Feelings {
        happy: of(&["happy", "pleased"]),
        angry: of(&["angry"]),
        sad: of(&["sad", "upset"]),
        relaxed: of(&["calm"]),
        surprised: of(&["surprised"]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn emotions_are_the_feelings_of_vrm_as_strong_as_they_are() {
        let feelings_of = |text: &str| feelings(&Emotion::parse(text).unwrap());
        assert_eq!(feelings_of("neutral:1"), Feelings::default());
        let mixed = feelings_of("happy:0.4,surprised:0.2");
        assert!((mixed.happy - 0.4).abs() < 1e-6 && (mixed.surprised - 0.2).abs() < 1e-6);
        assert_eq!(feelings_of("happy:1.5").happy, 1.0);
    }
}
