//! Keeps track of how the numbers and pictures in the documents are made. `docs/sources.toml` lists
//! files with the command that writes them and its inputs, such as models. A check finds files that
//! no entry makes, and files whose inputs have changed since.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use serde::Deserialize;
use sha2::{Digest, Sha256};
// Keeps the comments and the order of the list when digests are written to it.
use toml_edit::{DocumentMut, Item, value};

use crate::{machine, site::documents};

const LIST: &str = "docs/sources.toml";
/// Every file below these must belong to an entry, or each of its sections must.
const RESULTS: [&str; 3] = ["docs/images", "docs/measured", "weights/*/*/README.md"];
/// Every picture on these pages must belong to an entry.
const PAGES: [&str; 3] = ["README.md", "docs/**/*.md", "weights/**/*.md"];
const PICTURES: [&str; 6] = ["png", "jpg", "jpeg", "webp", "svg", "gif"];

/// Lists how the numbers and pictures in the documents are made, or makes some of them again.
#[derive(Args)]
pub struct Docs {
    /// Run nothing; fail if a result has no entry, or if its inputs have changed.
    #[arg(long, conflicts_with_all = ["note", "files"])]
    check: bool,
    /// Run no command; note that the files were made from the present inputs.
    #[arg(long, requires = "files")]
    note: bool,
    /// Files whose commands to run, named as in docs/sources.toml.
    files: Vec<String>,
}

impl Docs {
    /// Lists, checks or makes the results.
    pub fn run(&self) -> Result<()> {
        let root = machine::root();
        if let Some(why) = missing() {
            ensure!(self.check, "expected a clone of the repository: {why}");
            println!("ignored  what makes the documents: {why}");
            return Ok(());
        }
        let sources = Sources::read(&root)?;
        match (self.check, self.files.is_empty()) {
            (true, _) => sources.check(),
            (false, true) => sources.print(),
            (false, false) => {
                let places = self.files.iter().map(|file| sources.place(file));
                for place in places.collect::<Result<BTreeSet<_>>>()? {
                    // The previous call may have changed the list.
                    Sources::read(&root)?.make(place, self.note)?;
                }
                Ok(())
            }
        }
    }
}

/// Why the list cannot be used here, or `None` if it can.
pub fn missing() -> Option<&'static str> {
    // In a worktree .git is a file.
    let is_clone = machine::root().join(".git").exists();
    match (is_clone, machine::has("git") || machine::has("git.exe")) {
        (false, _) => Some("no .git"),
        (true, false) => Some("no git"),
        (true, true) => None,
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    entry: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// Paths or globs of files that the command writes, or `page.md#heading` for part of a page
    /// that somebody writes.
    files: Vec<String>,
    /// The command to type in the repository's root.
    command: Option<String>,
    /// How the result was made, if no command makes it.
    by_hand: Option<String>,
    /// The result is a page that repeats numbers of other pages. Each paragraph or item of a list
    /// links to the pages of its numbers.
    #[serde(default)]
    quotes: bool,
    /// Paths or globs of the files that determine the result, each with its digest when the result
    /// was made. The digest is empty if the files did not exist, or lay elsewhere, at that time.
    #[serde(default)]
    inputs: BTreeMap<String, String>,
    /// Why the result may be older than its inputs.
    stale: Option<String>,
}

/// The list, and the repository whose git index it is compared with.
struct Sources {
    root: PathBuf,
    text: String,
    entries: Vec<Entry>,
}

impl Sources {
    fn read(root: &Path) -> Result<Self> {
        let text =
            fs::read_to_string(root.join(LIST)).with_context(|| format!("reading {LIST}"))?;
        let list: List = toml_edit::de::from_str(&text).with_context(|| LIST)?;
        for entry in &list.entry {
            let ways = [
                entry.command.is_some(),
                entry.by_hand.is_some(),
                entry.quotes,
            ];
            ensure!(
                ways.iter().filter(|way| **way).count() == 1,
                "{LIST}, {:?}: expected one of `command`, `by_hand` and `quotes`",
                entry.files
            );
        }
        Ok(Sources {
            root: root.to_owned(),
            text,
            entries: list.entry,
        })
    }

