//! `anyface batch`: many lines of speech on one face, or on a few, in one process.
//!
//! The batch prepares each face and its shapes once. Then each thread does one line at a time. A row that fails does not
//! stop the others. A later run skips the rows that are finished.

mod attention;
mod export;
mod faces;
mod ledger;
mod line;
mod lips;
mod path_map;
mod picture;
mod plan;
mod results;
mod rows;
mod table_text;
mod work;

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    path::PathBuf,
    str::FromStr,
    sync::atomic::{AtomicUsize, Ordering},
    time::{Instant, SystemTime, UNIX_EPOCH},
};

use anyface::{Error, Result, job::Receipts};
use clap::Args;

use crate::{arguments::SharedArgs, console::Console, paths::InputPath, signals};
use export::{ExportArgs, NodeCommand};
use faces::Faces;
use ledger::{Digests, Entry, Failure, FileState, Ledger, SOME_FAILED};
use path_map::PathMap;
use plan::{Needs, duration};
use results::Summary;
use rows::{Defaults, Row};
use work::Done;

/// Exit code and kind of failure for a row that panicked.
const DEFECT: (u8, &str) = (10, "internal");
/// Stack of a thread that does lines.
const STACK_BYTES: usize = 8 << 20;

/// Animate many lines of speech on one face, from a table with one row for each line
#[derive(Args)]
pub struct Batch {
    /// The lines of speech: a .csv or .tsv table with a header, as spreadsheets save it (commas, semicolons or tabs). It needs the columns audio and out. It may also have
    /// the column name and one for each option of `animate` that is listed below. A column whose name begins with # holds
    /// notes. Relative paths start at the folder of this table. The ending of out chooses the kind of result: .csv or .json
    /// for weights of the mesh's ARKit shapes over time; .npz, .pc2, .mdd, .glb, .vrm, .usda or .vrma as `animate` writes them
    #[arg(value_name = "LINES")]
    lines: InputPath,
    /// Do only these rows, as in 1-500 or 7. Row 1 is the first one below the header
    #[arg(long, value_name = "A-B")]
    rows: Option<RowRange>,
    /// A folder in the table's paths that has another name on this machine. May be repeated. If
    /// only one of the two is a Windows path, the one that suits this system is opened, whichever
    /// of them a row has. Otherwise TO is opened
    #[arg(long, value_name = "FROM=TO")]
    map: Vec<PathMap>,
    /// Also redo the rows that are finished
    #[arg(long)]
    again: bool,
    /// Print what would be done, and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Only write the page and the summary of what all processes have done. A run with --rows
    /// writes neither, because other processes may still be doing other rows
    #[arg(long, conflicts_with_all = ["rows", "again", "dry_run"])]
    sum: bool,
    #[command(flatten)]
    export: ExportArgs,
    #[command(flatten)]
    defaults: Defaults,
}

/// First and last row number, both inclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct RowRange {
    first: usize,
    last: usize,
}

impl FromStr for RowRange {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let (first, last) = text.split_once('-').unwrap_or((text, text));
        match (first.trim().parse(), last.trim().parse()) {
            (Ok(first), Ok(last)) if 1 <= first && first <= last => Ok(RowRange { first, last }),
            _ => Err(format!(
                "expected rows from 1 on, as in 1-500 or 7, got {text:?}"
            )),
        }
    }
}

/// The rows of a batch, and which of them are still to do.
struct Job<'a> {
    rows: &'a [Row],
    /// The digest of each row, in the order of the rows.
    digests: &'a [String],
    ledger: &'a Ledger,
    faces: &'a Faces,
    /// Indices of the rows to do, in the order in which threads take them.
    waiting: &'a [usize],
    console: &'a Console,
}

/// Rows that this run has done, and how many of them failed.
#[derive(Default)]
struct Counts {
    done: AtomicUsize,
    failed: AtomicUsize,
}

