//! The history of a batch: one line of JSON each time a row ends, in one file that several
//! processes may write.

use std::{
    collections::{HashMap, HashSet},
    fs::{self, File, OpenOptions},
    io::{BufRead, BufReader, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::{SystemTime, UNIX_EPOCH},
};

use anyface::{Error, Result};
use serde::{Deserialize, Serialize};

use super::{
    lips::{Gap, LipMotion},
    rows::Row,
};
use crate::{console::kind, signals};

/// Name of the history in the folder of reports.
pub const HISTORY: &str = "history.jsonl";

/// The most bytes of a line that are read at once. An entry with its curves has a few thousand.
const LONGEST_LINE: u64 = 1 << 20;

/// Exit code if some rows failed, the same as that of Blender's batch.
pub const SOME_FAILED: u8 = 12;

/// Why a row has no result.
#[derive(Debug, Clone, PartialEq)]
pub struct Failure {
    pub kind: String,
    pub exit_code: u8,
    pub message: String,
}

impl From<&Error> for Failure {
    fn from(error: &Error) -> Failure {
        Failure {
            kind: kind(error).to_owned(),
            exit_code: error.exit_code(),
            message: error.to_string(),
        }
    }
}

/// How a row ended. Optional fields that do not apply are left out of the file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Entry {
    pub name: String,
    pub ok: bool,
    pub message: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    pub kind: String,
    pub exit_code: u8,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Seconds that the row took.
    pub seconds: f64,
    /// When the row ended, seconds since 1970.
    pub at: f64,
    pub host: String,
    pub pid: u32,
    /// Length of the sound, seconds.
    pub duration_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_mb: Option<u64>,
    #[serde(skip_serializing_if = "String::is_empty")]
    pub out: String,
    /// Size and time of the result, to detect later changes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub result: Option<FileState>,
    /// Digest of the row and the files that it reads.
    pub digest: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lips: Option<LipMotion>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gap: Option<Gap>,
    /// Peaks of the sound, 0 to 1.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub wave: Vec<f32>,
}

/// Size and time of a file. If either differs, the file has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileState {
    pub bytes: u64,
    pub modified_ns: u64,
}

impl FileState {
    /// The state of a file or folder. For a folder these are the sum of all sizes and the newest
    /// time in it. Links are followed, but a folder that several links lead to counts once. `None`
    /// if nothing is there, or if somebody asks the command to end meanwhile.
    pub fn of(path: &Path) -> Option<FileState> {
        FileState::of_new(path, &mut HashSet::new())
    }

    /// The state of a file or folder. `visited`: the folders that were counted before.
    fn of_new(path: &Path, visited: &mut HashSet<PathBuf>) -> Option<FileState> {
        let metadata = fs::metadata(path).ok()?;
        let state = FileState {
            bytes: metadata.len(),
            modified_ns: since_1970_ns(metadata.modified().ok()?),
        };
        if !metadata.is_dir() {
            return Some(state);
        }
        if signals::are_to_end() || !visited.insert(fs::canonicalize(path).ok()?) {
            return None;
        }
        let files = fs::read_dir(path).ok()?.flatten();
        let files = files.filter_map(|file| FileState::of_new(&file.path(), visited));
        Some(files.fold(state, |all, file| FileState {
            bytes: all.bytes.wrapping_add(file.bytes),
            modified_ns: all.modified_ns.max(file.modified_ns),
        }))
    }
}

fn since_1970_ns(time: SystemTime) -> u64 {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    since.as_nanos() as u64
}

/// Computes digests of rows. A digest changes when the row's options, the files that it reads or
/// the version of anyface change. It is the same on every machine that sees the same files.
#[derive(Default)]
pub struct Digests {
    known: HashMap<PathBuf, Option<FileState>>,
}

impl Digests {
    pub fn of(&mut self, row: &Row) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(env!("CARGO_PKG_VERSION").as_bytes());
        let words = serde_json::to_vec(&row.words).expect("text serialises");
        hasher.update(&words);
        for path in &row.inputs {
            // A mesh may have a file of landmarks beside it, which is read as well.
            for path in [path.clone(), crate::paths::landmarks_beside(path)] {
                let state = self.known.entry(path);
                let state = state.or_insert_with_key(|path| FileState::of(path));
                let state = serde_json::to_vec(state).expect("numbers serialise");
                hasher.update(&state);
            }
        }
        hasher.finalize().to_hex()[..24].to_owned()
    }
}

/// The history of a batch, in its folder of reports.
pub struct Ledger {
    path: PathBuf,
    /// Opened when the first line is written.
    file: Mutex<Option<File>>,
    /// The latest entry of each row, without its curves.
    last: HashMap<String, Entry>,
}

impl Ledger {
    /// Reads the existing history. It skips lines that are no entries, such as one that a killed
    /// process left unfinished.
    ///
    /// # Errors
    /// `Io` if the file cannot be read.
    pub fn open(folder: &Path) -> Result<Ledger> {
        let path = folder.join(HISTORY);
        let mut last = HashMap::new();
        each_entry(&path, |entry| {
            let entry = Entry {
                gap: None,
                wave: Vec::new(),
                ..entry
            };
            last.insert(entry.name.clone(), entry);
        })?;
        Ok(Ledger {
            path,
            file: Mutex::new(None),
            last,
        })
    }

    pub fn last(&self, name: &str) -> Option<&Entry> {
        self.last.get(name)
    }

