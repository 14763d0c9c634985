//! Which files a command reads and which it writes.
//!
//! The type of an option says whether it reads or writes, so that no option can be forgotten. Before work begins, the
//! command compares every result with every file that it reads and with every other result. A result whose name the
//! user did not type replaces only what this program wrote there.

use std::{
    ffi::OsString,
    io,
    ops::Deref,
    path::{Path, PathBuf},
};

use anyface::{
    Error, Result,
    job::{Place, Receipts},
};
use clap::{ArgMatches, Command};

macro_rules! path_type {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone)]
        pub struct $name(PathBuf);

        impl From<OsString> for $name {
            fn from(text: OsString) -> Self {
                $name(text.into())
            }
        }

        impl AsRef<Path> for $name {
            fn as_ref(&self) -> &Path {
                &self.0
            }
        }

        impl Deref for $name {
            type Target = Path;

            fn deref(&self) -> &Path {
                &self.0
            }
        }
    };
}

path_type! {
    /// A file or a folder that is read.
    InputPath
}
path_type! {
    /// A file or a folder that is written.
    OutputPath
}
path_type! {
    /// A folder of files that only anyface uses.
    CachePath
}

/// The path of the landmarks that every command reads with a mesh, if the file exists.
///
/// An opened mouth needs them: a search for landmarks sees its closed lips and might put a landmark on the wrong one.
pub fn landmarks_beside(mesh: &Path) -> PathBuf {
    mesh.with_extension("landmarks.json")
}

/// Whether a result of this name is a folder: the name has no ending, ends in a separator, or the folder exists.
pub fn is_folder(out: &Path) -> bool {
    let is_plain = out.extension().is_none_or(|ending| ending.is_empty());
    let text = out.to_string_lossy();
    is_plain || out.is_dir() || text.ends_with(std::path::is_separator)
}

/// Says which file a result replaces if its name is a link that leads to another folder.
pub fn link_warning(out: &Path) -> Option<String> {
    let target = Place::beyond_link(out)?;
    let (out, target) = (out.display(), target.display());
    Some(format!(
        "{out} is a link: the result is written to {target}"
    ))
}

/// A path, and the option that an error names with it.
struct Named {
    option: String,
    path: PathBuf,
}

impl Named {
    /// Refuses a result in a folder that is missing. A result that is a folder is made with all around it.
    fn check_folder(&self) -> Result<()> {
        let folder = self
            .path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty());
        match folder.filter(|folder| !is_folder(&self.path) && !folder.exists()) {
            None => Ok(()),
            Some(folder) => {
                let message = format!("this folder of {} is missing; make it first", self.option);
                let source = io::Error::new(io::ErrorKind::NotFound, message);
                Err(Error::io(folder)(source))
            }
        }
    }
}

/// The files of a command line.
pub struct Files {
    inputs: Vec<Named>,
    outputs: Vec<Named>,
    /// How many of the outputs have names that the user typed. They come first.
    typed: usize,
}

impl Files {
    /// The files of all options. `beside` are results whose names derive from those of other results.
    pub fn new(command: &Command, matches: &ArgMatches, beside: Vec<PathBuf>) -> Files {
        let mut files = Files {
            inputs: Vec::new(),
            outputs: Vec::new(),
            typed: 0,
        };
        files.read(command, matches);
        files.typed = files.outputs.len();
        files.outputs.extend(beside.into_iter().map(|path| Named {
            option: path.display().to_string(),
            path,
        }));
        files
    }

    fn read(&mut self, command: &Command, matches: &ArgMatches) {
        for arg in command.get_arguments() {
            let id = arg.get_id().as_str();
            let option = format!("--{}", arg.get_long().unwrap_or(id));
            let named = |path: &Path| Named {
                option: option.clone(),
                path: path.to_owned(),
            };
            // If the option has another type, the call returns an error: it is no path of this kind.
            if let Ok(Some(paths)) = matches.try_get_many::<InputPath>(id) {
                let paths: Vec<&InputPath> = paths.collect();
                self.inputs.extend(paths.iter().map(|path| named(path)));
                // `anyface landmarks` may replace this very file, which it is there to make.
                if id == "mesh" && command.get_name() != "landmarks" {
                    let beside = paths.iter().map(|path| landmarks_beside(path));
                    self.inputs.extend(beside.map(|path| Named {
                        option: "the landmarks of --mesh".to_owned(),
                        path,
                    }));
                }
            }
            if let Ok(Some(paths)) = matches.try_get_many::<OutputPath>(id) {
                self.outputs.extend(paths.map(|path| named(path)));
            }
        }
        if let Some((name, matches)) = matches.subcommand()
            && let Some(command) = command.find_subcommand(name)
        {
            self.read(command, matches);
        }
    }

