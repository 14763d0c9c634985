//! Prints results, progress and errors for people, or as JSON for programs.

use std::{
    borrow::Cow,
    fmt::Display,
    io::{self, IsTerminal, Write},
    time::Duration,
};

use anyface::{Error, Result, job::Progress, output::Report};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

use crate::signals;

const BAR_STEPS: u64 = 1000;

/// Where results, progress and errors go.
pub struct Console {
    json: bool,
    bar: ProgressBar,
}

impl Console {
    /// A progress bar appears on a terminal only, and never beside JSON.
    pub fn new(json: bool) -> Self {
        let bar = ProgressBar::new(BAR_STEPS);
        if std::io::stderr().is_terminal() && !json {
            let style = ProgressStyle::with_template("{msg:>10} {bar:40} {percent:>3} % {elapsed}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(Duration::from_millis(200));
        } else {
            bar.set_draw_target(ProgressDrawTarget::hidden())
        }
        Console { json, bar }
    }

    /// Shows the log of the library on standard error, at the level of `ANYFACE_LOG`. With `--json` it shows nothing unless
    /// `ANYFACE_LOG` is set.
    pub fn listen(&self) {
        let usual = if self.json { "off" } else { "error" };
        let filter = tracing_subscriber::EnvFilter::try_from_env("ANYFACE_LOG")
            .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new(usual));
        // A process can have only one subscriber. If there already is one, it stays.
        let _ = tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(std::io::stderr)
            .try_init();
    }

    /// A progress callback for the library. It cancels the work after a signal to end.
    pub fn progress(&self, progress: Progress) -> bool {
        self.bar.set_message(progress.stage);
        self.bar
            .set_position((progress.fraction * BAR_STEPS as f32) as u64);
        !signals::are_to_end()
    }

    /// Prints the report of a finished run: as JSON with `--json`, otherwise as `summary` and the
    /// warnings.
    ///
    /// # Errors
    /// `Io` if standard output cannot be written to.
    pub fn report(&self, report: &Report, summary: &str) -> Result<()> {
        self.bar.finish_and_clear();
        if self.json {
            return self.json(report);
        }
        print_line(summary)?;
        self.warn(&report.warnings);
        Ok(())
    }

    /// Prints warnings. With `--json` it prints nothing, because the value itself contains them.
    pub fn warn(&self, warnings: &[String]) {
        if !self.json {
            warnings
                .iter()
                .for_each(|warning| print_error_line(&format!("warning: {warning}")));
        }
    }

    /// Prints a note on standard error, as `{"note"}` with `--json`.
    pub fn note(&self, text: &str) {
        self.bar.finish_and_clear();
        if self.json {
            print_error_line(&serde_json::json!({ "note": text }))
        } else {
            print_error_line(&text)
        }
    }

    /// Prints a note on standard error while the progress bar goes on, as `{"note"}` with `--json`.
    pub fn aside(&self, text: &str) {
        self.bar.suspend(|| {
            if self.json {
                print_error_line(&serde_json::json!({ "note": text }))
            } else {
                print_error_line(&text)
            }
        });
    }

    /// Shows how many jobs of a list are done.
    pub fn count(&self, done: usize, total: usize, text: &str) {
        self.bar
            .set_position(BAR_STEPS * done as u64 / total.max(1) as u64);
        self.bar.set_message(clean(text).into_owned());
    }

    /// Prints one line of a continuous result. Returns false if the reader has closed the pipe.
    ///
    /// # Errors
    /// `Io` if standard output cannot be written to.
    pub fn line(text: &str) -> Result<bool> {
        line(text)
    }

    /// Prints `value` as JSON with `--json`, otherwise `text`.
    ///
    /// # Errors
    /// `Io` if standard output cannot be written to.
    pub fn value(&self, value: &impl Serialize, text: &str) -> Result<()> {
        self.bar.finish_and_clear();
        if self.json {
            self.json(value)
        } else {
            print_line(text.trim_end())
        }
    }

    fn json(&self, value: &impl Serialize) -> Result<()> {
        let text = serde_json::to_string_pretty(value).map_err(io::Error::from);
        print_line(&text.map_err(Error::io(STANDARD_OUTPUT))?)
    }

    /// Prints an error, as `{"error": {"kind", "code", "message"}}` with `--json`.
    pub fn error(&self, error: &Error) {
        self.bar.finish_and_clear();
        print_error_line(&error_text(error, self.json));
    }
}

/// The text of an error for standard error: a line for people, or JSON.
pub fn error_text(error: &Error, json: bool) -> String {
    if json {
        let body = serde_json::json!({"error": {
            "kind": kind(error),
            "code": error.exit_code(),
            "message": error.to_string(),
        }});
        body.to_string()
    } else {
        format!("error: {error}")
    }
}

const STANDARD_OUTPUT: &str = "standard output";

/// Prints a line on standard output. A reader that closes the pipe early, as `head` does, is no
/// error.
///
/// # Errors
/// `Io` if the line cannot be written, for example because the disk is full.
fn print_line(text: &str) -> Result<()> {
    line(text).map(|_| ())
}

/// Prints a line on standard output. Returns false if the reader has closed the pipe.
fn line(text: &str) -> Result<bool> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{}", clean(text)).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(false),
        result => result.map(|()| true).map_err(Error::io(STANDARD_OUTPUT)),
    }
}

/// Prints a line on standard error. Ignores a failure, because there is no other place to report
/// it.
pub fn print_error_line(text: &impl Display) {
    let _ = writeln!(io::stderr().lock(), "{}", clean(&text.to_string()));
}

/// Text that cannot steer the terminal on which it appears. Everything that the command prints goes
/// through here, because names in files and names of files may hold such characters.
///
/// Control characters other than line breaks and tabs, and those that turn the direction of
/// writing, become `\u001b` and the like. In the strings of JSON this means the same character.
pub fn clean(text: &str) -> Cow<'_, str> {
    let steers = |letter: char| {
        let is_control = letter.is_control() && !matches!(letter, '\n' | '\t');
        is_control || matches!(letter, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    if !text.contains(steers) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        if steers(letter) {
            out += &format!("\\u{:04x}", u32::from(letter));
        } else {
            out.push(letter);
        }
    }
    Cow::Owned(out)
}

/// The name of an error's kind.
pub fn kind(error: &Error) -> &'static str {
    match error {
        Error::InvalidInput(_) => "invalid_input",
        Error::ShapeMismatch { .. } => "shape_mismatch",
        Error::Audio(_) | Error::DamagedSound(_) => "audio",
        Error::Mesh(_) => "mesh",
        Error::FaceNotFound(_) => "face_not_found",
        Error::Weights(_) => "weights",
        Error::Numerics(_) => "numerics",
        Error::Io { .. } => "io",
        Error::Cancelled => "cancelled",
        Error::OutOfMemory(_) => "out_of_memory",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_steers_a_terminal_is_printed() {
        for (text, expected) in [
            ("Kopf, 頭\tراس\nline", "Kopf, 頭\tراس\nline"),
            ("\u{1b}]0;title\u{7}", r"\u001b]0;title\u0007"),
            ("a\rb\u{7f}\u{9b}31m", r"a\u000db\u007f\u009b31m"),
            ("gpj.\u{202e}exe", r"gpj.\u202eexe"),
        ] {
            assert_eq!(clean(text), expected);
        }
        let json = serde_json::json!({"name": "\u{1b}\u{9b}\u{202e}"});
        let text = serde_json::to_string_pretty(&json).unwrap();
        let read: serde_json::Value = serde_json::from_str(&clean(&text)).unwrap();
        assert_eq!(read, json);
    }
}
