"""Measures how late a face is behind its microphone, from sound to lines on standard output.

    python tests/live/latency.py SPEECH.wav [--rate 44100] [--fps 60] [--times 12] [...]

Further arguments go to `anyface live`. PulseAudio reads the device from a pipe. This script writes
the voice into the pipe in real time, mono at `--rate`, 2 ms at a time, so it knows the time of each
instant of the sound. It also runs the same sound without a clock. The motion of the jaw in both
runs tells which instant of the sound a frame shows. The delay of a line is the time of its arrival
minus the time of that instant. It includes the look-ahead.
"""

import argparse
import json
import subprocess
import threading
import time
import wave

import numpy as np

from sound_system import COMMAND, LiveFace, SoundSystem, until

_RATE_HZ = 16000
_PAUSE_S = 3
_BLOCK_S = 0.002


def main() -> None:
    """Prints percentiles of the delay and the share of a core."""
    parser = argparse.ArgumentParser()
    parser.add_argument("speech")
    parser.add_argument("--rate", type=int, default=48000)
    parser.add_argument("--fps", type=int, default=25)
    parser.add_argument("--times", type=int, default=12)
    options, live = parser.parse_known_args()
    sound = repeated(options.speech, options.times)
    with SoundSystem() as system:
        pipe = system.plug_pipe(options.rate)
        face = LiveFace(system, "--fps", str(options.fps), *live)
        microphone = Microphone(pipe, resampled(sound, options.rate), options.rate)
        until(lambda: len(face.frames) > 50, "frames come")
        began, used = time.monotonic(), face.processor_s()
        microphone.join()
        share = (face.processor_s() - used) / (time.monotonic() - began)
        face.end()
    spoken_s = len(sound) / _RATE_HZ
    offsets_s = offsets_between(face.frames, sound, live, options.times)
    offset_s = np.median(offsets_s)
    delays_ms = [
        1e3 * (at - microphone.start_s - frame["time_s"] - offset_s)
        for at, frame in face.frames
        # Frames at the end of the sound wait for samples that never come.
        if 2 < frame["time_s"] + offset_s < spoken_s - 1
    ]
    least, middle, most = np.percentile(delays_ms, [0, 50, 95])
    print(f"{options.rate} Hz, {options.fps} frames a second, {len(delays_ms)} lines:")
    print(f"delay {middle:.0f} ms (median), {most:.0f} ms (95 %), {least:.0f} ms (least)")
    print(f"{100 * share:.1f} % of a core; clocks differ by {1e3 * np.ptp(offsets_s):.1f} ms")


def repeated(speech: str, times: int) -> np.ndarray:
    """The voice `times` times, with silence before each repetition."""
    with wave.open(speech) as file:
        once = np.frombuffer(file.readframes(file.getnframes()), "<i2")
    return np.tile(np.concatenate([np.zeros(_PAUSE_S * _RATE_HZ, "<i2"), once]), times)


def resampled(sound: np.ndarray, rate_hz: int) -> np.ndarray:
    """The sound at the rate of the device, by linear interpolation."""
    times = np.arange(len(sound) * rate_hz // _RATE_HZ) * (_RATE_HZ / rate_hz)
    return np.interp(times, np.arange(len(sound)), sound).astype("<i2")


class Microphone(threading.Thread):
    """Writes a sound into a pipe by the clock, as a device that records it would."""

    def __init__(self, pipe: str, sound: np.ndarray, rate_hz: int):
        super().__init__(daemon=True)
        self._pipe, self._sound, self._rate_hz = pipe, sound, rate_hz
        self.start_s = time.monotonic()
        self.start()

    def run(self) -> None:
        """Writes each block at the time of its last sample."""
        block = round(_BLOCK_S * self._rate_hz)
        with open(self._pipe, "wb", buffering=0) as pipe:
            for first in range(0, len(self._sound), block):
                due_s = self.start_s + (first + block) / self._rate_hz
                time.sleep(max(0.0, due_s - time.monotonic()))
                pipe.write(self._sound[first : first + block].tobytes())


def offsets_between(frames: list, sound: np.ndarray, live: list, times: int) -> list[float]:
    """Delay in seconds from the sound to the face, found by the motion of its jaw.

    Returns one value for each repetition except the first and the last. In the first, the voice is
    new to the face. The values are alike unless samples were dropped.
    """
    words = [COMMAND, "live", "--input", "-", "--json", *live]
    whole = []
    # Start at several offsets, so that the jaw is known between the stream's frames too.
    for first in range(0, _RATE_HZ // 25, 40):
        rest = sound[first:].tobytes()
        done = subprocess.run(words, input=rest, capture_output=True, check=True)
        for line in done.stdout.splitlines():
            frame = json.loads(line)
            whole.append((frame["time_s"] + first / _RATE_HZ, frame["shapes"]["jawOpen"]))
    whole_s, jaw = np.array(sorted(whole)).T
    jaw_of = [(frame["time_s"], frame["shapes"]["jawOpen"]) for _, frame in frames]
    heard_s, heard_jaw = np.array(jaw_of).T

    def offset_s(is_part: np.ndarray) -> float:
        def error(offset_s: float) -> float:
            jaw_then = np.interp(heard_s[is_part] + offset_s, whole_s, jaw)
            return float(np.square(jaw_then - heard_jaw[is_part]).mean())

        coarse = min(np.arange(-1.0, 5.0, 0.02), key=error)
        return min(np.arange(coarse - 0.02, coarse + 0.02, 0.0005), key=error)

    one_s = len(sound) / _RATE_HZ / times
    return [offset_s(heard_s // one_s == number) for number in range(1, times - 1)]


if __name__ == "__main__":
    main()
