//! Checks that no file imports itself through others, and that the folders of the library import
//! only folders that ARCHITECTURE.md lists above them.
//!
//! A file imports another if it names something that the other defines, in a `use` or by a path. A
//! `pub use` is a signpost and imports nothing by itself: a file that takes a name from it imports
//! the file that defines the name. The signpost's own file imports it too if it also uses the name
//! elsewhere. Tests, comments and string literals do not count.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{self, PathBuf},
};

use proc_macro2::{Spacing, TokenStream, TokenTree};
use syn::{
    Attribute, Ident, ImplItemFn, ItemFn, ItemMod, ItemUse, Macro, Path, UseTree, Visibility,
    visit::{self, Visit},
};

/// Source folders of the crates, each with its own root module.
const CRATES: [&str; 6] = [
    "rust-core/src",
    "cli/src",
    "capi/src",
    "microphone/src",
    "packaging/src",
    "tests/eval/src",
];

/// Names of modules from the root of a crate.
type Module = Vec<String>;

/// A name that a file imports with `use`.
struct Import {
    path: Module,
    /// Its name in the file.
    name: String,
    is_signpost: bool,
}

/// The imports and paths of one file.
#[derive(Default)]
struct Source {
    imports: Vec<Import>,
    /// Paths in the code outside of every `use`.
    paths: Vec<Module>,
    /// Words of all paths outside of every `use`.
    words: BTreeSet<String>,
    /// Child modules that are compiled only for tests.
    of_tests: BTreeSet<String>,
}

impl Source {
    fn read(text: &str) -> Source {
        let mut source = Source::default();
        source.visit_file(&syn::parse_file(text).expect("a source is Rust"));
        source
    }

    fn add_path(&mut self, path: Module) {
        self.words.extend(path.iter().cloned());
        if path.len() > 1 {
            self.paths.push(path);
        }
    }

    /// Adds the paths in a macro's arguments, whatever their syntax.
    fn add_tokens(&mut self, tokens: TokenStream) {
        let mut path = Module::new();
        let mut goes_on = false;
        for token in tokens {
            match token {
                TokenTree::Ident(word) => {
                    if !goes_on {
                        self.add_path(std::mem::take(&mut path));
                    }
                    path.push(word.to_string());
                    goes_on = false;
                }
                TokenTree::Punct(sign) if sign.as_char() == ':' => {
                    goes_on |= sign.spacing() == Spacing::Joint;
                }
                TokenTree::Group(group) => self.add_tokens(group.stream()),
                _ => goes_on = false,
            }
        }
        self.add_path(path);
    }

    /// Adds the names that a `use` imports.
    fn add_names(&mut self, tree: &UseTree, before: &[String], is_signpost: bool) {
        let below = |name: &Ident| [before, &[name.to_string()]].concat();
        let (path, name) = match tree {
            UseTree::Path(path) => {
                return self.add_names(&path.tree, &below(&path.ident), is_signpost);
            }
            UseTree::Group(group) => {
                for tree in &group.items {
                    self.add_names(tree, before, is_signpost);
                }
                return;
            }
            UseTree::Name(name) if name.ident == "self" => (before.to_vec(), None),
            UseTree::Name(name) => (below(&name.ident), None),
            UseTree::Rename(rename) => (below(&rename.ident), Some(rename.rename.to_string())),
            // None of our own modules is imported with a glob.
            UseTree::Glob(_) => return,
        };
        let name = name.or_else(|| path.last().cloned()).unwrap_or_default();
        self.imports.push(Import {
            path,
            name,
            is_signpost,
        });
    }
}

fn is_of_tests(attributes: &[Attribute]) -> bool {
    let mut conditions = attributes.iter().filter(|a| a.path().is_ident("cfg"));
    conditions.any(|a| a.parse_args::<Path>().is_ok_and(|of| of.is_ident("test")))
}

impl Visit<'_> for Source {
    fn visit_item_mod(&mut self, module: &ItemMod) {
        if is_of_tests(&module.attrs) {
            self.of_tests.insert(module.ident.to_string());
        } else {
            visit::visit_item_mod(self, module);
        }
    }

    fn visit_item_fn(&mut self, function: &ItemFn) {
        if !is_of_tests(&function.attrs) {
            visit::visit_item_fn(self, function);
        }
    }

    fn visit_impl_item_fn(&mut self, function: &ImplItemFn) {
        if !is_of_tests(&function.attrs) {
            visit::visit_impl_item_fn(self, function);
        }
    }

    fn visit_item_use(&mut self, import: &ItemUse) {
        let is_signpost = !matches!(import.vis, Visibility::Inherited);
        self.add_names(&import.tree, &[], is_signpost);
    }

    fn visit_path(&mut self, path: &Path) {
        let words = path.segments.iter();
        self.add_path(words.map(|word| word.ident.to_string()).collect());
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, call: &Macro) {
        self.add_tokens(call.tokens.clone());
    }
}

