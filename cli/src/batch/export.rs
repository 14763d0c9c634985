//! `anyface batch --export`: hands the rows of a table to the engine of a render farm, which runs
//! them.
//!
//! It fills in the templates of `cli/farm`, which Blender's batch also uses, and says what to type
//! next. It does no row itself.

use std::{fs, io::Write, path::Path};

use anyface::{
    Error, Result,
    job::{Receipts, write_atomically},
};
use clap::{Args, ValueEnum};
use serde::Serialize;
use serde_json::to_string;

use super::plan::Needs;
use crate::{console::Console, paths::OutputPath};

/// Cores of a task if --cores is not given.
const CORES: usize = 2;
/// Memory of a task as a multiple of the estimate for its rows.
const MEMORY_MARGIN: f64 = 1.25;
/// Time limit of a task as a multiple of the estimate for its rows.
const TIME_MARGIN: f64 = 4.0;
/// Seconds that it takes to start the command and prepare a face on a slow disk.
const START_S: f64 = 300.0;

/// The farm engine that runs the rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Engine {
    Flamenco,
    Openjd,
    Slurm,
    Opencue,
}

impl Engine {
    /// Each template, and the name of the file made from it.
    fn templates(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Engine::Flamenco => &[
                (include_str!("../../farm/flamenco.js"), "anyface.js"),
                (include_str!("../../farm/flamenco.json"), "job.json"),
            ],
            Engine::Openjd => &[(include_str!("../../farm/openjd.yaml"), "template.yaml")],
            Engine::Slurm => &[(include_str!("../../farm/slurm.sh"), "anyface.sh")],
            Engine::Opencue => &[(include_str!("../../farm/opencue.py"), "submit.py")],
        }
    }

    /// What to type once the files are written.
    fn hint(self, folder: &str) -> String {
        match self {
            Engine::Flamenco => format!(
                "copy {folder}/anyface.js into the folder scripts of flamenco-manager (once), then run\n\
                 curl -H 'Content-Type: application/json' -d @{folder}/job.json http://MANAGER:8080/api/v3/jobs"
            ),
            Engine::Openjd => format!("deadline bundle submit {folder}"),
            Engine::Slurm => format!("bash {folder}/anyface.sh"),
            Engine::Opencue => format!("python {folder}/submit.py"),
        }
    }
}

/// Options of an export.
#[derive(Args)]
pub struct ExportArgs {
    /// Write the job files for this render farm engine, without doing any rows
    #[arg(long, value_enum, value_name = "ENGINE", conflicts_with_all = ["rows", "again", "dry_run", "sum"])]
    export: Option<Engine>,
    /// Rows of a task
    #[arg(long, requires = "export", default_value_t = 200, value_parser = count)]
    chunk: usize,
    /// Cores of a task. It does this many rows at once [default: 2]
    #[arg(long, requires = "export", value_parser = count)]
    cores: Option<usize>,
    /// Memory of a task in GB [default: a quarter more than the estimate for its rows]
    #[arg(long, requires = "export", value_name = "GB", value_parser = gigabytes)]
    memory: Option<f64>,
    /// Program that a node runs as `anyface` [default: the path of this program]
    #[arg(long, requires = "export", value_name = "PATH")]
    program: Option<String>,
    /// The folder of the export [default: LINES.ENGINE beside the table]
    #[arg(
        id = "export_out",
        long = "out",
        requires = "export",
        value_name = "DIR"
    )]
    out: Option<OutputPath>,
}

/// What a node runs: `program batch table options --rows A-B`.
pub struct NodeCommand<'a> {
    pub table: &'a Path,
    /// Options in the form `--name=value`.
    pub options: Vec<String>,
    pub rows: usize,
}

#[derive(Serialize)]
struct Exported {
    folder: String,
    rows: usize,
    tasks: usize,
    memory_mb: u64,
    cores: usize,
    next: String,
}

impl ExportArgs {
    /// Whether to hand the rows to an engine.
    pub fn is_on(&self) -> bool {
        self.export.is_some()
    }

    /// How many rows a task does at once.
    pub fn threads(&self) -> usize {
        self.cores.unwrap_or(CORES)
    }

    /// Writes the files of the engine, and says what to type next. `needs`: memory of one task, and
    /// processor time of all rows.
    ///
    /// # Errors
    /// `InvalidInput` for a table without rows and for words that the engine would read as its own
    /// syntax; `Io` if a file cannot be written.
    pub fn run(&self, node: &NodeCommand<'_>, needs: &Needs, console: &Console) -> Result<()> {
        let Some(engine) = self.export else {
            return Ok(());
        };
        if node.rows == 0 {
            return Err(Error::InvalidInput(format!(
                "{}: expected rows to export, got none",
                node.table.display()
            )));
        }
        let table = std::path::absolute(node.table).map_err(Error::io(node.table))?;
        let words = Words {
            program: match &self.program {
                Some(program) => program.clone(),
                None => text(&std::env::current_exe().map_err(Error::io("anyface"))?)?,
            },
            table: text(&table)?,
            options: node.options.clone(),
        };
        words.check(engine)?;
        let folder = match &self.out {
            Some(folder) => std::path::absolute(&**folder).map_err(Error::io(&**folder))?,
            None => table.with_extension(name(engine)),
        };
        let receipts = Receipts::new(Some(folder.clone()));
        for (_, file) in engine.templates() {
            receipts.derive(&folder.join(file))?;
        }
        fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        let cores = self.threads();
        let memory_mb = match self.memory {
            Some(gigabytes) => 1024.0 * gigabytes,
            None => MEMORY_MARGIN * needs.memory_mb as f64,
        };
        let memory_mb = memory_mb.ceil() as u64;
        let tasks = node.rows.div_ceil(self.chunk);
        let row_s = needs.processor_s / node.rows as f64;
        let seconds = START_S + TIME_MARGIN * row_s * self.chunk as f64 / cores as f64;
        let values = [
            ("rows", node.rows.to_string()),
            ("chunk", self.chunk.to_string()),
            ("chunks", tasks.to_string()),
            ("memory_mb", memory_mb.to_string()),
            ("cores", cores.to_string()),
            ("seconds", (60.0 * (seconds / 60.0).ceil()).to_string()),
        ];
        let values: Vec<_> = values.into_iter().chain(words.values(engine)?).collect();
        for (template, file) in engine.templates() {
            let path = folder.join(file);
            let content = fill(template, &values);
            write_atomically(&path, |file| file.write_all(content.as_bytes()))?;
        }
        let next = engine.hint(&shell([text(&folder)?])?);
        let summary = format!(
            "{} rows, {} a task, {memory_mb} MB and {cores} cores each, in {}; now\n{next}",
            node.rows,
            self.chunk,
            folder.display()
        );
        let exported = Exported {
            folder: folder.display().to_string(),
            rows: node.rows,
            tasks,
            memory_mb,
            cores,
            next,
        };
        console.value(&exported, &summary)
    }
}

