//! Makes the text of THIRD-PARTY.md from the output of cargo-about: a table of crates, and each
//! licence once.
//!
//! Files of the same licence differ in their line breaks, in their copyright lines and in the text
//! after the terms of Apache-2.0. The text that they share is written once, below a list of the
//! copyright lines.

use std::{
    cmp::Reverse,
    collections::{BTreeMap, BTreeSet},
};

use anyhow::{Context, Result, ensure};
use serde_json::Value;

/// The placeholder for the copyright holder in a licence that nobody has filled in.
const NOBODY: &str = "<year> <copyright holders>";

/// The Markdown fence around a licence text.
const FENCE: &str = "```";

/// Fills the page's template with the JSON of cargo-about.
///
/// # Errors
/// If the JSON lacks a field, or a licence has no holder.
pub fn page(template: &str, list_of_crates: &Value) -> Result<String> {
    let mut crates = BTreeMap::new();
    for entry in list(list_of_crates, "crates")? {
        let package = &entry["package"];
        if is_of_others(package) {
            crates.insert(release(package)?, row(package, text(entry, "license")?)?);
        }
    }
    let mozilla = crates.iter().filter(|(_, row)| row.contains("MPL-2.0"));
    let sources =
        mozilla.map(|((name, version), _)| format!("- https://crates.io/crates/{name}/{version}"));
    let sources: Vec<String> = sources.collect();
    let rows: Vec<String> = crates.into_values().collect();
    Ok(template
        .replace("@MOZILLA@", &sources.join("\n"))
        .replace("@CRATES@", &rows.join("\n"))
        .replace("@TEXTS@", &licences(list_of_crates)?))
}

/// A crate's name and version.
type Release = (String, String);

fn release(package: &Value) -> Result<Release> {
    let part = |name| text(package, name).map(str::to_owned);
    Ok((part("name")?, part("version")?))
}

fn row(package: &Value, licence: &str) -> Result<String> {
    let (name, version) = release(package)?;
    let repository = package["repository"].as_str().unwrap_or_default();
    Ok(format!("| {name} | {version} | {licence} | {repository} |"))
}

/// Whether others wrote the crate. Our own crates come from a folder and have no source.
fn is_of_others(package: &Value) -> bool {
    package["source"].is_string()
}

/// The text that all crates with the same terms share, and who holds the copyright of which crate.
#[derive(Default)]
struct Terms {
    text: String,
    /// The copyright lines, each with the crates whose files contain it.
    holders: BTreeMap<String, BTreeSet<Release>>,
}

impl Terms {
    /// The number of crates with these terms.
    fn count(&self) -> usize {
        self.holders.values().map(BTreeSet::len).sum()
    }
}

/// All licences by name. Among texts of the same name, the most frequent comes first.
fn licences(list_of_crates: &Value) -> Result<String> {
    let mut all: BTreeMap<(String, String), Terms> = BTreeMap::new();
    for licence in list(list_of_crates, "licenses")? {
        let name = text(licence, "name")?;
        for user in list(licence, "used_by")? {
            let package = &user["crate"];
            if !is_of_others(package) {
                continue;
            }
            let filled = text(licence, "text")?.replace(NOBODY, &authors(package)?);
            ensure!(
                !filled.contains("<year>"),
                "{name}: expected {NOBODY} as the holder, got {filled:?}"
            );
            ensure!(
                !filled.contains(FENCE),
                "{name}: expected a text without {FENCE}, got {filled:?}"
            );
            for (holders, terms) in parts(&filled) {
                let entry = all.entry((name.to_owned(), key(&terms))).or_default();
                entry.text = terms;
                let releases = entry.holders.entry(holders).or_default();
                releases.insert(release(package)?);
            }
        }
    }
    let mut all: Vec<(String, Terms)> = all
        .into_iter()
        .map(|((name, _), terms)| (name, terms))
        .collect();
    all.sort_by_key(|(name, terms)| (name.clone(), Reverse(terms.count())));
    Ok(all
        .iter()
        .map(|(name, terms)| section(name, terms))
        .collect())
}

