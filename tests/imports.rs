//! No file imports itself through others.
//!
//! A file imports another where it names something that the other defines, in a `use` or by a path. A `pub use` is
//! a signpost: it imports nothing by itself, and whoever takes a name from it imports the file that defines the
//! name, as the signpost's own file does where it uses the name besides. Tests, comments and texts do not count.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

/// Folders of sources, each with a root of its own.
const CRATES: [&str; 5] = [
    "rust-core/src",
    "cli/src",
    "capi/src",
    "packaging/src",
    "tests/eval/src",
];

/// Names of modules from the root of a crate.
type Module = Vec<String>;

/// A name that a file takes from somewhere.
struct Import {
    path: Module,
    /// What it is called in the file.
    name: String,
    is_signpost: bool,
}

/// What one file says.
#[derive(Default)]
struct Source {
    imports: Vec<Import>,
    /// Paths that stand in the code itself.
    paths: Vec<Module>,
    defined: BTreeSet<String>,
    /// Words outside of every `use`.
    words: BTreeSet<String>,
    /// Modules below it that only tests have.
    of_tests: BTreeSet<String>,
}

/// Words and signs of a source, without comments, texts, letters and lifetimes.
fn tokens(text: &str) -> Vec<String> {
    let letters: Vec<char> = text.chars().collect();
    let (mut out, mut i) = (Vec::new(), 0);
    let at = |i: usize| letters.get(i).copied().unwrap_or('\0');
    while i < letters.len() {
        let raw = letters[i..]
            .iter()
            .skip(1)
            .take_while(|c| **c == '#')
            .count();
        match (at(i), at(i + 1)) {
            ('/', '/') => i += letters[i..].iter().take_while(|c| **c != '\n').count(),
            ('r', '"' | '#') if at(i + 1 + raw) == '"' => {
                let end: String = std::iter::once('"')
                    .chain("#".repeat(raw).chars())
                    .collect();
                let rest: String = letters[i + 2 + raw..].iter().collect();
                let inside = rest.split(&end).next().unwrap_or_default();
                i += 2 + raw + inside.chars().count() + end.len();
            }
            ('"', _) => {
                i += 1;
                while i < letters.len() && at(i) != '"' {
                    i += 1 + usize::from(at(i) == '\\');
                }
                i += 1;
            }
            ('\'', '\\') => i += 3 + letters[i + 3..].iter().take_while(|c| **c != '\'').count(),
            ('\'', _) if at(i + 2) == '\'' => i += 3,
            // A lifetime.
            ('\'', _) => {
                let name = letters[i + 1..].iter();
                i += 1 + name
                    .take_while(|c| c.is_alphanumeric() || **c == '_')
                    .count();
            }
            (':', ':') => {
                out.push("::".to_owned());
                i += 2;
            }
            (c, _) if c.is_alphanumeric() || c == '_' => {
                let is_part = |c: &&char| c.is_alphanumeric() || **c == '_';
                let word: String = letters[i..].iter().take_while(is_part).collect();
                i += word.chars().count();
                out.push(word);
            }
            (c, _) => {
                if !c.is_whitespace() {
                    out.push(c.to_string());
                }
                i += 1;
            }
        }
    }
    out
}

/// Number of the token behind the item that begins at `start`.
fn end_of_item(tokens: &[String], start: usize) -> usize {
    let mut depth = 0;
    for (i, token) in tokens.iter().enumerate().skip(start) {
        match token.as_str() {
            "{" | "(" | "[" => depth += 1,
            "}" | ")" | "]" => depth -= 1,
            ";" if depth == 0 => return i + 1,
            _ => {}
        }
        if depth == 0 && token == "}" {
            return i + 1;
        }
    }
    tokens.len()
}

/// The names of a `use`, whose tokens stand between the word and the semicolon.
fn leaves(tokens: &[String], before: &[String], out: &mut Vec<(Module, String)>) {
    let mut path = before.to_vec();
    let mut i = 0;
    while i < tokens.len() {
        match tokens[i].as_str() {
            "::" => {}
            "{" => {
                let mut depth = 0;
                let mut start = i + 1;
                for j in i..tokens.len() {
                    match tokens[j].as_str() {
                        "{" => depth += 1,
                        "}" => depth -= 1,
                        _ => {}
                    }
                    let ends = (depth == 1 && tokens[j] == ",") || depth == 0;
                    if ends {
                        if start < j {
                            leaves(&tokens[start..j], &path, out);
                        }
                        start = j + 1;
                    }
                    if depth == 0 {
                        return;
                    }
                }
                return;
            }
            "as" => return out.push((path, tokens[i + 1].clone())),
            "self" if !path.is_empty() => {}
            word => path.push(word.to_owned()),
        }
        i += 1;
    }
    let name = path.last().cloned().unwrap_or_default();
    out.push((path, name));
}

