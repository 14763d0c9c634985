//! Writes files and folders so that either the whole appears or none of it.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError, TryLockError},
    time::{Duration, Instant, SystemTime},
};

use tempfile::{NamedTempFile, TempDir};

use super::{
    place::{Place, folder_of, follow},
    receipts::Receipts,
};
use crate::{Error, Result};

/// Bytes collected before each write.
const BUFFER_BYTES: usize = 1 << 20;
/// Start of the names of unfinished files.
const PREFIX: &str = ".anyface-";
/// End of these names.
const SUFFIX: &str = ".part";
/// An unfinished file that nobody has written to for this long belongs to a killed process.
const ABANDONED: Duration = Duration::from_secs(3600);
/// Least time between two searches of one folder for such files.
const LOOK_AGAIN: Duration = Duration::from_secs(60);

/// Unfinished files and folders of this process.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// The job whose files get their names together. If it is `None`, each file gets its name at once.
static JOB: Mutex<Option<Job>> = Mutex::new(None);

/// A job of [`all_or_none`].
#[derive(Default)]
struct Job {
    is_cancelled: Option<fn() -> bool>,
    inputs: Vec<(Place, PathBuf)>,
    outputs: Vec<(Place, PathBuf)>,
    /// Folders made for results, the outer ones first.
    folders: Vec<PathBuf>,
    /// Complete files that wait for the others.
    waiting: Vec<Unfinished>,
}

impl Job {
    /// Adds an output. Refuses a file that the job reads or already writes.
    fn note_output(&mut self, path: &Path) -> Result<()> {
        let place = Place::of(path);
        let known = |files: &[(Place, PathBuf)], what: &str| {
            let same = files.iter().find(|(other, _)| *other == place);
            same.map_or(Ok(()), |(_, other)| {
                let (path, other) = (path.display(), other.display());
                Err(Error::InvalidInput(format!(
                    "{path}: expected another file than {other}, which {what}"
                )))
            })
        };
        known(&self.inputs, "the result would replace")?;
        known(&self.outputs, "is another result")?;
        self.outputs.push((place, path.to_owned()));
        Ok(())
    }
}

fn unfinished(change: impl FnOnce(&mut Vec<PathBuf>)) {
    change(&mut UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner));
}