    /// Prints every entry with its state.
    fn print(&self) -> Result<()> {
        for entry in &self.entries {
            let state = match (changes(&self.digests(entry)?).is_empty(), &entry.stale) {
                (true, _) => "current",
                (false, Some(_)) => "stale",
                (false, None) => "CHANGED",
            };
            println!("{state:8} {}", entry.files.join(", "));
            let lines = [
                ("", &entry.command),
                ("by hand: ", &entry.by_hand),
                ("stale: ", &entry.stale),
            ];
            for (name, text) in lines {
                if let Some(text) = text {
                    println!(
                        "         {name}{}",
                        text.trim().replace('\n', "\n         ")
                    );
                }
            }
        }
        println!("{}", self.counts());
        Ok(())
    }

    fn counts(&self) -> String {
        let stale = self.entries.iter().filter(|entry| entry.stale.is_some());
        let by_hand = self.entries.iter().filter(|entry| entry.by_hand.is_some());
        format!(
            "{} entries, {} stale, {} by hand",
            self.entries.len(),
            stale.count(),
            by_hand.count()
        )
    }

    /// Fails with a message that lists all faults.
    fn check(&self) -> Result<()> {
        let faults = self.faults()?;
        println!("{}", self.counts());
        for entry in self.entries.iter().filter(|entry| entry.by_hand.is_some()) {
            println!("by hand: {}", entry.files.join(", "));
        }
        ensure!(faults.is_empty(), "{}", faults.join("\n"));
        Ok(())
    }

    /// All faults, one a line, each with what to do about it.
    fn faults(&self) -> Result<Vec<String>> {
        let (mut faults, mut results) = (Vec::new(), BTreeSet::new());
        for entry in &self.entries {
            for name in &entry.files {
                let paths = self.results(name)?;
                if paths.is_empty() {
                    faults.push(format!(
                        "{LIST}: expected a file of git or a heading, got {name:?}, which is none; correct the name, or git add it"
                    ));
                }
                results.extend(paths);
            }
            faults.extend(self.fault_of_age(entry)?);
            if entry.quotes {
                for page in &entry.files {
                    faults.extend(self.wrong_quotes(page)?);
                }
            }
        }
        for path in self.expected_results()?.difference(&results) {
            if self
                .sections(path)?
                .is_some_and(|all| all.is_subset(&results))
            {
                continue;
            }
            faults.push(format!(
                "{path}: expected an entry of {LIST} that makes it, found none; add one with its command and its inputs"
            ));
        }
        Ok(faults)
    }

    /// The sections of a page, as entries name them. `None` for other files and pages without
    /// sections.
    fn sections(&self, path: &str) -> Result<Option<BTreeSet<String>>> {
        if !path.ends_with(".md") {
            return Ok(None);
        }
        let text = fs::read_to_string(self.root.join(path))?;
        let titles = text.lines().filter_map(|line| line.strip_prefix("## "));
        let sections: BTreeSet<_> = titles
            .map(|title| format!("{path}#{}", documents::slug(title)))
            .collect();
        Ok((!sections.is_empty()).then_some(sections))
    }

    /// A fault for each number with a point or comma that no page linked beside it has.
    fn wrong_quotes(&self, page: &str) -> Result<Vec<String>> {
        let text = fs::read_to_string(self.root.join(page))?;
        let mut faults = Vec::new();
        for part in text.replace("\n- ", "\n\n- ").split("\n\n") {
            let links = documents::render(page, part).links.into_iter();
            let pages = links.map(|(target, _)| target);
            let pages: BTreeSet<_> = pages.filter(|target| target.ends_with(".md")).collect();
            let mut texts = String::new();
            for page in &pages {
                texts += &fs::read_to_string(self.root.join(page))?;
            }
            let numbers = numbers(part).into_iter();
            faults.extend(numbers.filter(|number| !texts.contains(number)).map(|number| {
                format!(
                    "{page}: expected {number} on a page that its paragraph links to, found it on none of {pages:?}; correct the number or the link"
                )
            }));
        }
        Ok(faults)
    }

