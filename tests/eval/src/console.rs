//! Prints results and progress for a person or a program.

use std::{io::Write, path::Path};

use anyface::{Error, Result, job::write_atomically};
use serde::Serialize;

/// Prints results and progress.
pub(super) struct Console {
    json: bool,
}

impl Console {
    /// With `json`, results are printed as JSON and progress is not reported.
    pub(super) fn new(json: bool) -> Self {
        Console { json }
    }

    /// Reports what is being measured and the share of the run that is done, 0 to 1.
    pub(super) fn stage(&self, name: &str, fraction: f32) {
        if !self.json {
            eprintln!("{:>3.0} % {name}", 100.0 * fraction);
        }
    }

    /// Prints `value` as JSON, or `text`.
    pub(super) fn value(&self, value: &impl Serialize, text: &str) {
        match (self.json, serde_json::to_string_pretty(value)) {
            (false, _) => println!("{}", text.trim_end()),
            (true, Ok(json)) => println!("{json}"),
            (true, Err(error)) => eprintln!("error: {error}"),
        }
    }
}

/// Writes a page, and its numbers as JSON next to it.
pub(super) fn write_page(path: &Path, page: &str, numbers: &impl Serialize) -> Result<()> {
    let json = serde_json::to_string_pretty(numbers)
        .map_err(|e| Error::Numerics(format!("numbers as JSON: {e}")))?;
    write_atomically(path, |file| file.write_all(page.as_bytes()))?;
    write_atomically(&path.with_extension("json"), |file| {
        writeln!(file, "{json}")
    })
}

/// The command as typed in the repository's root.
pub(super) fn command_line() -> String {
    let words: Vec<String> = std::env::args().skip(1).collect();
    format!("cargo measure {}", words.join(" "))
}
