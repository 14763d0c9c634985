//! The headers in `include`, generated from the C interfaces, and Python's table of the functions.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;

use crate::{machine, signatures};

/// A C interface.
pub struct Interface {
    /// Folder of its crate, which holds `cbindgen.toml`.
    folder: &'static str,
    /// Source files in the order in which a reader of the header meets them.
    sources: &'static [&'static str],
    /// Name of the header.
    header: &'static str,
}

/// The library, and the microphone, which is a library of its own.
pub const INTERFACES: [Interface; 2] = [
    Interface {
        folder: "capi",
        sources: LIBRARY,
        header: "anyface.h",
    },
    Interface {
        folder: "microphone",
        sources: &["c"],
        header: "anyface_microphone.h",
    },
];

const LIBRARY: &[&str] = &[
    "version",
    "status",
    "error",
    "progress",
    "engine",
    "mesh",
    "audio",
    "sounds",
    "request",
    "performer",
    "face_request",
    "face",
    "opened_face",
    "text",
    "motion",
    "motion_values",
    "motion_weights",
    "clip",
    "clip_stream",
    "motion_notes",
    "basis",
    "sliders",
    "curves",
    "rig",
    "weights",
    "head",
    "stream",
    "weight_stream",
];

/// Writes the headers in include, and Python's table of the functions.
#[derive(Args)]
pub struct Header {
    /// Write nothing; fail if a committed file differs from what the sources give.
    #[arg(long)]
    check: bool,
}

impl Header {
    /// Writes or checks the files.
    pub fn run(&self) -> Result<()> {
        for (path, fresh) in generated()? {
            if self.check {
                check(&path, &fresh)?
            } else {
                write(&path, &fresh)?
            }
        }
        Ok(())
    }
}

/// All files, with what the sources give.
fn generated() -> Result<Vec<(PathBuf, String)>> {
    let [library, microphone] = &INTERFACES;
    let header = library.generate()?;
    let table = signatures::table(&header)?;
    Ok(vec![
        (library.path(), header),
        (machine::root().join(signatures::PATH), table),
        (microphone.path(), microphone.generate()?),
    ])
}

impl Interface {
    fn path(&self) -> PathBuf {
        machine::root().join("include").join(self.header)
    }

    fn sources(&self) -> PathBuf {
        machine::root().join(self.folder).join("src")
    }

    /// Generates the header with the crate's `cbindgen.toml`.
    ///
    /// # Errors
    /// If the config or a source file cannot be read or parsed.
    fn generate(&self) -> Result<String> {
        let config = machine::root().join(self.folder).join("cbindgen.toml");
        let config = cbindgen::Config::from_file(&config)
            .map_err(|message| anyhow::anyhow!("{}: {message}", config.display()))?;
        let mut builder = cbindgen::Builder::new().with_config(config);
        for stem in self.sources {
            builder = builder.with_src(self.sources().join(format!("{stem}.rs")));
        }
        let bindings = builder.generate();
        let bindings = bindings.with_context(|| format!("reading {}/src", self.folder))?;
        let mut text = Vec::new();
        bindings.write(&mut text);
        String::from_utf8(text).context("the header is not UTF-8")
    }
}

fn write(path: &Path, fresh: &str) -> Result<()> {
    if std::fs::read_to_string(path).is_ok_and(|committed| committed == fresh) {
        println!("{} is up to date", path.display());
        return Ok(());
    }
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    std::fs::write(path, fresh).with_context(|| format!("writing {}", path.display()))?;
    println!("wrote {}", path.display());
    Ok(())
}

/// Fails with the first line that differs.
fn check(path: &Path, fresh: &str) -> Result<()> {
    let committed =
        std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    if committed == fresh {
        return Ok(());
    }
    let mut fresh_lines = fresh.lines();
    let mut number = 1;
    for line in committed.lines() {
        let other = fresh_lines.next();
        if other != Some(line) {
            bail!(
                "{}:{number} is out of date: has {line:?}, the sources give {:?}; run cargo xtask header",
                path.display(),
                other.unwrap_or("nothing more")
            );
        }
        number += 1;
    }
    let more = fresh_lines.next().unwrap_or("other line ends");
    bail!(
        "{}:{number} is out of date: ends, the sources give {more:?}; run cargo xtask header",
        path.display()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_committed_files_are_what_the_sources_give() {
        for (path, fresh) in generated().unwrap() {
            check(&path, &fresh).unwrap();
        }
    }

    #[test]
    fn a_difference_is_found_and_named() {
        let folder = std::env::temp_dir().join(format!("anyface-header-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("anyface.h");
        std::fs::write(&file, "one\ntwo\n").unwrap();
        assert!(check(&file, "one\ntwo\n").is_ok());
        let message = |fresh| check(&file, fresh).unwrap_err().to_string();
        assert!(message("one\n2\n").contains("anyface.h:2"));
        assert!(message("one\ntwo\nthree\n").contains("anyface.h:3"));
        assert!(message("one\n").contains("anyface.h:2"));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn every_exported_function_is_in_its_header() {
        let mut functions = 0;
        for interface in &INTERFACES {
            let header = interface.generate().unwrap();
            for entry in std::fs::read_dir(interface.sources()).unwrap() {
                let source = std::fs::read_to_string(entry.unwrap().path()).unwrap();
                for rest in source.split("extern \"C\" fn anyface_").skip(1) {
                    let name = rest.split('(').next().unwrap();
                    assert!(
                        header.contains(&format!("anyface_{name}(")),
                        "anyface_{name}"
                    );
                    functions += 1;
                }
            }
        }
        assert!(functions > 40, "{functions}");
    }

    #[test]
    fn every_function_and_type_has_a_comment() {
        for interface in &INTERFACES {
            let header = interface.generate().unwrap();
            let lines: Vec<&str> = header.lines().collect();
            let bare: Vec<&str> = lines
                .windows(2)
                .filter(|pair| is_declaration(pair[1]) && !pair[0].starts_with("///"))
                .map(|pair| pair[1])
                .collect();
            assert!(bare.is_empty(), "{bare:?}");
        }
    }

    fn is_declaration(line: &str) -> bool {
        let function = line.contains(" anyface_") && line.contains('(') && !line.starts_with(' ');
        function || line.starts_with("typedef struct") || line.starts_with("#define ANYFACE_A")
    }
}