    fn fault_of_age(&self, entry: &Entry) -> Result<Option<String>> {
        let name = &entry.files[..1].concat();
        let digests = self.digests(entry)?;
        if let Some((input, ..)) = digests.iter().find(|(_, _, now)| now.is_empty()) {
            return Ok(Some(format!(
                "{LIST}: expected {name:?} to be made from files of git, got {input:?}, which is none; correct the name"
            )));
        }
        let changed = changes(&digests);
        Ok(match (changed.is_empty(), &entry.stale) {
            (false, None) => Some(format!(
                "{name}: expected it to be made from the present inputs; {}; type `cargo xtask docs {name}`, or say in {LIST} by `stale` why it stays as it is",
                changed.join(", ")
            )),
            (true, Some(why)) => Some(format!(
                "{name}: {LIST} calls it stale ({why}), but its inputs are those that it was made from; delete `stale`"
            )),
            _ => None,
        })
    }

    /// Each input of an entry with its digest when the result was made and its digest now.
    fn digests<'a>(&self, entry: &'a Entry) -> Result<Vec<(&'a str, &'a str, String)>> {
        let inputs = entry.inputs.iter();
        let digests = inputs.map(|(input, before)| {
            let now = self.digest(input)?;
            Ok((input.as_str(), before.as_str(), now))
        });
        digests.collect()
    }

    /// The index of the entry that lists a file.
    fn place(&self, file: &str) -> Result<usize> {
        for (place, entry) in self.entries.iter().enumerate() {
            for name in &entry.files {
                if name == file || self.results(name)?.contains(file) {
                    return Ok(place);
                }
            }
        }
        bail!("expected a file that {LIST} lists, got {file:?}; `cargo xtask docs` shows them")
    }

    /// Runs the command of an entry, unless `note` is set, and notes the digests of its inputs.
    fn make(&self, place: usize, note: bool) -> Result<()> {
        let entry = &self.entries[place];
        let name = &entry.files[..1].concat();
        self.ensure_added(entry)?;
        match (&entry.command, &entry.by_hand) {
            _ if note => {}
            (Some(command), _) => {
                println!("{command}");
                let mut shell = Command::new("sh");
                shell.args(["-ec", command]).current_dir(&self.root);
                let status = shell.status().context("starting sh")?;
                ensure!(status.success(), "{name}: its command failed");
            }
            (None, Some(why)) => bail!(
                "{name}: expected a command, found a result by hand ({why}); make it, then type `cargo xtask docs --note {name}`"
            ),
            (None, None) => bail!(
                "{name}: expected a command, found a page that quotes others; `cargo xtask docs --check` compares it with them"
            ),
        }
        // The command may also have written an input.
        self.ensure_added(entry)?;
        self.note(place)
    }

    /// Fails if an input differs from git's index, from which the digests are computed.
    fn ensure_added(&self, entry: &Entry) -> Result<()> {
        for input in entry.inputs.keys() {
            let changed = self.git(&["diff", "--name-only", "--", &pathspec(input)])?;
            let changed = String::from_utf8_lossy(&changed);
            let mut files = changed.lines().filter(|file| !file.ends_with(".md"));
            ensure!(
                files.next().is_none(),
                "{input}: expected what git has, got something else; git add it, then call this again, with --note where the command has run"
            );
        }
        Ok(())
    }

    fn note(&self, place: usize) -> Result<()> {
        let mut list: DocumentMut = self.text.parse()?;
        let entries = list["entry"].as_array_of_tables_mut();
        let entry = entries.and_then(|entries| entries.get_mut(place));
        let entry = entry.with_context(|| format!("{LIST} has no [[entry]] {place}"))?;
        entry.remove("stale");
        if let Some(inputs) = entry.get_mut("inputs").and_then(Item::as_table_like_mut) {
            for input in self.entries[place].inputs.keys() {
                inputs.insert(input, value(self.digest(input)?));
            }
        }
        fs::write(self.root.join(LIST), list.to_string()).with_context(|| format!("writing {LIST}"))
    }

    /// Files that must belong to an entry: results, model cards, and pictures on pages.
    fn expected_results(&self) -> Result<BTreeSet<String>> {
        let mut expected = BTreeSet::new();
        for results in RESULTS {
            expected.extend(self.tracked(results)?);
        }
        for pages in PAGES {
            for path in self.tracked(pages)? {
                let text = fs::read_to_string(self.root.join(&path))?;
                let links = documents::render(&path, &text).links.into_iter();
                let files = links.map(|(target, _)| target);
                expected.extend(files.filter(|file| {
                    let ending = Path::new(file).extension().unwrap_or_default();
                    PICTURES.iter().any(|picture| ending == *picture)
                }));
            }
        }
        Ok(expected)
    }

    /// The files, or the heading, that a name in `files` stands for.
    fn results(&self, name: &str) -> Result<BTreeSet<String>> {
        let Some((page, heading)) = name.split_once('#') else {
            return self.tracked(name);
        };
        let text = fs::read_to_string(self.root.join(page)).unwrap_or_default();
        let is_there = documents::render(page, &text).anchors.contains(heading);
        Ok(is_there.then(|| name.to_owned()).into_iter().collect())
    }

    /// The files in git's index that match a path or glob.
    fn tracked(&self, pattern: &str) -> Result<BTreeSet<String>> {
        let listing = self.git(&["ls-files", "-z", "--", &pathspec(pattern)])?;
        let paths = String::from_utf8(listing)?;
        Ok(paths.split_terminator('\0').map(str::to_owned).collect())
    }

    /// Twelve hexadecimal digits that identify an input's files in git's index, without pages
    /// (.md). Empty if there are no files. The same as
    /// `git ls-files -sz -- ':(glob)INPUT' | grep -zv '\.md$' | sha256sum | cut -c-12`.
    fn digest(&self, input: &str) -> Result<String> {
        let listing = self.git(&["ls-files", "-sz", "--", &pathspec(input)])?;
        let files = listing.split_inclusive(|byte| *byte == 0);
        let files: Vec<u8> = files
            .filter(|file| !file.ends_with(b".md\0"))
            .flatten()
            .copied()
            .collect();
        let digits = Sha256::digest(&files);
        let digits = digits.iter().take(6).map(|byte| format!("{byte:02x}"));
        Ok(if files.is_empty() {
            String::new()
        } else {
            digits.collect()
        })
    }

    /// Runs git in the repository and returns what it prints.
    fn git(&self, words: &[&str]) -> Result<Vec<u8>> {
        let mut git = Command::new("git");
        let output = git.args(words).current_dir(&self.root).output();
        let output = output.context("starting git")?;
        let message = String::from_utf8_lossy(&output.stderr);
        ensure!(
            output.status.success(),
            "git {}: {message}",
            words.join(" ")
        );
        Ok(output.stdout)
    }
}

