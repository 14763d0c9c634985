//! Caches results of per-mesh work on disk between runs.
//!
//! An entry's name is the blake3 hash of everything its content depends on, so entries are never
//! out of date. The file also holds that hash, and a hash of the key and the payload together.
//! Reading checks both: a damaged or misnamed entry counts as absent. Files are renamed into place,
//! so they appear whole. A folder that cannot be read or written costs time and warnings. A file of
//! its own marks a folder as a cache. In any folder, only files with names of the cache's own make
//! are deleted.

use std::{
    collections::BTreeMap,
    ffi::OsStr,
    fs, io,
    io::Write,
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

mod arrays;

pub use arrays::{Arrays, Values};

use crate::{
    Error, Result,
    job::{InputKind, Receipts, read_file, read_text, receipts},
};

/// First bytes of every entry; the digit is the version of the layout.
const MAGIC: &[u8; 8] = b"anyface2";
const EXTENSION: &str = "anyface-cache";
const UNFINISHED: &str = "part";
/// The folder in which Blender's extension keeps pictures of faces, in its own cache.
const PICTURES: &str = "emotions";
/// Start of the names of unfinished entries, which `tempfile` chooses.
const TEMPORARY: &str = ".tmp";
/// The file that marks a folder as a cache. Programs that make backups know this name and pass the
/// folder over.
const MARK: &str = "CACHEDIR.TAG";
const MARK_TEXT: &str = "Signature: 8a477f597d28d172789f06886806bc55
# This folder is a cache of Anyface, which may delete files in it.
# About this file: https://bford.info/cachedir/
";

/// Total size beyond which the least recently used entries are deleted.
pub const DEFAULT_MAX_BYTES: u64 = 2 << 30;

/// Where results of per-mesh work are kept between runs.
#[derive(Debug, Clone, PartialEq)]
pub enum CachePolicy {
    /// Nothing is read or written.
    Off,
    /// The user's cache folder.
    UserFolder,
    /// This folder.
    Folder(PathBuf),
}

impl CachePolicy {
    /// The folder of the cache, if there is one.
    pub fn folder(&self) -> Option<PathBuf> {
        match self {
            CachePolicy::Off => None,
            CachePolicy::Folder(folder) => Some(folder.clone()),
            CachePolicy::UserFolder => user_folder(),
        }
    }

    /// The receipts of files with derived names, which lie in the cache.
    pub fn receipts(&self) -> Receipts {
        Receipts::new(self.folder())
    }

    /// Refuses a folder that holds files of others, unless it is marked as a cache. Caches of earlier
    /// versions have no mark, but hold nothing else either.
    ///
    /// # Errors
    /// `InvalidInput`.
    pub fn check(&self) -> Result<()> {
        let CachePolicy::Folder(folder) = self else {
            return Ok(());
        };
        let files = match fs::read_dir(folder) {
            Ok(files) if !is_marked(folder) => files,
            _ => return Ok(()),
        };
        let mut names = files.flatten().map(|file| file.file_name());
        names.find(|name| !is_own(name)).map_or(Ok(()), |name| {
            Err(Error::InvalidInput(format!(
                "cache: expected a new or an empty folder, or a cache of Anyface, got {}, which holds {}: name another",
                folder.display(),
                name.display()
            )))
        })
    }
}

/// Whether only this program chooses names such as this.
fn is_own(name: &OsStr) -> bool {
    let name = name.to_string_lossy();
    is_entry(&name) || is_unfinished(&name) || [receipts::FILE, PICTURES].contains(&&*name)
}

fn is_entry(name: &str) -> bool {
    let stem = name
        .strip_suffix(EXTENSION)
        .and_then(|name| name.strip_suffix('.'));
    stem.is_some_and(|stem| {
        stem.len() == 2 * blake3::OUT_LEN && stem.bytes().all(|c| c.is_ascii_hexdigit())
    })
}

fn is_unfinished(name: &str) -> bool {
    let stem = name
        .strip_suffix(UNFINISHED)
        .and_then(|name| name.strip_suffix('.'));
    let letters = stem.and_then(|stem| stem.strip_prefix(TEMPORARY));
    letters.is_some_and(|letters| {
        letters.len() == 6 && letters.bytes().all(|c| c.is_ascii_alphanumeric())
    })
}

fn is_marked(folder: &Path) -> bool {
    read_text(&folder.join(MARK), InputKind::Text).is_ok_and(|text| text == MARK_TEXT)
}

/// Names an entry by everything that its content depends on.
///
/// Each piece is hashed with its length, so that moving a border between two pieces changes the
/// name.
#[derive(Debug, Clone)]
pub struct CacheKey(blake3::Hasher);

impl CacheKey {
    /// `kind`: what is stored; `version`: raise it when the computation changes its results.
    pub fn new(kind: &str, version: u32) -> CacheKey {
        CacheKey(blake3::Hasher::new())
            .text(kind)
            .bytes(&version.to_le_bytes())
    }

    /// Adds raw bytes.
    #[must_use]
    pub fn bytes(mut self, bytes: &[u8]) -> CacheKey {
        self.0.update(&(bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
        self
    }

    /// Adds text.
    #[must_use]
    pub fn text(self, text: &str) -> CacheKey {
        self.bytes(text.as_bytes())
    }

    /// Adds single-precision numbers, bit by bit.
    #[must_use]
    pub fn f32s<'a>(self, values: impl IntoIterator<Item = &'a f32>) -> CacheKey {
        self.numbers(values, |v| v.to_le_bytes())
    }

    /// Adds double-precision numbers, bit by bit.
    #[must_use]
    pub fn f64s<'a>(self, values: impl IntoIterator<Item = &'a f64>) -> CacheKey {
        self.numbers(values, |v| v.to_le_bytes())
    }

    /// Adds whole numbers.
    #[must_use]
    pub fn u32s<'a>(self, values: impl IntoIterator<Item = &'a u32>) -> CacheKey {
        self.numbers(values, |v| v.to_le_bytes())
    }

    fn numbers<const N: usize, T>(
        self,
        values: impl IntoIterator<Item = T>,
        encode: fn(T) -> [u8; N],
    ) -> CacheKey {
        let bytes: Vec<u8> = values.into_iter().flat_map(encode).collect();
        self.bytes(&bytes)
    }

    /// The hash of all pieces.
    pub fn digest(&self) -> [u8; 32] {
        *self.0.finalize().as_bytes()
    }

    fn file_name(&self) -> String {
        format!("{}.{EXTENSION}", self.0.finalize().to_hex())
    }
}