impl Batch {
    /// Runs the command. Returns the exit code.
    pub fn run(&self, shared: &SharedArgs, console: &Console) -> Result<u8> {
        let started = Instant::now();
        let folder = self.reports();
        let pages = results::paths(&folder);
        let rows = rows::read(&self.lines, &self.defaults, &self.map, &pages)?;
        let chosen = self.chosen(&rows)?;
        let ledger = Ledger::open(&folder)?;
        if self.export.is_on() {
            return self.hand_over(&rows, &ledger, console);
        }
        let mut digests = Digests::default();
        let digests: Vec<String> = rows.iter().map(|row| digests.of(row)).collect();
        let is_left = |at: &usize| {
            let row: &Row = &rows[*at];
            self.again || !ledger.is_finished(row, &digests[*at])
        };
        let mut waiting: Vec<usize> = chosen.clone().filter(is_left).collect();
        let finished_before = chosen.len() - waiting.len();
        if self.sum {
            waiting.clear();
        }
        // Sorts the rows so that those of one face follow each other.
        waiting.sort_by(|a, b| rows[*a].face.cmp(&rows[*b].face).then(a.cmp(b)));
        let threads = threads(shared);
        if self.dry_run {
            return plan::tell(
                &rows,
                &waiting,
                (finished_before, threads),
                &ledger,
                console,
            );
        }
        let receipts = Receipts::new(Some(folder.clone()));
        pages.iter().try_for_each(|path| receipts.derive(path))?;
        let faces = Faces::default();
        let job = Job {
            rows: &rows,
            digests: &digests,
            ledger: &ledger,
            faces: &faces,
            waiting: &waiting,
            console,
        };
        let counts = job.run(threads)?;
        let seconds = started.elapsed().as_secs_f64();
        let done = counts.done.into_inner();
        let mut summary = Summary {
            rows: rows.len(),
            ok: 0,
            failed: Vec::new(),
            left: 0,
            finished_before,
            done,
            seconds,
            lines_per_s: done as f64 / seconds,
            warnings: job.warnings(),
            results: None,
        };
        if self.sum {
            faces.prepare(&rows, &|_| !signals::are_to_end());
        }
        // With --rows, other processes may be doing other rows. The summary and the page then wait
        // for --sum.
        let faces = self.rows.is_none().then_some(&faces);
        results::write(&folder, &rows, &digests, faces, &mut summary)?;
        if signals::are_to_end() {
            return Err(Error::Cancelled);
        }
        console.value(&summary, &text(&summary))?;
        Ok(match counts.failed.into_inner() {
            0 => 0,
            _ => SOME_FAILED,
        })
    }

    /// Writes the job files for the engine of a render farm.
    fn hand_over(&self, rows: &[Row], ledger: &Ledger, console: &Console) -> Result<u8> {
        let needs = Needs::of_all(rows, ledger, self.export.threads())?;
        let maps = self.map.iter().map(|map| format!("--map={map}"));
        let threads = format!("--threads={}", self.export.threads());
        let words = self.defaults.words().into_iter();
        let node = NodeCommand {
            table: &self.lines,
            options: words.chain(maps).chain([threads]).collect(),
            rows: rows.len(),
        };
        self.export.run(&node, &needs, console)?;
        Ok(0)
    }

    /// Indices of the rows that --rows chooses, or of all rows.
    fn chosen(&self, rows: &[Row]) -> Result<std::ops::Range<usize>> {
        let Some(RowRange { first, last }) = self.rows else {
            return Ok(0..rows.len());
        };
        if first <= rows.len() {
            Ok(first - 1..last.min(rows.len()))
        } else {
            Err(Error::InvalidInput(format!(
                "--rows {first}-{last}: expected some of {} rows",
                rows.len()
            )))
        }
    }

    /// `lines.csv` → `lines.reports`.
    fn reports(&self) -> PathBuf {
        self.lines.with_extension("reports")
    }
}

/// How many lines run at once: --threads, or one for each core.
fn threads(shared: &SharedArgs) -> usize {
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    shared.threads().unwrap_or_else(cores)
}

fn text(summary: &Summary) -> String {
    let Summary {
        rows,
        ok,
        failed,
        left,
        finished_before,
        done,
        seconds,
        lines_per_s,
        results,
        ..
    } = summary;
    let mut text = format!(
        "{ok} of {rows} lines are finished; {done} done now in {seconds:.1} s ({lines_per_s:.1} a second), \
         {finished_before} before"
    );
    if !failed.is_empty() {
        text += &format!(", {} failed", failed.len());
    }
    if *left > 0 {
        text += &format!(", {left} not yet done");
    }
    text + &match results {
        Some(page) => format!("; see {page}"),
        None => "; --sum writes the page when all rows are done".to_owned(),
    }
}

