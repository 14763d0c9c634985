//! Reads all input files, within a limit of size and so that a cancelled job does not wait for
//! them.
//!
//! A regular file may be as large as the limit of its kind. A pipe or a device may never end and
//! may never begin. So a separate thread reads it, and for most kinds its limit is lower.

use std::{
    fs::File,
    io::{self, Cursor, Read, Seek, SeekFrom},
    path::Path,
    sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel},
    time::Duration,
};

use super::atomic::{is_cancelled, write_atomically};
use crate::{Error, Result};

/// How often a job that waits for a pipe checks whether it is cancelled.
const PATIENCE: Duration = Duration::from_millis(50);
/// Bytes taken from a pipe at once.
const CHUNK: usize = 1 << 16;
/// Chunks that a thread reads ahead.
const CHUNKS_AHEAD: usize = 16;

/// What a file holds. This decides how large it may be, and which error refuses it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InputKind {
    /// A mesh: 4 GiB are some thirty million vertices as text.
    Mesh,
    /// A sound. From a pipe it may be an hour and a half of stereo WAV at 48 kHz.
    Sound,
    /// Arrays or vertices over time.
    Arrays,
    /// Text such as landmarks, events, timed words or a config.
    Text,
    /// A list with a number for each vertex.
    Numbers,
    /// Weights of a model.
    Weights,
}

impl InputKind {
    /// Most bytes of a regular file.
    fn largest_file(self) -> u64 {
        match self {
            InputKind::Mesh => 4 << 30,
            InputKind::Sound | InputKind::Arrays => 64 << 30,
            InputKind::Text => 16 << 20,
            InputKind::Numbers => 1 << 28,
            InputKind::Weights => 8 << 30,
        }
    }

    /// Most bytes of a pipe or a device, which may have no end.
    fn largest_pipe(self) -> u64 {
        match self {
            InputKind::Sound => 1 << 30,
            InputKind::Text => 16 << 20,
            _ => 1 << 28,
        }
    }

    fn refuse(self, message: String) -> Error {
        match self {
            InputKind::Mesh => Error::Mesh(message),
            InputKind::Sound => Error::Audio(message),
            InputKind::Weights => Error::Weights(message),
            InputKind::Arrays | InputKind::Text | InputKind::Numbers => {
                Error::InvalidInput(message)
            }
        }
    }

    fn too_large(self, path: &Path, most: u64) -> Error {
        let (path, megabytes) = (path.display(), most >> 20);
        self.refuse(format!(
            "{path}: expected at most {megabytes} MiB, got more; divide the file, or check that it is the right one"
        ))
    }
}

/// A file that is open for reading and seeking.
pub(crate) enum Input {
    /// A regular file.
    File(File),
    /// All the bytes of a pipe or a device.
    Bytes(Cursor<Vec<u8>>),
}

impl Input {
    /// Opens a file. All the bytes of a pipe are read here.
    ///
    /// # Errors
    /// `Io` if it cannot be read; `Cancelled` if the job is cancelled while it waits for a pipe;
    /// the kind's error if the file is larger than its kind allows.
    pub(crate) fn open(path: &Path, kind: InputKind) -> Result<Input> {
        let known = std::fs::metadata(path).map_err(Error::io(path))?;
        if known.is_dir() {
            return Err(Error::io(path)(io::ErrorKind::IsADirectory.into()));
        }
        if !known.is_file() {
            let most = kind.largest_pipe();
            let bytes = wait_for_bytes(path, most, is_cancelled)?;
            return if bytes.len() as u64 <= most {
                Ok(Input::Bytes(Cursor::new(bytes)))
            } else {
                Err(kind.too_large(path, most))
            };
        }
        let most = kind.largest_file();
        if known.len() <= most {
            Ok(Input::File(File::open(path).map_err(Error::io(path))?))
        } else {
            Err(kind.too_large(path, most))
        }
    }

    /// Number of bytes.
    ///
    /// # Errors
    /// If the system does not report it.
    pub(crate) fn length(&self) -> io::Result<u64> {
        match self {
            Input::File(file) => Ok(file.metadata()?.len()),
            Input::Bytes(bytes) => Ok(bytes.get_ref().len() as u64),
        }
    }
}

impl Read for Input {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Input::File(file) => file.read(into),
            Input::Bytes(bytes) => bytes.read(into),
        }
    }
}

impl Seek for Input {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Input::File(file) => file.seek(to),
            Input::Bytes(bytes) => bytes.seek(to),
        }
    }
}

/// All bytes of a file.
///
/// # Errors
/// `Io` if it cannot be read; `Cancelled` if the job of [`super::all_or_none`] is cancelled while
/// it waits for a pipe; the kind's error if the file is larger than its kind allows.
pub fn read_file(path: &Path, kind: InputKind) -> Result<Vec<u8>> {
    let file = match Input::open(path, kind)? {
        Input::Bytes(bytes) => return Ok(bytes.into_inner()),
        Input::File(file) => file,
    };
    // The file may have grown since it was opened, and those that a system makes up have no length.
    let most = kind.largest_file();
    let mut bytes = Vec::new();
    let expected = file.metadata().map_or(0, |known| known.len());
    let too_much = |_| Error::OutOfMemory(format!("{}: {expected} bytes", path.display()));
    bytes
        .try_reserve_exact(usize::try_from(expected).unwrap_or(usize::MAX))
        .map_err(too_much)?;
    let read = file.take(most + 1).read_to_end(&mut bytes);
    read.map_err(Error::io(path))?;
    if bytes.len() as u64 <= most {
        Ok(bytes)
    } else {
        Err(kind.too_large(path, most))
    }
}