    /// Refuses a result that would replace an input file, another result, or a file of the user under a name that
    /// nobody typed.
    ///
    /// # Errors
    /// `InvalidInput` that names the options.
    pub fn check(&self, receipts: &Receipts) -> Result<()> {
        self.check_each_other()?;
        let (typed, derived) = self.outputs.split_at(self.typed);
        let empty = typed
            .iter()
            .find(|output| output.path.as_os_str().is_empty());
        if let Some(Named { option, .. }) = empty {
            let message = format!("{option}: expected the name of a file, got an empty one");
            return Err(Error::InvalidInput(message));
        }
        typed.iter().try_for_each(Named::check_folder)?;
        derived
            .iter()
            .try_for_each(|output| receipts.derive(&output.path))
    }

    /// Says which results are written through links to other folders.
    pub fn link_warnings(&self) -> impl Iterator<Item = String> {
        let typed = self.outputs[..self.typed].iter();
        typed.filter_map(|output| link_warning(&output.path))
    }

    fn check_each_other(&self) -> Result<()> {
        for (n, output) in self.outputs.iter().enumerate() {
            let place = Place::of(&output.path);
            let is_same = |other: &&Named| Place::of(&other.path) == place;
            let is_replaced =
                |other: &&Named| is_same(other) || Place::is_inside(&output.path, &other.path);
            let refuse = |other: &Named, what: &str| {
                let (option, path) = (&output.option, output.path.display());
                Err(Error::InvalidInput(format!(
                    "{option} {path}: expected another file than that of {}, {what}",
                    other.option
                )))
            };
            if let Some(input) = self.inputs.iter().find(is_replaced) {
                return refuse(input, "which the result would replace");
            }
            if let Some(other) = self.outputs[..n].iter().find(is_same) {
                return refuse(other, "which is written, too");
            }
        }
        Ok(())
    }

    /// The paths of all files that are read.
    pub fn inputs(&self) -> Vec<PathBuf> {
        self.inputs.iter().map(|input| input.path.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::{any::TypeId, fs};

    use clap::{
        Arg, CommandFactory,
        error::{ContextKind, ContextValue, ErrorKind},
    };

    use super::*;
    use crate::Arguments;

    fn command() -> Command {
        let mut command = Arguments::command();
        command.build();
        command
    }

    fn is<T: 'static>(arg: &Arg) -> bool {
        arg.get_value_parser().type_id() == TypeId::of::<T>()
    }

    /// Long options of one subcommand whose values have the type `T`.
    fn options<T: 'static>(command: &Command) -> Vec<String> {
        let args = command.get_arguments().filter(|arg| is::<T>(arg));
        let long = args.filter_map(|arg| arg.get_long());
        long.map(|long| format!("--{long}")).collect()
    }

    /// The files of a subcommand with two options and all that these require. `None` if they exclude each
    /// other.
    fn files(name: &str, first: (&str, &Path), second: (&str, &Path)) -> Option<Files> {
        let mut words: Vec<OsString> = ["anyface".into(), name.into()].into();
        for (option, path) in [first, second] {
            words.extend([option.into(), path.into()]);
        }
        for _ in 0..8 {
            match Arguments::command().try_get_matches_from(&words) {
                Ok(matches) => return Some(Files::new(&command(), &matches, Vec::new())),
                Err(error) if error.kind() == ErrorKind::MissingRequiredArgument => {
                    let Some(ContextValue::Strings(missing)) = error.get(ContextKind::InvalidArg)
                    else {
                        panic!("{error}");
                    };
                    for option in missing {
                        let option = option.split_whitespace().next().unwrap().to_owned();
                        if option.starts_with('<') {
                            words.push("lines.csv".into());
                            continue;
                        }
                        let value = match option.as_str() {
                            "--redo" => "1-2".to_owned(),
                            "--export" => "slurm".to_owned(),
                            other => format!("no{other}"),
                        };
                        words.extend([option.into(), value.into()]);
                    }
                }
                Err(error) if error.kind() == ErrorKind::ArgumentConflict => return None,
                Err(error) => panic!("{words:?}: {error}"),
            }
        }
        panic!("{words:?}: always something missing");
    }

