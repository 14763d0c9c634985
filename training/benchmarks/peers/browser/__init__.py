"""Runs the npm peers in a headless Chromium. A page runs them on sounds, a server collects their outputs."""

import functools
import json
import shutil
import subprocess
import tempfile
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--mute-audio")
TOOLS = ("headaudio", "wlipsync", "wawa_lipsync")


class Handler(SimpleHTTPRequestHandler):
    """Serves the files of the page, the packages and the sounds. `POST` receives outputs and `/end`."""

    def __init__(self, *arguments, work: Path, task: dict, ended: threading.Event, errors: list, **more):
        self.work, self.task, self.ended, self.errors = work, task, ended, errors
        super().__init__(*arguments, **more)

    def translate_path(self, path: str) -> str:
        """The path on disk of a requested file."""
        path = path.split("?")[0]
        for start, folder in (("/packages/", "npm/node_modules"), ("/sounds/", "sounds")):
            if path.startswith(start):
                return str(self.work / folder / path[len(start) :])
        return str(HERE / path.lstrip("/"))

    def guess_type(self, path: str) -> str:
        """Browsers load modules only if their type is JavaScript."""
        return "text/javascript" if path.endswith((".mjs", ".js")) else super().guess_type(path)

    def do_GET(self) -> None:
        """Sends `/task.json` or a file."""
        if self.path == "/task.json":
            names = [n for n in self.task["names"] if not heard(self.work, n)]
            self.answer(json.dumps(self.task | {"names": names}).encode())
        else:
            super().do_GET()

    def do_POST(self) -> None:
        """Receives `/outputs/<tool>/<name>` or `/end`."""
        message = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        if self.path == "/end":
            self.errors += [message["error"]] if "error" in message else []
            self.ended.set()
        else:
            out = self.work / f"{self.path.lstrip('/')}.npz"
            out.parent.mkdir(parents=True, exist_ok=True)
            np.savez(out, times_s=np.array(message["times"]), values=np.array(message["values"]))
        self.answer(b"{}")

    def answer(self, body: bytes) -> None:
        """Sends a short JSON."""
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_) -> None:
        """Logs nothing."""


def heard(work: Path, name: str) -> bool:
    """Whether all tools have outputs for the sound `name`."""
    return all((work / "outputs" / tool / f"{name}.npz").exists() for tool in TOOLS)


def run_browser(work: Path, names: list[str], profile: dict, limit_s: float) -> None:
    """Runs the page's tools from `work/npm` on `work/sounds`; `profile` is a voice for wLipSync.

    Raises `RuntimeError` if no Chromium is found, the page fails, or it takes longer than `limit_s`.
    """
    command = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if command is None:
        raise RuntimeError("expected Chromium (`apt install chromium`), got none")
    ended, errors = threading.Event(), []
    task = {"names": names, "profile": profile}
    handler = functools.partial(Handler, work=work.resolve(), task=task, ended=ended, errors=errors)
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as user:
        page = f"http://127.0.0.1:{server.server_port}/index.html"
        line = [command, *FLAGS, f"--user-data-dir={user}", page]
        process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            if not ended.wait(limit_s):
                errors.append(f"no end after {limit_s:.0f} s")
        finally:
            process.terminate()
            process.wait()
            server.shutdown()
    if errors:
        raise RuntimeError(f"{page}: {errors[0]}")