/// The cache, which may be switched off.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cache {
    folder: Option<PathBuf>,
    max_bytes: u64,
}

impl Cache {
    /// The cache that `policy` asks for, bounded by [`DEFAULT_MAX_BYTES`].
    pub fn new(policy: &CachePolicy) -> Cache {
        let folder = policy.folder();
        if let Some(folder) = &folder {
            remove_abandoned(folder);
        }
        Cache {
            folder,
            max_bytes: DEFAULT_MAX_BYTES,
        }
    }

    /// The same with another bound. `max_bytes`: total size of all entries.
    #[must_use]
    pub fn with_max_bytes(self, max_bytes: u64) -> Cache {
        Cache { max_bytes, ..self }
    }

    /// Reads the entry of `key` with `decode`. If there is no usable entry, calls `make` and stores
    /// its result with `encode`. Without a cache nothing is encoded.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn get_or_make<T>(
        &self,
        key: &CacheKey,
        decode: impl FnOnce(Arrays) -> Option<T>,
        encode: impl FnOnce(&T) -> Arrays,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let Some(folder) = &self.folder else {
            return make();
        };
        let path = folder.join(key.file_name());
        if let Some(cached) = read(&path, key).and_then(decode) {
            return Ok(cached);
        }
        let fresh = make()?;
        if let Err(error) = self.store(folder, &path, key, &encode(&fresh)) {
            tracing::warn!(path = %path.display(), %error, "cache not written");
        }
        Ok(fresh)
    }

    fn store(&self, folder: &Path, path: &Path, key: &CacheKey, arrays: &Arrays) -> io::Result<()> {
        let payload = arrays.to_bytes()?;
        fs::create_dir_all(folder)?;
        if !is_marked(folder) {
            write_whole(folder, &folder.join(MARK), |file| {
                file.write_all(MARK_TEXT.as_bytes())
            })?;
        }
        write_whole(folder, path, |file| {
            file.write_all(MAGIC)?;
            file.write_all(&key.digest())?;
            file.write_all(&seal(key, &payload))?;
            file.write_all(&payload)
        })?;
        self.evict(folder, path)
    }

    /// Deletes the least recently used entries until the rest fits, but never `keep`, the newest.
    fn evict(&self, folder: &Path, keep: &Path) -> io::Result<()> {
        let mut entries = BTreeMap::new();
        let mut total = 0;
        for file in fs::read_dir(folder)?.flatten() {
            let (path, Ok(meta)) = (file.path(), file.metadata()) else {
                continue;
            };
            let age = meta.modified().unwrap_or(SystemTime::UNIX_EPOCH);
            if is_entry(&file.file_name().to_string_lossy()) {
                total += meta.len();
                entries.insert((age, path), meta.len());
            }
        }
        for ((_, path), size) in entries {
            if total <= self.max_bytes {
                break;
            }
            if path != keep {
                remove(&path);
                total -= size;
            }
        }
        Ok(())
    }
}

