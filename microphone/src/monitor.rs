//! Plays sound with a delay, so that it matches a face that needs time to follow.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use cpal::{
    BufferSize, Device, FromSample, SampleFormat, SizedSample, Stream, StreamConfig,
    traits::{DeviceTrait, HostTrait, StreamTrait},
};

use crate::{
    SAMPLE_RATE_HZ,
    devices::{MicrophoneError, name_of, usual_host},
    intake::Converter,
};

/// The most seconds of sound that may wait beyond the delay, because the clocks of two devices
/// differ. When more waits, the oldest samples are dropped.
const SURPLUS_S: f64 = 0.2;

/// How many blocks a second the device is asked to play.
const BLOCKS_A_SECOND: u32 = 50;

/// Samples that wait to be played.
struct Queue {
    samples: VecDeque<f32>,
    /// How many samples must wait before playback starts.
    delay: usize,
    is_playing: bool,
}

/// Plays sound, with a delay, through the system's default loudspeakers.
pub struct Monitor {
    name: String,
    queue: Arc<Mutex<Queue>>,
    converter: Option<Converter>,
    mono: Vec<f32>,
    surplus: usize,
    // Dropping this ends playback.
    _stream: Stream,
}

impl Monitor {
    /// Opens the loudspeakers. Sound is heard `delay_s` seconds after it was pushed.
    ///
    /// # Errors
    /// If nothing can be played.
    pub fn open(delay_s: f64) -> Result<Monitor, MicrophoneError> {
        let host = usual_host();
        let problem = |name: &str, reason: String| MicrophoneError::Device {
            name: name.to_owned(),
            reason,
        };
        let device = host
            .default_output_device()
            .ok_or_else(|| problem("monitor", "this system lists nothing that plays".into()))?;
        let name = name_of(&device);
        let usual = device
            .default_output_config()
            .map_err(|e| problem(&name, e.to_string()))?;
        let (format, config) = (usual.sample_format(), usual.config());
        let rate_hz = config.sample_rate;
        let of_seconds = |seconds: f64| (seconds * f64::from(rate_hz)) as usize;
        let queue = Arc::new(Mutex::new(Queue {
            samples: VecDeque::new(),
            delay: of_seconds(delay_s),
            is_playing: false,
        }));
        let short = StreamConfig {
            buffer_size: BufferSize::Fixed((rate_hz / BLOCKS_A_SECOND).max(1)),
            ..config
        };
        // Some systems only play blocks of their own size: ask again with the default.
        let stream =
            play(&device, format, short, &queue).or_else(|_| play(&device, format, config, &queue));
        Ok(Monitor {
            converter: match rate_hz {
                SAMPLE_RATE_HZ => None,
                _ => Some(Converter::new(SAMPLE_RATE_HZ, rate_hz).map_err(|e| problem(&name, e))?),
            },
            mono: Vec::new(),
            surplus: of_seconds(SURPLUS_S),
            _stream: stream.map_err(|e| problem(&name, e.to_string()))?,
            name,
            queue,
        })
    }

    /// Name of the device.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Queues `samples`, mono, 16 kHz, to be played after those pushed before.
    pub fn push(&mut self, samples: &[f32]) {
        self.mono.extend_from_slice(samples);
        let samples = match &mut self.converter {
            None => std::mem::take(&mut self.mono),
            Some(converter) => converter.take(&mut self.mono),
        };
        locked(&self.queue).push(&samples, self.surplus);
    }

    /// Whether sound is playing. False while it waits for the delay, and once all has been played.
    pub fn is_playing(&self) -> bool {
        locked(&self.queue).is_playing
    }
}

impl Queue {
    fn push(&mut self, samples: &[f32], surplus: usize) {
        self.samples.extend(samples);
        self.is_playing |= self.samples.len() >= self.delay.max(1);
        let most = self.delay + surplus + samples.len();
        if self.samples.len() > most {
            let first = self.samples.len() - self.delay - samples.len();
            self.samples.drain(..first);
        }
    }

    /// The next sample. Silence until the delay is over, and when no samples are left.
    fn next(&mut self) -> f32 {
        if !self.is_playing {
            return 0.0;
        }
        self.samples.pop_front().unwrap_or_else(|| {
            self.is_playing = false;
            0.0
        })
    }
}

fn locked(queue: &Mutex<Queue>) -> MutexGuard<'_, Queue> {
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

fn play(
    device: &Device,
    format: SampleFormat,
    config: StreamConfig,
    queue: &Arc<Mutex<Queue>>,
) -> Result<Stream, cpal::Error> {
    let queue = queue.clone();
    let stream = match format {
        SampleFormat::F32 => play_as::<f32>(device, config, queue),
        SampleFormat::I32 => play_as::<i32>(device, config, queue),
        // For other formats the system converts from this one.
        _ => play_as::<i16>(device, config, queue),
    }?;
    stream.play().map(|()| stream)
}

fn play_as<T>(
    device: &Device,
    config: StreamConfig,
    queue: Arc<Mutex<Queue>>,
) -> Result<Stream, cpal::Error>
where
    T: SizedSample + FromSample<f32>,
{
    let channels = usize::from(config.channels).max(1);
    let give = move |data: &mut [T], _: &cpal::OutputCallbackInfo| {
        let mut queue = locked(&queue);
        for frame in data.chunks_mut(channels) {
            frame.fill(T::from_sample(queue.next()));
        }
    };
    device.build_output_stream(config, give, |_| {}, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn queue(delay: usize) -> Queue {
        Queue {
            samples: VecDeque::new(),
            delay,
            is_playing: false,
        }
    }

    #[test]
    fn sound_is_heard_after_the_delay_and_again_after_a_gap() {
        let mut queue = queue(3);
        let mut heard = Vec::new();
        for n in 1..=6 {
            queue.push(&[n as f32], 10);
            heard.push(queue.next());
        }
        assert_eq!(heard, [0.0, 0.0, 1.0, 2.0, 3.0, 4.0]);
        let rest: Vec<f32> = (0..3).map(|_| queue.next()).collect();
        assert_eq!(rest, [5.0, 6.0, 0.0]);
        queue.push(&[7.0], 10);
        assert_eq!(queue.next(), 0.0, "it waits for the delay again");
    }

    #[test]
    fn a_clock_that_runs_fast_adds_no_delay() {
        let mut queue = queue(10);
        for n in 0..1000 {
            queue.push(&[n as f32; 4], 20);
            (0..3).for_each(|_| {
                queue.next();
            });
            assert!(queue.samples.len() <= 34, "{}", queue.samples.len());
        }
    }
}
