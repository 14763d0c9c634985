//! Finds which file a path means, however it is spelled.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// More links in a row than this are taken for a circle.
const MAX_LINKS: usize = 40;

/// Identifies the file that a path names.
///
/// Paths of one file have equal places, whatever their spelling or links. Files that do not exist
/// yet also have equal places where their names differ only in case, because some file systems
/// ignore case.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Place {
    /// An existing file, by its device and inode.
    #[cfg(unix)]
    File {
        /// Number of the device.
        device: u64,
        /// Number of the file on it.
        inode: u64,
    },
    /// An existing file, by its canonical path.
    #[cfg(not(unix))]
    File(PathBuf),
    /// A file that does not exist yet.
    New {
        /// The folder that it will lie in.
        folder: PathBuf,
        /// Its name in lower case.
        name: String,
    },
}

impl Place {
    /// The place of a path. A link means the file that it points to.
    pub fn of(path: &Path) -> Place {
        let path = follow(path);
        existing(&path).unwrap_or_else(|| {
            let folder = folder_of(&path);
            let name = path.file_name().unwrap_or_default();
            Place::New {
                folder: folder.canonicalize().unwrap_or_else(|_| folder.to_owned()),
                name: name.to_string_lossy().to_lowercase(),
            }
        })
    }

    /// The file that a result of this name would replace or make, if the name is a link that leads to
    /// another folder.
    pub fn beyond_link(path: &Path) -> Option<PathBuf> {
        let target = follow(path);
        let folder = |path: &Path| folder_of(path).canonicalize().ok();
        (folder(&target) != folder(path)).then_some(target)
    }

    /// Whether a file exists and lies in a folder, however deep.
    pub fn is_inside(file: &Path, folder: &Path) -> bool {
        let real = (file.canonicalize(), folder.canonicalize());
        matches!(real, (Ok(file), Ok(folder)) if file != folder && file.starts_with(&folder))
    }
}

#[cfg(unix)]
fn existing(path: &Path) -> Option<Place> {
    use std::os::unix::fs::MetadataExt;
    let metadata = fs::metadata(path).ok()?;
    let (device, inode) = (metadata.dev(), metadata.ino());
    Some(Place::File { device, inode })
}

#[cfg(not(unix))]
fn existing(path: &Path) -> Option<Place> {
    path.canonicalize().ok().map(Place::File)
}

/// The target of a link, even if nothing is there yet. Any other path stays as it is.
pub(super) fn follow(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        match fs::read_link(&path) {
            Ok(target) => path = folder_of(&path).join(target),
            Err(_) => break,
        }
    }
    path
}

/// The folder in which `path` lies.
pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spellings_of_a_file_have_one_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let long = folder.path().join(".").join("a.npz");
        assert_eq!(Place::of(&path), Place::of(&long));
        let other = folder.path().join("A.npz");
        assert_eq!(Place::of(&path), Place::of(&other));
        assert_ne!(Place::of(&path), Place::of(&folder.path().join("b.npz")));
        fs::write(&path, b"a").unwrap();
        assert_eq!(Place::of(&path), Place::of(&long));
        assert!(Place::is_inside(&long, folder.path()));
        assert!(!Place::is_inside(folder.path(), folder.path()));
    }

    #[cfg(unix)]
    #[test]
    fn links_lead_to_the_place_of_their_file() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let [file, soft, hard, dangling] =
            ["a.npz", "soft", "hard", "dangling"].map(|name| folder.path().join(name));
        fs::write(&file, b"a").unwrap();
        symlink("a.npz", &soft).unwrap();
        fs::hard_link(&file, &hard).unwrap();
        symlink("b.npz", &dangling).unwrap();
        assert_eq!(Place::of(&soft), Place::of(&file));
        assert_eq!(Place::of(&hard), Place::of(&file));
        assert_eq!(
            Place::of(&dangling),
            Place::of(&folder.path().join("b.npz"))
        );
        assert_eq!(Place::beyond_link(&soft), None);
        let outside = folder.path().join("outside");
        symlink("../c.npz", &outside).unwrap();
        assert!(Place::beyond_link(&outside).unwrap().ends_with("../c.npz"));
    }
}