/// Removes the half-written files of killed processes.
fn remove_abandoned(folder: &Path) {
    let Ok(files) = fs::read_dir(folder) else {
        return;
    };
    for file in files.flatten() {
        let is_part = is_unfinished(&file.file_name().to_string_lossy());
        let age = file.metadata().and_then(|meta| meta.modified());
        if is_part && age.is_ok_and(is_abandoned) {
            remove(&file.path());
        }
    }
}

/// Binds a payload to the key under which it was stored.
fn seal(key: &CacheKey, payload: &[u8]) -> [u8; blake3::OUT_LEN] {
    *blake3::keyed_hash(&key.digest(), payload).as_bytes()
}

/// The user's cache folder for this program, where the system has one.
fn user_folder() -> Option<PathBuf> {
    let folder = directories::ProjectDirs::from("", "", "anyface");
    if folder.is_none() {
        tracing::warn!("no home folder: nothing is cached");
    }
    folder.map(|dirs| dirs.cache_dir().to_path_buf())
}

/// Whether an unfinished file of this age is from a killed process: running writers take seconds.
fn is_abandoned(age: SystemTime) -> bool {
    let an_hour = Duration::from_secs(3600);
    SystemTime::now()
        .duration_since(age)
        .is_ok_and(|age| age > an_hour)
}

fn remove(path: &Path) {
    if let Err(error) = fs::remove_file(path) {
        tracing::debug!(path = %path.display(), %error, "cache entry not removed");
    }
}

fn write_whole(
    folder: &Path,
    path: &Path,
    write: impl FnOnce(&mut fs::File) -> io::Result<()>,
) -> io::Result<()> {
    let suffix = format!(".{UNFINISHED}");
    let mut file = tempfile::Builder::new()
        .prefix(TEMPORARY)
        .suffix(&suffix)
        .tempfile_in(folder)?;
    write(file.as_file_mut())?;
    file.persist(path).map_err(|e| e.error)?;
    Ok(())
}

