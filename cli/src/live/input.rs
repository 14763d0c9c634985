//! The source of the sound: a file played at the speed of a clock, raw samples on standard input, or a
//! microphone.

use std::{
    io::{self, IsTerminal, Read},
    sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel},
    thread,
    time::{Duration, Instant},
};

use anyface::{
    Error, Result,
    audio::{RateConverter, SAMPLE_RATE_HZ},
};

use super::sound_library::Microphone;

/// Samples that a file returns at a time: 20 ms.
const BLOCK: usize = 320;
/// The most bytes that are read from standard input at a time.
const BYTES: usize = 2 * BLOCK;
/// Blocks that may queue before the writer of standard input has to wait.
const WAITING: usize = 16;
/// First bytes of sound files. These are refused where raw samples are expected.
const OF_FILES: [&[u8]; 4] = [b"RIFF", b"OggS", b"fLaC", b"ID3"];

/// What [`Input::next`] returns.
#[derive(Debug)]
pub enum Arrival {
    /// Samples, mono, 16 kHz.
    Samples(Vec<f32>),
    /// Nothing yet.
    Nothing,
    /// The device was lost or is back, as a sentence for the user.
    Change(String),
    /// The sound is over.
    End,
}

/// A sound in progress.
pub enum Input {
    /// The samples of a file, the index of the next one to return, and the time at which playback began.
    /// The time is `None` if the file plays without a clock.
    File(Vec<f32>, usize, Option<Instant>),
    /// Samples that a thread reads from standard input.
    Pipe(Receiver<Result<Vec<f32>>>),
    /// A microphone, and whether it was lost.
    Microphone(Microphone, bool),
}

impl Input {
    /// Plays `samples`, mono, 16 kHz, at the speed of a clock, or without waiting if `is_fast`.
    pub fn of_samples(samples: Vec<f32>, is_fast: bool) -> Input {
        Input::File(samples, 0, (!is_fast).then(Instant::now))
    }

    /// Standard input: 16-bit little-endian samples, mono, at `rate_hz`.
    ///
    /// # Errors
    /// `InvalidInput` if standard input is a terminal, `Audio` for a rate that cannot be converted.
    pub fn of_standard_input(rate_hz: u32) -> Result<Input> {
        if io::stdin().is_terminal() {
            return Err(Error::InvalidInput(
                "--input -: expected sound on standard input, got a terminal; pipe it in, as in \
                 parec --rate=16000 --channels=1 --format=s16le | anyface live --input -"
                    .into(),
            ));
        }
        let converter = RateConverter::new(rate_hz)?;
        let (sender, receiver) = sync_channel(WAITING);
        thread::spawn(move || {
            if let Err(error) = read(io::stdin().lock(), converter, &sender) {
                // Nobody waits for it if the receiver is gone.
                let _ = sender.send(Err(error));
            }
        });
        Ok(Input::Pipe(receiver))
    }

    /// A microphone. It never reports an end.
    pub fn of_microphone(microphone: Microphone) -> Input {
        Input::Microphone(microphone, false)
    }

    /// Waits up to `patience` for sound and returns what arrived.
    ///
    /// # Errors
    /// `Io` if standard input cannot be read, `Audio` if it holds a sound file instead of raw samples.
    pub fn next(&mut self, patience: Duration) -> Result<Arrival> {
        match self {
            Input::File(samples, next, began) => {
                let end = samples.len().min(*next + BLOCK);
                if *next == end {
                    return Ok(Arrival::End);
                }
                if let Some(began) = began {
                    let due = Duration::from_secs_f64(end as f64 / f64::from(SAMPLE_RATE_HZ));
                    let wait = due.saturating_sub(began.elapsed());
                    thread::sleep(wait.min(patience));
                    if wait > patience {
                        return Ok(Arrival::Nothing);
                    }
                }
                let block = samples[*next..end].to_vec();
                *next = end;
                Ok(Arrival::Samples(block))
            }
            Input::Pipe(receiver) => match receiver.recv_timeout(patience) {
                Ok(samples) => samples.map(Arrival::Samples),
                Err(RecvTimeoutError::Timeout) => Ok(Arrival::Nothing),
                Err(RecvTimeoutError::Disconnected) => Ok(Arrival::End),
            },
            Input::Microphone(microphone, was_lost) => {
                let block = microphone.read(patience);
                if block.is_lost != *was_lost && !block.samples.is_empty() {
                    *was_lost = block.is_lost;
                    let name = microphone.name();
                    return Ok(Arrival::Change(if block.is_lost {
                        format!("{name} is gone; the face rests until it is back")
                    } else {
                        format!("{name} is back")
                    }));
                }
                Ok(if block.samples.is_empty() {
                    Arrival::Nothing
                } else {
                    Arrival::Samples(block.samples)
                })
            }
        }
    }
}

