//! Keeps files of the user from being replaced by results whose names nobody typed.
//!
//! Such a name derives from another one, as that of the sound beside a scene does. A file of that
//! name is replaced only if this program wrote it and nobody has changed it since. To know this, the
//! program keeps a receipt of each file that it writes under a derived name.

use std::{
    collections::BTreeMap,
    fs::{self, File, OpenOptions},
    io::{self, Write},
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use super::place::folder_of;
use crate::{Error, Result};

/// Name of the file of receipts in its folder.
pub(crate) const FILE: &str = ".anyface-receipts";
/// The most receipts in a folder. Beyond this number the older half goes, and its files count as the
/// user's.
const MOST: usize = 1 << 16;

/// Derived names that this process is about to write.
static DERIVED: Mutex<BTreeMap<PathBuf, Receipts>> = Mutex::new(BTreeMap::new());

fn derived() -> MutexGuard<'static, BTreeMap<PathBuf, Receipts>> {
    DERIVED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The receipts in one folder.
#[derive(Debug, Clone, Default)]
pub struct Receipts(Option<PathBuf>);

impl Receipts {
    /// The receipts in `folder`, which need not exist yet. Files inside it may move with it. Without
    /// a folder no receipt is kept, so that every file counts as the user's.
    pub fn new(folder: Option<PathBuf>) -> Receipts {
        Receipts(folder)
    }

    /// Whether a result with a derived name may take this path: nothing is there, or a file that
    /// this program wrote and nobody has changed since. A link counts as the user's.
    pub fn may_replace(&self, path: &Path) -> bool {
        match fs::symlink_metadata(path) {
            Err(error) => error.kind() == io::ErrorKind::NotFound,
            Ok(file) => file.is_file() && self.has(path).unwrap_or(false),
        }
    }

    /// Says that nobody typed the name of a result. From then on, writing it checks this again and
    /// keeps a receipt.
    ///
    /// # Errors
    /// `InvalidInput` if [`Receipts::may_replace`] says no.
    pub fn derive(&self, path: &Path) -> Result<()> {
        self.check(path)?;
        derived().insert(path.to_owned(), self.clone());
        Ok(())
    }

    /// The receipts of a path whose name is derived.
    pub(super) fn of(path: &Path) -> Option<Receipts> {
        derived().get(path).cloned()
    }

    /// Refuses a path that a derived name may not take.
    pub(super) fn check(&self, path: &Path) -> Result<()> {
        if self.may_replace(path) {
            return Ok(());
        }
        Err(Error::InvalidInput(format!(
            "{}: expected nothing here, or what anyface wrote here and nobody changed, got another file, which nobody \
             asked to replace: move it away, or name another result",
            path.display()
        )))
    }

    /// Keeps the receipt of a file that is about to get its name, and lies at `unfinished` until then.
    /// If that fails, the file will count as the user's.
    pub(super) fn add(&self, path: &Path, unfinished: &Path) {
        derived().remove(path);
        if let Some(folder) = &self.0
            && let Err(error) = append(folder, path, unfinished)
        {
            tracing::debug!(path = %path.display(), %error, "no receipt kept");
        }
    }

    fn has(&self, path: &Path) -> io::Result<bool> {
        let Some(folder) = &self.0 else {
            return Ok(false);
        };
        let receipts = fs::read_to_string(folder.join(FILE))?;
        Ok(contains(&receipts, &receipt(folder, path, path)?))
    }
}

fn append(folder: &Path, path: &Path, unfinished: &Path) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let receipt = receipt(folder, path, unfinished)?;
    let file = folder.join(FILE);
    let receipts = fs::read_to_string(&file).unwrap_or_default();
    if contains(&receipts, &receipt) {
        return Ok(());
    }
    let count = receipts.lines().count();
    if count < MOST {
        // A single write, so that other processes cannot write into the middle of it. The line break
        // in front ends a line that a killed process has left unfinished.
        let mut file = OpenOptions::new().append(true).create(true).open(file)?;
        return file.write_all(format!("\n{receipt}").as_bytes());
    }
    let mut fresh = tempfile::NamedTempFile::new_in(folder)?;
    for line in receipts.lines().skip(count - MOST / 2).chain([&*receipt]) {
        write!(fresh, "\n{line}")?;
    }
    fresh.persist(file).map(drop).map_err(|error| error.error)
}