    fn refusal(files: &Files) -> String {
        files
            .check(&Receipts::default())
            .err()
            .map_or_else(String::new, |error| error.to_string())
    }

    #[test]
    fn every_option_says_whether_its_file_is_read_or_written() {
        for subcommand in command().get_subcommands() {
            let unclear = options::<PathBuf>(subcommand);
            assert!(unclear.is_empty(), "{}: {unclear:?}", subcommand.get_name());
        }
    }

    #[test]
    fn no_result_replaces_what_is_read_however_it_is_spelled() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        fs::write(place("file"), b"of the user").unwrap();
        fs::hard_link(place("file"), place("hard")).unwrap();
        let mut spellings = vec![place("file"), place("./file"), place("hard")];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("file", place("soft")).unwrap();
            spellings.push(place("soft"));
        }
        let mut pairs = 0;
        for subcommand in command().get_subcommands() {
            let name = subcommand.get_name();
            for input in options::<InputPath>(subcommand) {
                for output in options::<OutputPath>(subcommand) {
                    for spelling in &spellings {
                        let (read, written) = (
                            (input.as_str(), &*place("file")),
                            (output.as_str(), &**spelling),
                        );
                        let Some(files) = files(name, read, written) else {
                            continue;
                        };
                        let message = refusal(&files);
                        let named = message.contains(&input) && message.contains(&output);
                        assert!(
                            named && message.contains("would replace"),
                            "{name} {input} {output}: {message:?}"
                        );
                        pairs += 1;
                    }
                }
            }
        }
        assert!(pairs > 150, "{pairs}");
    }

    #[test]
    fn no_two_results_have_one_place() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        let mut pairs = 0;
        for subcommand in command().get_subcommands() {
            let outputs = options::<OutputPath>(subcommand);
            for (n, one) in outputs.iter().enumerate() {
                for other in &outputs[..n] {
                    for spelling in ["new", "./new", "NEW"] {
                        let written = (one.as_str(), &*place("new"));
                        let too = (other.as_str(), &*place(spelling));
                        let Some(files) = files(subcommand.get_name(), written, too) else {
                            continue;
                        };
                        let message = refusal(&files);
                        assert!(
                            message.contains("is written, too"),
                            "{one} {other}: {message:?}"
                        );
                        pairs += 1;
                    }
                }
            }
        }
        assert!(pairs > 10, "{pairs}");
    }

    #[test]
    fn no_result_replaces_landmarks_beside_the_mesh() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        let mesh = place("m.obj");
        fs::write(place("m.landmarks.json"), b"by hand").unwrap();
        let mut pairs = 0;
        for subcommand in command().get_subcommands() {
            let name = subcommand.get_name();
            let reads = options::<InputPath>(subcommand).contains(&"--mesh".to_owned());
            for output in options::<OutputPath>(subcommand) {
                if !reads || name == "landmarks" {
                    continue;
                }
                let written = (output.as_str(), &*place("m.landmarks.json"));
                let Some(files) = files(name, ("--mesh", &mesh), written) else {
                    continue;
                };
                let message = refusal(&files);
                assert!(
                    message.contains("the landmarks of --mesh"),
                    "{name} {output}: {message:?}"
                );
                pairs += 1;
            }
        }
        assert!(pairs > 10, "{pairs}");
    }

    #[test]
    fn files_of_a_folder_that_is_read_stay_and_new_ones_may_lie_beside_them() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        fs::write(place("config.json"), b"{}").unwrap();
        let with = |out: &str| {
            let (read, written) = (("--weights", folder.path()), ("--report", &*place(out)));
            files("motion", read, written).unwrap()
        };
        assert!(refusal(&with("config.json")).contains("would replace"));
        assert_eq!(refusal(&with("report.json")), "");
    }
}
