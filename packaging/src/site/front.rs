//! The first page: what each part is and how to install it from this site.

use std::path::PathBuf;

use super::{
    frame::framed,
    parts::{Parts, name, system_of},
};

/// A script that writes addresses out in full. Without JavaScript the page shows the relative ones.
const ADDRESSES: &str = "<script>\nfor (const place of document.querySelectorAll(\"[data-address]\"))\n  \
    place.textContent = new URL(place.dataset.address, document.baseURI).href;\n</script>";

/// The page at the top of the site.
pub fn page(parts: &Parts) -> String {
    let mut body = format!(
        "<h1>Anyface {}</h1>\n<p>Anyface makes any face mesh talk: speech goes in, facial animation comes out, on a plain CPU. \
         <a href=\"docs/index.html\">The documents</a> say how.</p>\n",
        env!("CARGO_PKG_VERSION")
    );
    for (title, text) in sections(parts) {
        let text = text.unwrap_or("<p class=\"quiet\">Not part of this site.</p>".to_owned());
        body += &format!("<section>\n<h2>{title}</h2>\n{text}\n</section>\n");
    }
    let missing = parts.missing();
    if !missing.is_empty() {
        let lines: String = missing
            .iter()
            .map(|line| format!("<li>{line}</li>\n"))
            .collect();
        body += &format!(
            "<section>\n<h2>What this site lacks</h2>\n<ul>\n{}</ul>\n</section>\n",
            lines.replace("(`", "(<code>").replace("`)", "</code>)")
        );
    }
    framed("Speech in, facial animation out", 0, &(body + ADDRESSES))
}

/// The title and the text of each section. The text is `None` if the site lacks that part.
fn sections(parts: &Parts) -> [(&'static str, Option<String>); 5] {
    [
        ("Blender", blender(parts)),
        ("Python", python(parts)),
        ("In the browser", browser(parts)),
        ("JavaScript", javascript(parts)),
        ("C and C++", downloads(parts)),
    ]
}

fn blender(parts: &Parts) -> Option<String> {
    let link = |path: &PathBuf| {
        let (name, system) = (name(path), system_of(path).unwrap_or_default());
        let query = format!(
            "repository=.%2Findex.json&amp;blender_version_min=4.2.0&amp;platforms={system}"
        );
        format!("<li><a href=\"extensions/{name}?{query}\">{name}</a></li>\n")
    };
    let links: String = parts.extensions.iter().map(link).collect();
    (!links.is_empty()).then(|| {
        format!(
            "<p>Blender 4.2 or newer. In <em>Edit → Preferences → Get Extensions → Repositories → + → Add Remote \
             Repository</em> enter</p>\n<pre><code data-address=\"extensions/index.json\">extensions/index.json</code></pre>\n\
             <p>then find <em>Anyface</em> under <em>Get Extensions</em>. Blender offers new versions from there. Or drag the \
             link for your system into Blender:</p>\n<ul>\n{links}</ul>"
        )
    })
}

fn python(parts: &Parts) -> Option<String> {
    (!parts.wheels.is_empty()).then(|| {
        "<p>Python 3.10 or newer; numpy comes from where your pip usually looks.</p>\n\
         <pre><code>pip install anyface --find-links <span data-address=\"wheels/anyface/\">wheels/anyface/</span></code></pre>\n\
         <p><a href=\"wheels/anyface/index.html\">All wheels</a>; <a href=\"docs/python.html\">how the package is used</a>.</p>"
            .to_owned()
    })
}

fn browser(parts: &Parts) -> Option<String> {
    parts.web.as_ref().map(|_| {
        "<p><a href=\"web/index.html\">Drop a head and a sound, or speak into the microphone</a>. Nothing leaves your machine.</p>"
            .to_owned()
    })
}

fn javascript(parts: &Parts) -> Option<String> {
    let archive = parts.downloads.iter().map(|path| name(path));
    let archive = archive.into_iter().find(|name| name.ends_with(".tgz"))?;
    let address = address(parts, &archive);
    let install = match &parts.downloads_page {
        None => format!("<span data-address=\"{address}\">{address}</span>"),
        Some(_) => format!("./{archive}"),
    };
    Some(format!(
        "<p>For pages and programs of your own, <a href=\"{address}\">{archive}</a>:</p>\n\
         <pre><code>npm install {install}</code></pre>\n<p><a href=\"docs/web.html\">How the package is used</a>.</p>"
    ))
}

fn downloads(parts: &Parts) -> Option<String> {
    let mut links = String::new();
    for path in parts
        .downloads
        .iter()
        .filter(|path| !name(path).ends_with(".tgz"))
    {
        let name = name(path);
        links += &format!(
            "<li><a href=\"{}\">{name}</a></li>\n",
            address(parts, &name)
        );
    }
    (!links.is_empty()).then(|| {
        let sums = match &parts.downloads_page {
            None => "; <a href=\"downloads/SHA256SUMS\">SHA256SUMS</a> has their digests",
            Some(_) => "",
        };
        format!(
            "<p>Header, shared and static library, files of pkg-config and CMake as an archive for each system, and as a \
             Debian package (<code>sudo apt install ./libanyface-dev_….deb</code>){sums}. <a href=\"docs/c-host.html\">How \
             a host calls it</a>.</p>\n<ul>\n{links}</ul>"
        )
    })
}

/// The address of a download on this site, or of the page that has all downloads.
fn address(parts: &Parts, name: &str) -> String {
    match &parts.downloads_page {
        Some(page) => page.clone(),
        None => format!("downloads/{name}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn downloads_lead_to_the_page_that_has_them() {
        let mut parts = Parts {
            downloads: vec![
                "p/anyface-0.1.0-linux-x64.tar.gz".into(),
                "w/anyface-0.1.0.tgz".into(),
            ],
            ..Parts::default()
        };
        let here = page(&parts);
        assert!(
            here.contains("href=\"downloads/anyface-0.1.0-linux-x64.tar.gz\""),
            "{here}"
        );
        assert!(here.contains("downloads/SHA256SUMS"));
        let release = "https://example.org/releases/v0.1.0";
        parts.downloads_page = Some(release.to_owned());
        let elsewhere = page(&parts);
        assert_eq!(elsewhere.matches(&format!("href=\"{release}\"")).count(), 2);
        assert!(elsewhere.contains("npm install ./anyface-0.1.0.tgz"));
        assert!(!elsewhere.contains("downloads/"), "{elsewhere}");
    }
}
