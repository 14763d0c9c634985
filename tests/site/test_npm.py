"""npm installs the package from the site, and Node imports it.

`cargo xtask web` must have built the package.
"""

import os
import shutil
import subprocess

import pytest

from conftest import ROOT, served, write_site

WEB = ROOT / "target/web"
IMPORT = 'import("anyface").then((anyface) => console.log(Object.keys(anyface).join(" ")));'


def test_it_installs_and_node_imports_it(tmp_path):
    if not (WEB / "index.html").is_file():
        pytest.skip("ignored: `cargo xtask web` was not run")
    web, out, page = (tmp_path / name for name in ("web", "site", "page"))
    shutil.copytree(WEB, web)
    pack = ["npm", "pack", "--silent", "--pack-destination", web]
    archive = subprocess.run(
        pack, cwd=web / "anyface", capture_output=True, text=True, check=True
    ).stdout.strip()
    (tmp_path / "none").mkdir()
    write_site(out, "--packages", tmp_path / "none", "--web", web)
    assert (out / "web/index.html").is_file() and not (out / "web" / archive).exists()
    page.mkdir()
    with served(out) as address:
        install = ["npm", "install", "--silent", "--no-audit", f"{address}/downloads/{archive}"]
        environment = {**os.environ, "npm_config_cache": str(tmp_path / "cache")}
        subprocess.run(install, cwd=page, env=environment, check=True)
    done = subprocess.run(
        ["node", "-e", IMPORT], cwd=page, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and "load" in done.stdout.split(), done.stdout + done.stderr