fn root() -> PathBuf {
    path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The sources of one crate by module.
struct Crate {
    sources: BTreeMap<Module, Source>,
}

impl Crate {
    fn read(folder: &str) -> Crate {
        let mut of_crate = Crate {
            sources: BTreeMap::new(),
        };
        of_crate.add(&root().join(folder), &Vec::new());
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

    fn add(&mut self, folder: &path::Path, module: &Module) {
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
            let module = match stem {
                "main" if has_library => continue,
                "mod" | "lib" | "main" => module.clone(),
                _ => [module.as_slice(), &[stem.to_owned()]].concat(),
            };
            let text = fs::read_to_string(&path).unwrap();
            self.sources.insert(module, Source::read(&text));
        }
    }

    /// Turns a path in the file `of` into one from the root of the crate. `None` if it leads out of
    /// the crate.
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

    /// Finds the file that defines the item at an absolute path.
    fn file_of(&self, path: &[String], depth: usize) -> Option<Module> {
        let mut at = Vec::new();
        for (i, step) in path.iter().enumerate() {
            let below = [at.as_slice(), std::slice::from_ref(step)].concat();
            if self.sources.contains_key(&below) {
                at = below;
                continue;
            }
            // An import of this name leads on. Without one, the name is defined here.
            let named = self.sources.get(&at)?.imports.iter();
            let mut named = named.filter(|import| import.name == *step && depth < 8);
            let next = named.find_map(|import| self.absolute(&at, &import.path));
            return match next {
                Some(next) => self.file_of(&[&next, &path[i + 1..]].concat(), depth + 1),
                None => Some(at),
            };
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
                let file = self.file_of(&absolute, 0);
                if let Some(file) = file.filter(|file| file != module) {
                    let names = others.entry(file).or_default();
                    names.extend(path.last().cloned());
                }
            }
            (module.clone(), others)
        };
        self.sources.iter().map(of_file).collect()
    }

    /// Groups of files that import each other in a circle, as text.
    fn circles(&self) -> Vec<String> {
        let imports = self.imports();
        let reached = |from: &Module| {
            let mut reached_modules = BTreeSet::new();
            let mut left: Vec<&Module> = imports[from].keys().collect();
            while let Some(next) = left.pop() {
                if reached_modules.insert(next.clone()) {
                    left.extend(imports[next].keys());
                }
            }
            reached_modules
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

/// The folders of the library in the order in which the tree of ARCHITECTURE.md lists them.
fn floors() -> Vec<String> {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let entries = text.lines().filter_map(|line| line.strip_prefix("  src/"));
    let folders = entries.filter_map(|entry| entry.split_once("/ "));
    folders.map(|(folder, _)| folder.to_owned()).collect()
}

#[test]
fn the_tree_of_the_architecture_lists_every_folder_of_the_library() {
    let entries = fs::read_dir(root().join(CRATES[0])).unwrap().flatten();
    let names = entries.map(|entry| entry.file_name().into_string().unwrap());
    let listed = floors().into_iter();
    let listed = listed.chain(["error.rs", "lib.rs"].map(ToOwned::to_owned));
    assert_eq!(
        names.collect::<BTreeSet<_>>(),
        listed.collect::<BTreeSet<_>>()
    );
}

#[test]
fn folders_of_the_library_import_only_those_above_them() {
    let mut floors = floors();
    floors.insert(0, "error".to_owned());
    // The library's root belongs to no floor.
    let floor = |file: &Module| floors.iter().position(|name| Some(name) == file.first());
    let mut upwards = Vec::new();
    for (file, others) in Crate::read(CRATES[0]).imports() {
        for (other, names) in others {
            if floor(&other) > floor(&file) && !file.is_empty() {
                let [file, other] = [file.join("::"), other.join("::")];
                upwards.push(format!("{file} imports {other} {names:?}"));
            }
        }
    }
    assert!(upwards.is_empty(), "{}", upwards.join("\n"));
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
