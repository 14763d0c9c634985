//! Says what a batch would do, without doing it.

use anyface::{Result, audio::SoundFile, job::SILENT, mesh::Mesh, speech::frames_of};
use serde::Serialize;

use super::{
    ledger::{Ledger, SOME_FAILED},
    line::Line,
    rows::Row,
};
use crate::console::Console;

/// The plan reads the lengths of at most this many sounds, spread over all rows, and estimates the
/// rest from them.
const SAMPLED: usize = 50;
/// Seconds that one thread takes for a second of sound, used until a line has been done. Measured:
/// 186 ms for 4 s of sound on a head of 26,719 vertices, while the machine did other work.
const COST: f64 = 0.047;

#[derive(Serialize)]
struct Plan {
    rows: usize,
    finished_before: usize,
    waiting: usize,
    /// Name of each row that cannot be done, and why.
    broken: Vec<[String; 2]>,
    sound_s: f64,
    estimated_s: f64,
    estimated_mb: u64,
}

/// Prints how many rows would be done, which ones cannot be done, and how long the batch would
/// take. Returns the exit code.
///
/// # Errors
/// Those of loading the models and of reading the first line's mesh.
pub fn tell(
    rows: &[Row],
    waiting: &[usize],
    (finished_before, threads): (usize, usize),
    ledger: &Ledger,
    console: &Console,
) -> Result<u8> {
    let (good, broken) = sorted(waiting.iter().map(|at| &rows[*at]));
    let needs = Needs::of(&good, (rows, ledger), threads)?;
    let plan = Plan {
        rows: rows.len(),
        finished_before,
        waiting: good.len(),
        sound_s: needs.sound_s,
        estimated_s: needs.processor_s / threads as f64,
        estimated_mb: needs.memory_mb,
        broken,
    };
    console.value(&plan, &text(&plan))?;
    Ok(if plan.broken.is_empty() {
        0
    } else {
        SOME_FAILED
    })
}

/// Memory and time that rows need.
pub struct Needs {
    /// The most memory of one process, whose threads share the face and the models.
    pub memory_mb: u64,
    /// Seconds that one thread would take for all rows.
    pub processor_s: f64,
    sound_s: f64,
}

impl Needs {
    /// The needs of all rows of a table that can be done.
    ///
    /// # Errors
    /// Those of loading the models and of reading the first line's mesh.
    pub fn of_all(rows: &[Row], ledger: &Ledger, threads: usize) -> Result<Needs> {
        let (good, _) = sorted(rows.iter());
        Needs::of(&good, (rows, ledger), threads)
    }

    /// The needs of `lines`. Their time is estimated from what `rows` took before.
    fn of(lines: &[&Line], (rows, ledger): (&[Row], &Ledger), threads: usize) -> Result<Needs> {
        let step = lines.len().div_ceil(SAMPLED).max(1);
        let sounds = lines.iter().step_by(step);
        let lengths: Vec<f64> = sounds.filter_map(|line| length_s(line)).collect();
        let mean_s = lengths.iter().sum::<f64>() / lengths.len().max(1) as f64;
        let longest_s = lengths.iter().copied().fold(0.0, f64::max);
        let sound_s = mean_s * lines.len() as f64;
        Ok(Needs {
            memory_mb: match lines.first() {
                Some(line) => memory_mb(line, longest_s, threads)?,
                None => 0,
            },
            processor_s: sound_s * cost(rows, ledger),
            sound_s,
        })
    }
}

/// Separates the lines that can be done from the rows that cannot. For those it returns their names
/// and the reasons.
fn sorted<'a>(rows: impl Iterator<Item = &'a Row>) -> (Vec<&'a Line>, Vec<[String; 2]>) {
    let (mut good, mut broken) = (Vec::new(), Vec::new());
    for row in rows {
        match checked(row) {
            Ok(line) => good.push(line),
            Err(why) => broken.push([row.name.clone(), why]),
        }
    }
    (good, broken)
}

/// The line of a row if its options are valid and its files exist, otherwise the reason why not.
fn checked(row: &Row) -> std::result::Result<&Line, String> {
    let line = row.line.as_ref().map_err(ToString::to_string)?;
    let request = line.options.motion.request(&line.shared);
    request.map_err(|error| error.to_string())?;
    let missing = row.inputs.iter().find(|path| !path.exists());
    match missing {
        Some(path) => Err(format!("{}: no such file", path.display())),
        None => Ok(line),
    }
}

fn length_s(line: &Line) -> Option<f64> {
    let sound = SoundFile::read(&line.audio, true, SILENT).ok()?;
    Some(sound.levels.duration_s())
}

/// Seconds that one thread takes for a second of sound: the median of the lines that were done
/// before.
fn cost(rows: &[Row], ledger: &Ledger) -> f64 {
    let entries = rows.iter().filter_map(|row| ledger.last(&row.name));
    let entries = entries.filter(|entry| entry.ok && entry.duration_s > 0.0);
    let mut costs: Vec<f64> = entries.map(|e| e.seconds / e.duration_s).collect();
    costs.sort_by(f64::total_cmp);
    costs.get(costs.len() / 2).copied().unwrap_or(COST)
}

fn memory_mb(line: &Line, sound_s: f64, threads: usize) -> Result<u64> {
    let engine = line.shared.engine()?;
    let vertices = match &line.options.mesh {
        Some(mesh) => Mesh::read(mesh)?.positions.len(),
        None => 0,
    };
    let of_weights = line.wants_weights();
    let fps = line.options.motion.request(&line.shared)?.fps;
    let frames = if of_weights {
        anyface::rig::SHAPES
    } else {
        frames_of(sound_s, fps)
    };
    let one = engine.memory_need(vertices, frames, sound_s).bytes();
    let idle = engine.memory_need(vertices, 0, 0.0).bytes();
    let more = one.saturating_sub(idle).saturating_mul(threads as u64);
    Ok((idle + more) >> 20)
}

fn text(plan: &Plan) -> String {
    let Plan {
        rows,
        finished_before,
        waiting,
        broken,
        sound_s,
        estimated_s,
        estimated_mb,
    } = plan;
    let mut text = format!(
        "{rows} rows: {waiting} would be done, {finished_before} are finished, {} cannot be done\n\
         about {} of speech, {} and {estimated_mb} MB of memory",
        broken.len(),
        duration(*sound_s),
        duration(*estimated_s)
    );
    for [name, why] in broken {
        text += &format!("\n{name}: {why}");
    }
    text
}

/// `75` → `1 min 15 s`.
pub fn duration(seconds: f64) -> String {
    let seconds = seconds.round() as u64;
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s:02} s"),
        (h, m, _) => format!("{h} h {m:02} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_is_told_in_units_that_people_use() {
        let texts = [5.0, 75.0, 7_260.0].map(duration);
        assert_eq!(texts, ["5 s", "1 min 15 s", "2 h 01 min"]);
    }
}
