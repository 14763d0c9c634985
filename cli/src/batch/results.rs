//! What a batch leaves behind: a summary for machines and a page for people.

use std::{
    collections::{HashMap, HashSet},
    io::Write,
    path::{Path, PathBuf},
};

use anyface::{
    Error, Result,
    job::{InputKind, read_file, write_atomically, write_json},
};
use serde::Serialize;

use super::{
    attention::attention,
    faces::Faces,
    ledger::{Entry, HISTORY, Ledger, each_entry},
    lips::Gap,
    picture::Portrait,
    rows::Row,
};

/// The page has curves and pictures for this many rows: those that most need a human eye.
const SHOWN: usize = 100;
/// The most pictures of a row.
const PICTURES: usize = 3;
/// The page. The rows replace the placeholder [`ROWS`].
const PAGE: &str = include_str!("../../farm/results.html");
const ROWS: &str = "{{ROWS}}";

/// The paths of the summary and of the page.
pub fn paths(folder: &Path) -> [PathBuf; 2] {
    ["batch.json", "results.html"].map(|name| folder.join(name))
}

/// One row of the summary and the page.
#[derive(Serialize)]
struct Shown {
    #[serde(flatten)]
    entry: Entry,
    /// How much it needs a human eye, and why.
    attention: f64,
    reasons: Vec<String>,
    /// Only the page has these.
    #[serde(skip)]
    pictures: Vec<String>,
}

/// What the page needs of a row. It leaves out the rest, so that a page of ten thousand rows stays small.
#[derive(Serialize)]
struct PageRow<'a> {
    name: &'a str,
    ok: bool,
    message: &'a str,
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    warnings: &'a [String],
    seconds: f64,
    host: &'a str,
    duration_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    gap: &'a Option<Gap>,
    #[serde(skip_serializing_if = "<[f32]>::is_empty")]
    wave: &'a [f32],
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    pictures: &'a [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    memory_mb: Option<u64>,
    out: &'a str,
    attention: f64,
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    reasons: &'a [String],
}

impl Shown {
    fn on_page(&self) -> PageRow<'_> {
        let Entry {
            name,
            ok,
            message,
            warnings,
            seconds,
            host,
            duration_s,
            gap,
            wave,
            memory_mb,
            out,
            ..
        } = &self.entry;
        PageRow {
            name,
            ok: *ok,
            message,
            warnings,
            seconds: *seconds,
            host,
            duration_s: *duration_s,
            gap,
            wave,
            pictures: &self.pictures,
            memory_mb: *memory_mb,
            out,
            attention: self.attention,
            reasons: &self.reasons,
        }
    }
}

/// The totals of a batch.
#[derive(Serialize)]
pub struct Summary {
    /// Rows of the table.
    pub rows: usize,
    /// Rows that have succeeded.
    pub ok: usize,
    /// Names of rows that failed.
    pub failed: Vec<String>,
    /// Rows that have not been done yet, or have changed since.
    pub left: usize,
    /// Rows of this run that were finished before it started.
    pub finished_before: usize,
    /// Rows done in this run.
    pub done: usize,
    pub seconds: f64,
    pub lines_per_s: f64,
    /// Warnings that concern all rows of a face.
    pub warnings: Vec<String>,
    /// Path of the page, if it was written.
    pub results: Option<String>,
}

/// The whole summary on disk.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    lines: &'a [Shown],
}

/// Counts the rows for `summary` from the history, to which other processes may also have written.
/// If `faces` are given, also writes `batch.json` and `results.html`, whose pictures show these
/// faces.
///
/// # Errors
/// `Io` if a file cannot be read or written.
pub fn write(
    folder: &Path,
    rows: &[Row],
    digests: &[String],
    faces: Option<&Faces>,
    summary: &mut Summary,
) -> Result<()> {
    let mut shown = entries(folder, rows, digests)?;
    summary.rows = rows.len();
    summary.ok = shown.iter().filter(|row| row.entry.ok).count();
    summary.left = rows.len() - shown.len();
    let failed = shown.iter().filter(|row| !row.entry.ok);
    summary.failed = failed.map(|row| row.entry.name.clone()).collect();
    let Some(faces) = faces else {
        return Ok(());
    };
    let [document_path, page] = paths(folder);
    summary.results = Some(page.display().to_string());
    let document = Document {
        summary,
        lines: &shown,
    };
    write_json(&document_path, &document)?;
    shown.sort_by(|a, b| b.attention.total_cmp(&a.attention));
    add_curves(folder, &mut shown)?;
    add_pictures(rows, faces, &mut shown);
    let on_page: Vec<PageRow<'_>> = shown.iter().map(Shown::on_page).collect();
    let json = serde_json::to_string(&on_page).expect("rows serialise");
    let content = PAGE.replace(ROWS, &within_script(&json));
    write_atomically(&page, |file| file.write_all(content.as_bytes()))
}

/// JSON for a script of a page. No `<` of its strings stays, because `</script>` would end the
/// script, and after `<!--<script>` its own end would no longer count. Other characters need no
/// care: [`PAGE`] states its encoding.
fn within_script(json: &str) -> String {
    json.replace('<', "\\u003c")
}