/// Sends the samples of `pipe` until it ends or the receiver is dropped.
///
/// # Errors
/// `Io` if the pipe cannot be read, `Audio` if it holds a sound file instead of raw samples.
fn read(
    mut pipe: impl Read,
    mut converter: RateConverter,
    sender: &SyncSender<Result<Vec<f32>>>,
) -> Result<()> {
    let (mut bytes, mut left_over, mut is_first) = ([0; BYTES], 0, true);
    loop {
        let count = match pipe.read(&mut bytes[left_over..]) {
            Ok(0) => break,
            Ok(count) => left_over + count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(Error::io("standard input")(error)),
        };
        if is_first
            && OF_FILES
                .iter()
                .any(|start| bytes[..count].starts_with(start))
        {
            return Err(Error::Audio(
                "standard input: expected raw 16-bit samples, mono, 16 kHz or --rate, got a sound file; \
                 name it with --input FILE"
                    .into(),
            ));
        }
        is_first = false;
        // Keep half a sample until its other half arrives.
        let whole = count - count % 2;
        let pairs = bytes[..whole].chunks_exact(2);
        let samples =
            pairs.map(|pair| f32::from(i16::from_le_bytes([pair[0], pair[1]])) / 32_768.0);
        let samples = converter.push(&samples.collect::<Vec<f32>>())?;
        bytes.copy_within(whole..count, 0);
        left_over = count - whole;
        if !samples.is_empty() && sender.send(Ok(samples)).is_err() {
            return Ok(());
        }
    }
    let rest = converter.finish()?;
    if !rest.is_empty() {
        let _ = sender.send(Ok(rest));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reader that returns one of these pieces at each call.
    struct Pieces(Vec<Vec<u8>>);

    impl Read for Pieces {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            if self.0.is_empty() {
                return Ok(0);
            }
            let piece = self.0.remove(0);
            bytes[..piece.len()].copy_from_slice(&piece);
            Ok(piece.len())
        }
    }

    fn heard(pieces: Vec<Vec<u8>>) -> Vec<Result<Vec<f32>>> {
        let (sender, receiver) = sync_channel(WAITING);
        let converter = RateConverter::new(SAMPLE_RATE_HZ).unwrap();
        let result = read(Pieces(pieces), converter, &sender);
        drop(sender);
        let error = result.err().map(Err);
        receiver.iter().chain(error).collect()
    }

    #[test]
    fn samples_are_whole_however_the_bytes_come() {
        let all = heard(vec![vec![0], vec![0x40, 0x00], vec![0xC0, 0xFF, 0xFF]]);
        let samples: Vec<f32> = all.into_iter().flat_map(Result::unwrap).collect();
        assert_eq!(samples, [0.5, -0.5, -1.0 / 32_768.0]);
    }

    #[test]
    fn a_sound_file_is_refused() {
        let all = heard(vec![b"RIFF....WAVE".to_vec()]);
        let error = all[0].as_ref().unwrap_err().to_string();
        assert!(error.contains("name it with --input FILE"), "{error}");
    }

    #[test]
    fn a_file_is_handed_over_in_blocks_and_by_a_clock() {
        let began = Instant::now();
        let mut input = Input::of_samples(vec![0.0; 2 * BLOCK + 1], false);
        let (mut sizes, mut was_early) = (Vec::new(), false);
        loop {
            match input.next(Duration::from_millis(5)).unwrap() {
                Arrival::Samples(samples) => sizes.push(samples.len()),
                Arrival::Nothing => was_early = true,
                Arrival::Change(text) => panic!("{text}"),
                Arrival::End => break,
            }
        }
        assert_eq!(sizes, [BLOCK, BLOCK, 1]);
        assert!(was_early && began.elapsed() >= Duration::from_millis(40));
    }
}
