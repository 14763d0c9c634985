//! Records a device, in a thread of its own, until the `Microphone` is dropped.
//!
//! If the device goes away, the thread looks for it until it is back. Meanwhile the reader gets
//! silence at the pace of the clock, so that a face driven by it comes to rest and later resumes by
//! itself.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
        mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use cpal::{
    BufferSize, Device, ErrorKind, FromSample, HostId, SampleFormat, SizedSample, Stream,
    StreamConfig,
    traits::{DeviceTrait, StreamTrait},
};

use crate::{
    SAMPLE_RATE_HZ,
    devices::{MicrophoneError, device_named, name_of, recording_of},
    intake::Intake,
};

/// The most blocks that can wait to be read; further ones are dropped.
const WAITING: usize = 512;
/// How many blocks a second the device is asked to deliver.
const BLOCKS_A_SECOND: u32 = 100;
/// After this long without sound the device counts as lost, and the reader gets silence.
const LOST: Duration = Duration::from_millis(200);
/// After this long without sound the device is opened again.
const DEAD: Duration = Duration::from_secs(2);
/// How long to wait before looking for a lost device again.
const SEARCH: Duration = Duration::from_millis(500);
/// How long the thread takes to notice that the microphone was dropped.
const TICK: Duration = Duration::from_millis(50);

/// The sound that has arrived since the last read.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Mono, 16 kHz, nominally in [−1, 1]. Empty if nothing has arrived yet.
    pub samples: Vec<f32>,
    /// Whether the samples are silence because the device is gone.
    pub is_lost: bool,
}

/// A device that is being recorded.
pub struct Microphone {
    name: String,
    blocks: Receiver<Vec<f32>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    /// The time up to which sound or silence has been read.
    read_until: Instant,
    is_lost: bool,
}

impl Microphone {
    /// Records the device called `name`, or the system's default device if there is no name.
    ///
    /// # Errors
    /// If the device cannot be recorded now. Once open, a microphone waits for a lost device to
    /// return.
    pub fn open(name: Option<&str>) -> Result<Microphone, MicrophoneError> {
        let (sender, blocks) = sync_channel(WAITING);
        let (answer, opened) = sync_channel(1);
        let is_over = Arc::new(AtomicBool::new(false));
        let worker = Worker {
            name: name.map(str::to_owned),
            blocks: sender,
            is_over: is_over.clone(),
        };
        let thread = thread::spawn(move || worker.run(&answer));
        let name = opened.recv().unwrap_or_else(|_| {
            Err(MicrophoneError::Device {
                name: name.unwrap_or("the system's choice").to_owned(),
                reason: "the system's sound interface stopped".into(),
            })
        })?;
        Ok(Microphone {
            name,
            blocks,
            is_over,
            thread: Some(thread),
            read_until: Instant::now(),
            is_lost: false,
        })
    }

    /// Name of the device.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// All the sound that has arrived. If there is none, waits for at most `patience`.
    pub fn read(&mut self, patience: Duration) -> Block {
        let mut samples = match self.blocks.recv_timeout(patience) {
            Ok(samples) => samples,
            Err(RecvTimeoutError::Timeout) => return self.silence(),
            Err(RecvTimeoutError::Disconnected) => {
                thread::sleep(patience);
                return self.silence();
            }
        };
        samples.extend(self.blocks.try_iter().flatten());
        self.read_until = Instant::now();
        self.is_lost = false;
        Block {
            samples,
            is_lost: false,
        }
    }

    /// An empty block, or silence for the time since the last read if the device is lost.
    fn silence(&mut self) -> Block {
        let now = Instant::now();
        let since = now.saturating_duration_since(self.read_until);
        self.is_lost |= since > LOST;
        let mut samples = Vec::new();
        if self.is_lost {
            let count = since.as_secs_f64() * f64::from(SAMPLE_RATE_HZ);
            samples.resize(count as usize, 0.0);
            self.read_until = now;
        }
        Block {
            samples,
            is_lost: self.is_lost,
        }
    }
}

impl Drop for Microphone {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The part of a microphone that runs in its thread.
struct Worker {
    name: Option<String>,
    blocks: SyncSender<Vec<f32>>,
    is_over: Arc<AtomicBool>,
}

impl Worker {
    /// Records until the microphone is dropped. Sends one `answer`: whether recording could start.
    fn run(self, answer: &SyncSender<Result<String, MicrophoneError>>) {
        // The sound system of the device. A lost device is looked for only there.
        let mut host = None;
        while !self.is_over() {
            match Recording::begin(self.name.as_deref(), host, &self.blocks) {
                Ok(recording) => {
                    if host.is_none() {
                        let _ = answer.send(Ok(recording.name.clone()));
                    }
                    host = Some(recording.host);
                    self.watch(&recording);
                }
                Err(error) if host.is_none() => {
                    let _ = answer.send(Err(error));
                    return;
                }
                Err(_) => {}
            }
            let again = Instant::now() + SEARCH;
            while Instant::now() < again && !self.is_over() {
                thread::sleep(TICK);
            }
        }
    }

    /// Returns when the recording has failed or stalled, or when the microphone is dropped.
    fn watch(&self, recording: &Recording) {
        let (mut count, mut since) = (0, Instant::now());
        while !self.is_over() {
            match recording.failure.recv_timeout(TICK) {
                Err(RecvTimeoutError::Timeout) => {}
                Ok(()) | Err(RecvTimeoutError::Disconnected) => return,
            }
            let now = recording.count.load(Ordering::Relaxed);
            if now != count {
                (count, since) = (now, Instant::now());
            } else if since.elapsed() > DEAD {
                return;
            }
        }
    }

    fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }
}

/// An open device.
struct Recording {
    name: String,
    host: HostId,
    /// How many blocks have arrived.
    count: Arc<AtomicU64>,
    failure: Receiver<()>,
    // Dropping this ends the recording.
    _stream: Stream,
}

impl Recording {
    fn begin(
        name: Option<&str>,
        host: Option<HostId>,
        blocks: &SyncSender<Vec<f32>>,
    ) -> Result<Recording, MicrophoneError> {
        let device = device_named(name, host)?;
        let name = name_of(&device);
        let problem = |reason: String| MicrophoneError::Device {
            name: name.clone(),
            reason,
        };
        let recording = recording_of(&device).map_err(|e| problem(e.to_string()))?;
        let (format, mut config) = (recording.sample_format(), recording.config());
        let count = Arc::new(AtomicU64::new(0));
        let (send_failure, failure) = sync_channel(1);
        // Some systems only record in blocks of their own size: ask again with the default.
        let short = BufferSize::Fixed((config.sample_rate / BLOCKS_A_SECOND).max(1));
        let mut last = String::new();
        for size in [short, BufferSize::Default] {
            config.buffer_size = size;
            let intake =
                Intake::new(config.channels.into(), config.sample_rate).map_err(problem)?;
            let to = Destination {
                intake,
                blocks: blocks.clone(),
                count: count.clone(),
                failure: send_failure.clone(),
            };
            let opened = match format {
                SampleFormat::F32 => to.record::<f32>(&device, config),
                SampleFormat::I16 => to.record::<i16>(&device, config),
                SampleFormat::I32 => to.record::<i32>(&device, config),
                SampleFormat::U8 => to.record::<u8>(&device, config),
                SampleFormat::U16 => to.record::<u16>(&device, config),
                other => return Err(problem(format!("it records {other}, which cannot be read"))),
            };
            match opened.and_then(|stream| stream.play().map(|()| stream)) {
                Ok(stream) => {
                    return Ok(Recording {
                        name,
                        host: device
                            .id()
                            .map_or_else(|_| cpal::default_host().id(), |id| id.host()),
                        count,
                        failure,
                        _stream: stream,
                    });
                }
                Err(error) => last = error.to_string(),
            }
        }
        Err(problem(last))
    }
}

/// Where the sound of a device goes.
struct Destination {
    intake: Intake,
    blocks: SyncSender<Vec<f32>>,
    count: Arc<AtomicU64>,
    failure: SyncSender<()>,
}

impl Destination {
    fn record<T>(mut self, device: &Device, config: StreamConfig) -> Result<Stream, cpal::Error>
    where
        T: SizedSample,
        f32: FromSample<T>,
    {
        let failure = self.failure.clone();
        let take = move |data: &[T], _: &cpal::InputCallbackInfo| {
            self.count.fetch_add(1, Ordering::Relaxed);
            let samples = self.intake.take(data);
            if !samples.is_empty() {
                // Never block a thread of the sound system: drop the block if the queue is full.
                let _ = self.blocks.try_send(samples);
            }
        };
        let fail = move |error: cpal::Error| {
            let goes_on = [
                ErrorKind::Xrun,
                ErrorKind::DeviceChanged,
                ErrorKind::RealtimeDenied,
            ];
            if !goes_on.contains(&error.kind()) {
                let _ = failure.try_send(());
            }
        };
        device.build_input_stream(config, take, fail, None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A microphone that gets its sound from the test.
    fn by_hand() -> (Microphone, SyncSender<Vec<f32>>) {
        let (sender, blocks) = sync_channel(WAITING);
        let microphone = Microphone {
            name: "by hand".into(),
            blocks,
            is_over: Arc::new(AtomicBool::new(false)),
            thread: None,
            read_until: Instant::now(),
            is_lost: false,
        };
        (microphone, sender)
    }

    #[test]
    fn everything_that_has_come_is_read_at_once() {
        let (mut microphone, sender) = by_hand();
        sender.send(vec![1.0]).unwrap();
        sender.send(vec![2.0, 3.0]).unwrap();
        let block = microphone.read(Duration::ZERO);
        assert_eq!(block.samples, [1.0, 2.0, 3.0]);
        assert!(!block.is_lost);
        let block = microphone.read(Duration::ZERO);
        assert!(block.samples.is_empty() && !block.is_lost, "nothing yet");
    }

    #[test]
    fn a_device_that_is_gone_is_silence_by_the_clock_until_it_is_back() {
        let (mut microphone, sender) = by_hand();
        let began = Instant::now();
        let mut count = 0;
        while began.elapsed() < Duration::from_millis(500) {
            let block = microphone.read(Duration::from_millis(10));
            assert!(block.samples.iter().all(|x| *x == 0.0));
            count += block.samples.len();
        }
        let expected = began.elapsed().as_secs_f64() * 16_000.0;
        assert!((count as f64 - expected).abs() < 0.1 * expected, "{count}");
        assert!(microphone.read(Duration::from_millis(10)).is_lost);
        sender.send(vec![0.5]).unwrap();
        let block = microphone.read(Duration::from_millis(10));
        assert_eq!(
            (block.samples.as_slice(), block.is_lost),
            (&[0.5][..], false)
        );
        drop(sender);
        std::thread::sleep(2 * LOST);
        assert!(
            microphone.read(Duration::ZERO).is_lost,
            "its thread is gone"
        );
    }
}