    /// Whether the row has succeeded with its present options and input files, and its result is
    /// unchanged since.
    pub fn is_finished(&self, row: &Row, digest: &str) -> bool {
        let is_result = |entry: &Entry| {
            let out = row.outputs.first();
            let now = out.and_then(|out| FileState::of(out));
            now.is_some() && now == entry.result
        };
        let entry = self.last(&row.name);
        entry.is_some_and(|entry| entry.ok && entry.digest == digest && is_result(entry))
    }

    /// Appends how a row ended. The line is a single write, so that other processes cannot write
    /// into the middle of it.
    ///
    /// # Errors
    /// `Io` if the file cannot be written.
    pub fn append(&self, entry: &Entry) -> Result<()> {
        let mut line = serde_json::to_vec(entry).expect("an entry serialises");
        line.push(b'\n');
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let file = match &mut *file {
            Some(file) => file,
            none => none.insert(opened(&self.path)?),
        };
        file.write_all(&line).map_err(Error::io(&self.path))
    }
}

/// Opens the file for appending. If a killed process left an unfinished line at the end, a line
/// break closes it.
fn opened(path: &Path) -> Result<File> {
    let io = || Error::io(path);
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
    }
    let mut options = OpenOptions::new();
    let options = options.append(true).read(true).create(true);
    let mut file = options.open(path).map_err(io())?;
    if file.seek(SeekFrom::End(-1)).is_ok() {
        let mut end = [0];
        file.read_exact(&mut end).map_err(io())?;
        if end != *b"\n" {
            file.write_all(b"\n").map_err(io())?;
        }
    }
    Ok(file)
}

/// Hands every entry of a history to `take`, the oldest first.
///
/// # Errors
/// `Io` if the file exists but cannot be read, `InvalidInput` if it is not a regular file, or holds something else.
pub fn each_entry(path: &Path, mut take: impl FnMut(Entry)) -> Result<()> {
    let is_link = fs::symlink_metadata(path).is_ok_and(|file| file.is_symlink());
    let wrong = |got: &str| {
        let path = path.display();
        Err(Error::InvalidInput(format!(
            "{path}: expected the history of a batch, got {got}: move it away"
        )))
    };
    if is_link {
        return wrong("a link");
    }
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(Error::io(path)(error)),
    };
    if !file.metadata().map_err(Error::io(path))?.is_file() {
        return wrong("no regular file");
    }
    let mut lines = BufReader::new(file);
    let mut line = Vec::new();
    let (mut is_empty, mut is_history) = (true, false);
    loop {
        line.clear();
        let part = &mut (&mut lines).take(LONGEST_LINE);
        let count = part.read_until(b'\n', &mut line);
        if count.map_err(Error::io(path))? == 0 {
            break;
        }
        // A killed process may have left half an entry, even the only one.
        is_empty = false;
        is_history |= line.starts_with(b"{\"name\"");
        if let Ok(entry) = serde_json::from_slice::<Entry>(&line)
            && !entry.name.is_empty()
        {
            is_history = true;
            take(entry);
        }
    }
    if is_empty || is_history {
        Ok(())
    } else {
        wrong("another file")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(name: &str, ok: bool) -> Entry {
        Entry {
            name: name.to_owned(),
            ok,
            wave: vec![0.5; 200],
            ..Entry::default()
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_with_links_to_itself_counts_once() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("model");
        fs::create_dir(&inner).unwrap();
        fs::write(inner.join("config.json"), "{}").unwrap();
        let bytes = |path: &Path| FileState::of(path).unwrap().bytes;
        let [whole, of_inner] = [folder.path(), &inner].map(bytes);
        assert!(whole > of_inner && of_inner > 2);
        for link in ["a", "b"] {
            std::os::unix::fs::symlink(".", folder.path().join(link)).unwrap();
        }
        std::os::unix::fs::symlink("../model", inner.join("c")).unwrap();
        let links = fs::metadata(folder.path()).unwrap().len();
        assert!(bytes(folder.path()).abs_diff(whole) <= links);
    }

    #[test]
    fn the_last_end_of_a_row_counts_and_half_a_line_is_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let ledger = Ledger::open(folder.path()).unwrap();
        ledger.append(&entry("a", false)).unwrap();
        ledger.append(&entry("a", true)).unwrap();
        let path = folder.path().join(HISTORY);
        let mut file = OpenOptions::new().append(true).open(&path).unwrap();
        file.write_all(b"{\"name\": \"b\", \"ok\": tr").unwrap();
        let again = Ledger::open(folder.path()).unwrap();
        assert!(again.last("a").unwrap().ok && again.last("b").is_none());
        again.append(&entry("c", true)).unwrap();
        let third = Ledger::open(folder.path()).unwrap();
        assert!(third.last("c").unwrap().ok);
        assert_eq!(third.last("c").unwrap().wave, Vec::<f32>::new());
    }

    #[test]
    fn lines_of_many_writers_stay_whole() {
        let folder = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for writer in 0..4 {
                let folder = folder.path();
                scope.spawn(move || {
                    let ledger = Ledger::open(folder).unwrap();
                    for line in 0..50 {
                        let name = format!("{writer}-{line}");
                        ledger.append(&entry(&name, true)).unwrap();
                    }
                });
            }
        });
        let mut count = 0;
        each_entry(&folder.path().join(HISTORY), |_| count += 1).unwrap();
        assert_eq!(count, 200);
    }
}
