"""A pool of processes on this machine."""

import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed

from .attempt import run_shot


def run(command: list[str], shots: list[dict], workers: int, **limits) -> Iterator[dict]:
    """Reports of all shots as they end, `workers` at a time; `limits` as `run_shot` has them.

    The cores are shared out. Where the caller stops early, running processes are ended.
    """
    threads = max(1, (os.cpu_count() or 1) // workers)
    stop = threading.Event()
    with ThreadPoolExecutor(workers) as pool:
        waiting = [
            pool.submit(run_shot, command, shot, threads, stop=stop, **limits) for shot in shots
        ]
        try:
            for future in as_completed(waiting):
                yield future.result()
        finally:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