fn section(name: &str, terms: &Terms) -> String {
    let mut section = format!("\n### {name}\n");
    for (holder, releases) in &terms.holders {
        let releases: Vec<String> = releases
            .iter()
            .map(|(name, version)| format!("{name} {version}"))
            .collect();
        let colon = if holder.is_empty() { "" } else { ": " };
        section += &format!("- {holder}{colon}{}\n", releases.join(", "));
    }
    section + &format!("\n{FENCE}text\n{}\n{FENCE}\n", terms.text)
}

/// The authors that the manifest names, for a crate whose package has no licence file.
fn authors(package: &Value) -> Result<String> {
    let names = list(package, "authors")?.iter().filter_map(Value::as_str);
    // Some authors have left their address empty.
    let names: Vec<&str> = names.map(|name| name.trim_end_matches(" <>")).collect();
    Ok(if names.is_empty() {
        format!("the authors of {}", text(package, "name")?)
    } else {
        names.join(", ")
    })
}

/// Splits a licence file into pairs of copyright lines and the terms that they belong to. Text
/// after Apache-2.0, such as an exception, becomes a pair of its own.
fn parts(text: &str) -> Vec<(String, String)> {
    let text = text.replace('\r', "");
    let Some((terms, form, rest)) = around_form(&text) else {
        return vec![without_title(&text)];
    };
    let lines = form.lines().map(str::trim);
    let holders = lines.filter(|line| is_copyright(line) && !line.contains("yyyy"));
    let mut parts = vec![(holders.collect::<Vec<_>>().join("; "), terms.to_owned())];
    if !rest.is_empty() {
        parts.push((String::new(), rest.to_owned()));
    }
    parts
}

/// The copyright lines, and the terms without these lines and without the title.
fn without_title(text: &str) -> (String, String) {
    let mut paragraphs: Vec<&str> = paragraphs(text).collect();
    if paragraphs.first().is_some_and(|first| is_title(first)) {
        paragraphs.remove(0);
    }
    let is_above = |paragraph: &&&str| is_copyright(paragraph);
    let count = paragraphs.iter().take_while(is_above).count();
    let holders: Vec<String> = paragraphs.drain(..count).map(one_line).collect();
    let holders = holders.join("; ").replace(" Copyright ", "; Copyright ");
    (holders.replace(";;", ";"), paragraphs.join("\n\n"))
}

/// The paragraphs between empty lines, each with its indentation.
fn paragraphs(text: &str) -> impl Iterator<Item = &str> {
    let parts = text.split("\n\n").map(|part| part.trim_matches('\n'));
    parts
        .map(str::trim_end)
        .filter(|part| !part.trim().is_empty())
}

/// The terms of Apache-2.0, the form for a notice after them, and the rest of the text.
fn around_form(text: &str) -> Option<(&str, &str, &str)> {
    const TERMS_END: &str = "END OF TERMS AND CONDITIONS";
    // The end of the notice itself, or of the advice before it if somebody has left the notice out.
    const FORM_ENDS: [&str; 2] = ["limitations under the License.", "third-party archives."];
    let terms_end = text.find(TERMS_END)? + TERMS_END.len();
    let (terms, rest) = text.split_at(terms_end);
    let terms = terms.trim_matches('\n');
    if rest.trim().is_empty() {
        return Some((terms, "", ""));
    }
    let mut ends = FORM_ENDS.iter();
    let form_end = ends.find_map(|end| Some(rest.find(end)? + end.len()))?;
    let (form, rest) = rest.split_at(form_end);
    let is_form = form.trim().starts_with("APPENDIX") || is_copyright(form);
    is_form.then_some((terms, form, rest.trim()))
}

fn is_title(paragraph: &str) -> bool {
    let line = one_line(paragraph);
    line.len() < 40 && line.contains("MIT") && line.contains("License")
}

fn is_copyright(paragraph: &str) -> bool {
    ["Copyright ", "(C) "]
        .iter()
        .any(|start| paragraph.trim_start().starts_with(start))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Terms have the same key if they differ only in white space or in http and https.
fn key(terms: &str) -> String {
    one_line(terms).replace("https://", "http://")
}

fn list<'a>(value: &'a Value, name: &str) -> Result<&'a Vec<Value>> {
    let list = value[name].as_array();
    list.with_context(|| {
        format!(
            "expected a list {name:?} from cargo-about, got {}",
            value[name]
        )
    })
}

