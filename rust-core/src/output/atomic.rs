//! A file appears whole or not at all.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use tempfile::NamedTempFile;

use crate::{Error, Result};

/// Bytes that are gathered before the system is asked to write them.
const BUFFER_BYTES: usize = 1 << 20;

/// Writes a file under a temporary name in the same folder, then renames it to `path`.
///
/// On any failure the temporary file is removed and what was at `path` stays.
///
/// # Errors
/// `Io` if the folder cannot be written to, the disk is full, or `path` is there already and is
/// not a regular file.
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

/// A file in the making; dropped before [`Unfinished::finish`] it leaves nothing.
pub(super) struct Unfinished {
    path: PathBuf,
    temporary: NamedTempFile,
}

impl Unfinished {
    /// Opens a temporary file beside `path`.
    pub(super) fn create(path: &Path) -> Result<(Unfinished, BufWriter<File>)> {
        refuse_special(path).map_err(Error::io(path))?;
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let temporary = temporary_in(folder).map_err(Error::io(path))?;
        let file = temporary.reopen().map_err(Error::io(path))?;
        let path = path.to_owned();
        let file = BufWriter::with_capacity(BUFFER_BYTES, file);
        Ok((Unfinished { path, temporary }, file))
    }

    /// Renames it to its place, when everything was written.
    pub(super) fn finish(self) -> Result<()> {
        let persisted = self.temporary.persist(&self.path).map_err(|e| e.error);
        persisted.map(drop).map_err(Error::io(&self.path))
    }
}

/// Renaming onto a device or a folder would replace the device or fail late.
fn refuse_special(path: &Path) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(found) if !found.is_file() => Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "expected the name of a regular file",
        )),
        _ => Ok(()),
    }
}

fn temporary_in(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".anyface-").suffix(".part");
    // tempfile makes private files; a result is an ordinary one, subject to the umask.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
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
    fn folders_and_missing_folders_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_atomically(folder.path(), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("regular file"), "{error}");
        let path = folder.path().join("no/such/clip.npz");
        let error = write_atomically(&path, |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("no/such/clip.npz"), "{error}");
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