/// Copies a file. Either the whole copy appears or none of it.
///
/// # Errors
/// Those of [`read_file`] and of [`super::write_atomically`].
pub fn copy_file(from: &Path, kind: InputKind, to: &Path) -> Result<()> {
    let mut file = Input::open(from, kind)?;
    write_atomically(to, |copy| io::copy(&mut file, copy).map(drop))
}

/// The text of a file.
///
/// # Errors
/// Those of [`read_file`]; the kind's error if the file is not in UTF-8.
pub fn read_text(path: &Path, kind: InputKind) -> Result<String> {
    String::from_utf8(read_file(path, kind)?).map_err(|_| {
        let path = path.display();
        kind.refuse(format!(
            "{path}: expected text in UTF-8, got another encoding"
        ))
    })
}

/// Reads a pipe or a device to its end, or to one byte more than `most`.
///
/// Opening a pipe waits for a writer, and reading waits for the data. Another thread does both. If
/// the job is cancelled meanwhile, that thread may live until the process ends.
fn wait_for_bytes(path: &Path, most: u64, is_cancelled: impl Fn() -> bool) -> Result<Vec<u8>> {
    let (sender, receiver) = sync_channel(CHUNKS_AHEAD);
    let place = path.to_owned();
    std::thread::Builder::new()
        .name("pipe".into())
        .spawn(move || {
            let result = File::open(&place).and_then(|file| send_bytes(file, most, &sender));
            if let Err(error) = result {
                // This fails if the job was cancelled, because nobody listens any more.
                let _ = sender.send(Err(error));
            }
        })
        .map_err(Error::io(path))?;
    let mut bytes = Vec::new();
    loop {
        if is_cancelled() {
            return Err(Error::Cancelled);
        }
        match receiver.recv_timeout(PATIENCE) {
            Ok(chunk) => bytes.extend(chunk.map_err(Error::io(path))?),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(bytes),
        }
    }
}

/// Sends the bytes of a file to its end, or to one byte more than `most`.
fn send_bytes(file: File, most: u64, sender: &SyncSender<io::Result<Vec<u8>>>) -> io::Result<()> {
    let mut file = file.take(most + 1);
    loop {
        let mut chunk = vec![0; CHUNK];
        let count = match file.read(&mut chunk) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            count => count?,
        };
        chunk.truncate(count);
        if count == 0 || sender.send(Ok(chunk)).is_err() {
            return Ok(());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_beyond_the_limit_of_its_kind_is_refused_before_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("landmarks.json");
        File::create(&path)
            .unwrap()
            .set_len((16 << 20) + 1)
            .unwrap();
        let error = read_text(&path, InputKind::Text).unwrap_err();
        assert!(matches!(error, Error::InvalidInput(_)), "{error}");
        let message = error.to_string();
        assert!(
            message.contains("landmarks.json: expected at most 16 MiB"),
            "{message}"
        );
        assert_eq!(
            read_file(&path, InputKind::Mesh).unwrap().len(),
            (16 << 20) + 1
        );
    }

    #[test]
    fn bytes_that_are_no_text_and_folders_are_errors_of_their_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        std::fs::write(&path, b"\xff").unwrap();
        let error = read_text(&path, InputKind::Text).unwrap_err();
        assert!(error.to_string().contains("UTF-8"), "{error}");
        let error = read_file(folder.path(), InputKind::Mesh).unwrap_err();
        assert!(matches!(error, Error::Io { .. }), "{error}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_device_without_an_end_is_refused() {
        let zero = Path::new("/dev/zero");
        for kind in [InputKind::Text, InputKind::Mesh] {
            let error = read_file(zero, kind).unwrap_err();
            assert!(error.to_string().contains("got more"), "{error}");
        }
        assert_eq!(
            read_file(Path::new("/dev/null"), InputKind::Text).unwrap(),
            b""
        );
    }

    #[cfg(unix)]
    #[test]
    fn whoever_waits_for_a_pipe_can_be_cancelled() {
        let folder = tempfile::tempdir().unwrap();
        let [silent, pipe] = ["silent", "pipe"].map(|name| folder.path().join(name));
        let status = std::process::Command::new("mkfifo")
            .args([&silent, &pipe])
            .status();
        assert!(status.unwrap().success());
        let error = wait_for_bytes(&silent, 10, || true).unwrap_err();
        assert!(matches!(error, Error::Cancelled), "{error}");
        let bytes = vec![7; 3 * CHUNK + 5];
        let (path, written) = (pipe.clone(), bytes.clone());
        let writer = std::thread::spawn(move || std::fs::write(path, written).unwrap());
        assert_eq!(read_file(&pipe, InputKind::Mesh).unwrap(), bytes);
        writer.join().unwrap();
    }
}