/// The latest entry of each row, in the order of the table. Rows that have changed since have none.
fn entries(folder: &Path, rows: &[Row], digests: &[String]) -> Result<Vec<Shown>> {
    let ledger = Ledger::open(folder)?;
    let known = rows.iter().zip(digests);
    let known = known.filter_map(|(row, digest)| {
        let entry = ledger.last(&row.name)?;
        (entry.digest == *digest).then(|| entry.clone())
    });
    let known: Vec<Entry> = known.collect();
    let costs = known
        .iter()
        .filter(|entry| entry.ok && entry.duration_s > 0.0);
    let mut costs: Vec<f64> = costs
        .map(|entry| entry.seconds / entry.duration_s)
        .collect();
    costs.sort_by(f64::total_cmp);
    let usual = costs.get(costs.len() / 2).copied().unwrap_or(1.0);
    let shown = known.into_iter().map(|entry| {
        let (attention, reasons) = attention(&entry, usual);
        Shown {
            entry,
            attention,
            reasons,
            pictures: Vec::new(),
        }
    });
    Ok(shown.collect())
}

/// Reads the curves of the first rows from the history. Other curves are not kept in memory.
fn add_curves(folder: &Path, shown: &mut [Shown]) -> Result<()> {
    let first = shown.iter().take(SHOWN).enumerate();
    let places: HashMap<String, usize> = first
        .map(|(at, row)| (row.entry.name.clone(), at))
        .collect();
    each_entry(&folder.join(HISTORY), |entry| {
        if let Some(at) = places.get(&entry.name) {
            let row = &mut shown[*at].entry;
            (row.gap, row.wave) = (entry.gap, entry.wave);
        }
    })
}

/// Draws pictures of the first rows whose faces are still in memory and whose results are weights
/// in a .csv file.
fn add_pictures(rows: &[Row], faces: &Faces, shown: &mut [Shown]) {
    let shown_names: HashSet<&str> = shown
        .iter()
        .take(SHOWN)
        .map(|row| row.entry.name.as_str())
        .collect();
    let rows = rows
        .iter()
        .filter(|row| shown_names.contains(row.name.as_str()));
    let mut pictures: HashMap<String, Vec<String>> = HashMap::new();
    for row in rows {
        let Some(ready) = faces.at_hand(row) else {
            continue;
        };
        let (Some(face), Some(weights)) = (&ready.face, &ready.weights) else {
            continue;
        };
        let portrait = Portrait::new(face, weights.rig());
        let gap = shown.iter().find(|shown| shown.entry.name == row.name);
        let gap = gap.and_then(|shown| shown.entry.gap.as_ref());
        let values = gap.map_or(&[][..], |gap| &gap.values);
        let frames = telling_frames(values);
        // A result that can no longer be read as weights has no pictures.
        let drawn = row.outputs.first().map(|out| weights_of(out, &frames));
        let Some(Ok(drawn)) = drawn else { continue };
        let drawn = drawn
            .iter()
            .filter_map(|weights| portrait.draw(weights).ok());
        pictures.insert(row.name.clone(), drawn.collect());
    }
    for row in shown.iter_mut().take(SHOWN) {
        row.pictures = pictures.remove(&row.entry.name).unwrap_or_default();
    }
}

/// The frames with the widest gap, just after its fastest change, and in the middle, in ascending
/// order.
fn telling_frames(gap: &[f32]) -> Vec<usize> {
    let widest = (0..gap.len()).max_by(|a, b| gap[*a].total_cmp(&gap[*b]));
    let change = |t: &usize| (gap[*t] - gap[*t - 1]).abs();
    let fastest = (1..gap.len()).max_by(|a, b| change(a).total_cmp(&change(b)));
    let mut frames: Vec<usize> = [widest, fastest, Some(gap.len() / 2)]
        .into_iter()
        .flatten()
        .collect();
    frames.sort_unstable();
    frames.dedup();
    frames.truncate(PICTURES);
    frames
}

/// Reads the weights of some frames, with their names, from a .csv file that the batch has written.
fn weights_of(out: &Path, frames: &[usize]) -> Result<Vec<Vec<(String, f32)>>> {
    let wrong = || Error::InvalidInput(format!("{}: expected weights", out.display()));
    let is_table = |path: &PathBuf| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("csv"))
    };
    let path = Some(out.to_owned()).filter(is_table).ok_or_else(wrong)?;
    let bytes = read_file(&path, InputKind::Numbers)?;
    let mut table = csv::Reader::from_reader(bytes.as_slice());
    let names: Vec<String> = table
        .headers()
        .map_err(|_| wrong())?
        .iter()
        .map(small)
        .collect();
    let mut weights = Vec::new();
    for (t, record) in table.records().enumerate() {
        if frames.contains(&t) {
            let record = record.map_err(|_| wrong())?;
            let cells = names.iter().zip(record.iter());
            let known = cells.filter_map(|(name, cell)| Some((name.clone(), cell.parse().ok()?)));
            weights.push(known.collect());
        }
    }
    Ok(weights)
}

/// `JawOpen` → `jawOpen`.
fn small(name: &str) -> String {
    let mut letters = name.chars();
    let first = letters.next().map(|c| c.to_ascii_lowercase());
    first.into_iter().chain(letters).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_one_place_for_rows() {
        assert_eq!(PAGE.matches(ROWS).count(), 1);
        assert!(!PAGE.contains("http://") && !PAGE.contains("https://"));
    }

    #[test]
    fn no_text_of_a_row_ends_the_script_or_opens_another() {
        let names = ["<!--<script>", "</script><img src=x>", "<", "a\u{2028}b"];
        let page = within_script(&serde_json::to_string(&names).unwrap());
        assert!(!page.contains('<'), "{page}");
        let read: Vec<String> = serde_json::from_str(&page).unwrap();
        assert_eq!(read, names);
    }

    #[test]
    fn frames_that_tell_most_are_the_widest_and_the_fastest() {
        let mut gap = vec![1.0; 20];
        gap[4] = 9.0;
        gap[15] = 3.0;
        assert_eq!(telling_frames(&gap), [4, 5, 10]);
        assert_eq!(telling_frames(&[]), [0]);
    }
}