fn read(text: &str) -> Source {
    let mut all = tokens(text);
    let mut source = Source::default();
    // Without what only tests have.
    let mut i = 0;
    while i + 6 < all.len() {
        let is_of_tests = all[i..i + 6] == ["#", "[", "cfg", "(", "test", ")"];
        if is_of_tests {
            let item = i + 7;
            let end = end_of_item(&all, item);
            if let Some(at) = all[item..end].iter().take(5).position(|t| t == "mod") {
                source.of_tests.insert(all[item + at + 1].clone());
            }
            all.drain(i..end);
        } else {
            i += 1;
        }
    }
    let mut i = 0;
    while i < all.len() {
        let before = i.checked_sub(1).map_or("", |b| all[b].as_str());
        match all[i].as_str() {
            "use" => {
                let length = all[i..].iter().position(|token| token == ";");
                let end = i + length.expect("a use ends") + 1;
                let mut names = Vec::new();
                leaves(&all[i + 1..end - 1], &[], &mut names);
                let is_signpost = before == "pub" || before == ")";
                source
                    .imports
                    .extend(names.into_iter().map(|(path, name)| Import {
                        path,
                        name,
                        is_signpost,
                    }));
                i = end;
                continue;
            }
            "struct" | "enum" | "fn" | "trait" | "type" | "const" | "static" | "mod" => {
                if let Some(name) = all.get(i + 1) {
                    source.defined.insert(name.clone());
                    // A module in a file of its own is not defined here.
                    if all[i] == "mod" && all.get(i + 2).is_some_and(|t| t == ";") {
                        source.defined.remove(name);
                        i += 3;
                        continue;
                    }
                }
            }
            word if word.starts_with(|c: char| c.is_alphabetic() || c == '_') => {
                source.words.insert(word.to_owned());
                if all.get(i + 1).is_some_and(|t| t == "::") && before != "::" {
                    let steps = all[i..].chunks(2);
                    let steps = steps
                        .take_while(|s| s[0].starts_with(|c: char| c.is_alphabetic() || c == '_'));
                    let mut path = Vec::new();
                    for step in steps {
                        path.push(step[0].clone());
                        if step.get(1).is_none_or(|t| t != "::") {
                            break;
                        }
                    }
                    source.paths.push(path);
                }
            }
            _ => {}
        }
        i += 1;
    }
    source
}

/// The sources of one crate by their modules.
struct Crate {
    sources: BTreeMap<Module, Source>,
    files: BTreeMap<Module, String>,
}

impl Crate {
    fn read(folder: &str) -> Crate {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("..")
            .join(folder);
        let mut of_crate = Crate {
            sources: BTreeMap::new(),
            files: BTreeMap::new(),
        };
        of_crate.add(&root, &Vec::new());
        let tests: Vec<Module> = of_crate
            .sources
            .iter()
            .flat_map(|(module, source)| {
                let below =
                    |name: &String| [module.as_slice(), std::slice::from_ref(name)].concat();
                source.of_tests.iter().map(below).collect::<Vec<_>>()
            })
            .collect();
        of_crate
            .sources
            .retain(|module, _| !tests.iter().any(|test| module.starts_with(test)));
        of_crate
    }

    fn add(&mut self, folder: &Path, module: &Module) {
        for entry in fs::read_dir(folder).unwrap().flatten() {
            let (path, name) = (entry.path(), entry.file_name().into_string().unwrap());
            if path.is_dir() {
                self.add(&path, &[module.as_slice(), &[name]].concat());
                continue;
            }
            let Some(stem) = name.strip_suffix(".rs") else {
                continue;
            };
            let has_library = folder.join("lib.rs").exists();
            let own = match stem {
                "main" if has_library => continue,
                "mod" | "lib" | "main" => module.clone(),
                _ => [module.as_slice(), &[stem.to_owned()]].concat(),
            };
            let text = fs::read_to_string(&path).unwrap();
            self.sources.insert(own.clone(), read(&text));
            self.files.insert(own, path.display().to_string());
        }
    }

