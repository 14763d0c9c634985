//! The rows of a batch: a table whose columns are options of the command.
//!
//! Each row becomes the words of a command line, and the same parsers read it. So a row takes the
//! same options as the command, and has the same errors.

use std::{
    any::TypeId,
    collections::{HashMap, HashSet},
    path::{Path, PathBuf},
};

use anyface::{
    Error, Result,
    job::{InputKind, Place, read_file},
};
use clap::{ArgAction, ArgMatches, Args, Command, CommandFactory, FromArgMatches};

use super::{
    line::{Line, LineOptions},
    path_map::{PathMap, is_of_windows, translated},
    table_text::{delimiter, table_text},
};
use crate::{
    arguments::{FaceArgs, SharedArgs},
    paths::{CachePath, InputPath, OutputPath, landmarks_beside},
    scene::sound_beside,
};

/// The one column that is not an option.
const NAME: &str = "name";
/// A column whose name begins with this holds notes.
const NOTE: char = '#';
const LONGEST_NAME: usize = 200;

/// An option and the text of its value.
type Word = (String, String);

/// Options of the command line. They apply to each row that does not set them itself.
pub struct Defaults(Vec<Word>);

impl Defaults {
    /// The options as words of a command line: `--name=value`, or `--name` for one without a value.
    pub fn words(&self) -> Vec<String> {
        let command = Line::command();
        let is_flag = |long: &str| {
            let mut args = command.get_arguments();
            args.any(|arg| {
                arg.get_long() == Some(long) && matches!(arg.get_action(), ArgAction::SetTrue)
            })
        };
        let words = self.0.iter().map(|(long, value)| {
            if is_flag(long) {
                format!("--{long}")
            } else {
                format!("--{long}={value}")
            }
        });
        words.collect()
    }
}

impl Args for Defaults {
    fn augment_args(command: Command) -> Command {
        LineOptions::augment_args(command)
    }

    fn augment_args_for_update(command: Command) -> Command {
        LineOptions::augment_args_for_update(command)
    }
}

impl FromArgMatches for Defaults {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let mut words = Vec::new();
        for arg in Line::command().get_arguments() {
            let (id, Some(long)) = (arg.get_id().as_str(), arg.get_long()) else {
                continue;
            };
            // The batch itself decides these.
            let is_of_batch = ["threads", "json"].contains(&id);
            let is_known = matches.try_contains_id(id).unwrap_or(false);
            if is_of_batch
                || !is_known
                || matches.value_source(id) != Some(clap::parser::ValueSource::CommandLine)
            {
                continue;
            }
            let raw = matches.get_raw_occurrences(id).into_iter().flatten();
            let of_flag = matches!(arg.get_action(), ArgAction::SetTrue);
            if of_flag {
                words.push((long.to_owned(), "true".to_owned()));
                continue;
            }
            for value in raw.flatten() {
                let is_path = is_path(arg);
                let value = if is_path {
                    // Relative paths on the command line start at the current folder.
                    std::path::absolute(value).unwrap_or_else(|_| value.into())
                } else {
                    value.into()
                };
                words.push((long.to_owned(), value.to_string_lossy().into_owned()));
            }
        }
        Ok(Defaults(words))
    }

    fn update_from_arg_matches(
        &mut self,
        matches: &ArgMatches,
    ) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

fn is_path(arg: &clap::Arg) -> bool {
    let kind = arg.get_value_parser().type_id();
    kind == TypeId::of::<InputPath>() || is_output(arg) || kind == TypeId::of::<CachePath>()
}

fn is_output(arg: &clap::Arg) -> bool {
    arg.get_value_parser().type_id() == TypeId::of::<OutputPath>()
}

/// A row of the table.
pub struct Row {
    /// Row 1 is the first one below the header.
    pub number: usize,
    pub name: String,
    /// The options as the table and the command line spell them, which is the same on every
    /// machine.
    pub words: Vec<Word>,
    /// The line, or why there is none.
    pub line: Result<Line>,
    /// Files that the row reads, with the paths that this machine opens.
    pub inputs: Vec<PathBuf>,
    /// Files that the row writes, the result first.
    pub outputs: Vec<PathBuf>,
    /// The options of the face and the models as one text. Rows with the same text share a face.
    pub face: String,
}

/// Reads the rows of one table.
struct Reader<'a> {
    command: Command,
    /// Names of the options that choose the face, from [`options_of_face`].
    of_face: HashSet<String>,
    defaults: &'a [Word],
    maps: &'a [PathMap],
    folder: PathBuf,
    /// The option of each column; `None` for the name and notes.
    columns: Vec<Option<String>>,
    /// Index of the name column.
    name: Option<usize>,
}