fn text<'a>(value: &'a Value, name: &str) -> Result<&'a str> {
    let text = value[name].as_str();
    text.with_context(|| {
        format!(
            "expected a text {name:?} from cargo-about, got {}",
            value[name]
        )
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn package(name: &str) -> Value {
        json!({
            "name": name,
            "version": "1.0.0",
            "source": "registry+https://github.com/rust-lang/crates.io-index",
            "repository": format!("https://example.org/{name}"),
            "authors": ["Somebody <>"],
        })
    }

    fn licence(name: &str, text: &str, users: &[Value]) -> Value {
        let used_by: Vec<Value> = users.iter().map(|user| json!({"crate": user})).collect();
        json!({"name": name, "text": text, "used_by": used_by})
    }

    #[test]
    fn terms_are_written_once_below_their_holders() {
        let ours = json!({"name": "anyface", "version": "0.1.0", "source": null, "authors": []});
        let list_of_crates = json!({
            "crates": [
                {"package": package("one"), "license": "MIT"},
                {"package": package("two"), "license": "MPL-2.0"},
                {"package": ours, "license": "MIT"},
            ],
            "licenses": [
                licence("MIT", "MIT License\n\nCopyright 1\n\nDo what\nyou like.\n", &[package("one")]),
                licence("MIT", "Copyright 2\nand others\n\nDo what you\r\nlike.", &[package("two")]),
                licence("MIT", "Copyright 3\n\nDo what you like.", &[ours]),
                licence("MIT", "Do something else.", &[package("one")]),
            ],
        });
        let page = page("@MOZILLA@\n@CRATES@\n@TEXTS@", &list_of_crates).unwrap();
        assert_eq!(
            page,
            "- https://crates.io/crates/two/1.0.0\n\
             | one | 1.0.0 | MIT | https://example.org/one |\n\
             | two | 1.0.0 | MPL-2.0 | https://example.org/two |\n\
             \n### MIT\n- Copyright 1: one 1.0.0\n- Copyright 2 and others: two 1.0.0\n\
             \n```text\nDo what you\nlike.\n```\n\
             \n### MIT\n- one 1.0.0\n\n```text\nDo something else.\n```\n"
        );
    }

    #[test]
    fn a_form_that_nobody_has_filled_in_is_left_out() {
        let terms = "Apache\n\nEND OF TERMS AND CONDITIONS".to_owned();
        let form = |line: &str, rest: &str| {
            let form = format!("APPENDIX: how to\n\n  {line}\n\nlimitations under the License.");
            parts(&format!("\n{terms}\n\n{form}\n{rest}"))
        };
        let nobody = (String::new(), terms.clone());
        assert_eq!(
            form("Copyright [yyyy] [name]", ""),
            std::slice::from_ref(&nobody)
        );
        let holder = "Copyright 2020 A".to_owned();
        assert_eq!(form(&holder, ""), [(holder.clone(), terms.clone())]);
        let exception = (String::new(), "An exception.".to_owned());
        assert_eq!(form("", "An exception.\n"), [nobody, exception]);
        let advice = format!("{terms}\n\nAPPENDIX: how to\n\nwithin third-party archives.\n");
        assert_eq!(parts(&advice), [(String::new(), terms.clone())]);
        let other = format!("{terms}\n\nSomething else.");
        assert_eq!(parts(&other), [(String::new(), other.clone())]);
    }

    #[test]
    fn a_licence_without_holder_names_the_authors_or_is_an_error() {
        let page_of = |text: &str| {
            let licences = [licence("MIT", text, &[package("one")])];
            page("@TEXTS@", &json!({"crates": [], "licenses": licences}))
        };
        let filled = page_of("Copyright (c) <year> <copyright holders>\n\nTerms.").unwrap();
        assert!(
            filled.contains("- Copyright (c) Somebody: one 1.0.0"),
            "{filled}"
        );
        let error = page_of("Copyright (c) <year> <owner>\n\nTerms.").unwrap_err();
        assert!(error.to_string().contains("MIT"), "{error}");
    }
}