/// The inputs that have changed, each with both digests.
fn changes(digests: &[(&str, &str, String)]) -> Vec<String> {
    let changed = digests.iter().filter(|(_, before, now)| now != before);
    changed
        .map(|(input, before, now)| format!("{input} was {before:?} and is {now:?}"))
        .collect()
}

/// The numbers in a text that have a point or comma between digits: "0.94", "26,719".
fn numbers(text: &str) -> Vec<&str> {
    let words = text.split(|c: char| !(c.is_ascii_digit() || c == '.' || c == ','));
    let words = words.map(|word| word.trim_matches(['.', ',']));
    words.filter(|word| word.contains(['.', ','])).collect()
}

fn pathspec(pattern: &str) -> String {
    format!(":(glob){pattern}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENTRIES: &str = "# What makes what.\n\
        [[entry]]\n\
        files = [\"docs/measured/*\", \"docs/page.md#a-table\"]\n\
        command = \"echo 2 > docs/measured/quality.md\"\n\
        inputs = { \"weights/talk/voice\" = \"@\" } # the model\n\
        \n\
        [[entry]]\n\
        files = [\"docs/images/a.png\", \"weights/talk/voice/README.md\"]\n\
        by_hand = \"drawn\"\n";

    /// A repository in which everything has an entry. Dropping it deletes it.
    struct Repository(PathBuf);

    impl Repository {
        fn new(name: &str) -> Self {
            let process = std::process::id();
            let root = std::env::temp_dir().join(format!("anyface-docs-{name}-{process}"));
            machine::empty(&root).unwrap();
            let repository = Repository(root);
            repository.git(&["init", "--quiet"]);
            for (path, text) in [
                (
                    "README.md",
                    "![a](docs/images/a.png) [out](https://example.org/b.png)",
                ),
                ("docs/page.md", "# Page\n## A table\n"),
                ("docs/measured/quality.md", "1"),
                ("docs/images/a.png", "picture"),
                ("weights/talk/voice/README.md", "card"),
                ("weights/talk/voice/model.gz", "numbers"),
                (LIST, ENTRIES),
            ] {
                repository.write(path, text);
            }
            let digest = repository.sources().digest("weights/talk/voice").unwrap();
            assert_eq!(digest.len(), 12);
            repository.write(LIST, &ENTRIES.replace('@', &digest));
            repository
        }

        fn git(&self, words: &[&str]) {
            let mut git = Command::new("git");
            assert!(
                git.args(words)
                    .current_dir(&self.0)
                    .status()
                    .unwrap()
                    .success()
            );
        }

        fn write(&self, path: &str, text: &str) {
            let file = self.0.join(path);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, text).unwrap();
            self.git(&["add", path]);
        }

        fn change_list(&self, from: &str, to: &str) {
            let text = fs::read_to_string(self.0.join(LIST)).unwrap();
            assert!(text.contains(from), "{text}");
            self.write(LIST, &text.replace(from, to));
        }

        fn sources(&self) -> Sources {
            Sources::read(&self.0).unwrap()
        }

        /// The one fault that there is.
        fn fault(&self) -> String {
            let faults = self.sources().faults().unwrap();
            assert_eq!(faults.len(), 1, "{faults:?}");
            faults.concat()
        }
    }

    impl Drop for Repository {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn a_complete_list_has_no_fault() {
        let repository = Repository::new("complete");
        assert_eq!(repository.sources().faults().unwrap(), [""; 0]);
        repository.write("weights/talk/voice/README.md", "the card in other words");
        assert_eq!(repository.sources().faults().unwrap(), [""; 0]);
        assert_eq!(
            repository.sources().counts(),
            "2 entries, 0 stale, 1 by hand"
        );
    }

    #[test]
    fn results_without_an_entry_are_faults() {
        let repository = Repository::new("orphans");
        repository.write("docs/images/b.png", "picture");
        assert!(
            repository
                .fault()
                .starts_with("docs/images/b.png: expected an entry")
        );
        repository.change_list("a.png", "*.png");
        repository.write("docs/page.md", "# Page\n## A table\n![c](../site/c.png)\n");
        assert!(
            repository
                .fault()
                .starts_with("site/c.png: expected an entry")
        );
        repository.write("docs/page.md", "# Page\n## A table\n");
        repository.write("weights/talk/ear/README.md", "card");
        assert!(
            repository
                .fault()
                .starts_with("weights/talk/ear/README.md: expected an entry")
        );
    }

    #[test]
    fn a_page_may_have_an_entry_for_each_section() {
        let repository = Repository::new("sections");
        let page = "# Voice\n## Its data\n## Its limits\n";
        repository.write("weights/talk/voice/README.md", page);
        repository.change_list("voice/README.md", "voice/README.md#its-data");
        assert!(
            repository
                .fault()
                .starts_with("weights/talk/voice/README.md: expected an entry")
        );
        let both = "#its-data\", \"weights/talk/voice/README.md#its-limits";
        repository.change_list("#its-data", both);
        assert_eq!(repository.sources().faults().unwrap(), [""; 0]);
    }

    #[test]
    fn names_of_no_file_and_of_no_heading_are_faults() {
        let repository = Repository::new("names");
        repository.change_list(
            "\"docs/measured/*\"",
            "\"docs/measured/*\", \"docs/gone.md\"",
        );
        assert!(
            repository
                .fault()
                .contains("got \"docs/gone.md\", which is none")
        );
        repository.change_list("docs/gone.md", "docs/page.md#b");
        assert!(
            repository
                .fault()
                .contains("got \"docs/page.md#b\", which is none")
        );
        repository.change_list("docs/page.md#b", "docs/page.md#page");
        repository.change_list("weights/talk/voice\" =", "weights/talk/gone\" =");
        assert!(
            repository
                .fault()
                .contains("got \"weights/talk/gone\", which is none")
        );
    }

    #[test]
    fn a_result_older_than_its_inputs_says_so() {
        let repository = Repository::new("age");
        repository.write("weights/talk/voice/model.gz", "other numbers");
        let fault = repository.fault();
        assert!(fault.starts_with("docs/measured/*: expected"), "{fault}");
        assert!(fault.contains("weights/talk/voice was \""), "{fault}");
        repository.change_list(
            "[[entry]]\nfiles = [\"docs/m",
            "[[entry]]\nstale = \"Soon.\"\nfiles = [\"docs/m",
        );
        assert_eq!(repository.sources().faults().unwrap(), [""; 0]);
        repository.write("weights/talk/voice/model.gz", "numbers");
        assert!(repository.fault().contains("delete `stale`"));
    }

    #[test]
    fn a_command_makes_a_result_and_its_inputs_are_noted() {
        let repository = Repository::new("make");
        let model = repository.0.join("weights/talk/voice/model.gz");
        fs::write(
            repository.0.join("weights/talk/voice/README.md"),
            "other words",
        )
        .unwrap();
        fs::write(&model, "numbers of tomorrow").unwrap();
        let make = |file, note| {
            let sources = repository.sources();
            sources.make(sources.place(file)?, note)
        };
        let made = |note| make("docs/measured/quality.md", note);
        assert!(
            made(false)
                .unwrap_err()
                .to_string()
                .contains("git add it, then")
        );
        repository.write("weights/talk/voice/model.gz", "numbers of tomorrow");
        repository.change_list("# the model\n", "# the model\nstale = \"Soon.\"\n");
        made(true).unwrap();
        let page = repository.0.join("docs/measured/quality.md");
        assert_eq!(fs::read_to_string(&page).unwrap(), "1");
        assert_eq!(repository.sources().faults().unwrap(), [""; 0]);
        made(false).unwrap();
        assert_eq!(fs::read_to_string(&page).unwrap(), "2\n");
        let list = fs::read_to_string(repository.0.join(LIST)).unwrap();
        assert!(
            list.starts_with("# What makes what.") && list.contains("# the model"),
            "{list}"
        );
        assert!(!list.contains("stale"), "{list}");
        let message = |file| make(file, false).unwrap_err().to_string();
        assert!(message("docs/images/a.png").contains("(drawn)"));
        assert!(message("docs/none.md").contains("expected a file that"));
    }

    #[test]
    fn quoted_numbers_stand_on_the_pages_beside_them() {
        let repository = Repository::new("quotes");
        repository.write("docs/measured/quality.md", "r is 0.94 of 1,500 frames");
        repository.change_list("\"docs/measured/*\"", "\"docs/measured/quality.md\"");
        let entry = "\n[[entry]]\nfiles = [\"docs/measured/README.md\"]\nquotes = true\n";
        repository.change_list(
            "by_hand = \"drawn\"\n",
            &format!("by_hand = \"drawn\"\n{entry}"),
        );
        let page = |first: &str, second: &str| {
            let text = format!("# All\n- [One](quality.md): {first}.\n- Two: {second}, 2 of 3.\n");
            repository.write("docs/measured/README.md", &text);
        };
        page("0.94, 1,500", "5");
        assert_eq!(repository.sources().faults().unwrap(), [""; 0]);
        page("0.95", "5");
        let fault = repository.fault();
        assert!(fault.contains("expected 0.95 on a page"), "{fault}");
        page("0.94", "0.94");
        assert!(repository.fault().contains("found it on none of {}"));
    }

    #[test]
    fn an_entry_has_a_command_or_says_why_it_has_none() {
        let repository = Repository::new("either");
        repository.change_list("by_hand = \"drawn\"\n", "");
        let message = Sources::read(&repository.0).err().unwrap().to_string();
        assert!(
            message.contains("one of `command`, `by_hand` and `quotes`"),
            "{message}"
        );
        repository.change_list("inputs = ", "input = ");
        assert!(Sources::read(&repository.0).is_err());
    }
}