/// The words of a node's command.
struct Words {
    program: String,
    table: String,
    options: Vec<String>,
}

impl Words {
    fn check(&self, engine: Engine) -> Result<()> {
        let mut words = self.options.iter().chain([&self.program, &self.table]);
        match words.find(|word| word.contains("{{")) {
            Some(word) if engine == Engine::Openjd => Err(Error::InvalidInput(format!(
                "{word}: Open Job Description reads {{{{ as its own: expected paths without it, rename them"
            ))),
            _ => Ok(()),
        }
    }

    /// Values for the placeholders, quoted as the engine's language needs.
    fn values(&self, engine: Engine) -> Result<[(&'static str, String); 8]> {
        let behind = ["batch", &self.table].into_iter();
        let behind: Vec<&str> = behind
            .chain(self.options.iter().map(String::as_str))
            .collect();
        let (program, arguments) = match engine {
            Engine::Slurm => (shell([&self.program])?, shell(behind)?),
            _ => {
                let words: Vec<String> = behind.into_iter().map(quoted).collect();
                (quoted(&self.program), words.join(", "))
            }
        };
        let stem = Path::new(&self.table).file_stem();
        let stem = stem.map(|stem| stem.to_string_lossy()).unwrap_or_default();
        let is_of_names = |c: char| c.is_ascii_alphanumeric() || "_.-".contains(c);
        let name = stem.replace(|c| !is_of_names(c), "-");
        let name = match name.trim_matches('-') {
            "" => "anyface",
            name => name,
        };
        let platform = match std::env::consts::OS {
            "macos" => "darwin",
            other => other,
        };
        Ok([
            ("name", name.to_owned()),
            ("program", program),
            ("arguments", arguments),
            ("command", quoted(shell([&self.program, "batch"])?)),
            ("jobs", quoted(&self.table)),
            ("options", quoted(shell(&self.options)?)),
            // No row has a .blend file to render.
            ("blendfiles", quoted("[]")),
            ("platform", platform.to_owned()),
        ])
    }
}

/// The template with `{{name}}` replaced by the value of that name; other braces stay.
fn fill(template: &str, values: &[(&str, String)]) -> String {
    let mut out = String::new();
    let mut rest = template;
    while let Some(at) = rest.find("{{") {
        let (before, from) = rest.split_at(at);
        out += before;
        let value = from[2..].split_once("}}").and_then(|(name, behind)| {
            let known = values.iter().find(|(known, _)| *known == name);
            known.map(|(_, value)| (value, behind))
        });
        rest = match value {
            Some((value, behind)) => {
                out += value;
                behind
            }
            None => {
                out += "{{";
                &from[2..]
            }
        };
    }
    out + rest
}

/// Quotes words for a shell. `shlex` does this because a rule that it lacks would be missing for
/// everybody.
fn shell<W: AsRef<str>>(words: impl IntoIterator<Item = W>) -> Result<String> {
    let words = words.into_iter().map(|word| {
        let word = word.as_ref();
        let quoted = shlex::try_quote(word);
        quoted.map(|quoted| quoted.into_owned()).map_err(|_| {
            Error::InvalidInput(format!("{word:?}: expected text without a zero byte"))
        })
    });
    Ok(words.collect::<Result<Vec<_>>>()?.join(" "))
}

/// Quotes text so that JSON, Python, JavaScript and YAML all read it back.
fn quoted(text: impl AsRef<str>) -> String {
    to_string(text.as_ref()).expect("text serialises")
}

fn text(path: &Path) -> Result<String> {
    let wrong = || Error::InvalidInput(format!("{}: expected a path in UTF-8", path.display()));
    path.to_str().map(str::to_owned).ok_or_else(wrong)
}

fn name(engine: Engine) -> String {
    let value = engine.to_possible_value();
    value.map_or_else(String::new, |value| value.get_name().to_owned())
}

fn count(text: &str) -> std::result::Result<usize, String> {
    let count = text.parse().ok().filter(|count| *count > 0);
    count.ok_or_else(|| format!("expected 1 or more, got {text}"))
}

fn gigabytes(text: &str) -> std::result::Result<f64, String> {
    let size = text.parse().ok().filter(|size| *size > 0.0 && *size < 1e6);
    size.ok_or_else(|| format!("expected more than 0 GB, got {text}"))
}
