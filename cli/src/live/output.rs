//! Lines on standard output, written by a thread of their own: a reader who does not read holds neither
//! the other targets nor the end of the command.

use std::{
    sync::mpsc::{SyncSender, TrySendError, sync_channel},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use anyface::{Error, Result};

use crate::{console::Console, signals};

/// Lines that may wait for the reader: ten seconds of the stream.
const WAITING: usize = 250;
/// The time between two looks at a reader who holds the only target.
const PATIENCE: Duration = Duration::from_millis(5);
/// How long the end of the command waits for a reader beside other targets.
const LAST_WAIT: Duration = Duration::from_secs(1);

/// Standard output as a target.
pub struct Output {
    /// `None` once the reader has left.
    lines: Option<SyncSender<String>>,
    writer: Option<JoinHandle<Result<()>>>,
    /// Whether lines are lost, and not waited with, while the reader does not read.
    may_lose: bool,
    lost: usize,
}

impl Output {
    /// `is_alone`: whether no other target would have to wait for the reader.
    pub fn new(is_alone: bool) -> Output {
        let (lines, waiting) = sync_channel::<String>(WAITING);
        let writer = thread::spawn(move || {
            for line in waiting {
                if !Console::line(&line)? {
                    break;
                }
            }
            Ok(())
        });
        Output {
            lines: Some(lines),
            writer: Some(writer),
            may_lose: !is_alone,
            lost: 0,
        }
    }

    /// Whether the reader has left.
    pub fn is_gone(&self) -> bool {
        self.lines.is_none()
    }

    /// Writes a line, or loses it.
    ///
    /// # Errors
    /// `Io` if standard output cannot be written to; `Cancelled` while the only target waits.
    pub fn send(&mut self, line: &str, console: &Console) -> Result<()> {
        let mut line = line.to_owned();
        while let Some(lines) = &self.lines {
            match lines.try_send(line) {
                Ok(()) => {
                    if self.lost > 0 {
                        let lost = std::mem::take(&mut self.lost);
                        console.note(&format!("standard output: {lost} lines were lost"));
                    }
                    return Ok(());
                }
                Err(TrySendError::Disconnected(_)) => return self.close(),
                Err(TrySendError::Full(_)) if self.may_lose => {
                    if self.lost == 0 {
                        console.note(
                            "standard output: nobody reads it, so its lines are lost; the other targets go on",
                        );
                    }
                    self.lost += 1;
                    return Ok(());
                }
                Err(TrySendError::Full(_)) if signals::are_to_end() => {
                    return Err(Error::Cancelled);
                }
                Err(TrySendError::Full(waiting)) => line = waiting,
            }
            thread::sleep(PATIENCE);
        }
        Ok(())
    }

    /// Waits until the reader has all lines; beside other targets only for a moment.
    ///
    /// # Errors
    /// Those of [`Output::send`].
    pub fn finish(&mut self) -> Result<()> {
        self.lines = None;
        let begin = Instant::now();
        while self
            .writer
            .as_ref()
            .is_some_and(|writer| !writer.is_finished())
        {
            if signals::are_to_end() {
                return Err(Error::Cancelled);
            }
            if self.may_lose && begin.elapsed() > LAST_WAIT {
                return Ok(());
            }
            thread::sleep(PATIENCE);
        }
        self.close()
    }

    /// The end of the writer, who has nothing to do any more.
    fn close(&mut self) -> Result<()> {
        self.lines = None;
        match self.writer.take().map(JoinHandle::join) {
            Some(Ok(ended)) => ended,
            _ => Ok(()),
        }
    }
}