/// Removes all unfinished files and folders before the process ends in the middle of its work.
///
/// Another thread may hold the list of them. This waits 0.1 s for it, but no longer, because that
/// thread may be the one that ends the process.
pub fn remove_unfinished() {
    for _ in 0..100 {
        let paths = match UNFINISHED.try_lock() {
            Ok(paths) => Some(paths),
            Err(TryLockError::Poisoned(error)) => Some(error.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        };
        if let Some(mut paths) = paths {
            for path in paths.drain(..) {
                remove(&path);
            }
            drop(paths);
            let job = match JOB.try_lock() {
                Ok(job) => job,
                Err(TryLockError::Poisoned(error)) => error.into_inner(),
                Err(TryLockError::WouldBlock) => return,
            };
            if let Some(job) = &*job {
                remove_empty(&job.folders);
            }
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Runs a job and gives all its files their names together once it has succeeded. If it fails, it
/// leaves no file.
///
/// This is for a process that does one job at a time, such as the command, because the files of all
/// its threads wait. The job must write none of `inputs`, the files that it reads, and no file
/// twice. When `is_cancelled` returns true, the job stops waiting for a pipe.
///
/// # Errors
/// Those of `job`; `Io` if a file cannot get its name; `InvalidInput` for a file that the job reads
/// or already writes.
pub fn all_or_none<T>(
    inputs: Vec<PathBuf>,
    is_cancelled: fn() -> bool,
    job: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let swap = |next| {
        let mut job = JOB.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::replace(&mut *job, next)
    };
    let inputs = inputs.into_iter().map(|path| (Place::of(&path), path));
    swap(Some(Job {
        is_cancelled: Some(is_cancelled),
        inputs: inputs.collect(),
        ..Job::default()
    }));
    let result = job();
    let ended = swap(None).unwrap_or_default();
    let result = result.and_then(|result| {
        ended.waiting.into_iter().try_for_each(Unfinished::place)?;
        Ok(result)
    });
    if result.is_err() {
        remove_empty(&ended.folders);
    }
    result
}

/// Removes those of the folders that are empty, the inner ones first.
fn remove_empty(folders: &[PathBuf]) {
    for folder in folders.iter().rev() {
        // This fails, and the folder stays, if somebody else has put something into it.
        let _ = fs::remove_dir(folder);
    }
}

/// Makes a folder for results and its missing parents. If a job of [`all_or_none`] fails, it
/// removes the folders that it made.
///
/// # Errors
/// `Io` if one cannot be made.
pub(crate) fn create_folder(folder: &Path) -> Result<()> {
    let around = folder
        .ancestors()
        .filter(|path| !path.as_os_str().is_empty());
    let mut missing: Vec<PathBuf> = around
        .take_while(|path| !path.exists())
        .map(Path::to_owned)
        .collect();
    missing.reverse();
    if let Some(job) = &mut *JOB.lock().unwrap_or_else(PoisonError::into_inner) {
        job.folders.extend(missing);
    }
    fs::create_dir_all(folder).map_err(Error::io(folder))
}

/// Whether somebody has cancelled the job of [`all_or_none`].
pub(super) fn is_cancelled() -> bool {
    let job = JOB.lock().unwrap_or_else(PoisonError::into_inner);
    let asks = job.as_ref().and_then(|job| job.is_cancelled);
    asks.is_some_and(|is_cancelled| is_cancelled())
}

/// Removes an unfinished file or folder. Ignores errors, because it may get its name at the same
/// time, or somebody else may remove it.
fn remove(path: &Path) {
    let _ = if path.is_dir() {
        fs::remove_dir_all(path)
    } else {
        fs::remove_file(path)
    };
}

/// Writes a file under a temporary name in the same folder, then renames it to `path`.
///
/// On any failure the temporary file is removed and the old file at `path` stays. If `path` is a
/// link, the file that it points to is replaced and the link stays.
///
/// # Errors
/// `Io` if the folder cannot be written to, the disk is full, or `path` exists and is not a regular
/// file; `InvalidInput` for a file that the job reads or already writes.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<()> {
    let (unfinished, mut file) = Unfinished::create(path)?;
    write(&mut file).map_err(Error::io(path))?;
    file.flush().map_err(Error::io(path))?;
    drop(file);
    unfinished.finish()
}

/// An unfinished file. If it is dropped before [`Unfinished::finish`], it leaves nothing.
pub(crate) struct Unfinished {
    path: PathBuf,
    /// `Some` if nobody typed the name of the file.
    receipts: Option<Receipts>,
    temporary: Option<NamedTempFile>,
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            unfinished(|paths| paths.retain(|path| path != temporary.path()));
        }
    }
}

impl Unfinished {
    /// Opens a temporary file beside `path`.
    ///
    /// # Errors
    /// `Io`; `InvalidInput` for a file that the job reads or already writes, and for a file of the
    /// user that a derived name would replace.
    pub(crate) fn create(path: &Path) -> Result<(Unfinished, BufWriter<File>)> {
        refuse_special(path).map_err(Error::io(path))?;
        let receipts = Receipts::of(path);
        if let Some(receipts) = &receipts {
            receipts.check(path)?;
        }
        if let Some(job) = &mut *JOB.lock().unwrap_or_else(PoisonError::into_inner) {
            job.note_output(path)?;
        }
        let path = &follow(path);
        let folder = folder_of(path);
        remove_abandoned(folder);
        let temporary = temporary_in(folder).map_err(Error::io(path))?;
        unfinished(|paths| paths.push(temporary.path().to_owned()));
        let file = temporary.reopen().map_err(Error::io(path))?;
        let path = path.to_owned();
        let file = BufWriter::with_capacity(BUFFER_BYTES, file);
        let unfinished = Unfinished {
            path,
            receipts,
            temporary: Some(temporary),
        };
        Ok((unfinished, file))
    }

    /// Renames the complete file to its place, at once or together with the other files of its job.
    pub(crate) fn finish(self) -> Result<()> {
        let mut job = JOB.lock().unwrap_or_else(PoisonError::into_inner);
        match &mut *job {
            Some(job) => job.waiting.push(self),
            None => {
                drop(job);
                self.place()?;
            }
        }
        Ok(())
    }

    fn place(mut self) -> Result<()> {
        if let (Some(receipts), Some(temporary)) = (&self.receipts, &self.temporary) {
            receipts.check(&self.path)?;
            receipts.add(&self.path, temporary.path());
        }
        let Some(temporary) = self.temporary.take() else {
            return Ok(());
        };
        let name = temporary.path().to_owned();
        let persisted = temporary.persist(&self.path).map_err(|e| e.error);
        unfinished(|paths| paths.retain(|path| *path != name));
        persisted.map(drop).map_err(Error::io(&self.path))
    }
}

/// An unfinished folder. Its final place must hold no folder or an empty one. If it is dropped
/// before [`UnfinishedFolder::finish`], it leaves nothing.
pub(crate) struct UnfinishedFolder {
    path: PathBuf,
    temporary: Option<TempDir>,
}

impl Drop for UnfinishedFolder {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            unfinished(|paths| paths.retain(|path| path != temporary.path()));
        }
    }
}