/// Reads all rows of a table. No row may write one of the batch's own `files`.
///
/// # Errors
/// `Io` if the table cannot be read, `InvalidInput` if its header is not that of a batch. An error
/// in one row is kept in [`Row::line`].
pub fn read(
    path: &Path,
    defaults: &Defaults,
    maps: &[PathMap],
    files: &[PathBuf],
) -> Result<Vec<Row>> {
    let bytes = read_file(path, InputKind::Numbers)?;
    let wrong = |message: String| Error::InvalidInput(format!("{}: {message}", path.display()));
    let text = table_text(&bytes);
    let mut table = csv::ReaderBuilder::new()
        .delimiter(delimiter(&text))
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let header = table.headers().map_err(|e| wrong(e.to_string()))?.clone();
    let folder = std::path::absolute(path).map_err(Error::io(path))?;
    let folder = folder.parent().unwrap_or(&folder).to_owned();
    let defaults = beside(&defaults.0, &folder);
    let mut reader = Reader {
        command: Line::command(),
        of_face: options_of_face(),
        defaults: &defaults,
        maps,
        folder,
        columns: Vec::new(),
        name: header.iter().position(|name| option(name) == NAME),
    };
    reader.command.build();
    reader.columns = header
        .iter()
        .map(|name| reader.column(name).map_err(&wrong))
        .collect::<Result<_>>()?;
    for needed in ["audio", "out"] {
        let has = |column: &Option<String>| column.as_deref() == Some(needed);
        if !reader.columns.iter().any(has) {
            let names: Vec<&str> = header.iter().collect();
            return Err(wrong(format!(
                "expected a header with the columns audio and out, got {:?}",
                names.join(",")
            )));
        }
    }
    let mut rows = Vec::new();
    for (number, record) in (1..).zip(table.byte_records()) {
        let row = match record {
            // Spreadsheets end with rows of commas.
            Ok(record) if record.iter().all(<[u8]>::is_empty) => continue,
            Ok(record) => reader.row(number, &record),
            Err(error) => Row::broken(number, Error::InvalidInput(error.to_string())),
        };
        rows.push(row);
    }
    refuse_clashes(&mut rows, path, files);
    Ok(rows)
}

/// The options of the command line, with paths below the table's folder made relative to it. So a
/// row stays the same on machines that have the folder in another place.
fn beside(words: &[Word], folder: &Path) -> Vec<Word> {
    let words = words.iter().map(|(long, value)| {
        let inside = Path::new(value).strip_prefix(folder);
        let inside = inside.ok().and_then(Path::to_str);
        let value = inside.filter(|inside| !inside.is_empty()).unwrap_or(value);
        (long.clone(), value.to_owned())
    });
    words.collect()
}

/// Names of the options that choose the face and the models.
fn options_of_face() -> HashSet<String> {
    let command = SharedArgs::augment_args(FaceArgs::augment_args(Command::new("")));
    let options = command.get_arguments().filter_map(|arg| arg.get_long());
    options.chain(["mesh"]).map(str::to_owned).collect()
}

/// Spells the name of a column like that of an option.
fn option(column: &str) -> String {
    column.trim().to_ascii_lowercase().replace('_', "-")
}

impl Row {
    fn broken(number: usize, error: Error) -> Row {
        Row {
            number,
            name: format!("row-{number}"),
            words: Vec::new(),
            line: Err(error),
            inputs: Vec::new(),
            outputs: Vec::new(),
            face: String::new(),
        }
    }
}

