"""Pages of the site in Chromium: full addresses, light and dark schemes, and no fault for axe.

Without Chromium or npm the test is ignored, or fails if `CI` is set.
"""

import os
import shutil
import sys

import pytest

from conftest import ROOT, install_npm, served

sys.path.insert(0, str(ROOT / "tests/web"))
browser = pytest.importorskip("browser")
AXE = "axe-core@4.14.1"
FAULTS = (
    "axe.run().then((r) => r.violations.map((v) => v.id + ': ' + "
    "v.nodes.map((n) => n.html).join()))"
)
PAGES = ("index.html", "docs/index.html", "docs/python.html", "extensions/index.html")


@pytest.fixture(scope="module")
def axe(tmp_path_factory):
    """The source text of axe."""
    if not any(map(shutil.which, browser.BROWSERS)):
        if os.environ.get("CI"):
            pytest.fail("Chromium is not installed")
        pytest.skip("ignored: Chromium is not installed")
    packages = install_npm(AXE, tmp_path_factory.mktemp("axe"))
    return (packages / "axe-core/axe.min.js").read_text()


@pytest.mark.parametrize("path", PAGES)
def test_axe_finds_nothing_in_light_and_dark(path, site, axe):
    with served(site) as address:
        page = browser.Page(f"{address}/{path}")
        try:
            browser.wait(lambda: page.read("document.readyState === 'complete' && !!document.body"))
            if path == "index.html":
                shown = page.read("document.querySelector('[data-address]').textContent")
                assert shown == f"{address}/extensions/index.json"
            page.read(axe + "; 0")
            grounds = set()
            for scheme in ("light", "dark"):
                page.prefer(scheme)
                assert page.read(FAULTS) == []
                grounds.add(page.read("getComputedStyle(document.body).backgroundColor"))
                page.photograph(site.parent / f"{path.replace('/', '-')}-{scheme}.png")
            assert len(grounds) == 2
        finally:
            page.close()
