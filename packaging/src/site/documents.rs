//! Writes the documents as pages, with every file of the repository that they link to. A broken
//! link is an error.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use anyhow::{Context, Result, ensure};
use pulldown_cmark::{CowStr, Event, HeadingLevel, LinkType, Options, Parser, Tag, TagEnd, html};

use super::frame;

/// Documents outside `docs` that are written even if no other document links to them.
const FIRST: [&str; 2] = ["README.md", "CHANGELOG.md"];
/// Subfolder of the documents for every file that lies outside `docs` in the repository.
const BESIDE: &str = "repository";

/// A document as a page.
pub struct Page {
    title: String,
    body: String,
    /// The names that an address may give after a `#`.
    pub anchors: BTreeSet<String>,
    /// Paths in the repository that the page links to, each with its anchor, or "" for none.
    pub links: Vec<(String, String)>,
}

/// Writes the documents of the repository `root` into the folder `out` and returns their number.
///
/// # Errors
/// If a link names a file or a heading that does not exist.
pub fn write(root: &Path, out: &Path) -> Result<usize> {
    let mut waiting: BTreeSet<String> = FIRST.map(str::to_owned).into();
    for folder in ["docs", "docs/measured"] {
        for entry in fs::read_dir(root.join(folder))? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            if name.ends_with(".md") {
                waiting.insert(format!("{folder}/{name}"));
            }
        }
    }
    let mut pages: BTreeMap<String, Page> = BTreeMap::new();
    let mut files = BTreeSet::new();
    while let Some(path) = waiting.pop_first() {
        let from = root.join(&path);
        if !path.ends_with(".md") {
            let to = out.join(place(&path));
            fs::create_dir_all(to.parent().unwrap_or(out))?;
            fs::copy(&from, to)
                .with_context(|| format!("copying {path}, to which a document links"))?;
            files.insert(path);
            continue;
        }
        let text = fs::read_to_string(&from)
            .with_context(|| format!("reading {path}, to which a document links"))?;
        let page = render(&path, &text);
        let targets = page.links.iter().map(|(target, _)| target.clone());
        let new = targets.filter(|target| !pages.contains_key(target) && !files.contains(target));
        waiting.extend(new.filter(|target| *target != path));
        pages.insert(path, page);
    }
    for (path, page) in &pages {
        for (target, anchor) in &page.links {
            let is_there = pages
                .get(target)
                .is_none_or(|page| page.anchors.contains(anchor));
            ensure!(
                anchor.is_empty() || is_there,
                "{path} links to {target}#{anchor}: expected a heading of that name"
            );
        }
        let to = out.join(place(path));
        let depth = 1 + place(path).matches('/').count();
        fs::create_dir_all(to.parent().unwrap_or(out))?;
        fs::write(to, frame::framed(&page.title, depth, &page.body))?;
    }
    fs::write(out.join("index.html"), index(&pages))?;
    Ok(pages.len())
}

/// The page that lists the documents, with those of the folder `docs` first.
fn index(pages: &BTreeMap<String, Page>) -> String {
    let line = |(path, page): (&String, &Page)| {
        format!("<li><a href=\"{}\">{}</a></li>\n", place(path), page.title)
    };
    let (documents, others): (Vec<_>, Vec<_>) = pages
        .iter()
        .partition(|(path, _)| path.starts_with("docs/"));
    let documents: String = documents.into_iter().map(line).collect();
    let others: String = others.into_iter().map(line).collect();
    let body = format!(
        "<h1>Documents</h1>\n<ul>\n{documents}</ul>\n<h2>Of the repository</h2>\n<ul>\n{others}</ul>"
    );
    frame::framed("Documents", 1, &body)
}

/// The path of a file of the repository within the site's folder of documents.
fn place(path: &str) -> String {
    let place = match path.strip_prefix("docs/") {
        Some(inside) => inside.to_owned(),
        None => format!("{BESIDE}/{path}"),
    };
    match place.strip_suffix(".md") {
        Some(stem) => format!("{stem}.html"),
        None => place,
    }
}

/// The document at `path` of the repository as HTML.
pub fn render(path: &str, text: &str) -> Page {
    let options =
        Options::ENABLE_TABLES | Options::ENABLE_STRIKETHROUGH | Options::ENABLE_FOOTNOTES;
    let mut events: Vec<Event> = Parser::new_ext(text, options).collect();
    let (mut title, mut anchors, mut links) = (None, BTreeSet::new(), Vec::new());
    for at in 0..events.len() {
        if let Event::Html(html) | Event::InlineHtml(html) = &events[at] {
            anchors.extend(named(html));
        }
        if matches!(events[at], Event::Start(Tag::Heading { .. })) {
            let words = heading(&events[at..]);
            let anchor = unused(&anchors, &slug(&words));
            if let Event::Start(Tag::Heading { id, level, .. }) = &mut events[at] {
                *id = Some(CowStr::from(anchor.clone()));
                if *level == HeadingLevel::H1 {
                    title.get_or_insert(escaped(&words));
                }
            }
            anchors.insert(anchor);
        }
        if let Event::Start(
            Tag::Link {
                dest_url,
                link_type,
                ..
            }
            | Tag::Image {
                dest_url,
                link_type,
                ..
            },
        ) = &mut events[at]
            && *link_type != LinkType::Email
            && let Some((target, anchor)) = target(path, dest_url)
        {
            *dest_url = CowStr::from(address(path, &target, &anchor));
            links.push((target, anchor));
        }
    }
    let mut body = String::new();
    html::push_html(&mut body, events.into_iter());
    // An empty header cell would be a heading without text.
    let body = body.replace("<th></th>", "<td></td>");
    let title = title.unwrap_or_else(|| path.to_owned());
    Page {
        title,
        body,
        anchors,
        links,
    }
}

