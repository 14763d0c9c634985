"""A page in headless Chromium, controlled over the protocol of its developer tools."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

from websockets.sync.client import connect

# Names of the browser's command on different systems.
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_KEYS = {"Tab": 9, "Enter": 13, " ": 32, "Home": 36, "ArrowLeft": 37, "ArrowDown": 40, "Escape": 27}


def wait(is_so, seconds: float = 120.0):
    """Waits until `is_so()` is true and returns its value; fails after `seconds`."""
    end = time.monotonic() + seconds
    while not (answer := is_so()):
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.05)
    return answer


class Page:
    """A page in a browser of its own.

    `prefix` holds words before the browser's command, such as `taskset`.
    """

    def __init__(self, address: str, flags=(), prefix=(), size=(1280, 800)):
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._process = subprocess.Popen(
            [
                *prefix,
                next(filter(shutil.which, BROWSERS)),
                "--headless=new",
                "--no-sandbox",
                "--remote-debugging-port=0",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                f"--window-size={size[0]},{size[1]}",
                f"--user-data-dir={self._folder.name}",
                *flags,
                "about:blank",
            ],
            stderr=subprocess.DEVNULL,
        )
        port_file = Path(self._folder.name) / "DevToolsActivePort"
        wait(lambda: port_file.is_file() and len(port_file.read_text().split()) == 2)
        self._number = 0
        port, browser = port_file.read_text().split()
        self._socket = connect(f"ws://127.0.0.1:{port}{browser}", max_size=None)
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._socket.close()
        self._socket = connect(f"ws://127.0.0.1:{port}/devtools/page/{target}", max_size=None)
        self.said = []
        self.call("Runtime.enable")
        self.call("Log.enable")
        self.call("Page.enable")
        width, height = size
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        self.call("Page.navigate", url=address)

    def call(self, method: str, **parameters):
        """Sends a command; returns the browser's answer."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while (answer := json.loads(self._socket.recv(timeout=120))).get("id") != self._number:
            if answer.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded"):
                self.said.append(json.dumps(answer["params"]))
        assert "result" in answer, answer
        return answer["result"]

    def read(self, expression: str):
        """Value of a JavaScript expression; waits for it if it is a promise."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """Presses and releases a key."""
        code = _KEYS[key]
        text = {"Enter": "\r", " ": " "}.get(key, "")
        of_key = {"key": key, "windowsVirtualKeyCode": code, "code": "Space" if key == " " else key}
        down = "keyDown" if text else "rawKeyDown"
        self.call("Input.dispatchKeyEvent", type=down, text=text, **of_key)
        self.call("Input.dispatchKeyEvent", type="keyUp", **of_key)

    def prefer(self, scheme: str) -> None:
        """Switches to the light or the dark scheme."""
        self.call(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-color-scheme", "value": scheme}],
        )

    def photograph(self, path: Path) -> None:
        """Writes a picture of the page."""
        picture = self.call("Page.captureScreenshot")["data"]
        path.write_bytes(base64.b64decode(picture))

    def close(self) -> None:
        """Ends the browser."""
        self._socket.close()
        self._process.terminate()
        self._process.wait()
