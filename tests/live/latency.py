"""How late a face is behind its microphone, from sound that is played to lines on standard output.

    python tests/live/latency.py SPEECH.wav [--rate 44100] [--fps 60] [--times 12]

The voice, mono at 16 kHz, is played on a PulseAudio without hardware; a recorder beside the face
tells when its first sample came out of the device. Where the lips part in the same sound without a
clock tells which instant of the face that is; the median over all times joins both clocks. A packet
is late by its arrival less the instant of the sound that it stands at, look-ahead included.
"""

import argparse
import itertools
import json
import subprocess
import time
import wave

import numpy as np

from sound_system import COMMAND, LiveFace, SoundSystem, until

_RATE_HZ = 16000
_PARTED = 0.05
_PAUSE_S = 3


def main() -> None:
    """Prints percentiles of the delay and the share of a core."""
    parser = argparse.ArgumentParser()
    parser.add_argument("speech")
    parser.add_argument("--rate", type=int, default=48000)
    parser.add_argument("--fps", type=int, default=25)
    parser.add_argument("--times", type=int, default=12)
    options = parser.parse_args()
    parted_s = heard_before_s(options.speech)
    with SoundSystem(options.rate) as system:
        face = LiveFace(system, "--fps", str(options.fps))
        until(lambda: len(face.frames) > 50, "frames come")
        began, used, first = time.monotonic(), face.processor_s(), len(face.frames)
        clocks = [clock_s(system, face, options.speech, parted_s) for _ in range(options.times)]
        share = (face.processor_s() - used) / (time.monotonic() - began)
        face.end()
    delays = [at - frame["time_s"] - np.median(clocks) for at, frame in face.frames[first:]]
    middle, most = np.percentile(delays, [50, 95])
    print(f"{options.rate} Hz, {options.fps} frames a second, {len(delays)} packets:")
    print(f"delay {1e3 * middle:.0f} ms (median), {1e3 * most:.0f} ms (95 %)")
    print(f"clocks differ by {1e3 * np.std(clocks):.0f} ms; {100 * share:.1f} % of a core")


def heard_before_s(speech: str) -> float:
    """When the lips part after a voice begins that was heard four times before."""
    with wave.open(speech) as file:
        samples = file.readframes(file.getnframes())
    once = samples + bytes(2 * _PAUSE_S * _RATE_HZ)
    words = [COMMAND, "live", "--input", "-", "--json"]
    done = subprocess.run(words, input=5 * once, capture_output=True, check=True)
    start_s = 4 * len(once) / 2 / _RATE_HZ
    frames = [json.loads(line) for line in done.stdout.splitlines()]
    return parting_s([frame for frame in frames if frame["time_s"] > start_s - 1]) - start_s


def parting_s(frames: list) -> float | None:
    """Instant at which the lips part, between two frames; None where they do not."""
    for one, other in itertools.pairwise(frames):
        low, high = one["shapes"]["jawOpen"], other["shapes"]["jawOpen"]
        if low <= _PARTED < high:
            share = (_PARTED - low) / (high - low)
            return one["time_s"] + share * (other["time_s"] - one["time_s"])
    return None


def clock_s(system: SoundSystem, face: LiveFace, speech: str, parted_s: float) -> float:
    """When the stream's first sample came out of the device, by a voice that is played."""
    recorder = subprocess.Popen(
        ["parec", "--format=s16le", "--rate=16000", "--channels=1", "--latency-msec=5"],
        env=system.environment,
        stdout=subprocess.PIPE,
    )
    time.sleep(1.5)
    start = len(face.frames)
    player = subprocess.Popen(["paplay", "--latency-msec=20", speech], env=system.environment)
    loud = []
    while not len(loud):
        block = np.frombuffer(recorder.stdout.read1(4096), "<i2")
        loud = np.flatnonzero(block)
    # The block was whole when it came: its first sound is that much older.
    heard = time.monotonic() - (len(block) - loud[0]) / _RATE_HZ

    def seen() -> float | None:
        return parting_s([frame for _, frame in face.frames[start:]])

    until(lambda: seen() is not None, "the lips part")
    clock = heard - (seen() - parted_s)
    recorder.kill()
    recorder.wait()
    player.wait()
    time.sleep(1.5)
    return clock


if __name__ == "__main__":
    main()