impl Reader<'_> {
    fn column(&self, name: &str) -> std::result::Result<Option<String>, String> {
        let long = option(name);
        if long == NAME || name.starts_with(NOTE) || long.is_empty() {
            return Ok(None);
        }
        let known = self
            .command
            .get_arguments()
            .filter_map(|arg| arg.get_long());
        let known: Vec<&str> = known
            .filter(|known| !["threads", "json", "help"].contains(known))
            .collect();
        if known.contains(&long.as_str()) {
            Ok(Some(long))
        } else {
            Err(format!(
                "column {name:?}: expected name or an option of `anyface animate`, such as audio, out, mesh, emotion or seed; \
                 a column of notes begins with {NOTE}"
            ))
        }
    }

    fn row(&mut self, number: usize, record: &csv::ByteRecord) -> Row {
        match self.parsed(number, record) {
            Ok(row) => row,
            Err(error) => Row {
                name: self.name_of(number, record),
                ..Row::broken(number, error)
            },
        }
    }

    /// The name of a row that cannot be read.
    fn name_of(&self, number: usize, record: &csv::ByteRecord) -> String {
        let name = self.name.and_then(|at| record.get(at));
        let name = name.and_then(|name| std::str::from_utf8(name).ok());
        name.filter(|name| is_name(name))
            .map_or_else(|| format!("row-{number}"), str::to_owned)
    }

    fn parsed(&mut self, number: usize, record: &csv::ByteRecord) -> Result<Row> {
        let cells = self.cells(record)?;
        let row_words = self.columns.iter().zip(&cells);
        let row_words = row_words.filter(|(_, cell)| !cell.is_empty());
        let row_words =
            row_words.filter_map(|(column, cell)| Some((column.clone()?, (*cell).to_owned())));
        let row_words: Vec<Word> = row_words.collect();
        let out = row_words.iter().find(|(long, _)| long == "out");
        let out = out.map_or("", |(_, out)| out.as_str());
        let name = self.name.and_then(|at| cells.get(at));
        let name = name.copied().filter(|name| !name.is_empty());
        let name = name.unwrap_or(out).to_owned();
        if !is_name(&name) {
            return Err(Error::InvalidInput(format!(
                "name: expected up to {LONGEST_NAME} letters, got {:?}",
                name.chars().take(60).collect::<String>()
            )));
        }
        let mut words = self.defaults_beside(&row_words);
        words.extend(row_words);
        self.of_words(number, name, words)
    }

    /// The cells of a row as text.
    fn cells<'c>(&self, record: &'c csv::ByteRecord) -> Result<Vec<&'c str>> {
        if record.len() > self.columns.len() {
            return Err(Error::InvalidInput(format!(
                "expected {} cells as in the header, got {}; a comma within a cell needs quotes about the cell",
                self.columns.len(),
                record.len()
            )));
        }
        let cells = record.iter().map(std::str::from_utf8);
        let cells: std::result::Result<Vec<&str>, _> = cells.collect();
        cells.map_err(|_| Error::InvalidInput("expected text in UTF-8".to_owned()))
    }

    /// Parses the words of a row as the command line does.
    fn of_words(&mut self, number: usize, name: String, words: Vec<Word>) -> Result<Row> {
        let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
        let (mut typed, mut face) = (Vec::new(), Vec::new());
        for (long, value) in &words {
            let mut args = self.command.get_arguments();
            let arg = args.find(|arg| arg.get_long() == Some(long));
            let arg = arg.expect("columns are options");
            if matches!(arg.get_action(), ArgAction::SetTrue) {
                let is_on = is_yes(value)
                    .map_err(|message| Error::InvalidInput(format!("{long}: {message}")))?;
                typed.extend(is_on.then(|| format!("--{long}")));
                continue;
            }
            let mut value = value.clone();
            if is_path(arg) {
                let path = self.opened(long, &value)?;
                value = path.to_string_lossy().into_owned();
                if is_output(arg) {
                    outputs.push(path)
                } else {
                    inputs.push(path)
                }
            }
            typed.push(format!("--{long}={value}"));
            if self.of_face.contains(long) {
                face.push(format!("{long}={value}"));
            }
        }
        let line = self.command.try_get_matches_from_mut(typed);
        let line = line.and_then(|matches| Line::from_arg_matches(&matches));
        let line = line.map_err(|error| Error::InvalidInput(plain(&error)))?;
        line.check_out()?;
        let sound = sound_beside(&line.out, &line.audio);
        outputs.extend(sound.filter(|path| Place::of(path) != Place::of(&line.audio)));
        face.sort();
        Ok(Row {
            number,
            name,
            words,
            line: Ok(line),
            inputs,
            outputs,
            face: face.join("\n"),
        })
    }

    /// The options of the command line that apply to a row. `row_words` neither set these nor
    /// conflict with them.
    fn defaults_beside(&self, row_words: &[Word]) -> Vec<Word> {
        let arg = |long: &str| {
            let mut args = self.command.get_arguments();
            args.find(|arg| arg.get_long() == Some(long))
        };
        let is_replaced = |default: &str| {
            row_words.iter().any(|(long, _)| {
                let excluded = |one: &str, other: &str| {
                    let conflicts = arg(one).map(|arg| self.command.get_arg_conflicts_with(arg));
                    let mut conflicts = conflicts.into_iter().flatten();
                    conflicts.any(|arg| arg.get_long() == Some(other))
                };
                long == default || excluded(long, default) || excluded(default, long)
            })
        };
        let defaults = self.defaults.iter();
        defaults
            .filter(|(long, _)| !is_replaced(long))
            .cloned()
            .collect()
    }

    /// The path that this machine opens.
    fn opened(&self, long: &str, value: &str) -> Result<PathBuf> {
        let mut path = translated(value, self.maps);
        if !cfg!(windows) && is_of_windows(&path) {
            if path.as_bytes().get(1) == Some(&b':') || path.starts_with("\\\\") {
                return Err(Error::InvalidInput(format!(
                    "{long}: expected a path of this machine, got {value}; --map {}=FOLDER says where that is here",
                    path.split(['\\', '/']).next().unwrap_or_default()
                )));
            }
            path = path.replace('\\', "/");
        }
        Ok(self.folder.join(path))
    }
}

