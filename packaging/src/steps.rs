//! Runs commands and prints one line for each: result, name, time. The output goes to a log. If a
//! command fails, the end of its output also goes to the terminal. While a command runs, its last
//! line of output is shown: continuously on a terminal, every half minute elsewhere.

use std::{
    fs::File,
    io::{IsTerminal, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};

use crate::machine::target;

/// Runs commands one after the other and remembers what the test runners counted.
pub struct Steps {
    started: Instant,
    log: File,
    log_path: PathBuf,
    /// Sums over all runners so far.
    pub counts: Counts,
    failures: Vec<String>,
}

/// A command that runs alongside the next steps and has its own log. Dropping it kills the command.
pub struct Started {
    name: String,
    began: Instant,
    log_path: PathBuf,
    child: Child,
}

impl Drop for Started {
    fn drop(&mut self) {
        let _ = self.child.kill();
    }
}

/// What test runners report.
#[derive(Default, Clone, Copy, Debug, PartialEq)]
pub struct Counts {
    /// Tests that passed.
    pub passed: u64,
    /// Tests that failed.
    pub failed: u64,
    /// Tests that could not run here.
    pub ignored: u64,
}

impl Steps {
    /// Starts a list; its log is `target/xtask-<task>.log`.
    pub fn new(task: &str) -> Result<Self> {
        let log_path = target().join(format!("xtask-{task}.log"));
        std::fs::create_dir_all(target())?;
        let log = File::options()
            .create(true)
            .truncate(true)
            .read(true)
            .write(true)
            .open(&log_path)
            .with_context(|| format!("creating {}", log_path.display()))?;
        println!("log: {}", log_path.display());
        Ok(Steps {
            started: Instant::now(),
            log,
            log_path,
            counts: Counts::default(),
            failures: Vec::new(),
        })
    }

    /// Runs a command that must succeed.
    pub fn run(&mut self, name: &str, command: &mut Command) -> Result<String> {
        let (ok, output) = self.execute(name, command)?;
        if !ok {
            print_tail(&output);
            bail!(
                "{name} failed; the whole output is in {}",
                self.log_path.display()
            );
        }
        Ok(output)
    }

    /// Starts a command in the background. [`Steps::join`] waits for it and fails if it failed.
    pub fn start(&mut self, name: &str, command: &mut Command) -> Result<Started> {
        let end = format!("{}.log", name.replace(' ', "-"));
        let log_path = self.log_path.with_extension(end);
        let log = File::create(&log_path)?;
        println!("start    {name}, beside what follows");
        Ok(Started {
            name: name.to_owned(),
            began: Instant::now(),
            child: spawn(name, command, &log)?,
            log_path,
        })
    }

    /// Waits for a command that was started.
    pub fn join(&mut self, mut started: Started) -> Result<()> {
        let status = watch(&started.name, &mut started.child, &started.log_path, 0)?;
        report(&started.name, status, started.began);
        if !status.success() {
            print_tail(&std::fs::read_to_string(&started.log_path)?);
            let log = started.log_path.display();
            bail!("{} failed; the whole output is in {log}", started.name);
        }
        Ok(())
    }

    /// Time since the list began, such as "3 min 05 s".
    pub fn elapsed(&self) -> String {
        clock(self.started.elapsed())
    }

    /// Runs a check. If it fails, the failure is remembered and the other checks still run.
    pub fn check(&mut self, name: &str, command: &mut Command) -> Result<()> {
        let (ok, output) = self.execute(name, command)?;
        let counts = Counts::read(&output);
        self.counts.add(counts);
        if !ok {
            print_tail(&output);
            self.failures.push(name.to_owned());
        }
        Ok(())
    }

    /// Reports that something could not run here.
    pub fn ignore(&mut self, name: &str, why: &str) {
        self.counts.ignored += 1;
        println!("ignored  {name}: {why}");
    }

    /// Prints the closing lines. Returns an error if a check failed.
    pub fn finish(self) -> Result<()> {
        let Counts {
            passed,
            failed,
            ignored,
        } = self.counts;
        println!("took {}", self.elapsed());
        if passed + failed + ignored > 0 {
            println!("{passed} passed, {failed} failed, {ignored} skipped");
        }
        if !self.failures.is_empty() {
            bail!("failed: {}", self.failures.join(", "));
        }
        Ok(())
    }

    fn execute(&mut self, name: &str, command: &mut Command) -> Result<(bool, String)> {
        let began = Instant::now();
        let from = self.log.seek(SeekFrom::End(0))?;
        writeln!(self.log, "\n==== {name}\n{command:?}")?;
        let begun = self.log.stream_position()?;
        let mut child = spawn(name, command, &self.log)?;
        let status = watch(name, &mut child, &self.log_path, begun)?;
        let mut output = Vec::new();
        self.log.seek(SeekFrom::Start(from))?;
        self.log.read_to_end(&mut output)?;
        report(name, status, began);
        Ok((
            status.success(),
            String::from_utf8_lossy(&output).into_owned(),
        ))
    }
}

impl Counts {
    /// Adds up the closing lines of `cargo test` and of pytest.
    pub fn read(output: &str) -> Self {
        let mut counts = Counts::default();
        for line in output.lines().filter(|line| is_closing_line(line)) {
            let words: Vec<&str> = line
                .split([' ', ',', ';', '='])
                .filter(|word| !word.is_empty())
                .collect();
            for pair in words.windows(2) {
                let Ok(number) = pair[0].parse::<u64>() else {
                    continue;
                };
                match pair[1] {
                    "passed" => counts.passed += number,
                    "failed" | "error" | "errors" => counts.failed += number,
                    "ignored" | "skipped" => counts.ignored += number,
                    _ => {}
                }
            }
        }
        counts
    }

    fn add(&mut self, other: Counts) {
        self.passed += other.passed;
        self.failed += other.failed;
        self.ignored += other.ignored;
    }
}

fn spawn(name: &str, command: &mut Command, log: &File) -> Result<Child> {
    command
        .stdin(Stdio::null())
        .stdout(log.try_clone()?)
        .stderr(log.try_clone()?)
        .spawn()
        .with_context(|| format!("starting {name}: {command:?}"))
}

fn report(name: &str, status: ExitStatus, began: Instant) {
    let word = if status.success() { "ok" } else { "FAILED" };
    println!("{word:8} {name} ({})", clock(began.elapsed()));
}

/// Waits for a command and meanwhile shows its last line of output. The output starts at byte
/// `begun` of `log`.
fn watch(name: &str, child: &mut Child, log: &Path, begun: u64) -> Result<ExitStatus> {
    let (began, mut said) = (Instant::now(), Instant::now());
    let spinner = ProgressBar::new_spinner().with_prefix(name.to_owned());
    let style = ProgressStyle::with_template("{spinner} {prefix} ({elapsed}) {wide_msg:.dim}")?;
    spinner.set_style(style);
    let quiet = !std::io::stderr().is_terminal();
    loop {
        if let Some(status) = child.try_wait()? {
            spinner.finish_and_clear();
            return Ok(status);
        }
        if quiet && said.elapsed() >= Duration::from_secs(30) {
            said = Instant::now();
            println!(
                "...      {name} ({}): {}",
                clock(began.elapsed()),
                last_line(log, begun)
            );
        }
        spinner.set_message(last_line(log, begun));
        spinner.tick();
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// The last line of a log from byte `begun` on. Empty if there is none or the log cannot be read.
fn last_line(log: &Path, begun: u64) -> String {
    let mut end = Vec::new();
    // Opens its own handle: seeking in the shared one would change where the command writes.
    if let Ok(mut file) = File::open(log) {
        let size = file.metadata().map_or(0, |data| data.len());
        let _ = file.seek(SeekFrom::Start(size.saturating_sub(1024).max(begun)));
        let _ = file.read_to_end(&mut end);
    }
    let text = String::from_utf8_lossy(&end);
    let line = text
        .rsplit(['\n', '\r'])
        .find(|line| !line.trim().is_empty());
    let words = line.unwrap_or_default().trim();
    words
        .chars()
        .filter(|c| !c.is_control())
        .take(100)
        .collect()
}

fn is_closing_line(line: &str) -> bool {
    let pytest = line.contains(" in ")
        && line.ends_with(['s', '=', ')'])
        && ["passed", "failed", "skipped", "error"]
            .iter()
            .any(|word| line.contains(word))
        && line
            .trim_start_matches(['=', ' '])
            .starts_with(|c: char| c.is_ascii_digit());
    line.starts_with("test result:") || pytest
}

fn print_tail(output: &str) {
    let lines: Vec<&str> = output.lines().collect();
    for line in &lines[lines.len().saturating_sub(80)..] {
        println!("    {line}");
    }
}

fn clock(time: Duration) -> String {
    match time.as_secs() {
        seconds @ 0..60 => format!("{seconds} s"),
        seconds => format!("{} min {:02} s", seconds / 60, seconds % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_line_of_a_log_is_the_last_that_says_something() {
        let path = std::env::temp_dir().join(format!("anyface-last-line-{}", std::process::id()));
        std::fs::write(&path, "first\nrendered 1 of 9\rrendered 2 of 9\r\n\n").unwrap();
        assert_eq!(last_line(&path, 0), "rendered 2 of 9");
        assert_eq!(last_line(&path, 39), "");
        std::fs::remove_file(&path).unwrap();
        assert_eq!(last_line(&path, 0), "");
    }

    #[test]
    fn closing_lines_of_both_runners_are_added_up() {
        let output = "test result: ok. 12 passed; 1 failed; 2 ignored; 0 measured; 0 filtered out\n\
                      test tests::passed ... ok\n\
                      ======= 3 passed, 1 skipped, 2 warnings in 4.20s =======\n\
                      1 failed, 2 passed in 0.1s\n";
        assert_eq!(
            Counts::read(output),
            Counts {
                passed: 17,
                failed: 2,
                ignored: 3
            }
        );
    }
}