impl UnfinishedFolder {
    /// Makes a temporary folder beside `path`.
    pub(crate) fn create(path: &Path) -> Result<UnfinishedFolder> {
        let folder = folder_of(path);
        remove_abandoned(folder);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).suffix(SUFFIX);
        // tempfile makes private folders. A result is an ordinary one, subject to the umask.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
        let temporary = builder.tempdir_in(folder).map_err(Error::io(path))?;
        unfinished(|paths| paths.push(temporary.path().to_owned()));
        Ok(UnfinishedFolder {
            path: path.to_owned(),
            temporary: Some(temporary),
        })
    }

    /// The folder to write its files into.
    pub(crate) fn place(&self) -> &Path {
        self.temporary
            .as_ref()
            .map_or(&self.path, |temporary| temporary.path())
    }

    /// Renames the complete folder to its place. An empty folder there is removed first.
    pub(crate) fn finish(mut self) -> Result<()> {
        let Some(temporary) = self.temporary.take() else {
            return Ok(());
        };
        let name = temporary.path().to_owned();
        let named = if self.path.is_dir() {
            fs::remove_dir(&self.path).and_then(|()| fs::rename(&name, &self.path))
        } else {
            fs::rename(&name, &self.path)
        };
        unfinished(|paths| paths.retain(|path| *path != name));
        named.map_err(Error::io(&self.path))?;
        // The folder has its final name now.
        let _ = temporary.keep();
        Ok(())
    }
}

/// Refuses a device or a folder, and names that no file can have. Renaming would replace the device
/// or fail late, when other files of the job have their names already.
fn refuse_special(path: &Path) -> io::Result<()> {
    let is_file = match fs::metadata(path) {
        Ok(file) => file.is_file(),
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        Err(_) => path.file_name().is_some_and(|name| {
            let (path, name) = (path.as_os_str(), name.as_encoded_bytes());
            path.as_encoded_bytes().ends_with(name)
        }),
    };
    if is_file {
        Ok(())
    } else {
        let message = "expected the name of a regular file";
        Err(io::Error::new(io::ErrorKind::InvalidInput, message))
    }
}

