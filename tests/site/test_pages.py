"""Pages of the site: links have a target, nothing loads from other hosts, gaps are explained."""

import hashlib
import html.parser
import urllib.parse

from conftest import HERE


class Page(html.parser.HTMLParser):
    """The links of a page, the files that it loads, and the names within it."""

    def __init__(self, text):
        super().__init__()
        self.links, self.loaded, self.names, self.tags = [], [], set(), []
        self.without_words = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        """Notes one element."""
        values = dict(attributes)
        self.tags.append(tag)
        self.names |= {values[key] for key in ("id", "name") if values.get(key)}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        elif tag == "link":
            self.loaded.append(values["href"])
        elif "src" in values:
            self.loaded.append(values["src"])
        if tag == "img" and "alt" not in values:
            self.without_words.append(values.get("src"))


def pages(site):
    """Pages by path, except those that `cargo xtask web` makes and the examples to copy."""
    others = {"web", "examples"}
    paths = [path for path in site.rglob("*.html") if not others.intersection(path.parts)]
    return {path.resolve(): Page(path.read_text()) for path in paths}


def test_every_link_leads_to_a_file_and_a_name_in_it(site):
    known = pages(site)
    assert len(known) > 30
    for path, page in known.items():
        for link in page.links + page.loaded:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme:
                continue
            target = path.parent / urllib.parse.unquote(parts.path) if parts.path else path
            target = (target / "index.html" if target.is_dir() else target).resolve()
            assert target.is_file() and target.is_relative_to(site), f"{path}: {link}"
            if parts.fragment and target in known and "wheels" not in target.parts:
                assert parts.fragment in known[target].names, f"{path}: {link}"


def test_nothing_is_loaded_from_other_hosts(site):
    for path, page in pages(site).items():
        others = [link for link in page.loaded if urllib.parse.urlsplit(link).netloc]
        assert not others, f"{path}: {others}"
    assert "url(" not in (site / "style.css").read_text()


def test_every_page_has_a_language_a_title_and_words_for_its_pictures(site):
    for path, page in pages(site).items():
        text = path.read_text()
        assert '<html lang="en">' in text and "<title>" in text, path
        assert not page.without_words, f"{path}: {page.without_words}"
        assert page.tags.count("h1") >= 1, path
    style = (site / "style.css").read_text()
    assert "prefers-color-scheme: dark" in style


def test_what_is_missing_is_said_by_the_task_and_on_the_page(site):
    said = (site.parent / "said.txt").read_text()
    front = (site / "index.html").read_text()
    for words in ("the Python wheel for macos-arm64", "the C library for windows-x64"):
        assert f"missing  {words}" in said and f"<li>{words}</li>" in front
    for words in ("the Blender extension for windows-x64", f"the Python wheel for {HERE}"):
        assert words not in said and words not in front


def test_digests_of_downloads_are_theirs(site):
    lines = (site / "downloads/SHA256SUMS").read_text().splitlines()
    names = dict(reversed(line.split("  ")) for line in lines)
    assert f"anyface-0.1.0-{HERE}.tar.gz" in names
    for name, digest in names.items():
        content = (site / "downloads" / name).read_bytes()
        assert hashlib.sha256(content).hexdigest() == digest