impl Job<'_> {
    /// Does all waiting rows on this number of threads.
    fn run(&self, threads: usize) -> Result<Counts> {
        let (next, counts, started) = (AtomicUsize::new(0), Counts::default(), Instant::now());
        self.prepare_first();
        let work = || {
            loop {
                let at = next.fetch_add(1, Ordering::Relaxed);
                let Some(at) = self.waiting.get(at).filter(|_| !signals::are_to_end()) else {
                    return;
                };
                self.close(*at, &counts);
                self.show(&counts, started);
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..threads.min(self.waiting.len()) {
                let thread = std::thread::Builder::new().stack_size(STACK_BYTES);
                let spawned = thread.spawn_scoped(scope, || match alone() {
                    Ok(pool) => pool.install(work),
                    Err(_) => work(),
                });
                spawned.map_err(|error| {
                    Error::OutOfMemory(format!("expected room for a thread, got none ({error})"))
                })?;
            }
            Ok(())
        })?;
        Ok(counts)
    }

    /// Prepares the face of the first row before the threads start, so that all cores can work on it.
    fn prepare_first(&self) {
        let rows = self.waiting.iter().map(|at| &self.rows[*at]);
        let first = rows.filter_map(|row| Some((row, row.line.as_ref().ok()?)));
        if let Some((row, line)) = first.take(1).next() {
            let progress = |p| self.console.progress(p);
            let ready = self.faces.ready(row, line, self.rows, &progress);
            for warning in ready.iter().flat_map(|ready| &ready.warnings) {
                self.console.aside(&format!("warning: {warning}"));
            }
        }
    }

    /// The warnings of all faces that are still in memory, each once.
    fn warnings(&self) -> Vec<String> {
        let faces = self.waiting.iter();
        let faces = faces.filter_map(|at| self.faces.at_hand(&self.rows[*at]));
        let mut warnings: Vec<String> = faces.flat_map(|ready| ready.warnings.clone()).collect();
        warnings.sort();
        warnings.dedup();
        warnings
    }

    /// Does one row and writes how it ended to the ledger. A row that was cancelled gets no entry.
    fn close(&self, at: usize, counts: &Counts) {
        let row = &self.rows[at];
        let started = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| self.perform(row)));
        let result = result.unwrap_or_else(|panic| Err(defect(panic.as_ref())));
        let cancelled = Error::Cancelled.exit_code();
        if result.as_ref().is_err_and(|f| f.exit_code == cancelled) {
            return;
        }
        let mut entry = Entry {
            name: row.name.clone(),
            seconds: (1e3 * started.elapsed().as_secs_f64()).round() / 1e3,
            at: since_1970_s(),
            host: gethostname::gethostname().to_string_lossy().into_owned(),
            pid: std::process::id(),
            digest: self.digests[at].clone(),
            ..Entry::default()
        };
        match result {
            Ok(done) => note(&mut entry, row, done),
            Err(failure) => {
                counts.failed.fetch_add(1, Ordering::Relaxed);
                let (number, name, why) = (row.number, &row.name, &failure.message);
                self.console.aside(&format!("row {number}, {name}: {why}"));
                (entry.kind, entry.exit_code) = (failure.kind, failure.exit_code);
                entry.message = failure.message;
            }
        }
        counts.done.fetch_add(1, Ordering::Relaxed);
        if let Err(error) = self.ledger.append(&entry) {
            let message = format!("{}: its end could not be noted: {error}", row.name);
            counts.failed.fetch_add(1, Ordering::Relaxed);
            self.console.aside(&message);
        }
    }

    fn perform(&self, row: &Row) -> std::result::Result<Done, Failure> {
        let line = row.line.as_ref().map_err(Failure::from)?;
        let progress = &|_| !signals::are_to_end();
        let ready = self.faces.ready(row, line, self.rows, progress)?;
        work::perform(line, &ready, progress).map_err(|error| Failure::from(&error))
    }

    fn show(&self, counts: &Counts, started: Instant) {
        let done = counts.done.load(Ordering::Relaxed);
        let (total, per_s) = (
            self.waiting.len(),
            done as f64 / started.elapsed().as_secs_f64(),
        );
        let left_s = (total - done) as f64 / per_s.max(1e-9);
        let text = format!("{done}/{total}, {per_s:.1}/s, {} left", duration(left_s));
        self.console.count(done, total, &text);
    }
}

/// Makes a thread pool of only the calling thread. The parallel loops of a line then stay on its
/// thread, because the other threads are busy with other lines.
fn alone() -> std::result::Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
    let builder = rayon::ThreadPoolBuilder::new().num_threads(1);
    builder.use_current_thread().build()
}

fn note(entry: &mut Entry, row: &Row, done: Done) {
    let report = done.report;
    entry.ok = true;
    entry.message = format!("{} frames at {} fps", report.frames, report.fps);
    entry.warnings = report.warnings;
    entry.duration_s = report.audio_s.unwrap_or_default();
    entry.memory_mb = report.memory_mb;
    let out = row.outputs.first();
    entry.out = out.map_or_else(String::new, |out| out.display().to_string());
    entry.result = out.and_then(|out| FileState::of(out));
    entry.lips = Some(done.lips);
    entry.gap = Some(done.gap);
    entry.wave = done.wave;
}

/// The failure of a row whose code panicked, with the panic's message.
fn defect(panic: &(dyn std::any::Any + Send)) -> Failure {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    let (exit_code, kind) = DEFECT;
    Failure {
        kind: kind.to_owned(),
        exit_code,
        message: format!(
            "a defect of anyface, please report it with this line: {}",
            text.unwrap_or("no words")
        ),
    }
}

fn since_1970_s() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    (1e3 * since.unwrap_or_default().as_secs_f64()).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_rows_are_read_and_odd_ones_refused() {
        let range = |first, last| Ok(RowRange { first, last });
        assert_eq!("1-500".parse(), range(1, 500));
        assert_eq!("7".parse(), range(7, 7));
        for text in ["0-3", "5-2", "", "a-b", "-3", "1-2-3"] {
            assert!(text.parse::<RowRange>().is_err(), "{text}");
        }
    }
}
