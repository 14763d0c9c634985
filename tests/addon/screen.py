"""A Blender window on a display of its own. Tests drive it by mouse and keys and photograph it."""

import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

DRIVER = Path(__file__).with_name("window_driver.py")
SIZE = (1280, 800)
# Parts of the screen that the pages show: width x height + left + top.
HEAD_AND_SIDEBAR = "738x638+319+80"
WITH_CHANNELS = "834x638+223+80"
WITHOUT_PROPERTIES = "1057x748+0+28"
PREFERENCES = "690x545+567+128"
PATIENCE_S = 120.0


def install_in(blender: Path, zipped: Path, folder: Path) -> None:
    """Puts the extension into the Blender whose resources lie in `folder`."""
    copy = folder / "anyface.zip"
    if zipped != copy:
        shutil.copy(zipped, copy)
    words = [blender, "-b", "--command", "extension", "install-file", "-r", "user_default", "-e"]
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(folder)}
    subprocess.run([*words, copy], env=environment, check=True, capture_output=True)


class Screen:
    """`enter` runs programs beside Blender's executable (see packaging/chroot.sh)."""

    def __init__(self, enter: Path, blender: Path, folder: Path):
        self.enter, self.folder = enter, folder
        self.environment = {
            **os.environ,
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "BLENDER_USER_RESOURCES": str(folder),
            "XDG_RUNTIME_DIR": str(folder),
        }
        (folder / "driver.py").write_text(DRIVER.read_text())
        screen = ("-screen", "0", f"{SIZE[0]}x{SIZE[1]}x24", "-ac", "-nolisten", "tcp")
        # The server picks a free display and prints its number.
        command = [str(enter), "Xvfb", "-displayfd", "1", *screen]
        self._server = subprocess.Popen(
            command,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        display = self._server.stdout.readline().decode().strip()
        assert display, "Xvfb did not start"
        self.environment["DISPLAY"] = f":{display}"
        self.log = open(folder / "blender.log", "w")  # noqa: SIM115 - closed in close()
        words = ("--factory-startup", "-p", "0", "0", *SIZE, "--python", folder / "driver.py")
        self._blender = self._start(
            blender, *words, "--addons", "bl_ext.user_default.anyface", "--", folder
        )
        assert self.ask("answer = bpy.app.background") is False

    def _start(self, *words):
        command = [str(word) for word in words]
        return subprocess.Popen(
            command, env=self.environment, stdout=self.log, stderr=self.log, start_new_session=True
        )

    def close(self) -> None:
        """Ends Blender and the display."""
        # SIGTERM, unlike SIGKILL, lets the server remove its socket.
        for process, end in ((self._blender, signal.SIGKILL), (self._server, signal.SIGTERM)):
            os.killpg(process.pid, end)
            process.wait()
        self.log.close()

    def ask(self, code: str):
        """Runs `code` in Blender and returns what it left in `answer`."""
        reply = self.folder / "answer.json"
        half = self.folder / "ask.part"
        half.write_text(code)
        os.replace(half, self.folder / "ask.py")
        ends = time.monotonic() + PATIENCE_S
        while not reply.exists():
            assert self._blender.poll() is None, (self.folder / "blender.log").read_text()[-3000:]
            assert time.monotonic() < ends, f"Blender did not answer: {code}"
            time.sleep(0.02)
        result = json.loads(reply.read_text())
        reply.unlink()
        assert "error" not in result, result["error"]
        return result["answer"]

    def wait(self, code: str, patience_s: float = PATIENCE_S) -> float:
        """Waits until the expression is true. Returns how many seconds that took."""
        began = time.monotonic()
        while not self.ask(f"answer = bool({code})"):
            assert time.monotonic() < began + patience_s, f"never true: {code}"
        return time.monotonic() - began

    def hand(self, *words) -> None:
        """Runs xdotool: `mousemove X Y`, `click 1`, `key ctrl+z` …"""
        command = [str(self.enter), "xdotool", *(str(word) for word in words)]
        subprocess.run(command, env=self.environment, check=True, capture_output=True)

    def photograph(self, path: Path, part: str | None = None) -> None:
        """Saves the screen as PNG. A `part` of it, for the pages, gets only 256 colours."""
        shot = self.folder / "shot.png"
        crop = ["-crop", part, "+repage", "-colors", "256"] if part else []
        kind = "PNG8" if part else "PNG24"
        command = [str(self.enter), "import", "-window", "root", *crop, f"{kind}:{shot}"]
        subprocess.run(command, env=self.environment, check=True, capture_output=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(shot.read_bytes())

    def find(self, operator: str, share: float = 1 / 3) -> tuple[int, int]:
        """Where the button of an operator is, at a `share` of the sidebar's width.

        It is found by Ctrl C, which copies a button's command to the clipboard.
        """
        return self._find(operator, "ctrl+c", share)

    def find_slider(self, path: str) -> tuple[int, int]:
        """Where a property's slider is. `path` is the end of the data path that Blender copies."""
        return self._find(path, "ctrl+alt+shift+c", 2 / 3)

    def scroll(self, button: int) -> None:
        """Scrolls the sidebar by the mouse wheel to its top (4) or its bottom (5)."""
        x = self.ask("_, _, _, side = area_of('VIEW_3D')\nanswer = side.x + side.width // 2")
        for _ in range(16):
            self.hand("mousemove", x, SIZE[1] // 2, "click", button)

    def _find(self, words: str, keys: str, share: float) -> tuple[int, int]:
        """Where in the sidebar, at a `share` of its width, `keys` copy a text with `words`."""
        x, top, bottom = self.ask(
            "_, area, _, side = area_of('VIEW_3D')\n"
            "height = bpy.context.window_manager.windows[0].height\n"
            f"x = side.x + int(side.width * {share})\n"
            "answer = (x, height - side.y - side.height, height - side.y)"
        )
        for y in range(top + 8, bottom - 4, 9):
            self.ask("bpy.context.window_manager.clipboard = ''")
            self.hand("mousemove", x, y, "sleep", "0.06", "key", keys, "sleep", "0.06")
            if words in self.ask("answer = bpy.context.window_manager.clipboard"):
                return x, y
        raise AssertionError(f"nothing in the sidebar copies {words}")

    def press(self, operator: str) -> None:
        """Clicks the button of an operator."""
        self.hand("mousemove", *self.find(operator), "sleep", "0.1", "click", "1")