fn contains(receipts: &str, receipt: &str) -> bool {
    receipts.lines().any(|line| line == receipt)
}

/// A hash of a file's path and of the content that lies at `content`.
fn receipt(folder: &Path, path: &Path, content: &Path) -> io::Result<String> {
    let place = folder_of(path).canonicalize()?;
    let place = place.join(path.file_name().unwrap_or_default());
    let folder = folder.canonicalize()?;
    let name = place.strip_prefix(&folder).unwrap_or(&place);
    let mut hasher = blake3::Hasher::new();
    hasher.update(name.as_os_str().as_encoded_bytes());
    hasher.update(&[0]);
    hasher.update_reader(File::open(content)?)?;
    Ok(hasher.finalize().to_hex().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::write_atomically;

    fn write(receipts: &Receipts, path: &Path, text: &str) -> Result<()> {
        receipts.derive(path)?;
        write_atomically(path, |file| file.write_all(text.as_bytes()))
    }

    #[test]
    fn a_derived_name_replaces_only_what_was_written_here_and_is_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("take.wav");
        let receipts = Receipts::new(Some(folder.path().join("cache")));
        write(&receipts, &path, "one").unwrap();
        write(&receipts, &path, "two").unwrap();
        // Without the receipts, and as another file, it is the user's.
        assert!(!Receipts::default().may_replace(&path));
        let other = folder.path().join("other.wav");
        fs::copy(&path, &other).unwrap();
        assert!(!receipts.may_replace(&other));
        fs::write(&path, "corrected by hand").unwrap();
        let error = write(&receipts, &path, "three").unwrap_err().to_string();
        assert!(error.contains("nobody asked to replace"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"corrected by hand");
    }

    #[test]
    fn a_file_that_appears_during_the_work_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("take.wav");
        let receipts = Receipts::new(Some(folder.path().to_owned()));
        receipts.derive(&path).unwrap();
        let result = write_atomically(&path, |file| {
            fs::write(&path, "of the user")?;
            file.write_all(b"of the program")
        });
        assert!(matches!(result, Err(Error::InvalidInput(_))));
        assert_eq!(fs::read(&path).unwrap(), b"of the user");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn receipts_move_with_the_folder_that_holds_them() {
        let folder = tempfile::tempdir().unwrap();
        let [old, new] = ["old", "new"].map(|name| folder.path().join(name));
        fs::create_dir(&old).unwrap();
        write(
            &Receipts::new(Some(old.clone())),
            &old.join("page.html"),
            "one",
        )
        .unwrap();
        fs::rename(&old, &new).unwrap();
        write(
            &Receipts::new(Some(new.clone())),
            &new.join("page.html"),
            "two",
        )
        .unwrap();
    }

    #[test]
    fn half_a_receipt_and_too_many_receipts_do_no_harm() {
        let folder = tempfile::tempdir().unwrap();
        let receipts = Receipts::new(Some(folder.path().to_owned()));
        let [first, second] = ["a", "b"].map(|name| folder.path().join(name));
        write(&receipts, &first, "a").unwrap();
        let file = folder.path().join(FILE);
        let half = fs::read_to_string(&file).unwrap() + "\n0123";
        fs::write(&file, &half).unwrap();
        write(&receipts, &second, "b").unwrap();
        assert!(receipts.may_replace(&first) && receipts.may_replace(&second));
        let all = fs::read_to_string(&file).unwrap();
        fs::write(&file, "0\n".repeat(MOST) + &all).unwrap();
        write(&receipts, &second, "c").unwrap();
        assert!(receipts.may_replace(&first) && receipts.may_replace(&second));
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.lines().count() < MOST);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_the_users() {
        let folder = tempfile::tempdir().unwrap();
        let receipts = Receipts::new(Some(folder.path().to_owned()));
        let path = folder.path().join("take.wav");
        std::os::unix::fs::symlink("nothing-yet.wav", &path).unwrap();
        assert!(write(&receipts, &path, "one").is_err());
        assert!(!folder.path().join("nothing-yet.wav").exists());
    }
}
