"""A VRM avatar speaks with `anyface live` on the page docs/examples/three-vrm.html in a browser.

The test needs chromium, and npm to fetch three and @pixiv/three-vrm into target/vrm. Without them
it is ignored. A run leaves pictures of the face at each sound and at a blink in target/vrm.
"""

import functools
import http.server
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import avatar
import pytest

from conftest import RATE_HZ, vowels

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "tests/web"))
browser = pytest.importorskip("browser")
COMMAND = os.environ.get("ANYFACE_COMMAND", str(ROOT / "target/debug/anyface"))
FOLDER = ROOT / "target/vrm"


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files and writes no log."""

    def log_message(self, *_):
        """Says nothing."""


@pytest.fixture(scope="module")
def place():
    """Address of a server for the page, the avatar and the packages."""
    if shutil.which("npm") is None or not any(map(shutil.which, browser.BROWSERS)):
        pytest.skip("ignored: npm or chromium is not installed")
    FOLDER.mkdir(parents=True, exist_ok=True)
    if not (FOLDER / "node_modules/@pixiv/three-vrm").is_dir():
        words = ["npm", "install", "--silent", "--no-audit", "three", "@pixiv/three-vrm"]
        if subprocess.run(words, cwd=FOLDER, check=False).returncode != 0:
            pytest.skip("ignored: npm cannot fetch three and @pixiv/three-vrm")
    avatar.write(FOLDER / "avatar.vrm")
    shutil.copy(ROOT / "docs/examples/three-vrm.html", FOLDER)
    handler = functools.partial(Quiet, directory=FOLDER)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/three-vrm.html"
        server.shutdown()


def test_an_avatar_speaks_blinks_and_shuts_its_mouth(place):
    words = [COMMAND, "live", "--input", "-", "--any-sound", "--websocket", "127.0.0.1:0"]
    live = subprocess.Popen(words, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=False)
    socket = live.stderr.readline().decode().split()[-1].strip('"}').rstrip(".")
    page = browser.Page(f"{place}?socket={socket}", size=(400, 400))
    is_over = threading.Event()
    threading.Thread(target=speak, args=(live.stdin, is_over), daemon=True).start()
    try:
        browser.wait(lambda: (page.read("window.anyface?.frames") or 0) > 5)
        matches = {}
        conditions = {
            "a": lambda w: w["aa"] > 0.4,
            "u": lambda w: w["ou"] + w["oh"] > 0.3 and w["aa"] < 0.3,
            "m": lambda w: sum(w[name] for name in ("aa", "ih", "ou", "ee", "oh")) < 0.05,
            "blink": lambda w: w["blinkLeft"] > 0.7 and w["blinkRight"] > 0.7,
        }
        end = time.monotonic() + 40.0
        while len(matches) < len(conditions) and time.monotonic() < end:
            weights = page.read("window.anyface.weights")
            for name, is_so in conditions.items():
                if name not in matches and is_so(weights):
                    page.photograph(FOLDER / f"{name}.png")
                    matches[name] = weights
        assert matches.keys() == conditions.keys(), matches
    finally:
        is_over.set()
        page.close()
        live.kill()
        live.wait()


def speak(pipe, is_over: threading.Event) -> None:
    """Sends the sounds in real time, again and again, until `is_over` is set."""
    sound, block = vowels(), 2 * RATE_HZ // 50
    begun = time.monotonic()
    for number in range(10**6):
        at = number * block % (len(sound) - block)
        try:
            pipe.write(sound[at : at + block])
            pipe.flush()
        except OSError:
            return
        if is_over.wait(max(0.0, begun + number / 50 - time.monotonic())):
            return