/// Removes the unfinished files of killed processes from a folder. It looks into a folder at most
/// once a minute, because a batch may keep ten thousand results there.
fn remove_abandoned(folder: &Path) {
    static LOOKED: Mutex<Vec<(PathBuf, Instant)>> = Mutex::new(Vec::new());
    let mut looked = LOOKED.lock().unwrap_or_else(PoisonError::into_inner);
    looked.retain(|(_, at)| at.elapsed() < LOOK_AGAIN);
    if looked.iter().any(|(known, _)| known == folder) {
        return;
    }
    looked.push((folder.to_owned(), Instant::now()));
    drop(looked);
    let Ok(files) = fs::read_dir(folder) else {
        return;
    };
    for file in files.flatten() {
        let name = file.file_name();
        let name = name.to_string_lossy();
        if !name.starts_with(PREFIX) || !name.ends_with(SUFFIX) {
            continue;
        }
        let touched = file.metadata().and_then(|meta| meta.modified());
        let age = touched.map(|at| SystemTime::now().duration_since(at));
        if age.is_ok_and(|age| age.is_ok_and(|age| age > ABANDONED)) {
            remove(&file.path());
        }
    }
}

fn temporary_in(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).suffix(SUFFIX);
    // tempfile makes private files. A result is an ordinary one, subject to the umask.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

/// Writes any value as indented JSON.
///
/// # Errors
/// `Io` if the file cannot be written.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    write_atomically(path, |file| {
        serde_json::to_writer_pretty(&mut *file, value)?;
        std::io::Write::write_all(file, b"\n")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clip.npz");
        fs::write(&path, b"old").unwrap();
        let result = write_atomically(&path, |file| {
            file.write_all(&vec![1; 3 * BUFFER_BYTES])?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        });
        assert!(matches!(result, Err(Error::Io { .. })));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_finished_file_replaces_the_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clip.npz");
        fs::write(&path, b"a longer old file").unwrap();
        write_atomically(&path, |file| file.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_killed_processes_left_goes_with_the_next_file() {
        let folder = tempfile::tempdir().unwrap();
        for (name, age_s) in [
            (".anyface-a.part", 4000),
            (".anyface-b.part", 30),
            ("c.part", 4000),
        ] {
            let file = File::create(folder.path().join(name)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age_s))
                .unwrap();
        }
        write_atomically(&folder.path().join("clip.npz"), |_| Ok(())).unwrap();
        let exists = |name: &str| folder.path().join(name).exists();
        assert!(!exists(".anyface-a.part"));
        assert!(exists(".anyface-b.part") && exists("c.part") && exists("clip.npz"));
    }

    #[test]
    fn a_process_that_ends_in_the_middle_removes_its_files() {
        let folder = tempfile::tempdir().unwrap();
        let (guard, file) = Unfinished::create(&folder.path().join("clip.npz")).unwrap();
        let name = guard.temporary.as_ref().unwrap().path().to_owned();
        assert!(name.exists());
        unfinished(|paths| assert!(paths.contains(&name)));
        drop(guard);
        // Windows removes the name when the last handle closes.
        drop(file);
        unfinished(|paths| assert!(!paths.contains(&name)));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn folders_and_missing_folders_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_atomically(folder.path(), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("regular file"), "{error}");
        for name in ["", "no-folder/", "no-folder/.", "no-folder/.."] {
            let path = match name {
                "" => PathBuf::new(),
                name => folder.path().join(name),
            };
            let error = write_atomically(&path, |_| Ok(())).unwrap_err();
            assert!(error.to_string().contains("regular file"), "{error}");
        }
        let path = folder.path().join("no/such/clip.npz");
        let error = write_atomically(&path, |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("no/such/clip.npz"), "{error}");
        let path = folder.path().join("n".repeat(300));
        assert!(write_atomically(&path, |_| panic!("written")).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_and_its_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("a"), folder.path().join("link"));
        fs::write(&file, b"old").unwrap();
        std::os::unix::fs::symlink("a", &link).unwrap();
        write_atomically(&link, |file| file.write_all(b"new")).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
    }

    #[cfg(unix)]
    #[test]
    fn results_are_as_readable_as_the_umask_says() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("a"), folder.path().join("b"));
        write_atomically(&ours, |_| Ok(())).unwrap();
        fs::write(&plain, b"").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }
}