/// The plain words of the heading at the start of `events`.
fn heading(events: &[Event]) -> String {
    let inside = events
        .iter()
        .take_while(|event| !matches!(event, Event::End(TagEnd::Heading(_))));
    let words = inside.filter_map(|event| match event {
        Event::Text(text) | Event::Code(text) => Some(text.as_ref()),
        Event::SoftBreak => Some(" "),
        _ => None,
    });
    words.collect()
}

/// The anchor that GitHub gives a heading.
pub fn slug(words: &str) -> String {
    let lower = words.to_lowercase();
    let letters = lower
        .chars()
        .filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    letters.map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// `name`, or `name` with a number appended if the name is taken.
fn unused(anchors: &BTreeSet<String>, name: &str) -> String {
    let numbered = (1..).map(|number| format!("{name}-{number}"));
    let mut names = std::iter::once(name.to_owned()).chain(numbered);
    names
        .find(|name| !anchors.contains(name))
        .unwrap_or_default()
}

/// The anchors that HTML within a document sets: `<a name="gpu">`.
fn named(html: &str) -> impl Iterator<Item = String> + '_ {
    let names = html.split("name=\"").skip(1);
    names.filter_map(|rest| rest.split('"').next().map(str::to_owned))
}

/// The path in the repository and the anchor that a link in the document `path` leads to. `None`
/// for links to other hosts.
fn target(path: &str, link: &str) -> Option<(String, String)> {
    if link.contains("://") || link.starts_with("mailto:") {
        return None;
    }
    let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
    if file.is_empty() {
        return Some((path.to_owned(), anchor.to_owned()));
    }
    let mut parts: Vec<&str> = path.split('/').collect();
    parts.pop();
    for part in file.split('/') {
        match part {
            ".." => drop(parts.pop()),
            "." | "" => {}
            part => parts.push(part),
        }
    }
    Some((parts.join("/"), anchor.to_owned()))
}

/// The relative address of `target` from the page of `path`.
fn address(path: &str, target: &str, anchor: &str) -> String {
    let up = "../".repeat(place(path).matches('/').count());
    let mark = if anchor.is_empty() { "" } else { "#" };
    format!("{up}{}{mark}{anchor}", place(target))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_lead_from_page_to_page_and_headings_have_names() {
        let text = "# One `two`\n## A, b & c\n## A, b & c\n<a name=\"old\"></a>\n\
            [up](../README.md) [here](#a-b--c-1) [side](rig.md#avatars) <a@b.org> [out](https://example.org/x.md) ![p](images/a.png)\n";
        let page = render("docs/live.md", text);
        assert_eq!(page.title, "One two");
        let anchors = ["a-b--c", "a-b--c-1", "old", "one-two"].map(str::to_owned);
        assert_eq!(page.anchors, anchors.into());
        for part in [
            "href=\"repository/README.html\"",
            "href=\"live.html#a-b--c-1\"",
            "href=\"rig.html#avatars\"",
            "href=\"https://example.org/x.md\"",
            "src=\"images/a.png\"",
        ] {
            assert!(page.body.contains(part), "{part}: {}", page.body);
        }
        let card = render(
            "weights/shared/rig/README.md",
            "[rig](../../../docs/rig.md)",
        );
        let expected = "href=\"../../../../rig.html\"";
        assert!(card.body.contains(expected), "{}", card.body);
    }

    #[test]
    fn a_link_that_leads_nowhere_is_named() {
        let root = std::env::temp_dir().join(format!("anyface-documents-{}", std::process::id()));
        fs::create_dir_all(root.join("docs/measured")).unwrap();
        for name in FIRST {
            fs::write(root.join(name), "# Title\n").unwrap();
        }
        let out = root.join("out");
        fs::write(root.join("docs/a.md"), "[b](../README.md#title)\n").unwrap();
        assert_eq!(write(&root, &out).unwrap(), 3);
        for (link, word) in [
            ("b.md", "b.md"),
            ("../README.md#else", "#else"),
            ("p.png", "p.png"),
        ] {
            fs::write(root.join("docs/a.md"), format!("[b]({link})\n")).unwrap();
            let words = write(&root, &out).unwrap_err().to_string();
            assert!(words.contains(word), "{words}");
        }
        fs::remove_dir_all(root).unwrap();
    }
}
