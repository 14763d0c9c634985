//! Lists the code that per-mesh work depends on, and hashes it. The build script writes the hash
//! into the library. A test checks which changes alter it.

use std::{fs, io, path::Path};

/// Folders with everything in them. Speech is not among them: a change there leaves the cached
/// meshes of a user valid.
pub const SOURCES: [&str; 8] = [
    "src/cache",
    "src/face",
    "src/models",
    "src/mesh",
    "src/operators",
    "src/nn",
    "src/deform",
    "src/head",
];

/// The blake3 hash, in hexadecimal, of the names and contents of [`SOURCES`] under `root`.
///
/// # Errors
/// If one of them cannot be read or is missing.
pub fn digest(root: &Path) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    for source in SOURCES {
        add(&root.join(source), source, &mut hasher)
            .map_err(|e| io::Error::other(format!("{source}: {e}")))?;
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Hashes the file or folder at `path` under the name `name`. Each piece is hashed with its length.
fn add(path: &Path, name: &str, hasher: &mut blake3::Hasher) -> io::Result<()> {
    if path.is_dir() {
        let mut entries: Vec<_> = fs::read_dir(path)?.collect::<io::Result<_>>()?;
        entries.sort_by_key(|entry| entry.file_name());
        for entry in entries {
            let name = format!("{name}/{}", entry.file_name().display());
            add(&entry.path(), &name, hasher)?;
        }
        return Ok(());
    }
    for bytes in [name.as_bytes(), &fs::read(path)?] {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    }
    Ok(())
}
