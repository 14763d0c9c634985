"""A private PulseAudio server whose device hears what plays on it, and an `anyface live`."""

import json
import os
import subprocess
import tempfile
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COMMAND = os.environ.get("ANYFACE_COMMAND", str(ROOT / "target/debug/anyface"))
_SERVER = [
    "pulseaudio",
    "-n",
    "--daemonize=no",
    "--exit-idle-time=-1",
    "--disable-shm",
    "--use-pid-file=no",
    "-L",
]
_MODULES = "module-native-protocol-unix"


class SoundSystem:
    """A server without hardware; `with` starts and stops it."""

    def __init__(self, rate_hz: int = 48000, channels: int = 2):
        self._sink = f"rate={rate_hz} channels={channels} sink_properties=device.description=Desk"
        self._folder = tempfile.TemporaryDirectory()
        self._server = None
        hidden = {"PULSE_SERVER", "PULSE_RUNTIME_PATH", "DISPLAY", "DBUS_SESSION_BUS_ADDRESS"}
        inherited = {name: value for name, value in os.environ.items() if name not in hidden}
        self.environment = {
            **inherited,
            "XDG_RUNTIME_DIR": self._folder.name,
            "HOME": self._folder.name,
        }

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.stop()
        self._folder.cleanup()

    def start(self) -> None:
        """Starts the server and plugs its device in."""
        self._server = subprocess.Popen(
            [*_SERVER, _MODULES], env=self.environment, stderr=subprocess.DEVNULL
        )
        until(lambda: self.control("info") is not None, "PulseAudio runs")
        self.plug()

    def stop(self) -> None:
        """Kills the server, as a crash would."""
        self._server.kill()
        self._server.wait()

    def plug(self) -> None:
        """Adds the device, as if somebody plugged it in."""
        assert self.control("load-module", "module-null-sink", *self._sink.split()) is not None

    def plug_pipe(self, rate_hz: int) -> str:
        """Replaces the device by a 16-bit mono microphone that hears a pipe; returns its path."""
        self.unplug()
        pipe = f"{self._folder.name}/microphone"
        words = f"file={pipe} format=s16le rate={rate_hz} channels=1"
        properties = "source_properties=device.description=Desk"
        plugged = self.control("load-module", "module-pipe-source", *words.split(), properties)
        assert plugged is not None
        return pipe

    def unplug(self) -> None:
        """Takes the device away."""
        self.control("unload-module", "module-null-sink")

    def control(self, *words: str) -> str | None:
        """The output of pactl, or None if it fails."""
        done = subprocess.run(
            ["pactl", *words], env=self.environment, capture_output=True, text=True, check=False
        )
        return done.stdout if done.returncode == 0 else None


class LiveFace:
    """`anyface live --json`: collects `(time of arrival, frame)` of each line, and the notes."""

    def __init__(self, system: SoundSystem, *arguments: str):
        self.frames, self.notes = [], []
        self.process = subprocess.Popen(
            [COMMAND, "live", "--microphone", "desk", "--json", *arguments],
            env=system.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for pipe, take in (
            (
                self.process.stdout,
                lambda line: self.frames.append((time.monotonic(), json.loads(line))),
            ),
            (self.process.stderr, self.notes.append),
        ):
            threading.Thread(target=self._read, args=(pipe, take), daemon=True).start()

    @staticmethod
    def _read(pipe, take) -> None:
        for line in pipe:
            take(line)

    def count(self, text: str) -> int:
        """How many notes contain this text."""
        return sum(text in note for note in self.notes)

    def processor_s(self) -> float:
        """Seconds of processor time used so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(") ", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def memory_mb(self) -> float:
        """Memory in use."""
        return int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]) * 4096 / 1e6

    def end(self) -> None:
        """Kills the process."""
        self.process.kill()
        self.process.wait()


def until(is_so, what: str, seconds: float = 60.0) -> None:
    """Waits until `is_so()`; raises `TimeoutError` after `seconds`."""
    end = time.monotonic() + seconds
    while not is_so():
        if time.monotonic() > end:
            raise TimeoutError(f"expected that {what} within {seconds:.0f} s")
        time.sleep(0.02)