    /// A path of a file from the root of the crate; `None` where it leads elsewhere.
    fn absolute(&self, of: &Module, path: &[String]) -> Option<Module> {
        let mut at = of.clone();
        let mut rest = path;
        match path.first()?.as_str() {
            "crate" => (at, rest) = (Vec::new(), &path[1..]),
            "self" => rest = &path[1..],
            "super" => {
                while rest.first().is_some_and(|step| step == "super") {
                    at.pop()?;
                    rest = &rest[1..];
                }
            }
            first => {
                let below = [of.as_slice(), &[first.to_owned()]].concat();
                if !self.sources.contains_key(&below) {
                    let source = &self.sources[of];
                    let known = source.imports.iter().find(|import| import.name == first)?;
                    if known.path.first()? == first {
                        return None;
                    }
                    let start = self.absolute(of, &known.path)?;
                    return Some([start.as_slice(), &path[1..]].concat());
                }
            }
        }
        Some([at.as_slice(), rest].concat())
    }

    /// The file that defines what an absolute path names.
    fn file_of(&self, path: &[String], depth: usize) -> Option<Module> {
        let mut at = Vec::new();
        for (i, step) in path.iter().enumerate() {
            let below = [at.as_slice(), std::slice::from_ref(step)].concat();
            if self.sources.contains_key(&below) {
                at = below;
                continue;
            }
            let source = self.sources.get(&at)?;
            if source.defined.contains(step) || depth > 8 {
                return Some(at);
            }
            let named = source.imports.iter().find(|import| import.name == *step);
            let globs = source.imports.iter().filter(|import| import.name == "*");
            for import in named.into_iter().chain(globs) {
                let Some(mut next) = self.absolute(&at, &import.path) else {
                    continue;
                };
                if next.last().is_some_and(|last| last == "*") {
                    next.pop();
                    next.push(step.clone());
                }
                next.extend_from_slice(&path[i + 1..]);
                return self.file_of(&next, depth + 1);
            }
            return Some(at);
        }
        self.sources.contains_key(&at).then_some(at)
    }

    /// Which files each file imports, and by which names.
    fn imports(&self) -> BTreeMap<Module, BTreeMap<Module, BTreeSet<String>>> {
        let of_file = |(module, source): (&Module, &Source)| {
            let used = source.imports.iter();
            let used = used.filter(|i| !i.is_signpost || source.words.contains(&i.name));
            let paths = used.map(|import| &import.path).chain(&source.paths);
            let mut others: BTreeMap<Module, BTreeSet<String>> = BTreeMap::new();
            for path in paths {
                let Some(absolute) = self.absolute(module, path) else {
                    continue;
                };
                let named = absolute.strip_suffix(&["*".to_owned()]);
                let file = self.file_of(named.unwrap_or(&absolute), 0);
                if let Some(file) = file.filter(|file| file != module) {
                    let names = others.entry(file).or_default();
                    names.extend(path.last().cloned());
                }
            }
            (module.clone(), others)
        };
        self.sources.iter().map(of_file).collect()
    }

    /// Groups of files each of which imports itself through the others of its group.
    fn circles(&self) -> Vec<String> {
        let imports = self.imports();
        let reached = |from: &Module| {
            let mut found = BTreeSet::new();
            let mut left: Vec<&Module> = imports[from].keys().collect();
            while let Some(next) = left.pop() {
                if found.insert(next.clone()) {
                    left.extend(imports[next].keys());
                }
            }
            found
        };
        let reached: BTreeMap<&Module, BTreeSet<Module>> = imports
            .keys()
            .map(|module| (module, reached(module)))
            .collect();
        let group = |module: &&Module| -> BTreeSet<Module> {
            let back = reached[*module].iter();
            back.filter(|other| reached[*other].contains(*module))
                .cloned()
                .collect()
        };
        let groups: BTreeSet<BTreeSet<Module>> = imports.keys().map(|m| group(&m)).collect();
        let shown = |group: &BTreeSet<Module>| {
            let lines = group.iter().map(|module| {
                let inside = imports[module]
                    .iter()
                    .filter(|(other, _)| group.contains(*other));
                let inside = inside.map(|(other, names)| format!("{} {names:?}", other.join("::")));
                let inside: Vec<String> = inside.collect();
                format!("  {} imports {}", module.join("::"), inside.join(", "))
            });
            lines.collect::<Vec<_>>().join("\n")
        };
        groups
            .iter()
            .filter(|group| !group.is_empty())
            .map(shown)
            .collect()
    }
}

#[test]
fn no_file_imports_itself_through_others() {
    let circles = CRATES.iter().flat_map(|folder| {
        let circles = Crate::read(folder).circles();
        circles
            .into_iter()
            .map(move |circle| format!("{folder}:\n{circle}"))
    });
    let circles: Vec<String> = circles.collect();
    assert!(
        circles.is_empty(),
        "{} circles\n{}",
        circles.len(),
        circles.join("\n")
    );
}
