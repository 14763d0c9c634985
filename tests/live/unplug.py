"""Unplugs a microphone or kills its server, and brings it back, many times while a face listens.

    python tests/live/unplug.py [--times 200]

Fails if the face does not come back, or if its memory grows.
"""

import argparse
import sys

from sound_system import LiveFace, SoundSystem, until


def main() -> int:
    """Kills the server every tenth time, and unplugs the device the other times."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--times", type=int, default=200)
    times = parser.parse_args().times
    with SoundSystem() as system:
        face = LiveFace(system)
        until(lambda: face.count("listening to"), "it listens")
        memory = []
        for number in range(1, times + 1):
            if number % 10 == 0:
                system.stop()
            else:
                system.unplug()
            until(
                lambda number=number: face.count("Desk is gone") == number,
                f"it is gone, time {number}",
            )
            frames = len(face.frames)
            until(lambda frames=frames: len(face.frames) > frames + 5, "frames go on")
            if number % 10 == 0:
                system.start()
            else:
                system.plug()
            until(
                lambda number=number: face.count("Desk is back") == number,
                f"it is back, time {number}",
            )
            memory.append(face.memory_mb())
            if number % (max(times // 10, 1)) == 0:
                print(f"{number} times, {memory[-1]:.1f} MB", flush=True)
        is_alive = face.process.poll() is None
        face.end()
    grown = memory[-1] - memory[min(20, len(memory) - 1)]
    print(f"alive: {is_alive}; {grown:+.1f} MB since the first twenty")
    return 0 if is_alive and grown < 5.0 else 1


if __name__ == "__main__":
    sys.exit(main())