fn is_name(name: &str) -> bool {
    !name.is_empty() && name.len() <= LONGEST_NAME && !name.chars().any(char::is_control)
}

fn is_yes(value: &str) -> std::result::Result<bool, String> {
    match value.to_ascii_lowercase().as_str() {
        "true" | "yes" | "1" | "x" => Ok(true),
        "false" | "no" | "0" => Ok(false),
        _ => Err(format!("expected yes or no, got {value:?}")),
    }
}

/// An error of the parser as one line of text.
fn plain(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let lines = text.lines().map(str::trim);
    let lines = lines.take_while(|line| !line.starts_with("Usage:"));
    let lines: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
    lines
        .join("; ")
        .trim_start_matches("error: ")
        .trim_end_matches("; For more information, try '--help'.")
        .to_owned()
}

/// Refuses rows that write what another row writes or reads, and rows that share a name. Rows run
/// in parallel and in any order, so the result of such a pair would depend on chance.
fn refuse_clashes(rows: &mut [Row], table: &Path, files: &[PathBuf]) {
    let mut names: HashMap<String, Vec<usize>> = HashMap::new();
    let mut written: HashMap<Place, Vec<usize>> = HashMap::new();
    let mut read: HashMap<Place, PathBuf> = HashMap::new();
    for path in files.iter().map(PathBuf::as_path).chain([table]) {
        read.insert(Place::of(path), path.to_owned());
    }
    let mut places: HashMap<&Path, Place> = HashMap::new();
    for row in rows.iter().filter(|row| row.line.is_ok()) {
        names.entry(row.name.clone()).or_default().push(row.number);
        for path in &row.outputs {
            written.entry(Place::of(path)).or_default().push(row.number);
        }
        for path in &row.inputs {
            let place = places.entry(path).or_insert_with(|| Place::of(path));
            read.entry(place.clone()).or_insert_with(|| path.clone());
        }
        if let Ok(Some(mesh)) = row.line.as_ref().map(|line| &line.options.mesh) {
            let landmarks = landmarks_beside(mesh);
            read.insert(Place::of(&landmarks), landmarks);
        }
    }
    let others = |numbers: &[usize], number: usize| {
        let others = numbers.iter().filter(|n| **n != number).take(3);
        let others: Vec<String> = others.map(ToString::to_string).collect();
        (!others.is_empty()).then(|| others.join(", "))
    };
    let mut clashes: Vec<(usize, String)> = Vec::new();
    for (at, row) in rows.iter().enumerate().filter(|(_, row)| row.line.is_ok()) {
        for path in &row.outputs {
            let place = Place::of(path);
            if let Some(others) = others(&written[&place], row.number) {
                let path = path.display();
                clashes.push((at, format!("out {path}: row {others} writes it, too")));
            }
            if let Some(input) = read.get(&place) {
                let input = input.display();
                clashes.push((
                    at,
                    format!("out {input}: expected another file than one that is read"),
                ));
            }
        }
        if let Some(others) = others(&names[&row.name], row.number) {
            let name = &row.name;
            clashes.push((at, format!("name {name:?}: row {others} has it, too")));
        }
    }
    for (at, message) in clashes {
        let row = &mut rows[at];
        // Each entry in the history needs a name of its own.
        if names
            .get(&row.name)
            .is_some_and(|numbers| numbers.len() > 1)
        {
            row.name = format!("row-{}", row.number);
        }
        row.line = Err(Error::InvalidInput(message));
    }
}