/// Reads an entry and marks it as used; `None` if it is damaged or belongs to another key.
fn read(path: &Path, key: &CacheKey) -> Option<Arrays> {
    let bytes = match read_file(path, InputKind::Arrays) {
        Ok(bytes) => bytes,
        Err(error) => {
            let is_missing = |source: &io::Error| source.kind() == io::ErrorKind::NotFound;
            if !matches!(&error, Error::Io { source, .. } if is_missing(source)) {
                tracing::warn!(path = %path.display(), %error, "cache not read");
            }
            return None;
        }
    };
    let expected = [&MAGIC[..], &key.digest()].concat();
    let (head, rest) = bytes.split_at_checked(expected.len())?;
    let (hash, payload) = rest.split_at_checked(blake3::OUT_LEN)?;
    if head != expected || seal(key, payload) != hash {
        tracing::warn!(path = %path.display(), "cache entry is damaged or another's, computing again");
        return None;
    }
    if let Ok(file) = fs::File::options().append(true).open(path) {
        // If this fails, only the order of eviction suffers.
        let _ = file.set_modified(SystemTime::now());
    }
    Arrays::from_bytes(payload)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrays(value: f64) -> Arrays {
        let mut arrays = Arrays::default();
        arrays.insert_f64("x", &[2, 1], vec![value, -value]);
        arrays
    }

    fn key(name: &str) -> CacheKey {
        CacheKey::new("test", 1).text(name)
    }

    fn cache() -> (tempfile::TempDir, Cache) {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(&CachePolicy::Folder(folder.path().join("a/b")));
        (folder, cache)
    }

    impl Cache {
        fn get_or_compute(
            &self,
            key: &CacheKey,
            compute: impl FnOnce() -> Result<Arrays>,
        ) -> Result<Arrays> {
            self.get_or_make(key, Some, Arrays::clone, compute)
        }
    }

    fn must_not_run() -> Result<Arrays> {
        Err(Error::Numerics("computed although kept".into()))
    }

    fn files(cache: &Cache) -> Vec<PathBuf> {
        let folder = cache.folder.as_ref().unwrap();
        let files = fs::read_dir(folder).unwrap();
        let files = files.map(|file| file.unwrap().path());
        files.filter(|path| !path.ends_with(MARK)).collect()
    }

    #[test]
    fn the_second_question_is_answered_from_disk() {
        let (_folder, cache) = cache();
        let first = cache.get_or_compute(&key("a"), || Ok(arrays(1.5))).unwrap();
        assert_eq!(
            first,
            cache.get_or_compute(&key("a"), must_not_run).unwrap()
        );
        assert!(cache.get_or_compute(&key("b"), must_not_run).is_err());
        assert_eq!(files(&cache).len(), 1);
    }

    #[test]
    fn keys_differ_with_kind_version_content_and_borders() {
        let names: std::collections::BTreeSet<_> = [
            CacheKey::new("a", 1),
            CacheKey::new("b", 1),
            CacheKey::new("a", 2),
            CacheKey::new("a", 1).text("x").text(""),
            CacheKey::new("a", 1).text("").text("x"),
            CacheKey::new("a", 1).f32s(&[0.0]),
            CacheKey::new("a", 1).f32s(&[-0.0]),
            CacheKey::new("a", 1).u32s(&[1, 2]),
            CacheKey::new("a", 1).f64s(&[1.0]),
        ]
        .iter()
        .map(CacheKey::file_name)
        .collect();
        assert_eq!(names.len(), 9);
    }

    #[test]
    fn damaged_entries_are_computed_again() {
        for damage in ["cut", "bit", "empty", "magic"] {
            let (_folder, cache) = cache();
            cache.get_or_compute(&key("a"), || Ok(arrays(1.0))).unwrap();
            let path = files(&cache).remove(0);
            let mut bytes = fs::read(&path).unwrap();
            match damage {
                "cut" => bytes.truncate(bytes.len() - 1),
                "bit" => *bytes.last_mut().unwrap() ^= 1,
                "empty" => bytes.clear(),
                _ => bytes[7] = b'0',
            }
            fs::write(&path, bytes).unwrap();
            let again = cache.get_or_compute(&key("a"), || Ok(arrays(2.0))).unwrap();
            assert_eq!(again, arrays(2.0), "{damage}");
            assert_eq!(
                cache.get_or_compute(&key("a"), must_not_run).unwrap(),
                arrays(2.0)
            );
        }
    }

    #[test]
    fn an_unusable_folder_costs_only_time() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "in the way").unwrap();
        for policy in [
            CachePolicy::Folder(file.join("inside")),
            CachePolicy::Folder(file.clone()),
            CachePolicy::Off,
        ] {
            let cache = Cache::new(&policy);
            for value in [1.0, 2.0] {
                assert_eq!(
                    cache
                        .get_or_compute(&key("a"), || Ok(arrays(value)))
                        .unwrap(),
                    arrays(value)
                );
            }
        }
        assert_eq!(fs::read(&file).unwrap(), b"in the way");
    }

    #[test]
    fn an_entry_under_the_name_of_another_is_a_miss() {
        let (_folder, cache) = cache();
        for (name, value) in [("a", 1.0), ("b", 2.0)] {
            cache
                .get_or_compute(&key(name), || Ok(arrays(value)))
                .unwrap();
        }
        let path = |name| cache.folder.as_ref().unwrap().join(key(name).file_name());
        fs::copy(path("a"), path("b")).unwrap();
        assert!(cache.get_or_compute(&key("b"), must_not_run).is_err());
        // A key in front of another entry's payload does not make it valid.
        let mut bytes = fs::read(path("a")).unwrap();
        bytes[MAGIC.len()..][..32].copy_from_slice(&key("b").digest());
        fs::write(path("b"), bytes).unwrap();
        assert!(cache.get_or_compute(&key("b"), must_not_run).is_err());
        let again = cache.get_or_compute(&key("b"), || Ok(arrays(3.0))).unwrap();
        assert_eq!(again, arrays(3.0));
        assert_eq!(
            cache.get_or_compute(&key("b"), must_not_run).unwrap(),
            arrays(3.0)
        );
    }

    #[test]
    fn what_killed_processes_left_goes_at_the_next_start() {
        let (_folder, cache) = cache();
        let folder = cache.folder.clone().unwrap();
        fs::create_dir_all(&folder).unwrap();
        for (name, age_s) in [
            (".tmpaB3xyZ.part", 4000),
            (".tmpyoung0.part", 30),
            ("film.mkv.part", 4000),
            (".tmp-notes.part", 4000),
            ("old.txt", 4000),
        ] {
            let file = fs::File::create(folder.join(name)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age_s))
                .unwrap();
        }
        let _next = Cache::new(&CachePolicy::Folder(folder));
        let mut left: Vec<_> = files(&cache)
            .iter()
            .map(|p| p.file_name().unwrap().to_owned())
            .collect();
        left.sort();
        assert_eq!(
            left,
            [
                ".tmp-notes.part",
                ".tmpyoung0.part",
                "film.mkv.part",
                "old.txt"
            ]
        );
    }

    #[test]
    fn a_folder_of_others_is_no_cache_and_an_old_cache_is() {
        let (_folder, cache) = cache();
        let folder = cache.folder.clone().unwrap();
        let policy = CachePolicy::Folder(folder.clone());
        // It does not exist, is empty, is a cache.
        policy.check().unwrap();
        fs::create_dir_all(&folder).unwrap();
        policy.check().unwrap();
        cache.get_or_compute(&key("a"), || Ok(arrays(1.0))).unwrap();
        let film = folder.join("film.mkv.part");
        fs::write(&film, "x").unwrap();
        policy.check().unwrap();
        // A cache of an earlier version has no mark. Beside files of others it is refused.
        fs::remove_file(folder.join(MARK)).unwrap();
        let error = policy.check().unwrap_err().to_string();
        assert!(error.contains("holds film.mkv.part"), "{error}");
        fs::remove_file(film).unwrap();
        policy.check().unwrap();
        // The mark of another program says nothing.
        fs::write(
            folder.join(MARK),
            "Signature: 8a477f597d28d172789f06886806bc55\n",
        )
        .unwrap();
        assert!(policy.check().is_err());
    }

    #[test]
    fn eviction_leaves_files_of_others() {
        let (_folder, cache) = cache();
        let folder = cache.folder.clone().unwrap();
        fs::create_dir_all(&folder).unwrap();
        let others = ["mine.anyface-cache", "film.mkv.part", "notes.txt"];
        for name in others {
            let file = fs::File::create(folder.join(name)).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH).unwrap();
        }
        let small = cache.with_max_bytes(0);
        for name in ["a", "b"] {
            small
                .get_or_compute(&key(name), || Ok(arrays(1.0)))
                .unwrap();
        }
        assert!(others.iter().all(|name| folder.join(name).exists()));
        assert_eq!(files(&small).len(), others.len() + 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_read_only_folder_still_answers() {
        use std::os::unix::fs::PermissionsExt;
        let (_folder, cache) = cache();
        cache.get_or_compute(&key("a"), || Ok(arrays(1.0))).unwrap();
        let folder = cache.folder.clone().unwrap();
        fs::set_permissions(&folder, fs::Permissions::from_mode(0o555)).unwrap();
        assert_eq!(
            cache.get_or_compute(&key("a"), must_not_run).unwrap(),
            arrays(1.0)
        );
        assert_eq!(
            cache.get_or_compute(&key("b"), || Ok(arrays(2.0))).unwrap(),
            arrays(2.0)
        );
        fs::set_permissions(&folder, fs::Permissions::from_mode(0o755)).unwrap();
    }

    #[test]
    fn a_disk_that_fills_up_leaves_no_part_behind() {
        let (folder, _) = cache();
        let path = folder.path().join("entry");
        let error = write_whole(folder.path(), &path, |file| {
            file.write_all(&[0; 1000])?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert_eq!(error.unwrap_err().kind(), io::ErrorKind::StorageFull);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn the_least_recently_used_entries_go_first() {
        let (_folder, cache) = cache();
        for name in ["a", "b", "c"] {
            cache
                .get_or_compute(&key(name), || Ok(arrays(1.0)))
                .unwrap();
        }
        let size = fs::metadata(&files(&cache)[0]).unwrap().len();
        let folder = cache.folder.clone().unwrap();
        for (name, age_s) in [("a", 30), ("b", 20), ("c", 10)] {
            let file = fs::File::options()
                .append(true)
                .open(folder.join(key(name).file_name()))
                .unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age_s))
                .unwrap();
        }
        // Reading "a" makes it the youngest, so "b" makes room for "d".
        cache.get_or_compute(&key("a"), must_not_run).unwrap();
        let bounded = cache.clone().with_max_bytes(3 * size);
        bounded
            .get_or_compute(&key("d"), || Ok(arrays(1.0)))
            .unwrap();
        for name in ["a", "c", "d"] {
            cache.get_or_compute(&key(name), must_not_run).unwrap();
        }
        assert!(cache.get_or_compute(&key("b"), must_not_run).is_err());
        // The newest entry stays even if it alone is too large.
        cache
            .with_max_bytes(0)
            .get_or_compute(&key("e"), || Ok(arrays(1.0)))
            .unwrap();
        assert_eq!(files(&bounded).len(), 1);
    }
}
